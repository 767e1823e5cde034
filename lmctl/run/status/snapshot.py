"""The status of a run for outside clients, as JSON values."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Sequence
from typing import Any

from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.job.schema import JobManifest
from lmctl.run.execution.deposition import Progress
from lmctl.run.execution.job_progress import JobProgress
from lmctl.run.interlocks.alarms import RunAlarms
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.sequence import CellSequence
from lmctl.run.state.transitions import RunState
from lmctl.run.status.live_values import live_values, value_origins
from lmctl.run.status.startup_time import StartupTime

_BEFORE = (RunState.READY, RunState.CONNECTING, RunState.CHECKING, RunState.GAS, RunState.POWDER,
           RunState.ARMED)
_ENDING = (RunState.FINISHING, RunState.STOPPING, RunState.TRIPPED)


class RunView:
    """One run, looked at. What it knows comes from progress and from what `snapshot` is given."""

    def __init__(
        self, made: RunFolder, manifest: JobManifest, profile: MachineProfile,
        hoppers: Sequence[HopperSettings], operator: str, progress: Progress | None,
    ) -> None:
        self._made = made
        self._fixed = {
            "run": made.run, "pid": os.getpid(), "part": manifest.part_name,
            "machine": profile.name,
            "operator": operator, "layers": len(manifest.layers),
            "lines": sum(entry.n_lines for entry in manifest.layers),
            "hoppers": [h.name for h in hoppers],
            "materials": [h.material for h in hoppers],
        }
        self._hoppers = tuple(h.name for h in hoppers)
        self._power_W_per_s = manifest.max_power_W / manifest.s_max
        self._end_s = manifest.layers[-1].end_s
        self._reported: tuple[float, float, int, float] | None = None
        self._progress = progress
        self._preparation = StartupTime(profile, hoppers, manifest.powder_mode)

    def on_progress(self, done_s: float, total_s: float, layer: int, remaining_s: float) -> None:
        """Take progress, and hand it on."""
        self._reported = (done_s, total_s, layer, remaining_s)
        if self._progress is not None:
            self._progress(done_s, total_s, layer, remaining_s)

    def snapshot(
        self, state: RunState, course: JobProgress, recorder: RunRecorder, sequence: CellSequence
    ) -> dict[str, Any]:
        """What the control socket answers to "status".

        run, part, machine, operator, pid, lines, layers, hoppers, materials : as the run began;
            materials in the hoppers' order
        now_s : machine time since the run began
        state, line, layer (from 1), place (in words), override_percent
        line : lines of the job executed; sent_line : with those sent to the controller
        designed : {material: volume fraction of the part file at the end of the line under way};
            None between beads, and where it is not known
        doing, doing_left_s : what is done at this moment, in words, and the machine time until it
            is over (None: not known); held_by : why a held run is held, "" where it is not
        refill_hopper : the hopper that an operator has asked to refill, until it is weighed; None
            where there is none. It may be opened in the state "refilling"
        next : commands that may be useful now, each with what it does
        done_s, total_s : program time; remaining_s : machine time to the end of the program, with
            what the run waits for before it deposits
        beam_off : whether every power goes out as zero
        position_mm, s_word, power_W, speed_mm_s, set_g_min, measured_g_min, carrier_L_min,
            shield_gas_L_min : as last reported, None before the first; flows in the hoppers' order
        origins : {key: kind, source and age_s of its value}; of flows the oldest hopper's
        reading_age_s : of each hopper's last reading, in the hoppers' order
        interlocks : every row of the interlock table: name, state, what, hint; none before the
            machine is accepted
        reentry : of a held run, where it would go on: layer (from 1), beam_on_line, repeated_mm,
            run_up_mm, approach_mm; None otherwise, and where the place is not known
        levels : of the hoppers that report one, each with hopper, level_percent and weight_g (None:
            not reported)
        alarms : the cause first, each with what, where, hint, and when it came and was over
        warnings : of feeders, oldest first, each with feeder, hopper ("": unknown), what and hint
        """
        at_start = (0.0, self._end_s, 0, self._end_s * 100.0 / course.override_percent)
        done_s, total_s, layer, remaining_s = self._reported or at_start
        t, alarms = asyncio.get_running_loop().time(), sequence.alarms
        latest, now_s, ages = recorder.latest, recorder.now_s(), sequence.report_ages()
        remaining_s += self._preparation.remaining_s(state, t)
        doing = sequence.phase.current_phase(state, t)
        return {
            **self._fixed, "state": state.value, "doing": doing.description,
            "doing_left_s": None if doing.remaining_s is None else round(doing.remaining_s, 1),
            "held_by": self._held_by(state, alarms, sequence),
            "refill_hopper": sequence.refilling.hopper_name,
            "next": self._next(state, sequence),
            "levels": sequence.hopper_levels(), "line": course.lines_executed, "layer": layer + 1,
            "place": course.place_text, "override_percent": course.override_percent,
            "done_s": round(done_s, 3), "total_s": round(total_s, 3),
            "remaining_s": round(remaining_s, 1), "beam_off": sequence.beam_off,
            **live_values(latest, self._hoppers, self._power_W_per_s),
            "now_s": round(now_s, 3), "sent_line": course.lines_sent,
            "designed": _rounded(course.designed_fractions),
            "origins": value_origins(latest, now_s, ages),
            "reading_age_s": [ages.hoppers.get(name) for name in self._hoppers],
            "interlocks": [row._asdict() for row in sequence.interlock_board()],
            "reentry": self._reentry(state, sequence),
            "alarms": [
                {"name": one.name, "what": one.what, "where": list(one.where), "hint": one.hint,
                 "at_s": round(one.at_s, 3),
                 "cleared_s": None if one.cleared_s is None else round(one.cleared_s, 3)}
                for one in alarms
            ],
            "warnings": [
                {"feeder": one.feeder, "hopper": one.hopper, "what": one.text, "hint": one.remedy}
                for one in alarms.warnings
            ],
        }

    @staticmethod
    def _reentry(state: RunState, sequence: CellSequence) -> dict[str, Any] | None:
        preview = sequence.reentry_preview() if state is RunState.HELD else None
        if preview is None:
            return None
        return {
            "layer": preview.layer + 1, "beam_on_line": preview.beam_on_line,
            "repeated_mm": round(preview.repeated_mm, 3),
            "run_up_mm": round(preview.run_up_mm, 3),
            "approach_mm": [[round(axis, 3) for axis in corner] for corner in preview.approach_mm],
        }

    @staticmethod
    def _held_by(state: RunState, alarms: RunAlarms, sequence: CellSequence) -> str:
        if state not in (RunState.HOLDING, RunState.HELD):
            return ""
        if alarms.cause is None and _awaits_height(sequence):
            return "a height check"
        if alarms.cause is None and _awaits_purge(sequence):
            return "a purge between layers"
        return "the operator" if alarms.cause is None else alarms.cause.what

    def _next(self, state: RunState, sequence: CellSequence) -> list[dict[str, str]]:
        """What an operator may want to type now."""
        acts: list[tuple[str, str]] = []
        if state in _BEFORE:
            acts = [("stop", "ends the run")]
        elif state in (RunState.DEPOSITING, RunState.PURGING, RunState.RESUMING):
            acts = [("hold", "stops on the path, beam off"), ("stop", "ends the run")]
        elif state is RunState.HELD:
            acts = [("resume", "purges the hoses and goes on"), ("stop", "ends the run")]
        elif state in (RunState.OPENING, RunState.REFILLING, RunState.WEIGHING):
            acts = [("stop", "ends the run")]
        elif state in _ENDING:
            acts = [("stop", "skips the gas post-flow")]
        found = [{"command": self._made.command(act), "does": does} for act, does in acts]
        if state is RunState.REFILLING:
            filled = f"lmctl refill {sequence.refilling.hopper_name} --lot LOT --mass GRAMS"
            found.insert(0, {"command": filled, "does": "once it is filled and closed"})
        if state is RunState.HELD and _awaits_height(sequence):
            found.insert(0, {"command": "lmctl height MM",
                             "does": "with the height of the part; then it can be resumed"})
        return found


def _rounded(fractions: dict[str, float] | None) -> dict[str, float] | None:
    return None if fractions is None else {
        material: round(one, 4) for material, one in fractions.items()}


def _awaits_purge(sequence: CellSequence) -> bool:
    return sequence.purge.layers is not None and sequence.purge.layers.is_due


def _awaits_height(sequence: CellSequence) -> bool:
    return sequence.heights is not None and sequence.heights.awaited is not None
