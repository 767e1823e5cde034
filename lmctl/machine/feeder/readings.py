"""A feeder's reading of one hopper, in the units of the cell: flows in g/min."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from firmware_protocol.pmx import (
    PMX_MAP,
    HopperStatusBits,
    hopper_input_names,
    hopper_register_name,
    mirror_offset,
)
from firmware_protocol.registers import WordOrder
from lmctl.config.machine import HopperSettings
from lmctl.machine.feeder.flow_law import FlowLaw


@dataclass(frozen=True)
class HopperReading:
    """One hopper as last read; None where the device reports "not available".

    time_s : loop time of the reply; hoppers are read less often than the device itself
    setpoint_g_min : what the disc is asked to feed now, after the device's ramp
    previous_setpoints_g_min : earlier set-points, from which the disc may still be ramping
    flow_estimated_g_min : disc speed times feed factor, by the hopper's calibrated law
    flow_weighed_g_min : from the load cell
    """

    time_s: float
    flags: HopperStatusBits
    setpoint_g_min: float
    flow_estimated_g_min: float | None
    flow_weighed_g_min: float | None
    weight_g: float | None
    level_percent: float | None
    carrier_L_min: float | None
    previous_setpoints_g_min: tuple[float, ...] = ()


#: Rows of a hopper that a reading holds: the first of its block, in one read.
_READ = 11


class HopperReader:
    """Reads one hopper. address, count : of its input registers; mirrored : which of the mirror's.

    feed_factor_g_rev : as stored in the device, to convert disc speeds to set-points
    law : from set-points to flows; None: that of the profile
    """

    def __init__(
        self, hopper: HopperSettings, feed_factor_g_rev: float,
        word_order: WordOrder = WordOrder.ABCD, law: FlowLaw | None = None,
    ) -> None:
        wanted = [
            name for name in hopper_input_names(hopper.channel)
            if PMX_MAP[name].address < 100 * hopper.channel + _READ
        ]
        (block,) = PMX_MAP.plan_reads(wanted)
        self._block = block.with_word_order(word_order)
        self.address, self.count = self._block.address, self._block.count
        at = mirror_offset(hopper.channel)
        self.mirrored = slice(at, at + self.count)
        self._hopper = hopper
        self._factor = feed_factor_g_rev
        self._law = law or FlowLaw(hopper)

    def decode_reading(
        self, words: Sequence[int], time_s: float, former_g_min: tuple[float, ...] = ()
    ) -> HopperReading:
        """Raises RegisterError where the number of words is wrong."""
        values: dict[str, Any] = self._block.decode(words)

        def value(name: str) -> Any:
            return values[hopper_register_name(self._hopper.channel, name)]

        estimated = value("FLOW_EST")
        return HopperReading(
            time_s=time_s,
            flags=HopperStatusBits(value("STATUS")),
            setpoint_g_min=self._law.flow_g_min((value("DISC_RAMPED") or 0.0) * self._factor),
            flow_estimated_g_min=None if estimated is None else self._law.flow_g_min(estimated),
            flow_weighed_g_min=value("FLOW_LIW"),
            weight_g=value("WEIGHT"),
            level_percent=value("LEVEL"),
            carrier_L_min=value("CARRIER_ACT"),
            previous_setpoints_g_min=former_g_min,
        )
