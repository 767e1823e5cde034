"""The controller's messages, one a line: parsed from text, and written back as text.

    line = "ok" | "error:" N | "ALARM:" N | "<" status ">" | "[" kind ":" text "]"
         | "$" N "=" value | "$N" N "=" block | ">" block ":" answer | banner

Only `ok` and `error:N` answer a line that was sent; everything else may come anywhere between
them. A line that fits nothing is `UnknownMessage`: never an exception, never an answer.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from firmware_protocol.status import StatusReport, parse_status


@dataclass(frozen=True, slots=True)
class OkReply:
    """The oldest unanswered line was parsed and planned. It has not been executed."""

    def format(self) -> str:
        return "ok"


@dataclass(frozen=True, slots=True)
class ErrorReply:
    """The oldest unanswered line was rejected."""

    code: int

    def format(self) -> str:
        return f"error:{self.code}"


@dataclass(frozen=True, slots=True)
class AlarmMessage:
    """The controller stopped and is locked."""

    code: int

    def format(self) -> str:
        return f"ALARM:{self.code}"


@dataclass(frozen=True, slots=True)
class StatusMessage:
    """An answer to `?`."""

    report: StatusReport

    def format(self) -> str:
        return self.report.format()


@dataclass(frozen=True, slots=True)
class WelcomeBanner:
    """The controller has started or was reset: lines not yet answered never will be."""

    text: str

    def format(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class FeedbackMessage:
    """`[kind:text]`: messages, parser state, offsets, identity."""

    kind: str
    text: str

    def format(self) -> str:
        return f"[{self.kind}:{self.text}]"


@dataclass(frozen=True, slots=True)
class SettingMessage:
    """`$number=value`."""

    number: int
    value: str

    def format(self) -> str:
        return f"${self.number}={self.value}"


@dataclass(frozen=True, slots=True)
class StartupBlockSetting:
    """`$Nn=block`: a line the controller runs at every start."""

    number: int
    block: str

    def format(self) -> str:
        return f"$N{self.number}={self.block}"


@dataclass(frozen=True, slots=True)
class StartupBlockReply:
    """`>block:answer`: a stored line was run; its answer is no answer to the host."""

    block: str
    reply: str

    def format(self) -> str:
        return f">{self.block}:{self.reply}"


@dataclass(frozen=True, slots=True)
class UnknownMessage:
    """A line that is none of these: damaged, or of a firmware we do not know."""

    text: str

    def format(self) -> str:
        return self.text


Message = (
    OkReply | ErrorReply | AlarmMessage | StatusMessage | WelcomeBanner | FeedbackMessage
    | SettingMessage | StartupBlockSetting | StartupBlockReply | UnknownMessage
)

_CODE = re.compile(r"(error|ALARM):([0-9]{1,3})")
_FEEDBACK = re.compile(r"\[([^\[\]:]{1,64}):(.*)\]")  # of any kind: firmware adds kinds
_SETTING = re.compile(r"\$([0-9]{1,4})=(.*)")
_STORED = re.compile(r"\$N([0-9])=(.*)")
_STARTUP = re.compile(r">(.*):(ok|error:[0-9]{1,3})")
_BANNER = re.compile(r"Grbl(?:HAL)? [0-9][^ ]* \[.*\]")


def parse_message(text: str) -> Message:
    """The message in one received line, without its line end. Never raises.

    >>> parse_message("error:20")
    ErrorReply(code=20)
    """
    if text == "ok":
        return OkReply()
    first = text[:1]
    if first == "<":
        report = parse_status(text)
        return UnknownMessage(text) if report is None else StatusMessage(report)
    if first == "[":
        found = _FEEDBACK.fullmatch(text)
        return FeedbackMessage(found[1], found[2]) if found else UnknownMessage(text)
    if first in ("e", "A"):
        found = _CODE.fullmatch(text)
        if found:
            return ErrorReply(int(found[2])) if first == "e" else AlarmMessage(int(found[2]))
    if first == "$":
        if found := _SETTING.fullmatch(text):
            return SettingMessage(int(found[1]), found[2])
        if found := _STORED.fullmatch(text):
            return StartupBlockSetting(int(found[1]), found[2])
    if first == ">" and (found := _STARTUP.fullmatch(text)):
        return StartupBlockReply(found[1], found[2])
    if first == "G" and _BANNER.fullmatch(text):
        return WelcomeBanner(text)
    return UnknownMessage(text)
