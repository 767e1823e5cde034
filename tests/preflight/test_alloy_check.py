"""Rules that cannot be kept are refused before any geometry, all at once, with their reasons."""

from pathlib import Path

import pytest

import lmctl.examples
from lmctl.config.dilution import DilutionSettings
from lmctl.config.machine import load_profile
from lmctl.errors import PlanError
from lmctl.part.load import part_from_text
from lmctl.preflight.part_check import check_part

HEAD = """
name = "part"
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [20, 10, 2]
[composition]
feature = { kind = "coordinate", along = "x" }
profile = { kind = "linear", near = { "316L" = 1.0 }, far = { "WC-12Co" = 1.0 }, over_mm = [0, 20] }
"""


@pytest.fixture
def check(tmp_path):
    profile = load_profile(Path(lmctl.examples.__file__).parent / "cell.toml")

    def checked(rule, head=HEAD, dilution=None):
        text = f"""{head}
[[alloy_rule]]
name = "eta phase"
powders = ["316L", "WC-12Co"]
reason = "brittle"
{rule}"""
        stated = () if dilution is None else (DilutionSettings(share=dilution),)
        return check_part(part_from_text(text, tmp_path, "part"),
                          profile.model_copy(update={"dilution": stated}))
    return checked


def text_of(caught):
    return caught.value.render()


def test_a_rule_that_can_be_kept_is_no_problem(check):
    assert check('forbidden = [{ "316L" = [0.3, 0.6] }]').n_layers > 0


def test_a_mixture_that_the_part_names_and_a_rule_forbids(check):
    with pytest.raises(PlanError) as caught:
        check('forbidden = [{ "316L" = [0.3, 1.0] }]')
    assert "the part wants 100 % 316L, which an alloy rule forbids" in text_of(caught)
    assert "eta phase: brittle" in text_of(caught)
    assert "28 % 316L + 72 % WC-12Co" in text_of(caught)  # 0.3 less the margin


def test_rules_that_leave_no_mixture(check):
    with pytest.raises(PlanError, match="forbid every mixture"):
        check('forbidden = [{ "316L" = [0, 0.6] }, { "316L" = [0.5, 1] }]')


def test_a_jump_is_an_impossible_pair_where_its_first_bead_is_diluted_into_the_region(check):
    rule = 'forbidden = [{ "316L" = [0.1, 0.9], "WC-12Co" = [0.1, 0.9] }]'
    assert check(rule).n_layers > 0
    assert check(rule, dilution=0.02).n_layers > 0
    with pytest.raises(PlanError) as caught:
        check(rule, dilution=0.2)
    assert "impossible pair" in text_of(caught)
    assert "brittle" in text_of(caught)
    ignored = HEAD + '[process]\ndilution = "ignore"\n'
    assert check(rule, ignored, dilution=0.2).n_layers > 0


def test_no_way_round(check):
    three = HEAD.replace('[[body]]', '[[material]]\nname = "Ni"\n[[body]]')
    with pytest.raises(PlanError) as caught:
        check('forbidden = [{ "316L" = [0.3, 0.6] }]\nway = "around"', three)
    assert "no way leads round" in text_of(caught)
    assert "eta phase: brittle" in text_of(caught)


def test_all_that_is_in_the_way_is_reported_at_once(check):
    three = HEAD.replace('[[body]]', '[[material]]\nname = "Ni"\n[[body]]')
    with pytest.raises(PlanError) as caught:
        check('forbidden = [{ "316L" = [0.3, 1.0] }]', three.replace("20, 10", "2000, 10"))
    for wanted in ("holds Ni", "100 % 316L", "x: needs"):
        assert wanted in text_of(caught)
