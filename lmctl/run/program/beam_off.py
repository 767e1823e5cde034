"""Programs for a machine whose interlocks are not monitored yet: every S word becomes S0."""

from __future__ import annotations

import re

from lmctl.errors import JobError

_POWER = re.compile(rb"S[0-9.]+")
_OTHER_M = re.compile(rb"M(?!0*[45](?:\.0*)?(?:[^0-9.]|$))[0-9.]*")


def line_without_beam(line: bytes) -> bytes:
    """The line with its power set to zero.

    Raises JobError where it holds an M word other than M4 and M5: M3 would leave the beam at the
    controller's last power, and the effect of any other on the beam is unknown here.
    """
    if b"M" in line and (other := _OTHER_M.search(line)):
        raise JobError(
            f"the job holds {other.group().decode()}, which may not run without interlocks",
            where=f"program line {line.decode()!r}",
            hint="plan the part again: programs made by lmctl use M4 and M5 only",
        )
    return _POWER.sub(b"S0", line) if b"S" in line else line
