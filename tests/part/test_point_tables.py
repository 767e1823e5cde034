"""Tables of points in every manner of writing: the same points, or refused with the line."""

from __future__ import annotations

import codecs
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lmctl.errors import InputError
from lmctl.part.load import part_from_model
from lmctl.part.sources.cloud_files import PointCloud, read_cloud
from lmctl.part.sources.files import DataFile

POINTS = np.round(np.random.default_rng(3).uniform(-20, 20, (150, 3)), 3)
MARKS = ("#", "//", "%", "!", ";", "*", "'", "--", "$", "REM", "C")
TEXT = st.text(alphabet="0123456789.,;- \t\n#/xyzeE+\"'", max_size=120)


def read(data: bytes | str, suffix: str = "xyz") -> PointCloud:
    raw = data.encode() if isinstance(data, str) else data
    return read_cloud(DataFile(Path(f"scan.{suffix}"), raw, ""), "mm")


def refused(data: bytes | str, suffix: str = "xyz") -> InputError:
    with pytest.raises(InputError) as caught:
        read(data, suffix)
    assert "scan." in caught.value.what
    return caught.value


def rows(separator: str = " ", decimal: str = ".", after: str = "") -> str:
    lines = [separator.join(f"{v:.3f}".replace(".", decimal) for v in p) + after for p in POINTS]
    return "\n".join(lines) + "\n"


def all_there(cloud: PointCloud) -> bool:
    return bool(np.array_equal(cloud.points, np.unique(POINTS, axis=0)))


@pytest.mark.parametrize("mark", MARKS)
@pytest.mark.parametrize("separator", [" ", "\t", ";", ","])
def test_comments_in_any_common_style(mark: str, separator: str) -> None:
    text = rows(separator)
    half = text.index("\n", len(text) // 2) + 1
    commented = f"{mark} a scan of 1 2 3\n\n{text[:half]}{mark} more\n{text[half:]}{mark} end\n"
    assert all_there(read(commented, "asc"))


@pytest.mark.parametrize(
    ("separator", "decimal"),
    [*((separator, ".") for separator in (" ", "\t", ";", "; ", ",", ", ")),
     *((separator, ",") for separator in (" ", "\t", ";", "; "))],
)
def test_every_separator_and_decimal_mark(separator: str, decimal: str) -> None:
    cloud = read(rows(separator, decimal), "txt")
    assert all_there(cloud)
    assert any("decimal commas" in note for note in cloud.notes) == (decimal == ",")


def test_decimal_commas_between_commas_are_never_guessed() -> None:
    tenths = "\n".join(",".join(f"{v:.1f}".replace(".", ",") for v in p) for p in POINTS)
    for text in (rows(",", ","), tenths, "# scan\n" + tenths):
        error = refused(text, "csv")
        assert "decimal commas between commas" in error.what
        assert "semicolons" in error.hint
    whole = "\n".join(",".join([*(str(int(10 * v)) for v in p), "9,9,9"]) for p in POINTS)
    assert len(read("x,y,z,r,g,b\n" + whole, "csv").points) == len(POINTS)
    assert len(read(whole, "csv").points) == len(POINTS)  # some of its y are negative


def test_decimal_commas_that_come_later_are_seen() -> None:
    cloud = read("0 0 0\n1 2 3\n" + rows(" ", ","), "txt")
    assert len(cloud.points) == len(POINTS) + 2


@pytest.mark.parametrize("head", ["x y z i", "# x y z i", "% X[mm] Y[mm] Z[mm] I", "//X Y Z I"])
@pytest.mark.parametrize("separator", [" ", "\t"])
def test_heads_in_comments_or_not(head: str, separator: str) -> None:
    cloud = read(head.replace(" ", separator) + "\n" + rows(separator, after=separator + "7"))
    assert all_there(cloud)
    assert "of 4 columns" in cloud.notes[0]


def test_a_head_in_a_comment_says_which_column_is_which() -> None:
    swapped = "\n".join(f"{z} {x} {y}" for x, y, z in POINTS.tolist())
    assert all_there(read("# z x y\n" + swapped))
    assert all_there(read("# the x and y and z of a scan\n" + rows()))  # prose is no head


@pytest.mark.parametrize("after", ["", " -1204", " -1204 255 128 0"])
def test_pts_files_say_how_many_points_follow(after: str) -> None:
    assert all_there(read(f"{len(POINTS)}\n" + rows(after=after), "pts"))
    assert all_there(read(rows(after=after), "pts"))
    lines = rows(after=after).splitlines()
    two = ["100", *lines[:100], "50", *lines[100:]]
    assert all_there(read("\n".join(two), "pts"))
    short = refused("150\n" + "\n".join(lines[:120]), "pts")
    assert "promises 150 points, 120 follow" in short.where[0]


def test_text_of_other_encodings() -> None:
    assert all_there(read(codecs.BOM_UTF16_LE + rows().encode("utf-16-le")))
    assert all_there(read("# gr\xfcn\n".encode("latin-1") + rows().encode()))
    assert "not text" in refused(bytes(range(32)) * 40).what


def test_other_things_called_asc_are_called_by_name() -> None:
    heights = "ncols 10\nnrows 10\nxllcorner 0\nyllcorner 0\ncellsize 1\n" + "1 2 3 4\n" * 10
    assert "grid of heights" in refused(heights, "asc").where[0]


def test_lines_written_in_another_manner_than_the_first_are_named() -> None:
    assert "line 151" in refused(rows() + "1,5 2,5 3,5\n" + rows()).what
    assert "line 3" in refused("# a\n1.5 2.5 3.5\n1.5;2.5;3.5\n" + rows()).what


def ball(extra: list[tuple[float, float, float]]) -> str:
    ways = np.random.default_rng(0).normal(size=(6000, 3))
    ways *= 10.0 / np.linalg.norm(ways, axis=1)[:, None]
    return "\n".join(f"{x:.5f} {y:.5f} {z:.5f}" for x, y, z in [*extra, *ways.tolist()])


@pytest.mark.parametrize("far", [4.0, 15.0, 60.0, 900.0, 1e5, 1e9])
@pytest.mark.parametrize("count", [1, 4])
def test_outliers_are_called_outliers(far: float, count: int, tmp_path: Path) -> None:
    """Whatever their distance, and never a question of units."""
    (tmp_path / "a.xyz").write_text(ball([(10 + far, 0.1 * n * far, 0) for n in range(count)]))
    part = part_from_model(tmp_path / "a.xyz", "mm")
    assert sum("outliers" in warning for warning in part.warnings) == 1
    assert part.bounds_mm[1] == pytest.approx([9.95] * 3, abs=0.15)
    assert part.grid.pitch_mm <= 0.5


def test_what_is_far_but_many_is_no_outlier() -> None:
    two = ball([]) + "\n" + "\n".join(
        f"{x + 100} {y} {z}" for x, y, z in np.random.default_rng(1).normal(size=(400, 3)).tolist())
    assert len(read(two).points) == 6400


@settings(max_examples=300, deadline=None)
@given(TEXT, st.sampled_from(["xyz", "csv", "txt", "asc", "pts"]))
@example("1;2\n;", "csv")
@example('"1,2,3', "csv")
@example("5\n", "pts")
@example("1e999 1 1\n" * 120, "xyz")
@example('1 2 "3\n', "xyz")
def test_whatever_else_is_written_is_read_or_refused_in_words(text: str, suffix: str) -> None:
    if not text.strip():
        return
    error = refused(text, suffix)
    reported = " ".join([error.what, *error.where, error.hint])
    for word in ("dtype", "usecols", "ndarray", "array(", "loadtxt", "could not convert"):
        assert word not in reported
