"""How long the powder in each hopper lasts, by its weight and by what the program still needs.

A refill takes an operator and some minutes, so it is announced well before a hopper is empty. The
feeder's own low-level warning comes on top (warning 51).
"""

from __future__ import annotations

import asyncio
from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import HopperSettings
from lmctl.errors import LmctlError
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobLayer, JobManifest
from lmctl.machine.feeder.readings import HopperReading
from lmctl.machine.feeder.warnings import FeederWarning
from lmctl.run.cell.devices import Cell
from lmctl.run.interlocks.alarms import RunAlarms
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.program.program_clock import ProgramClock

#: A refill is announced so long before a hopper is used up [s]; the announcement is over when it
#: lasts for so much longer.
REFILL_NOTICE_S = 900.0
_OVER = 1.2

#: Share of a full hopper that its disc does not feed evenly: it is not counted on.
RESERVE_FRACTION = 0.05

#: Longest time between two knots of what is used up [s]: between them it is taken as even.
_KNOTS_S = 1.0

#: How often weights are compared with the program; one layer is read each time [s].
_EVERY_S = 2.0

#: Number of this warning: below those that feeders have (process values 51 to 55).
REFILL_DUE_WARNING_NUMBER = 50


class _LayerNeed(NamedTuple):
    """Powder that a layer needs: knots of program time, and of each hopper the mass up to them."""

    layer: int
    time_s: FloatArray
    used_g: FloatArray


class SupplyForecast:
    """What the rest of a job needs of each hopper, layer by layer as it is requested.

    hoppers : in the job's order, as flows are
    """

    def __init__(
        self, manifest: JobManifest, read_layer: Callable[[int], JobLayer],
        hoppers: Sequence[HopperSettings],
    ) -> None:
        self.hoppers = tuple(hoppers)
        self._manifest = manifest
        self._read_layer = read_layer
        self._starts_s = [entry.start_s for entry in manifest.layers]
        self._needs: list[_LayerNeed] = []  # of consecutive layers

    @property
    def end_s(self) -> float:
        """Program time at the end of the job."""
        return self._manifest.layers[-1].end_s

    def read_ahead(self, s: float) -> None:
        """Read one layer more, up to ANNOUNCED_S ahead of program time s."""
        layer = max(bisect_right(self._starts_s, s) - 1, 0)
        self._needs = [need for need in self._needs if need.layer >= layer]
        following = self._needs[-1].layer + 1 if self._needs else layer
        if following < len(
            self._starts_s) and self._starts_s[following] < s + _OVER * REFILL_NOTICE_S:
            self._needs.append(_need_of(self._read_layer(following)))

    def lasts_until_s(self, hopper: int, s: float, left_g: float) -> float | None:
        """Program time at which so much powder is used up from program time s on.

        None where it is not within what has been looked at.
        """
        for need in self._needs:
            used_g, before_g = need.used_g[hopper], float(
                np.interp(s, need.time_s, need.used_g[hopper]))
            needed_g = float(used_g[-1]) - before_g
            if needed_g >= left_g:
                return float(np.interp(before_g + left_g, used_g, need.time_s))
            left_g -= needed_g
        return None

    def layer_at(self, s: float) -> int:
        """The layer, counted from 1, in which a program time lies."""
        return max(bisect_right(self._starts_s, s), 1)


def _need_of(layer: JobLayer) -> _LayerNeed:
    first_s, last_s = float(layer.flow_s[0]), float(layer.flow_s[-1])
    time_s = np.unique(np.concatenate([layer.flow_s, np.arange(first_s, last_s, _KNOTS_S)]))
    used_g = []
    for flow_g_s in layer.flow_g_s.T:
        flow = np.interp(time_s, layer.flow_s, flow_g_s)
        steps_g = np.diff(time_s) * (flow[1:] + flow[:-1]) / 2.0
        used_g.append(np.concatenate([[0.0], np.cumsum(steps_g)]))
    return _LayerNeed(layer.index, time_s, np.array(used_g))


def usable_powder_g(reading: HopperReading) -> float | None:
    """Powder that can be counted on, by weight and level; None without a load cell."""
    weight_g, percent = reading.weight_g, reading.level_percent
    if weight_g is None:
        return None
    full_g = 100.0 * weight_g / percent if percent else weight_g
    return max(0.0, weight_g - RESERVE_FRACTION * full_g)


class SupplyWatch:
    """Announces refills of one run, from `start` to `stop`. clock : of the present segment."""

    def __init__(
        self, job: JobReader, hoppers: Sequence[HopperSettings], cell: Cell,
        clock: Callable[[], ProgramClock], alarms: RunAlarms, recorder: RunRecorder,
    ) -> None:
        self._forecast = SupplyForecast(job.manifest, job.read_layer, hoppers)
        self._cell = cell
        self._clock = clock
        self._alarms = alarms
        self._recorder = recorder
        self._loop = asyncio.get_running_loop()
        self._active: dict[str, FeederWarning] = {}
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        self._timer = self._loop.call_later(_EVERY_S, self._look)

    def stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _look(self) -> None:
        clock = self._clock()
        s = clock.program_time_s(self._loop.time())
        try:
            self._forecast.read_ahead(s)
        except LmctlError:  # a layer that cannot be read ends the run when it is its turn
            return
        for index, hopper in enumerate(self._forecast.hoppers):
            self._look_at(index, hopper, s, clock.rate)
        self.start()

    def _look_at(self, index: int, hopper: HopperSettings, s: float, rate: float) -> None:
        reading = self._cell.hopper_reading(hopper.name)
        left_g = None if reading is None else usable_powder_g(reading)
        if reading is None or left_g is None:
            return
        until_s = self._forecast.lasts_until_s(index, s, left_g)
        lasts_s = None if until_s is None else (until_s - s) / max(rate, 0.01)
        active = self._active.get(hopper.name)
        if active is None and until_s is not None and lasts_s is not None and (
            lasts_s <= REFILL_NOTICE_S
        ):
            self._announce(hopper, reading, left_g, until_s, lasts_s)
        elif active is not None and (lasts_s is None or lasts_s > _OVER * REFILL_NOTICE_S):
            del self._active[hopper.name]
            self._set_warning(active, is_active=False)

    def _announce(
        self, hopper: HopperSettings, reading: HopperReading, left_g: float, until_s: float,
        lasts_s: float,
    ) -> None:
        more_min = (self._forecast.end_s - until_s) / 60.0
        warning = FeederWarning(
            REFILL_DUE_WARNING_NUMBER, hopper.feeder, hopper.name,
            f"hopper {hopper.name} of feeder {hopper.feeder}: of {reading.weight_g:.0f} g left "
            f"{left_g:.0f} g can be counted on, enough for {lasts_s / 60.0:.0f} min, until layer "
            f"{self._forecast.layer_at(until_s)}; the job lasts {more_min:.0f} min longer",
            f"have {hopper.material} at hand; `lmctl refill {hopper.name}` holds the run at the "
            "end of its path",
        )
        self._active[hopper.name] = warning
        self._set_warning(warning, is_active=True)

    def _set_warning(self, warning: FeederWarning, *, is_active: bool) -> None:
        self._recorder.record_warning(warning, is_active=is_active)
        self._alarms.set_warning(warning, is_active=is_active)
