"""Faults that alter bytes: on the controller's link and on a feeder's, by TCP and by pty."""

import asyncio

import pytest

RTU = [("modbus-tcp://127.0.0.1:5021", "pty")]
DEVICE_ID = 0x504D


def test_lost_bytes_make_another_line(play):
    async def scene(cell):
        cell.inject("bytes_lost", count=2, every=2)
        # "G91\n" loses 9 and its end; "$G" joins what is left
        return await cell.send("G91\n"), await cell.send("1\n$G\n")

    first, second = play(scene)
    assert first == b""
    assert b"ok" in second


def test_one_byte_in_so_many_is_lost(play):
    async def scene(cell):
        cell.inject("bytes_lost", count=3, every=4, direction="to_host")
        return await cell.send("G21\nG21\nG21\nG21\n")

    assert play(scene) == b"ok\rok\rok\rok\r\n"


def test_doubled_bytes(play):
    async def scene(cell):
        cell.inject("bytes_doubled", count=4, direction="to_host")
        return await cell.send("G21\nG21\n")

    assert play(scene) == b"ookk\r\r\n\nok\r\n"


@pytest.mark.parametrize("bit", range(8))
def test_a_flipped_bit(play, bit):
    async def scene(cell):
        cell.inject("bytes_flipped", bit=bit, direction="to_host")
        return await cell.send("G21\n")

    assert play(scene) == bytes((ord("o") ^ 1 << bit,)) + b"k\r\n"


def test_a_bit_flipped_on_the_way_to_the_device_is_executed_as_it_arrives(play):
    async def scene(cell):
        cell.inject("bytes_flipped", bit=1, every=2)
        await cell.send("G1\n")  # "G3": an arc without its words
        return cell.said

    assert play(scene).startswith(b"error:")


@pytest.mark.parametrize("direction", ["to_device", "to_host"])
def test_late_bytes_come_in_order(play, direction):
    async def scene(cell):
        cell.inject("bytes_late", late_s=0.5, direction=direction)
        early = await cell.send("G21\n", then_s=0.2) + await cell.send("FOO\n", then_s=0.29)
        return early, await cell.send("", then_s=0.25)

    assert play(scene) == (b"", b"ok\r\nerror:2\r\n")


def test_what_is_late_when_the_fault_ends_comes_before_what_follows(play):
    async def scene(cell):
        number = cell.inject("bytes_late", late_s=5.0)
        await cell.send("FOO\n")
        cell.board.clear(number)
        return await cell.send("\n", then_s=0.1)

    assert play(scene) == b"error:2\r\nok\r\n"


def test_garbage_comes_back_beside_the_answers(play):
    async def scene(cell):
        cell.inject("garbage_echoed", for_s=1.0)
        garbage = await cell.send("G21\n", then_s=1.1)
        return garbage, await cell.send("G21\n")

    garbage, after = play(scene)
    assert garbage.count(b"ok\r\n") == 1
    assert len(garbage) == len(b"ok\r\n") + len(b"G21\n")
    assert b"G21" not in garbage
    assert after == b"ok\r\n"


def test_a_closed_link_throws_the_host_out_turns_it_away_and_takes_it_again(play):
    async def scene(cell):
        port = int(cell.bench.endpoints["motion"].rpartition(":")[2])
        cell.inject("link_closed", for_s=2.0)
        await asyncio.sleep(0.5)
        thrown_out = cell._listening.done()
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        turned_away = await asyncio.gather(reader.read(1), return_exceptions=True)
        writer.close()
        await asyncio.sleep(2.0)
        await cell.connect()
        return thrown_out, turned_away, await cell.send(
            "G21\n"), cell.judge.host_disconnected_at_s()

    thrown_out, (turned_away,), said, went_s = play(scene)
    assert thrown_out
    assert turned_away == b"" or isinstance(turned_away, ConnectionError)
    assert said == b"ok\r\n"
    assert went_s == (0.0,)


@pytest.mark.parametrize("wire", [(), RTU])
def test_a_closed_feeder_link(play, wire):
    async def scene(cell):
        host = await cell.modbus()
        assert await host.read(0) == [DEVICE_ID]
        cell.inject("link_closed", "F1", for_s=2.0)
        closed = await host.ask(0, then_s=2.5)
        return closed, await (host if wire else await cell.modbus()).read(0)

    closed, after = play(scene, *wire)
    assert closed == (b"" if wire else b"<closed>")
    assert after == [DEVICE_ID]


@pytest.mark.parametrize("wire", [(), RTU])
@pytest.mark.parametrize("code", range(1, 7))
def test_exceptions_are_answered_in_the_devices_place(play, wire, code):
    async def scene(cell):
        host = await cell.modbus()
        before = cell.bench.feeders["F1"].holding.raw_word("HEARTBEAT")
        cell.inject("modbus_exception", "F1", code=code, count=2)
        refused = [await host.ask(0), await host.ask(0)]
        return refused, await host.read(0), before

    refused, after, _ = play(scene, *wire)
    for number, answer in enumerate(refused, 1):
        if wire:
            assert answer[:3] == bytes((1, 0x84, code))
            assert len(answer) == 5
        else:
            assert answer == bytes((0, number, 0, 0, 0, 3, 1, 0x84, code))
    assert after == [DEVICE_ID]


@pytest.mark.parametrize("wire", [(), RTU])
def test_refused_requests_do_not_reach_the_device(play, wire):
    async def scene(cell):
        host = await cell.modbus()
        cell.inject("modbus_exception", "F1", code=6)
        if not wire:
            host._write(bytes((0, 9, 0, 0, 0, 6, 1, 6, 0, 1, 0, 77)))  # HEARTBEAT := 77
            await asyncio.sleep(0.01)
        return cell.bench.feeders["F1"].holding.raw_word("HEARTBEAT")

    assert play(scene, *wire) == 0


@pytest.mark.parametrize("wire", [(), RTU])
def test_slow_dropped_and_doubled_replies(play, wire):
    async def scene(cell):
        host = await cell.modbus()
        one = await host.ask(0)
        slow_number = cell.inject("replies_slow", "F1", late_s=0.3)
        slow = await host.ask(0, then_s=0.29), await host.ask(0, then_s=0.02)
        await asyncio.sleep(0.5)
        cell.board.clear(slow_number)
        cell.inject("replies_dropped", "F1")
        dropped = await host.ask(0), await host.read(0)
        cell.inject("replies_doubled", "F1")
        doubled = await host.ask(0), await host.read(0)
        return len(one), slow, dropped, doubled

    length, slow, dropped, doubled = play(scene, *wire)
    assert (len(slow[0]), len(slow[1])) == (0, length)
    assert dropped == (b"", [DEVICE_ID])
    assert len(doubled[0]) == 2 * length
    assert doubled[1] == [DEVICE_ID]


@pytest.mark.parametrize("wire", [(), RTU])
def test_a_silent_device_neither_receives_nor_answers(play, wire):
    async def scene(cell):
        host = await cell.modbus()
        cell.inject("device_silent", "F1", for_s=1.0)
        return await host.ask(0, then_s=1.1), await host.read(0)

    assert play(scene, *wire) == (b"", [DEVICE_ID])


def test_only_the_device_named_is_struck(play):
    async def scene(cell):
        cell.inject("device_silent", "F1")
        return await (await cell.modbus("F2")).read(0), await cell.send("G21\n")

    assert play(scene) == ([DEVICE_ID], b"ok\r\n")


def test_faults_on_one_link_add_up(play):
    async def scene(cell):
        cell.inject("bytes_late", late_s=0.2, direction="to_host")
        cell.inject("ok_doubled")
        return await cell.send("G21\n", then_s=0.19), await cell.send("", then_s=0.1)

    assert play(scene) == (b"", b"ok\r\nok\r\n")


def test_a_bench_without_faults_passes_bytes_through_untouched(play):
    async def scene(cell):
        number = cell.inject("bytes_lost", count=1)
        await cell.send("G21\n")
        cell.board.clear(number)
        return [(edge.to_device, edge.to_host) for edge in cell.bench.edges.values()]

    assert set(play(scene)) == {(None, None)}
