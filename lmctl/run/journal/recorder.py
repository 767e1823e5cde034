"""What a run writes into its journal, record by record (docs/reference/journal-records.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from typing import Any, NamedTuple

from lmctl.errors import JournalError, LmctlError
from lmctl.machine.feeder.warnings import FeederWarning
from lmctl.run.interlocks.alarms import RunAlarm
from lmctl.run.journal.writer import JournalWriter
from lmctl.run.program.layer_program import PathSpan
from lmctl.run.program.place import Known, PlaceReached, ProgramPlace
from lmctl.run.program.reentry import Reentry
from lmctl.run.state.transitions import Effect, RunEvent, RunState

#: Samples wait so long before they are written [s]: after a crash no more than that is in doubt.
SAMPLE_BATCH_S = 0.5

#: Effects that move the machine.
_MOVING = frozenset({Effect.MOVE_TO_PURGE, Effect.LEAVE_PART, Effect.START_MOTION})

_COLUMNS = ("t", "line", "x_mm", "y_mm", "z_mm", "feed_mm_min", "s_word")


class LatestReport(NamedTuple):
    """The last status report, as journaled. Flows in the hoppers' order [g/min].

    at_s : machine time of the report since the run began
    """

    position_mm: tuple[float, ...]
    feed_mm_min: float | None
    s_word: float | None
    set_g_min: tuple[float, ...]
    measured_g_min: tuple[float | None, ...]
    carrier_L_min: tuple[float | None, ...] = ()
    shield_gas_L_min: float | None = None
    at_s: float = 0.0


class Refill(NamedTuple):
    """What was filled into a hopper. Masses in g; None where the hopper has no load cell.

    mass_g : as the operator states; weighed_g : the difference of the weights before and after
    """

    hopper: str
    material: str
    lot: str
    mass_g: float
    weighed_g: float | None
    before_g: float | None
    after_g: float | None


class RunRecorder:
    """Writes a run's journal.

    now_s : machine time since the run began, as records carry it
    hoppers : names, in the order flows are given
    latest : the last sample, for status requests
    layer_so_far : the present accounts of the layers under way

    When the journal cannot be written (a full disk) the first write raises JournalError, which
    ends the run; writes of the safe stop that follows are dropped, so that nothing delays it.
    """

    def __init__(
        self, journal: JournalWriter, now_s: Callable[[], float], hoppers: Iterable[str]
    ) -> None:
        self._journal = journal
        self.now_s = now_s
        self._hoppers = tuple(hoppers)
        self._samples: list[tuple[Any, ...]] = []
        self._batch_due_s = 0.0
        self._broken = False
        self.latest: LatestReport | None = None
        self.layer_so_far: Callable[[], list[dict[str, Any]]] = list

    def record_machine(self, **fields: Any) -> None:
        """The controller that answered on the motion link."""
        self._append("machine", **fields)

    def record_state(self, event: RunEvent, before: RunState, after: RunState) -> None:
        """A transition, durable before its effects begin."""
        self._event("state", event=event, **{"from": before, "to": after})
        self._sync()

    def record_effect(self, do: Effect, failed: str = "") -> None:
        """An effect begins, or has failed while the run was being stopped anyway.

        One that moves the machine is on the disk when this returns: recovery must not take a
        machine for unmoved because the host was killed right after.
        """
        self._event("act", do=do, **({"failed": failed} if failed else {}))
        if do in _MOVING:
            self._sync()

    def record_paths_started(self, begun: Iterable[PathSpan]) -> None:
        """Paths whose lines are about to be sent; on the disk when this returns."""
        for path in begun:
            self._append("path", path=path.path, layer=path.layer,
                         lines=[path.first_line, path.last_line])
        self._sync()

    def record_paths_executed(self, done: Iterable[PathSpan]) -> None:
        """Paths that have been executed."""
        for path in done:
            self._append("executed", path=path.path)

    def sent(self, line: int, reported: ProgramPlace) -> None:
        """Lines up to this one are about to be sent; out of this process when this returns.

        reported : the place reported last. A killed host loses none of it.
        """
        self._append("sent", line=line, reported=_place(reported))
        self._flush()

    def record_place(self, reached: PlaceReached, standstill_mm: tuple[float, ...] | None) -> None:
        """Where deposition ended; durable. standstill_mm : machine position, if reported at rest"""
        fields: dict[str, Any] = {"known": reached.known}
        if reached.is_assumed:
            fields["at_least"] = _place(reached.at_least)
        if reached.known is Known.UNKNOWN:
            fields["until"] = _place(reached.until)
        if reached.reported_s is not None:
            fields["reported_at"] = round(reached.reported_s, 3)
        if standstill_mm is not None:
            fields["standstill_mm"] = [round(axis, 3) for axis in standstill_mm]
        self._event("place", **place_fields(reached.place), **fields)
        self._sync()

    def record_entry(self, entry: Reentry) -> None:
        """How the job resumes from a place."""
        self._event(
            "entry", **place_fields(entry.place),
            beam_on_line=entry.beam_on_line, layer=entry.layer.index,
            repeated_mm=round(entry.repeated_mm, 3),
        )

    def record_alarm(self, alarm: RunAlarm) -> None:
        """An interlock has tripped."""
        explains = {"explains": sorted(alarm.explains)} if alarm.explains else {}
        self._event("alarm", name=alarm.name, what=alarm.what, hint=alarm.hint, **explains,
                     local={"where": list(alarm.where)})

    def record_alarm_cleared(self, alarm: RunAlarm, how: str) -> None:
        """An alarm is over. how : its cause is gone, or it was acknowledged"""
        self._event("alarm_cleared", name=alarm.name, what=alarm.what, how=how)

    def record_warning(self, warning: FeederWarning, *, is_active: bool) -> None:
        """A warning has appeared, or is over."""
        self._event(
            "warning", number=warning.number, feeder=warning.feeder, hopper=warning.hopper,
            active=is_active, what=warning.text, hint=warning.remedy,
        )

    def record_refill(self, refill: Refill) -> None:
        """A hopper was refilled; durable."""
        self._event("refill", **{
            name: round(value, 1) if isinstance(value, float) else value
            for name, value in refill._asdict().items()
        })
        self._sync()

    def record_slope(self, **fields: Any) -> None:
        """A window of a hopper's loss in weight."""
        self._append("slope", **fields)

    def record_slope_correction(self, **fields: Any) -> None:
        """Set-points of a hopper are corrected from now on."""
        self._event("slope_correction", **fields)

    def record_hose_response(self, **fields: Any) -> None:
        """What a purge has measured of a hopper's dead time and lag, or why nothing; durable."""
        self._event("hose_response", **fields)
        self._sync()

    def record_height(self, **fields: Any) -> None:
        """The height of the part between two layers, and what follows from it; durable."""
        self._event("height", **fields)
        self._sync()

    def record_purge(self, fed_g: dict[str, float]) -> None:
        """Powder that has gone into no layer."""
        self._append("purge", fed_g={name: round(fed, 4) for name, fed in fed_g.items()})

    def record_unreported_motion(self, **fields: Any) -> None:
        """What an earlier run executed without a report of it."""
        self._event("unreported", **fields)

    def record_layer_opened(self, **fields: Any) -> None:
        """Lines of a layer are about to be sent."""
        self._event("layer_opened", **fields)

    def record_layer(self, **fields: Any) -> None:
        """A layer is over, or the run is."""
        self._event("layer", **fields)
        self._sync()

    def record_setpoint(self, flows_g_min: dict[str, float]) -> None:
        """Set-points on their way to the feeders."""
        self._append("setpoint", flow_g_min=flows_g_min)
        self._flush()

    def record_override(self, feed_percent: int, source: str, power_percent: int = 100) -> None:
        """Overrides. source : "operator" as requested, "controller" as reported."""
        self._event("override", feed_percent=feed_percent, power_percent=power_percent,
                     source=source)

    def record_operator(self, act: str, operator: str, refused: str, **local: Any) -> None:
        """An act that came from outside.

        operator : the name given, "" for none; refused : why, "" where it was accepted

        Accepted ones are durable. Refusals change nothing, and there may be many a second: they
        do not wait for the disk.
        local : who, by user and process number
        """
        self._event("operator", act=act, operator=operator, accepted=not refused,
                     **({"refused": refused} if refused else {}), local=local)
        if not refused:
            self._sync()

    def record_sample(
        self, line: int, position_mm: tuple[float, ...], feed_mm_min: float | None,
        s_word: float | None, set_g_min: tuple[float, ...],
        measured_g_min: tuple[float | None, ...], carrier_L_min: tuple[float | None, ...],
        shield_gas_L_min: float | None,
    ) -> None:
        """One status report; written together with others after a while."""
        now_s = self.now_s()
        self.latest = LatestReport(position_mm, feed_mm_min, s_word, set_g_min, measured_g_min,
                                   carrier_L_min, shield_gas_L_min, now_s)
        if not self._samples:
            self._batch_due_s = now_s + SAMPLE_BATCH_S
        self._samples.append((
            round(now_s, 6), line, *(round(axis, 3) for axis in position_mm[:3]), feed_mm_min,
            s_word, *set_g_min, *measured_g_min, *carrier_L_min, shield_gas_L_min,
        ))
        if now_s >= self._batch_due_s:
            self.write_samples()

    def write_samples(self) -> None:
        """Write the samples that wait, and let the journal outlive this process."""
        if self._samples:
            columns = [list(column) for column in zip(*self._samples, strict=True)]
            self._samples.clear()
            n = len(self._hoppers)
            *flows, shield = columns[len(_COLUMNS):]
            self._append(
                "samples", **{
                    "at" if name == "t" else name: column
                    for name, column in zip(_COLUMNS, columns, strict=False)
                },
                set_g_min=dict(zip(self._hoppers, flows[:n], strict=True)),
                flow_g_min=dict(zip(self._hoppers, flows[n:2 * n], strict=True)),
                carrier_L_min=dict(zip(self._hoppers, flows[2 * n:], strict=True)),
                **({"shield_gas_L_min": shield} if any(one is not None for one in shield) else {}),
                layers=self.layer_so_far(),
            )
        self._flush()

    def record_fault(self, error: BaseException, follows: str = "") -> None:
        """A reason to stop, in words; durable.

        follows : what came before it and is the cause, "" where it is the cause itself
        """
        if isinstance(error, LmctlError):
            # Places name ports and files, which differ between equal runs.
            self._event("fault", what=error.what, hint=error.hint,
                         **({"follows": follows} if follows else {}),
                         local={"where": list(error.where)})
        else:
            self._event("fault", what=f"internal error: {error!r}", hint="")
        self._sync()

    def seal(self, state: RunState, **fields: Any) -> None:
        """The last record."""
        self.write_samples()
        if not self._broken:
            self._journal.seal(self.now_s(), state=state, **fields,
                               local={"wall": wall_stamp()})

    def _append(self, kind: str, **fields: Any) -> None:
        if not self._broken:
            self._journal.append(self.now_s(), kind, **fields)

    def _event(self, kind: str, **fields: Any) -> None:
        """A record that people read: it has the wall clock as well."""
        local = {"wall": wall_stamp(), **fields.pop("local", {})}
        self._append(kind, **fields, local=local)

    def _flush(self) -> None:
        self._write(self._journal.flush)

    def _sync(self) -> None:
        self._write(self._journal.sync)

    def _write(self, how: Callable[[], None]) -> None:
        if self._broken:
            return
        try:
            how()
        except JournalError:
            self._broken = True
            raise


def place_fields(place: ProgramPlace) -> dict[str, Any]:
    """A place as records carry it."""
    return {"line": place.line, "share": round(place.line_fraction, 6)}


def _place(place: ProgramPlace) -> list[float]:
    return [place.line, round(place.line_fraction, 6)]


def wall_stamp() -> str:
    """The wall clock as journals carry it: UTC, ISO 8601, milliseconds."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
