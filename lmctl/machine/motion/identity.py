"""Who answers on a motion link, and how it is set.

Everything here is read from the controller's own answers (`$I`, `$$`, `$G`, `$#`); nothing is
assumed from the port it is connected to.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from firmware_protocol.dialect import GRBL, GRBLHAL, Dialect
from firmware_protocol.messages import FeedbackMessage, SettingMessage, parse_message
from firmware_protocol.status import StatusReport
from lmctl.errors import MachineError

BENCH_INFO = "lmctl-bench"
"""User info in `[VER:...]` by which the simulated machine makes itself known."""

REPORT_MASK, HOMING, MOST_SPINDLE, LASER_MODE = 10, 22, 30, 32
#: Bits of $10. Those of lines and overrides are grblHAL's; a Grbl reports overrides always.
REPORT_BLOCKS, REPORT_LINE, REPORT_OVERRIDES = 2, 4, 64
_VERSION = re.compile(r"1\.1[a-z]")
_MODAL_OFFSET = re.compile(r"G5[4-9](?:\.[1-3])?")
_LEAST_RX, _MOST_RX = 64, 65_536


@dataclass(frozen=True)
class UnsuitableSetting:
    """A setting with which no program may be streamed.

    text : what is wrong with it; number, value : the setting that corrects it
    """

    text: str
    number: int
    value: int


@dataclass(frozen=True)
class ControllerIdentity:
    """A controller's identity as reported.

    version : text of `[VER:]` before the user info; info : the user info
    rx_bytes : stated size of its receive buffer; planner_blocks : blocks of its planner
    is_bench : it is the simulated machine
    """

    dialect: Dialect
    version: str
    info: str
    rx_bytes: int
    planner_blocks: int

    @property
    def is_bench(self) -> bool:
        return self.info == BENCH_INFO


def parse_identity(answer: Sequence[str], endpoint: str) -> ControllerIdentity:
    """The identity in the lines that answered `$I`. Raises MachineError where it is no Grbl 1.1."""
    said = {m.kind: m.text for m in map(parse_message, answer) if isinstance(m, FeedbackMessage)}
    version, _, info = said.get("VER", "").partition(":")
    if not _VERSION.match(version):
        raise MachineError(
            f"the controller's firmware {version or '(unnamed)'} is not Grbl 1.1 or grblHAL",
            where=f"motion controller at {endpoint}",
            hint="lmctl speaks with Grbl 1.1 and grblHAL only: install one of them",
        )
    numbers = said.get("OPT", "").split(",")[1:3]
    if len(numbers) < 2 or not all(number.isdecimal() for number in numbers):
        raise MachineError(
            "the controller does not state the size of its receive buffer",
            where=(f"motion controller at {endpoint}", f"[OPT:{said.get('OPT', '')}]"),
            hint="use a build of Grbl 1.1 or grblHAL that answers $I with [OPT:letters,blocks,rx]",
        )
    blocks, rx_bytes = map(int, numbers)
    if not _LEAST_RX <= rx_bytes <= _MOST_RX or not 2 <= blocks <= 10_000:
        raise MachineError(
            f"the controller states {blocks} planner blocks and {rx_bytes} bytes of receive buffer",
            where=f"motion controller at {endpoint}",
            hint="that is not credible: check cable and baud rate, then try again",
        )
    hal = said.get("FIRMWARE", "").lower() == "grblhal"
    return ControllerIdentity(GRBLHAL if hal else GRBL, version, info, rx_bytes, blocks)


def parse_settings(answer: Sequence[str]) -> dict[int, str]:
    """The settings in the lines that answered `$$`."""
    return {m.number: m.value for m in map(parse_message, answer) if isinstance(m, SettingMessage)}


def parse_work_offset(parser_state: Sequence[str], offsets: Sequence[str]) -> tuple[float, ...]:
    """Work offset (work = machine - offset) from the answers to `$G` and `$#`, one value an axis.

    The active G54-G59.3 plus G92, plus the tool length offset: a single TLO value acts on Z.
    """
    modal = " ".join(m.text for m in map(parse_message,
                                         parser_state) if isinstance(m, FeedbackMessage))
    active = _MODAL_OFFSET.search(modal)
    said: dict[str, tuple[float, ...]] = {}
    for message in map(parse_message, offsets):
        if isinstance(message, FeedbackMessage):
            try:
                said[message.kind] = tuple(map(float, message.text.split(",")))
            except ValueError:
                continue  # [PRB:...:0] is no offset
    total = list(said.get(active[0] if active else "G54", (0.0, 0.0, 0.0)))
    tool = said.get("TLO", ())
    for extra in (said.get("G92", ()), (0.0, 0.0, *tool) if len(tool) == 1 else tool):
        total = [a + b for a, b in zip(total, (*extra, *[0.0] * len(total)), strict=False)]
    return tuple(total)


def is_homing_enabled(settings: Mapping[int, str]) -> bool:
    """Whether the controller has a homing cycle and waits for it ($22; grblHAL: its lowest bit)."""
    stated = settings.get(HOMING, "0")
    return stated.isdecimal() and bool(int(stated) & 1)


def reported_homed_state(report: StatusReport) -> bool | None:
    """grblHAL's `H:homed[,mask]` in a report: whether all axes to be homed are; None without it."""
    said = dict(report.unknown_fields).get("H")
    return None if said is None else said.partition(",")[0] == "1"


def unsuitable_settings(identity: ControllerIdentity,
                        settings: Mapping[int, str]) -> list[UnsuitableSetting]:
    """Settings with which a program must not be streamed, on any machine.

    $32 must be 1: otherwise M4 is an ordinary spindle and the beam stays on at standstill. $10
    must enable `Bf:` or `Ln:`: otherwise the host cannot determine what has been executed.
    """
    found = []
    if settings.get(LASER_MODE) != "1":
        found.append(UnsuitableSetting(
            f"laser mode is off (${LASER_MODE}={settings.get(LASER_MODE, 'missing')}): M4 would "
            "leave the beam on at standstill", LASER_MODE, 1,
        ))
    stated = settings.get(REPORT_MASK, "")
    mask = int(stated) if stated.isdecimal() else 0
    hal = identity.dialect is GRBLHAL
    wanted = REPORT_BLOCKS | REPORT_LINE if hal else REPORT_BLOCKS
    if not mask & wanted:
        fields = "neither Ln: nor Bf:" if hal else "no Bf:"
        overrides = REPORT_OVERRIDES if hal else 0  # asked for too, in one go
        found.append(UnsuitableSetting(
            f"status reports carry {fields} (${REPORT_MASK}={stated or 'missing'}), so executed "
            "lines could not be distinguished from planned ones",
            REPORT_MASK, mask | wanted | overrides,
        ))
    return found
