"""A run that broke off: what `log` makes of a damaged journal, what `recover` says and asks."""

from __future__ import annotations

import json
import shlex
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from lmctl.cli import recover
from lmctl.cli.__main__ import main
from lmctl.config.machine import load_profile
from lmctl.errors import MachineError
from lmctl.run.journal.format import read_records
from lmctl.run.journal.writer import JournalWriter
from tests.error_facts import assert_states
from tests.run.conftest import squares, write_job

FAULTS = '[[fault]]\nkind = "hard_limit"\nat_line = 40\n'


@pytest.fixture(scope="module")
def tripped(tmp_path_factory):
    """The folder of a run that met a limit switch in its first layer's squares."""
    folder = tmp_path_factory.mktemp("tripped")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["init", "gear", "."]) == 0
        write_job(folder / "part.lmj", load_profile(folder / "cell.toml"), squares())
        (folder / "faults.toml").write_text(FAULTS)
        assert main(["run", "part.lmj", "--sim", "--faults", "faults.toml"]) == 5
    return folder


@pytest.fixture
def journal(tripped, tmp_path):
    """The journal of that run, in a folder of the test's own."""
    shutil.copytree(tripped, tmp_path, dirs_exist_ok=True)
    return tmp_path / "runs/run-0001/journal.jsonl"


@pytest.mark.parametrize("line", [
    '{"x": 1}', '{"t": "soon", "kind": "state"}', '{"t": 1, "kind": "layer", "lines": 3}',
    '{"t": 1, "kind": "header", "format": "lmctl-journal-2", "hoppers": 3}',
    '{"t": 1, "kind": "seal", "local": 7}',
])
def test_a_journal_added_to_by_hand_is_refused_in_words(journal, refused, lmctl, line):
    sealed = journal.read_text()
    journal.write_text(f"{sealed}{line}\n")
    for form in ([], ["--csv"]):
        outcome = lmctl("log", "run-0001", *form)
        assert "there is a line after the seal" in outcome.talk
        assert "Traceback" not in outcome.talk
    assert "no log can be printed of it" in refused("log", "run-0001", code=1)
    records = lmctl("log", "run-0001", "--json").json["records"]
    assert records[-1] == json.loads(line)


def test_figures_of_an_altered_journal_do_not_come_without_a_warning(journal, lmctl):
    assert lmctl("log", "run-0001", "--csv").talk == ""
    journal.write_text(journal.read_text().replace('"operator":""', '"operator":"Eve"', 1))
    for form in ("--csv", "--json"):
        outcome = lmctl("log", "run-0001", form)
        assert outcome.code == 0
        assert "warning: the journal is broken at line 2" in outcome.talk


def test_hints_can_be_typed_where_folders_have_spaces(lmctl, tmp_path):
    def typed(text, do):
        (line,) = [line for line in text.splitlines() if line.startswith("hint:") and do in line]
        words = shlex.split(line.split("`")[1] if "`" in line else line.removeprefix("hint: "))
        assert words[0] == "lmctl"
        return words[1:]

    plan = typed(lmctl("init", "gear", "a cell").data, "plan")
    assert [Path(word).is_file() for word in plan[1::2]] == [True, True]
    write_job(tmp_path / "part.lmj", load_profile(tmp_path / "a cell/cell.toml"), squares())
    log = typed(lmctl("run", "part.lmj", "--sim", "--runs", "my runs").data, "log")
    assert lmctl(*log).code == 0
    status = lmctl("status", "run-0001", "--runs", "my runs").data
    assert typed(status, "log") == log
    jobs = typed(lmctl("log", "run-0009", "--runs", "my runs").talk, "jobs")
    assert "run-0001" in lmctl(*jobs).data


def test_no_one_recovers_without_being_asked(journal, refused, monkeypatch):
    monkeypatch.setattr("sys.stdin.isatty", lambda: False)
    talk = refused("recover", "run-0001", "--sim", "--position-restored", code=2)
    assert "there is no terminal to ask at" in talk


def test_a_controller_without_homing_that_was_switched_off_and_on_is_never_believed(
    journal, lmctl, refused
):
    """A fresh bench stands at its zero, as a controller does that was switched off and on."""
    talk = refused("recover", "run-0001", "--sim", "--yes", code=4)
    assert "the controller has lost its place" in talk
    assert "it says 0, 0, 0" in talk
    assert "lmctl machine offset --here" in talk
    assert "--position-restored" in talk
    assert not (journal.parent.parent / "run-0002").exists()


def test_after_its_position_was_restored_the_part_goes_on(journal, lmctl):
    damaged = journal.parent.parent / "run-0002" / "journal.jsonl"
    damaged.parent.mkdir()
    damaged.write_bytes(b"\0\n")
    recovered = lmctl("recover", "run-0001", "--sim", "--yes", "--position-restored")
    assert "the journal of run-0002 cannot be read: do not go on if" in recovered.talk
    assert "found in state Idle, at X0.000 Y0.000 Z0.000" in recovered.talk
    # A limit switch: it came to rest, and may have lost steps.
    assert ": inferred from what was sent" in recovered.talk
    assert recovered.code == 0, recovered.talk


def test_bead_that_is_in_no_doubt_is_not_stated(journal, refused):
    talk = refused("recover", "run-0001", "--sim", "--yes", "--position-restored",
                   "--deposited", "3", code=2)
    assert "no bead is in doubt" in talk


def test_who_says_no_has_recovered_nothing(journal, refused, monkeypatch):
    monkeypatch.setattr(recover, "ask_confirmation", lambda *_: False)
    talk = refused("recover", "run-0001", "--sim", "--position-restored", code=2)
    assert "not recovered: nothing has been sent that moves the machine" in talk
    assert "the same command asks again" in talk


def test_a_run_that_its_job_has_ended_is_not_recovered(journal, refused):
    """To go on with such a job would fail in the same way again."""
    first, *records = read_records(journal)
    *records, seal = records
    journal.unlink()
    own = {"seq", "prev", "t", "kind"}

    def fields(record, **changes):
        return {key: value for key, value in record.items() if key not in own} | changes

    header = {key: value for key, value in fields(first).items() if key not in ("format", "local")}
    with JournalWriter(journal, header, local=first["local"]) as made:
        for record in records:
            made.append(record["t"], record["kind"], **fields(record))
        made.seal(seal["t"], **{key: value for key, value in fields(
            seal, recoverable=False).items() if key != "records"})
    talk = refused("recover", "run-0001", "--sim", "--yes", code=1)
    assert "ended because of its job, which would go wrong again" in talk
    assert "plan the part again" in talk


def test_a_part_of_which_only_the_way_back_is_missing(tripped, lmctl, refused, tmp_path):
    """The limit switch was met behind the last bead: nothing of the part is missing."""
    shutil.copytree(tripped, tmp_path, dirs_exist_ok=True)
    lines = sum(map(len, squares()))
    (tmp_path / "faults.toml").write_text(FAULTS.replace("40", str(lines - 2)))
    assert lmctl("run", "part.lmj", "--sim", "--faults", "faults.toml").code == 5
    talk = refused("recover", "run-0002", "--sim", "--yes", "--position-restored", code=1)
    assert "has deposited every bead of its job: nothing is left" in talk


@pytest.mark.parametrize(
    ("status", "facts"),
    [
        (None, ("does not say where it is", "lmctl machine doctor")),
        (SimpleNamespace(state="Alarm"),
         ("is in alarm, and has no homing cycle ($22=0)", "lmctl machine unlock")),
    ],
)
def test_a_controller_that_cannot_be_gone_on_with(status, facts):
    motion = SimpleNamespace(status=status)
    with pytest.raises(MachineError) as refused:
        recover._refuse_lost(SimpleNamespace(), motion, SimpleNamespace(lost=""), restored=False)
    assert_states(refused.value, *facts)
