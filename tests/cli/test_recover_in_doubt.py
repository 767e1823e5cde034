"""A motion link cut in the path: the controller runs its lines to their end with the beam on, and
nobody sees it. `recover` never guesses how much of that is on the part."""

from __future__ import annotations

import re
import shutil
from importlib.resources import files

import pytest

from lmctl.cli.__main__ import main
from lmctl.config.machine import load_profile
from tests.run.conftest import squares, write_job

EXAMPLES = files("lmctl.examples")


@pytest.fixture(scope="module")
def cut(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cut")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        write_job(folder / "part.lmj", load_profile(EXAMPLES / "cell.toml"), squares())
        (folder / "faults.toml").write_text(
            '[[fault]]\nkind = "link_closed"\ndevice = "motion"\nat_line = 40\nfor_s = 5\n')
        assert main(["run", "part.lmj", "--sim", "--faults", "faults.toml"]) == 5
    return folder


@pytest.fixture(autouse=True)
def copied(cut, tmp_path):
    shutil.copytree(cut, tmp_path, dirs_exist_ok=True)


def test_its_journal_says_unknown_and_from_where_to_where(lmctl):
    records = lmctl("log", "run-0001", "--json").json["records"]
    (place,) = [record for record in records if record["kind"] == "place"]
    assert place["known"] == "unknown"
    assert (place["line"], place["share"]) < tuple(place["until"])
    assert "standstill_mm" not in place
    assert 0.0 < place["t"] - place["reported_at"] < 0.25


def test_no_one_being_asked_it_is_refused_with_the_choices(refused):
    talk = refused("recover", "run-0001", "--sim", "--yes", "--position-restored", code=2)
    assert "mm of bead may be on the part or not" in talk
    assert re.search(r"path \d+ of layer \d+: [0-9.]+ mm, from X[0-9.]+ Y[0-9.]+ Z[0-9.]+ "
                     r"\(line \d+\) to X", talk)
    assert "--deposited MM" in talk


@pytest.mark.parametrize(("answer", "refusal"), [
    ("-1", "no length"), ("much", "no length"), ("99", "more than the"), ("nan", "no length"),
])
def test_an_answer_that_is_no_length_of_it_is_refused(refused, answer, refusal):
    talk = refused("recover", "run-0001", "--sim", "--yes", "--position-restored",
                   f"--deposited={answer}", code=2)
    assert refusal in talk


@pytest.mark.parametrize("deposited", ["0", "2.5", "all"])
def test_it_goes_on_from_where_the_operator_says(lmctl, deposited):
    recovered = lmctl("recover", "run-0001", "--sim", "--yes", "--position-restored",
                      "--deposited", deposited)
    assert recovered.code == 0, recovered.talk
    header = lmctl("log", "run-0002", "--json").json["records"][0]
    assert header["begins_at"]["known"] == "stated"
    begins_at = (header["begins_at"]["line"], header["begins_at"]["share"])
    records = lmctl("log", "run-0001", "--json").json["records"]
    (place,) = [record for record in records if record["kind"] == "place"]
    least, most = (place["line"], place["share"]), tuple(place["until"])
    assert least <= begins_at <= most
    assert (begins_at == pytest.approx(least)) == (deposited == "0")
    assert (begins_at == most) == (deposited == "all")


def test_it_is_asked_in_words(lmctl, monkeypatch):
    answers = iter(["2,5"])
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("click.prompt", lambda text, err: next(answers))
    monkeypatch.setattr("click.confirm", lambda text, err: True)
    recovered = lmctl("recover", "run-0001", "--sim", "--position-restored")
    assert recovered.code == 0, recovered.talk
    assert "look at the part" in recovered.talk
