"""The two firmwares this protocol is spoken with, as data.

Numbers are of Grbl 1.1h (20190830) and grblHAL core 1.1f.20260817, read from their sources and
from transcripts of both.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from firmware_protocol.realtime import GRBL_REALTIME, GRBLHAL_REALTIME, RealtimeCommand


class ErrorPolicy(Enum):
    """What the firmware does with the lines behind one that it rejected."""

    CONTINUE = "reports the error and executes the lines that follow"
    LATCH = "rejects every following G-code line with the same number until it is cleared"


@dataclass(frozen=True)
class Dialect:
    """What differs between the firmwares.

    max_line_chars : characters of one line the firmware stores; spaces and comments are not stored
    rx_bytes : size of the receive buffer as `[OPT:]` states it; one byte less is usable
    rx_report_margin : what `Bf:` leaves off `rx_bytes` when the buffer is empty
    planner_blocks : what `Bf:` shows when the planner is empty
    segment_buffer_s : most motion cut into segments and not yet made; `Ln:` and `Bf:` lead by it
    realtime_bytes : bytes acted on; `dropped` : bytes thrown away unread
    """

    name: str
    banner: str
    version: str
    options: str
    max_line_chars: int
    rx_bytes: int
    rx_report_margin: int
    planner_blocks: int
    segment_buffer_s: float
    realtime_bytes: frozenset[RealtimeCommand]
    ignored_bytes: frozenset[int]
    error_policy: ErrorPolicy


_CONTROL = frozenset(range(0x20)) - {0x0A, 0x0D}

GRBL = Dialect(
    name="grbl",
    banner="Grbl 1.1h ['$' for help]",
    version="1.1h.20190830",
    options="V",
    max_line_chars=79,
    rx_bytes=128,
    rx_report_margin=0,
    planner_blocks=15,
    segment_buffer_s=0.05,
    realtime_bytes=GRBL_REALTIME,
    ignored_bytes=frozenset(range(0x80, 0x100)) - GRBL_REALTIME,
    error_policy=ErrorPolicy.CONTINUE,
)

GRBLHAL = Dialect(
    name="grblhal",
    banner="GrblHAL 1.1f ['$' or '$HELP' for help]",
    version="1.1f.20260817",
    options="VNML+",
    max_line_chars=256,
    rx_bytes=1024,
    rx_report_margin=1,
    planner_blocks=100,
    segment_buffer_s=0.09,
    realtime_bytes=GRBLHAL_REALTIME,
    ignored_bytes=(frozenset(range(0x80, 0xC0)) | _CONTROL) - GRBLHAL_REALTIME,
    error_policy=ErrorPolicy.LATCH,
)

DIALECTS: dict[str, Dialect] = {dialect.name: dialect for dialect in (GRBL, GRBLHAL)}
