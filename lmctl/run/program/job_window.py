"""The part of a job that a run needs now, layer by layer, in constant memory.

Layers are read when a line or a program time in them is first requested (the streamer runs ahead by
the send horizon, the powder by the longest dead time). `forget` drops the layers that lie behind.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Callable

import numpy as np

from lmctl.job.schema import JobLayer, JobManifest
from lmctl.run.program.layer_program import LayerProgram, layer_program_of


class JobWindow:
    """The lines and flows of a job near the place it is being run.

    manifest : of the job
    read_layer : JobReader.layer
    start_mm : where the nozzle is before the first line
    beam_off : every power is sent as zero
    first_layer : where running begins; no earlier layer is ever read

    Lines are counted from 0 through the whole job; program times before the job give its first
    flow, times after it its last.
    """

    def __init__(
        self,
        manifest: JobManifest,
        read_layer: Callable[[int], JobLayer],
        start_mm: tuple[float, float, float],
        beam_off: bool = False,
        first_layer: int = 0,
    ) -> None:
        self.manifest = manifest
        self.n_lines = sum(entry.n_lines for entry in manifest.layers)
        self.end_s = manifest.layers[-1].end_s
        self._read_layer = read_layer
        self._beam_off = beam_off
        self._first_layer = first_layer
        self._first_lines = [entry.first_line for entry in manifest.layers]
        self._starts_s = [entry.start_s for entry in manifest.layers]
        self._loaded: deque[LayerProgram] = deque()
        self._behind_mm = np.array(start_mm, dtype=np.float64)  # end of the last layer read
        self._behind_fed_s = 0.0

    def first_layer(self) -> LayerProgram:
        """The layer in which running begins. It must not have been forgotten."""
        return self.layer_program(self._first_layer)

    def layer_program(self, layer: int) -> LayerProgram:
        """A layer, by its place in the job. It must not have been forgotten."""
        first = self._first_loaded
        if layer < first:
            raise IndexError(f"layer {layer} lies behind")
        while layer >= first + len(self._loaded):
            self._load(first + len(self._loaded))
        return self._loaded[layer - first]

    def layer_program_of_line(self, line: int) -> LayerProgram:
        """The layer that holds a line."""
        for layer in self._loaded:
            if layer.first_line <= line <= layer.last_line:
                return layer
        return self.layer_program(bisect_right(self._first_lines, line) - 1)

    def designed_fractions(self, line: int) -> dict[str, float] | None:
        """Volume fractions of the part file at the end of a line, by material.

        None where that is no bead or not stated in the job, and in a layer that is not held.
        """
        for layer in self._loaded:
            if layer.first_line <= line <= layer.last_line:
                fractions = layer.designed[line - layer.first_line].tolist()
                if any(fractions):
                    return dict(zip(self.manifest.materials, fractions, strict=True))
        return None

    def line_start_s(self, line: int) -> float:
        """Program time at which a line starts; the job's end for the line after the last."""
        if line >= self.n_lines:
            return self.end_s
        layer = self.layer_program_of_line(line)
        return layer.starts_s[line - layer.first_line]

    def next_motion_start_s(self, line: int) -> float:
        """Program time at which the first line from this one on that moves starts."""
        while line < self.n_lines:
            layer = self.layer_program_of_line(line)
            if layer.speeds_mm_s[line - layer.first_line] > 0.0:
                break
            line += 1
        return self.line_start_s(line)

    def line_at_program_time(self, s: float) -> int:
        """The line that runs at program time s; the job's last one at its end."""
        layer = self._at(s)
        return min(layer.first_line + bisect_right(layer.ends_s, s), layer.last_line)

    def line_span_at_program_time(self, s: float) -> tuple[list[float], list[float], float, float]:
        """Where the line that runs at program time s starts and ends, and when."""
        layer = self._at(s)
        row = min(bisect_left(layer.ends_s, s), len(layer.program) - 1)
        corners = layer.corners_mm
        return corners[row], corners[row + 1], layer.starts_s[row], layer.ends_s[row]

    def commanded_between(self, from_s: float, to_s: float) -> tuple[float, list[float]]:
        """Of the lines that run between two program times: the highest speed [mm/s], and of each
        that moves its energy per millimetre [J/mm]; 0 and none where none does."""
        layer = self._at(from_s)
        lines = slice(bisect_left(layer.ends_s, from_s), bisect_right(layer.starts_s, to_s))
        speeds_mm_s, energies_J_mm = layer.speeds_mm_s[lines], layer.energies_J_mm[lines]
        while layer.ends_s[-1] < to_s and layer.index + 1 < len(self.manifest.layers):
            layer = self.layer_program(layer.index + 1)
            last = bisect_right(layer.starts_s, to_s)
            speeds_mm_s += layer.speeds_mm_s[:last]
            energies_J_mm += layer.energies_J_mm[:last]
        if 0.0 in speeds_mm_s:
            moving = zip(energies_J_mm, speeds_mm_s, strict=True)
            energies_J_mm = [energy for energy, speed in moving if speed > 0.0]
        return max(speeds_mm_s, default=0.0), energies_J_mm

    @property
    def _first_loaded(self) -> int:
        """The first layer that has not been forgotten."""
        return self._loaded[0].index if self._loaded else self._first_layer

    def drop_layers_before(self, before_line: int) -> None:
        """Drop the layers that end before this line, but for the last one read."""
        while len(self._loaded) > 1 and self._loaded[0].last_line < before_line:
            self._loaded.popleft()

    def advance(self, s: float, machine_s: float, rate: float) -> float:
        """Program time after so much machine time more, at a feed override of `rate`.

        The override acts on G1 only: rapids and dwells take the time they were planned to take.
        """
        if rate == 1.0 or machine_s <= 0.0:
            reached_s = s + machine_s if machine_s > 0.0 else s
            return reached_s if reached_s < self.end_s else self.end_s
        layer = self._at(s)
        target = self.machine_time_s(s, rate) + machine_s
        while True:
            ends = layer.end_s - layer.feed_time_end_s * (1.0 - 1.0 / rate)
            row = int(ends.searchsorted(target))
            if row < len(ends):
                slope = rate if layer.is_feed_move[row] else 1.0
                return float(layer.end_s[row] - (ends[row] - target) * slope)
            if layer.index == len(self.manifest.layers) - 1:
                return self.end_s
            layer = self.layer_program(layer.index + 1)

    def next_beam_off_span_s(self, s: float, before_s: float) -> tuple[float, float] | None:
        """Program times between which the beam is off: the first such span to start after s.

        None where none starts before `before_s`.
        """
        layer = self._at(s)
        while True:
            first = int(layer.start_s.searchsorted(s))
            off = np.flatnonzero(layer.beam_off_spans[first:])
            if len(off):
                first += int(off[0])
                on = np.flatnonzero(~layer.beam_off_spans[first:])
                last = first + int(on[0]) - 1 if len(on) else len(layer.beam_off_spans) - 1
                start_s, end_s = float(layer.start_s[first]), float(layer.end_s[last])
                if start_s >= before_s:
                    return None
                if end_s > start_s:
                    return start_s, end_s
                s = np.nextafter(end_s, np.inf)
            elif layer.end_s[-1] >= before_s or layer.index + 1 == len(self.manifest.layers):
                return None
            else:
                layer = self.layer_program(layer.index + 1)

    def flow_g_s(self, hopper: int, s: float) -> float:
        """Mass flow wanted at the nozzle from one hopper [g/s]."""
        layer = self._at(s)
        times, flow = layer.flow_s, layer.flow_g_s[hopper]
        after = bisect_right(times, s)
        if after == 0 or after == len(times):
            return flow[after - 1 if after else 0]
        start_s, start = times[after - 1], flow[after - 1]
        return start + (flow[after] - start) * (s - start_s) / (times[after] - start_s)

    def flow_steady_until_s(self, hopper: int, s: float) -> float:
        """Program time up to which a hopper's flow surely is what it is at s; s if it changes."""
        layer = self._at(s)
        times, flow = layer.flow_s, layer.flow_g_s[hopper]
        after = bisect_right(times, s)
        steady = after
        while 0 < steady < len(times) and flow[steady] == flow[steady - 1]:
            steady += 1
        return times[steady - 1] if steady > after else s

    def _at(self, s: float) -> LayerProgram:
        """The layer in which a program time lies, or the nearest one still held."""
        for layer in self._loaded:
            if layer.flow_s[0] <= s < layer.flow_s[-1]:
                return layer
        index = max(bisect_right(self._starts_s, s) - 1, 0)
        return self.layer_program(max(index, self._first_loaded))

    def machine_time_s(self, s: float, rate: float) -> float:
        """Machine time from the job's start to program time s, at one override throughout."""
        if rate == 1.0:
            return s
        layer = self._at(s)
        row = min(int(layer.end_s.searchsorted(s)), len(layer.end_s) - 1)
        left_s = layer.end_s[row] - s
        fed_s = layer.feed_time_end_s[row] - (left_s if layer.is_feed_move[row] else 0.0)
        return float(s - fed_s * (1.0 - 1.0 / rate))

    def _load(self, index: int) -> None:
        layer = layer_program_of(
            self._read_layer(index), self._behind_mm, self._behind_fed_s, beam_off=self._beam_off
        )
        self._loaded.append(layer)
        self._behind_mm = layer.end_mm[-1]
        self._behind_fed_s = float(layer.feed_time_end_s[-1])
