"""Tracks of equal mixture are deposited in the order in which heat makes the beam wait least."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.job.schema import LineKind
from lmctl.part.load import load_part
from lmctl.plan.planner import plan_job
from lmctl.plan.sequence import layer_sequencer
from lmctl.plan.sequence.heat_order import rearrangement_of
from tests.plan.planned_jobs import layers_of

BAR = """
[[body]]
name = "{name}"
kind = "box"
low_mm = [{at}, 0, 0]
high_mm = [{end}, 14, 4]
composition.profile = {{ kind = "constant", of = {{ "316L" = {steel}, "WC-12Co" = {hard} }} }}
"""


def bars(steel=(1.0,) * 5, limit=200):
    """Five walls of one track side by side, with so much steel each."""
    names = "abcde"
    text = 'name = "bars"\n[[material]]\nname = "316L"\n[[material]]\nname = "WC-12Co"\n'
    for number, share in enumerate(steel):
        text += BAR.format(name=names[number], at=6 * number, end=6 * number + 2, steel=share,
                           hard=round(1 - share, 3))
    return text + f"""[[body]]
kind = "union"
of = {list(names)}
[process]
power_W = 800
interpass_max_C = {limit}
""".replace("'", '"')


@pytest.fixture
def plan(tmp_path, profile):
    def planned(text):
        file = tmp_path / "bars.toml"
        file.write_text(text, encoding="utf-8")
        plan_job(load_part(file), profile, tmp_path / "bars.lmj")
        return layers_of(tmp_path / "bars.lmj")

    return planned


def test_a_layer_begins_where_it_is_coolest(plan, monkeypatch):
    manifest, _ = plan(bars())
    heat = manifest.totals["predicted_heat"]
    assert heat["layers_reordered"] >= 2
    assert heat["interpass_C"] <= 200 + heat["interpass_max_C"] / 50
    assert {layer.order for layer in manifest.heat} <= {"nearest", "coolest", "apart"}
    assert any("in an order that heat asked for" in found["text"] for found in manifest.verdict)
    monkeypatch.setattr(layer_sequencer, "quickest_attempt", lambda _h, _g, _o, first, *_: first)
    nearest, _ = plan(bars())
    assert nearest.totals["predicted_heat"]["layers_reordered"] == 0
    assert manifest.totals["duration_s"] < nearest.totals["duration_s"] - 3
    assert manifest.totals["deposited_volume_mm3"] == pytest.approx(
        nearest.totals["deposited_volume_mm3"], rel=1e-6)


def test_mixtures_stay_in_their_order(plan):
    """Three bars of one mixture, two of another: what heat asks for stays within each."""
    manifest, layers = plan(bars((1.0, 0.5, 1.0, 0.5, 1.0), limit=150))
    assert manifest.totals["predicted_heat"]["layers_reordered"] >= 1
    for layer in layers:
        steel = layer.lines["fractions"][layer.lines["kind"] == LineKind.BEAD][:, 0]
        changes = np.flatnonzero(np.abs(np.diff(steel)) > 0.1)
        assert len(changes) == 1


def in_a_row(count):
    """Tracks of two vertices, 2 mm apart."""
    at = np.repeat(2.0 * np.arange(count), 2)
    return SimpleNamespace(points_mm=np.column_stack([at, np.tile([0.0, 9.0], count)]),
                           starts=np.arange(0, 2 * count + 1, 2))


@settings(max_examples=40, deadline=None)
@given(count=st.integers(2, 30), seed=st.integers(0, 100))
def test_orders_hold_every_track_once_and_begin_with_the_coolest(count, seed):
    track_C = np.random.default_rng(seed).permutation(count) * 10.0
    for order in ("coolest", "apart"):
        tracks = rearrangement_of(order, in_a_row(count), np.repeat(track_C, 2))(np.arange(count))
        assert sorted(tracks.tolist()) == list(range(count))
        assert track_C[tracks[0]] == 0
    tracks = rearrangement_of("coolest", in_a_row(count), np.repeat(track_C, 2))(np.arange(count))
    assert (np.diff(track_C[tracks]) > 0).all()


def test_tracks_apart_are_no_neighbours():
    tracks = rearrangement_of("apart", in_a_row(12), np.zeros(24))(np.arange(12))
    assert np.abs(np.diff(tracks))[:6].min() >= 2
