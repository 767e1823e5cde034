"""Feeders whose registers a map file describes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.machine.feeder.mapped.link import MappedFeederLink as MappedFeederLink

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {"MappedFeederLink": "lmctl.machine.feeder.mapped.link"}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
