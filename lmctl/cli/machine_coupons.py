"""`lmctl machine catch-test|dilution-test`: coupons that are deposited, weighed and cut."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from lmctl.cli.calibrations import calibration_path, stored_calibration
from lmctl.cli.cell import CellChoice, cell_options, choose_cell
from lmctl.cli.console import ask_confirmation, print_data, print_json, print_message
from lmctl.cli.operator import operator_name, operator_option
from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.config.materials import find_material
from lmctl.errors import UsageError

if TYPE_CHECKING:
    from lmctl.calibration.calibration_file import CatchCalibration, DilutionCalibration
    from lmctl.calibration.coupons import Coupon
    from lmctl.cli.coupon_runs import CouponOperator

T = TypeVar("T")

#: An answer that cannot be right is asked for again so often.
_ASKED_AGAIN = 2

_output_option = click.option("-o", "--output", type=click.Path(path_type=Path),
                              help="Calibration file to add to [that of the profile, beside it].")


@click.command("catch-test")
@cell_options
@click.option("--material", "names", multiple=True, metavar="NAME",
              help="A powder to test; may be given several times [those of all hoppers].")
@click.option("--no-mixture", is_flag=True, help="Lay no coupon of a mixture.")
@_output_option
@operator_option
@click.option("--yes", is_flag=True, help="Do not ask.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def catch_test(
    machine: Path | None, sim: bool, bench: Path | None, runs_dir: Path, names: tuple[str, ...],
    no_mixture: bool, output: Path | None, operator: str | None, yes: bool, as_json: bool,
) -> None:
    """Measure how much of each powder stays on the part: coupons, weighed by you.

    Lays a coupon of each powder, and one of the first two half and half by volume, each on a plate
    of its own. You weigh the plate before and after, to 0.01 g, and type the mass with its unit.
    """
    cell = choose_cell(machine, sim, bench, calibrated=False)
    materials = _materials_named(cell.profile, names)
    target = output or calibration_path(cell.profile, cell.profile_path)
    who = operator_name(operator)
    _ask_for_coupons(sim, yes)

    async def act(profile: MachineProfile, hands: CouponOperator) -> list[CatchCalibration]:
        return await _caught(profile, hands, runs_dir, materials, not no_mixture, target, who)

    found = _run_with_hands(cell, act)
    digest = stored_calibration(target, cell.profile.name).digest
    if as_json:
        print_json({"calibration": str(target), "digest": digest,
                    "catch": [one.model_dump(mode="json") for one in found]})
        return
    for one in found:
        what = " + ".join(f"{share:.0%} {name}" for name, share in one.mass_shares.items())
        print_data(f"{what if len(one.mass_shares) > 1 else what.partition(' ')[2]}: "
                   f"{one.efficiency.value:.3f} ± {one.efficiency.half_width:.3f}, "
                   f"{one.deposited_g:.2f} g of {one.fed_g:.2f} g")
    for line in _interaction(found):
        print_data(line)
    print_data(f"written to {target}, digest {digest[:12]}")


@click.command("dilution-test")
@cell_options
@click.option("--material", required=True, help="The powder to lay.")
@click.option("--substrate", required=True, help="The plate's alloy, as part files call it.")
@_output_option
@operator_option
@click.option("--yes", is_flag=True, help="Do not ask.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def dilution_test(
    machine: Path | None, sim: bool, bench: Path | None, runs_dir: Path, material: str,
    substrate: str, output: Path | None, operator: str | None, yes: bool, as_json: bool,
) -> None:
    """Measure dilution against energy per length: single tracks on a known plate, cut or analysed.

    Lays a track at each of three speeds. You cut or analyse it, and type the share of the plate in
    the bead ("18.3 %"), or the section's areas above and below the plate ("2.10 mm2 / 0.47 mm2").
    """
    cell = choose_cell(machine, sim, bench, calibrated=False)
    _materials_named(cell.profile, (material,))
    target = output or calibration_path(cell.profile, cell.profile_path)
    who = operator_name(operator)
    _ask_for_coupons(sim, yes)

    async def act(profile: MachineProfile, hands: CouponOperator) -> list[DilutionCalibration]:
        return await _diluted(profile, hands, runs_dir, material, substrate, target, who)

    found = _run_with_hands(cell, act)
    digest = stored_calibration(target, cell.profile.name).digest
    if as_json:
        print_json({"calibration": str(target), "digest": digest,
                    "dilution": [one.model_dump(mode="json") for one in found]})
        return
    for one in found:
        print_data(f"{one.energy_J_mm:.0f} J/mm: dilution {100 * one.dilution.value:.1f} ± "
                   f"{100 * one.dilution.half_width:.1f} %")
    print_data(f"written to {target}, digest {digest[:12]}")


def _ask_for_coupons(sim: bool, yes: bool) -> None:
    if not sim and not ask_confirmation(
        "Coupons will be deposited, beam on. Is the first plate clamped, and the cell closed?", yes
    ):
        raise click.Abort


def _materials_named(profile: MachineProfile, names: tuple[str, ...]) -> list[str]:
    """Raises UsageError for a powder that no hopper holds, or of which no recipe is known."""
    held = list(dict.fromkeys(hopper.material for hopper in profile.hopper))
    wrong = [name for name in names if name not in held]
    if wrong:
        raise UsageError(f"no hopper of {profile.name} holds {', '.join(wrong)}",
                         hint=f"they hold {', '.join(held)}")
    chosen = list(dict.fromkeys(names)) or held
    unknown = [name for name in chosen if find_material(name) is None]
    if unknown:
        raise UsageError(f"no recipe is known for a coupon of {', '.join(unknown)}",
                         hint="name powders of the library by --material, and test others by hand")
    return chosen


def _run_with_hands(
    cell: CellChoice, act: Callable[[MachineProfile, CouponOperator], Coroutine[Any, Any, T]]
) -> T:
    if cell.sim:
        from lmctl.cli.bench import run_on_bench_with_operator

        return run_on_bench_with_operator(act, cell.profile, cell.bench)
    return cell.run_on_cell(lambda profile: act(profile, _AskedAtTerminal()))


class _AskedAtTerminal:
    """The person at the terminal, asked while the cell is at rest."""

    async def weigh_plate(self, request: str) -> str:
        return str(click.prompt(request, err=True))

    async def analyse_track(self, request: str) -> str:
        return str(click.prompt(request, err=True))


def _measured_profile(profile: MachineProfile, target: Path) -> MachineProfile:
    """The profile with the feeder tests of a calibration: coupons are fed by measured hoppers."""
    from lmctl.calibration.validity import calibrated_profile

    found = stored_calibration(target, profile.name)
    untested = [h.name for h in profile.hopper if found.hopper_calibration(h.name) is None]
    if untested:
        print_message(f"warning: hopper {', '.join(untested)} has no feeder test, so that what it "
                      "feeds is known to 6 % only: run `lmctl machine feeder-test` first")
    return calibrated_profile(profile, found)


async def _caught(
    profile: MachineProfile, hands: CouponOperator, runs_dir: Path, materials: list[str],
    with_mixture: bool, target: Path, who: str,
) -> list[CatchCalibration]:
    from lmctl.calibration.coupons import weighing_coupon

    coupons = [weighing_coupon({material: 1.0}) for material in materials]
    if with_mixture and len(materials) > 1:
        coupons.append(weighing_coupon({materials[0]: 0.5, materials[1]: 0.5}))
    laid_with = _measured_profile(profile, target)
    return [await _weighed(coupon, laid_with, hands, runs_dir, target, who) for coupon in coupons]


async def _weighed(
    coupon: Coupon, profile: MachineProfile, hands: CouponOperator, runs_dir: Path, target: Path,
    who: str,
) -> CatchCalibration:
    """Lay one coupon, have it weighed, and write what that says."""
    from lmctl.calibration.calibration_file import (
        CatchCalibration,
        MeasuredValue,
        calibration_stamp,
        save_calibration,
    )
    from lmctl.calibration.coupons import catch_estimate, check_weights
    from lmctl.calibration.entered_values import parse_mass_g
    from lmctl.cli.coupon_runs import lay_coupon
    from lmctl.machine.measuring.calibration_entry import conditions_of

    async def empty() -> tuple[float, float]:
        return parse_mass_g(await hands.weigh_plate(
            f"coupon {coupon.name}: weigh an empty plate and clamp it; its mass, with unit"))

    async def laden() -> tuple[float, float]:
        mass_g, step_g = parse_mass_g(await hands.weigh_plate(
            f"coupon {coupon.name}: let it cool to room temperature, brush off loose powder, "
            "weigh; its mass, with unit"))
        check_weights(before_g, mass_g, fed_g)
        return mass_g, step_g

    before_g, step_g = await _until_plausible(empty)
    laid = await lay_coupon(coupon, profile, runs_dir, who)
    fed_g = sum(laid.fed_g.values())
    after_g, after_step_g = await _until_plausible(laden)
    stored = stored_calibration(target, profile.name)
    hoppers = {m: _hopper_of(profile, m) for m in laid.fed_g}
    estimate = catch_estimate(
        after_g - before_g, max(step_g, after_step_g), laid.fed_g, laid.beam_on_s,
        {m: stored.hopper_calibration(h.name) for m, h in hoppers.items()})
    found = CatchCalibration(
        mass_shares={m: round(mass / fed_g, 5) for m, mass in laid.fed_g.items()},
        conditions=conditions_of(profile, hoppers[next(iter(laid.fed_g))],
                                 by=who or "not named", measured=calibration_stamp()),
        efficiency=MeasuredValue.of(estimate), fed_g=round(fed_g, 4),
        deposited_g=round(after_g - before_g, 4))
    save_calibration(stored.with_catch(found), target)
    return found


async def _until_plausible(ask: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """What is answered; a slip is told and asked again, so that it costs no coupon.

    Raises UsageError after several.
    """
    for _ in range(_ASKED_AGAIN):
        try:
            return await ask()
        except UsageError as error:
            print_message(error.render())
    return await ask()


def _hopper_of(profile: MachineProfile, material: str) -> HopperSettings:
    return next(hopper for hopper in profile.hopper if hopper.material == material)


def _interaction(found: list[CatchCalibration]) -> list[str]:
    """How a mixture is caught, against its powders by themselves."""
    single = {next(iter(one.mass_shares)): one.efficiency.value
              for one in found if len(one.mass_shares) == 1}
    lines = []
    for one in found:
        if len(one.mass_shares) > 1 and one.mass_shares.keys() <= single.keys():
            alone = sum(share * single[name] for name, share in one.mass_shares.items())
            lines.append(f"the mixture is caught {100 * (one.efficiency.value / alone - 1):+.1f} % "
                         "against its powders by themselves")
    return lines


async def _diluted(
    profile: MachineProfile, hands: CouponOperator, runs_dir: Path, material: str, substrate: str,
    target: Path, who: str,
) -> list[DilutionCalibration]:
    from lmctl.calibration.calibration_file import (
        DilutionCalibration,
        MeasuredValue,
        calibration_stamp,
        save_calibration,
    )
    from lmctl.calibration.coupons import dilution_coupon
    from lmctl.calibration.entered_values import ANALYSIS_ERROR, parse_dilution
    from lmctl.calibration.estimate import Estimate
    from lmctl.cli.coupon_runs import lay_coupon
    from lmctl.machine.measuring.calibration_entry import conditions_of
    from lmctl.plan.recipe import MOST_FASTER_FACTOR, MOST_SLOWER_FACTOR

    # multiples of the powder's own speed, so of its energy per length: as far as plans change it
    speed_factors = (1 / MOST_SLOWER_FACTOR, 1.0, MOST_FASTER_FACTOR)
    library = find_material(material)
    assert library is not None  # looked for before
    laid_with = _measured_profile(profile, target)
    found = []
    for number, factor in zip(itertools.count(1), speed_factors, strict=False):
        coupon = dilution_coupon(material, round(library.speed_mm_s * factor, 3))
        laid = await lay_coupon(coupon, laid_with, runs_dir, who)
        request = (f"track {number} of {len(speed_factors)}, {laid.energy_J_mm:.0f} J/mm: cut or "
                   "analyse it; share of the plate in the bead, as 18.3 %")

        async def analysed(request: str = request) -> float:
            return parse_dilution(await hands.analyse_track(request))

        share = await _until_plausible(analysed)
        one = DilutionCalibration(
            material=material, substrate=substrate,
            conditions=conditions_of(profile, _hopper_of(profile, material),
                                     by=who or "not named", measured=calibration_stamp()),
            energy_J_mm=round(laid.energy_J_mm, 2),
            dilution=MeasuredValue.of(Estimate(share, ANALYSIS_ERROR)))
        save_calibration(stored_calibration(target, profile.name).with_dilution(one), target)
        found.append(one)
    return found
