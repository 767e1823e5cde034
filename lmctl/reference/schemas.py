"""JSON schemas of the files, for editors that complete keys; made from models or from rows."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel

from lmctl.reference.key_row import FILE_KINDS, KIND_OF_TABLE, KeyRow
from lmctl.reference.model_rows import docstring_entries

_DRAFT = "https://json-schema.org/draft/2020-12/schema"

#: In place of a number of a part, for `lmctl optimise`.
_FREE_NUMBER = {
    "type": "object",
    "description": "a number that `lmctl optimise` chooses: free = [low, high] with start, or "
                   "same_as, sum_of, rest",
    "anyOf": [{"required": [key]} for key in ("free", "same_as", "sum_of", "rest", "free_levels")],
}


def schema_of_model(
    model: type[BaseModel], title: str, *, free_numbers: bool = False
) -> dict[str, Any]:
    """The schema of a pydantic model, with the meanings of its docstrings.

    free_numbers : tables may stand where numbers do
    """
    schema = model.model_json_schema()
    models = {one.__name__: one for one in _models(model, {})}
    for name, table in [*schema.get("$defs", {}).items(), (model.__name__, schema)]:
        texts = _texts(models[name]) if name in models else {}
        for key, value in table.get("properties", {}).items():
            value.pop("title", None)
            if text := texts.get(key):
                value["description"] = text
        table["description"] = str(table.get("description", "")).partition("\n")[0]
    if free_numbers:
        schema["$defs"]["FreeNumber"] = _FREE_NUMBER
        for name in ("Composition", *schema["$defs"]):
            if name.endswith(("Profile", "TablePoint", "ShellBody")):
                _allow_free_numbers(schema["$defs"][name])
    schema = {"$schema": _DRAFT, **schema, "title": title}
    schema["properties"]["$schema"] = {"type": "string"}
    return schema


def _texts(model: type[BaseModel]) -> dict[str, str]:
    """What a model's docstring says of each key, by the name that files know it by."""
    texts = docstring_entries(model)
    return {field.alias or name: texts[name] for name, field in model.model_fields.items()
            if name in texts}


def schema_of_rows(rows: Iterable[KeyRow], kind: str) -> dict[str, Any]:
    """The schema of a file whose keys are known as rows. Keys of kinds of tables are joined."""
    schema: dict[str, Any] = {"$schema": _DRAFT, "title": FILE_KINDS[kind], "type": "object",
                              "properties": {}, "additionalProperties": False}
    own = [row for row in rows
           if row.path.startswith(f"{kind}.") and row.type != KIND_OF_TABLE]
    tables: dict[str, dict[str, Any]] = {kind: schema}
    for row in own:
        parent, _, key = row.path.rpartition(".")
        if parent not in tables:  # the kind of a table
            parent = parent.rpartition(".")[0]
        value = _value(row)
        value["description"] = row.text
        table = tables[parent]
        table["properties"].setdefault(key, value)
        if row.is_required and parent == row.path.rpartition(".")[0]:
            table.setdefault("required", []).append(key)
        inner = value.get("items", value)
        if inner.get("type") == "object":
            inner.setdefault("properties", {})
            tables[row.path] = inner
            if row.same_as:
                inner |= {key: part for key, part in tables[row.same_as].items()
                          if key != "description"}
            inner["additionalProperties"] = not inner["properties"]
    for path, table in tables.items():
        if path != kind:
            table["additionalProperties"] = not table["properties"] or path.endswith(
                ("settings", "bits", "codes"))
    return schema


def _value(row: KeyRow) -> dict[str, Any]:
    if row.type == "list of tables":
        return {"type": "array", "items": {"type": "object"}}
    if row.type == "table":
        return {"type": "object"}
    if row.allowed.startswith('"'):
        return {"enum": re.findall(r'"([^"]*)"', row.allowed)}
    if row.type == "number":
        return {"type": "number"} | _limits(row.allowed)
    if row.type == "whole number":
        return {"type": "integer"} | _limits(row.allowed)
    return {"text": {"type": "string"}, "true or false": {"type": "boolean"}}.get(row.type, {})


def _limits(allowed: str) -> dict[str, float]:
    found = {}
    for word, key in (("from", "minimum"), ("above", "exclusiveMinimum"), ("to", "maximum")):
        if match := re.search(rf"\b{word} (-?[\d.][\d. ]*(?:e[+-]?\d+)?)", allowed):
            found[key] = float(match[1].replace(" ", ""))
    return found


def _allow_free_numbers(schema: Any) -> None:
    """Let a reference to a free number stand beside each number of a schema."""
    if isinstance(schema, list):
        for item in schema:
            _allow_free_numbers(item)
    elif isinstance(schema, dict):
        for item in schema.values():
            _allow_free_numbers(item)
        if schema.get("type") in ("number", "array") and "anyOf" not in schema:
            plain = {key: schema.pop(key) for key in list(schema)
                     if key not in ("description", "default")}
            schema["anyOf"] = [plain, {"$ref": "#/$defs/FreeNumber"}]


def _models(
    model: type[BaseModel], found: dict[type[BaseModel], None]
) -> dict[type[BaseModel], None]:
    if model not in found:
        found[model] = None
        for field in model.model_fields.values():
            open_ones: list[Any] = [field.annotation]
            while open_ones:
                one = open_ones.pop()
                if isinstance(one, type) and issubclass(one, BaseModel):
                    _models(one, found)
                open_ones += getattr(one, "__args__", ())
    return found
