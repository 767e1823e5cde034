"""How true a build is to its design on cells that hide what they are, as one JSON object.

The row groups are the modules of `fidelity_rows`; what each measures stands in its docstring. Runs
are in virtual time; only the speed of the process is timed on the wall clock. All groups together
take more than an hour.

    python tests/benchmarks/fidelity.py [GROUP ...]
"""

from __future__ import annotations

import argparse
import importlib
import json
import pkgutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(__file__).resolve().parent / "fidelity_rows"
#: Modules that hold no rows.
NO_ROWS = {"hidden_cell"}


def main() -> int:
    groups = sorted({module.name for module in pkgutil.iter_modules([str(FOLDER)])} - NO_ROWS)
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("group", nargs="*", help=f"of {', '.join(groups)}")
    chosen = options.parse_args().group or groups
    if unknown := set(chosen) - set(groups):
        options.error(f"there is no row group {', '.join(sorted(unknown))}")
    sys.path.insert(0, str(ROOT))  # groups import each other as tests.benchmarks.fidelity_rows
    joined: dict[str, float | int] = {}
    for group in chosen:
        measured = importlib.import_module(f"tests.benchmarks.fidelity_rows.{group}").rows()
        if twice := joined.keys() & measured.keys():
            raise SystemExit(f"{group}: other groups have these keys, too: {', '.join(twice)}")
        joined |= measured
    print(json.dumps(joined, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
