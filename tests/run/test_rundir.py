"""Run folders: the next free one, found by name, listed without reading whole journals."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from lmctl.errors import JobError, JournalError, MissingFileError
from lmctl.run.journal import run_folders
from lmctl.run.journal.format import FORMAT_VERSION
from lmctl.run.journal.writer import JournalWriter


@pytest.fixture
def job_file(tmp_path):
    path = tmp_path / "part.lmj"
    path.write_bytes(b"a job")
    return path


def test_runs_are_numbered_on_and_hold_their_job(tmp_path, job_file):
    runs = tmp_path / "deep" / "runs"
    assert [run_folders.create_run_folder(runs, job_file).run for _ in range(3)] == [
        "run-0001", "run-0002", "run-0003"
    ]
    run_folders.find_run_folder(runs, "run-0002").job.unlink()
    (runs / "run-0002").rmdir()
    # a number is never given twice
    assert run_folders.create_run_folder(runs, job_file).run == "run-0004"
    job_file.unlink()
    assert run_folders.find_run_folder(runs, "run-0001").job.read_bytes() == b"a job"


def test_the_job_and_its_folder_outlive_the_power(tmp_path, job_file, monkeypatch):
    synced = []
    monkeypatch.setattr("os.fsync", lambda fd: synced.append(os.fstat(fd).st_ino))
    made = run_folders.create_run_folder(tmp_path / "runs", job_file)
    assert {made.job.stat().st_ino, (tmp_path / "runs").stat().st_ino} <= set(synced)


def test_processes_at_once_get_folders_of_their_own(tmp_path, job_file):
    code = (
        "import sys; from pathlib import Path; from lmctl.run.journal import run_folders\n"
        "for _ in range(20):\n"
        " print(run_folders.create_run_folder(Path(sys.argv[1]), Path(sys.argv[2])).run)"
    )
    children = [
        subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "runs"), str(job_file)],
                         stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    names = [name for child in children for name in child.communicate()[0].split()]
    assert all(child.returncode == 0 for child in children)
    assert sorted(names) == [f"run-{k:04d}" for k in range(1, 61)]


@pytest.mark.parametrize("folder", ["runs", "my runs", "a;b/'runs'", "$HOME"])
def test_a_hint_to_a_run_can_be_copied_into_a_shell(folder):
    text = run_folders.RunFolder(Path(folder) / "run-0007").command("log")
    typed = subprocess.run(["sh", "-c", f"printf '%s\\n' {text}"], capture_output=True, text=True)
    where = [] if folder == "runs" else ["--runs", folder]
    assert typed.stdout.splitlines() == ["lmctl", "log", "run-0007", *where]


def test_a_missing_job_leaves_nothing_behind(tmp_path):
    with pytest.raises(JobError, match="cannot copy the job"):
        run_folders.create_run_folder(tmp_path / "runs", tmp_path / "none.lmj")
    assert list((tmp_path / "runs").iterdir()) == []


@pytest.mark.parametrize("name", ["run-0009", "../run-0001", "run-0001/..", "", "run-1", "."])
def test_only_a_run_s_own_name_finds_it(tmp_path, job_file, name):
    run_folders.create_run_folder(tmp_path / "runs", job_file)
    with pytest.raises(MissingFileError, match="there is no run") as error:
        run_folders.find_run_folder(tmp_path / "runs", name)
    assert error.value.where == ("the last one is run-0001",)


def test_the_list_distinguishes_running_done_and_broken_off(tmp_path, job_file):
    runs = tmp_path / "runs"
    assert run_folders.list_runs(runs) == []
    made = [run_folders.create_run_folder(runs, job_file) for _ in range(4)]
    header = {"part": "gear", "operator": "Ada"}
    local = {"wall": "2026-01-01T00:00:00Z"}
    with JournalWriter(made[0].journal, header, local=local) as journal:
        journal.seal(12.5, state="done", lines=42)
    with JournalWriter(made[1].journal, header, local=local) as journal:
        journal.append(1.0, "sample")
    with JournalWriter(made[2].journal, header, local=local):
        rows = run_folders.list_runs(runs)
    assert [row.state for row in rows] == ["done", "broken off", "running", "no journal"]
    assert (rows[0].part, rows[0].operator, rows[0].lines, rows[0].machine_s) == (
        "gear", "Ada", 42, 12.5
    )
    assert rows[0].started == "2026-01-01T00:00:00Z"
    assert rows[1].lines is None


def test_garbage_in_the_folder_is_passed_over(tmp_path, job_file):
    runs = tmp_path / "runs"
    run_folders.create_run_folder(runs, job_file).journal.write_bytes(b"\x00garbage\nmore")
    (runs / "notes.txt").touch()
    assert [row.state for row in run_folders.list_runs(runs)] == ["no journal"]


def test_a_run_whose_journal_is_of_another_format_is_listed_as_such(tmp_path, job_file):
    runs = tmp_path / "runs"
    later = FORMAT_VERSION + 1
    folder = run_folders.create_run_folder(runs, job_file)
    folder.journal.write_text(f'{{"format":"lmctl-journal-{later}"}}\n')
    assert [row.state for row in run_folders.list_runs(runs)] == [f"format {later}"]


def test_a_file_in_the_folders_place_is_reported(tmp_path, job_file):
    (tmp_path / "runs").touch()
    with pytest.raises(JournalError, match=r"cannot make|is not a folder"):
        run_folders.create_run_folder(tmp_path / "runs", job_file)
    with pytest.raises(JournalError, match="is not a folder"):
        run_folders.list_runs(tmp_path / "runs")
