"""What beads of one mixture each reach at best on the union of two cylinders, whatever plans do.

Straight beads lie side by side across an even gradient, in four layers, and the simulated process
deposits them: no planner is asked. Tried are pitches down to half of the part's, one after the
other or every other one first and then those between, layers upon each other or moved by half a
pitch. The mixture of each bead is that under its middle, moved by an amount that is searched for
each kind of bead (of odd and even layers, first and second rounds) so that the most of the volume
is within ±0.03. Moved by no more than the tolerance of a path, 0.02, it is right by path, too;
moved by any amount the nozzle's place has another mixture than the part.

Where both cylinders are, the mixture goes from one end to the other across the lens that they
share, in a straight line: 0.8 over its width, the steeper the nearer its tips. The bound takes the
best of all tried at each width, as if pitch and order could change from place to place, and all of
the rest of the part for right.

    python -m tests.benchmarks.mixture_rows.bead_bound
"""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass

import numpy as np

from simulators.array_types import FloatArray
from simulators.process.deposition import lay_pieces

BEAD_MM, LAYER_MM, CELL_MM = 2.0, 0.8, 0.25
PITCHES_MM = (1.334, 1.2, 1.067, 0.934, 0.8, 0.667)
#: Beyond what is bounded: a fifth of a bead apart, in five rounds.
FINEST_MM, FINEST_ROUNDS = 0.4, (0, 3, 1, 4, 2)
ROUNDS = ((0,), (0, 1))
MOVED = (0.0, 0.5)
LAYERS, WIDTH_MM, LENGTH_MM = 4, 24.0, 3.0
PATH_TOLERANCE, VOLUME_TOLERANCE = 0.02, 0.03
#: Of the part: radii of the cylinders, how far apart they are, and the change across the lens.
RADII_MM, APART_MM, CHANGE = (12.0, 10.0), 14.0, 0.8
#: Gradients at which shares are computed [1/mm]: the middle of the lens has 0.1.
GRADIENTS = (0.1, 0.11, 0.12, 0.14, 0.16, 0.2, 0.25, 0.3, 0.4, 0.6, 1.0)


@dataclass(frozen=True)
class RowOfBeads:
    """Voxels (n,) in the middle of a block of beads: their volume, how far the beads in them lie
    from them in the mean [mm], and of which kinds these are, (n, kinds)."""

    volume: FloatArray
    off_mm: FloatArray
    kinds: FloatArray

    def best_share(self, gradient: float, most: float) -> float:
        """Within tolerance, with each kind's mixture moved by so much at most."""
        moved = np.zeros(self.kinds.shape[1])

        def share(moved: FloatArray) -> float:
            off = np.abs(self.off_mm * gradient - self.kinds @ moved)
            return float(self.volume[off <= VOLUME_TOLERANCE].sum() / self.volume.sum())

        found = share(moved)
        for _ in range(3):
            for kind in range(len(moved)):
                for to in np.linspace(-most, most, 41):
                    tried = moved.copy()
                    tried[kind] = to
                    if share(tried) > found:
                        moved, found = tried, share(tried)
        return found


def row_of_beads(pitch_mm: float, rounds: tuple[int, ...], moved: float) -> RowOfBeads:
    """Deposit a block; moved : every other layer, in pitches."""
    place, kind = [], []
    for layer in range(LAYERS):
        x = np.arange(4.0 + moved * pitch_mm * (layer % 2), WIDTH_MM - 4.0, pitch_mm)
        order = np.concatenate([np.arange(len(x))[one::len(rounds)] for one in rounds])
        if layer % 2:
            order = order[::-1]
        for bead in order:
            y = np.arange(CELL_MM / 4, LENGTH_MM, CELL_MM / 2)
            place.append(np.column_stack([np.full(len(y), x[bead]), y, np.full(len(y), LAYER_MM)]))
            kind.append(np.full(len(y), len(rounds) * (layer % 2) + bead % len(rounds)))
    at, of_kind = np.vstack(place), np.concatenate(kind)
    n, kinds = len(at), 2 * len(rounds)
    volume = np.zeros((n, 2 + kinds))
    each = pitch_mm * LAYER_MM * CELL_MM / 2
    # half of it says where the middle of its bead is, the other half of which kind it is
    volume[:, 1] = each / 2 * at[:, 0] / WIDTH_MM
    volume[:, 0] = each / 2 - volume[:, 1]
    volume[np.arange(n), 2 + of_kind] = each / 2
    step = np.linalg.norm(np.diff(at, axis=0), axis=1)
    advance = np.concatenate([[0.0], np.where(step > CELL_MM, 1e6, step)])
    shape = (round(WIDTH_MM / CELL_MM), round((LENGTH_MM + 2) / CELL_MM), 24)
    voxels = np.zeros((*shape, volume.shape[1] + 1))
    top = np.zeros(shape[:2])
    lay_pieces(
        at + np.array([0.0, 1.0, 0.0]), np.tile([0.0, 1.0], (n, 1)), np.full(n, CELL_MM / 2),
        advance, np.full(n, BEAD_MM), np.zeros(n), volume, np.zeros(volume.shape[1]), LAYER_MM,
        CELL_MM, CELL_MM, 0.0, top, voxels, np.zeros((n, volume.shape[1])), np.zeros(n))
    middle = voxels[32:64, 6:14, 3:11]  # of the block: no ends, no first and last layer's surface
    x = (np.arange(32, 64) + 0.5) * CELL_MM
    flat = middle.reshape(-1, middle.shape[-1])
    kept = flat.sum(axis=1) > 1e-9
    one = flat[kept]
    x = np.repeat(x, middle.shape[1] * middle.shape[2])[kept]
    half = one[:, :2].sum(axis=1)
    return RowOfBeads(2 * half, x - one[:, 1] / half * WIDTH_MM, one[:, 2:-1] / half[:, None])


def bound_rows() -> dict[str, float]:
    """Shares of the union's volume at most: by beads that are right by path; by any beads; and by
    beads a fifth of their width apart, in five rounds, that are right by path."""
    rows = [row_of_beads(*one) for one in itertools.product(PITCHES_MM, ROUNDS, MOVED)]
    finest = [row_of_beads(FINEST_MM, FINEST_ROUNDS, moved) for moved in MOVED]
    return {
        "volume_union_bound": _of_part(rows, PATH_TOLERANCE),
        "volume_union_bound_any_path": _of_part(rows, 0.1),
        "volume_union_bound_finest": _of_part(finest, PATH_TOLERANCE),
    }


def _of_part(rows: list[RowOfBeads], most: float) -> float:
    best = [max(row.best_share(gradient, most) for row in rows) for gradient in GRADIENTS]
    (a, b), y = RADII_MM, np.linspace(-RADII_MM[1], RADII_MM[1], 4001)
    width = np.sqrt(np.clip(a**2 - y**2, 0, None)) - APART_MM + np.sqrt(np.clip(
        b**2 - y**2, 0, None))
    width = np.clip(width, 0.0, None)
    step = y[1] - y[0]
    lens = float(width.sum() * step)
    share = np.interp(CHANGE / np.maximum(width, 1e-3), GRADIENTS, best)
    whole = np.pi * (a**2 + b**2) - lens
    return round(1 - float(((1 - share) * width).sum() * step) / whole, 4)


if __name__ == "__main__":
    print(json.dumps(bound_rows(), indent=1))
