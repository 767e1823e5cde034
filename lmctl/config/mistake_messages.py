"""Plain messages for mistakes in a configuration, in place of the validation library's own."""

from __future__ import annotations

from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from lmctl.config.materials import suggest_name

#: By the library's own name of the mistake; {…} is the limit that was broken, as it reports it.
_WORDS = {
    "missing": "is missing",
    "greater_than": "must be above {gt}",
    "greater_than_equal": "must be at least {ge}",
    "less_than": "must be below {lt}",
    "less_than_equal": "must be at most {le}",
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "bool_type": "must be true or false",
    "string_type": "must be text in quotes",
    "string_too_short": "must not be empty",
    "string_too_long": "must be at most {max_length} characters long",
    "tuple_type": "must be a list in [ ]",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "too_long": "takes {max_length}, there are {actual_length}",
    "literal_error": "must be {expected}",
    "union_tag_not_found": "says no `kind`",
    "union_tag_invalid": "there is no kind {tag!r}; there are {expected_tags}",
}


def describe_mistake(mistake: ErrorDetails, model: type[BaseModel]) -> str:
    """One mistake that was found when data was checked against `model`."""
    kind, context = mistake["type"], mistake.get("ctx", {})
    if kind == "extra_forbidden":
        *table, key = mistake["loc"]
        guess = suggest_name(str(key), _keys_at(model, table))
        return "there is no such key" + (f"; {guess}" if guess else "")
    if kind == "too_short":
        least = context["min_length"]
        return "at least one is needed" if least == 1 else (
            f"takes at least {least}, there are {context['actual_length']}")
    if kind in _WORDS:
        return _WORDS[kind].format_map({name: _plain(value) for name, value in context.items()})
    return mistake["msg"].removeprefix("Value error, ")


def _plain(value: Any) -> Any:
    """A limit without superfluous digits and exponent."""
    return f"{value:.10g}" if isinstance(value, float) else value


def _keys_at(model: type[BaseModel], place: list[int | str]) -> list[str]:
    """The keys of the table at a place, which is as the library names it."""
    kinds: list[Any] = [model]
    for step in place:
        kinds = _below(kinds, step)
    return [field.alias or key for kind in _models(kinds)
            for key, field in kind.model_fields.items()]


def _below(kinds: list[Any], step: int | str) -> list[Any]:
    """What may come one step further into a value that is of one of some kinds."""
    if isinstance(step, int):  # into a list, whose items are all of a kind where they are tables
        return [of for kind in kinds for of in _kinds(next(iter(get_args(kind)), None))]
    models = _models(kinds)
    if len(models) > 1:  # the step selects one of them, as the value's own `kind` does
        return [m for m in models if step in get_args(m.model_fields["kind"].annotation)]
    return [of for m in models for key, field in m.model_fields.items()
            if step == (field.alias or key) for of in _kinds(field.annotation)]


def _kinds(annotation: Any) -> list[Any]:
    """The kinds that an annotation leaves to choose from."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _kinds(get_args(annotation)[0])
    if origin in (Union, UnionType):
        return [of for choice in get_args(annotation) for of in _kinds(choice)]
    return [annotation]


def _models(kinds: list[Any]) -> list[type[BaseModel]]:
    return [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)]
