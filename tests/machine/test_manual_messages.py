"""What is told at jogging, homing and looking when the controller does not do its part."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from importlib.resources import files
from types import SimpleNamespace
from typing import Any

import pytest

from lmctl.config.machine import load_profile
from lmctl.errors import MachineError
from lmctl.machine.manual.homing import unlock_controller, wait_for_report
from lmctl.machine.manual.inspect_motion import read_motion
from lmctl.machine.manual.jog import JogRequest, jog_axes
from simulators import virtual_time
from tests.error_facts import assert_states

LIMITS = load_profile(files("lmctl.examples") / "cell.toml").motion
BEAM_OFF = "[GC:G0 G54 M5 S0]"


class Controller:
    """A controller at a place in a state, which answers as it is told to, and then reports.

    reports : what the listener is called with after a jog, by the name of the callback
    """

    def __init__(
        self, state: str | None = "Idle", *, at_mm: Any = (10.0, 10.0, 20.0),
        parser_state: str = BEAM_OFF, reports: Mapping[str, tuple[Any, ...]] | None = None,
    ) -> None:
        self.status = None if state is None else SimpleNamespace(state=state, substate=1)
        self.position_mm, self.position_trusted = at_mm, True
        self.identity = SimpleNamespace(dialect=None)
        self.listener: Any = None
        self.sent: list[Any] = []
        self._parser_state, self._reports = parser_state, reports or {}

    async def send_command(self, line: str) -> list[str]:
        self.sent.append(line)
        if line.startswith("$J="):
            for name, values in self._reports.items():
                asyncio.get_running_loop().call_later(
                    0.1, lambda name=name, values=values: getattr(self.listener, name)(*values))
        elif line == "$X":
            asyncio.get_running_loop().call_later(0.1, lambda: self.listener.on_status(self.status))
        return [self._parser_state]

    def send_realtime(self, command: object) -> None:
        self.sent.append(command)

    async def reset(self) -> None:
        self.sent.append("reset")


def jogged(controller: Controller) -> Any:
    jog = JogRequest({"X": 5.0}, feed_mm_min=600.0, relative=True)
    return jog_axes(jog, controller, LIMITS)


@pytest.mark.parametrize(
    ("controller", "facts"),
    [
        (Controller("Run"), ("cannot jog in state Run", "wait until it has stopped")),
        (Controller("Alarm"), ("cannot jog in state Alarm", "lmctl machine unlock")),
        (Controller(None), ("cannot jog in state unknown",)),
        (Controller(at_mm=None), ("does not say where it is", "try again")),
        (Controller(parser_state="[GC:G0 G54 M4 S500]"),
         ("did not switch the beam off", "it says [GC:G0 G54 M4 S500]", "by hand")),
        (Controller(reports={"on_status": (SimpleNamespace(state="Idle", substate=None),)}),
         ("ended before it arrived", "X10.00 Y10.00 Z20.00", "stopped at its panel")),
        (Controller(reports={"on_lost": ("the cable was pulled",)}),
         ("the motion controller is lost: the cable was pulled", "cable and power")),
        (Controller(reports={"on_restart": ()}), ("controller restarted", "home it")),
        (Controller(), ("still moves after", "look at the machine")),
    ],
)
def test_a_jog_that_comes_to_nothing(controller: Controller, facts: tuple[str, ...]) -> None:
    with pytest.raises(MachineError) as refused:
        virtual_time.run_in_virtual_time(jogged(controller))
    assert_states(refused.value, *facts)


@pytest.mark.parametrize(
    ("act", "controller", "facts"),
    [
        (unlock_controller, Controller("Alarm"),
         ("stays in alarm", "cause remains", "lmctl machine doctor")),
        (wait_for_report, Controller(), ("motion controller is silent", "check its cable")),
        (read_motion, Controller(None), ("does not report its state", "check its cable")),
    ],
)
def test_a_controller_that_keeps_what_it_knows(
    act: Callable[..., Any], controller: Controller, facts: tuple[str, ...]
) -> None:
    with pytest.raises(MachineError) as refused:
        virtual_time.run_in_virtual_time(act(controller))
    assert_states(refused.value, *facts)
