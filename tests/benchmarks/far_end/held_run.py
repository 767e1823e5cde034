"""A run that is held and resumed again and again, with its bench: a process of its own.

    python tests/benchmarks/far_end/held_run.py RUNS_DIR SPEED

Runs a long job at SPEED times real time, on a cell whose hoses are short and whose purge position
is near, so that resuming takes half a second. Prints, for each feed hold, when its byte was given
to the wire (seconds of the monotonic clock): the controller behind it is a computer of its own in
truth, and here a part of this process. A stop on its control socket ends it.
"""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from importlib.resources import files
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))  # also without being installed

from lmctl.cli.bench import load_bench, replace_endpoints
from lmctl.config.machine import load_profile
from lmctl.errors import LmctlError
from lmctl.machine.motion.links import ByteLink
from lmctl.run.executor import RunExecutor
from lmctl.run.real_time_priority import real_time_priority
from simulators import virtual_time
from simulators.bench import Bench
from tests.run.conftest import squares, write_job

#: Feed holds nearer to each other than this are one [s].
ONE_HOLD_S = 0.1

#: Purge position: beside the first square, above the last layer.
NEAR_MM = (26.0, 30.0, 16.0)


async def run_until_stopped(runs_dir: Path) -> None:
    profile = load_profile(Path(str(files("lmctl.examples") / "cell.toml")))
    profile = profile.model_copy(update={
        "hopper": tuple(one.model_copy(update={"dead_time_s": 0.1, "lag_s": 0.02})
                        for one in profile.hopper),
        "feeder": tuple(one.model_copy(update={"gas_preflow_s": 0.1, "stabilise_s": 0.1})
                        for one in profile.feeder),
        "motion": profile.motion.model_copy(update={"purge_mm": NEAR_MM}),
    })
    job = runs_dir.parent / "job.lmj"
    write_job(job, profile, squares(20, 12, 60.0, start_mm=NEAR_MM))

    to_wire, told = ByteLink.write_realtime, [0.0]

    def timed(link, data):
        to_wire(link, data)
        now_s = time.monotonic()
        if b"!" in data and now_s - told[0] > ONE_HOLD_S:  # a hold repeats it
            print(now_s, flush=True)
        told[0] = now_s if b"!" in data else told[0]

    ByteLink.write_realtime = timed
    async with Bench(load_bench(None), ephemeral_ports=True) as cell:
        wired = replace_endpoints(profile, cell.endpoints)
        with suppress(LmctlError), real_time_priority():  # it is stopped
            await RunExecutor(job, wired, runs_dir, operator="bench").run()


if __name__ == "__main__":
    virtual_time.run_in_virtual_time(run_until_stopped(Path(sys.argv[1])),
                                     speed=float(sys.argv[2]))
