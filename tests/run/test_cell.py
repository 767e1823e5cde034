"""Connecting to a cell of which nothing is there: one report, nothing left open, nothing begun."""

from __future__ import annotations

import gc
import socket
import warnings
from importlib.resources import files

import pytest

from lmctl.config.machine import load_profile
from lmctl.errors import JobError, LmctlError, MachineError
from lmctl.run.executor import run_job
from lmctl.run.journal.format import read_records, verify_journal
from lmctl.run.journal.run_folders import list_runs
from simulators import virtual_time


@pytest.fixture
def absent():
    """The example cell, its endpoints being ports on which nothing listens."""
    profile = load_profile(files("lmctl.examples") / "cell.toml")
    sockets = [socket.socket() for _ in range(3)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    motion = profile.motion.model_copy(update={"endpoint": f"tcp://127.0.0.1:{ports[0]}"})
    feeders = tuple(
        feeder.model_copy(update={"endpoint": f"modbus-tcp://127.0.0.1:{port}"})
        for feeder, port in zip(profile.feeder, ports[1:], strict=True)
    )
    return profile.model_copy(update={"motion": motion, "feeder": feeders})


def test_all_that_is_absent_is_reported_in_one_report(tmp_path, absent, job_file):
    job_file(tmp_path / "job.lmj", absent)
    with pytest.raises(MachineError) as error:
        virtual_time.run_in_virtual_time(run_job(tmp_path / "job.lmj", absent, tmp_path / "runs"))
    text = error.value.render()
    assert "3 devices of the cell failed" in text
    assert absent.motion.endpoint in text
    assert "F1" in text
    assert "F2" in text
    assert "run-0001" in text
    assert error.value.exit_code == 4
    assert len(text.splitlines()) < 12


def test_a_run_that_could_not_begin_leaves_a_sealed_journal(tmp_path, absent, job_file):
    job_file(tmp_path / "job.lmj", absent)
    with pytest.raises(MachineError):
        virtual_time.run_in_virtual_time(run_job(tmp_path / "job.lmj", absent, tmp_path / "runs"))
    (run,) = list_runs(tmp_path / "runs")
    assert run.state == "faulted"
    journal = tmp_path / "runs" / run.run / "journal.jsonl"
    assert verify_journal(journal).sealed
    kinds = [record["kind"] for record in read_records(journal)]
    assert kinds[0] == "header"
    assert "fault" in kinds
    assert "path" not in kinds
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gc.collect()  # a link left open would warn


def test_a_job_for_another_machine_is_refused_before_a_run_is_made(tmp_path, absent, job_file):
    job_file(tmp_path / "job.lmj", absent)
    other = absent.model_copy(update={"name": "other cell"})
    with pytest.raises(JobError, match="planned for 'bench cell'"):
        virtual_time.run_in_virtual_time(run_job(tmp_path / "job.lmj", other, tmp_path / "runs"))
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("content", [None, b"", b"PK\x03\x04 garbage", b"not a job"])
def test_what_is_no_job_is_refused_before_a_run_is_made(tmp_path, absent, content):
    if content is not None:
        (tmp_path / "job.lmj").write_bytes(content)
    with pytest.raises(LmctlError):
        virtual_time.run_in_virtual_time(run_job(tmp_path / "job.lmj", absent, tmp_path / "runs"))
    assert not (tmp_path / "runs").exists()
