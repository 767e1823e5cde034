"""What every key of every file means, made from the models: for help, schemas and documents."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.reference.key_row import FILE_KINDS as FILE_KINDS
    from lmctl.reference.key_row import KeyRow as KeyRow
    from lmctl.reference.key_rows import load_key_rows as load_key_rows
    from lmctl.reference.key_rows import rows_under as rows_under

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "FILE_KINDS": "lmctl.reference.key_row",
    "KeyRow": "lmctl.reference.key_row",
    "load_key_rows": "lmctl.reference.key_rows",
    "rows_under": "lmctl.reference.key_rows",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
