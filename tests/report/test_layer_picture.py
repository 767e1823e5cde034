"""Pictures of layers: covered where beads are, colours apart for every eye and in grey."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.image import imread

from lmctl.job.schema import JobLayer, LineKind, line_dtype
from lmctl.report.composition_colours import composition_colours, material_colours
from lmctl.report.layer_picture import LayerView, draw_layer

#: Machado, Oliveira, Fernandes (2009), severity 1, in linear sRGB, DOI 10.1109/TVCG.2009.113.
BLINDNESS = {
    "none": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                   [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                     [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                   [0.004733, 0.691367, 0.303900]],
}


def lab(linear):
    """CIE L*a*b* of linear sRGB (n, 3), D65."""
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722],
                       [0.0193, 0.1192, 0.9505]])
    ratio = np.clip(linear @ to_xyz.T, 0, None) / [0.9505, 1.0, 1.089]
    f = np.where(ratio > 216 / 24389, np.cbrt(ratio), (24389 / 27 * ratio + 16) / 116)
    return np.column_stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]),
                            200 * (f[:, 1] - f[:, 2])])


def linear(colours):
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("count", [2, 3, 4])
@pytest.mark.parametrize("kind", BLINDNESS)
def test_pure_materials_stay_apart_for_every_eye_and_in_grey(count, kind):
    seen = lab(np.clip(linear(material_colours(count)) @ np.array(BLINDNESS[kind]).T, 0, 1))
    for a, b in combinations(seen, 2):
        assert np.linalg.norm(a - b) > 25
        if kind == "none":
            assert abs(a[0] - b[0]) > 12


@pytest.mark.parametrize("count", [2, 3, 4])
def test_every_mixture_has_a_colour_of_its_own(count):
    """Mixtures a tenth apart differ; so a picture can be read back by its key."""
    tenths = np.array([row for row in np.ndindex(*[11] * count) if sum(row) == 10]) / 10
    seen = lab(linear(composition_colours(tenths)))
    gap = np.linalg.norm(seen[:, None] - seen[None], axis=2) + 1e9 * np.eye(len(seen))
    assert gap.min() > 1.0


def square_layer(pitch_mm, n=10):
    """Rows of a square, bead width 2 mm, one path each."""
    table = np.zeros(2 * n, line_dtype(2))
    for k in range(n):
        y = 100 + k * pitch_mm
        table[2 * k] = table[2 * k + 1] = 0
        table["x_mm"][2 * k : 2 * k + 2] = (100, 120)
        table["y_mm"][2 * k : 2 * k + 2] = y
        table["kind"][2 * k : 2 * k + 2] = (LineKind.TRAVEL, LineKind.BEAD)
        table["path"][2 * k : 2 * k + 2] = (-1, k)
    table["bead_width_mm"][1::2] = 2.0
    table["fractions"] = (0.5, 0.5)
    return JobLayer(0, 0.8, 0, ("",) * len(table), table, np.zeros(2), np.zeros((2, 2)))


@pytest.mark.parametrize(("pitch_mm", "covered"), [(1.334, 1.0), (4.0, 0.5)])
def test_beads_cover_in_the_picture_what_they_cover_in_the_layer(tmp_path, pitch_mm, covered):
    layer = square_layer(pitch_mm)
    draw_layer(layer, ("316L", "WC-12Co"), LayerView((100, 100), (90, 90), "part", "a layer"),
               tmp_path / "a.png")
    image = imread(tmp_path / "a.png")[:, :, :3]
    teal = np.abs(image - composition_colours(np.array([[0.5, 0.5]]))[0]).max(axis=2) < 0.02
    rows = np.flatnonzero(teal[:, : teal.shape[1] * 3 // 4].any(axis=1))
    columns = np.flatnonzero(teal[:, : teal.shape[1] * 3 // 4].any(axis=0))
    inside = image[rows[0] : rows[-1], columns[0] + 20 : columns[-1] - 20]
    paper = (inside > 0.999).all(axis=2).mean()
    assert 1 - paper == pytest.approx(covered, abs=0.08)
