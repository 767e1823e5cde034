"""Alarms, interruptions and causes, as the records of a journal tell of them."""

from __future__ import annotations

import pytest

from lmctl.report.part_record import part_record_of
from lmctl.run.journal.writer import JournalWriter


def wall(t):
    return f"2026-01-01T00:{int(t) // 60:02d}:{t % 60:06.3f}Z"


class Written:
    """A journal written record by record."""

    def __init__(self, folder, run, offset_s=0.0, **header):
        self.path = folder / run / "journal.jsonl"
        self.path.parent.mkdir(parents=True)
        self.journal = JournalWriter(self.path, header, local={"run": run, "wall": wall(offset_s)})
        self.journal.__enter__()
        self.offset_s = offset_s

    def record(self, t, kind, **fields):
        self.journal.append(t, kind, **fields, local={"wall": wall(t + self.offset_s)})

    def state(self, t, before, after, event="achieved"):
        self.record(t, "state", event=event, **{"from": before, "to": after})

    def alarm(self, t, name, **fields):
        self.record(t, "alarm", name=name, what=f"{name} is wrong", hint="look", **fields)

    def end(self, t, state="done"):
        self.journal.seal(t, state=state, local={"wall": wall(t + self.offset_s)})
        self.die()

    def die(self):
        self.journal.__exit__(None, None, None)


def test_a_hold_is_an_interruption_from_the_act_to_the_next_bead(tmp_path):
    run = Written(tmp_path, "run-0001")
    run.state(1, "armed", "depositing")
    run.record(10, "operator", act="hold", operator="Ada", accepted=True)
    run.state(10, "depositing", "holding", "hold")
    run.record(11, "place", line=7, share=0.25, known="reported")
    run.state(11, "holding", "held")
    run.state(40, "held", "purging", "resume")
    run.record(42, "entry", line=7, share=0.25, beam_on_line=6, layer=0, repeated_mm=0.2)
    run.state(50, "resuming", "depositing")
    run.state(90, "depositing", "finishing", "program done")
    run.end(100)
    part = part_record_of(run.path)
    (one,) = part.interruptions
    assert (one.cause, one.line, one.share, one.known) == ("operator Ada: hold", 7, 0.25,
                                                           "reported")
    assert (one.duration_s, one.entry_line, one.repeated_mm) == (40.0, 6, 0.2)
    (deviation,) = part.deviations
    assert (deviation.cause, deviation.duration_s) == ("operator Ada: hold", 40.0)


@pytest.mark.parametrize("sealed", [True, False])
def test_what_ended_a_run_ends_where_the_next_run_goes_on(tmp_path, sealed):
    run = Written(tmp_path, "run-0001")
    run.state(1, "armed", "depositing")
    if sealed:
        run.alarm(20, "disc")
        run.state(20, "depositing", "tripped", "fault")
        run.record(21, "place", line=3, share=0.5, known="inferred")
        run.end(30, "faulted")
    else:
        run.record(20, "override", feed_percent=90, power_percent=100, source="operator")
        run.die()
    more = Written(tmp_path, "run-0002", offset_s=600.0, continues="run-0001")
    more.record(0, "entry", line=3, share=0.5, beam_on_line=3, layer=0, repeated_mm=0.1)
    more.state(5, "armed", "depositing")
    more.state(9, "depositing", "finishing", "program done")
    more.end(12)
    (one,) = part_record_of(run.path).interruptions
    assert (one.run, one.resumed_in, one.entry_line) == ("run-0001", "run-0002", 3)
    assert one.duration_s == pytest.approx(585.0)
    assert ("disc is wrong" if sealed else "the journal ends") in one.cause
    (alone,) = part_record_of(run.path, run_only=True).interruptions
    assert (alone.resumed_in, alone.duration_s) == ("", None)


def test_alarms_show_which_was_first_and_when_each_cleared(tmp_path):
    run = Written(tmp_path, "run-0001")
    run.state(1, "armed", "depositing")
    run.alarm(5, "disc")
    run.alarm(6, "flow")
    run.record(8, "alarm_cleared", name="flow", what="", how="gone")
    run.record(9, "alarm_cleared", name="disc", what="", how="acknowledged")
    run.alarm(20, "silent")
    run.alarm(21, "lost", explains=["silent"])
    run.end(30, "faulted")
    part = part_record_of(run.path)
    told = {one.name: (one.is_first_out, one.duration_s, one.how) for one in part.alarms}
    assert told == {
        "disc": (True, 4.0, "acknowledged"), "flow": (False, 2.0, "gone"),
        "silent": (False, None, ""), "lost": (True, None, ""),
    }
    causes = {one.text.removeprefix("ALARM: "): one.cause for one in part.deviations}
    assert causes["flow is wrong"] == "follows: disc is wrong"
    assert causes["lost is wrong"] == "first out"
