"""What each fault of a feeder does: to what it tells, to its powder, and to its alarms."""

import asyncio

import numpy as np
import pytest

from firmware_protocol.pmx import FeederStatusBits, HopperStatusBits
from simulators.feeder.readings import register_values
from simulators.modbus_errors import ExceptionReplyError

G_MIN = 10.0
FACTOR = 2.594  # g/rev of the shipped bench
THETA_S, TAU_S = 3.0, 1.0


async def feeding(cell):
    """F1 feeds 10 g/min, long stable."""
    cell.feed("F1", G_MIN)
    await asyncio.sleep(30.0)


def values(cell, channel=1):
    device = cell.bench.feeders["F1"]
    return register_values(device, channel, device.advance_to_now())


def nozzle_g_min(cell, seconds_ago=0.0):
    process = cell.bench.feeders["F1"].hoppers[1].process
    return 60.0 * float(process.nozzle_flow_g_s(np.array([cell.now_s - seconds_ago]))[0])


def test_a_restart_stops_discs_and_forgets(play):
    async def scene(cell):
        await feeding(cell)
        at_s = cell.now_s
        cell.inject("feeder_restarts", "F1")
        await asyncio.sleep(5.0)
        return at_s, cell.judge.powder_stop("F1"), cell.judge.gas_off_at_s("F1"), values(cell, 0)

    at_s, stop, gas_off_s, system = play(scene)
    assert stop.commanded_s == stop.stopped_s == gas_off_s == at_s
    assert (system["UPTIME"], system["SEQ_APPLIED"], system["ALARM"]) == (5, 0, 0)


def test_local_ends_remote_control_until_it_is_turned_back(play):
    async def scene(cell):
        await feeding(cell)
        number = cell.inject("feeder_local", "F1")
        local = values(cell, 0)["MODE"], cell.judge.is_powder_on("F1")
        cell.board.clear(number)
        return local, values(cell, 0)["MODE"]

    assert play(scene) == ((0, False), 1)


def test_the_watchdog_trips_though_heartbeats_come(play):
    async def scene(cell):
        await feeding(cell)
        cell.inject("watchdog_trips", "F1")
        return values(cell, 0), cell.judge.is_powder_on("F1")

    system, on = play(scene)
    assert system["FIRST_ALARM_CODE"] == 104
    assert system["STATUS"] & FeederStatusBits.WATCHDOG_TRIPPED
    assert not on


def test_the_estop_chain(play):
    async def scene(cell):
        await feeding(cell)
        number = cell.inject("feeder_estop", "F1")
        opened = values(cell, 0)
        cell.board.clear(number)
        return opened, values(cell, 0)

    opened, closed = play(scene)
    assert opened["FIRST_ALARM_CODE"] == 101
    assert not opened["STATUS"] & FeederStatusBits.ESTOP_CHAIN_OK
    assert closed["STATUS"] & FeederStatusBits.ESTOP_CHAIN_OK


def test_stale_data_stand_still_with_tick_and_toggle_while_powder_goes_on(play):
    async def scene(cell):
        await feeding(cell)
        host = await cell.modbus()
        number = cell.inject("data_stale", "F1")
        stale = [await host.read(0, 24) + await host.read(100, 20)]
        await asyncio.sleep(1.05)
        cell.recipe("F1", 5.0)
        await asyncio.sleep(5.0)
        stale.append(await host.read(0, 24) + await host.read(100, 20))
        cell.board.clear(number)
        return stale, await host.read(23, 1), nozzle_g_min(cell)

    (first, second), (tick,), flow = play(scene)
    assert first == second
    assert tick != first[23]
    assert flow < 9.0


def test_a_lying_feeder_says_it_feeds_while_discs_stand(play):
    async def scene(cell):
        await feeding(cell)
        number = cell.inject("feeder_lies", "F1")
        await asyncio.sleep(15.0)
        lies = values(cell, 0), values(cell), nozzle_g_min(cell)
        cell.board.clear(number)
        await asyncio.sleep(15.0)
        return lies, nozzle_g_min(cell)

    (system, hopper, flow), after = play(scene)
    assert system["STATUS"] & FeederStatusBits.FEEDING
    assert system["STATUS"] & FeederStatusBits.AT_SETPOINT
    assert hopper["STATUS"] & HopperStatusBits.RUNNING
    assert hopper["FLOW_EST"] == pytest.approx(G_MIN, abs=0.01)
    assert hopper["DISC_ACT"] == pytest.approx(G_MIN / FACTOR, abs=0.01)
    assert hopper["FLOW_LIW"] == 0.0
    assert flow == pytest.approx(0.0, abs=1e-3)
    assert after == pytest.approx(G_MIN, rel=1e-3)


def test_an_ignored_recipe_is_taken_and_not_run(play):
    async def scene(cell):
        await feeding(cell)
        number = cell.inject("recipe_ignored", "F1")
        before = values(cell, 0)["SEQ_APPLIED"]
        cell.recipe("F1", 5.0)
        await asyncio.sleep(15.0)
        ignored = before == values(cell, 0)["SEQ_APPLIED"], nozzle_g_min(cell)
        wanted = 60 * float(cell.bench.feeders["F1"].hoppers[1].fault_free_process.nozzle_flow_g_s(
            np.array([cell.now_s]))[0])
        cell.board.clear(number)
        cell.recipe("F1", 5.0)
        await asyncio.sleep(15.0)
        return ignored, wanted, nozzle_g_min(cell)

    ignored, wanted, after = play(scene)
    assert ignored == (True, pytest.approx(G_MIN, rel=1e-3))
    assert wanted == pytest.approx(5.0, rel=1e-3)
    assert after == pytest.approx(5.0, rel=1e-3)


@pytest.mark.parametrize(
    ("kind", "code", "notices_s"),
    [("disc_stalls", 202, 0.5), ("speed_deviates", 203, 2.0), ("carrier_low", 204, 1.0),
     ("lid_open", 206, 0.0), ("supply_low", 102, 0.5), ("over_pressure", 103, 1.0),
     ("hose_clogs", 103, 1.0)],
)
def test_the_device_notices_in_its_time_and_keeps_its_alarm_while_the_cause_stands(
    play, kind, code, notices_s
):
    async def scene(cell):
        await feeding(cell)
        at_s = cell.now_s
        number = cell.inject(kind, "F1")
        await asyncio.sleep(notices_s + 0.1)
        alarm, stop = values(cell, 0)["FIRST_ALARM_CODE"], cell.judge.powder_stop("F1")
        with pytest.raises(ExceptionReplyError, match="4"):
            cell.reset_alarm()
        cell.board.clear(number)
        cell.reset_alarm()
        return alarm, stop.commanded_s - at_s, values(cell, 0)["FIRST_ALARM_CODE"]

    alarm, after_s, cleared = play(scene)
    assert alarm == code
    assert after_s == pytest.approx(notices_s)
    assert cleared == 0


@pytest.mark.parametrize(
    "kind",
    ["disc_stalls", "speed_deviates", "carrier_low", "lid_open", "supply_low", "over_pressure",
     "hose_clogs"],
)
def test_unnoticed_it_raises_nothing(play, kind):
    async def scene(cell):
        await feeding(cell)
        cell.inject(kind, "F1", noticed=False)
        await asyncio.sleep(10.0)
        return values(cell, 0)["FIRST_ALARM_CODE"], cell.judge.is_powder_on("F1")

    assert play(scene) == (0, True)


@pytest.mark.parametrize(
    ("kind", "values", "share"),
    [("disc_stalls", {}, 0.0), ("speed_deviates", {"percent": -40.0}, 0.6),
     ("speed_deviates", {"percent": 50.0}, 1.5), ("hose_clogs", {"share": 0.25}, 0.25)],
)
def test_what_comes_out_of_the_nozzle(play, kind, values, share):
    async def scene(cell):
        await feeding(cell)
        number = cell.inject(kind, "F1", noticed=False, **values)
        await asyncio.sleep(THETA_S - 0.01)
        before = nozzle_g_min(cell)
        await asyncio.sleep(0.01 + TAU_S)
        middle = nozzle_g_min(cell)
        await asyncio.sleep(20.0)
        end = nozzle_g_min(cell)
        cell.board.clear(number)
        await asyncio.sleep(20.0)
        return before, middle, end, nozzle_g_min(cell)

    before, middle, end, after = play(scene)
    assert before == pytest.approx(G_MIN, rel=1e-6)
    assert middle == pytest.approx(G_MIN * (share + (1 - share) * np.exp(-1)), rel=1e-6)
    assert end == pytest.approx(G_MIN * share, abs=1e-6)
    assert after == pytest.approx(G_MIN, rel=1e-6)


def test_the_device_sees_a_disc_that_turns_wrong_and_not_a_hose_that_clogs(play):
    async def scene(cell, kind):
        await feeding(cell)
        cell.inject(kind, "F1", noticed=False)
        await asyncio.sleep(10.0)
        return values(cell), values(cell, 0)

    slow, _ = play(lambda cell: scene(cell, "speed_deviates"))
    assert slow["DISC_ACT"] == pytest.approx(0.7 * G_MIN / FACTOR, rel=1e-2)
    assert slow["FLOW_EST"] == pytest.approx(0.7 * G_MIN, rel=1e-2)
    assert not slow["STATUS"] & HopperStatusBits.AT_SETPOINT
    clogged, system = play(lambda cell: scene(cell, "hose_clogs"))
    assert clogged["DISC_ACT"] == pytest.approx(G_MIN / FACTOR, rel=1e-2)
    assert clogged["STATUS"] & HopperStatusBits.AT_SETPOINT
    assert system["MIXER_PRESSURE"] == 900


@pytest.mark.parametrize("kind", ["hose_clogs", "over_pressure"])
def test_a_pressure_may_rise_slowly_and_is_noticed_at_its_top(play, kind):
    async def scene(cell):
        await feeding(cell)
        number = cell.inject(kind, "F1", mbar=1050, rise_s=10.0)
        seen = []
        for _ in range(4):
            await asyncio.sleep(2.5)
            seen.append((values(cell, 0)["MIXER_PRESSURE"], values(cell, 0)["FIRST_ALARM_CODE"]))
        await asyncio.sleep(1.01)
        alarm, fed = values(cell, 0)["FIRST_ALARM_CODE"], nozzle_g_min(cell)
        cell.board.clear(number)
        return seen, alarm, fed, values(cell, 0)["MIXER_PRESSURE"]

    seen, alarm, fed, after = play(scene)
    assert seen == [(300, 0), (550, 0), (800, 0), (1050, 0)]
    assert alarm == 103
    assert fed == pytest.approx(G_MIN, rel=1e-6)  # less powder takes its time to the nozzle
    assert after == 50


def test_a_rise_that_is_over_before_its_top_leaves_nothing(play):
    async def scene(cell):
        await feeding(cell)
        number = cell.inject("hose_clogs", "F1", rise_s=10.0)
        await asyncio.sleep(5.0)
        cell.board.clear(number)
        await asyncio.sleep(14.0)
        return values(cell, 0)["FIRST_ALARM_CODE"], nozzle_g_min(cell)

    assert play(scene) == (0, pytest.approx(G_MIN, rel=1e-6))


def test_a_limited_disc_clips_the_set_point_that_runs_reports_it_and_is_judged(play):
    async def scene(cell):
        await feeding(cell)
        number = cell.inject("disc_limited", "F1", n_max_rpm=1.0)
        clipped, warned = values(cell), values(cell, 0)["WARNING"]
        await asyncio.sleep(20.0)
        fed, hopper = nozzle_g_min(cell), cell.bench.feeders["F1"].hoppers[1]
        wanted_rpm = hopper.fault_free_process.disc_rpm(cell.now_s)
        cell.board.clear(number)
        await asyncio.sleep(20.0)
        return clipped, warned, fed, wanted_rpm, nozzle_g_min(cell), values(cell, 0)["WARNING"]

    clipped, warned, fed, wanted_rpm, after, cleared = play(scene)
    assert clipped["STATUS"] & HopperStatusBits.LIMITED
    assert clipped["DISC_RAMPED"] == 1.0
    assert (warned, cleared) == (1 << 4, 0)
    assert fed == pytest.approx(FACTOR, rel=1e-3)
    assert wanted_rpm == pytest.approx(G_MIN / FACTOR, rel=1e-2)
    assert after == pytest.approx(G_MIN, rel=1e-3)


@pytest.mark.parametrize(("of", "bit"), [("drift", 1), ("unsteady flow", 2),
                                         ("old calibration", 3)])
def test_a_warning_is_shown_and_stops_nothing(play, of, bit):
    async def scene(cell):
        await feeding(cell)
        number = cell.inject("feeder_warns", "F1", of=of)
        shown = values(cell, 0)["WARNING"], values(cell, 0)["STATUS"] & FeederStatusBits.WARNING
        await asyncio.sleep(5.0)
        on = cell.judge.is_powder_on("F1")
        cell.board.clear(number)
        return shown, on, values(cell, 0)["WARNING"]

    assert play(scene) == ((1 << bit, FeederStatusBits.WARNING), True, 0)


def test_a_set_point_changed_while_a_disc_deviates_is_followed_as_wrongly(play):
    async def scene(cell):
        await feeding(cell)
        cell.inject("speed_deviates", "F1", percent=-50, noticed=False)
        cell.recipe("F1", 20.0)
        await asyncio.sleep(20.0)
        return nozzle_g_min(cell)

    assert play(scene) == pytest.approx(10.0, rel=1e-5)


def test_a_flow_read_back_wrong_flows_right(play):
    async def scene(cell):
        await feeding(cell)
        number = cell.inject("flow_readback_off", "F1", percent=-25)
        wrong = values(cell)["FLOW_EST"]
        cell.board.clear(number)
        return wrong, values(cell)["FLOW_EST"], nozzle_g_min(cell)

    assert play(scene) == tuple(pytest.approx(x, rel=1e-3) for x in (7.5, 10.0, 10.0))


def test_carrier_supply_and_pressure_are_reported(play):
    async def scene(cell):
        await feeding(cell)
        for kind in ("carrier_low", "supply_low", "over_pressure", "lid_open"):
            cell.inject(kind, "F1", noticed=False)
        return values(cell), values(cell, 0)

    hopper, system = play(scene)
    assert hopper["CARRIER_ACT"] == pytest.approx(2.5)
    assert (system["SUPPLY_PRESSURE"], system["MIXER_PRESSURE"]) == (1.0, 1500)
    assert not hopper["STATUS"] & HopperStatusBits.LID_CLOSED
    assert not system["STATUS"] & FeederStatusBits.LID_CLOSED


def test_an_empty_hopper_is_noticed_at_once_and_flows_no_more(play):
    async def scene(cell):
        await feeding(cell)
        cell.inject("hopper_empty", "F1")
        await asyncio.sleep(15.0)
        empty = values(cell, 0)["FIRST_ALARM_CODE"], values(cell)["LEVEL"], nozzle_g_min(cell)
        cell.inject("hopper_level", "F1", grams=500.0)
        cell.reset_alarm()
        cell.feed("F1", G_MIN)
        await asyncio.sleep(20.0)
        return empty, nozzle_g_min(cell), values(cell)["WEIGHT"]

    (alarm, level, flow), again, weight = play(scene)
    assert (alarm, level) == (207, 0.0)
    assert flow == pytest.approx(0.0, abs=1e-4)
    assert again == pytest.approx(G_MIN, rel=1e-4)
    assert weight == pytest.approx(500 - 20 * G_MIN / 60, abs=0.1)


def test_a_level_runs_out_when_it_should(play):
    async def scene(cell):
        await feeding(cell)
        at_s = cell.now_s
        cell.inject("hopper_level", "F1", grams=2.0)
        low = values(cell)["STATUS"] & HopperStatusBits.LEVEL_LOW
        await asyncio.sleep(30.0)
        return low, cell.judge.powder_stop("F1").commanded_s - at_s, values(cell, 0)

    low, lasted_s, system = play(scene)
    assert low
    assert lasted_s == pytest.approx(2.0 / G_MIN * 60)
    assert system["FIRST_ALARM_CODE"] == 207


def test_below_its_least_speed_a_disc_stands_and_says_so(play):
    async def scene(cell):
        await feeding(cell)
        number = cell.inject("below_n_min", "F1", n_min_rpm=5.0)
        await asyncio.sleep(15.0)
        below = values(cell)["STATUS"] & HopperStatusBits.BELOW_N_MIN, nozzle_g_min(cell)
        cell.recipe("F1", 20.0)
        await asyncio.sleep(15.0)
        above = nozzle_g_min(cell)
        cell.recipe("F1", 10.0)
        cell.board.clear(number)
        await asyncio.sleep(15.0)
        below_n_min = values(cell)["STATUS"] & HopperStatusBits.BELOW_N_MIN
        return below, above, nozzle_g_min(cell), below_n_min

    (flag, flow), above, after, cleared = play(scene)
    assert flag
    assert flow == pytest.approx(0.0, abs=1e-4)
    assert above == pytest.approx(20.0, rel=1e-4)
    assert after == pytest.approx(10.0, rel=1e-4)
    assert not cleared
