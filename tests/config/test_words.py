"""Mistakes in plain words: never those of the library that finds them, and with the key meant."""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Iterator
from importlib.resources import files
from typing import Any

import pytest

from lmctl.config.free_numbers import resolve_free_numbers
from lmctl.config.machine import MachineProfile
from lmctl.config.part_file import PartFile
from lmctl.config.toml_file import ConfigModel, validated_model
from lmctl.errors import ConfigError

EXAMPLES = sorted(path.name for path in files("lmctl.examples").iterdir()
                  if path.name.endswith(".toml")
                  and not path.name.startswith(("bench", "feeder-")))

#: What stands in files by mistake.
ODD = ["", "x", "y" * 2000, 7, 2.5, -1e9, 1e12, float("nan"), True, [], [1], [[1]], {}, {"a": 1},
       ["a"] * 12, None]

#: How the library speaks.
FOREIGN = re.compile(r"\b(Input|String|Tuple|Dictionary|List|Value|Field|Extra|Unable|valid|item"
                     r"|items|instance|greater|less|equal|character)\b")


def of(name: str) -> tuple[dict[str, Any], type[ConfigModel]]:
    text = (files("lmctl.examples") / name).read_text(encoding="utf-8")
    data = tomllib.loads(text)
    if name.startswith("cell"):
        return data, MachineProfile
    return resolve_free_numbers(data).data, PartFile  # with numbers where they are free


def places(data: Any) -> Iterator[tuple[Any, Any]]:
    """Every table or list in some data, with each of its keys."""
    for key in data if isinstance(data, dict) else range(len(data)):
        yield data, key
        if isinstance(data[key], dict | list):
            yield from places(data[key])


def reasons(data: Any, model: type[ConfigModel]) -> list[tuple[str, str]]:
    try:
        validated_model(data, model, name="it")
    except ConfigError as error:
        return [(finding.path, finding.reason) for finding in error.findings]
    return []


@pytest.mark.parametrize("name", EXAMPLES)
def test_whatever_is_written_anywhere_is_refused_in_our_own_words(name: str) -> None:
    data, model = of(name)
    reported = set()
    for holder, key in list(places(data)):
        kept = holder[key]
        for odd in ODD:
            holder[key] = odd
            reported |= set(reasons(data, model))
        holder[key] = kept
    assert len(reported) > 20
    assert [found for found in sorted(reported) if FOREIGN.search(found[1])] == []


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_key_with_a_letter_too_few_is_known_again_wherever_it_stands(name: str) -> None:
    data, model = of(name)
    materials = {item["name"] for item in data.get("material", [])}
    keys = [(h, k) for h, k in places(data) if isinstance(k, str) and k not in materials]
    assert len(keys) > 5
    for holder, key in keys:
        if len(key) < 5:
            continue
        before = copy.copy(holder)
        holder[key[:-2] + key[-1]] = holder.pop(key)
        guesses = [reason for _, reason in reasons(data, model) if "no such key" in reason]
        assert guesses == [f"there is no such key; did you mean {key!r}?"]
        holder.clear()
        holder.update(before)


def test_a_key_like_no_other_is_only_refused() -> None:
    data, model = of("box.toml")
    data["quux"] = 1
    assert reasons(data, model) == [("quux", "there is no such key")]
