"""The catch scale under the nozzle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.machine.scale.driver import CatchScaleDriver as CatchScaleDriver
    from lmctl.machine.scale.reading import ScaleReading as ScaleReading

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "CatchScaleDriver": "lmctl.machine.scale.driver",
    "ScaleReading": "lmctl.machine.scale.reading",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
