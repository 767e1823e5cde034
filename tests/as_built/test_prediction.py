"""What a journal predicts: even where the machine was reported to go at an even pace."""

from types import SimpleNamespace

import numpy as np
import pytest

from lmctl.as_built.believed_dilution import LevelDilution
from lmctl.as_built.journal_powder import CommandedPowder
from lmctl.as_built.prediction import _Beads, _strips, predicted_volume
from lmctl.errors import InputError


def straight_beads(angle, n_tracks=9, length=20.0, pitch=1.3, step=0.2):
    """Parallel strips that close up, at an angle to the voxels."""
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    across = np.array([-np.sin(angle), np.cos(angle), 0.0])
    s = np.arange(step / 2, length, step)
    place = np.concatenate([
        s[:, None] * along + (track - n_tracks / 2 + 0.5) * pitch * across
        for track in range(n_tracks)])
    place[:, 2] = 0.8
    n = len(place)
    return _Beads(place, np.tile(along, (n, 1)), np.full(n, step), np.full(n, pitch),
                  np.arange(n) * 0.02, np.full(n, 0.02), np.arange(n)), along, across


def test_strips_that_close_up_fill_voxels_evenly_at_any_angle():
    for angle in (0.0, 0.3, 0.7, 1.1):
        beads, along, across = straight_beads(angle)
        volume = (beads.length_mm * beads.width_mm * 0.8)[:, None]
        built = _strips(beads, volume, 0.8, 0.0, ("316L",))
        assert np.isclose(built.deposited_mm3.sum(), volume.sum(), rtol=1e-6)
        filled = built.deposited_mm3[0] / np.prod(built.voxel_mm)
        i, j = np.indices(filled.shape[:2])
        centre = built.origin_mm[:2] + (np.stack([i, j], axis=2) + 0.5) * built.voxel_mm[:2]
        inside = ((np.abs(centre @ along[:2] - 10) < 9) & (np.abs(centre @ across[:2]) < 5))
        assert np.abs(filled[inside][:, :3] - 1).max() < 0.05


def test_runs_that_deposited_nothing_predict_nothing():
    with pytest.raises(InputError, match="reports no bead with powder") as refused:
        predicted_volume(SimpleNamespace(), SimpleNamespace(), [])
    assert "lmctl jobs" in refused.value.hint


@pytest.mark.parametrize("substrate", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), None])
def test_layers_melt_what_lies_below_them(substrate):
    """By the recursion of deposits, in a column of five layers with a gap; volumes stay."""
    fed = np.array([0.5, 0.625, 0.2, 0.8, 0.4])
    volumes = np.zeros((3, 2, 2, 18))
    levels = [3, 6, 9, 12, 15]
    for level, second in zip(levels, fed, strict=True):
        volumes[:, 0, 1, level] = 7.0 * np.array([1 - second, second, 0.0])
    plate = None if substrate is None else np.array(substrate)
    found = LevelDilution(0.2, plate).melted_into(volumes)
    assert found.sum(axis=0) == pytest.approx(volumes.sum(axis=0))
    below = plate
    for level, second in zip(levels, fed, strict=True):
        laid = np.array([1 - second, second, 0.0])
        if below is not None:
            laid = 0.8 * laid + 0.2 * below
        assert found[:, 0, 1, level] / 7.0 == pytest.approx(laid)
        below = laid


def test_a_hose_that_a_purge_has_measured_delays_what_is_set_from_then_on():
    """Steps at 10 s and 30 s, the second behind the hose as measured at 20 s."""
    powder = CommandedPowder()
    powder.take({"kind": "header", "hoppers": [
        {"name": "A", "material": "316L", "dead_time_s": 3.0, "lag_s": 1.0}]})
    for record in (
        {"kind": "setpoint", "t": 10.0, "flow_g_min": {"A": 6.0}},
        {"kind": "hose_response", "t": 20.0, "source": "not measured", "reason": "it is full"},
        {"kind": "hose_response", "t": 20.0, "source": "measured", "hopper": "A",
         "used_dead_time_s": 4.0, "used_lag_s": 0.5},
        {"kind": "setpoint", "t": 30.0, "flow_g_min": {"A": 12.0}},
    ):
        powder.take(record)
    at_s = np.array([12.9, 14.0, 25.0, 33.9, 34.5, 40.0])
    expected = [0.0, 0.1 * (1 - np.exp(-1)), 0.1, 0.1, 0.2 - 0.1 * np.exp(-1), 0.2]
    assert powder.flow_g_s("316L", at_s) == pytest.approx(expected, abs=1e-4)
