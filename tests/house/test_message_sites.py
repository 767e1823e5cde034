"""Which texts of the code count as messages, and which do not."""

from __future__ import annotations

from pathlib import Path

from tests.house.message_sites import MessageSites

MODULE = '''
HINT = "a constant that is said"

def unreadable(file, why):
    return InputError(f"{file} cannot be read: {why}", hint="export it again")

def reason(kind):
    return "of a kind that is not known" if kind else f"it has {kind} corners"

def read(file, kind, table, listed):
    wrong = []
    wrong.append("a mistake in a list")
    wrong += [f"{name} is there twice" for name in listed]
    if wrong:
        raise UsageError("mistakes were made", where=wrong)
    what, hint = "a text that came apart", "what to do next"
    if kind == 1:
        raise PlanError(what, hint=hint)
    if kind == 2:
        raise unreadable(file, "its head is missing")
    if kind == 3:
        raise unreadable(file, reason(kind))
    if kind == 4:
        raise JobError("layers {} to {} only".format(1, 2))
    if kind == 5:
        raise JobError(HINT)
    table.report_mistake("key", "must be one of two")
    note = "a text that nobody is told"
    raise RuntimeError("a mistake of our own")

class TripError(MachineError):
    def __init__(self, name, what):
        super().__init__(what)

def trip():
    raise TripError("door open", "the door was opened")
'''


def test_texts_are_followed_from_where_they_are_said_to_where_they_are_written(
    tmp_path: Path,
) -> None:
    (tmp_path / "lmctl").mkdir()
    (tmp_path / "lmctl/reading.py").write_text(MODULE)
    found = {site.pattern.replace("\\ ", " ") for site in MessageSites(tmp_path).all()}
    assert found == {
        ".* cannot be read: .*", "its head is missing", "of a kind that is not known",
        "it has .* corners", "a mistake in a list", ".* is there twice", "mistakes were made",
        "a text that came apart", "layers .* to .* only", "a constant that is said",
        "must be one of two", "the door was opened",
    }
