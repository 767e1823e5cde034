"""A wanted tolerance chooses the pitch of a cloud's field; what the data cannot give is refused."""

from pathlib import Path

import numpy as np
import pytest

from lmctl.errors import InputError
from lmctl.part.load import load_part
from lmctl.part.tolerance import cloud_within_tolerance, surface_error_mm

RADIUS_MM = 6.0


def ball(count: int, noise_mm: float, seed: int = 1) -> np.ndarray:
    """Samples of a sphere, spread evenly, off it by as much along its normals."""
    turn = np.arange(count) * np.pi * (3 - np.sqrt(5))
    z = 1 - (2 * np.arange(count) + 1) / count
    flat = np.sqrt(1 - z**2)
    unit = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    off = np.random.default_rng(seed).normal(0, noise_mm, (count, 1))
    return (RADIUS_MM + off) * unit


@pytest.fixture(scope="module")
def within():
    return cloud_within_tolerance(ball(3000, 0.01), None, 1.0, 0.02, is_fixed=False)


def test_the_pitch_is_refined_until_the_surface_is_within(within):
    assert within.error_mm <= 0.02
    assert within.stored.grid.pitch_mm < 1.0


def test_the_estimate_is_true_of_the_surface(within):
    """Against the sphere itself, which the samples do not hold."""
    truth = np.abs(surface_error_at_sphere(within))
    assert np.quantile(truth, 0.95) <= 1.5 * within.error_mm
    assert within.error_mm == pytest.approx(
        surface_error_mm(within.stored, ball(3000, 0.01)), rel=1e-6)


def surface_error_at_sphere(within) -> np.ndarray:
    from lmctl.field.field import sample_distance

    return sample_distance(within.stored, ball(2000, 0.0, seed=2))


def test_what_noise_does_not_allow_is_refused_with_what_it_allows():
    cloud = ball(1500, 0.1)
    with pytest.raises(InputError) as caught:
        cloud_within_tolerance(cloud, None, 1.0, 0.001, is_fixed=False)
    text = caught.value.render()
    assert "cannot be had within tolerance_mm = 0.001" in text
    enough = float(text.split("at least ")[1].split(",")[0])
    found = cloud_within_tolerance(cloud, None, 1.0, enough, is_fixed=False)
    assert found.error_mm <= enough


def test_a_stated_pitch_is_kept():
    with pytest.raises(InputError, match="cannot be had") as caught:
        cloud_within_tolerance(ball(3000, 0.01), None, 1.0, 0.0005, is_fixed=True)
    assert "pitch_mm is given" in caught.value.render()


def test_a_part_file_states_it_and_what_was_reached_is_reported(tmp_path: Path):
    np.savetxt(tmp_path / "ball.xyz", ball(3000, 0.01), fmt="%.4f")
    (tmp_path / "ball.toml").write_text(
        'name = "ball"\ntolerance_mm = 0.05\n[[material]]\nname = "316L"\n'
        '[[body]]\nkind = "cloud"\nfile = "ball.xyz"\nunits = "mm"\n', encoding="utf-8")
    part = load_part(tmp_path / "ball.toml")
    assert part.surface_error_mm is not None
    assert part.surface_error_mm <= 0.05
    assert any("tolerance_mm is 0.05" in note for note in part.notes)
