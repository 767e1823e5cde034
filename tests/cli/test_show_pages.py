"""`lmctl show` as a page: all of a job or a run in one file, and every value the job's own."""

from __future__ import annotations

import json
import re
import shutil
import zlib
from base64 import b64decode
from html.parser import HTMLParser

import numpy as np
import pytest

from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.run.journal.format import read_records


@pytest.fixture(autouse=True)
def copied(recovered_part, tmp_path):
    shutil.copytree(recovered_part, tmp_path, dirs_exist_ok=True)


def unpacked(packed):
    """The columns of a layer, as the page's own script decodes them."""
    data = zlib.decompress(b64decode(packed["data"]))
    found = {}
    for column in packed["columns"]:
        if column["type"] == "f4":
            found[column["name"]] = np.frombuffer(data, "<f4", column["n"], column["at"])
            continue
        steps = np.cumsum(np.frombuffer(data, "<u2", column["n"], column["at"]), dtype="<u2")
        values = column["low"] + column["step"] * steps.astype(float)
        holes = column["holes"] & (steps == 65_535)
        found[column["name"]] = np.where(holes, np.nan, values)
    return found


class Scripts(HTMLParser):
    """The text of each script element, and all references that leave the page."""

    def __init__(self, text):
        super().__init__()
        self.texts, self.references, self._open = [], [], False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self._open = tag == "script"
        if self._open:
            self.texts.append("")
        self.references += [value for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag):
        self._open = False

    def handle_data(self, data):
        if self._open:
            self.texts[-1] += data


def page(tmp_path, lmctl, *arguments):
    done = lmctl("show", *arguments, "-o", "page.html")
    assert done.code == 0, done.talk
    text = (tmp_path / "page.html").read_text("utf-8")
    found = Scripts(text)
    head, layers, script = found.texts
    assert found.references == []
    assert "http" not in text.replace("http-equiv", "")
    assert "@" not in re.sub(r"@media", "", text.partition("<script")[0])
    return json.loads(head), json.loads(layers), script


def test_every_value_of_a_job_is_in_its_page(tmp_path, lmctl):
    head, layers, _ = page(tmp_path, lmctl, "part.lmj")
    with JobReader(tmp_path / "part.lmj") as job:
        assert (head["part"], head["job"]) == ("block <b>&</b>", job.digest)
        assert head["runs"] == []
        assert len(layers) == len(job.manifest.layers) == 2
        for shown, layer, mixture in zip(layers, job.iterate_layers(), job.manifest.mixtures,
                                         strict=True):
            values, lines = unpacked(shown), layer.lines
            for name, column, step in (
                ("x", "x_mm", 0.005), ("y", "y_mm", 0.005), ("width", "bead_width_mm", 1e-4),
                ("power", "power_W", 0.05), ("speed", "speed_mm_s", 0.001),
            ):
                assert values[name] == pytest.approx(lines[column], abs=step)
            assert values["s"] == pytest.approx(lines["end_s"] - layer.flow_s[0], abs=1e-3)
            assert (values["kind"] == lines["kind"]).all()
            assert values["flow1"] == pytest.approx(60.0 * layer.flow_g_s[:, 1], abs=1e-3)
            assert values["planned0"] == pytest.approx(lines["fractions"][:, 0], abs=1e-4)
            bead = lines["kind"] == LineKind.BEAD
            way = np.hypot(*(np.diff(lines[axis], prepend=lines[axis][0])
                             for axis in ("x_mm", "y_mm")))
            mean = np.average(values["predicted0"][bead], weights=way[bead])
            assert mean == pytest.approx(mixture.predicted[0], abs=0.005)
            worst = max(np.abs(values[f"predicted{k}"] - values[f"planned{k}"])[bead].max()
                        for k in (0, 1))
            assert values["error"].max() == pytest.approx(worst, abs=1e-4)
            assert values["designed0"][bead] == pytest.approx(lines["designed"][bead, 0], abs=1e-4)
            assert np.isnan(values["designed0"][~bead]).all()
            starts = np.flatnonzero(np.diff(lines["path"][bead])) + 1
            assert (np.flatnonzero(np.diff(values["path"][bead])) + 1 == starts).all()


def test_the_page_of_a_run_shows_what_was_executed_and_reported(tmp_path, lmctl):
    head, layers, _ = page(tmp_path, lmctl, "run-0002")
    assert [(one["run"], one["state"]) for one in head["runs"]] == [
        ("run-0001", "faulted"), ("run-0002", "done")]
    (cut,) = head["interruptions"]
    assert (cut["known"], cut["resumed_in"]) == ("unknown", "run-0002")
    assert cut["entry_line"] >= cut["line"]
    assert [one["executed"] for one in layers] == [len(unpacked(one)["x"]) for one in layers]
    assert layers[0]["remark"]
    for shown in layers:
        planned, seen = unpacked(shown), unpacked(shown["reported"])
        for run in np.unique(seen["run"]):
            assert (np.diff(seen["s"][seen["run"] == run]) >= 0).all()
        # A place reported lies on the line that the job runs at that time.
        x = np.interp(seen["s"], planned["s"], planned["x"])
        y = np.interp(seen["s"], planned["s"], planned["y"])
        assert np.hypot(x - seen["x"], y - seen["y"]).max() < 0.05
        planned_there = np.interp(seen["s"], planned["s"], planned["planned0"])
        late = seen["s"] > 3.0  # the first seconds of a layer may still hold the mixture before
        assert np.abs(seen["inferred0"] - planned_there)[late].max() < 0.03
    assert set(unpacked(layers[0]["reported"])["run"]) == {0.0, 1.0}
    samples = sum(
        sum(beam > 0 for beam in record["s_word"])
        for run in ("run-0001", "run-0002")
        for record in read_records(tmp_path / f"runs/{run}/journal.jsonl")
        if record["kind"] == "samples")
    assert sum(len(unpacked(one["reported"])["s"]) for one in layers) == samples


def test_a_run_that_was_broken_off_is_shown_as_far_as_it_came(tmp_path, lmctl):
    shutil.rmtree(tmp_path / "runs/run-0002")
    _, layers, _ = page(tmp_path, lmctl, "runs/run-0001")
    assert 0 < layers[0]["executed"] < len(unpacked(layers[0])["x"])
    assert (layers[1]["executed"], layers[1]["reported"]) == (0, None)


def test_names_cannot_end_the_script_they_stand_in(tmp_path, lmctl):
    (tmp_path / "part.toml").write_text(
        (tmp_path / "part.toml").read_text().replace("block <b>&</b>", "</script><i>"))
    assert lmctl("plan", "part.toml", "-o", "part.lmj").code == 0
    head, _, script = page(tmp_path, lmctl, "part.lmj", "--layer", "2")
    assert head["part"] == "</script><i>"
    assert script.rstrip().endswith("start();")
    assert 'data-first="1"' in (tmp_path / "page.html").read_text("utf-8")


@pytest.mark.parametrize(("arguments", "told"), [
    (["run-0002", "-o", "a.png"], "choose .html"),
    (["run-0002", "-x", "1"], "are for parts"),
    (["run-0007"], "there is no run 'run-0007'"),
    (["part.lmj", "-o", "no/where.html"], "there is no folder no"),
    (["nothing.lmj"], "nothing.lmj"),
])
def test_what_cannot_be_shown_is_refused(refused, arguments, told):
    assert told in refused("show", *arguments, code=2, hint=False)


def test_a_run_without_its_job_is_refused(tmp_path, refused):
    (tmp_path / "runs/run-0002/job.lmj").unlink()
    assert "is not the job of this run" in refused("show", "run-0002", code=1)
