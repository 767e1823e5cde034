"""What people see of lmctl, and how long they wait for it, as one JSON object.

The row groups are the modules of `faces_rows`; what each measures stands in its docstring. Times
are those of whole programs on the wall clock.

    python tests/benchmarks/faces.py [GROUP ...]
"""

from __future__ import annotations

import argparse
import importlib
import json
import pkgutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(__file__).resolve().parent / "faces_rows"


def main() -> int:
    groups = sorted(module.name for module in pkgutil.iter_modules([str(FOLDER)]))
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("group", nargs="*", help=f"of {', '.join(groups)}")
    chosen = options.parse_args().group or groups
    if unknown := set(chosen) - set(groups):
        options.error(f"there is no row group {', '.join(sorted(unknown))}")
    sys.path.insert(0, str(ROOT))  # row groups use each other and the helpers of tests
    joined: dict[str, float | int] = {}
    for group in chosen:
        measured = importlib.import_module(f"tests.benchmarks.faces_rows.{group}").rows()
        if twice := joined.keys() & measured.keys():
            raise SystemExit(f"{group}: other groups have these keys, too: {', '.join(twice)}")
        joined |= measured
    print(json.dumps(joined, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
