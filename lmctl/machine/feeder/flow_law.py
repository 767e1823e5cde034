"""A hopper's calibrated law between the flow it is set to and the flow it feeds."""

from __future__ import annotations

from lmctl.config.machine import HopperSettings


class FlowLaw:
    """flow = offset + slope · correction · set-point while the disc turns; 0 at set-point 0.

    correction : by which the slope is taken to have changed since it was measured; 1 at first
    """

    def __init__(self, hopper: HopperSettings) -> None:
        self.correction = 1.0
        self._slope = hopper.slope
        self._offset_g_min = hopper.offset_g_min

    def setpoint_g_min(self, flow_g_min: float) -> float:
        """What to set for a flow; 0 for none."""
        if flow_g_min <= 0.0:
            return 0.0
        return max((flow_g_min - self._offset_g_min) / (self._slope * self.correction), 0.0)

    def flow_g_min(self, setpoint_g_min: float) -> float:
        """What a set-point, or a disc at that speed, feeds."""
        if setpoint_g_min <= 0.0:
            return 0.0
        return max(self._offset_g_min + self._slope * self.correction * setpoint_g_min, 0.0)
