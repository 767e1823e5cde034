"""`lmctl optimise` as a user meets it: a better part file, a report, searches that go on."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lmctl.design import optimiser
from lmctl.design.optimiser import read_state
from lmctl.errors import InputError

RING = """# a ring under pressure
name = "ring"
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
[[body]]
name = "outer"
kind = "cylinder"
base_mm = [0, 0, 0]
top_mm = [0, 0, 4]
radius_mm = 40
[[body]]
name = "bore"
kind = "cylinder"
base_mm = [0, 0, -1]
top_mm = [0, 0, 5]
radius_mm = 20
[[body]]
kind = "difference"
of = ["outer", "bore"]
[composition]
feature = { kind = "axis", point_mm = [0, 0, 0], direction = [0, 0, 1] }
[composition.profile]
kind = "power"
k = { free = [0.3, 3], start = 2.5, name = "k" }   # exponent
near = { "316L" = 1 }
far = { "WC-12Co" = 1 }
over_mm = [20, 41]
[[load]]
on = "bore"
pressure_MPa = 100
[[support]]
rigid_motion = true
[simulation]
model = "plane-stress"
mesh_mm = 8
[optimise]
minimise = "largest-principal"
starts = 1
depositable = false
"""


def test_the_part_file_that_is_written_performs_as_reported(lmctl: Callable[..., Any]) -> None:
    Path("ring.toml").write_text(RING)
    outcome = lmctl("optimise", "ring.toml", "--json")
    assert outcome.code == 0, outcome.talk
    data = json.loads(outcome.data)
    assert data["objective_after"] < 0.97 * data["objective_before"]
    folder = Path("ring-optimised")
    assert {p.name for p in folder.iterdir()} == {
        "ring.toml", "report.html", "before.png", "after.png", "search.png", "search.json"}
    text = (folder / "ring.toml").read_text()
    assert text.startswith("# a ring under pressure")
    assert "   # exponent" in text
    again = json.loads(lmctl("simulate", str(folder / "ring.toml"), "--json").data)
    most = again["extremes"]["largest-principal"]["largest"]["value"]
    assert most == pytest.approx(data["after"]["extremes"]["largest-principal"]["largest"]["value"])


def test_an_interrupted_search_goes_on(
    lmctl: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("ring.toml").write_text(RING)
    kept = optimiser.SearchState.write

    def interrupted(state: optimiser.SearchState, path: Path) -> None:
        kept(state, path)
        if state.step == 3:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(optimiser.SearchState, "write", interrupted)
        assert lmctl("optimise", "ring.toml").code == 130
    before = json.loads(Path("ring-optimised/search.json").read_text())
    assert len(before["history"]) == 3
    outcome = lmctl("optimise", "ring.toml", "--json")
    assert outcome.code == 0
    assert "going on after step 3" in outcome.talk
    history = json.loads(Path("ring-optimised/search.json").read_text())["history"]
    assert history[:3] == before["history"]
    assert history[3][1] == pytest.approx(before["history"][2][1])  # from where it was


def test_a_gradient_limit_that_binds_is_kept_everywhere(lmctl: Callable[..., Any]) -> None:
    """At 0.3/τ a fraction may change by about 0.033 a millimetre from track to track."""
    slow = RING.replace("depositable = false", "rate_per_s = 0.3").replace(
        'k = { free = [0.3, 3], start = 2.5, name = "k" }   # exponent\n',
        "k = 1\na = { free = [0.1, 1], start = 0.9 }\n")
    Path("ring.toml").write_text(slow)
    outcome = lmctl("optimise", "ring.toml", "--json")
    assert outcome.code == 0, outcome.talk
    laying = json.loads(outcome.data)["laying"]
    assert laying["over_gradient"] == 0
    assert 0.9 < max(laying["largest_across"], laying["largest_along"]) <= 1.0


@pytest.mark.parametrize(("changes", "code", "told"), [
    ([('{ free = [0.3, 3], start = 2.5, name = "k" }', "1")], 3, "nothing is free"),
    ([("[optimise]\n", "[process]\n"), ('minimise = "largest-principal"\nstarts = 1\n'
      "depositable = false\n", "")], 3, "has no table [optimise]"),
    ([('minimise = "largest-principal"', 'minimise = "cost"')], 3, "material[2].price_per_kg"),
    ([("depositable = false", 'depositable = false\nlimit = [{ quantity = "mass", at_most = 1 }]')],
     1, "mass at most 1: beyond by"),
])
def test_what_cannot_be_optimised_is_said(
    refused: Callable[..., str], changes: list[tuple[str, str]], code: int, told: str
) -> None:
    text = RING
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    Path("ring.toml").write_text(text)
    assert told in refused("optimise", "ring.toml", code=code)


def test_a_state_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "state.json").write_text('{"colour": 3}')
    with pytest.raises(InputError, match="is no state of a search") as refused:
        read_state(tmp_path / "state.json", RING)
    assert "remove it to begin anew" in refused.value.hint


def test_a_dry_run_says_what_it_will_take(lmctl: Callable[..., Any]) -> None:
    Path("ring.toml").write_text(RING)
    outcome = lmctl("optimise", "ring.toml", "--dry")
    assert "1 free numbers, at most 60 steps" in outcome.data
