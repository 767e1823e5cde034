"""How a run stands, for whoever asks from outside, as JSON values."""

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
from lmctl.run.journal.recorder import LatestReport
from lmctl.run.startup_time import StartupTime


class RunView:
    """One run, looked at. What it knows comes from progress and from what `snapshot` is given."""

    def __init__(
        self, run: str, manifest: JobManifest, profile: MachineProfile,
        hoppers: Sequence[HopperSettings], operator: str, progress: Progress | None,
    ) -> None:
        self._fixed = {
            "run": run, "pid": os.getpid(), "part": manifest.part_name, "machine": profile.name,
            "operator": operator, "layers": len(manifest.layers),
            "lines": sum(entry.n_lines for entry in manifest.layers),
            "hoppers": [h.name for h in hoppers],
        }
        self._end_s = manifest.layers[-1].end_s
        self._told: tuple[float, float, int, float] | None = None
        self._progress = progress
        self._preparation = StartupTime(profile, hoppers, manifest.powder_mode)

    def on_progress(self, done_s: float, total_s: float, layer: int, remaining_s: float) -> None:
        """Take progress, and hand it on."""
        self._told = (done_s, total_s, layer, remaining_s)
        if self._progress is not None:
            self._progress(done_s, total_s, layer, remaining_s)

    def snapshot(
        self, state: str, course: JobProgress, latest: LatestReport | None, alarms: RunAlarms, *,
        beam_off: bool,
    ) -> dict[str, Any]:
        """What the control socket answers to "status".

        run, part, machine, operator, pid, lines, layers, hoppers : as the run began
        state, line, layer (from 1), place (in words), override_percent
        done_s, total_s : program time; remaining_s : machine time to the end of the program, with
            what the run waits for before it deposits
        beam_off : whether every power goes out as zero
        position_mm, s_word, set_g_min, measured_g_min : as last reported, None before the first;
            flows in the hoppers' order
        alarms : first-out first, each with what, where and hint
        warnings : of feeders, oldest first, each with feeder, hopper ("": unknown), what and hint
        """
        whole = (0.0, self._end_s, 0, self._end_s * 100.0 / course.override_percent)
        done_s, total_s, layer, remaining_s = self._told or whole
        remaining_s += self._preparation.remaining_s(state, asyncio.get_running_loop().time())
        return {
            **self._fixed, "state": state, "line": course.lines_executed, "layer": layer + 1,
            "place": course.place_text, "override_percent": course.override_percent,
            "done_s": round(done_s, 3), "total_s": round(total_s, 3),
            "remaining_s": round(remaining_s, 1), "beam_off": beam_off,
            "position_mm": None if latest is None else list(latest.position_mm),
            "s_word": None if latest is None else latest.s_word,
            "set_g_min": None if latest is None else list(latest.set_g_min),
            "measured_g_min": None if latest is None else list(latest.measured_g_min),
            "alarms": [
                {"name": one.name, "what": one.what, "where": list(one.where), "hint": one.hint,
                 "at_s": round(one.at_s, 3)}
                for one in alarms
            ],
            "warnings": [
                {"feeder": one.feeder, "hopper": one.hopper, "what": one.text, "hint": one.remedy}
                for one in alarms.warnings
            ],
        }
