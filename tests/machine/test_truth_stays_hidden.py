"""Self-measurement sees wires and hands only: no code of lmctl reads what the simulators hide."""

from __future__ import annotations

import sys
from dataclasses import fields
from typing import ClassVar

from simulators.feeder.config import HopperConfig
from simulators.operator import SimulatedOperator
from simulators.virtual_time import run_in_virtual_time
from tests.machine import measuring_cell

#: Particulars of a hopper that a test is to find out, or that would give them away.
HIDDEN = {field.name for field in fields(HopperConfig)} - {"channel"}


class WatchedHopper(HopperConfig):
    """A hopper's truth that notes who reads it."""

    readers: ClassVar[set[str]] = set()

    def __getattribute__(self, name: str):
        if name in HIDDEN:
            WatchedHopper.readers.add(str(sys._getframe(1).f_globals.get("__name__")))
        return super().__getattribute__(name)


def test_a_feeder_test_reads_no_truth(monkeypatch) -> None:
    truth = measuring_cell.TRUTH
    watched = WatchedHopper(**{field.name: getattr(truth, field.name)
                               for field in fields(HopperConfig)})
    monkeypatch.setattr(measuring_cell, "TRUTH", watched)
    monkeypatch.setattr(measuring_cell, "replace", lambda config, **_: config)
    WatchedHopper.readers.clear()

    async def whole():
        async with measuring_cell.measuring_cell() as cell:
            return await cell.test(limit_s=110.0).run()

    assert run_in_virtual_time(whole()).response.slope.value > 0
    readers = {name.partition(".")[0] for name in WatchedHopper.readers}
    assert "simulators" in readers  # else nothing was watched
    assert "lmctl" not in readers


def test_the_simulated_operator_offers_acts_and_nothing_else() -> None:
    assert {name for name in vars(SimulatedOperator) if not name.startswith("_")} == {
        "put_on_weight", "take_off_weight", "weigh_plate", "analyse_track", "measure_height"}
