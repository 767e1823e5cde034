"""A homed Grbl says nothing of it: what a session leaves behind lets the next one begin."""

from __future__ import annotations

import pytest

from lmctl.errors import MachineError
from lmctl.machine.manual.homing import home_axes, set_work_offset, unlock_controller
from lmctl.machine.motion.driver import MotionDriver
from lmctl.run.executor import run_job
from lmctl.run.journal.last_known_position import LastKnownPosition
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig

CHANGES = (
    ('dialect = "grblhal"', 'dialect = "grbl"'), ("rx_bytes = 1024", "rx_bytes = 128"),
    ("planner_blocks = 100", "planner_blocks = 15"),
    ("10 = 511", "10 = 3\n20 = 1\n22 = 1\n24 = 600\n25 = 6000"),
)


@pytest.fixture
def on_grbl(tmp_path, profile, square_job, bench_text):
    """Runs a story on one Grbl with homing: story(home, run, others), each of them awaitable."""

    def events_of(story):
        text = bench_text
        for old, new in CHANGES:
            assert old in text
            text = text.replace(old, new)
        runs = tmp_path / "runs"

        async def main():
            async with Bench(BenchConfig.parse(text), ephemeral_ports=True) as bench:
                wired = profile.model_copy(update={
                    "motion": profile.motion.model_copy(
                        update={"endpoint": bench.endpoints["motion"]}),
                    "feeder": tuple(
                        feeder.model_copy(update={"endpoint": bench.endpoints[feeder.name]})
                        for feeder in profile.feeder
                    ),
                })

                async def with_motion(act, journaled=True):
                    whereabouts = LastKnownPosition(runs, wired)
                    motion = await MotionDriver.open(
                        wired.motion.endpoint, baud=115_200, status_period_s=0.1)
                    try:
                        await act(motion)
                    finally:
                        if journaled:
                            whereabouts.record_position(motion)
                            whereabouts.journal.append("ended", do="test", **whereabouts.left)
                        await motion.close()

                async def home(motion):
                    await unlock_controller(motion)
                    await home_axes(motion)
                    await set_work_offset(motion, {"X": -300, "Y": -300, "Z": -200}, here=False)

                await story(
                    lambda: with_motion(home), lambda: run_job(square_job, wired, runs),
                    lambda act: with_motion(act, journaled=False),
                )

        virtual_time.run_in_virtual_time(main())

    return events_of


@pytest.fixture
def bench_text():
    from importlib.resources import files

    return (files("lmctl.examples") / "bench.toml").read_text()


def test_after_homing_one_run_follows_another(on_grbl):
    async def story(home, run, others):
        await home()
        for _ in range(2):
            assert (await run()).state == "done"

    on_grbl(story)


def test_what_another_hand_has_moved_or_only_unlocked_is_not_known(on_grbl):
    async def story(home, run, others):
        async def nudge(motion):
            await motion.send_command("G91")
            await motion.send_command("G0 X-0.1")
            await motion.send_command("G90")

        await others(unlock_controller)
        with pytest.raises(MachineError, match="not been homed"):
            await run()
        await home()
        await others(nudge)
        with pytest.raises(MachineError, match="not been homed"):
            await run()
        await home()
        assert (await run()).state == "done"

    on_grbl(story)
