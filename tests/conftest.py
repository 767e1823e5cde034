"""What every test has in common: it does not wait for what none of them is about."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator

import pytest


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Thousands of tests and their libraries stay to the end: no collector looks at them again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(autouse=True, scope="session")
def _no_power_cuts() -> Iterator[None]:
    """Files are written as ever, but nobody waits until the disk has them.

    A process that is killed loses nothing of what it has written; only a machine that loses power
    does, and no test can show that.
    """

    def written(descriptor: int) -> None:
        os.fstat(descriptor)  # a closed one is refused as ever

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", written)
        patch.setattr(os, "fdatasync", written)
        yield
