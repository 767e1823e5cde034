"""`python -m simulators bench.toml`: the simulated cell as a process of its own, in real time."""

from __future__ import annotations

import argparse
import asyncio
import json
import signal
import sys
from pathlib import Path

from simulators.bench import Bench, with_motion_on_pty
from simulators.bench_config import BenchConfig, BenchConfigError

CONFIGURATION_WRONG, CANNOT_SERVE = 3, 4


def main(arguments: list[str] | None = None) -> int:
    """Serve until interrupted. One line of JSON on stdout names the endpoints."""
    parser = argparse.ArgumentParser(prog="python -m simulators", description=__doc__)
    parser.add_argument("bench", type=Path, help="the cell, as in lmctl/examples/bench.toml")
    parser.add_argument("--pty", action="store_true", help="put the motion controller on a pty")
    given = parser.parse_args(arguments)
    try:
        config = BenchConfig.load(given.bench)
    except OSError as error:
        return _fail(f"cannot read {given.bench}: {error.strerror}", CONFIGURATION_WRONG)
    except BenchConfigError as error:
        mistakes = "\n  ".join(error.mistakes)
        return _fail(f"{given.bench} does not describe a bench\n  {mistakes}", CONFIGURATION_WRONG)
    try:
        asyncio.run(_serve(with_motion_on_pty(config) if given.pty else config))
    except OSError as error:
        return _fail(str(error), CANNOT_SERVE)
    return 0


async def _serve(config: BenchConfig) -> None:
    loop, stop = asyncio.get_running_loop(), asyncio.Event()
    for interruption in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(interruption, stop.set)
    async with Bench(config) as bench:
        print(json.dumps(bench.endpoints), flush=True)
        await stop.wait()


def _fail(message: str, code: int) -> int:
    print(f"error: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
