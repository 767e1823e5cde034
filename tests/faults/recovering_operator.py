"""The operator of these tests: recovers runs, looks at the part, and touches off."""

from __future__ import annotations

import asyncio
from pathlib import Path

from lmctl.cli.machine_actions import run_journaled, run_with_motion
from lmctl.cli.recover import prepare
from lmctl.config.machine import MachineProfile
from lmctl.errors import JournalError, MachineError
from lmctl.job.reader import JobReader
from lmctl.machine.manual.controller import open_motion_controller
from lmctl.machine.manual.homing import home_axes, set_work_offset, unlock_controller
from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.motion.identity import is_homing_enabled
from lmctl.run.journal.earlier_run import EarlierRun
from lmctl.run.journal.last_known_position import LastKnownPosition
from lmctl.run.journal.replay import replay_run
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.program.place import PlaceReached
from simulators.bench import Bench
from tests.faults.on_the_part import measured

#: Where program zero lies on a machine with homing, in machine coordinates.
HOMED_ZERO_MM = (-300.0, -300.0, -200.0)



class NothingLeftError(Exception):
    """A run has deposited every bead of its job."""


class RecoveringOperator:
    """Recovers runs, looks at the part when asked, and touches off where a position is lost."""

    def __init__(
        self, bench: Bench, cell: MachineProfile, job: Path, *, has_homing: bool
    ) -> None:
        self._bench = bench
        self._cell = cell
        self._job = job
        self.zero_mm = HOMED_ZERO_MM if has_homing else (0.0, 0.0, 0.0)
        self.times_asked = 0
        self.times_touched_off = 0
        self.needless_touch_offs = 0

    async def home(self, runs: Path) -> None:
        """Before the first run: out of the alarm, homed, and program zero set."""
        async def act(motion: MotionDriver) -> None:
            await unlock_controller(motion)
            await home_axes(motion)
            await set_work_offset(motion, dict(zip("XYZ", self.zero_mm, strict=True)), here=False)

        await run_journaled(self._cell, runs, {"do": "home"},
                            lambda whereabouts: run_with_motion(self._cell, whereabouts, act))
        await asyncio.sleep(1.0)

    async def recover(self, made: RunFolder, runs: Path, *, harmless: bool) -> EarlierRun | None:
        """What `lmctl recover` goes on with; None where nothing of the part has been begun."""
        try:
            after = replay_run(made)
        except JournalError as error:
            if "before it began" in error.what:
                return None
            raise self._left(error) from error
        touched_off = False
        while True:
            try:
                continuation = await prepare(
                    after, self._cell, runs, [], yes=True, restored=False, stated_mm=None,
                    ask=self._look)
                break
            except JournalError as error:
                raise self._left(error) from error
            except MachineError as error:
                if touched_off or "has lost its place" not in error.what:
                    raise
                await self._touch_off(runs, harmless=harmless)
                touched_off = True
        return continuation

    @staticmethod
    def _left(error: JournalError) -> Exception:
        return NothingLeftError() if "nothing is left" in error.what else error

    def _look(self, job: JobReader, reached: PlaceReached, _: float, __: list[str]) -> float:
        self.times_asked += 1
        part = measured(self._bench, self._job, [], self.zero_mm)
        return round(part.deposited_mm(job, reached.place, reached.until), 1)

    async def make_ready(self, runs: Path, *, harmless: bool) -> None:
        """Before a run that begins the part: home or touch off, where the doctor asks for it."""
        await asyncio.sleep(1.0)
        async with open_motion_controller(self._cell) as motion:
            LastKnownPosition(runs, self._cell).judge_position(motion)
            known, homes = motion.position_trusted, is_homing_enabled(motion.settings)
        await asyncio.sleep(1.0)
        if not known and homes:
            await self.home(runs)
        elif not known:
            await self._touch_off(runs, harmless=harmless)

    async def _touch_off(self, runs: Path, *, harmless: bool) -> None:
        """Say where the machine really is: the work offset makes up for the place it has lost."""
        self.times_touched_off += 1
        self.needless_touch_offs += harmless
        await asyncio.sleep(1.0)
        trace = self._bench.motion.trace
        believed, shift = self._bench.motion.position_mm, trace.position_error_mm
        true_mm = {axis: at + by for axis, at, by in zip("XYZ", believed, shift, strict=True)}

        async def act(motion: MotionDriver) -> None:
            await unlock_controller(motion)
            await set_work_offset(motion, true_mm, here=True)

        await run_journaled(self._cell, runs, {"do": "offset", "axes": true_mm, "here": True},
                            lambda whereabouts: run_with_motion(self._cell, whereabouts, act))
