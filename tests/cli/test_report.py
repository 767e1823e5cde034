"""`lmctl report`: one report of a part made in two runs, in every form; and what is refused."""

from __future__ import annotations

import csv
import io
import re
import shutil
from html.parser import HTMLParser

import pytest

from lmctl.job.reader import JobReader
from lmctl.report.as_built_text import BUILT_BY


@pytest.fixture(autouse=True)
def copied(recovered_part, tmp_path):
    shutil.copytree(recovered_part, tmp_path, dirs_exist_ok=True)


@pytest.fixture(autouse=True)
def _without_pictures(request, monkeypatch):
    """They take most of the time, and few tests are about them."""
    if "with_pictures" not in request.fixturenames:
        monkeypatch.setattr("lmctl.report.job_report.pictures.report_pictures", lambda _: [])


@pytest.fixture
def with_pictures():
    """Draws the pictures."""


class Page(HTMLParser):
    """The words of a page, and what its tags refer to."""

    def __init__(self, text):
        super().__init__()
        self.words, self.references, self.tags, self.blanks = [], [], [], 0
        self.feed(text)
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "data", "action"):
                self.references.append(value)
            self.blanks += (name, value) == ("class", "blank")

    def handle_data(self, data):
        if self.tags and self.tags[-1] != "style":
            self.words.append(data)


def page(tmp_path, lmctl, *options):
    done = lmctl("report", "run-0001", "-o", "report.html", *options)
    assert done.code == 0, done.talk
    return Page((tmp_path / "report.html").read_text(encoding="utf-8"))


def test_runs_that_recovered_one_another_are_one_report(tmp_path, lmctl):
    first = page(tmp_path, lmctl)
    assert "run-0001, run-0002 on bench cell" in first.text
    assert "layers complete 2 of 2" in first.text
    assert "operator Ada, Bob" in first.text
    assert (lmctl("report", "run-0002", "-o", "other.html").code, Page(
        (tmp_path / "other.html").read_text(encoding="utf-8")).text) == (0, first.text)
    alone = page(tmp_path, lmctl, "--run-only")
    assert "NOT COMPLETE: ended by a fault" in alone.text
    assert "run-0002" not in alone.text


def test_the_page_needs_nothing_but_itself(tmp_path, lmctl, with_pictures):
    found = page(tmp_path, lmctl)
    assert found.references
    assert all(one.startswith("data:image/png;base64,") for one in found.references)
    assert not {"script", "link", "iframe", "b"} & set(found.tags)
    assert "block <b>&</b>" in found.text
    assert "url(" not in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_digests_are_whole_and_verified(tmp_path, lmctl):
    found = page(tmp_path, lmctl)
    with JobReader(tmp_path / "runs/run-0001/job.lmj") as job:
        for digest in (job.digest, job.manifest.part_sha256, job.manifest.profile_digest):
            assert digest in found.text
    assert found.text.count("whole and sealed") == 2
    assert "its digest is the one in the journal" in found.text
    assert "whole, and made on this journal" in found.text


def test_what_no_one_has_stated_is_a_ruled_blank(tmp_path, lmctl):
    before = page(tmp_path, lmctl)
    assert "serial number SN-0" in before.text
    assert "A4711" in before.text
    after = page(tmp_path, lmctl, "--set", "serial=SN-7", "--set", "drawing=D-100", "--set",
                 "powder.WC-12Co.certificate=3.1/88")
    assert "serial number SN-7" in after.text
    assert "3.1/88" in after.text
    assert before.blanks - after.blanks == 2


def test_it_shows_first_out_cause_reentry_and_modelled_on(tmp_path, lmctl):
    text = page(tmp_path, lmctl).text
    assert "first out" in text
    assert "stood when the run ended" in text
    assert re.search(r"layer 1, line \d+, \d+ % unknown .* run-0002 layer 1, line \d+", text)
    assert "modelled on those of ASTM F2971 and NASA-STD-6030" in text
    assert "no statement of conformity" in text
    assert "Note on run-0001: the plug was loose" in text


def test_the_pdf_is_of_the_same_document_and_the_same_every_time(tmp_path, lmctl, with_pictures):
    assert lmctl("report", "run-0001", "-o", "a.pdf").code == 0
    assert lmctl("report", "run-0001", "-o", "b.pdf").code == 0
    data = (tmp_path / "a.pdf").read_bytes()
    assert data.startswith(b"%PDF-")
    assert data == (tmp_path / "b.pdf").read_bytes()
    sizes = {tuple(float(one) for one in box.split())
             for box in re.findall(rb"/MediaBox \[ ?([0-9. ]+)\]", data)}
    assert [tuple(round(one) for one in size) for size in sizes] == [(0, 0, 595, 842)]
    assert len(re.findall(rb"/Type /Page\b", data)) >= 3
    assert data.count(b"/Subtype /Image") == 2


def test_a_journal_without_an_end_is_reported_as_such(tmp_path, lmctl):
    journal = tmp_path / "runs/run-0002/journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-200])
    done = lmctl("report", "run-0002", "-o", "report.html")
    assert done.code == 0, done.talk
    assert "the journal of run-0002 has no end" in done.talk
    text = Page((tmp_path / "report.html").read_text(encoding="utf-8")).text
    assert "NOT COMPLETE" in text
    assert "The journal of run-0002 has no end: its last line was half written" in text


def test_an_altered_journal_is_named_with_its_line(tmp_path, lmctl):
    journal = tmp_path / "runs/run-0001/journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    lines[0] = lines[0].replace(b'"Ada"', b'"Eve"')
    journal.write_bytes(b"".join(lines))
    text = page(tmp_path, lmctl).text
    assert "The journal of run-0001 was damaged or altered at line 2" in text
    assert "BROKEN at line 2" in text


@pytest.mark.parametrize("change", ["other", "missing", "damaged"])
def test_without_its_job_nothing_is_claimed_that_only_the_job_shows(tmp_path, lmctl, change):
    job = tmp_path / "runs/run-0001/job.lmj"
    match change:
        case "other":
            (tmp_path / "part.toml").write_text(
                (tmp_path / "part.toml").read_text().replace("k = 1.5", "k = 1.4"))
            assert lmctl("plan", "part.toml", "-o", job).code == 0
        case "missing":
            job.unlink()
        case "damaged":
            job.write_bytes(job.read_bytes()[:-300])
    found = page(tmp_path, lmctl)
    assert "The job file beside the journal is not used" in found.text
    assert found.references == []
    assert "Summary layers complete 2 of 2" in found.text
    assert "predicted within" not in found.text


def test_what_was_built_joins_the_report(tmp_path, lmctl, refused):
    found = page(tmp_path, lmctl, "--as-built", "--layer", "1", "--set", "serial=SN-9")
    assert f"{BUILT_BY['predicted'].capitalize()}." in found.text
    assert "composition error mean RMS" in found.text
    assert "serial number SN-9" in found.text
    assert len(found.references) == 1
    assert "neither --csv nor --json" in refused(
        "report", "run-0001", "--as-built", "--json", "-o", "a.html", code=2)


def test_layers_and_history_as_csv(tmp_path, lmctl):
    layers = list(csv.DictReader(io.StringIO(lmctl("report", "run-0002", "--csv").data)))
    assert [row["layer"] for row in layers] == ["1", "2"]
    for row in layers:
        assert None not in row
        assert None not in row.values()
        shares = [float(row[f"inferred_{name}_fraction_mean"]) for name in ("316L", "WC-12Co")]
        assert sum(shares) == pytest.approx(1.0, abs=1e-3)
        assert float(row["designed_316L_fraction"]) == pytest.approx(
            float(row["inferred_316L_fraction_mean"]), abs=0.02)
        assert float(row["reported_carrier_A_L_min_mean"]) > 1.0
        assert float(row["reported_speed_mm_s_most"]) <= float(row["planned_speed_mm_s_most"]) + .1
    (tmp_path / "runs/run-0003").mkdir()
    (tmp_path / "runs/run-0003/journal.jsonl").write_text("none\n")
    assert lmctl("report", "--csv", "-o", "history.csv").code == 0
    runs = list(csv.DictReader(io.StringIO((tmp_path / "history.csv").read_text())))
    assert [(row["run"], row["state"], row["journal"]) for row in runs] == [
        ("run-0001", "faulted", "sealed"), ("run-0002", "done", "sealed"),
        ("run-0003", "no journal", "cannot be read")]
    assert runs[1]["continues"] == "run-0001"
    assert int(runs[0]["open_deviations"]) <= int(runs[0]["deviations"])


@pytest.mark.parametrize(("arguments", "told"), [
    ([], "of which run"),
    (["run-0001", "-o", "report.docx"], ".html or .pdf"),
    (["run-0001", "-o", "nowhere/report.html"], "there is no folder nowhere"),
    (["run-0001", "--set", "colour=red", "--set", "serial"], "there is no key 'colour'"),
    (["--csv", "--run-only"], "belong to a run"),
    (["--csv", "--runs", "elsewhere"], "elsewhere holds no run"),
    (["run-0009"], "there is no run 'run-0009'"),
])
def test_what_cannot_be_meant_is_refused(refused, arguments, told):
    assert told in refused("report", *arguments, code=2)


def test_without_reportlab_a_pdf_is_refused_with_what_to_install(refused, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "reportlab.platypus", None)
    for name in ("report_pdf", "pdf_table"):
        monkeypatch.delitem(__import__("sys").modules, f"lmctl.report.job_report.{name}",
                            raising=False)
    assert "lmctl[pdf]" in refused("report", "run-0001", "-o", "a.pdf", code=2)
