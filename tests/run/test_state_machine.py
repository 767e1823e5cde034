"""The loop over the state table: order of effects, faults and stops in every state."""

from __future__ import annotations

import asyncio

import pytest

from lmctl.errors import JournalError, MachineError
from lmctl.run.interlocks.alarms import InterlockError
from lmctl.run.state.state_machine import RunStateMachine
from lmctl.run.state.transitions import Effect, RunEvent, RunState
from simulators import virtual_time


class Rig:
    """Effects that take a second each, and a log of everything that happens."""

    def __init__(self, fails=(), full_disk=False, lasts=()):
        self.log, self.faults, self.states = [], [], []
        self.fails, self.lasts = dict(fails), dict(lasts)
        self.full_disk = full_disk
        self.program = None
        self.machine = RunStateMachine(self.carry_out, lambda error: self.log.append("halt"), self)

    async def carry_out(self, do):
        self.log.append(do)
        await asyncio.sleep(self.lasts.get(do, 1.0))
        if do in self.fails:
            raise self.fails[do]
        if do is Effect.START_MOTION:
            self.program = asyncio.get_running_loop().call_later(
                10.0, self.machine.post_event, RunEvent.PROGRAM_DONE)
        elif do in (Effect.FEED_HOLD, Effect.STOP_MOTION) and self.program is not None:
            self.program.cancel()

    def record_state(self, event, before, after):
        self.states.append(after)
        if self.full_disk and after is RunState.POWDER:
            raise JournalError("disk full")

    def record_fault(self, error):
        if self.full_disk:
            raise JournalError("disk full")
        self.faults.append(str(error))


#: Seconds after the start at which each state is entered, effects taking a second each.
ENTERED = {
    RunState.CONNECTING: 0, RunState.CHECKING: 1, RunState.GAS: 2, RunState.POWDER: 4,
    RunState.ARMED: 6,
    RunState.DEPOSITING: 8, RunState.FINISHING: 19,
}
SAFE_STOP = ["halt", Effect.STOP_MOTION, Effect.POWDER_OFF, Effect.GAS_OFF]


def run(rig, *acts):
    """Run to the end; acts are (time, callable)."""

    async def main():
        loop = asyncio.get_running_loop()
        rig.task = asyncio.current_task()
        for at, act in acts:
            loop.call_later(at, act)
        return await rig.machine.run()

    return virtual_time.run_in_virtual_time(main())


def test_a_run_goes_through_its_states_to_done():
    rig = Rig()
    assert run(rig) is RunState.DONE
    assert rig.log == [
        Effect.CONNECT, Effect.CHECK_MACHINE, Effect.MOVE_TO_PURGE, Effect.GAS_ON, Effect.POWDER_ON,
        Effect.AWAIT_STABLE,
        Effect.ARM_BEAM, Effect.LEAD_POWDER, Effect.START_MOTION, Effect.REST_BEAM,
        Effect.POWDER_OFF, Effect.GAS_OFF,
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

    assert run(rig, (ENTERED[state] + 0.5, break_it)) is RunState.FAULTED
    assert seen == [state]
    assert str(rig.machine.fault) == "first"
    assert rig.faults == ["first", "second"]
    if state in (RunState.CONNECTING, RunState.CHECKING):
        assert "halt" not in rig.log
        assert Effect.STOP_MOTION not in rig.log
    else:
        tail = [one for one in rig.log[rig.log.index("halt"):] if one != "halt"]
        assert tail == SAFE_STOP[1:]


@pytest.mark.parametrize("state", ENTERED)
def test_being_cancelled_is_an_orderly_stop(state):
    rig = Rig()
    ended = run(rig, (ENTERED[state] + 0.5, lambda: rig.task.cancel()))
    if state is RunState.FINISHING:
        assert ended is RunState.DONE
        assert rig.log[-3:] == [Effect.REST_BEAM, Effect.POWDER_OFF, Effect.GAS_OFF_NOW]
    else:
        assert ended is RunState.STOPPED
        if state not in (RunState.CONNECTING, RunState.CHECKING):
            assert rig.log[-3:] == [Effect.STOP_MOTION, Effect.POWDER_OFF, Effect.GAS_OFF]
    assert rig.machine.fault is None


def test_a_second_cancellation_skips_the_post_flow_only():
    rig = Rig()
    ended = run(rig, (10.0, lambda: rig.task.cancel()), (12.5, lambda: rig.task.cancel()))
    assert ended is RunState.STOPPED
    assert rig.log[-6:] == [
        Effect.STOP_MOTION, Effect.POWDER_OFF, Effect.GAS_OFF, Effect.STOP_MOTION,
        Effect.POWDER_OFF, Effect.GAS_OFF_NOW
    ]


def test_an_effect_that_fails_is_a_fault():
    rig = Rig(fails={Effect.AWAIT_STABLE: MachineError("no powder")})
    assert run(rig) is RunState.FAULTED
    assert str(rig.machine.fault) == "no powder"
    assert rig.log[-4:] == SAFE_STOP
    assert Effect.ARM_BEAM not in rig.log


def test_a_dead_device_does_not_keep_the_others_from_stopping():
    dead = MachineError("link is gone")
    rig = Rig(fails={Effect.STOP_MOTION: dead, Effect.POWDER_OFF: dead})
    assert run(rig, (10.0, lambda: rig.machine.trip(MachineError("first")))) is RunState.FAULTED
    assert rig.log[-4:] == SAFE_STOP
    assert rig.faults == ["first", "link is gone", "link is gone"]


def test_a_stop_that_fails_becomes_a_fault_and_is_tried_once_more():
    rig = Rig(fails={Effect.POWDER_OFF: MachineError("feeder silent")})
    assert run(rig, (10.0, lambda: rig.machine.post_event(RunEvent.STOP))) is RunState.FAULTED
    assert rig.log[-6:] == [Effect.STOP_MOTION, Effect.POWDER_OFF, *SAFE_STOP]


def test_a_bug_is_stopped_like_a_fault_and_kept_as_it_is():
    rig = Rig(fails={Effect.ARM_BEAM: ZeroDivisionError("a bug")})
    assert run(rig) is RunState.FAULTED
    assert isinstance(rig.machine.fault, ZeroDivisionError)
    assert rig.log[-4:] == SAFE_STOP


def test_an_event_the_table_does_not_know_is_a_fault():
    rig = Rig()
    assert run(rig, (5.0, lambda: rig.machine.post_event(RunEvent.RESUME))) is RunState.FAULTED
    assert "'resume'" in rig.faults[0] or "resume" in rig.faults[0]
    assert rig.log[-3:] == [Effect.STOP_MOTION, Effect.POWDER_OFF, Effect.GAS_OFF]


def test_a_full_disk_stops_the_run_safely():
    rig = Rig(full_disk=True)
    assert run(rig) is RunState.FAULTED
    assert isinstance(rig.machine.fault, JournalError)
    assert rig.log[-3:] == SAFE_STOP[1:]


HELD = [Effect.FEED_HOLD, Effect.CLEAR_MOTION, Effect.POWDER_OFF, Effect.AWAIT_OPERATOR]
RESUMED = [
    Effect.ACKNOWLEDGE, Effect.LEAVE_PART, Effect.GAS_ON, Effect.POWDER_ON, Effect.AWAIT_STABLE,
    Effect.ARM_BEAM, Effect.LEAD_POWDER, Effect.START_MOTION,
]
WAITS = {Effect.AWAIT_OPERATOR: 1000.0}


def test_hold_and_resume_go_through_a_purge():
    rig = Rig(lasts=WAITS)
    machine = rig.machine
    ended = run(rig, (10.0, lambda: machine.post_event(RunEvent.HOLD)),
                (15.0, lambda: machine.post_event(RunEvent.RESUME)))
    assert ended is RunState.DONE
    held = rig.log.index(Effect.FEED_HOLD)
    assert rig.log[held:held + 12] == HELD + RESUMED


def test_an_interlock_holds_at_once_and_is_not_the_end():
    rig = Rig(lasts=WAITS)
    machine = rig.machine
    ended = run(rig, (10.0, lambda: machine.trip(InterlockError("gas", "gas is low"))),
                (10.2, lambda: machine.trip(InterlockError("disc", "disc is jammed"))),
                (20.0, lambda: machine.post_event(RunEvent.RESUME)))
    assert ended is RunState.DONE
    assert machine.fault is None
    assert rig.faults == ["gas is low", "disc is jammed"]
    at = rig.log.index("halt")
    assert rig.log[at + 1:at + 13] == HELD + RESUMED


def test_an_interlock_before_anything_is_deposited_ends_the_run():
    rig = Rig()
    tripped = run(rig, (4.5, lambda: rig.machine.trip(InterlockError("gas", "gas is low"))))
    assert tripped is RunState.FAULTED
    assert str(rig.machine.fault) == "gas is low"
    assert rig.log[-3:] == SAFE_STOP[1:]


def test_a_held_run_no_one_comes_to_is_stopped():
    rig = Rig(lasts=WAITS)
    assert run(rig, (10.0, lambda: rig.machine.post_event(RunEvent.HOLD))) is RunState.STOPPED
    assert rig.log[-3:] == SAFE_STOP[1:]


def test_a_feeder_that_fails_while_resuming_holds_again():
    rig = Rig(fails={Effect.GAS_ON: InterlockError("F1", "no gas")}, lasts=WAITS)
    machine = rig.machine

    def again():
        rig.fails.clear()
        machine.post_event(RunEvent.RESUME)

    rig.fails = {}
    ended = run(
        rig, (10.0, lambda: machine.post_event(RunEvent.HOLD)),
        (15.0, lambda: (rig.fails.update({Effect.GAS_ON: InterlockError("F1", "no gas")}),
                        machine.post_event(RunEvent.RESUME))),
        (40.0, again),
    )
    assert ended is RunState.DONE
    assert rig.faults == ["no gas"]
    assert machine.fault is None
    held = rig.log.index(Effect.FEED_HOLD)
    first = HELD + RESUMED[:3] + ["halt"]
    assert rig.log[held:held + len(first) + 4] == first + HELD


def test_a_dead_feeder_does_not_keep_the_run_from_being_held():
    dead = InterlockError("F1", "feeder is gone")
    rig = Rig(fails={Effect.POWDER_OFF: dead}, lasts=WAITS)
    run(rig, (10.0, lambda: rig.machine.post_event(RunEvent.HOLD)),
        (30.0, lambda: rig.machine.post_event(RunEvent.STOP)))
    assert RunState.HELD in rig.states


def test_a_wish_the_state_does_not_know_is_no_fault():
    rig = Rig()
    answers = {}
    ended = run(rig, *(
        (at + 0.5,
         lambda state=state: answers.update({state: rig.machine.request_event(RunEvent.HOLD)}))
        for state, at in ENTERED.items() if state is not RunState.DEPOSITING
    ))
    assert ended is RunState.DONE
    assert set(answers.values()) == {False}
    assert Effect.FEED_HOLD not in rig.log
    rig = Rig()
    run(rig, (10.0, lambda: rig.machine.request_event(RunEvent.HOLD)),
        (50.0, lambda: rig.machine.request_event(RunEvent.STOP)))
    assert Effect.FEED_HOLD in rig.log


@pytest.mark.parametrize("event", [RunEvent.HOLD, RunEvent.STOP])
def test_a_request_that_ends_the_beam_does_so_before_it_is_journaled(event):
    rig = Rig()
    at_once = []

    def ask():
        assert rig.machine.request_event(event)
        at_once.append((rig.log[-1], rig.states[-1]))

    run(rig, (10.0, ask), (50.0, lambda: rig.machine.request_event(RunEvent.STOP)))
    assert at_once == [("halt", RunState.DEPOSITING)]


def test_asking_twice_is_asking_once():
    rig = Rig(lasts=WAITS)

    def twice(event):
        assert rig.machine.request_event(event)
        assert rig.machine.request_event(event)

    ended = run(rig, (10.0, lambda: twice(RunEvent.HOLD)), (14.5, lambda: twice(RunEvent.RESUME)))
    assert ended is RunState.DONE
    assert rig.log.count(Effect.FEED_HOLD) == rig.log.count(Effect.LEAVE_PART) == 1
    assert rig.faults == []


def test_what_was_not_achieved_when_last_tried_is_known():
    dead = MachineError("link is gone")
    rig = Rig(fails={Effect.STOP_MOTION: dead, Effect.GAS_OFF: dead})
    run(rig, (10.0, lambda: rig.machine.trip(MachineError("first"))))
    assert rig.machine.undone == {Effect.STOP_MOTION, Effect.GAS_OFF}
    rig = Rig(fails={Effect.STOP_MOTION: dead})
    rig.machine.undone.add(Effect.POWDER_OFF)
    run(rig, (10.0, lambda: rig.machine.post_event(RunEvent.STOP)), (12.0, rig.fails.clear))
    assert rig.machine.state is RunState.FAULTED
    assert rig.machine.undone == set()


@pytest.mark.parametrize(("at_s", "touched"), [(0.5, False), (1.5, False), (2.5, True)])
def test_a_run_that_ends_while_it_only_looks_has_touched_nothing(at_s, touched):
    rig = Rig()
    run(rig, (at_s, lambda: rig.machine.trip(MachineError("broken"))))
    assert rig.machine.state is RunState.FAULTED
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

    rig.machine = RunStateMachine(connect, lambda error: None, rig)
    assert run(rig, (2.0, lambda: rig.machine.request_event(RunEvent.STOP)),
               (2.5, lambda: rig.task.cancel())) is RunState.STOPPED
    assert closed == [Effect.CONNECT]
