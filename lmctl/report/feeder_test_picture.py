"""A feeder test as a picture: what was set, what the scale saw, and what the fit leaves over."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from lmctl.array_types import FloatArray
from lmctl.calibration.step_response import displayed_mass_g, nozzle_flow_g_min
from lmctl.machine.measuring.feeder_test import FeederTestResult

#: Flow by the scale is a difference over so long [s].
_FLOW_OVER_S = 2.0


def draw_feeder_test(result: FeederTestResult, target: Path) -> None:
    """Draw a test and save it; the ending of `target` chooses the format.

    Raises OSError where the file cannot be written.
    """
    feeder_test_figure(result).savefig(target)


def feeder_test_figure(result: FeederTestResult) -> Figure:
    """Flow set, by the scale and as fitted; the whitened residual; one step averaged over all."""
    steps, fit = result.steps, result.response.two_lags or result.response.one_lag
    time_s, start_s = steps.time_s, steps.time_s[0]
    lags_s = [fit.lag_s.value, fit.estimates["scale_lag_s"].value]
    if "drive_lag_s" in fit.estimates:
        lags_s.append(fit.estimates["drive_lag_s"].value)
    way = {"dead_time_s": fit.dead_time_s.value, "slope": fit.slope.value,
           "offset_g_min": fit.offset_g_min.value}
    fitted = nozzle_flow_g_min(time_s, steps.history, lags_s=lags_s, **way)
    figure = Figure(figsize=(9.5, 7.0), dpi=110, layout="constrained")
    flow, rest = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    set_s = np.append(steps.history.time_s[1:], time_s[-1]) - start_s
    flow.stairs(steps.history.flow_g_min[1:], set_s, color="0.6", label="set", baseline=None)
    span = max(int(_FLOW_OVER_S / float(np.median(np.diff(time_s)))), 1)
    seen = 60.0 * (steps.mass_g[span:] - steps.mass_g[:-span]) / (time_s[span:] - time_s[:-span])
    flow.plot((time_s[span:] + time_s[:-span]) / 2 - start_s, seen, lw=0.7, color="#c25b12",
              label=f"by the scale, over {_FLOW_OVER_S:g} s")
    flow.plot(time_s - start_s, fitted, lw=1.2, color="#1f5fa8", label="fitted, behind the scale")
    flow.set_ylabel("flow [g/min]")
    flow.legend(loc="upper right", fontsize=8, ncols=3)
    flow.set_ylim(0.0, 1.25 * float(max(fitted.max(), steps.history.flow_g_min.max())))
    flow.set_title(
        f"hopper {result.hopper.name} ({result.hopper.material}): dead time "
        f"{fit.dead_time_s.text(3, 's')}, lag {fit.lag_s.text(3, 's')}, slope "
        f"{fit.slope.text(4)}", fontsize=10)
    over = steps.mass_g - displayed_mass_g(time_s, steps.history, lags_s=lags_s, **way)
    rest.plot(time_s - start_s, over - over[0], lw=0.8, color="#1f5fa8")
    sigma_g = _mass_error_g(time_s, fitted, fit.noise.rsd, fit.noise.correlation_s)
    rest.fill_between(time_s - start_s, -2 * sigma_g, 2 * sigma_g, color="0.88",
                      label="±2 standard deviations of noise added up")
    rest.set_ylabel("mass left over [g]")
    rest.set_xlabel("time [s]")
    rest.legend(loc="upper left", fontsize=8)
    return figure


def _mass_error_g(
    time_s: FloatArray, flow_g_min: FloatArray, rsd: float, correlation_s: float
) -> FloatArray:
    """Standard deviation of the mass that noise has added up to, long against its correlation."""
    step_s = np.diff(time_s, prepend=time_s[0])
    return np.sqrt(np.cumsum(2.0 * correlation_s * (rsd * flow_g_min / 60.0) ** 2 * step_s))
