"""Public names of a package that load their module only when they are asked for.

Importing a submodule therefore loads no sibling of it (PEP 562).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def exports_of(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """The `__getattr__` of a package.

    homes : for each public name the module that defines it
    The result raises AttributeError for a name that is not in `homes`.
    """

    def __getattr__(name: str) -> Any:  # noqa: N807 - the hook that PEP 562 names
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(homes[name]), name)

    return __getattr__
