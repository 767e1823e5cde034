"""Both firmwares, and how a program begins on each."""

from __future__ import annotations

import pytest

BOTH = pytest.mark.parametrize("dialect", ["grbl", "grblhal"])
START = {"grbl": "G21 G90 G94\nM4 S600\n", "grblhal": "G21 G90 G94\nM4 S600\n"}
LEAD_S = {"grbl": 0.05, "grblhal": 0.09}


def beam(rig, times_s):
    rig.machine.stepper.commit()
    return rig.trace.sample(times_s).power_fraction
