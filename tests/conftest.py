"""What every test has in common: it does not wait for what none of them is about."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings

#: Tests run side by side already; more threads for small matrices only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

#: A failing run is caused by the change under test, not by an example that is new to this run.
#: `pytest --hypothesis-profile random` searches at random and prints how to repeat what it finds.
settings.register_profile("same examples", derandomize=True)
settings.register_profile("random", print_blob=True)
settings.load_profile("same examples")


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
    """Files are written as usual, but without waiting for the disk.

    A process that is killed loses nothing of what it has written; only a machine that loses power
    does, and no test can show that.
    """

    def written(descriptor: int) -> None:
        os.fstat(descriptor)  # a closed one is refused as ever

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", written)
        patch.setattr(os, "fdatasync", written)
        yield


@pytest.fixture(autouse=True, scope="session")
def _at_a_terminal() -> Iterator[None]:
    """Ctrl-C and hang-ups reach the tests and the programs they start.

    Whoever starts the tests in the background may have them ignored, and that is inherited.
    """
    wanted = {signal.SIGINT: signal.default_int_handler, signal.SIGHUP: signal.SIG_DFL}
    before = {number: signal.signal(number, handler) for number, handler in wanted.items()}
    yield
    for number, was in before.items():
        signal.signal(number, was)
