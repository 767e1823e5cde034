"""What is said of a run that went wrong begins with the cause, wherever it is said."""

from __future__ import annotations

import pytest

from lmctl.report.job_log_text import part_record_as_text
from lmctl.report.part_record import part_record_of
from lmctl.run.journal.format import read_records
from simulators.faults.fault_injector import FaultInjector
from simulators.faults.kinds import Fault


def injects(kind: str, **values):
    """An act: a fault becomes real, and stands."""

    def act(one) -> None:
        one.board = FaultInjector(one.bench)
        one.board.inject(Fault.create(kind, **values))

    return act


CAUSES = [
    ("link_closed", {}, "the motion controller is lost: the link"),
    ("ok_lost", {}, "the motion controller is lost: an answer is missing"),
    # whichever comes first: three reports of the controller's buffer, or an answer too many
    ("ok_doubled", {}, ("the motion controller is lost: an answer came twice",
                        "the motion controller is lost: a reply came to no command")),
    ("controller_reboots", {}, "the motion controller restarted in the middle of the run"),
    ("controller_silent", {}, "the motion controller has not reported for 0.6 s"),
    ("hard_limit", {}, "the motion controller is in alarm: a hard limit was hit"),
]


@pytest.mark.parametrize(("kind", "values", "cause"), CAUSES, ids=[kind for kind, _, _ in CAUSES])
def test_the_cause_is_the_headline_everywhere(run, large_square_job, kind, values, cause):
    notify, seen = [], []

    def look(one) -> None:
        one.executor._notice = notify.append
        one.executor._live.sequence.alarms.notify = notify.append

    one = run(large_square_job, acts=[
        (1.0, look), (3.0, injects(kind, **values)),
        (5.5, lambda one: seen.append(one.executor.snapshot()["alarms"])),
    ])
    # on the terminal, as it ends and as it comes
    assert one.error.what.startswith(cause)
    shown = [line for line in notify if line.startswith(("alarm: ", "the cause: "))]
    assert shown[-1].partition(": ")[2].startswith(cause)
    # in `status`
    if seen and seen[-1]:
        assert seen[-1][0]["what"].startswith(cause)
    # in the journal
    seal = list(read_records(one.journal))[-1]
    assert seal["cause"]["what"].startswith(cause)
    assert not any(text.startswith(cause) for text in seal["followed"])
    # in the log
    text = part_record_as_text(part_record_of(one.journal))
    rows = [line.split(maxsplit=1) for line in text.splitlines()]
    assert next(row[1] for row in rows if row[:1] == ["cause"]).startswith(
        tuple(text[:40] for text in ((cause,) if isinstance(cause, str) else cause)))


def test_what_follows_is_listed_under_the_cause(run, large_square_job):
    one = run(large_square_job, acts=[(3.0, injects("controller_reboots"))])
    assert "then: the motion controller has not reported for 0.6 s" in one.error.where
    faults = [r for r in read_records(one.journal) if r["kind"] == "fault"]
    restarted = next(r for r in faults if "restarted" in r["what"])
    assert "follows" not in restarted
    later = faults[faults.index(restarted) + 1:]
    assert all(r["follows"] == restarted["what"] for r in later)
