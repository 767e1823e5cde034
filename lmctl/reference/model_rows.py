"""Rows of keys from pydantic models: types and limits from the fields, meanings from docstrings.

A docstring says `key : text`, or `key, other : text` for several; `first .. last : text` speaks of
all fields from the first to the last.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from lmctl.reference.key_row import KIND_OF_TABLE, KeyRow, as_toml, unit_of_key

#: The keys of an entry: at the beginning of a line, or of a sentence within one.
_ENTRY = re.compile(r"(?:^|(?<=\n)|(?<=[;.:] ))[ \t]*(\w+(?:(?:, | \.\. )\w+)*) : ")


def model_rows(
    model: type[BaseModel], path: str, homes: dict[type[BaseModel], str] | None = None
) -> Iterator[KeyRow]:
    """A row for every key of a model and of those within it; path : of the table.

    homes : where models have their rows; a model that comes again refers to the first place
    """
    homes = {} if homes is None else homes
    texts = docstring_entries(model)
    for name, field in model.model_fields.items():
        key = field.alias or name
        yield from _field_rows(key, field, f"{path}.{key}", texts.get(name, ""), homes)


def _field_rows(
    name: str, field: FieldInfo, path: str, text: str, homes: dict[type[BaseModel], str]
) -> Iterator[KeyRow]:
    shape = _Shape.of(field)
    models = shape.models
    first = homes.get(models[0]) if models else None
    yield KeyRow(path, shape.words, unit_of_key(name), _default(field), field.is_required(),
                 shape.allowed, "", text, first or "")
    if first is not None or not models:
        return
    homes |= dict.fromkeys(models, path)
    if len(models) == 1:
        yield from model_rows(models[0], path, homes)
        return
    # Tables of several kinds: keys that all have come once, then those of each kind.
    shared = {key for key in models[0].model_fields
              if all(key in one.model_fields for one in models)
              and len({str(one.model_fields[key].annotation) for one in models}) == 1}
    kinds = [kind for one in models for kind in _kinds(one)]
    yield KeyRow(f"{path}.kind", "text", "", "", True, ", ".join(map(as_toml, kinds)), "",
                 "which kind it is, and so which keys it has", "")
    for one in models:
        texts = docstring_entries(one)
        for key, inner in one.model_fields.items():
            if key in shared and one is models[0] and key != "kind":
                yield from _field_rows(key, inner, f"{path}.{key}", texts.get(key, ""), homes)
        for kind in _kinds(one):
            yield KeyRow(f"{path}.{kind}", KIND_OF_TABLE, "", "", False, "", "",
                         (one.__doc__ or "").partition("\n")[0].rstrip("."), "")
            for key, inner in one.model_fields.items():
                if key not in shared and key != "kind":
                    yield from _field_rows(
                        key, inner, f"{path}.{kind}.{key}", texts.get(key, ""), homes)


def docstring_entries(documented: Any, names: Sequence[str] = ()) -> dict[str, str]:
    """What a class (its bases first) or a function says of each key in its docstring.

    names : of the keys; () takes the fields of the class
    """
    found: dict[str, str] = {}
    places = reversed(documented.__mro__) if isinstance(documented, type) else [documented]
    for place in places:
        if "__doc__" in vars(place) or place is documented:
            found |= _entries(place.__doc__ or "", list(names) or _names(documented))
    return found


def _entries(doc: str, names: list[str]) -> dict[str, str]:
    """The entries of one docstring: each goes to the next, or to an empty line."""
    found: dict[str, str] = {}
    for paragraph in re.split(r"\n[ \t]*\n", doc):
        begins = [match for match in _ENTRY.finditer(paragraph)
                  if set(re.split(r", | \.\. ", match[1])) <= set(names)]
        if not begins:
            continue
        ends = [match.start() for match in begins[1:]] + [len(paragraph)]
        for match, end in zip(begins, ends, strict=True):
            text = " ".join(paragraph[match.end() : end].split()).rstrip(".;")
            text = re.sub(r"\bNone\b", "left out", text)  # a file has no None
            found |= dict.fromkeys(_keys(match[1], names), text)
    return found


def _keys(text: str, names: list[str]) -> list[str]:
    """The keys that an entry begins with."""
    found: list[str] = []
    for part in text.split(", "):
        first, dots, last = part.partition(" .. ")
        found += names[names.index(first) : names.index(last) + 1] if dots else [part]
    return found


def _names(documented: Any) -> list[str]:
    fields = getattr(documented, "model_fields", None) or getattr(
        documented, "__dataclass_fields__", {})
    return list(fields)


class _Shape(NamedTuple):
    """words : the type; allowed : limits and choices in words; models : of the tables within"""

    words: str
    allowed: str
    models: tuple[type[BaseModel], ...]

    @classmethod
    def of(cls, field: FieldInfo) -> _Shape:
        shape = _shape(field.annotation)
        limits = _limits(field.metadata)
        return shape._replace(allowed=" ".join(filter(None, (shape.allowed, limits))).strip())


def _shape(annotation: Any) -> _Shape:
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        shape = _shape(inner[0])
        limits = _limits([item for part in inner[1:] for item in _constraints(part)])
        return shape._replace(allowed=" ".join(filter(None, (shape.allowed, limits))))
    if origin in (Union, UnionType):
        shapes = [_shape(one) for one in inner if one is not NoneType]
        models = tuple(model for shape in shapes for model in shape.models)
        types = list(dict.fromkeys(shape.words for shape in shapes))
        allowed = list(dict.fromkeys(shape.allowed for shape in shapes if shape.allowed))
        return _Shape(" or ".join(types), "; or ".join(allowed), models)
    if origin is Literal:
        texts = all(isinstance(one, str) for one in inner)
        return _Shape("text" if texts else "whole number", ", ".join(map(as_toml, inner)), ())
    if origin is tuple:
        if len(inner) == 2 and inner[1] is Ellipsis:
            shape = _shape(inner[0])
            return _Shape("list of tables" if shape.models else f"list of {_plural(shape.words)}",
                          shape.allowed, shape.models)
        shape = _shape(inner[0])
        return _Shape(f"list of {len(inner)} {_plural(shape.words)}", shape.allowed, shape.models)
    if origin is dict:
        shape = _shape(inner[1])
        named = "table by name" if shape.models else f"table of {_plural(shape.words)} by name"
        return _Shape(named, shape.allowed, shape.models)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return _Shape("table", "", (annotation,))
    return _Shape(_WORDS.get(annotation, str(annotation)), "", ())


_WORDS: dict[Any, str] = {
    float: "number", int: "whole number", str: "text", bool: "true or false",
}


def _plural(kind: str) -> str:
    """Several of a kind: of lists, the first word takes the ending."""
    first, of, rest = kind.partition(" of ")
    return f"{first}s{of}{rest}"


def _constraints(part: Any) -> list[Any]:
    return part.metadata if isinstance(part, FieldInfo) else [part]


def _limits(metadata: list[Any]) -> str:
    """Limits in words, those that are 0 or 1 character long left out."""
    words = []
    for item in metadata:
        for key, text in (("ge", "from {}"), ("gt", "above {}"), ("le", "to {}"),
                          ("lt", "below {}")):
            if (limit := getattr(item, key, None)) is not None:
                words.append(text.format(f"{limit:,.10g}".replace(",", " ")))
        least = getattr(item, "min_length", None)
        if least is not None and least > 1:
            words.append(f"(at least {least})")
    return " ".join(words)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return ""
    value = field.default
    if value is PydanticUndefined and field.default_factory is not None:
        value = field.default_factory()  # type: ignore[call-arg]
    if value is None or isinstance(value, BaseModel) or value in ((), {}):
        return ""
    if isinstance(value, tuple) and any(isinstance(one, BaseModel) for one in value):
        return ""
    return as_toml(value)


def _kinds(model: type[BaseModel]) -> tuple[str, ...]:
    """The values of `kind` that select a model among others."""
    kind = model.model_fields.get("kind")
    return () if kind is None else tuple(get_args(kind.annotation))
