"""Refilling a hopper in the middle of a run: requested, weighed, and verified by its flow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from firmware_protocol.pmx import HopperStatusBits
from lmctl.config.machine import HopperSettings
from lmctl.errors import UsageError
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.machine.feeder.readings import HopperReading
from lmctl.run.cell.devices import Cell
from lmctl.run.interlocks.alarms import InterlockError
from lmctl.run.journal.recorder import Refill, RunRecorder

#: A refilled hopper's flow is steady when it is by weight what is set, within this share but not
#: less than [g/min], for so long [s]: half of what the interlock on weighed flow allows.
_SHARE, _LEAST_G_MIN = 0.075, 0.25
_FOR_S = 5.0
_PATIENCE_S = 60.0

#: The mass named by the operator and the one weighed should agree so far, or it is reported.
_MASS_SHARE, _MASS_G = 0.05, 20.0


@dataclass(frozen=True)
class _Filled:
    """The powder filled in, as the operator states it."""

    lot: str
    mass_g: float


class RefillProcedure:
    """The refills of one run, one hopper after the other.

    hopper : the requested one, from the request until it is weighed; None otherwise
    """

    def __init__(self, hoppers: Sequence[HopperSettings], recorder: RunRecorder) -> None:
        self.hopper: HopperSettings | None = None
        self._hoppers = tuple(hoppers)
        self._recorder = recorder
        self._is_due = False
        self._before: HopperReading | None = None
        self._filled: _Filled | None = None
        self._unproven: list[HopperSettings] = []  # refilled, and powder has not run since

    @property
    def hopper_name(self) -> str | None:
        """The requested hopper's name."""
        return None if self.hopper is None else self.hopper.name

    # --- the operator

    def request_refill(self, name: str) -> None:
        """A hopper is to be opened when the run is held. Raises UsageError."""
        if self.hopper is not None and self.hopper.name != name:
            raise UsageError(f"hopper {self.hopper.name} is being refilled",
                             hint="finish that first: one hopper after the other")
        self.hopper, self._is_due = self._named(name), True

    def take_due_request(self) -> bool:
        """Whether a requested hopper is still to be opened; reading it clears the request."""
        is_due, self._is_due = self._is_due, False
        return is_due

    def confirm_filled(self, name: str, lot: str, mass_g: float) -> None:
        """A hopper has been filled and closed. Raises UsageError where another one is open."""
        if self.hopper is None or self.hopper.name != name:
            raise UsageError(
                f"hopper {name} is not open for refilling",
                hint=f"`lmctl refill {self._named(name).name}` makes it ready to be opened",
            )
        self._filled = _Filled(lot, mass_g)

    def _named(self, name: str) -> HopperSettings:
        for hopper in self._hoppers:
            if hopper.name == name:
                return hopper
        names = ", ".join(hopper.name for hopper in self._hoppers)
        raise UsageError(f"this run uses no hopper {name!r}", hint=f"its hoppers: {names}")

    # --- the cell

    async def open_hopper(self, cell: Cell) -> None:
        """Powder and gas of its feeder off; the hopper may be opened. Raises MachineError."""
        hopper = self._asked
        try:
            self._before = await _feeder_of(cell, hopper).open_hopper(hopper.name)
        except Exception:
            self.hopper = None
            raise

    async def weigh_and_record(self, cell: Cell) -> str:
        """Weigh what was filled in and journal it; returns a sentence for people.

        Raises MachineError where the weight does not settle.
        """
        hopper, filled, before = self._asked, self._filled, self._before
        if filled is None:
            raise RuntimeError("a hopper was closed before it was filled")
        after = await _feeder_of(cell, hopper).close_hopper(hopper.name)
        before_g = None if before is None else before.weight_g
        weighed_g = None
        if before_g is not None and after.weight_g is not None:
            weighed_g = after.weight_g - before_g
        self._recorder.record_refill(Refill(
            hopper.name, hopper.material, filled.lot, filled.mass_g, weighed_g, before_g,
            after.weight_g,
        ))
        self._unproven.append(hopper)
        self.hopper = self._before = self._filled = None
        return _sentence(hopper, filled, weighed_g)

    async def prove_flow(self, cell: Cell) -> None:
        """Return when the refilled hoppers feed by weight what is set, steadily.

        Hoppers without a load cell have only their feeder's own report. Raises Interlock.
        """
        if not self._unproven:
            return
        steady = [_SteadyFlow(cell, hopper) for hopper in self._unproven]
        try:
            await cell.wait_until(
                lambda: sum(not one.is_steady() for one in steady) == 0, _PATIENCE_S,
                "steadiness",
            )
        except Exception as error:
            names = " and ".join(one.hopper.name for one in steady if not one.steady)
            raise InterlockError(
                "refilled flow", f"hopper {names} does not feed steadily after its refill",
                where=[one.said for one in steady if not one.steady],
                hint="look for bridged or damp powder, and whether the lid is tight; then resume",
            ) from error
        self._unproven.clear()

    @property
    def _asked(self) -> HopperSettings:
        if self.hopper is None:
            raise RuntimeError("no hopper is being refilled")
        return self.hopper


class _SteadyFlow:
    """Whether one hopper has fed as set for long enough. said : by its last reading"""

    def __init__(self, cell: Cell, hopper: HopperSettings) -> None:
        self.hopper = hopper
        self.steady = False
        self.said = "it has not been read"
        self._feeder = _feeder_of(cell, hopper)
        self._since_s: float | None = None
        self._read_s = 0.0

    def is_steady(self) -> bool:
        """By the readings looked at so far. Once steady it stays so."""
        status = self._feeder.status
        reading = None if status is None else status.hoppers.get(self.hopper.name)
        self._feeder.request_hopper_readings()
        if self.steady or reading is None or reading.time_s <= self._read_s:
            return self.steady
        self._read_s = reading.time_s
        flow, wanted = reading.flow_weighed_g_min, reading.setpoint_g_min
        if reading.weight_g is None:
            self.steady = True
            return True
        self.said = f"by weight {'nothing valid' if flow is None else f'{flow:.2f} g/min'}, " \
                    f"{wanted:.2f} g/min is set"
        is_near = flow is not None and HopperStatusBits.LIW_VALID in reading.flags and (
            abs(flow - wanted) <= max(_LEAST_G_MIN, _SHARE * wanted)
        )
        if not is_near:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = reading.time_s
        self.steady = self._since_s is not None and reading.time_s - self._since_s >= _FOR_S
        return self.steady


def _feeder_of(cell: Cell, hopper: HopperSettings) -> FeederDriver:
    return next(feeder for feeder in cell.feeders if feeder.name == hopper.feeder)


def _sentence(hopper: HopperSettings, filled: _Filled, weighed_g: float | None) -> str:
    said = f"hopper {hopper.name} refilled: lot {filled.lot}, {filled.mass_g:g} g by the operator"
    if weighed_g is None:
        return f"{said}; it has no load cell"
    differs = abs(weighed_g - filled.mass_g) > max(_MASS_G, _MASS_SHARE * filled.mass_g)
    return f"{said}, {weighed_g:.0f} g weighed" + ("; the two differ" if differs else "")
