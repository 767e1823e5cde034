"""Check that the program of a job does what its line table states.

Digests prove that nothing was altered since the job was written. They do not prove that its writer
was right, or honest: the controller executes the text, while all monitoring reads the table. So
before anything moves the two are compared line by line, with one layer in memory at a time.

Positions have three decimals, feeds one, powers as many as `s_word_decimals` gives: differences by
rounding are accepted.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.config.machine import MachineProfile
from lmctl.errors import JobError
from lmctl.job.container import REPLAN_HINT
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobLayer, JobManifest, LineKind
from lmctl.preflight.s_word import s_word_decimals

_OPENING, _CLOSING = ("G21 G90 G94", "M4 S0"), "M5"
_SIGNED, _PLAIN = r"(-?[0-9]+(?:\.[0-9]+)?)", r"([0-9]+(?:\.[0-9]+)?)"
_LINE = re.compile(
    rf"^N[0-9]+ (?:G1 X{_SIGNED} Y{_SIGNED}(?: Z{_SIGNED})?(?: F{_PLAIN})?(?: S{_PLAIN})?"
    rf"|G4 P{_PLAIN}|(G21 G90 G94|M4 S0|M5))\n", re.MULTILINE,
)
_X, _Y, _Z, _F, _S, _P, _WORDS = range(7)

# Half of the last decimal, and a little for float32.
_POSITION_MM, _DWELL_S, _FEED_MM_MIN, _OF_LAST_DECIMAL = 6e-4, 6e-4, 0.06, 0.6
# The same of the manifest's totals.
_LASTING_S, _POWER_W = 1e-6, 0.06
_OF_FLOAT32 = 1e-6
# A line may be executed slower than its programmed feed, but not faster.
_FASTER, _FASTER_S = 1e-3, 1e-4

def check_program(job: JobReader, profile: MachineProfile) -> None:
    """Refuse a job whose text does not match its table, naming the first line that differs.

    Compared are kind, end position, feed, power, waiting time and the least time a line can take;
    and the table itself with what the manifest promises. Raises JobError.
    """
    check = _Check(job.manifest, profile.motion.purge_mm)
    for layer in job.iterate_layers():
        check.layer(layer, is_last=layer.index == len(job.manifest.layers) - 1)


class _Check:
    """Checks layers in order. at_mm : program position at the start of the next layer."""

    def __init__(self, manifest: JobManifest, start_mm: Sequence[float]) -> None:
        self._manifest = manifest
        self._at_mm = np.array(start_mm, dtype=float)

    def layer(self, layer: JobLayer, *, is_last: bool) -> None:
        """Raises JobError."""
        rows = _LINE.findall("\n".join(layer.program) + "\n")
        if len(rows) != len(layer.program):
            self._refuse_words(layer)
        text = list(zip(*rows, strict=True))
        kind = layer.lines["kind"]
        moves = _present(text[_X])
        self._kinds(layer, moves, _present(text[_P]))
        self._setup(layer, text[_WORDS], is_last)
        ends_mm = self._positions(layer, text, moves)
        self._speeds(layer, text, moves, ends_mm)
        self._powers(layer, text, moves)
        waits = kind == LineKind.DWELL
        lasting_s = np.diff(layer.lines["end_s"], prepend=layer.flow_s[0])
        self._compare(layer, waits, _numbers(text[_P]), lasting_s, _DWELL_S, "waits {:g} s")
        self._promises(layer, lasting_s)
        self._at_mm = ends_mm[-1]

    def _refuse_words(self, layer: JobLayer) -> None:
        for at, line in enumerate(layer.program):
            if _LINE.fullmatch(line + "\n") is None:
                self._refuse(layer, at, "the program has a line that no plan is made of")

    def _kinds(self, layer: JobLayer, moves: NDArray[np.bool_], waits: NDArray[np.bool_]) -> None:
        kind = layer.lines["kind"]
        known = np.where(kind == LineKind.SETUP, 0, np.where(kind == LineKind.DWELL, 2, 1))
        said = np.where(moves, 1, np.where(waits, 2, 0))
        if (at := _first(known != said)) is not None:
            does = ("sets modes", "moves", "waits")[said[at]]
            self._refuse(layer, at, f"the program {does}, the table has "
                                    f"{LineKind(int(kind[at])).name.lower()}")

    def _setup(self, layer: JobLayer, words: Sequence[str], is_last: bool) -> None:
        """Modes are set at the program's beginning, and the beam is disarmed at its end."""
        expected = [""] * len(words)
        if layer.index == 0:
            expected[:2] = _OPENING[: len(words)]
        if is_last:
            expected[-1] = _CLOSING
        if list(words) == expected:
            return
        at = next(i for i, said in enumerate(words) if said != expected[i])
        self._refuse(layer, at, f"the program sets {words[at] or 'no modes'} here, a plan "
                                f"{expected[at] or 'none'}")

    def _positions(
        self, layer: JobLayer, text: Sequence[Sequence[str]], moves: NDArray[np.bool_]
    ) -> FloatArray:
        """(n, 3) where each line ends by the program."""
        ends_mm = np.empty((len(moves), 3))
        first = _first(moves)
        if first is not None and not text[_Z][first]:
            self._refuse(layer, first, "the layer's first move does not say how high it is")
        for axis, column in enumerate((_X, _Y, _Z)):
            name = "xyz"[axis]
            ends_mm[:, axis] = _held(_numbers(text[column]), float(self._at_mm[axis]))
            self._compare(layer, moves, ends_mm[:, axis], layer.lines[f"{name}_mm"],
                          _POSITION_MM, f"goes to {name.upper()} {{:.3f}} mm")
        return ends_mm

    def _speeds(
        self, layer: JobLayer, text: Sequence[Sequence[str]], moves: NDArray[np.bool_],
        ends_mm: FloatArray,
    ) -> None:
        first = _first(moves)
        if first is not None and not text[_F][first]:
            self._refuse(layer, first, "the layer's first move does not say how fast it is")
        feed = _held(_numbers(text[_F]), 0.0)
        self._compare(layer, moves, feed / 60, layer.lines["speed_mm_s"], _FEED_MM_MIN / 60,
                      "goes at {:.4g} mm/s")
        if (at := _first(moves & (feed <= 0))) is not None:
            self._refuse(layer, at, "the program moves at F0")
        length_mm = np.linalg.norm(np.diff(ends_mm, axis=0, prepend=self._at_mm[None]), axis=1)
        least_s = np.where(moves, length_mm / np.maximum(feed / 60, 1e-9), 0.0)
        lasting_s = np.diff(layer.lines["end_s"], prepend=layer.flow_s[0])
        rounding_s = np.where(moves, 2 * _POSITION_MM / np.maximum(feed / 60, 1e-9), 0.0)
        early = lasting_s < least_s * (1 - _FASTER) - rounding_s - _FASTER_S
        if (at := _first(early)) is not None:
            self._refuse(layer, at, f"the program takes {least_s[at]:.3f} s at least, the table "
                                    f"has {lasting_s[at]:.3f} s")

    def _powers(
        self, layer: JobLayer, text: Sequence[Sequence[str]], moves: NDArray[np.bool_]
    ) -> None:
        manifest = self._manifest
        first = _first(moves)
        if first is not None and not text[_S][first]:
            self._refuse(layer, first, "the layer's first move does not say with which power")
        said = _held(_numbers(text[_S]), 0.0)
        beam_off = moves & (layer.lines["kind"] != LineKind.BEAD)
        if (at := _first(beam_off & (said != 0))) is not None:
            kind = LineKind(int(layer.lines["kind"][at])).name.lower()
            self._refuse(layer, at, f"the program has the beam on, at S{said[at]:g}; the table "
                                    f"has it off ({kind})")
        per_S = manifest.max_power_W / manifest.s_max
        rounded_W = _OF_LAST_DECIMAL / 10 ** s_word_decimals(manifest.s_max) * per_S
        self._compare(layer, moves, said * per_S, layer.lines["power_W"], rounded_W,
                      "has a beam of {:g} W")

    def _promises(self, layer: JobLayer, lasting_s: FloatArray) -> None:
        """Check the manifest's totals over all lines, by which a machine accepts the job."""
        lines, totals = layer.lines, self._manifest.totals
        low, high = self._manifest.bounds_mm
        moves = ~np.isin(lines["kind"], (int(LineKind.SETUP), int(LineKind.DWELL)))
        for axis, name in enumerate("xyz"):
            ends_mm = lines[f"{name}_mm"]
            outside = (ends_mm < low[axis] - _POSITION_MM) | (ends_mm > high[axis] + _POSITION_MM)
            if (at := _first(moves & outside)) is not None:
                self._refuse(layer, at, f"it goes to {name.upper()} {ends_mm[at]:.3f} mm, the "
                                        f"manifest says {low[axis]:g} to {high[axis]:g}")
        for key, values, rounded, unit in (
            ("longest_line_s", lasting_s, _LASTING_S, "s"),
            ("peak_power_W", lines["power_W"], _POWER_W, "W"),
        ):
            most = float(totals.get(key, np.inf))
            over = values > most * (1 + _OF_FLOAT32) + rounded
            if (at := _first(over)) is not None:
                self._refuse(layer, at, f"it has {values[at]:.6g} {unit}, the manifest says "
                                        f"{most:.6g} at most")

    def _compare(
        self, layer: JobLayer, where: NDArray[np.bool_], said: FloatArray,
        known: NDArray[np.floating], tolerance: float, words: str,
    ) -> None:
        off = np.abs(said - known) > tolerance + _OF_FLOAT32 * np.abs(known)
        if (at := _first(where & off)) is not None:
            self._refuse(layer, at, f"the program {words.format(said[at])}, the table has "
                                    f"{_bare(words).format(known[at])}")

    def _refuse(self, layer: JobLayer, at: int, what: str) -> None:
        raise JobError(
            f"line {layer.first_line + at} of the job is not what it is said to be: {what}",
            where=f"layer {layer.index}: {layer.program[at]}", hint=REPLAN_HINT,
        )


def _bare(words: str) -> str:
    """The number and its unit."""
    return words[words.index("{"):]


def _first(where: NDArray[np.bool_]) -> int | None:
    return int(where.argmax()) if where.any() else None


def _present(column: Sequence[str]) -> NDArray[np.bool_]:
    return np.fromiter(map(bool, column), bool, len(column))


def _numbers(column: Sequence[str]) -> FloatArray:
    """The words' values, NaN where there is none."""
    values = np.full(len(column), np.nan)
    values[_present(column)] = np.fromiter(map(float, filter(None, column)), float)
    return values


def _held(values: FloatArray, before: float) -> FloatArray:
    """Modal words: each value until the next; before the first, `before`."""
    at = np.maximum.accumulate(np.where(np.isnan(values), -1, np.arange(len(values))))
    return np.where(at >= 0, values[at], before)
