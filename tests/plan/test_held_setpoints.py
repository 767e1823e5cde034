"""Set-points as planning predicts them are those that running sends; the nozzle's flow from them
against a fine numerical integration."""

from bisect import bisect_right

import numpy as np
import pytest

from lmctl.config.machine import HopperSettings
from lmctl.plan.sequence.held_setpoints import HeldSetpoints, SetpointChanges
from lmctl.plan.sequence.nozzle_flow import CellValues, nozzle_flow_g_s
from lmctl.preflight.setpoint_rules import MAX_TICKS, SETPOINT_PERIOD_S
from lmctl.run.powder.lead import HoseDynamics, PowderPlan


def hopper(name, dead_time_s, lag_s, **more):
    return HopperSettings(name=name, feeder="F", material=name, dead_time_s=dead_time_s,
                          lag_s=lag_s, min_flow_g_min=0.8, max_flow_g_min=30, **more)


HOPPERS = (hopper("A", 3.0, 1.0), hopper("B", 2.53, 0.8))


class SteadyClock:
    """Program time as planned, from machine time 0 on."""

    rate, is_override_pending = 1.0, False

    def program_time_s(self, t):
        return max(t, 0.0)

    def program_time_ahead_s(self, t, machine_s):
        return max(t + machine_s, 0.0)

    def override_at(self, s):
        return 1.0


class FlowTable:
    """What a window of a job says of its flow."""

    def __init__(self, times_s, flow_g_s):
        self.times_s, self.flow = times_s.tolist(), flow_g_s

    def flow_g_s(self, hopper, s):
        return float(np.interp(s, self.times_s, self.flow[:, hopper]))

    def flow_steady_until_s(self, hopper, s):
        after = steady = bisect_right(self.times_s, s)
        while 0 < steady < len(self.times_s) and (
                self.flow[steady, hopper] == self.flow[steady - 1, hopper]):
            steady += 1
        return self.times_s[steady - 1] if steady > after else s


def wanted():
    """Knots of two flows [g/s]: ramps, jumps, nothing, and a while of steady flow."""
    random = np.random.default_rng(3)
    times = np.concatenate([[0.0], np.cumsum(random.uniform(0.3, 3.0, 60))])
    flow = random.uniform(1.0, 20.0, (61, 2)) / 60.0
    flow[20:32] = flow[20]
    flow[45:48, 1] = 0.0
    return times, flow


def sent_by_running(times_s, flow_g_s, mode):
    """(k, 3) ticks at which set-points change and both set-points, as the sender goes about it."""
    hoses = [HoseDynamics(h.dead_time_s, h.lag_s, h.max_flow_g_min, h.min_flow_g_min)
             for h in HOPPERS]
    plan = PowderPlan(mode, hoses, FlowTable(times_s, flow_g_s), SteadyClock())
    plan.start()
    tick, ticks, changes = round(-plan.lead_s / SETPOINT_PERIOD_S), 0, []
    while tick * SETPOINT_PERIOD_S <= times_s[-1]:
        t = tick * SETPOINT_PERIOD_S
        flows = list(plan.setpoints_g_min(t, ticks))
        if not changes or changes[-1][1:] != flows:
            changes.append([t, *flows])
        ticks = int(min(max(round(plan.valid_for_s(t) / SETPOINT_PERIOD_S, 6), 1), MAX_TICKS))
        tick += ticks
    return np.array(changes)


@pytest.mark.parametrize("mode", ["lead", "none"])
def test_predicted_set_points_are_those_that_running_sends(mode):
    times, flow = wanted()
    predicted = HeldSetpoints(HOPPERS, leads=mode == "lead")
    for first in range(0, 60, 7):  # layer by layer, of which the next begins where one ends
        predicted.add_flow(times[first : first + 8], flow[first : first + 8])
    predicted.finish()
    changes = predicted.changes_since(-np.inf).until(times[-1])
    sent = sent_by_running(times, flow, mode)
    assert len(sent) > 100
    assert changes.time_s == pytest.approx(sent[:, 0])
    assert changes.setpoint_g_min == pytest.approx(sent[:, 1:])


def test_set_points_follow_the_hoppers_own_law():
    """A hopper that feeds 0.2 g/min more than 1.1 times its set-point is set that much lower."""
    times, flow = wanted()
    as_is = HeldSetpoints(HOPPERS, leads=True)
    other = HeldSetpoints((HOPPERS[0].model_copy(update={"slope": 1.1, "offset_g_min": 0.2}),
                           HOPPERS[1]), leads=True)
    for setpoints in (as_is, other):
        setpoints.add_flow(times, flow)
        setpoints.finish()
    fed, set_ = (setpoints.changes_since(-np.inf).setpoint_g_min for setpoints in (as_is, other))
    stands = fed[:, 0] == 0.0
    assert 0.2 + 1.1 * set_[~stands, 0] == pytest.approx(fed[~stands, 0], abs=0.006)
    assert not set_[stands, 0].any()
    assert set_[:, 1] == pytest.approx(fed[:, 1])


@pytest.mark.parametrize("drive_lag_s", [0.0, 0.3, 0.8])
def test_nozzle_flow_against_integration(drive_lag_s):
    """Euler in steps of 0.1 ms: drive, dead time, hose; what is fed is offset + slope · set-point,
    and nothing at set-point 0."""
    changes = SetpointChanges(np.array([0.0, 2.0, 2.4, 5.0, 7.0]),
                              np.array([[6.0], [12.0], [3.0], [0.0], [9.0]]))
    values = CellValues(*(np.array([v]) for v in (1.3, 0.8, drive_lag_s, 1.05, -0.2, 0.7)))
    at = np.linspace(0.5, 11.5, 50)
    step = 1e-4
    t = np.arange(0.0, 12.0, step)
    setpoint = changes.setpoint_g_min[np.searchsorted(changes.time_s, t, side="right") - 1, 0]
    drive = np.where(setpoint > 0, -0.2 + 1.05 * setpoint, 0.0) / 60.0
    if drive_lag_s:
        drive = lagged(drive, drive_lag_s, step)
    late = np.interp(t - 1.3, t, drive, left=drive[0])
    expected = np.interp(at, t, lagged(late, 0.8, step))
    assert nozzle_flow_g_s(changes, values, at)[:, 0] == pytest.approx(expected, abs=2e-4)


def lagged(inflow, lag_s, step_s):
    y = np.empty_like(inflow)
    y[0] = inflow[0]
    for i in range(len(inflow) - 1):
        y[i + 1] = y[i] + step_s / lag_s * (inflow[i] - y[i])
    return y
