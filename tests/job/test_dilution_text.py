"""What people read of a job's dilution."""

from __future__ import annotations

import pytest

from lmctl.job.dilution_text import dilution_text

KNOWN = {"share": 0.2, "low": 0.18, "high": 0.22, "compensated_fraction": 1.0,
         "clipped_fraction": 0.0, "clipped_worst": 0.0}


@pytest.mark.parametrize(("totals", "materials", "text"), [
    ({}, 1, ""),
    ({}, 2, "not made up for: not measured or stated, or ignored"),
    ({"dilution": KNOWN}, 2, "20.0% (18.0% to 22.0%) made up for"),
    ({"dilution": KNOWN | {"low": 0.2, "high": 0.2, "compensated_fraction": 0.75}}, 2,
     "20.0% made up for in 75% of the path"),
    ({"dilution": KNOWN | {"clipped_fraction": 0.051, "clipped_worst": 0.0471}}, 2,
     "20.0% (18.0% to 22.0%) made up for; 5.1% of the path cannot, off by up to 0.047"),
    ({"dilution": KNOWN | {"compensated_fraction": 0.0}}, 2, "made up for in no layer"),
])
def test_dilution_in_words(totals, materials, text):
    assert dilution_text(totals, materials) == text
