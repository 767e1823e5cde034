"""The material library."""

from __future__ import annotations

import pytest

from lmctl.config.materials import MATERIAL_LIBRARY, find_material, suggest_name


@pytest.mark.parametrize(
    ("name", "density", "apparent", "catch"),
    [
        ("316L", 7.99, 4.4, 0.75), ("WC-12Co", 14.3, 4.8, 0.55), ("Ti-6Al-4V", 4.43, 2.5, 0.75),
        ("8YSZ", 6.05, 2.3, 0.5), ("Cu", 8.96, 4.9, 0.65),
    ],
)
def test_handbook_values(name: str, density: float, apparent: float, catch: float) -> None:
    material = MATERIAL_LIBRARY[name]
    assert (material.density_g_cm3, material.apparent_g_cm3) == (density, apparent)
    assert material.catch_efficiency == catch


def test_values_are_possible() -> None:
    for name, material in MATERIAL_LIBRARY.items():
        assert material.name == name
        assert 0 < material.catch_efficiency <= 1
        if material.apparent_g_cm3 is not None:  # spheres cannot pack denser than this
            assert 0.25 < material.apparent_g_cm3 / material.density_g_cm3 < 0.74
        # docs/explanation/process-defaults.md, Process window, medium class
        assert 800 <= material.power_W <= 2500
        assert 8 <= material.speed_mm_s <= 20


def test_names_are_found_in_any_case_and_guessed() -> None:
    assert find_material("wc-12co") is MATERIAL_LIBRARY["WC-12Co"]
    assert find_material("unobtainium") is None
    assert suggest_name("IN 718", list(MATERIAL_LIBRARY)) == "did you mean 'IN718'?"
    assert suggest_name("ti6al4v", list(MATERIAL_LIBRARY)) == "did you mean 'Ti-6Al-4V'?"
    assert suggest_name("xyzzy", list(MATERIAL_LIBRARY)) == ""
