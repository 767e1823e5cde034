"""The words of a recipe: heartbeat to shadow block in one write.

Source: docs/explanation/powder-delivery.md, Feeders.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence

from firmware_protocol.pmx import (
    SetpointMode,
    WatchdogAction,
    hopper_register_name,
    recipe_register_names,
    register_map,
)
from firmware_protocol.registers import RegisterValue
from lmctl.config.machine import FeederSettings, HopperSettings
from lmctl.machine.feeder.flow_law import FlowLaw

_COUNTS_PER_G_MIN = 100
_MAX_COUNT = 65_534  # of a 16-bit register that may be "not available"

#: Longest time a disc takes to reach a new set-point [s].
_FOLLOWS_WITHIN_S = 1.0


class RecipeWriter:
    """Turns flows into the words of one write. address : of the first word.

    n_hoppers : what the device has, used or not; the discs of unused hoppers do not turn
    laws : by hopper name, between flows and the device's set-points
    """

    def __init__(self, feeder: FeederSettings, hoppers: Sequence[HopperSettings],
                 n_hoppers: int) -> None:
        self.laws = {hopper.name: FlowLaw(hopper) for hopper in hoppers}
        table = register_map(n_hoppers)
        block = table.contiguous_block(recipe_register_names(n_hoppers))
        self.address = block.address
        self._hoppers = tuple(hoppers)
        self._most = [round(h.max_flow_g_min * _COUNTS_PER_G_MIN) for h in hoppers]
        self._words = block.encode(_settings(feeder, hoppers, n_hoppers))
        self._at = {
            name: table.wire_address(name) - block.address
            for name in ("HEARTBEAT", "SEQ")
        }
        self._flow_at = [
            table.wire_address(hopper_register_name(h.channel,
                                                    "FLOW_SP")) - block.address for h in hoppers
        ]

    def flow_counts(self, flows_g_min: Mapping[str, float]) -> tuple[int, ...]:
        """Set-points for these flows as the device resolves them, 0.01 g/min each, in the hoppers'
        order.

        Raises ValueError for a flow that is no number, out of range, or of an unknown hopper.
        """
        if len(flows_g_min) != len(self._hoppers):
            raise ValueError(f"flows for {sorted(flows_g_min)}, not for every hopper")
        counts = []
        for hopper, most in zip(self._hoppers, self._most, strict=True):
            flow_g_min = flows_g_min.get(hopper.name, math.nan)
            count = round(flow_g_min * _COUNTS_PER_G_MIN) if math.isfinite(flow_g_min) else -1
            if not 0 <= count <= most:
                raise ValueError(
                    f"hopper {hopper.name}: {flow_g_min} g/min is not within 0 to "
                    f"{hopper.max_flow_g_min:g}"
                )
            setpoint_g_min = self.laws[hopper.name].setpoint_g_min(flow_g_min)
            counts.append(min(round(setpoint_g_min * _COUNTS_PER_G_MIN), _MAX_COUNT))
        return tuple(counts)

    def recipe_words(self, counts: Sequence[int], *, sequence: int, heartbeat: int) -> list[int]:
        """The write that makes these flows the recipe number `sequence`."""
        words = list(self._words)
        words[self._at["HEARTBEAT"]] = heartbeat
        words[self._at["SEQ"]] = sequence
        for at, count in zip(self._flow_at, counts, strict=True):
            words[at] = count
        return words


class PreviousFlows:
    """Earlier set-points, from which the hoppers' discs may still be ramping.

    laws : in the hoppers' order
    """

    def __init__(self, laws: Sequence[FlowLaw]) -> None:
        self._laws = tuple(laws)
        self._until: deque[tuple[float, tuple[int, ...]]] = deque()

    def record_replaced(self, counts: tuple[int, ...], t_s: float) -> None:
        """Record the recipe that has just been replaced."""
        self._until.append((t_s, counts))

    def recent_setpoints_g_min(self, hopper: int, t_s: float) -> tuple[float, ...]:
        """Flows commanded of a hopper, by its index, shortly before t_s."""
        while self._until and self._until[0][0] < t_s - _FOLLOWS_WITHIN_S:
            self._until.popleft()
        return tuple(self._laws[hopper].flow_g_min(counts[hopper] / _COUNTS_PER_G_MIN)
                     for _, counts in self._until)


def settling_time_s(hoppers: Sequence[HopperSettings]) -> float:
    """θ + 4τ of the slowest hose: after that a step has arrived to 98 %.

    Source: docs/explanation/powder-delivery.md, Transport delay and lag.
    """
    return max(h.dead_time_s + 4.0 * h.lag_s for h in hoppers)


def _settings(
    feeder: FeederSettings, hoppers: Sequence[HopperSettings], n_hoppers: int
) -> dict[str, RegisterValue]:
    """Every value of the write but those that change with each one."""
    values: dict[str, RegisterValue] = dict.fromkeys(recipe_register_names(n_hoppers), 0)
    values |= {
        "WD_TIMEOUT": round(feeder.watchdog_s * 1000),
        "WD_ACTION": WatchdogAction.DISCS_STOP,
        "STABILISE": max(feeder.stabilise_s, settling_time_s(hoppers)),
        "POSTFLOW": post_flow_duration_s(feeder, hoppers),
        "SETPOINT_MODE": SetpointMode.G_MIN,
        "AT_SPEED_TOL": 2.0,
    }
    for hopper in hoppers:
        values[hopper_register_name(hopper.channel, "CARRIER_SP")] = hopper.carrier_L_min
    return values


def post_flow_duration_s(feeder: FeederSettings, hoppers: Sequence[HopperSettings]) -> float:
    """Gas after powder: what the profile asks for, and long enough to empty the hose."""
    return max(feeder.gas_postflow_s, settling_time_s(hoppers))
