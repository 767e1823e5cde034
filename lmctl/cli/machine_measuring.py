"""`lmctl machine feeder-test`: hoppers stepped over the catch scale, and what that has shown."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lmctl.cli.calibrations import calibration_path, stored_calibration
from lmctl.cli.cell import CellChoice, cell_options, choose_cell
from lmctl.cli.console import (
    ask_confirmation,
    format_duration,
    print_data,
    print_json,
    print_message,
)
from lmctl.cli.number_types import FiniteRange
from lmctl.cli.operator import operator_name, operator_option
from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.errors import ConfigError, UsageError

if TYPE_CHECKING:
    from lmctl.calibration.calibration_file import Calibration, HopperCalibration
    from lmctl.machine.measuring.feeder_test import FeederTestResult
    from lmctl.machine.measuring.scale_lag import ScaleOperator


@click.command("feeder-test")
@cell_options
@click.option("--hopper", "names", multiple=True, metavar="NAME",
              help="A hopper to test; may be given several times [all].")
@click.option("--limit", "limit_s", type=FiniteRange(60, 3600), default=600.0, show_default=True,
              help="Longest test of one hopper [s].")
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Calibration file to add to [that of the profile, beside it].")
@click.option("--plots", type=click.Path(path_type=Path, file_okay=False),
              help="Folder for a picture of each test [that of the calibration].")
@operator_option
@click.option("--yes", is_flag=True, help="Do not ask.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def feeder_test(
    machine: Path | None, sim: bool, bench: Path | None, runs_dir: Path, names: tuple[str, ...],
    limit_s: float, output: Path | None, plots: Path | None, operator: str | None, yes: bool,
    as_json: bool,
) -> None:
    """Measure dead time, lag, slope and offset of hoppers with the catch scale. The beam stays off.

    First the scale's own lag with a known weight, which you are asked to put on; then each hopper
    is stepped between two flows until its intervals are narrow enough, or the limit is reached.
    """
    cell = choose_cell(machine, sim, bench, calibrated=False)
    hoppers = _hoppers_named(cell.profile, names)
    target = output or calibration_path(cell.profile, cell.profile_path)
    stored_calibration(target, cell.profile.name)  # refused now, not after the test
    who = operator_name(operator)
    if not sim and not ask_confirmation(
        "Powder will run onto the scale, beam off. Is the scale under the nozzle, and the way of "
        "the powder free?", yes
    ):
        raise click.Abort
    results = _run_with_operator(
        cell, lambda profile, hands: _measured(profile, hands, runs_dir, hoppers, limit_s, target,
                                               who))
    pictures = [_draw(result, plots or target.parent) for result in results]
    found = stored_calibration(target, cell.profile.name)
    if as_json:
        print_json({
            "calibration": str(target), "digest": found.digest,
            "hoppers": [{**_entry(found, one).model_dump(mode="json"), "is_precise": one.is_precise,
                         "more_s": round(one.more_s, 1), "doubts": list(one.doubts)}
                        for one in results],
        })
        return
    for result, picture in zip(results, pictures, strict=True):
        for line in result_lines(result, _entry(found, result)):
            print_data(line)
        print_data(f"  picture          {picture}")
    print_data(f"written to {target}, digest {found.digest[:12]}")
    if cell.profile.calibration is None:
        print_message("hint: a table [calibration] in the machine profile makes planning and "
                      "running use it")


def _entry(found: Calibration, result: FeederTestResult) -> HopperCalibration:
    entry = found.hopper_calibration(result.hopper.name)
    assert entry is not None
    return entry


def _hoppers_named(profile: MachineProfile, names: tuple[str, ...]) -> list[HopperSettings]:
    """Raises UsageError for an unknown hopper."""
    known = {hopper.name: hopper for hopper in profile.hopper}
    wrong = [name for name in names if name not in known]
    if wrong:
        raise UsageError(f"{profile.name} has no hopper {', '.join(wrong)}",
                         hint=f"its hoppers: {', '.join(known)}")
    return [known[name] for name in dict.fromkeys(names)] or list(profile.hopper)


def _run_with_operator(
    cell: CellChoice,
    act: Callable[[MachineProfile, ScaleOperator], Coroutine[Any, Any, list[FeederTestResult]]],
) -> list[FeederTestResult]:
    if cell.sim:
        from lmctl.cli.bench import run_on_bench_with_operator

        return run_on_bench_with_operator(act, cell.profile, cell.bench)
    return cell.run_on_cell(lambda profile: act(profile, _AskedOperator()))


class _AskedOperator:
    """The person at the terminal."""

    async def put_on_weight(self, weight_g: float) -> None:
        print_message(f"put the weight of {weight_g:g} g onto the scale, and let go of it")

    async def take_off_weight(self, weight_g: float) -> None:
        print_message("take the weight off")


async def _measured(
    profile: MachineProfile, hands: ScaleOperator, runs_dir: Path, hoppers: list[HopperSettings],
    limit_s: float, target: Path, who: str,
) -> list[FeederTestResult]:
    """Test the hoppers one after the other; each is written as soon as it is measured."""
    from lmctl.calibration.calibration_file import calibration_stamp, save_calibration
    from lmctl.cli.machine_actions import run_journaled
    from lmctl.machine.measuring.calibration_entry import calibration_entry
    from lmctl.machine.measuring.feeder_test import FeederTest
    from lmctl.machine.measuring.scale_lag import measure_scale_lag
    from lmctl.machine.measuring.step_plan import WantedPrecision, plan_steps
    from lmctl.machine.scale.driver import CatchScaleDriver

    settings = profile.scale
    if settings is None:
        raise ConfigError("there is no catch scale to test with",
                          hint="a table [scale] in the machine profile names it; a bench file has "
                          "one too")
    feeders = {feeder.name: feeder for feeder in profile.feeder}
    plans = {hopper.name: plan_steps(hopper, limit_s) for hopper in hoppers}

    async def act(whereabouts: Any) -> list[FeederTestResult]:
        results: list[FeederTestResult] = []
        scale = await CatchScaleDriver.open(settings)
        try:
            scale_lag_s = await measure_scale_lag(scale, hands, settings.weight_g)
            print_message(f"the scale lags by {scale_lag_s.text(3, 's')}")
            for hopper in hoppers:
                test = FeederTest(feeders[hopper.feeder], hopper, scale, scale_lag_s,
                                  plans[hopper.name], WantedPrecision(), print_message)
                result = await test.run()
                entry = calibration_entry(result, profile, by=who or "not named",
                                          measured=calibration_stamp())
                found = stored_calibration(target, profile.name).with_hopper(entry)
                save_calibration(found, target)
                whereabouts.journal.append("measured", hopper=hopper.name, digest=found.digest,
                                           values=entry.model_dump(mode="json"))
                results.append(result)
        finally:
            await scale.close()
        return results

    what = {"do": "feeder-test", "hoppers": [hopper.name for hopper in hoppers], "by": who}
    return await run_journaled(profile, runs_dir, what, act)


def result_lines(result: FeederTestResult, entry: HopperCalibration) -> list[str]:
    """A hopper's test, as people read it."""
    hopper, response, fit = result.hopper, result.response, result.response.one_lag
    lines = [
        f"hopper {hopper.name} ({hopper.material}): {result.steps.history.step_count} steps of "
        f"{result.plan.low_g_min:g} and {result.plan.high_g_min:g} g/min in "
        f"{format_duration(result.steps.duration_s)}",
        f"  dead time        {fit.dead_time_s.text(3, 's'):<22} profile {hopper.dead_time_s:g}",
        f"  lag              {fit.lag_s.text(3, 's'):<22} profile {hopper.lag_s:g}",
        f"  whole response   {response.response_s.text(3, 's')}",
    ]
    if response.two_lags is not None:
        drive = response.two_lags.estimates["drive_lag_s"]
        lines.append(f"  drive lag        {drive.text(2, 's'):<22} beside the hose's, "
                     f"{response.two_lags.lag_s.text(2, 's')}")
        unparted = entry.unparted
        lines.append("  not parted       " + (
            f"{', '.join(unparted)}: only the whole response is sure" if unparted else "nothing"))
    lines += [
        f"  slope            {response.slope.text(4):<22} of the set-point",
        f"  offset           {response.offset_g_min.text(3, 'g/min')}",
        f"  unsteadiness     {100 * fit.noise.rsd:.1f} % over {fit.noise.correlation_s:.1f} s",
    ]
    lines += [f"  doubt            {doubt}" for doubt in result.doubts]
    if not result.is_precise:
        lines.append(f"  go on for        {format_duration(result.more_s)} more, for intervals as "
                     "narrow as wanted (--limit)")
    return lines


def _draw(result: FeederTestResult, folder: Path) -> Path:
    """Raises ConfigError where the picture cannot be written."""
    from lmctl.report.feeder_test_picture import draw_feeder_test

    target = folder / f"feeder-test-{result.hopper.name}.png"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        draw_feeder_test(result, target)
    except OSError as error:
        raise ConfigError.cannot_write(target, error) from None
    return target
