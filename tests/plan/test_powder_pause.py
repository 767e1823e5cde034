"""Powder stops in long waits, and the next bead has its mixture from the first millimetre on."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.job.schema import LineKind
from lmctl.part.load import load_part
from lmctl.plan.recipe import make_recipe
from lmctl.plan.sequence.mixture_ramps import PowderLimits
from lmctl.plan.sequence.powder_flow import NO_PAUSE, powder_flow
from lmctl.plan.sequence.powder_pause import PowderPause, powder_pause_of
from tests.benchmarks.mixture_rows.as_built import build
from tests.plan.planned_jobs import layers_of

LIMITS = PowderLimits(np.array([1.0, 0.5]), np.array([4.0, 4.0]), np.ones(2))
PAUSE = PowderPause(steady_s=6.0, least_off_s=5.0)
BEFORE, NEXT = np.array([0.8, 0.2]), np.array([0.3, 0.9])


def flow_in_gap(gap_s, pause=PAUSE):
    """Knots of a gap and of the bead of 3 s after it."""
    return powder_flow(10.0, 13.0 + gap_s, np.array([10.0 + gap_s, 13.0 + gap_s]),
                       np.vstack([NEXT, NEXT]), np.array([0, 2]), LIMITS, "lead", BEFORE,
                       pause=pause)


def test_powder_stops_in_a_long_gap_and_stands_before_the_bead():
    flow = flow_in_gap(60.0)
    at_s = np.linspace(10.0, 73.0, 5000)
    now = np.column_stack([np.interp(at_s, flow.times_s, flow.g_s[:, m]) for m in range(2)])
    assert now[(at_s > 20) & (at_s < 60)] == pytest.approx(0.0)
    assert now[at_s > 70 - PAUSE.steady_s] == pytest.approx(np.broadcast_to(NEXT, now[
        at_s > 70 - PAUSE.steady_s].shape))
    # no other mixture on the way up; and set-points that hoppers have
    rising = now[(at_s > 60) & (now.sum(axis=1) > 1e-6)]
    assert rising[:, 0] / rising.sum(axis=1) == pytest.approx(0.25)
    slope = np.diff(flow.g_s, axis=0) / np.diff(flow.times_s)[:, None]
    for setpoint in (flow.g_s[:-1] + LIMITS.lag_s * slope, flow.g_s[1:] + LIMITS.lag_s * slope):
        # chords of the last bit of a fall are a little steeper than the fall itself
        assert (setpoint >= -2e-3 * LIMITS.max_flow_g_s).all()
        assert (setpoint <= LIMITS.max_flow_g_s + 1e-9).all()


def test_a_gap_too_short_to_stop_is_as_it_was():
    for gap_s in (0.0, 2.0, 11.0, 17.0):
        flow, same = flow_in_gap(gap_s), flow_in_gap(gap_s, NO_PAUSE)
        assert (flow.times_s == same.times_s).all()
        assert (flow.g_s == same.g_s).all()


def test_other_modes_never_stop():
    flow = powder_flow(0.0, 63.0, np.array([60.0, 63.0]), np.vstack([NEXT, NEXT]),
                       np.array([0, 2]), LIMITS, "dwell", BEFORE, pause=PAUSE)
    assert flow.g_s.min() > 0


WAITING = """
name = "bar"
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
[composition]
feature = { kind = "coordinate", along = "x" }
profile = { kind = "linear", near = { "316L" = 0.7, "WC-12Co" = 0.3 }, over_mm = [0, 12], far = { \
"316L" = 0.3, "WC-12Co" = 0.7 } }
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [12, 2, 1.6]
[process]
least_layer_time_s = 60
"""


def test_a_plan_wastes_no_powder_in_its_waits(tmp_path, profile):
    """And on the bench, by the simulators' own record, the bead after the wait is as planned."""
    file = tmp_path / "bar.toml"
    file.write_text(WAITING)
    as_built = build(file, late_s=0.0, volume=False)
    totals = as_built.manifest.totals
    _, layers = layers_of(file.with_suffix(".lmj"))
    second = layers[1]
    bead_s = second.lines["end_s"][np.argmax(second.lines["kind"] == LineKind.BEAD) - 1]
    pause = powder_pause_of(make_recipe(
        load_part(file).materials, load_part(file).process, profile), profile)
    off = second.flow_s[second.flow_g_s.sum(axis=1) < 1e-9]
    assert off.max() - off.min() >= 25
    from_s = np.searchsorted(second.flow_s, bead_s - pause.steady_s - 1e-6)
    standing = second.flow_g_s[from_s:np.searchsorted(second.flow_s, bead_s + 1e-6)]
    assert standing == pytest.approx(np.broadcast_to(standing[-1], standing.shape))
    assert sum(totals["powder_beam_off_g"].values()) < 0.5 * 50 * standing[-1].sum()
    assert as_built.path_share > 0.99
