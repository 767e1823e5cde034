"""A run goes before other processes where the system permits that, and runs where it does not."""

from __future__ import annotations

import os
import sys
import threading

import pytest

from lmctl.run.real_time_priority import real_time_priority

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="priorities are those of Linux")


def may_have_it() -> bool:
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except OSError:
        return False
    os.sched_setscheduler(0, *before)
    return True


def test_the_thread_has_it_while_it_drives_and_no_longer():
    if not may_have_it():
        pytest.skip("this user may not have a real-time priority")
    before, seen = os.sched_getscheduler(0), []
    with real_time_priority():
        assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_RR
        other = threading.Thread(target=lambda: seen.append(os.sched_getscheduler(0)))
        other.start()
        other.join()
    assert seen == [os.SCHED_OTHER]
    assert os.sched_getscheduler(0) == before


def test_where_it_is_not_permitted_a_run_is_an_ordinary_process(monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    began = []
    with real_time_priority():
        began.append(os.sched_getscheduler(0))
    assert began == [os.SCHED_OTHER]


def test_a_fault_in_the_run_leaves_no_priority_behind():
    before = os.sched_getscheduler(0)
    with pytest.raises(ValueError, match="a fault"), real_time_priority():
        raise ValueError("a fault")
    assert os.sched_getscheduler(0) == before
