"""Real-time bytes that set a feed override."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files

import pytest

from firmware_protocol.realtime import RealtimeCommand
from lmctl.config.machine import load_profile
from lmctl.errors import UsageError
from lmctl.run.program.override_limits import (
    LEAST_PERCENT,
    MOST_PERCENT,
    override_bytes,
    override_range,
)

STEP = {
    RealtimeCommand.FEED_PLUS_10: 10, RealtimeCommand.FEED_MINUS_10: -10,
    RealtimeCommand.FEED_PLUS_1: 1,
    RealtimeCommand.FEED_MINUS_1: -1,
}


def test_every_override_is_reached_from_any_other():
    for percent in range(LEAST_PERCENT, MOST_PERCENT + 1):
        first, *steps = override_bytes(percent)
        assert first is RealtimeCommand.FEED_100
        assert 100 + sum(STEP[byte] for byte in steps) == percent


@pytest.mark.parametrize("percent", [0, 49, 201, -60])
def test_others_are_refused(percent):
    with pytest.raises(ValueError, match="is not from 50 to 200"):
        override_bytes(percent)


@pytest.fixture
def range_of(job):
    """range_of(peak_power_W=..., peak_flow_g_min=...): of a job with these totals."""

    def made(**totals):
        manifest = job([[("bead", (1, 0, 0), 1.0, 0)]]).manifest
        cell = load_profile(files("lmctl.examples") / "cell.toml")
        return override_range(replace(manifest, totals=totals), cell)

    return made


@pytest.mark.parametrize(("totals", "most", "limit"), [
    ({}, 200, ""),
    ({"peak_power_W": 1200.0}, 200, ""),
    ({"peak_power_W": 2400.0}, 125, "the job asks for 2400 W, and the laser has 3000"),
    ({"peak_power_W": 3000.0}, 100, "the job asks for 3000 W, and the laser has 3000"),
    ({"peak_power_W": 1e-9, "peak_flow_g_min": {"A": 0.0}}, 200, ""),
    ({"peak_power_W": 2000.0, "peak_flow_g_min": {"A": 48.0}}, 125, "48.0 g/min of hopper A"),
])
def test_an_override_goes_as_far_as_beam_and_powder_follow(range_of, totals, most, limit):
    found = range_of(**totals)
    found.check(most)
    found.check(LEAST_PERCENT)
    with pytest.raises(UsageError) as refused:
        found.check(most + 1)
    assert f"give 50 to {most}" in str(refused.value.hint)
    assert limit in "".join(refused.value.where)
