"""One machine, one owner: whoever comes second is told who has it."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from importlib.resources import files

import pytest

from lmctl.config.machine import load_profile
from lmctl.errors import MachineError
from lmctl.run.cell.ownership import lock_machine, owner_of


@pytest.fixture(autouse=True)
def own_locks(tmp_path, monkeypatch):
    monkeypatch.setattr("lmctl.run.cell.ownership.FOLDERS", (tmp_path,))
    return tmp_path / "lmctl-locks"


@pytest.fixture
def profile():
    return load_profile(files("lmctl.examples") / "cell.toml")


def rewired(profile, motion, feeders):
    return profile.model_copy(update={
        "motion": profile.motion.model_copy(update={"endpoint": motion}),
        "feeder": tuple(
            feeder.model_copy(update={"endpoint": endpoint})
            for feeder, endpoint in zip(profile.feeder, feeders, strict=True)
        ),
    })


FEEDERS = ("modbus-tcp://10.0.0.1:502", "modbus-tcp://10.0.0.2")


def test_the_hint_to_the_other_run_can_be_copied_into_a_shell(profile, tmp_path, own_locks):
    with (
        lock_machine(profile, "run-0007", tmp_path / "runs of; mine"),
        pytest.raises(MachineError) as refused, lock_machine(profile, "run-0008", tmp_path),
    ):
        pass
    typed = shlex.split(refused.value.hint.split("`")[1])
    assert typed == ["lmctl", "status", "run-0007", "--runs", str(tmp_path / "runs of; mine")]


def test_a_second_run_is_refused_with_the_run_that_has_the_machine(profile, tmp_path, own_locks):
    with lock_machine(profile, "run-0007", tmp_path / "runs"):
        with pytest.raises(MachineError) as refused, lock_machine(profile, "run-0008", tmp_path):
            pass
        text = refused.value.render()
        assert "run-0007 has the machine" in text
        assert str(os.getpid()) in text
        assert f"lmctl status run-0007 --runs {tmp_path / 'runs'}" in text
        owner = owner_of(profile)
        assert owner is not None
        assert owner.activity == "run-0007"
    assert owner_of(profile) is None
    assert list(own_locks.iterdir()) == []
    with lock_machine(profile, "run-0008", tmp_path):
        pass


def test_the_folder_for_large_files_has_no_say_in_who_owns_a_machine(
    profile, tmp_path, monkeypatch
):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    with lock_machine(profile, "run-0007", tmp_path):
        monkeypatch.setenv("TMPDIR", str(elsewhere))
        monkeypatch.setattr("tempfile.tempdir", None)
        with pytest.raises(MachineError, match="run-0007"), lock_machine(profile, "run-0008",
                                                                         tmp_path):
            pass
    assert list(elsewhere.iterdir()) == []


def test_locks_are_where_everybody_may_write_whoever_asks(profile, tmp_path, monkeypatch):
    kept, open_to_all = tmp_path / "kept", tmp_path / "open"
    kept.mkdir(0o755)
    open_to_all.mkdir()
    open_to_all.chmod(0o1777)
    monkeypatch.setattr("lmctl.run.cell.ownership.FOLDERS",
                        (tmp_path / "none", kept, open_to_all, tmp_path))
    with lock_machine(profile, "run-0001", tmp_path):
        assert list((open_to_all / "lmctl-locks").iterdir())
    assert list(kept.iterdir()) == []


def test_one_shared_wire_is_enough(profile, tmp_path):
    mine = rewired(profile, "tcp://10.0.0.9:23", FEEDERS)
    other = rewired(profile, "tcp://10.0.0.8:23", ("modbus-tcp://10.0.0.3", FEEDERS[1] + ":502"))
    with lock_machine(mine, "run-0001", tmp_path), pytest.raises(MachineError, match="run-0001"), \
            lock_machine(other, "run-0002", tmp_path):
        pass
    with lock_machine(other, "run-0002", tmp_path):  # what it did get, it gave back
        pass


def test_cells_that_share_no_wire_may_run_at_once(profile, tmp_path):
    other = rewired(profile, "tcp://10.0.0.8:23", FEEDERS)
    with lock_machine(profile, "run-0001", tmp_path), lock_machine(other, "run-0002", tmp_path):
        pass


def test_one_port_by_two_names_is_one_port(profile, tmp_path):
    (tmp_path / "ttyUSB0").touch()
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyUSB0")
    one = rewired(profile, f"serial://{tmp_path}/ttyUSB0", FEEDERS)
    two = rewired(profile, f"serial://{tmp_path}/by-id",
                  ("modbus-tcp://10.0.0.6", "modbus-tcp://10.0.0.7"))
    with lock_machine(one, "run-0001", tmp_path), pytest.raises(MachineError, match="run-0001"), \
            lock_machine(two, "run-0002", tmp_path):
        pass


def test_a_killed_owner_leaves_nothing_that_keeps_others_out(profile, tmp_path):
    program = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from lmctl.config.machine import load_profile\n"
        "from lmctl.run.cell import ownership\n"
        "from lmctl.run.cell.ownership import lock_machine\n"
        "ownership.FOLDERS = (Path(sys.argv[1]),)\n"
        "with lock_machine(load_profile(Path(sys.argv[2])), 'run-0001', Path('.')):\n"
        "    print('mine', flush=True); os.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path), str(files("lmctl.examples") / "cell.toml")],
        capture_output=True, text=True,
    )
    assert done.stdout == "mine\n", done.stderr
    assert list((tmp_path / "lmctl-locks").iterdir())
    assert owner_of(profile) is None
    with lock_machine(profile, "run-0002", tmp_path):
        pass


def test_a_lock_file_with_nonsense_in_it_is_still_a_lock(profile, tmp_path, own_locks):
    with lock_machine(profile, "run-0001", tmp_path):
        for path in own_locks.iterdir():
            path.write_bytes(b"\xff[")
        with (
            pytest.raises(MachineError, match="another process has the machine"),
            lock_machine(profile, "run-0002", tmp_path),
        ):
            pass
