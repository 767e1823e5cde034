"""Keep the predictions of some layers of a plan, evenly spread, within a bound of memory."""

from __future__ import annotations

from lmctl.plan.sequence.mixture_prediction import MixturePrediction

#: Pieces of path kept at most, of all layers together; a piece takes about 130 bytes.
MAX_PIECES = 8_000
#: So many layers are kept however many pieces they have.
_LEAST_LAYERS = 2


class SampledLayers:
    """Predictions of every layer, or of every 2nd, 4th, … where they are many.

    layers : (k,) predictions, in the order of the job
    seen : layers with beads so far
    """

    def __init__(self, max_pieces: int = MAX_PIECES) -> None:
        self._max_pieces = max_pieces
        self._stride = 1
        self._kept: list[tuple[int, MixturePrediction]] = []
        self.seen = 0

    @property
    def layers(self) -> list[MixturePrediction]:
        return [layer for _, layer in self._kept]

    @property
    def are_all(self) -> bool:
        """Whether no layer is left out."""
        return len(self._kept) == self.seen

    def add(self, prediction: MixturePrediction) -> None:
        """The next layer's prediction."""
        if self.seen % self._stride == self._within_stride:
            self._kept.append((self.seen, prediction))
        self.seen += 1
        while len(self._kept) > _LEAST_LAYERS and self._pieces() > self._max_pieces:
            self._stride *= 2
            self._kept = [(number, layer) for number, layer in self._kept
                          if number % self._stride == self._within_stride]

    @property
    def _within_stride(self) -> int:
        """Which layer of a stride is kept: away from its ends, and one kept at half the stride."""
        return 0b0101010101010101010101010101 & (self._stride - 1)

    def _pieces(self) -> int:
        return sum(len(layer.pieces) for _, layer in self._kept)
