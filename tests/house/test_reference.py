"""What ships about keys is what the models say, and says something of every key."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from typing import Any

import pytest

from firmware_protocol.map_file import parse_map
from lmctl.config.machine import MachineProfile
from lmctl.config.part_file import PartFile
from lmctl.reference.key_row import FILE_KINDS, KIND_OF_TABLE, KeyRow, as_toml
from lmctl.reference.model_rows import docstring_entries
from tests.house.reference import EXAMPLES, ROOT, all_rows, stale, undocumented


@pytest.fixture(scope="module")
def rows() -> list[KeyRow]:
    return all_rows()


def test_every_key_has_a_meaning(rows: list[KeyRow]) -> None:
    assert undocumented(rows) == []


def test_what_ships_is_made_from_the_models_as_they_are() -> None:
    old = [path.relative_to(ROOT).as_posix() for path in stale()]
    assert old == [], "keys have changed: run `python -m tests.house.reference` and commit these"


def test_every_key_of_the_models_has_a_row(rows: list[KeyRow]) -> None:
    """Counted another way: by walking the JSON schemas that pydantic makes."""
    known = {row.path.rpartition(".")[2] for row in rows}
    for model in (PartFile, MachineProfile):
        schema = model.model_json_schema()
        tables = [schema, *schema.get("$defs", {}).values()]
        keys = {key for table in tables for key in table.get("properties", {})}
        assert keys - known == set()


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_every_key_of_an_example_has_a_row(path: Any, rows: list[KeyRow]) -> None:
    kind = next((kind for start, kind in (("cell", "machine"), ("bench", "bench"),
                                          ("feeder-", "map")) if path.name.startswith(start)),
                "part")
    known = {row.key for row in rows if row.path.startswith(f"{kind}.")}
    own = {"bits", "codes", "near", "far", "of", "settings", "powder", "free", "start"}
    unknown = set()

    def walk(table: Any, parent: str) -> None:
        if isinstance(table, list):
            for item in table:
                walk(item, parent)
        elif isinstance(table, dict):
            for key, value in table.items():
                if parent not in own and key not in known:
                    unknown.add(key)
                walk(value, key if parent not in own else parent)

    walk(tomllib.loads(path.read_text("utf-8")), "")
    markers = {"free", "start", "above", "same_as", "sum_of", "rest", "free_levels"}
    assert unknown - markers == set()


@pytest.mark.parametrize("kind", FILE_KINDS)
def test_schemas_name_the_keys_of_the_rows(kind: str, rows: list[KeyRow]) -> None:
    text = (ROOT / "lmctl/reference/schemas" / f"{kind}.json").read_text("utf-8")
    schema = json.loads(text)
    found: dict[str, str] = {}

    def walk(table: dict[str, Any]) -> None:
        for key, value in table.get("properties", {}).items():
            found.setdefault(key, value.get("description", ""))
            walk(value.get("items", value))

    for table in (schema, *schema.get("$defs", {}).values()):
        walk(table)
    own = [row for row in rows
           if row.path.startswith(f"{kind}.") and row.type != KIND_OF_TABLE]
    assert {row.key for row in own} - found.keys() == set()
    assert [row.path for row in own if row.key != "kind" and not found[row.key]] == []


@pytest.mark.parametrize(
    "path", [*EXAMPLES.glob("bench*.toml"), *EXAMPLES.glob("feeder-*.toml"),
             *(ROOT / "firmware_protocol/maps").glob("*.toml")], ids=lambda path: path.stem)
def test_what_ships_is_what_its_schema_allows(path: Any) -> None:
    kind = "bench" if path.name.startswith("bench") else "map"
    schema = json.loads((ROOT / f"lmctl/reference/schemas/{kind}.json").read_text("utf-8"))
    types = {"object": dict, "array": list, "string": str, "number": int | float, "integer": int,
             "boolean": bool}

    def refused(value: Any, table: dict[str, Any], place: str) -> Iterator[str]:
        if "enum" in table and value not in table["enum"]:
            yield f"{place}: {value!r}"
        if "type" in table and not isinstance(value, types[table["type"]]):
            yield f"{place}: no {table['type']}"
        if isinstance(value, dict):
            known = table.get("properties", {})
            yield from (f"{place}.{key} is missing" for key in table.get("required", ())
                        if key not in value)
            for key, item in value.items():
                if key in known:
                    yield from refused(item, known[key], f"{place}.{key}")
                elif not table.get("additionalProperties", True):
                    yield f"{place}.{key} is not known"
        for item in value if isinstance(value, list) and "items" in table else ():
            yield from refused(item, table["items"], place)

    assert list(refused(tomllib.loads(path.read_text("utf-8")), schema, kind)) == []


def test_entries_of_a_docstring_are_told_from_other_sentences() -> None:
    class Table:
        """A table; first : of two. It is: not an entry.

        second, third : for
            both; fourth : in the same line
        fifth .. seventh : a range

        eighth: no entry, without a space
        """

    names = ["first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth"]
    assert docstring_entries(Table, names) == {
        "first": "of two. It is: not an entry", "second": "for both", "third": "for both",
        "fourth": "in the same line", **dict.fromkeys(("fifth", "sixth", "seventh"), "a range")}


@pytest.mark.parametrize("value", [True, 3, 2.5, -100_000, 'a "quoted" \\ text', [1, [2.0, 3.0]],
                                   {"316L": 0.5, "WC-12Co": {"a b": "c"}}])
def test_examples_are_toml(value: Any) -> None:
    assert tomllib.loads(f"value = {as_toml(value)}")["value"] == value


def test_examples_of_map_keys_are_possible(rows: list[KeyRow]) -> None:
    """Ways of [missing] are those that the reader takes."""
    missing = [row for row in rows if row.path.startswith("map.missing.")]
    assert len(missing) == 13
    with pytest.raises(ValueError, match="name: is missing") as refused:
        parse_map("[missing]\n" + "".join(f"{row.key} = {row.example}\n" for row in missing))
    assert "missing." not in "\n".join(
        line for line in str(refused.value).splitlines() if "must be" in line)
