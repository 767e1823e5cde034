"""What was not as planned in a part: each deviation with cause, duration, reason, disposition."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lmctl.report.events import LoggedEvent
from lmctl.report.interruptions import Interruption
from lmctl.report.layer_record import LayerRecord
from lmctl.report.run_record import RunRecord
from lmctl.run.journal.notes import Note


@dataclass(frozen=True)
class Deviation:
    """Something that was not as planned. seq : of the journal record, None where there is none

    notes : what people have written about it
    cause : what it followed from, in words, "" where the record does not say; duration_s : for how
        long it stood, or deposition rested, None where the record does not say
    """

    run: str
    seq: int | None
    text: str
    notes: tuple[Note, ...]
    cause: str = ""
    duration_s: float | None = None

    @property
    def reason(self) -> str:
        """What people have written about it, "" where nobody has."""
        return "; ".join(note.text for note in self.notes)

    @property
    def disposition(self) -> str:
        """What was decided last, "" where nothing was."""
        return next((str(note.disposition) for note in reversed(self.notes) if note.disposition),
                    "")


def deviations_of(
    runs: Sequence[RunRecord], layers: Sequence[LayerRecord],
    interruptions: Sequence[Interruption], notes: Sequence[Note],
) -> tuple[Deviation, ...]:
    """Events and layers that are not as planned, each with what was noted about it."""

    def deviation(
        run: str, seq: int | None, text: str, cause: str, duration_s: float | None
    ) -> Deviation:
        about = tuple(note for note in notes
                      if note.run == run and note.about is not None and note.about == seq)
        return Deviation(run, seq, text, about, cause, duration_s)

    found = [
        deviation(run.run, event.seq, event.text, *_cause(run, event, interruptions))
        for run in runs for event in run.events if event.is_deviation
    ]
    found += [
        deviation(layer.runs[-1], layer.seq, f"layer {layer.number}: {words}",
                  _cause_in(layer, interruptions), None)
        for layer in layers if (words := layer.difference)
    ]
    return tuple(found)


def _cause(
    run: RunRecord, event: LoggedEvent, interruptions: Sequence[Interruption]
) -> tuple[str, float | None]:
    """What an event followed from, and for how long it stood or deposition rested."""
    first = ""
    for alarm in run.alarms:
        first = alarm.what if alarm.is_first_out else first
        if alarm.seq == event.seq:
            return ("first out" if alarm.is_first_out else f"follows: {first}"), alarm.duration_s
    for one in interruptions:
        if one.run != run.run or one.seq is None:
            continue
        if event.seq == one.seq - 1:  # the act stands just before the state that it led to
            return one.cause, one.duration_s
        lasted_s = float("inf") if one.duration_s is None or one.resumed_in != run.run \
            else one.duration_s
        if one.began_s <= event.t_s < one.began_s + lasted_s:
            return one.cause, None
    return "", None


def _cause_in(layer: LayerRecord, interruptions: Sequence[Interruption]) -> str:
    """What ended deposition within a layer, "" where nothing did."""
    first, last = layer.lines
    return "; ".join(dict.fromkeys(
        one.cause for one in interruptions
        if one.run in layer.runs and one.line is not None and first <= one.line <= last))
