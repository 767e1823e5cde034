"""How true a build is to its design on cells that hide what they are, as one JSON object.

The row groups are the modules of `fidelity_rows`; what each measures stands in its docstring. Runs
are in virtual time; only the speed of the process is timed on the wall clock.

Each group runs in a process of its own, for `--limit` seconds at most. One that fails or takes
longer costs its own rows only: it is named on stderr, and the exit code is 1. seconds_GROUP is what
a group took of the wall clock, cpu_seconds_GROUP of the processor.

    python tests/benchmarks/fidelity.py [--limit S] [GROUP ...]
"""

from __future__ import annotations

import argparse
import json
import pkgutil
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(__file__).resolve().parent / "fidelity_rows"
#: Modules that hold no rows.
NO_ROWS = {"hidden_cell"}
LIMIT_S = 1800.0


def main() -> int:
    groups = sorted({module.name for module in pkgutil.iter_modules([str(FOLDER)])} - NO_ROWS)
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("group", nargs="*", help=f"of {', '.join(groups)}")
    options.add_argument("--limit", type=float, default=LIMIT_S, metavar="S",
                         help="longest time of a group [s] [%(default)s]")
    given = options.parse_args()
    chosen = given.group or groups
    if unknown := set(chosen) - set(groups):
        options.error(f"there is no row group {', '.join(sorted(unknown))}")
    joined: dict[str, float | int] = {}
    failed = 0
    for group in chosen:
        began_s, began_cpu_s = time.perf_counter(), _children_cpu_s()
        try:
            measured = rows_of_group(group, given.limit)
        except GroupError as error:
            failed += 1
            measured = {}
            print(f"{group}: {error}", file=sys.stderr)
        if twice := joined.keys() & measured.keys():
            raise SystemExit(f"{group}: other groups have these keys, too: {', '.join(twice)}")
        joined |= measured
        joined[f"seconds_{group}"] = round(time.perf_counter() - began_s, 1)
        joined[f"cpu_seconds_{group}"] = round(_children_cpu_s() - began_cpu_s, 1)
        print(f"{group}: {joined[f'seconds_{group}']} s", file=sys.stderr)
    print(json.dumps(joined, indent=1))
    return 1 if failed else 0


class GroupError(Exception):
    """A group of rows gave none; says why."""


def rows_of_group(group: str, limit_s: float) -> dict[str, Any]:
    """The rows of a group, measured in a process of its own. Raises GroupError."""
    try:
        done = subprocess.run(
            [sys.executable, "-m", f"tests.benchmarks.fidelity_rows.{group}"], cwd=ROOT,
            capture_output=True, text=True, timeout=limit_s)
    except subprocess.TimeoutExpired:
        raise GroupError(f"it took longer than {limit_s:g} s") from None
    if done.returncode:
        raise GroupError("\n".join(done.stderr.splitlines()[-5:]))
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def _children_cpu_s() -> float:
    """Processor time of all processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    sys.exit(main())
