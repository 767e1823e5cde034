"""A controller without homing that has lost its place is not believed by the next command."""

from __future__ import annotations

from importlib.resources import files

import pytest

from lmctl.cli.bench import replace_endpoints
from lmctl.cli.machine_actions import run_journaled, run_with_motion
from lmctl.errors import MachineError
from lmctl.machine.manual.homing import set_work_offset
from lmctl.run.cell.doctor import check_inspection, inspect_cell
from lmctl.run.executor import RunExecutor
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from tests.faults.disturbances import run_disturbed
from tests.faults.moments import GRBL
from tests.faults.on_the_part import measured

BENCH = (files("lmctl.examples") / "bench.toml").read_text()

#: From the start of a run until it stands at the purge position, and its powder is not yet stable.
AT_PURGE_S = 6.0


class CellWithoutHoming:
    """One simulated cell, what its operator does, and what is on the part."""

    def __init__(self, bench, profile, job, runs):
        self.bench, self.profile, self.job, self.runs = bench, profile, job, runs

    async def run(self):
        await RunExecutor(self.job, self.profile, self.runs).run()

    async def disturbed(self, what):
        """A run to which that happens at the purge position."""
        self.runs = await run_disturbed(self.bench, self.profile, self.job.parent, self.runs, None,
                                        what, AT_PURGE_S, in_motion=False)

    async def found_by_doctor(self):
        """What is wrong with the motion controller."""
        look = await inspect_cell(self.profile, self.runs)
        return [one.text for one in check_inspection(look, self.profile)["motion"]
                if one.refuses_run and not one.is_met]

    async def refused(self):
        """Why a run is refused: doctor has said the same."""
        found = await self.found_by_doctor()
        with pytest.raises(MachineError) as refused:
            await self.run()
        assert found == [refused.value.what]
        return refused.value.render()

    async def touch_off(self):
        """State where the nozzle really is."""
        trace = self.bench.motion.trace
        true_mm = {axis: at + by for axis, at, by in zip(
            "XYZ", self.bench.motion.position_mm, trace.position_error_mm, strict=True)}
        await run_journaled(
            self.profile, self.runs, {"do": "offset", "axes": true_mm, "here": True},
            lambda whereabouts: run_with_motion(
                self.profile, whereabouts,
                lambda motion: set_work_offset(motion, true_mm, here=True)))

    def off_path_mm(self):
        return measured(self.bench, self.job, [], (0.0, 0.0, 0.0)).off_path_mm


@pytest.fixture(params=["grblhal", "grbl"])
def in_cell(request, tmp_path, profile, square_job):
    """Tells a story of one cell of each firmware."""
    text = BENCH
    for old, new in GRBL.items() if request.param == "grbl" else ():
        text = text.replace(old, new)

    def tell(story):
        async def main():
            async with Bench(BenchConfig.parse(text), ephemeral_ports=True) as bench:
                await story(CellWithoutHoming(
                    bench, replace_endpoints(profile, bench.endpoints), square_job,
                    tmp_path / "runs"))

        virtual_time.run_in_virtual_time(main())

    return tell


def test_a_restart_before_the_first_bead_is_known_to_the_next_run(in_cell):
    """Its zero is now the purge position, 24.5 mm from where it was. Nothing of the part has been
    begun, so nothing is recovered: the job is run again."""

    async def story(cell):
        await cell.disturbed("restart")
        assert cell.bench.motion.trace.position_error_mm == pytest.approx((10.0, 10.0, 20.0))
        why = await cell.refused()
        assert "has lost its place" in why
        assert "run-0001" in why
        assert "offset --here" in why
        await cell.touch_off()
        await cell.run()
        assert cell.off_path_mm() < 0.1

    in_cell(story)


def test_a_controller_switched_off_between_two_runs_is_not_believed(in_cell):
    async def story(cell):
        await cell.run()
        cell.bench.motion.lose_power()
        assert "switched off and on" in await cell.refused()

    in_cell(story)


def test_a_host_killed_at_the_purge_position_has_lost_nothing(in_cell):
    async def story(cell):
        await cell.disturbed("kill")
        assert await cell.found_by_doctor() == []
        assert cell.bench.motion.trace.position_error_mm == (0.0, 0.0, 0.0)

    in_cell(story)
