"""Which wire the drivers of feeders are tested over."""

from __future__ import annotations

import pytest

from simulators.feeder.server import serve_pty, serve_tcp
from tests.machine.feeder_cell import SERVING


@pytest.fixture(params=["tcp", "rtu"])
def wire(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Either wire, for what `feeder_cell` serves."""
    monkeypatch.setitem(SERVING, "by", serve_tcp if request.param == "tcp" else serve_pty)
    return request.param
