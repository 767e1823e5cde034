"""Strategies: how the tracks of one slice are laid out, each a function of the slice alone."""

from lmctl.lazy_exports import exports_of

__all__ = ["SliceTask", "StrategyTracks", "tracks_of_slice"]

__getattr__ = exports_of(__name__, {
    "SliceTask": "lmctl.plan.geometry.strategies.slice_task",
    "StrategyTracks": "lmctl.plan.geometry.strategies.slice_task",
    "tracks_of_slice": "lmctl.plan.geometry.strategies.choice",
})
