"""A scan that does not lie on the nominal part is refused with the distance that was measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lmctl.errors import ConfigError, InputError
from lmctl.examples.templates import write_template
from lmctl.part.load import load_part
from tests.part_files import block_file

#: About y: turned by 2°, the ends of the bar are 1 mm off.
TURN = np.radians(2.0)


@pytest.fixture(scope="module")
def repair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("repair")
    write_template("repair", folder)
    return folder / "repair.toml"


def moved(x, y, z):
    return lambda points: points + np.array([x, y, z])


def with_scan(repair: Path, folder: Path, change) -> Path:
    """The example with its scan changed: points (n, 3) -> (n, 3)."""
    points = np.loadtxt(repair.parent / "worn_bar.csv", delimiter=",", skiprows=1)
    np.savetxt(folder / "worn_bar.csv", change(points), fmt="%.3f", delimiter=",")
    for name in ("repair.toml", "nominal_bar.stl"):
        (folder / name).write_bytes((repair.parent / name).read_bytes())
    return folder / "repair.toml"


def test_the_scan_that_ships_lies_on_the_nominal_bar(repair):
    part = load_part(repair)
    found = next(note for note in part.notes if "lies on 'nominal'" in note)
    assert "worn by up to 2.0" in found
    assert part.substrate_surface is not None


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (moved(0, 0, 1.5), r"lies above 'nominal' over \d\d% of it, by up to 1\.5"),
        (moved(0, 0, -1.5),
         r"lies on 'nominal' over \d% of it only: half of it is more than 1\.\d\d mm off"),
        (moved(8, 0, 0), r"above 'nominal' over|is shifted against 'nominal' by"),
        (lambda p: p + np.outer(p[:, 0] * np.tan(TURN), (0, 0, 1)), r"above 'nominal' over"),
        (moved(100, 40, 0), r"and the part lie 41\.\d mm apart in the xy plane"),
        (lambda p: p / 25.4, r"lies above|lies on 'nominal' over|beside it"),
    ],
    ids=["raised", "lowered", "pushed along", "turned", "far off", "in inches"],
)
def test_a_scan_that_lies_wrong_is_refused_with_how_far(repair, tmp_path, change, told):
    with pytest.raises(InputError, match=told) as caught:
        load_part(with_scan(repair, tmp_path, change))
    assert "register" in caught.value.hint


def test_a_scan_that_is_pushed_across_a_ridge_is_refused_with_the_way(tmp_path):
    """Everywhere it is less than registration_mm too high or too low; both slopes show the way."""
    (tmp_path / "roof.obj").write_text(
        "v 0 0 0\nv 20 0 0\nv 10 0 3\nv 0 20 0\nv 20 20 0\nv 10 20 3\n"
        "f 1 2 3\nf 4 6 5\nf 1 4 5 2\nf 2 5 6 3\nf 3 6 4 1\n")
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 20.1, 0.5), np.arange(0, 20.1, 0.5)))
    scan = np.column_stack([x + 1.0, y, 3 - 0.3 * np.abs(x - 10)])
    np.savetxt(tmp_path / "scan.xyz", scan, fmt="%.3f")
    (tmp_path / "part.toml").write_text(
        'combine = "difference"\n' + block_file((18, 18, 8), low_mm=(2, 2, 4))
        + '[[body]]\nname = "roof"\nkind = "mesh"\nfile = "roof.obj"\nunits = "mm"\n'
        '[substrate]\nkind = "scan"\nfile = "scan.xyz"\nunits = "mm"\nof = "roof"\n')
    with pytest.raises(InputError, match=r"is shifted against 'roof' by 0\.9\d mm: x 0\.9") as told:
        load_part(tmp_path / "part.toml")
    assert "register" in told.value.hint


def test_a_small_error_of_registration_is_accepted(repair, tmp_path):
    part = load_part(with_scan(repair, tmp_path, moved(0, 0, 0.1)))
    assert any("lies on 'nominal'" in note for note in part.notes)


def test_mistakes_of_the_table_are_told_at_once(tmp_path):
    text = """
name = "p"
[[material]]
name = "316L"
[[body]]
name = "block"
kind = "box"
low_mm = [0, 0, 0]
high_mm = [9, 9, 9]
"""
    for table, told in [
        ('kind = "cylinder"\nnormal = [0, 0, 1]',
         ["a cylinder needs point_mm", "a cylinder needs radius_mm", "a cylinder has no normal"]),
        ('kind = "mesh"\nfile = "a.stl"\nof = "blok"\nlayers = "parallel"',
         ["substrate.of: no body is named 'blok' (did you mean 'block'?)", "substrate.units",
          '"parallel" needs a plane or a cylinder']),
        ('layers = "shifted"', ["layers on a plate are level"]),
        ('kind = "plane"\npoint_mm = [0, 0, 0]\nnormal = [1, 0, -1]', ["normal does not point up"]),
        ('kind = "cylinder"\npoint_mm = [0, 0, 0]\nradius_mm = 5\naxis = [1, 0, 1]',
         ["axis is not level"]),
    ]:
        file = tmp_path / "p.toml"
        file.write_text(f"{text}\n[substrate]\n{table}\n")
        with pytest.raises(ConfigError) as caught:
            load_part(file)
        for words in told:
            assert words in caught.value.render()
