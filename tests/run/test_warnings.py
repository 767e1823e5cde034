"""When a warning of a feeder is told, and when it counts as over."""

from __future__ import annotations

import asyncio

import pytest

from lmctl.machine.feeder.warnings import FeederWarning
from lmctl.run.interlocks.warnings import WARNING_CLEAR_S, WarningDebounce
from simulators import virtual_time

LOW_A, LOW_B, DRIFT, CLIPPED = (
    FeederWarning(number, "F1", hopper, f"{number} of {hopper}", "fill it")
    for number, hopper in ((51, "A"), (51, "B"), (52, "A"), (55, "A"))
)


def warning_changes(story):
    """story : (seconds since the one before, what is heard); what is told, and when."""
    async def main():
        loop = asyncio.get_running_loop()
        began_s, lines = loop.time(), []
        warnings = WarningDebounce(
            lambda one, stands: lines.append((round(loop.time() - began_s, 6), one, stands)))
        for wait_s, received in story:
            await asyncio.sleep(wait_s)
            if received is None:
                warnings.stop()
            else:
                warnings.update(received)
        await asyncio.sleep(10 * WARNING_CLEAR_S)
        return lines

    return virtual_time.run_in_virtual_time(main())


def test_it_is_reported_at_once_and_over_when_it_has_stayed_away():
    assert warning_changes([(1.0, (LOW_A,)), (5.0, ())]) == [
        (1.0, LOW_A, True), (6.0 + WARNING_CLEAR_S, LOW_A, False)]


def test_the_same_is_reported_once():
    same = (LOW_A,)
    assert warning_changes([(0.0, same), (1.0, same), (1.0, (LOW_A,))]) == [(0.0, LOW_A, True)]


@pytest.mark.parametrize("period_s", [0.5, 1.0, 7.0, WARNING_CLEAR_S - 1])
def test_one_that_flickers_is_one_record_however_long(period_s):
    story = [(period_s, received) for _ in range(1000) for received in ((LOW_A,), ())]
    assert warning_changes(story) == [
        (period_s, LOW_A, True), (round(2000 * period_s + WARNING_CLEAR_S, 6), LOW_A, False)]


def test_each_hopper_and_each_warning_counts_for_itself():
    lines = warning_changes(
        [(0.0, (LOW_A,)), (1.0, (LOW_A, LOW_B, DRIFT)), (1.0, (LOW_B,)), (1.0, (LOW_B,))])
    assert lines[:3] == [(0.0, LOW_A, True), (1.0, LOW_B, True), (1.0, DRIFT, True)]
    assert sorted(lines[3:]) == [
        (2.0 + WARNING_CLEAR_S, LOW_A, False), (2.0 + WARNING_CLEAR_S, DRIFT, False)]


def test_one_that_is_over_may_come_again():
    lines = warning_changes([(0.0, (LOW_A,)), (1.0, ()), (2 * WARNING_CLEAR_S, (LOW_A,))])
    assert [stands for _, _, stands in lines] == [True, False, True]


def test_a_clipped_set_point_is_an_alarm_and_not_a_warning():
    assert warning_changes([(0.0, (CLIPPED,)), (1.0, (CLIPPED, LOW_A)), (1.0, (LOW_A,))]) == [
        (1.0, LOW_A, True)]


def test_after_the_run_nothing_is_reported():
    assert warning_changes([(0.0, (LOW_A,)), (1.0, ()), (1.0, None)]) == [(0.0, LOW_A, True)]
