"""`lmctl machine catch-test` and `dilution-test` on a bench whose powder is not the library's."""

from __future__ import annotations

import pytest

from lmctl.calibration import load_calibration

PROCESS = """
[process]
max_power_W = 3000
bead_width_mm = 2.0
power_W = 1500
speed_mm_s = 10
dilution = 0.2
dilution_per_J_mm = 0.001
substrate = "mild steel"
"""


def test_a_coupon_shows_the_hidden_catch(lmctl, bench, tmp_path) -> None:
    file = bench(("catch_efficiency = 0.75", "catch_efficiency = 0.675"))
    outcome = lmctl("machine", "catch-test", "--sim", "--bench", file, "--material", "316L",
                    "--operator", "Ada", "--json")
    assert outcome.code == 0, outcome.talk
    (caught,) = outcome.json["catch"]
    assert caught["efficiency"]["value"] == pytest.approx(0.675, abs=0.004)
    assert caught["efficiency"]["low"] < 0.675 < caught["efficiency"]["high"]
    assert "no feeder test" in outcome.talk
    found = load_calibration(tmp_path / "calibration.json").catch_of("316L")
    assert found is not None
    assert found.deposited_g / found.fed_g == pytest.approx(0.675, abs=0.004)


def test_tracks_show_dilution_against_energy(lmctl, bench, tmp_path) -> None:
    file = bench()
    file.write_text(file.read_text() + PROCESS)
    outcome = lmctl("machine", "dilution-test", "--sim", "--bench", file, "--material", "316L",
                    "--substrate", "mild steel", "--operator", "")
    assert outcome.code == 0, outcome.talk
    by_energy = {one.energy_J_mm: one.dilution.value
                 for one in load_calibration(tmp_path / "calibration.json").dilution}
    assert len(by_energy) == 3
    for energy_J_mm, share in by_energy.items():
        assert share == pytest.approx(0.2 + 0.001 * (energy_J_mm - 150.0), abs=0.005)


def test_what_cannot_be_deposited_or_analysed_is_refused(refused, lmctl) -> None:
    assert "no hopper" in refused("machine", "catch-test", "--sim", "--material", "Cu", code=2)
    assert "no hopper" in refused("machine", "dilution-test", "--sim", "--material", "Cu",
                                  "--substrate", "Fe", code=2)


def test_a_slip_of_the_pen_costs_no_coupon(lmctl, bench, monkeypatch) -> None:
    from simulators.operator import SimulatedOperator

    weighed = SimulatedOperator.weigh_plate
    slips = iter(["412.37", "4.12 kg"])

    async def careless(self, request: str) -> str:
        return next(slips, None) or await weighed(self, request)

    monkeypatch.setattr(SimulatedOperator, "weigh_plate", careless)
    outcome = lmctl("machine", "catch-test", "--sim", "--bench", bench(), "--material", "316L",
                    "--operator", "Ada")
    assert outcome.code == 0, outcome.talk
    assert "no mass with its unit" in outcome.talk
    assert "is stated to 10 g only" in outcome.talk
    assert outcome.talk.count("laying coupon") == 1
