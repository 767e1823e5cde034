"""Program lines as bytes: digits of integers in the program's own last decimals, by one kernel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import IntArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.job.layer_rules import MAX_LINE
from lmctl.job.schema import N_WORD_MODULUS, LineKind

ByteArray = NDArray[np.uint8]

#: Decimals of coordinates [mm], feeds [mm/min] and dwell times [s] in a program.
COORDINATE_DECIMALS, FEED_DECIMALS, DWELL_DECIMALS = 3, 1, 3

_SETUP, _DWELL, _BEAD = int(LineKind.SETUP), int(LineKind.DWELL), int(LineKind.BEAD)
_N, _G, _X, _Y, _Z, _F, _S, _P = (ord(letter) for letter in "NGXYZFSP")
_SPACE, _NEW_LINE, _MINUS, _POINT, _ZERO = (ord(letter) for letter in " \n-.0")


def line_bytes(
    kind: NDArray[np.uint8], path: NDArray[np.int32], target: IntArray, feed: IntArray,
    power: IntArray, dwell: IntArray, first_line: int, power_decimals: int,
    setup: tuple[str, ...],
) -> bytes:
    """n lines of program text, each with its number and a line end.

    kind, path : (n,) as in the job's line table
    target : (n, 3) x, y, z; feed, power, dwell : (n,); all in their last decimal's units
    setup : text of the SETUP lines, in order
    A layer states z, feed and power at its first motion and each path at its lead-in; in between
    they are repeated only where they change. Motion with the beam off always has S0.
    """
    words = bytearray("".join(setup).encode("ascii") or b" ")  # the kernel takes no constant array
    ends = np.cumsum([0, *(len(text) for text in setup)])
    buffer = np.empty(len(kind) * (MAX_LINE + 1) + len(words), np.uint8)
    length = _write_lines(
        kind, path, target, feed, power, dwell, first_line, power_decimals,
        np.frombuffer(words, np.uint8), ends, buffer)
    return buffer[:length].tobytes()


@kernel
def _write_lines(
    kind: NDArray[np.uint8], path: NDArray[np.int32], target: IntArray, feed: IntArray,
    power: IntArray, dwell: IntArray, first_line: int, power_decimals: int, words: ByteArray,
    ends: IntArray, out: ByteArray,
) -> int:
    n = 0
    said_setup = 0
    z = said_feed = said_power = np.int64(-(2**62))  # no word written yet
    on_path = -1
    for i in range(len(kind)):
        n = _word(out, n, _N, np.int64((first_line + i) % N_WORD_MODULUS), 0)
        out[n] = _SPACE
        n += 1
        if kind[i] == _SETUP:
            for k in range(ends[said_setup], ends[said_setup + 1]):
                out[n] = words[k]
                n += 1
            said_setup += 1
        elif kind[i] == _DWELL:
            n = _word(out, n, _G, np.int64(4), 0)
            out[n] = _SPACE
            n = _word(out, n + 1, _P, dwell[i], DWELL_DECIMALS)
        else:
            if path[i] != on_path:
                z = said_feed = said_power = np.int64(-(2**62))
                on_path = path[i]
            n = _word(out, n, _G, np.int64(1), 0)
            out[n] = _SPACE
            n = _word(out, n + 1, _X, target[i, 0], COORDINATE_DECIMALS)
            out[n] = _SPACE
            n = _word(out, n + 1, _Y, target[i, 1], COORDINATE_DECIMALS)
            if target[i, 2] != z:
                z = target[i, 2]
                out[n] = _SPACE
                n = _word(out, n + 1, _Z, z, COORDINATE_DECIMALS)
            if feed[i] != said_feed:
                said_feed = feed[i]
                out[n] = _SPACE
                n = _word(out, n + 1, _F, said_feed, FEED_DECIMALS)
            wanted = power[i] if kind[i] == _BEAD else np.int64(0)
            if wanted != said_power or kind[i] != _BEAD:
                said_power = wanted
                out[n] = _SPACE
                n = _word(out, n + 1, _S, wanted, power_decimals)
        out[n] = _NEW_LINE
        n += 1
    return n


@inner_kernel
def _word(out: ByteArray, n: int, letter: int, value: np.int64, decimals: int) -> int:
    """A letter and a fixed-point number without needless zeros; returns the next free place."""
    out[n] = letter
    n += 1
    if value < 0:
        out[n] = _MINUS
        n += 1
        value = -value
    while decimals > 0 and value % 10 == 0:
        value //= 10
        decimals -= 1
    digits = 1
    size = value // 10
    while size > 0:
        digits += 1
        size //= 10
    if digits <= decimals:
        digits = decimals + 1
    last = n + digits - 1 + (1 if decimals > 0 else 0)
    end = last + 1
    written = 0
    while written < digits:
        if written == decimals and decimals > 0:
            out[last] = _POINT
            last -= 1
        out[last] = _ZERO + value % 10
        value //= 10
        last -= 1
        written += 1
    return end
