"""How another controller writes a program: templates as data, those that ship and a user's own."""

from __future__ import annotations

import string
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from pydantic import Field

from lmctl.config.toml_file import ConfigModel, parse_toml, read_text
from lmctl.errors import ConfigError, Finding, UsageError

Template = Annotated[str, Field(max_length=200)]
Templates = Annotated[tuple[Template, ...], Field(max_length=100)]

#: What each template may name in braces, and a value it is tried with.
_HEAD_FIELDS: dict[str, object] = {"part": "p", "job": "0", "machine": "m", "duration_s": 1.0}
_FIELDS: dict[str, dict[str, object]] = {
    "comment": {"text": "t"}, "head": _HEAD_FIELDS, "tail": _HEAD_FIELDS, "gas_on": {},
    "gas_off": {}, "powder_on": {}, "powder_off": {}, "dwell": {"seconds": 1.0}, "motion": {},
    "x": {"mm": 1.0}, "y": {"mm": 1.0}, "z": {"mm": 1.0}, "feed": {"mm_min": 1.0},
    "beam_power": {"W": 1.0, "share": 0.5}, "beam_on": {}, "beam_off": {},
    "flow": {"number": 1, "hopper": "A", "g_min": 1.0},
    "flow_at_rest": {"number": 1, "hopper": "A", "g_min": 1.0},
}

#: Dialects that ship.
SHIPPED = ("plain", "linuxcnc", "siemens")


class GcodeDialect(ConfigModel):
    """Templates of one controller's language; what each may name stands in braces.

    comment : {text}; head, tail : lines, {part}, {job}, {machine}, {duration_s}
    gas_on, gas_off, powder_on, powder_off : lines, powder between gas on and gas off
    dwell : {seconds}; motion : the word that begins a move; x, y, z : {mm}; feed : {mm_min}
    beam_power : {W}, {share} of the laser's greatest; beam_on, beam_off : of the laser gate
    flow : set-point of a hopper while motion runs: {number} from 1, {hopper}, {g_min}
    flow_at_rest : the same while it rests; empty takes `flow`
    """

    description: Template
    extension: Annotated[str, Field(pattern=r"^\.[a-zA-Z0-9]{1,8}$")]
    comment: Template
    head: Templates
    tail: Templates
    gas_on: Templates = ()
    gas_off: Templates = ()
    powder_on: Templates = ()
    powder_off: Templates = ()
    dwell: Template
    motion: Template
    x: Template
    y: Template
    z: Template
    feed: Template
    beam_power: Template
    beam_on: Template
    beam_off: Template
    flow: Template
    flow_at_rest: Template = ""

    def as_comment(self, text: str) -> str:
        """A comment that cannot end itself."""
        return self.comment.format(text=plain_text(text))


def plain_text(text: str) -> str:
    """The same without what ends a comment or a line, or is no ASCII."""
    return "".join(one if one.isascii() and one.isprintable() and one not in "();%" else " "
                   for one in text)


def load_dialect(name: str) -> GcodeDialect:
    """One that ships, by its name, or a file. Raises UsageError; ConfigError with all mistakes."""
    if name in SHIPPED:
        where = files("lmctl.exchange") / "dialects" / f"{name}.toml"
        return parse_dialect(where.read_text("utf-8"), name=f"{name}.toml")
    path = Path(name)
    if path.suffix.lower() != ".toml":
        raise UsageError(f"there is no form {name!r} to export to",
                         hint=f"choose one of {', '.join(SHIPPED)}, csv, or a dialect file .toml")
    return parse_dialect(read_text(path), name=name)


def parse_dialect(text: str, *, name: str) -> GcodeDialect:
    """Check the text of a dialect file. Raises ConfigError with all mistakes."""
    dialect = parse_toml(text, GcodeDialect, name=name)
    findings = [
        Finding(key, problem)
        for key, known in _FIELDS.items()
        for template in _templates(getattr(dialect, key))
        if (problem := _problem(template, known))
    ]
    if findings:
        raise ConfigError.of_findings(name, findings)
    return dialect


def _templates(value: str | tuple[str, ...]) -> tuple[str, ...]:
    return (value,) if isinstance(value, str) else value


def _problem(template: str, known: dict[str, object]) -> str:
    """Why a template cannot be filled in, "" where it can."""
    if not template.isprintable():
        return "holds a line end or a sign that does not print"
    try:
        named = [one for _, one, _, _ in string.Formatter().parse(template) if one is not None]
    except ValueError as error:
        return f"{template!r}: {error}"
    unknown = sorted({one for one in named if one not in known})
    if unknown:
        may = f"it may name {_named(known)}" if known else "it may name nothing in braces"
        return f"{template!r} names {_named(unknown)}; {may}"
    try:
        template.format(**known)
    except (ValueError, TypeError) as error:
        return f"{template!r}: {error}"
    return ""


def _named(fields: Iterable[str]) -> str:
    return ", ".join("{" + one + "}" for one in fields)
