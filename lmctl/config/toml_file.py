"""Read a TOML file into a checked model, reporting every mistake at once with its path."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from lmctl.config.mistake_messages import describe_mistake
from lmctl.errors import ConfigError, Finding, MissingFileError

#: A configuration a person wrote is small; more than this is some other file given by mistake.
MAX_FILE_BYTES = 1_000_000

#: Most tables of an array ([[hopper]], [[body]]) in one file, and most mistakes reported.
_MOST_TABLES, _MOST_REPORTED = 2_000, 100

#: A key of thirty parts and more: the time that TOML takes for those grows with their square.
_DEEP_KEY = re.compile(r"(?:\.[ \t]*[\w\"'-]{1,200}[ \t]*){30}")


class ConfigModel(BaseModel):
    """Base of every configuration model: unknown keys, NaN and infinities are errors.

    So is a value of another kind: neither "4" nor true is a number.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True,
                              defer_build=True)


M = TypeVar("M", bound=ConfigModel)


def read_text(path: Path) -> str:
    """The UTF-8 text of a configuration file, without the byte-order mark that Windows editors put.

    Raises MissingFileError, or ConfigError where the file is unreadable, huge, or not text.
    """
    try:
        if path.is_dir():
            raise ConfigError(f"{path} is a folder, not a file", hint="name the file in it")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise ConfigError(
                f"{path} is too large for a configuration file",
                where=f"{path.stat().st_size:,} bytes; at most {MAX_FILE_BYTES:,}",
                hint="was a data file given in its place?",
            )
        with path.open("rb") as file:  # a device or a pipe states no size
            data = file.read(MAX_FILE_BYTES + 1)
        if len(data) > MAX_FILE_BYTES:
            raise ConfigError(f"{path} is too large for a configuration file",
                              where=f"at most {MAX_FILE_BYTES:,} bytes are read",
                              hint="was a data file given in its place?")
        return data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except FileNotFoundError:
        raise MissingFileError.for_path(path) from None
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path} is not text", where=f"byte {error.start} is not UTF-8",
            hint="a TOML file is expected here, saved as UTF-8",
        ) from None
    except OSError as error:
        raise ConfigError.cannot_read(path, error) from None


def parse_toml(text: str, model: type[M], *, name: str) -> M:
    """Check TOML text against a model.

    name : what to call the text in messages, usually its path.
    Raises ConfigError: without findings for bad TOML, else with one for each key that is wrong.
    """
    return validated_model(parse_tables(text, name=name), model, name=name)


def parse_tables(text: str, *, name: str) -> dict[str, Any]:
    """TOML text as plain data, unchecked. Raises ConfigError where it is none."""
    if (count := text.count("\n[[")) > _MOST_TABLES:
        raise ConfigError(f"{name} has {count:,} tables; at most {_MOST_TABLES:,} are taken",
                          hint="was a data file given in its place?")
    try:
        if _DEEP_KEY.search(text):
            raise RecursionError
        return tomllib.loads(text)
    except RecursionError:
        raise ConfigError(f"{name} is not valid TOML", where="nested too deeply",
                          hint="was another file given in its place?") from None
    except ValueError as error:  # of its own, and of numbers with thousands of digits
        raise ConfigError(f"{name} is not valid TOML", where=str(error)[:200],
                          hint="correct it there; text stands in quotes, lists in [ ]") from None


def validated_model(data: object, model: type[M], *, name: str) -> M:
    """Check plain data against a model; as `parse`, without the TOML."""
    try:
        return model.model_validate(_frozen(data))
    except ValidationError as error:
        mistakes = _first_causes(error.errors(include_url=False))
        findings = [
            Finding(_dotted(item["loc"]), describe_mistake(item, model))
            for item in mistakes[:_MOST_REPORTED]
        ]
        raise ConfigError.of_findings(
            name, findings, unlisted=len(mistakes) - len(findings)) from None


def load_toml(path: Path, model: type[M]) -> M:
    """Read and check a TOML file. Raises ConfigError."""
    return parse_toml(read_text(path), model, name=str(path))


def _frozen(data: object) -> object:
    """Plain data with its lists as tuples, which is what models hold."""
    if isinstance(data, dict):
        return {key: _frozen(value) for key, value in data.items()}
    return tuple(map(_frozen, data)) if isinstance(data, list) else data


def _first_causes(mistakes: list[ErrorDetails]) -> list[ErrorDetails]:
    """Drop "list too short" mistakes caused by wrong items, which are reported themselves."""
    return [
        item for item in mistakes
        if item["type"] != "too_short"
        or not any(len(other["loc"]) > len(item["loc"])
                   and other["loc"][: len(item["loc"])] == item["loc"] for other in mistakes)
    ]


def _dotted(loc: tuple[int | str, ...]) -> str:
    """("hopper", 0, "lag_s") -> "hopper[1].lag_s": people count tables from one."""
    text = ""
    for step in loc:
        text += f"[{step + 1}]" if isinstance(step, int) else (f".{step}" if text else step)
    return text
