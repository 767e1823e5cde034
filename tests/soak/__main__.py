"""Random parts and random cells, for as long as one likes: `python -m tests.soak WHAT FIRST COUNT`.

WHAT is `solids`, `meshes` or `clouds` (a part down the whole road) or `cells` (a run with faults).
One line a seed; exits 1 if one falls short. A seed tells the same story every time.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from tests.soak.cells import run_a_cell
from tests.soak.parts import PARTS, random_part_down_the_road


def main(arguments: list[str]) -> int:
    if len(arguments) != 3 or arguments[0] not in (*PARTS, "cells"):
        raise SystemExit(__doc__)
    what, first, count = arguments[0], int(arguments[1]), int(arguments[2])
    wrong = []
    for seed in range(first, first + count):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            outcome = (run_a_cell(seed, folder) if what == "cells"
                       else random_part_down_the_road(what, seed, folder))
        if outcome.shortfalls:
            wrong.append(seed)
        print(seed, outcome, flush=True)
    print(f"{len(wrong)} of {count} fell short")
    for seed in wrong:
        print(f"to repeat: python -m tests.soak {what} {seed} 1")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
