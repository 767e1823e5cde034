"""Ctrl-C where compiled libraries have called Python back: neither dropped nor another error."""

from __future__ import annotations

import ctypes
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

from lmctl.cli.__main__ import main
from lmctl.cli.interrupts import interruptible
from lmctl.part.part import Part
from tests.cli.test_interrupts import BLOCK


def interrupt() -> None:
    signal.raise_signal(signal.SIGINT)


def interrupted_and_dropped() -> None:
    """ctypes prints what a callback raises, and drops it; so the kernels' compiler loses it."""
    ctypes.CFUNCTYPE(None)(interrupt)()


def interrupted_and_turned() -> None:
    """numpy says that it cannot compare structured arrays where its comparison is interrupted."""
    def look(frame: FrameType, event: str, argument: Any) -> None:
        if event == "call" and frame.f_code.co_name == "_promote_fields":
            sys.setprofile(None)
            interrupt()

    sys.setprofile(look)
    try:
        np.unique(np.zeros((3, 2)), axis=0)
    finally:
        sys.setprofile(None)
    raise AssertionError("numpy compares rows in another way now")


def test_one_that_is_dropped_ends_the_work_at_its_next_step(
    capfd: pytest.CaptureFixture[str]
) -> None:
    steps = []

    def work() -> None:
        with interruptible() as check:
            for step in range(3):
                check()
                steps.append(step)
                interrupted_and_dropped()

    with pytest.raises(KeyboardInterrupt):
        work()
    assert steps == [0]
    assert capfd.readouterr().err == ""


def test_one_that_is_dropped_in_the_last_step_counts_too() -> None:
    with pytest.raises(KeyboardInterrupt):
        interruptible()(interrupted_and_dropped)()


def test_one_that_comes_out_as_another_error_is_itself_again() -> None:
    with pytest.raises(TypeError):
        interrupted_and_turned()
    with pytest.raises(KeyboardInterrupt):
        interruptible()(interrupted_and_turned)()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_terminations_and_hang_ups_clean_up_too(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    cleaned = []

    @interruptible()
    def work() -> None:
        try:
            signal.raise_signal(number)
        finally:
            cleaned.append("half-written file")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert cleaned == ["half-written file"]
    assert signal.getsignal(number) is before


def test_a_hang_up_that_is_ignored_stays_ignored() -> None:
    """As under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        interruptible()(lambda: signal.raise_signal(signal.SIGHUP))()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_nothing_else_is_touched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Errors keep their kind, those that callbacks drop are reported, and all is as before."""
    reported: list[type[BaseException]] = []

    def report(dropped: sys.UnraisableHookArgs) -> None:
        reported.append(dropped.exc_type)

    monkeypatch.setattr(sys, "unraisablehook", report)
    handler = signal.getsignal(signal.SIGINT)

    def fail() -> None:
        raise ValueError("an error of a callback")

    @interruptible()
    def work() -> None:
        ctypes.CFUNCTYPE(None)(fail)()
        raise KeyError("an error of the work")

    with pytest.raises(KeyError):
        work()
    assert reported == [ValueError]
    assert sys.unraisablehook is report
    assert signal.getsignal(signal.SIGINT) is handler


def test_works_where_no_signal_can_be_taken() -> None:
    taken = []
    work = interruptible()(lambda: taken.append("done"))
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert taken == ["done"]


@pytest.mark.parametrize("interrupted", [interrupted_and_dropped, interrupted_and_turned])
@pytest.mark.parametrize("command", ["plan", "check", "show"])
def test_commands_end_interrupted(
    command: str, interrupted: Callable[[], None], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str],
) -> None:
    """In the middle of a part's sections, or of its picture."""
    (tmp_path / "part.toml").write_text(BLOCK.replace("120, 90, 40", "12, 9, 4"))
    monkeypatch.chdir(tmp_path)
    section = Part.section

    def interrupted_section(part: Part, *arguments: Any) -> Any:
        interrupted()
        return section(part, *arguments)

    monkeypatch.setattr(Part, "section", interrupted_section)
    monkeypatch.setattr("lmctl.report.part_picture.draw_part", lambda *_: interrupted())
    assert main([command, "part.toml"]) == 130
    talk = capfd.readouterr().err
    assert talk.endswith("interrupted\n")
    assert "Traceback" not in talk
    assert [path.name for path in tmp_path.iterdir()] == ["part.toml"]


def test_what_a_library_drops_on_the_way_out_of_an_interrupt_is_not_printed(monkeypatch):
    """A compiled library's finaliser that fails for the interrupt: it is no error of its own."""
    reported = []
    monkeypatch.setattr(sys, "unraisablehook", reported.append)

    class Finalised:
        def __del__(self):
            raise AttributeError("half torn down")

    @interruptible()
    def work():
        one = Finalised()
        del one
        assert len(reported) == 1  # before the interrupt it is reported as ever
        one = Finalised()
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            del one

    with pytest.raises(KeyboardInterrupt):
        work()
    assert len(reported) == 1
