"""What accompanies a part on paper: in the part file, and stated on the command line."""

from __future__ import annotations

import pytest

from lmctl.config.part_rules import parse_part_file
from lmctl.config.traveller import TravellerSettings, with_stated_values
from lmctl.errors import ConfigError, UsageError

PART = (
    'name = "p"\n[[material]]\nname = "316L"\n'
    '[[body]]\nkind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [1, 2, 3]\n'
)
MATERIALS = ("316L", "Ni 99.5")


def test_a_part_file_states_it() -> None:
    part = parse_part_file(
        PART + '[traveller]\nserial = "17"\n[traveller.powder."316L"]\nlot = "A4711"\n'
        "reuse_count = 2\n", name="part.toml")
    assert part.traveller.serial == "17"
    assert part.traveller.powder["316L"].reuse_count == 2
    assert part.traveller.drawing is None


def test_every_mistake_in_it_is_named_at_once() -> None:
    with pytest.raises(ConfigError) as caught:
        parse_part_file(
            PART + '[traveller]\nserail = "17"\nnozzle = 4\n[traveller.powder.316l]\nlot = "A"\n',
            name="part.toml")
    found = {one.path: one.reason for one in caught.value.findings}
    assert set(found) == {"traveller.serail", "traveller.nozzle", "traveller.powder.316l"}
    assert "did you mean '316L'" in found["traveller.powder.316l"]


def test_what_is_stated_later_replaces_what_was_stated_before() -> None:
    stated = TravellerSettings(serial="1", nozzle="N3")
    found = with_stated_values(
        stated, ["serial=2", "serial = 3", "powder.Ni 99.5.lot=L=7", "powder.316L.reuse_count=4"],
        MATERIALS)
    assert (found.serial, found.nozzle) == ("3", "N3")
    assert found.powder["Ni 99.5"].lot == "L=7"
    assert found.powder["316L"].reuse_count == 4
    assert stated.serial == "1"


def test_all_mistakes_of_set_are_reported_together() -> None:
    with pytest.raises(UsageError) as caught:
        with_stated_values(
            TravellerSettings(), ["serial", "sreial=1", "powder.316L.reuse_count=twice", "=4",
                                  "powder.Ti64.lot=1", "powder=1"], MATERIALS)
    where = "\n".join(caught.value.where)
    assert len(caught.value.where) == 6
    assert "did you mean 'serial'" in where
    assert "'twice' cannot be its value" in where
    assert "powder.316L.lot" in caught.value.hint
