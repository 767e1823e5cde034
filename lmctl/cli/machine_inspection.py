"""`lmctl machine status|doctor`: looking at every device, moving and writing nothing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lmctl.cli.cell import CellChoice, cell_options, choose_cell
from lmctl.cli.console import print_data, print_json
from lmctl.config.machine import MachineProfile
from lmctl.errors import ConfigError, LmctlError, MachineError

if TYPE_CHECKING:
    from lmctl.machine.manual.inspect_modbus import FeederInspection
    from lmctl.machine.manual.inspect_motion import MotionReading
    from lmctl.machine.safety.status import SafetyStatus
    from lmctl.run.cell.condition import StartCondition
    from lmctl.run.cell.doctor import CellInspection


@click.command()
@cell_options
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.pass_context
def status(
    ctx: click.Context, machine: Path | None, sim: bool, bench: Path | None, runs_dir: Path,
    as_json: bool,
) -> None:
    """One look at every device of the cell. Exit code 4 where one cannot be reached."""
    cell = choose_cell(machine, sim, bench)
    seen = cell.run_on_cell(lambda profile: inspect(profile, "lmctl machine status", runs_dir))
    found = {
        "motion": _motion_facts(seen.motion),
        "feeders": {name: _feeder_facts(one) for name, one in seen.feeders.items()},
        "safety": None if seen.safety is None else _safety_facts(seen.safety),
    }
    if as_json:
        print_json(found)
    else:
        _put_facts(found, cell.profile)
    if any(isinstance(one, LmctlError) for one in (seen.motion, seen.safety,
                                                   *seen.feeders.values())):
        ctx.exit(MachineError.exit_code)


@click.command()
@cell_options
@click.option("--close-relay", is_flag=True,
              help="Close the watchdog relay first, as a run does, so that a controller behind it "
              "can be asked too.")
@click.option("--search", is_flag=True,
              help="Look for a motion controller that is silent on a serial port at other rates.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.pass_context
def doctor(
    ctx: click.Context, machine: Path | None, sim: bool, bench: Path | None, runs_dir: Path,
    close_relay: bool, search: bool, as_json: bool,
) -> None:
    """Check every condition of a run's start, and what to do, without moving or writing anything.

    Exit code 4 where a run would be refused, 1 where something else should be mended, 0 where all
    is well.
    """
    from lmctl.run.cell.doctor import check_inspection

    cell = choose_cell(machine, sim, bench, calibrated=False)
    seen = cell.run_on_cell(lambda profile: inspect(profile, "lmctl machine doctor", runs_dir,
                                                    close_relay=close_relay, search=search))
    found = check_inspection(seen, cell.profile) | _calibration_conditions(cell)
    conditions = [condition for of_device in found.values() for condition in of_device]
    unmet = [condition for condition in conditions if not condition.is_met]
    refusing = [condition for condition in unmet if condition.refuses_run]
    if as_json:
        print_json({
            "good": not unmet,
            "checks": [
                {"device": device, "good": condition.is_met, "text": condition.text,
                 "hint": "" if condition.is_met else condition.hint,
                 "refuses_run": condition.refuses_run}
                for device, of_device in found.items() for condition in of_device
            ],
        })
    else:
        for device, of_device in found.items():
            print_data(device)
            for condition in of_device:
                print_data(f"  {'✓' if condition.is_met else '✗'} {condition.text}")
                if not condition.is_met and condition.hint:
                    print_data(f"      what to do: {condition.hint}")
        print_data(f"{len(conditions)} checks, " + (
            "all well" if not unmet
            else f"{len(unmet)} to mend" + (f"; a run would be refused for {len(refusing)} of them"
                                            if refusing else "; a run would start")
        ))
    if unmet:
        ctx.exit(MachineError.exit_code if refusing else 1)


def _calibration_conditions(cell: CellChoice) -> dict[str, list[StartCondition]]:
    """What the calibration holds that the profile names, and what is doubtful about it."""
    from lmctl.calibration.validity import calibrated_profile
    from lmctl.cli.calibrations import judged_calibration
    from lmctl.run.cell.condition import StartCondition

    try:
        judged = judged_calibration(cell.profile, cell.profile_path)
    except ConfigError as error:
        return {"calibration": [StartCondition(False, "; ".join([error.what, *error.where]),
                                               error.hint, refuses_run=True)]}
    if judged is None:
        return {}
    conditions = [
        StartCondition(False, f"{finding.what}: {finding.text}", "measure again, or correct the "
                       "profile", refuses_run=finding.refuses)
        for finding in judged.findings
    ]
    if judged.found is not None:
        use = calibrated_profile(cell.profile, judged.found).calibration_use
        conditions.insert(0, StartCondition(True, f"calibration {use.text if use else ''}"))
    return {"calibration": conditions}


async def inspect(
    profile: MachineProfile, who: str, runs_dir: Path, *, close_relay: bool = False,
    search: bool = False,
) -> CellInspection:
    """Look at all devices. Raises MachineError where the machine is in other hands."""
    from lmctl.run.cell.doctor import inspect_cell
    from lmctl.run.cell.ownership import lock_machine

    with lock_machine(profile, who, runs_dir):  # a controller at work must not be asked by two
        return await inspect_cell(profile, runs_dir, close_relay=close_relay, search=search)


def _error(error: LmctlError) -> dict[str, Any]:
    return {"error": error.what, "where": list(error.where), "hint": error.hint}


def _motion_facts(look: MotionReading | LmctlError) -> dict[str, Any]:
    if isinstance(look, LmctlError):
        return _error(look)
    report, identity = look.report, look.identity
    return {
        "firmware": None if identity is None else f"{identity.dialect.name} {identity.version}",
        "state": report.state, "substate": report.substate,
        "position_mm": None if look.position_mm is None else list(look.position_mm),
        "position_trusted": look.is_position_trusted, "homed": look.is_homed,
        "pins": report.active_pins or "",
        "overrides_percent":
            None if report.override_percents is None else list(report.override_percents),
        "blocks_free": report.planner_blocks_free, "rx_free": report.rx_bytes_free,
    }


def _feeder_facts(look: FeederInspection | LmctlError) -> dict[str, Any]:
    if isinstance(look, LmctlError):
        return _error(look)
    status = look.status
    return {
        "state": status.state.name, "mode": status.mode.name,
        "alarm": None if status.alarm is None else status.alarm.text,
        "what_to_do": None if status.alarm is None else status.alarm.remedy,
        "warnings": [{"what": one.text, "what_to_do": one.remedy} for one in status.warnings],
        "gas_L_min": status.total_gas_L_min,
        "mixer_pressure_mbar": status.mixer_pressure_mbar,
        "hoppers": {
            name: {"level_percent": reading.level_percent,
                   "flow_g_min": reading.flow_estimated_g_min,
                   "carrier_L_min": reading.carrier_L_min}
            for name, reading in status.hoppers.items()
        },
    }


def _safety_facts(look: SafetyStatus | LmctlError) -> dict[str, Any]:
    if isinstance(look, LmctlError):
        return _error(look)
    return {
        "open": [one.text for one in look.open_inputs], "relay_closed": look.relay_closed,
        "laser_enabled": look.laser_enabled,
        "shield_gas_L_min": look.shield_gas_L_min, "chiller_C": look.chiller_C,
        "chiller_L_min": look.chiller_L_min, "oxygen_ppm": look.oxygen_ppm,
        "extraction_Pa": look.extraction_Pa,
    }


def _put_facts(found: dict[str, Any], profile: MachineProfile) -> None:
    _put_device("motion", profile.motion.endpoint, found["motion"], _put_motion)
    for feeder in profile.feeder:
        _put_device(f"feeder {feeder.name}", feeder.endpoint, found["feeders"][feeder.name],
                    _put_feeder)
    if found["safety"] is not None and profile.safety is not None:
        _put_device("safety", profile.safety.endpoint, found["safety"], _put_safety)


def _put_device(name: str, endpoint: str, facts: dict[str, Any], put_facts: Any) -> None:
    print_data(f"{name}  {endpoint}")
    if "error" not in facts:
        put_facts(facts)
        return
    print_data(f"  cannot be looked at: {facts['error']}")
    for place in facts["where"]:
        print_data(f"    {place}")
    if facts["hint"]:
        print_data(f"    what to do: {facts['hint']}")


def _put_motion(facts: dict[str, Any]) -> None:
    sub = "" if facts["substate"] is None else f":{facts['substate']}"
    print_data(
        f"  state      {facts['state']}{sub}" + (f", {facts['firmware']}" if facts["firmware"]
                                                        else ""))
    at = facts["position_mm"]
    place = "not reported" if at is None else "  ".join(
        f"{axis} {value:.3f}" for axis, value in zip("XYZ", at, strict=False)) + " mm"
    print_data(
        f"  position   {place}"
        + ("" if facts["position_trusted"] else " (not known: home the machine)"))
    if facts["overrides_percent"] is not None:
        feed, rapid, spindle = facts["overrides_percent"]
        print_data(f"  overrides  feed {feed} %, rapid {rapid} %, power {spindle} %")
    if facts["blocks_free"] is not None:
        print_data(f"  free       {facts['blocks_free']} blocks, {facts['rx_free']} bytes")
    print_data(f"  inputs     {facts['pins'] or 'none active'}")


def _put_feeder(facts: dict[str, Any]) -> None:
    print_data(f"  state      {facts['state']}, switch at {facts['mode']}")
    if facts["alarm"]:
        print_data(f"  alarm      {facts['alarm']}")
        print_data(f"             what to do: {facts['what_to_do']}")
    for warning in facts["warnings"]:
        print_data(f"  warning    {warning['what']}")
        print_data(f"             what to do: {warning['what_to_do']}")
    print_data(f"  gas        {_number(facts['gas_L_min'], '.1f')} L/min, mixer pressure "
               f"{_number(facts['mixer_pressure_mbar'], '.0f')} mbar")
    for name, hopper in facts["hoppers"].items():
        print_data(f"  hopper {name:<4}level {_number(hopper['level_percent'], '.0f')} %, "
                   f"{_number(hopper['flow_g_min'], '.2f')} g/min")


def _put_safety(facts: dict[str, Any]) -> None:
    print_data(f"  inputs     {'; '.join(facts['open']) or 'all good'}")
    if facts["relay_closed"] is not None:
        print_data("  relay      " + ("closed" if facts["relay_closed"] else
                              "open, as it is while no host sends heartbeats: wired to the "
                              "controller's door input, it is an open door there"))
    if facts["laser_enabled"] is not None:
        print_data(f"  laser      enable output {'on' if facts['laser_enabled'] else 'off'}")
    for key, name, unit in (
        ("shield_gas_L_min", "shield gas", "L/min"), ("chiller_C", "chiller", "°C"),
        ("chiller_L_min", "chiller", "L/min"), ("oxygen_ppm", "oxygen", "ppm"),
        ("extraction_Pa", "extraction", "Pa"),
    ):
        if facts[key] is not None:
            print_data(f"  {name:<11}{facts[key]:g} {unit}")


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
