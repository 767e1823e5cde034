"""`python -m simulators bench.toml`: the simulated cell as a process of its own, in real time."""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import sys
from dataclasses import dataclass
from pathlib import Path

from simulators.bench import Bench, with_motion_on_pty
from simulators.bench_config import BenchConfig, BenchConfigError
from simulators.fault_outcome import record_as_json
from simulators.faults.fault_injector import FaultInjector, InjectedFault
from simulators.faults.plan import FaultPlan, FaultPlanError

CONFIGURATION_WRONG, CANNOT_SERVE = 3, 4


def main(arguments: list[str] | None = None) -> int:
    """Serve until interrupted. The first line of JSON on stdout names the endpoints.

    Each fault of a plan adds one line of JSON when it happens. The record is written at the end and
    on SIGUSR1.
    """
    parser = argparse.ArgumentParser(prog="python -m simulators", description=__doc__)
    parser.add_argument("bench", type=Path, help="the cell, as in lmctl/examples/bench.toml")
    parser.add_argument("--pty", action="store_true", help="put the motion controller on a pty")
    parser.add_argument("--faults", type=Path, metavar="FILE",
                        help="what goes wrong, and when; times count from the host's coming")
    parser.add_argument("--record", type=Path, metavar="FILE",
                        help="write what the cell did there, as JSON")
    given = parser.parse_args(arguments)
    try:
        config = BenchConfig.load(given.bench)
        faults = FaultPlan.load(given.faults, config) if given.faults else FaultPlan()
    except OSError as error:
        return _fail(f"cannot read {error.filename}: {error.strerror}", CONFIGURATION_WRONG)
    except BenchConfigError as error:
        return _mistaken(f"{given.bench} does not describe a bench", error.mistakes)
    except FaultPlanError as error:
        return _mistaken(f"{given.faults} does not say what goes wrong", error.mistakes)
    served = with_motion_on_pty(config) if given.pty else config
    try:
        asyncio.run(_serve(_Order(served, faults, given.record)))
    except OSError as error:
        return _fail(str(error), CANNOT_SERVE)
    return 0


@dataclass(frozen=True)
class _Order:
    config: BenchConfig
    faults: FaultPlan
    record: Path | None


async def _serve(order: _Order) -> None:
    loop, stop = asyncio.get_running_loop(), asyncio.Event()
    for interruption in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(interruption, stop.set)
    async with Bench(order.config) as bench:
        board = FaultInjector(bench, on_happened=_tell)

        def write() -> None:
            if order.record is not None:
                _write(order.record, json.dumps(record_as_json(bench, board.injected)))

        loop.add_signal_handler(signal.SIGUSR1, write)
        print(json.dumps(bench.endpoints), flush=True)
        arming = asyncio.create_task(_arm(board, bench, order.faults))
        await stop.wait()
        arming.cancel()
        board.close()
        write()


async def _arm(board: FaultInjector, bench: Bench, faults: FaultPlan) -> None:
    await bench.edges["motion"].host_came.wait()
    board.schedule(faults)


def _tell(happened: InjectedFault) -> None:
    print(json.dumps({"fault": happened.fault.kind.name, "device": happened.fault.device,
                      "channel": happened.fault.channel, "at_s": happened.at_s}), flush=True)


def _write(path: Path, text: str) -> None:
    """Write the file completely or not at all."""
    unfinished = path.with_name(path.name + ".part")
    unfinished.write_text(text, encoding="utf-8")
    os.replace(unfinished, path)


def _mistaken(message: str, mistakes: tuple[str, ...]) -> int:
    return _fail("\n  ".join([message, *mistakes]), CONFIGURATION_WRONG)


def _fail(message: str, code: int) -> int:
    print(f"error: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
