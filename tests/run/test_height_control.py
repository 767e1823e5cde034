"""The law of height checks: against a part that grows at a rate of its own."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from lmctl.errors import UsageError
from lmctl.run.powder.height_control import HeightControl

LAYER_MM = 0.8


class Journal:
    def __init__(self):
        self.records = []

    def record_height(self, **fields):
        self.records.append({"kind": "height", **fields})


def control(every=5, layers=50, journal=None, tolerance_mm=0.0):
    manifest = SimpleNamespace(
        totals={"height_check_every": every, "height_tolerance_mm": tolerance_mm},
        layers=[SimpleNamespace(z_mm=3.0 + LAYER_MM * n, first_line=100 * n)
                for n in range(layers)])
    return HeightControl.of_job(manifest, journal or Journal())


def grow(heights, growth, layers=50):
    """Deposit layers of a part that grows by `growth` of what is planned, with its checks."""
    height_mm, checks, layer = 0.0, [], 0
    while layer < layers:
        boundary = heights.next_boundary(layer)
        until = layers if boundary is None else boundary.layers
        height_mm += (until - layer) * LAYER_MM * growth * heights.volume_factor
        layer = until
        if boundary is not None:
            heights.on_boundary(boundary)
            heights.enter(height_mm)
        checks.append((layer, height_mm))
    return checks


def test_a_job_that_asks_for_none_has_none():
    manifest = SimpleNamespace(totals={}, layers=[SimpleNamespace(z_mm=1.0, first_line=0)])
    assert HeightControl.of_job(manifest, Journal()) is None


def test_a_run_is_held_after_so_many_layers_and_not_after_the_last():
    heights = control(every=4, layers=12)
    found = [heights.next_boundary(layer) for layer in range(12)]
    assert [None if b is None else (b.layers, b.line) for b in found] == (
        [(4, 400)] * 4 + [(8, 800)] * 4 + [None] * 4)


@pytest.mark.parametrize("growth", [0.94, 0.97, 1.04])
def test_the_next_check_finds_the_planned_height(growth):
    """The deficit of the first five layers is made up for in the next five, and none is left."""
    checks = grow(control(), growth)
    assert checks[0][1] == pytest.approx(5 * LAYER_MM * growth)
    for layers, height_mm in checks[2:]:
        assert height_mm == pytest.approx(layers * LAYER_MM, rel=1e-6)


@pytest.mark.parametrize(("growth", "height_mm", "factor"), [
    (0.977, 0.977 * 40.0, 1.0),           # within: the planned volume stays
    (0.94, 39.0, 0.975 / 0.94),           # brought back to the edge, and kept there
    (1.04, 41.0, 1.025 / 1.04),
])
def test_the_planned_volume_is_fed_where_the_height_is_within_its_tolerance(
    growth, height_mm, factor
):
    """A tolerance of 1 mm is 2.5 % of the whole height, and a share of what is planned before."""
    heights = control(tolerance_mm=1.0)
    checks = grow(heights, growth)
    assert checks[-1][1] == pytest.approx(height_mm, abs=1e-6)
    assert heights.volume_factor == pytest.approx(factor, abs=1e-6)
    for layers, at_mm in checks[2:]:
        assert abs(at_mm / (layers * LAYER_MM) - 1.0) <= 0.025 + 1e-9


def test_a_tolerance_in_mm_holds_where_it_is_less_than_the_share():
    checks = grow(control(tolerance_mm=0.2), 0.95)
    for layers, at_mm in checks[3:]:
        assert at_mm == pytest.approx(layers * LAYER_MM - 0.2, abs=1e-6)


def test_powder_is_changed_by_a_tenth_at_most_and_that_is_said():
    journal = Journal()
    heights = control(journal=journal)
    checks = grow(heights, 0.85)
    assert {record["volume_factor"] for record in journal.records} == {1.1}
    assert all(record["at_limit"] for record in journal.records)
    assert checks[-1][1] == pytest.approx(LAYER_MM * 0.85 * (5 + 45 * 1.1))
    heights.on_boundary(control().next_boundary(0))
    assert "would be needed" in heights.enter(3.4)


def test_a_height_in_another_unit_or_out_of_turn_is_refused():
    heights = control()
    with pytest.raises(UsageError, match="no height is asked for"):
        heights.enter(4.0)
    heights.on_boundary(heights.next_boundary(0))
    for wrong_mm in (0.4, 40.0):
        with pytest.raises(UsageError, match="not to be believed"):
            heights.enter(wrong_mm)
    assert heights.awaited == 5
    assert "planned: 4.00 mm" in heights.request_text()


def test_a_check_that_is_skipped_changes_nothing():
    journal = Journal()
    heights = control(journal=journal)
    heights.on_boundary(heights.next_boundary(0))
    heights.enter(None)
    assert (heights.volume_factor, heights.awaited) == (1.0, None)
    assert journal.records[0]["source"] == "not measured"


def test_a_run_that_goes_on_with_a_part_takes_over_its_last_check():
    first, second = Journal(), Journal()
    heights = control(journal=first)
    for layer, height_mm in ((0, 3.8), (5, None)):
        heights.on_boundary(heights.next_boundary(layer))
        heights.enter(height_mm)
    again = control(journal=second)
    again.go_on_from([{"kind": "header"}, *first.records])
    assert again.volume_factor == pytest.approx(heights.volume_factor, abs=1e-4)
    assert second.records[0]["source"] == "earlier run"
    third = control()
    third.go_on_from(second.records)
    assert third.volume_factor == again.volume_factor


def test_copies_deposited_one_after_the_other_are_checked_each_by_itself():
    """Three parts of six layers: after 4, 8 and 16 layers one is under way, after 12 none is."""
    z_mm = [3.0 + LAYER_MM * n for n in range(6)] * 3
    manifest = SimpleNamespace(
        totals={"height_check_every": 4},
        layers=[SimpleNamespace(z_mm=z, first_line=100 * n) for n, z in enumerate(z_mm)])
    heights = HeightControl.of_job(manifest, Journal())
    boundaries = [heights.next_boundary(layer) for layer in (0, 4, 8, 16)]
    assert [b and b.layers for b in boundaries] == [4, 8, 16, None]
    assert [heights.planned_mm(layers) for layers in (0, 4, 6, 8, 16)] == pytest.approx(
        [0.0, 3.2, 4.8, 1.6, 3.2])
    growth = 0.98
    heights.on_boundary(boundaries[0])
    heights.enter(3.2 * growth)
    assert heights.volume_factor == pytest.approx((4.8 - 3.2 * growth) / (1.6 * growth))
    factor = heights.volume_factor
    heights.on_boundary(boundaries[1])
    heights.enter(1.6 * growth * factor)  # of the second part, in two layers
    assert heights.volume_factor == pytest.approx(
        (4.8 - 1.6 * growth * factor) / (3.2 * growth), rel=1e-6)
