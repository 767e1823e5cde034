"""The picture of a part: whatever its shape, nothing is cut off or covered, no paper is lost."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from lmctl.part.load import load_part
from lmctl.report.part_picture import part_figure

LONG = "a part whose name goes on and on, far beyond what fits a line, and on to its end"


def figure_of(folder: Path, size: tuple[float, float, float], materials: list[str], name: str
              ) -> Figure:
    text = f'name = "{name}"\n' + "".join(
        f'[[material]]\nname = "{m}"\ndensity_g_cm3 = 8\ncatch_efficiency = 0.6\npower_W = 1500\n'
        "speed_mm_s = 10\n" for m in materials
    ) + (f'[[body]]\nkind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = {list(size)}\n[composition]\n'
         f'profile = {{ kind = "constant", of = {{ "{materials[0]}" = 1 }} }}\n')
    (folder / "part.toml").write_text(text)
    return part_figure(load_part(folder / "part.toml"), (None, None, None))


def boxes_in(figure: Figure) -> tuple[list[Bbox], Bbox]:
    """What each panel and each key takes with its labels, and the heading [inches]."""
    figure.draw_without_rendering()
    outer = [*(axis.get_tightbbox() for axis in figure.axes), figure._suptitle.get_window_extent()]
    *boxes, heading = (Bbox.from_extents(box.extents / figure.dpi) for box in outer)
    return boxes, heading


@pytest.mark.parametrize(
    ("size", "materials", "name"),
    [
        ((12, 12, 80), ["316L", "WC-12Co"], "rod"),
        ((60, 14, 12), ["a", "b", "c" * 60], "blade"),
        ((60, 60, 10), ["316L", "WC-12Co"], LONG),
        ((2, 20, 400), ["316L"], LONG),
    ],
)
def test_labels_neither_touch_nor_are_cut_and_no_paper_is_wasted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: tuple[float, float, float],
    materials: list[str], name: str,
) -> None:
    monkeypatch.setattr("lmctl.report.part_picture.NODES", 60)
    figure = figure_of(tmp_path, size, materials, name)
    boxes, heading = boxes_in(figure)
    width, height = figure.get_size_inches()
    for box in [*boxes, heading]:
        assert box.x0 > 0
        assert box.y0 > 0
        assert box.x1 < width
        assert box.y1 < height
    for one, other in itertools.combinations([*boxes, heading], 2):
        assert Bbox.intersection(one, other) is None
    for one, other in itertools.pairwise(sorted((box.x0, box.x1) for box in boxes[:3])):
        assert other[0] - one[1] < 0.5
    if name != LONG:
        edges = np.array([box.extents for box in boxes])
        assert edges[:, 0].min() < 0.5
        assert edges[:, 2].max() > width - 0.5
