"""Which runs make a part, by what their headers say, also where one was altered."""

from __future__ import annotations

import pytest

from lmctl.report.part_record import part_record_of
from lmctl.run.journal.writer import JournalWriter


def runs(folder, **continues):
    """Journals of a header each; continues : {run: the run it goes on with}"""
    for run, before in continues.items():
        path = folder / run.replace("_", "-") / "journal.jsonl"
        path.parent.mkdir(parents=True)
        header = {"continues": before.replace("_", "-")} if before else {}
        with JournalWriter(path, header, local={"run": path.parent.name}) as journal:
            journal.seal(1.0, state="stopped")


def names(folder, run, **options):
    return [one.run for one in part_record_of(folder / run / "journal.jsonl", **options).runs]


def test_every_run_of_a_part_has_the_same_record(tmp_path):
    runs(tmp_path, run_0001="", run_0002="", run_0003="run_0001", run_0004="run_0003")
    (tmp_path / "run-0005").mkdir()  # it died before it had a journal
    (tmp_path / "run-0006").mkdir()
    (tmp_path / "run-0006/journal.jsonl").write_text("no journal\n")
    for run in ("run-0001", "run-0003", "run-0004"):
        assert names(tmp_path, run) == ["run-0001", "run-0003", "run-0004"]
        assert names(tmp_path, run, run_only=True) == [run]
    assert names(tmp_path, "run-0002") == ["run-0002"]


@pytest.mark.parametrize("before", ["run_0001", "run_0002", "run_0009"])
def test_a_run_that_says_it_goes_on_with_itself_or_a_later_one_is_read_all_the_same(
    tmp_path, before
):
    runs(tmp_path, run_0001=before, run_0002="run_0001")
    for run in ("run-0001", "run-0002"):
        assert names(tmp_path, run) == ["run-0001", "run-0002"]
