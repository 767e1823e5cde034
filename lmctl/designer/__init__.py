"""The designer: a part file's bodies, features and mixtures moved in a page of this machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.designer.design_session import DesignSession as DesignSession
    from lmctl.designer.server import run_designer as run_designer

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "DesignSession": "lmctl.designer.design_session",
    "run_designer": "lmctl.designer.server",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
