"""What is documented of the files' keys.

keys : of part, profile, bench, fault and map files
keys_documented : the share of them whose row says what the key means, made from the models as they
    are now and not from what ships
key_help_s : wall clock of `lmctl help part.process.overlap`, the whole process, median of seven
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time

from lmctl.reference.key_row import KIND_OF_TABLE
from tests.house.reference import all_rows


def rows() -> dict[str, float | int]:
    keys = [row for row in all_rows() if row.type != KIND_OF_TABLE]
    return {"keys": len(keys),
            "keys_documented": sum(bool(row.text) for row in keys) / len(keys),
            "key_help_s": round(statistics.median(_help_s() for _ in range(7)), 3)}


def _help_s() -> float:
    begun_s = time.perf_counter()
    subprocess.run([sys.executable, "-m", "lmctl.cli", "help", "part.process.overlap"], check=True,
                   stdout=subprocess.DEVNULL)
    return time.perf_counter() - begun_s
