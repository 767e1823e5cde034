"""Keys of an endpoint, behind its `?`: read together, and refused by name where they are wrong."""

from __future__ import annotations

from collections.abc import Mapping
from urllib.parse import parse_qsl

from lmctl.errors import ConfigError


def endpoint_keys(text: str, query: str, valid: Mapping[str, str], instead: str) -> dict[str, str]:
    """The keys of an endpoint by name.

    text : the whole endpoint; query : what follows its `?`
    valid : keys it may have, each with its values in words
    instead : what to do where it takes none
    Raises ConfigError: for keys that are unknown, given twice or without a value, each by name,
    with the valid ones.
    """
    given = parse_qsl(query, keep_blank_values=True)
    names = [name for name, _ in given]
    wrong = [f"unknown key {name!r}" for name in dict.fromkeys(names) if name not in valid]
    wrong += [f"key {name!r} is given twice" for name in dict.fromkeys(names)
              if names.count(name) > 1]
    wrong += [f"key {name!r} has no value" for name, value in given if not value and name in valid]
    if query and not given:
        wrong.append(f"{query!r} is no key=value")
    if wrong:
        raise endpoint_key_error(text, "; ".join(wrong), valid, instead)
    return dict(given)


def endpoint_key_error(
    text: str, wrong: str, valid: Mapping[str, str], instead: str = ""
) -> ConfigError:
    """That something behind the `?` will not do, with the keys and values that will."""
    known = ", ".join(f"{name}={values}" for name, values in valid.items())
    return ConfigError(
        f"{text!r} is not an endpoint: {wrong}",
        hint=f"valid keys behind the ?: {known}" if valid else f"it takes no keys; {instead}",
    )
