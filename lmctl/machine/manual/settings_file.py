"""Firmware settings kept in a text file: a line `$number=value` each, as firmware prints them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from lmctl.config.toml_file import read_text
from lmctl.errors import ConfigError, Finding, UsageError

#: Longer lines overrun the receive buffer of the smallest controller.
_MAX_VALUE = 70

_LINE = re.compile(r"\$?([0-9]{1,4})=(.*)")
#: As Grbl 0.9 and some senders print them: `$0=10 (step pulse, usec)`.
_DESCRIBED = re.compile(r"([+-]?[0-9.]+)\s+\(.*\)")
#: What a controller would take out of a line as a command of its own, at once: ? ! ~.
_REALTIME = frozenset("?!~")


def read_settings_file(path: Path) -> dict[int, str]:
    """The settings kept in a file; blank lines and those that begin with # ; or ( are passed over.

    Raises MissingFileError; ConfigError with every line that is no setting, or cannot be sent.
    """
    found: dict[int, str] = {}
    wrong = []
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        text = line.strip()
        if not text or text[0] in "#;(":
            continue
        try:
            setting, value = parse_setting(text)
        except UsageError as error:
            wrong.append(Finding(f"line {number}", error.what))
            continue
        if setting in found:
            wrong.append(Finding(f"line {number}", f"${setting} is set twice"))
        found[setting] = value
    if not found and not wrong:
        wrong.append(Finding("", "there is no setting in it"))
    if wrong:
        raise ConfigError(f"{path} is no file of firmware settings", findings=wrong[:20],
                          hint="write lines such as $110=6000; `lmctl machine settings --backup` "
                               "makes such a file")
    return found


def parse_setting(text: str) -> tuple[int, str]:
    """Number and value of `32=1` or `$32=1`. Raises UsageError for text that is no setting."""
    matched = _LINE.fullmatch(text)
    if matched is None:
        raise UsageError(f"{text[:40]!r} is no setting", hint="write 32=1, or '$32=1' in quotes")
    value = matched[2].strip()
    if described := _DESCRIBED.fullmatch(value):
        value = described[1]
    if len(value) > _MAX_VALUE:
        raise UsageError(f"the value of ${matched[1]} is longer than {_MAX_VALUE} characters",
                         hint="give the value alone")
    if not value.isascii() or not value.isprintable() or _REALTIME & set(value):
        raise UsageError(
            f"the value of ${matched[1]} holds a character that a controller does not take as text",
            hint="? ! ~ and what is not ASCII cannot be sent: set it at the controller itself",
        )
    return int(matched[1]), value


def write_settings_file(path: Path, settings: Mapping[int, str], comments: list[str]) -> None:
    """Keep settings in a new file. Raises UsageError where it is there already, or cannot be."""
    lines = [*(f"# {comment}" for comment in comments),
             *(f"${number}={value}" for number, value in settings.items())]
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")
    except FileExistsError:
        raise UsageError(f"{path} is there already", hint="a backup is never written over: name "
                         "another file") from None
    except OSError as error:
        raise UsageError.cannot_write(path, error) from None


def is_same_value(kept: str, reported: str) -> bool:
    """Whether a controller that reports a setting so holds the value that was kept.

    Numbers are compared to the decimals the controller prints.
    """
    if kept == reported:
        return True
    try:
        difference = abs(float(kept) - float(reported))
    except ValueError:
        return False
    decimals = len(reported.partition(".")[2])
    return difference <= 0.5000001 * 10.0 ** -decimals if decimals else difference == 0.0
