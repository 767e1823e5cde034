"""Match each piece of a layer to the nearest piece of its kind in the layer below, within reach."""

from __future__ import annotations

from typing import Generic, TypeVar

Piece = TypeVar("Piece")
Place = tuple[float, float]


class PiecesBelow(Generic[Piece]):
    """The pieces of the last two layers by place, for layers taken in order.

    reach_mm : how far the middle of a piece may be from that of the one below it
    """

    def __init__(self, reach_mm: float) -> None:
        self._reach_mm = reach_mm
        self._layer = -1
        self._below: dict[tuple[str, int, int], list[tuple[Place, Piece]]] = {}
        self._here: dict[tuple[str, int, int], list[tuple[Place, Piece]]] = {}

    def take_piece_below(self, kind: str, at_mm: Place, layer: int) -> Piece | None:
        """The piece below a place, which no other piece of this layer gets any more."""
        self._go_to(layer)
        x, y = self._cell(at_mm)
        best: tuple[float, list[tuple[Place, Piece]], int] | None = None
        for i in (-1, 0, 1):
            for j in (-1, 0, 1):
                waiting = self._below.get((kind, x + i, y + j), [])
                for number, ((u, v), _) in enumerate(waiting):
                    away = ((u - at_mm[0]) ** 2 + (v - at_mm[1]) ** 2) ** 0.5
                    if away <= self._reach_mm and (best is None or away < best[0]):
                        best = away, waiting, number
        return None if best is None else best[1].pop(best[2])[1]

    def remember_piece(self, kind: str, at_mm: Place, layer: int, piece: Piece) -> None:
        """Remember a piece of this layer for the next."""
        self._go_to(layer)
        self._here.setdefault((kind, *self._cell(at_mm)), []).append((at_mm, piece))

    def _go_to(self, layer: int) -> None:
        if layer != self._layer:
            self._below = self._here if layer == self._layer + 1 else {}
            self._here = {}
            self._layer = layer

    def _cell(self, at_mm: Place) -> tuple[int, int]:
        return round(at_mm[0] / self._reach_mm), round(at_mm[1] / self._reach_mm)
