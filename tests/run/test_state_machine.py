"""The loop over the state table: order of effects, faults and stops in every state."""

from __future__ import annotations

import asyncio

import pytest

from lmctl.errors import JournalError, MachineError
from lmctl.run.interlocks.alarms import Interlock
from lmctl.run.state.machine import StateMachine
from lmctl.run.state.table import Do, Event, State
from simulators import virtual_time


class Rig:
    """Effects that take a second each, and a log of everything that happens."""

    def __init__(self, fails=(), full_disk=False, lasts=()):
        self.log, self.faults, self.states = [], [], []
        self.fails, self.lasts = dict(fails), dict(lasts)
        self.full_disk = full_disk
        self.program = None
        self.machine = StateMachine(self.carry_out, lambda error: self.log.append("halt"), self)

    async def carry_out(self, do):
        self.log.append(do)
        await asyncio.sleep(self.lasts.get(do, 1.0))
        if do in self.fails:
            raise self.fails[do]
        if do is Do.START_MOTION:
            self.program = asyncio.get_running_loop().call_later(
                10.0, self.machine.post, Event.PROGRAM_DONE)
        elif do in (Do.FEED_HOLD, Do.STOP_MOTION) and self.program is not None:
            self.program.cancel()

    def state(self, event, before, after):
        self.states.append(after)
        if self.full_disk and after is State.POWDER:
            raise JournalError("disk full")

    def fault(self, error):
        if self.full_disk:
            raise JournalError("disk full")
        self.faults.append(str(error))


#: Seconds after the start at which each state is entered, effects taking a second each.
ENTERED = {
    State.CONNECTING: 0, State.CHECKING: 1, State.GAS: 2, State.POWDER: 4, State.ARMED: 6,
    State.DEPOSITING: 8, State.FINISHING: 19,
}
SAFE_STOP = ["halt", Do.STOP_MOTION, Do.POWDER_OFF, Do.GAS_OFF]


def run(rig, *acts):
    """Run to the end; acts are (time, callable)."""

    async def main():
        loop = asyncio.get_running_loop()
        rig.task = asyncio.current_task()
        for at, act in acts:
            loop.call_later(at, act)
        return await rig.machine.run()

    return virtual_time.run(main())


def test_a_run_goes_through_its_states_to_done():
    rig = Rig()
    assert run(rig) is State.DONE
    assert rig.log == [
        Do.CONNECT, Do.CHECK_MACHINE, Do.MOVE_TO_PURGE, Do.GAS_ON, Do.POWDER_ON, Do.AWAIT_STABLE,
        Do.ARM_BEAM, Do.LEAD_POWDER, Do.START_MOTION, Do.REST_BEAM, Do.POWDER_OFF, Do.GAS_OFF,
    ]
    assert rig.faults == []


@pytest.mark.parametrize("state", ENTERED)
def test_a_fault_in_any_state_holds_at_once_and_stops_in_order(state):
    rig = Rig()
    seen = []

    def break_it():
        seen.append(rig.machine.state)
        rig.machine.trip(MachineError("first"))
        rig.machine.trip(MachineError("second"))

    assert run(rig, (ENTERED[state] + 0.5, break_it)) is State.FAULTED
    assert seen == [state]
    assert str(rig.machine.fault) == "first"
    assert rig.faults == ["first", "second"]
    if state in (State.CONNECTING, State.CHECKING):
        assert "halt" not in rig.log
        assert Do.STOP_MOTION not in rig.log
    else:
        tail = [one for one in rig.log[rig.log.index("halt"):] if one != "halt"]
        assert tail == SAFE_STOP[1:]


@pytest.mark.parametrize("state", ENTERED)
def test_being_cancelled_is_an_orderly_stop(state):
    rig = Rig()
    ended = run(rig, (ENTERED[state] + 0.5, lambda: rig.task.cancel()))
    if state is State.FINISHING:
        assert ended is State.DONE
        assert rig.log[-3:] == [Do.REST_BEAM, Do.POWDER_OFF, Do.GAS_OFF_NOW]
    else:
        assert ended is State.STOPPED
        if state not in (State.CONNECTING, State.CHECKING):
            assert rig.log[-3:] == [Do.STOP_MOTION, Do.POWDER_OFF, Do.GAS_OFF]
    assert rig.machine.fault is None


def test_a_second_cancellation_skips_the_post_flow_only():
    rig = Rig()
    ended = run(rig, (10.0, lambda: rig.task.cancel()), (12.5, lambda: rig.task.cancel()))
    assert ended is State.STOPPED
    assert rig.log[-6:] == [
        Do.STOP_MOTION, Do.POWDER_OFF, Do.GAS_OFF, Do.STOP_MOTION, Do.POWDER_OFF, Do.GAS_OFF_NOW
    ]


def test_an_effect_that_fails_is_a_fault():
    rig = Rig(fails={Do.AWAIT_STABLE: MachineError("no powder")})
    assert run(rig) is State.FAULTED
    assert str(rig.machine.fault) == "no powder"
    assert rig.log[-4:] == SAFE_STOP
    assert Do.ARM_BEAM not in rig.log


def test_a_dead_device_does_not_keep_the_others_from_stopping():
    dead = MachineError("link is gone")
    rig = Rig(fails={Do.STOP_MOTION: dead, Do.POWDER_OFF: dead})
    assert run(rig, (10.0, lambda: rig.machine.trip(MachineError("first")))) is State.FAULTED
    assert rig.log[-4:] == SAFE_STOP
    assert rig.faults == ["first", "link is gone", "link is gone"]


def test_a_stop_that_fails_becomes_a_fault_and_is_tried_once_more():
    rig = Rig(fails={Do.POWDER_OFF: MachineError("feeder silent")})
    assert run(rig, (10.0, lambda: rig.machine.post(Event.STOP))) is State.FAULTED
    assert rig.log[-6:] == [Do.STOP_MOTION, Do.POWDER_OFF, *SAFE_STOP]


def test_a_bug_is_stopped_like_a_fault_and_kept_as_it_is():
    rig = Rig(fails={Do.ARM_BEAM: ZeroDivisionError("a bug")})
    assert run(rig) is State.FAULTED
    assert isinstance(rig.machine.fault, ZeroDivisionError)
    assert rig.log[-4:] == SAFE_STOP


def test_an_event_the_table_does_not_know_is_a_fault():
    rig = Rig()
    assert run(rig, (5.0, lambda: rig.machine.post(Event.RESUME))) is State.FAULTED
    assert "'resume'" in rig.faults[0] or "resume" in rig.faults[0]
    assert rig.log[-3:] == [Do.STOP_MOTION, Do.POWDER_OFF, Do.GAS_OFF]


def test_a_full_disk_stops_the_run_safely():
    rig = Rig(full_disk=True)
    assert run(rig) is State.FAULTED
    assert isinstance(rig.machine.fault, JournalError)
    assert rig.log[-3:] == SAFE_STOP[1:]


HELD = [Do.FEED_HOLD, Do.CLEAR_MOTION, Do.POWDER_OFF, Do.AWAIT_OPERATOR]
RESUMED = [
    Do.ACKNOWLEDGE, Do.LEAVE_PART, Do.GAS_ON, Do.POWDER_ON, Do.AWAIT_STABLE,
    Do.ARM_BEAM, Do.LEAD_POWDER, Do.START_MOTION,
]
WAITS = {Do.AWAIT_OPERATOR: 1000.0}


def test_hold_and_resume_go_through_a_purge():
    rig = Rig(lasts=WAITS)
    machine = rig.machine
    ended = run(rig, (10.0, lambda: machine.post(Event.HOLD)),
                (15.0, lambda: machine.post(Event.RESUME)))
    assert ended is State.DONE
    held = rig.log.index(Do.FEED_HOLD)
    assert rig.log[held:held + 12] == HELD + RESUMED


def test_an_interlock_holds_at_once_and_is_not_the_end():
    rig = Rig(lasts=WAITS)
    machine = rig.machine
    ended = run(rig, (10.0, lambda: machine.trip(Interlock("gas", "gas is low"))),
                (10.2, lambda: machine.trip(Interlock("disc", "disc is jammed"))),
                (20.0, lambda: machine.post(Event.RESUME)))
    assert ended is State.DONE
    assert machine.fault is None
    assert rig.faults == ["gas is low", "disc is jammed"]
    at = rig.log.index("halt")
    assert rig.log[at + 1:at + 13] == HELD + RESUMED


def test_an_interlock_before_anything_is_laid_ends_the_run():
    rig = Rig()
    tripped = run(rig, (4.5, lambda: rig.machine.trip(Interlock("gas", "gas is low"))))
    assert tripped is State.FAULTED
    assert str(rig.machine.fault) == "gas is low"
    assert rig.log[-3:] == SAFE_STOP[1:]


def test_a_held_run_nobody_comes_to_is_stopped():
    rig = Rig(lasts=WAITS)
    assert run(rig, (10.0, lambda: rig.machine.post(Event.HOLD))) is State.STOPPED
    assert rig.log[-3:] == SAFE_STOP[1:]


def test_a_feeder_that_fails_while_resuming_holds_again():
    rig = Rig(fails={Do.GAS_ON: Interlock("F1", "no gas")}, lasts=WAITS)
    machine = rig.machine

    def again():
        rig.fails.clear()
        machine.post(Event.RESUME)

    rig.fails = {}
    ended = run(
        rig, (10.0, lambda: machine.post(Event.HOLD)),
        (15.0, lambda: (rig.fails.update({Do.GAS_ON: Interlock("F1", "no gas")}),
                        machine.post(Event.RESUME))),
        (40.0, again),
    )
    assert ended is State.DONE
    assert rig.faults == ["no gas"]
    assert machine.fault is None
    held = rig.log.index(Do.FEED_HOLD)
    first = HELD + RESUMED[:3] + ["halt"]
    assert rig.log[held:held + len(first) + 4] == first + HELD


def test_a_dead_feeder_does_not_keep_the_run_from_being_held():
    dead = Interlock("F1", "feeder is gone")
    rig = Rig(fails={Do.POWDER_OFF: dead}, lasts=WAITS)
    run(rig, (10.0, lambda: rig.machine.post(Event.HOLD)),
        (30.0, lambda: rig.machine.post(Event.STOP)))
    assert State.HELD in rig.states


def test_a_wish_the_state_does_not_know_is_no_fault():
    rig = Rig()
    answers = {}
    ended = run(rig, *(
        (at + 0.5, lambda state=state: answers.update({state: rig.machine.wish(Event.HOLD)}))
        for state, at in ENTERED.items() if state is not State.DEPOSITING
    ))
    assert ended is State.DONE
    assert set(answers.values()) == {False}
    assert Do.FEED_HOLD not in rig.log
    rig = Rig()
    run(rig, (10.0, lambda: rig.machine.wish(Event.HOLD)),
        (50.0, lambda: rig.machine.wish(Event.STOP)))
    assert Do.FEED_HOLD in rig.log


def test_asking_twice_is_asking_once():
    rig = Rig(lasts=WAITS)

    def twice(event):
        assert rig.machine.wish(event)
        assert rig.machine.wish(event)

    ended = run(rig, (10.0, lambda: twice(Event.HOLD)), (14.5, lambda: twice(Event.RESUME)))
    assert ended is State.DONE
    assert rig.log.count(Do.FEED_HOLD) == rig.log.count(Do.LEAVE_PART) == 1
    assert rig.faults == []


def test_what_was_not_achieved_when_last_tried_is_known():
    dead = MachineError("link is gone")
    rig = Rig(fails={Do.STOP_MOTION: dead, Do.GAS_OFF: dead})
    run(rig, (10.0, lambda: rig.machine.trip(MachineError("first"))))
    assert rig.machine.undone == {Do.STOP_MOTION, Do.GAS_OFF}
    rig = Rig(fails={Do.STOP_MOTION: dead})
    rig.machine.undone.add(Do.POWDER_OFF)
    run(rig, (10.0, lambda: rig.machine.post(Event.STOP)), (12.0, rig.fails.clear))
    assert rig.machine.state is State.FAULTED
    assert rig.machine.undone == set()


@pytest.mark.parametrize(("at_s", "touched"), [(0.5, False), (1.5, False), (2.5, True)])
def test_a_run_that_ends_while_it_only_looks_has_touched_nothing(at_s, touched):
    rig = Rig()
    run(rig, (at_s, lambda: rig.machine.trip(MachineError("broken"))))
    assert rig.machine.state is State.FAULTED
    assert rig.machine.touched is touched


def test_a_stop_while_connecting_waits_until_what_was_opened_is_closed():
    rig = Rig()
    closed = []

    async def connect(do):
        try:
            await asyncio.sleep(60.0)
        finally:
            await asyncio.sleep(1.0)  # giving a device back is said to it, too
            closed.append(do)

    rig.machine = StateMachine(connect, lambda error: None, rig)
    assert run(rig, (2.0, lambda: rig.machine.wish(Event.STOP)),
               (2.5, lambda: rig.task.cancel())) is State.STOPPED
    assert closed == [Do.CONNECT]
