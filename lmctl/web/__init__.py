"""The live page of a folder of runs, and doors for other programs: REST, metrics, SHDR, OPC UA."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.web.access import AccessPolicy as AccessPolicy
    from lmctl.web.access import access_policy as access_policy
    from lmctl.web.run_catalogue import RunCatalogue as RunCatalogue
    from lmctl.web.server import DashSettings as DashSettings
    from lmctl.web.server import run_dash as run_dash

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "AccessPolicy": "lmctl.web.access",
    "DashSettings": "lmctl.web.server",
    "RunCatalogue": "lmctl.web.run_catalogue",
    "access_policy": "lmctl.web.access",
    "run_dash": "lmctl.web.server",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
