"""The geometry of a layer placed for each copy of the part: computed once, deposited many times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lmctl.part.copies import PartCopy
from lmctl.plan.geometry.layer_geometry import LayerGeometry


def layer_of_copies(geometry: LayerGeometry, copies: Sequence[PartCopy]) -> LayerGeometry:
    """All copies of a layer as one layer, in the coordinates that copies share.

    Tracks of one copy after those of another; figures are those of all copies together, without
    what is lost and what overhangs, which is the same in each.
    """
    n, tracks, islands = len(copies), geometry.n_tracks, int(geometry.island.max(initial=-1)) + 1
    figures = geometry.figures.scaled(n)
    return replace(
        geometry,
        points_mm=np.vstack([copy.places_mm(geometry.points_mm) for copy in copies]),
        starts=np.concatenate(
            [[0], *(geometry.starts[1:] + k * len(geometry.points_mm) for k in range(n))]
        ).astype(np.intp),
        strip_width_mm=np.tile(geometry.strip_width_mm, n),
        fractions=np.tile(geometry.fractions, (n, 1)),
        is_closed=np.tile(geometry.is_closed, n),
        island=np.concatenate([geometry.island + k * islands for k in range(n)]).astype(np.intp),
        outline_mm=np.vstack([copy.places_mm(geometry.outline_mm) for copy in copies]),
        outline_starts=np.concatenate(
            [[0], *(geometry.outline_starts[1:] + k * len(geometry.outline_mm) for k in range(n))]
        ),
        figures=replace(figures, lost=(), overhang=()),
        is_directed=None if geometry.is_directed is None else np.tile(geometry.is_directed, n),
        rounds=None if geometry.rounds is None else np.tile(geometry.rounds, n),
        fractions_across=None if geometry.fractions_across is None else np.tile(
            geometry.fractions_across, (n, 1, 1)),
        fractions_below=None if geometry.fractions_below is None else np.tile(
            geometry.fractions_below, (n, 1)),
        designed=None if geometry.designed is None else np.tile(geometry.designed, (n, 1)),
        copy=np.repeat(np.arange(n, dtype=np.intp), tracks))
