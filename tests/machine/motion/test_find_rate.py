"""A silent motion controller is looked for at other rates of its serial port, over ptys."""

from __future__ import annotations

import os
import termios
from importlib.resources import files

from lmctl.config.machine import load_profile
from lmctl.machine.manual.rate_search import find_baud_rate
from lmctl.machine.motion.endpoint import parse_motion_endpoint
from lmctl.run.cell.doctor import check_inspection, inspect_cell
from simulators import virtual_time
from simulators.pty_transport import PtyTransport

_SPEEDS = {termios.B9600: 9600, termios.B19200: 19200, termios.B38400: 38400,
           termios.B57600: 57600, termios.B115200: 115200}


def rate_of(path):
    """How the host has set the line that ends at a pty."""
    line = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        return _SPEEDS.get(termios.tcgetattr(line)[4], -1)
    finally:
        os.close(line)


class Controller:
    """Answers `?` at one rate, and is silent at every other."""

    def __init__(self, rate):
        self.rate, self.line = rate, None  # the line is a pty, made with this as its receiver

    def data_received(self, data):
        if rate_of(self.line.path) == self.rate:
            self.line.write(b"<Idle|WPos:0.000,0.000,0.000|FS:0,0>\r\n" * data.count(b"?"))


def test_the_rate_of_a_controller_is_found():
    async def main(rate):
        controller = Controller(rate)
        controller.line = PtyTransport(controller)
        found = await find_baud_rate(parse_motion_endpoint(f"serial://{controller.line.path}"),
                                     9600)
        controller.line.close()
        return found

    assert virtual_time.run_in_virtual_time(main(115_200)) == 115_200
    assert virtual_time.run_in_virtual_time(main(38_400)) == 38_400
    assert virtual_time.run_in_virtual_time(main(None)) is None


def test_doctor_says_at_which_rate_a_silent_controller_answers(tmp_path):
    async def main(rate):
        controller = Controller(rate)
        controller.line = PtyTransport(controller)
        profile = load_profile(files("lmctl.examples") / "cell.toml")
        motion = profile.motion.model_copy(
            update={"endpoint": f"serial://{controller.line.path}", "baud": 9600})
        profile = profile.model_copy(update={"motion": motion})
        found = check_inspection(await inspect_cell(profile, tmp_path, search=True), profile)
        controller.line.close()
        return found["motion"]

    (found,) = virtual_time.run_in_virtual_time(main(115_200))
    assert "a Grbl answers there at 115200 baud, and 9600 is set" in found.text
    assert found.hint == "set motion.baud = 115200 in the machine profile"
    (none,) = virtual_time.run_in_virtual_time(main(None))
    assert "nor does a Grbl answer at another usual rate" in none.text
