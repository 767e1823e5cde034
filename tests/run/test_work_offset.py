"""Work offsets that a reset would forget, by what a controller says of them."""

from __future__ import annotations

import asyncio

import pytest

from lmctl.errors import MachineError
from lmctl.run.cell.work_offset import persistent_work_offset, refuse_changed_offset


class Controller:
    """Answers `$G` and `$#` as Grbl does."""

    def __init__(self, system="G54", tool="0.000", **offsets):
        self.system, self.tool, self.offsets = system, tool, offsets

    async def send_command(self, line):
        if line == "$G":
            return [f"[GC:G0 {self.system} G17 G21 G90 G94 M5 M9 T0 F0 S0]"]
        said = [f"[{name}:{self.offsets.get(name, '0.000,0.000,0.000')}]"
                for name in ("G54", "G55", "G59", "G28", "G30", "G92")]
        return [*said, f"[TLO:{self.tool}]", "[PRB:0.000,0.000,0.000:0]"]


def offset(controller):
    return asyncio.run(persistent_work_offset(controller))


def test_what_g54_holds_is_the_work_offset():
    assert offset(Controller(G54="1.500,-2.000,3.000", G55="9.000,9.000,9.000")) == (1.5, -2.0, 3.0)


@pytest.mark.parametrize(("controller", "words"), [
    (Controller("G55"), ["those of G55"]),
    (Controller("G59.3"), ["those of G59.3"]),
    (Controller(G92="-5.000,0.000,0.000"), ["G92"]),
    (Controller(tool="2.000"), ["tool length"]),
    (Controller(tool="0.000,0.000,-0.010"), ["tool length"]),
    (Controller("G56", G92="0.000,0.000,1.000"), ["those of G56", "an offset by G92"]),
])
def test_what_a_reset_would_change_is_refused_with_what_mends_it(controller, words):
    with pytest.raises(MachineError) as refused:
        offset(controller)
    reasons = [refused.value.what, *refused.value.where]
    assert len(reasons) == len(words)
    assert all(word in reason for word, reason in zip(words, reasons, strict=True))
    assert "`lmctl machine offset --clear`" in refused.value.hint


def test_an_offset_that_has_changed_is_distinguished_from_rounding():
    controller = Controller(G54="1.500,-2.000,3.000")
    asyncio.run(refuse_changed_offset(controller, (1.501, -2.0, 3.0)))
    with pytest.raises(MachineError, match="has changed") as refused:
        asyncio.run(refuse_changed_offset(controller, (1.5, -2.0, 3.1)))
    assert refused.value.where == ("it is 1.5, -2, 3 mm, and was 1.5, -2, 3.1 mm",)
