"""Names of a field's arrays: each material is found again, whatever it is called."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lmctl.report.part_export import array_names


@pytest.mark.parametrize(("materials", "names"), [
    (["316L", "WC-12Co"], ["distance", "316L", "WC-12Co"]),
    (["distance"], ["distance", "distance 2"]),
    (["Stahl ä", "Stahl ö", "Stahl _ 2"], ["distance", "Stahl _", "Stahl _ 2", "Stahl _ 2 2"]),
])
def test_names_stay_apart(materials, names):
    assert array_names(materials) == names


@given(st.lists(st.text(min_size=1, max_size=8), max_size=8))
def test_any_names_are_plain_and_different(materials):
    names = array_names(materials)
    assert len(set(names)) == len(names) == len(materials) + 1
    assert all(re.fullmatch(r"[A-Za-z0-9 .+/_-]+", name) for name in names)
