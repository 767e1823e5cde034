"""A log against the simulated cell's own record, after random holds, kills and recoveries.

Fifty of them are tests/benchmarks/disturbances_rows/log.py.
"""

from __future__ import annotations

import pytest

from tests.run.recorded_parts import record_part


@pytest.mark.parametrize("seed", [3, 8, 38])
def test_every_row_of_a_log_agrees_with_what_the_cell_did(seed, tmp_path):
    part = record_part(seed, tmp_path)
    assert part.missing_layers == [], part.happened
    errors = part.errors()
    assert len(errors) >= 2 * 5
    worst = max(errors, key=errors.get)
    assert errors[worst] <= 0.005, (seed, worst, part.happened)
