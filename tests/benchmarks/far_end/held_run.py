"""A run that is held and resumed again and again, with its bench: a process of its own.

    python tests/benchmarks/far_end/held_run.py RUNS_DIR SPEED

Runs a long job at SPEED times real time, on a cell whose hoses are short so that resuming takes a
second. Prints, for each feed hold, when its byte reached the controller (seconds of the monotonic
clock). A stop on its control socket ends it.
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
from lmctl.run.executor import RunExecutor
from simulators import virtual_time
from simulators.bench import Bench
from tests.run.conftest import squares, write_job


async def run_until_stopped(runs_dir: Path) -> None:
    profile = load_profile(Path(str(files("lmctl.examples") / "cell.toml")))
    profile = profile.model_copy(update={
        "hopper": tuple(one.model_copy(update={"dead_time_s": 0.2, "lag_s": 0.05})
                        for one in profile.hopper),
        "feeder": tuple(one.model_copy(update={"gas_preflow_s": 0.2, "stabilise_s": 0.2})
                        for one in profile.feeder),
    })
    job = runs_dir.parent / "job.lmj"
    write_job(job, profile, squares(20, 12, 60.0))

    def timed(data, pass_on):
        if b"!" in data:
            print(time.monotonic(), flush=True)
        pass_on(data)

    async with Bench(load_bench(None), ephemeral_ports=True) as cell:
        cell.edges["motion"].add_filter("to_device", timed)
        wired = replace_endpoints(profile, cell.endpoints)
        with suppress(LmctlError):  # it is stopped
            await RunExecutor(job, wired, runs_dir, operator="bench").run()


if __name__ == "__main__":
    virtual_time.run_in_virtual_time(run_until_stopped(Path(sys.argv[1])),
                                     speed=float(sys.argv[2]))
