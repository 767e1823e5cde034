"""What may happen to a run in these tests: links cut, hosts killed, controllers restarted."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
from pathlib import Path

from lmctl.config.machine import MachineProfile
from lmctl.errors import LmctlError, UsageError
from lmctl.run.executor import RunExecutor
from lmctl.run.journal.earlier_run import EarlierRun
from lmctl.run.state.transitions import RunState
from simulators.bench import Bench
from simulators.faults.link_tap import LinkTap, drop_chunk


async def run_disturbed(
    bench: Bench, cell: MachineProfile, folder: Path, runs: Path, continues: EarlierRun | None,
    what: str, at_s: float, *, in_motion: bool,
) -> Path:
    """A run to which something happens; returns the folder of runs as that leaves it.

    at_s : when, from the start of the run, or, in_motion, from that of its motion
    """
    executor = RunExecutor(folder / "job.lmj", cell, runs, continues=continues)
    task = asyncio.create_task(executor.run())
    while in_motion and executor.state is not RunState.DEPOSITING and not task.done():  # noqa: ASYNC110
        await asyncio.sleep(0.01)
    await asyncio.wait([task], timeout=at_s)
    if task.done():
        with contextlib.suppress(LmctlError):
            await task
        return runs
    act = what.partition(",")[0]
    if act == "kill":
        runs = _killed(bench, runs)
    elif act == "stop":
        executor.stop()
    elif act == "hold":
        await _hold_and_resume(executor, task)
    else:
        undo = {"cut": _cut, "mute": _mute, "restart": _restart}[act](bench)
        asyncio.get_running_loop().call_later(2.0, undo)
    with contextlib.suppress(LmctlError):
        await task
    await asyncio.sleep(3.0)
    for edge in bench.edges.values():
        edge.set_open(True)
    if what.endswith("restart") and act != "restart":
        bench.motion.lose_power()
    return runs


async def _hold_and_resume(executor: RunExecutor, task: asyncio.Task) -> None:
    """As an operator does it, where the run can be held at all."""
    with contextlib.suppress(UsageError):
        executor.hold()
        await asyncio.wait([task], timeout=20.0)
        executor.resume()


def _killed(bench: Bench, runs: Path) -> Path:
    """Nothing that the host does reaches anything any more, and of its journal there is what the
    operating system has."""
    for edge in bench.edges.values():
        edge.set_open(False)
    kept = runs.with_name(f"{runs.name}-killed")
    shutil.copytree(runs, kept, ignore=shutil.ignore_patterns("*.sock"))
    return kept


def _cut(bench: Bench):
    edge = bench.edges["motion"]
    edge.set_open(False)
    return lambda: edge.set_open(True)


def _mute(bench: Bench):
    """A cable that breaks without an error at either end."""
    edge = bench.edges["motion"]
    return _nothing_passes(edge)


def _restart(bench: Bench):
    banner, edge = bench.motion.lose_power(), bench.edges["motion"]
    undo = _nothing_passes(edge)

    def ready() -> None:
        undo()
        edge.send_to_host(banner)

    return ready


def _nothing_passes(edge: LinkTap):
    def one(data: bytes, deliver) -> None:
        drop_chunk(data, deliver)

    for direction in ("to_device", "to_host"):
        edge.add_filter(direction, one)

    def undo() -> None:
        for direction in ("to_device", "to_host"):
            edge.remove_filter(direction, one)

    return undo
