"""Modbus answers that arrive damaged: an answer is the device's own or it is none.

RTU frames carry a checksum, so that nothing wrong may pass there. Modbus TCP has none of its own
(TCP has one): a flipped register value passes, but no crash, no hang and no wrong number of values
may come of it. In virtual time, so that time-outs cost nothing.
"""

import asyncio
import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.config.modbus_device import ModbusDevice
from lmctl.errors import MachineError
from lmctl.machine.modbus.client import ModbusLink
from simulators import virtual_time
from simulators.faults.link_tap import LinkTap
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.server import FeederRegisters
from simulators.modbus_server import serve_pty, serve_tcp

CONFIG = FeederConfig("F1", (HopperConfig(1, "316L", 0.008, 0.7, 3.0, 1.0, 2.0, 0.3, 30.0, 1e3),))
TIMEOUT_S = 0.2
WORDS = [0x1234, 0xABCD, 7]

wires = pytest.mark.parametrize("wire", ["tcp", "rtu"])


class Damage:
    """A filter of an edge that makes other chunks of the next chunk."""

    def __init__(self) -> None:
        self.change = None

    def __call__(self, data, deliver) -> None:
        change, self.change = self.change, None
        for chunk in [data] if change is None else change(data):
            deliver(chunk)


def under_damage(wire: str, act):
    """Run act(link, damage, direction...) against the simulated feeder, which holds WORDS."""
    complaints = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: complaints.append(context))
        edge, to_host, to_device = LinkTap(), Damage(), Damage()
        edge.add_filter("to_host", to_host)
        edge.add_filter("to_device", to_device)
        device = PmxFeederDevice(CONFIG, loop.time)
        serve = serve_tcp if wire == "tcp" else serve_pty
        server = await serve(FeederRegisters(device), edge=edge)
        link = await ModbusLink.open(
            ModbusDevice(endpoint=server.endpoint, device_id=1), timeout_s=TIMEOUT_S)
        try:
            await link.write(20, WORDS)
            await act(link, to_host, to_device)
        finally:
            await link.close()
            await server.close()

    virtual_time.run_in_virtual_time(main())
    assert complaints == []


async def asked(link: ModbusLink) -> list[int] | None:
    """The registers as answered, or None; never later than its time, whatever comes."""
    loop = asyncio.get_running_loop()
    begun_s = loop.time()
    try:
        return list(await link.read_holding(20, len(WORDS)))
    except MachineError:
        return None
    finally:
        # A serial line waits out what may still come of the last answer, then the answer's time.
        assert loop.time() - begun_s <= 2 * TIMEOUT_S + 0.2


async def recovers(link: ModbusLink, tries: int = 8) -> None:
    """Within a few requests the device's own answer is back."""
    for _ in range(tries):
        if await asked(link) == WORDS:
            return
        await asyncio.sleep(1.0)
    pytest.fail("it never answered again")


async def written_again(link: ModbusLink) -> None:
    """Within a few requests a write is taken, and stands."""
    for _ in range(8):
        try:
            await link.write(20, WORDS)
        except MachineError:
            await asyncio.sleep(1.0)
        else:
            assert await asked(link) == WORDS
            return
    pytest.fail("it never took a write again")


@wires
def test_every_bit_of_an_answer_flipped(wire):
    async def act(link, to_host, _):
        for at, bit in itertools.product(range(9 if wire == "tcp" else 11), range(8)):
            def flip(data, at=at, bit=bit):
                damaged = bytearray(data)
                damaged[at % len(data)] ^= 1 << bit
                return [bytes(damaged)]

            to_host.change = flip
            found = await asked(link)
            if wire == "rtu":
                assert found is None
            else:  # beyond the header it is a value, which no check covers
                assert found is None or len(found) == len(WORDS)
                assert found is None or found == WORDS or at >= 2
            await recovers(link)

    under_damage(wire, act)


@wires
def test_an_answer_cut_at_every_byte_and_the_rest_that_comes_late_or_never(wire):
    async def act(link, to_host, _):
        for at, late in itertools.product(range(1, 11), (False, True)):
            rests = []

            def cut(data, at=at, rests=rests):
                rests.append(data[at:])
                return [data[:at]]

            to_host.change = cut
            assert await asked(link) is None
            if late:
                to_host.change = lambda data, rests=rests: [rests[0], data]
            assert await asked(link) in (WORDS, None)
            await recovers(link)

    under_damage(wire, act)


@wires
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_answers_chopped_repeated_dropped_and_mixed_with_noise(wire, data):
    rounds = data.draw(st.lists(st.tuples(
        st.lists(st.integers(1, 12), max_size=4),          # where it is chopped
        st.lists(st.integers(0, 4), min_size=1, max_size=6),  # which pieces come, in which order
        st.binary(max_size=12),                            # noise before
    ), min_size=1, max_size=8))

    async def act(link, to_host, _):
        for places, order, noise in rounds:
            def mangle(answer, places=places, order=order, noise=noise):
                edges = [0, *sorted(min(place, len(answer)) for place in places), len(answer)]
                pieces = [answer[a:b] for a, b in itertools.pairwise(edges)]
                return [noise, *(pieces[at % len(pieces)] for at in order)]

            to_host.change = mangle
            found = await asked(link)
            assert found is None or len(found) == len(WORDS)
            if wire == "rtu":
                assert found in (None, WORDS)
        await recovers(link)

    under_damage(wire, act)


@wires
def test_every_bit_of_a_request_flipped_writes_nothing_by_rtu_and_leaves_tcp_usable(wire):
    async def act(link, _, to_device):
        for at, bit in itertools.product(range(13), range(8)):
            def flip(data, at=at, bit=bit):
                damaged = bytearray(data)
                damaged[at % len(data)] ^= 1 << bit
                return [bytes(damaged)]

            to_device.change = flip
            acknowledged = True
            try:
                await link.write(20, [0x5555])
            except MachineError:
                acknowledged = False
            if wire == "rtu":
                assert not acknowledged
                # A device that goes by the length waits for the rest, longer than one by pauses.
                await recovers(link, tries=50)  # WORDS stand as they were
            else:
                await written_again(link)

    under_damage(wire, act)
