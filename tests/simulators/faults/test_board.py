"""When faults happen, for how long, and what is remembered of them."""

import asyncio

import pytest

from simulators.faults.fault_injector import FaultInjector
from simulators.faults.kinds import Fault
from simulators.faults.plan import FaultPlan

LINES = "G21 G90 G94\nM4 S0\n" + "".join(f"N{n} G1 X{n} F600 S500\n" for n in range(1, 41))


def plan(cell, text):
    return FaultPlan.parse(text, cell.bench.config)


def test_a_fault_at_a_time_and_for_a_while(play):
    async def scene(cell):
        await asyncio.sleep(7.0)
        cell.board.schedule(plan(cell, '[[fault]]\nkind="door"\nat_s=2.5\nfor_s=1.25\n'))
        await asyncio.sleep(2.6)
        active = cell.board.injected
        await asyncio.sleep(2.0)
        return active, cell.board.injected

    (active,), (over,) = play(scene)
    assert (active.at_s, active.cleared_s) == (pytest.approx(9.5), None)
    assert over.cleared_s == pytest.approx(10.75)
    assert str(over) == "door at 9.500 s"


@pytest.mark.parametrize("line", [1, 2, 30, 40])
def test_a_fault_as_a_line_begins(play, line):
    async def scene(cell):
        cell.board.schedule(plan(cell, f'[[fault]]\nkind="bytes_lost"\nat_line={line}\n'))
        await cell.send(LINES, then_s=10.0)
        return cell.board.injected[0].at_s, cell.judge.executed_lines()[line - 1]

    at_s, executed = play(scene)
    assert executed.line == line
    assert at_s == pytest.approx(executed.begin_s, abs=0.0101 if line == 1 else 1e-9)


def test_a_line_that_never_comes_is_waited_for_in_vain_and_a_later_one_will_do(play):
    async def scene(cell):
        cell.board.schedule(plan(
            cell, '[[fault]]\nkind="panel_hold"\nat_line=100\n[[fault]]\nkind="door"\nat_line=7\n'))
        await cell.send("G21 G90 G94\nN3 G1 X5 F600\nN9 G1 X10\n", then_s=5.0)
        names = [str(one.fault) for one in cell.board.injected]
        return names, cell.judge.executed_lines()[1].begin_s, cell.board.injected[0].at_s

    names, begin_s, at_s = play(scene)
    assert names == ["door"]
    assert at_s == pytest.approx(begin_s, abs=1e-9)


def test_watching_for_lines_changes_nothing_of_the_motion(play):
    async def scene(cell, text):
        if text:
            cell.board.schedule(plan(cell, text))
        await cell.send(LINES, then_s=10.0)
        return cell.judge.executed_lines()

    plain = play(lambda cell: scene(cell, ""))
    watched = play(lambda cell: scene(cell, '[[fault]]\nkind="bytes_lost"\nat_line=1000\n'))
    assert [line.end_s for line in watched] == pytest.approx([line.end_s for line in plain])


def test_a_fault_at_a_level(play):
    async def scene(cell):
        cell.inject("hopper_level", "F1", grams=10.0)
        cell.board.schedule(plan(
            cell, '[[fault]]\nkind="panel_hold"\nat_level_g={feeder="F1", grams=8}\n'))
        cell.feed("F1", 12.0)
        await asyncio.sleep(5.0)
        cell.recipe("F1", 30.0)
        await asyncio.sleep(30.0)
        return cell.board.injected[-1].at_s

    # 12 g/min from 3 s to 5 s, then 30 g/min
    assert play(scene) == pytest.approx(5.0 + (2.0 - 0.4) / 0.5, abs=1e-6)


def test_a_level_already_passed_is_reached_at_once(play):
    async def scene(cell):
        cell.board.schedule(plan(
            cell, '[[fault]]\nkind="panel_hold"\nat_level_g={feeder="F1", grams=1e6}\n'))
        await asyncio.sleep(0.01)
        return cell.board.injected[0].at_s

    assert play(scene) == 0.0


def test_closing_disarms(play):
    async def scene(cell):
        cell.board.schedule(plan(cell, '[[fault]]\nkind="door"\nat_s=1\n'
                                  '[[fault]]\nkind="door"\nat_line=1\n'))
        cell.board.close()
        await cell.send(LINES, then_s=3.0)
        return cell.board.injected

    assert play(scene) == ()


def test_clearing_by_fault_and_all(play):
    async def scene(cell):
        door = Fault.create("door")
        cell.board.inject(door)
        cell.inject("controller_silent")
        cell.inject("disc_stalls", "F1")
        await asyncio.sleep(1.0)
        cell.board.clear(door)
        first = [one.cleared_s for one in cell.board.injected]
        await asyncio.sleep(1.0)
        cell.board.clear_all()
        return first, [one.cleared_s for one in cell.board.injected]

    assert play(scene) == ([1.0, None, None], [1.0, 2.0, 2.0])


def test_a_device_the_bench_has_not(play):
    async def scene(cell):
        for kind, device in (("link_closed", "F9"), ("disc_stalls", "F9"),
                             ("feeder_local", "F9")):
            with pytest.raises(ValueError, match="F9"):
                cell.inject(kind, device)
        with pytest.raises(ValueError, match="no hopper 3"):
            cell.inject("disc_stalls", "F1", 3)
        return cell.board.injected

    assert play(scene) == ()


def test_the_host_is_killed_by_whoever_owns_it(play):
    async def scene(cell):
        done, reported = [], []
        board = FaultInjector(cell.bench, lambda: done.append(cell.now_s), reported.append)
        board.inject(Fault.create("host_killed"))
        cell.inject("host_killed")  # a mark only
        return done, [str(one) for one in reported]

    assert play(scene) == ([0.0], ["host_killed at 0.000 s"])


def test_a_fault_is_visible_with_the_first_bytes_that_get_to_the_host(play):
    async def scene(cell):
        host = await cell.modbus()
        numbers = [cell.inject("hard_limit"), cell.inject("lid_open", "F1"),
                   cell.inject("disc_stalls", "F1"), cell.inject("device_silent", "F2", for_s=5.0),
                   cell.inject("modbus_exception", "safety"), cell.inject("host_killed")]
        await asyncio.sleep(1.0)
        await host.read(6)
        other = await cell.modbus("F2")
        await other.ask(6)
        await asyncio.sleep(5.0)
        await other.ask(6)
        await (await cell.modbus("safety")).ask(0)
        return [cell.board.injected[number].detectable_s for number in numbers]

    alarm, lid, disc, silent, exception, host = play(scene)
    assert alarm == 0.0
    assert lid == disc == pytest.approx(1.0, abs=0.01)
    assert silent == pytest.approx(6.02, abs=0.01)
    assert exception == pytest.approx(6.03, abs=0.01)
    assert host is None


def test_what_a_feeder_has_not_noticed_it_cannot_show(play):
    async def scene(cell):
        host = await cell.modbus()
        number = cell.inject("speed_deviates", "F1")
        await host.ask(6, then_s=1.9)
        before = cell.board.injected[number].detectable_s
        await asyncio.sleep(0.2)
        await host.ask(6)
        edges = cell.bench.edges.values()
        return before, cell.board.injected[number].detectable_s, [edge.to_host for edge in edges]

    before, after, filters = play(scene)
    assert before is None
    assert after == pytest.approx(2.1, abs=0.01)
    assert set(filters) == {None}
