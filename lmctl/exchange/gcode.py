"""A job as a program of another controller, line by line, in constant memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lmctl.exchange.dialect import GcodeDialect, plain_text
from lmctl.exchange.powder_commands import FlowAhead, LeadingSetpoints
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobLayer, LineKind

#: At rest set-points may change this often [s].
_REST_S = 0.5
#: Powder runs at its first flow so many lags and the dead time before motion [s], at least so long.
_SETTLING_LAGS, _LEAST_SETTLING_S = 4.0, 8.0
#: Gas flows so long before powder and after it [s].
_PREFLOW_S, _POSTFLOW_S = 5.0, 10.0


@dataclass
class _Written:
    """Words in force."""

    x: str = ""
    y: str = ""
    z: str = ""
    feed: str = ""
    power: str = ""
    beam: bool = False


def gcode_lines(job: JobReader, dialect: GcodeDialect) -> Iterator[str]:
    """The program, without line ends.

    Motion, speeds and beam power are the job's lines; set-points of hoppers stand where running
    would send them, to the nearest line. Times are those of the plan: the other controller's own
    acceleration and overrides are not known here.
    """
    yield from _Program(job, dialect).lines()


class _Program:
    def __init__(self, job: JobReader, dialect: GcodeDialect) -> None:
        manifest = job.manifest
        self._job = job
        self._say = dialect
        self._about = {
            "part": plain_text(manifest.part_name), "job": job.digest,
            "machine": plain_text(manifest.machine),
            "duration_s": manifest.layers[-1].end_s,
        }
        self._flow = FlowAhead()
        self._leads = manifest.powder_mode == "lead"
        self._longest_s = max(one.dead_time_s for one in manifest.hoppers)
        self._settling_s = max(_LEAST_SETTLING_S, max(
            one.dead_time_s + _SETTLING_LAGS * one.lag_s for one in manifest.hoppers))
        self._setpoints: list[LeadingSetpoints] = []
        self._in_force = _Written()
        self._loaded = 0

    def lines(self) -> Iterator[str]:
        """Head, powder before motion, layers, tail."""
        say, manifest = self._say, self._job.manifest
        yield from (line.format(**self._about) for line in say.head)
        self._load_ahead(0.0)
        self._setpoints = [
            LeadingSetpoints(hopper, at, self._flow, leads=self._leads)
            for at, hopper in enumerate(manifest.hoppers)]
        yield from say.gas_on
        yield say.dwell.format(seconds=_PREFLOW_S)
        yield from say.powder_on
        for at in range(len(self._setpoints)):
            yield self._flow_line(at, at_rest=True)
        yield say.dwell.format(seconds=self._settling_s)
        if self._leads:  # what the first lines need leaves the hoppers before they begin
            yield from self._rest(-self._longest_s, 0.0)
        for layer in self._job.iterate_layers():
            yield say.as_comment(f"layer {layer.index + 1}, z {layer.z_mm:.3f}")
            yield from self._layer(layer)
        if self._in_force.beam:
            yield say.beam_off
        for at in range(len(self._setpoints)):
            self._setpoints[at].setpoint_g_min = 0.0
            yield self._flow_line(at, at_rest=True)
        yield from say.powder_off
        yield say.dwell.format(seconds=_POSTFLOW_S)
        yield from say.gas_off
        yield from (line.format(**self._about) for line in say.tail)

    def _layer(self, layer: JobLayer) -> Iterator[str]:
        begin_s = float(layer.flow_s[0])
        for row in layer.lines:
            end_s = float(row["end_s"])
            self._load_ahead(end_s)
            if row["kind"] == LineKind.DWELL:
                if self._in_force.beam:
                    self._in_force.beam = False
                    yield self._say.beam_off
                yield from self._rest(begin_s, end_s)
            elif row["kind"] != LineKind.SETUP:
                yield from self._changes(begin_s, end_s, at_rest=False)
                yield from self._beam(float(row["power_W"]))
                yield self._move(row)
            begin_s = end_s
        self._flow.forget_before(begin_s - 1.0)

    def _rest(self, begin_s: float, end_s: float) -> Iterator[str]:
        """A wait, with set-points that change in it."""
        waited_s, s = 0.0, begin_s
        while s < end_s - 1e-9:
            until_s = min(end_s, s + _REST_S)
            changes = list(self._changes(s, until_s, at_rest=True))
            if changes and waited_s:
                yield self._say.dwell.format(seconds=waited_s)
                waited_s = 0.0
            yield from changes
            waited_s, s = waited_s + until_s - s, until_s
        if waited_s:
            yield self._say.dwell.format(seconds=waited_s)

    def _changes(self, begin_s: float, end_s: float, *, at_rest: bool) -> Iterator[str]:
        for at, setpoints in enumerate(self._setpoints):
            if setpoints.advance(begin_s, end_s):
                yield self._flow_line(at, at_rest=at_rest)

    def _flow_line(self, at: int, *, at_rest: bool) -> str:
        template = self._say.flow_at_rest if at_rest and self._say.flow_at_rest else self._say.flow
        return template.format(
            number=at + 1, hopper=self._job.manifest.hoppers[at].name,
            g_min=self._setpoints[at].setpoint_g_min)

    def _beam(self, power_W: float) -> Iterator[str]:
        say, now = self._say, self._in_force
        if power_W <= 0.0:
            if now.beam:
                now.beam = False
                yield say.beam_off
            return
        power = say.beam_power.format(W=power_W, share=power_W / self._job.manifest.max_power_W)
        if power != now.power:
            now.power = power
            yield power
        if not now.beam:
            now.beam = True
            yield say.beam_on

    def _move(self, row: np.void) -> str:
        say, now = self._say, self._in_force
        words = [say.motion]
        for axis in ("x", "y", "z"):
            word = getattr(say, axis).format(mm=float(row[f"{axis}_mm"]))
            if word != getattr(now, axis):
                setattr(now, axis, word)
                words.append(word)
        if len(words) == 1:  # a move of nothing, which keeps its place in the program
            words.append(now.x)
        feed = say.feed.format(mm_min=60.0 * float(row["speed_mm_s"]))
        if feed != now.feed:
            now.feed = feed
            words.append(feed)
        return " ".join(words)

    def _load_ahead(self, s: float) -> None:
        """Knots of every layer that a set-point at program time s looks into."""
        manifest = self._job.manifest
        needed_s = s + self._longest_s + 2.0
        while self._loaded < len(manifest.layers) and (
            self._loaded == 0 or manifest.layers[self._loaded].start_s <= needed_s
        ):
            layer = self._job.read_layer(self._loaded)
            self._flow.add(layer.flow_s, layer.flow_g_s)
            self._loaded += 1
