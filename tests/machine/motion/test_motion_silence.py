"""What comes instead of a status report is said, so that each fault of a link reads differently."""

from __future__ import annotations

import itertools

import pytest

from firmware_protocol.dialect import GRBL
from lmctl.errors import MachineError
from lmctl.machine.manual.inspect_motion import inspect_controller
from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.motion.observation import ControllerObservation

#: 115,200 baud read at 9,600, and the other way round, look like this: few bytes are text.
GARBAGE = bytes((0xF8, 0x80, 0x00, 0x1C, 0x3F, 0xE3, 0x9F, 0x00))


def refusal(run, device, wire, how) -> MachineError:
    async def main() -> None:
        async with device.on_tcp() if wire == "tcp" else device.on_pty(wire) as endpoint:
            if how == "open":
                await MotionDriver.open(endpoint, baud=9600, status_period_s=0.1)
            else:
                await inspect_controller(endpoint, baud=9600)

    with pytest.raises(MachineError) as refused:
        run(main())
    return refused.value


def answering(controller, answer):
    """A controller that answers every third `?` so, whatever it is."""
    device = controller(GRBL)
    questions = itertools.count()

    def feed(data):
        for byte in data:
            if byte == ord("?") and next(questions) % 3 == 0:
                device.write(answer)

    device.feed = feed
    return device


CASES = {
    "dead cable": (b"", "is silent: no byte came back",
                   {"serial": "TX and RX", "tcp": "most serve one at a time"}),
    "echo": (b"?", "only the echo of what was sent",
             {"serial": "bridge between TX and RX", "tcp": "bridge between TX and RX"}),
    "wrong baud rate": (GARBAGE, "of them no text, such as f8 80 00 1c 3f",
                        {"serial": "9600 was tried", "tcp": "serial server's baud rate"}),
    "another device": (b"echo:Marlin 2.1\r\n", "is not a Grbl controller: 'echo:Marlin 2.1",
                       {"serial": "something else is at that port", "tcp": "something else"}),
    "no power": (b"\r\nGrbl 1.1h ['$' for help]\r\n", "restarted 70 times",
                 {"serial": "power supply", "tcp": "power supply"}),
    "another version": (b"[MSG:hello]\r\n", "sends messages, and no status report: '[MSG:hello]",
                        {"serial": "version of the firmware", "tcp": "version"}),
}


@pytest.mark.parametrize("wire", ["tcp", "serial"])
@pytest.mark.parametrize("how", ["open", "look"])
@pytest.mark.parametrize(("answer", "what", "hints"), CASES.values(), ids=CASES)
def test_each_kind_of_silence_reads_differently(
    controller, in_virtual_time, answer, what, hints, wire, how
):
    error = refusal(in_virtual_time, answering(controller, answer), wire, how)
    assert what in error.what
    assert hints[wire] in error.hint
    others = [words for words in (case[1] for case in CASES.values()) if words != what]
    assert not any(words in error.what for words in others)


def test_a_damaged_byte_on_a_good_line_is_no_wrong_baud_rate():
    seen = ControllerObservation(is_serial=True, baud=115_200)
    seen.on_data(b"<Idle|WPos:0.000,0.000,0.000|Bf:1\xff,1023")
    assert "another baud rate" not in seen.diagnose_missing_report()[0]
