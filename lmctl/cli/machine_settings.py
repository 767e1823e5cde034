"""`lmctl machine settings`: firmware settings shown, kept, compared, and written where agreed."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lmctl.cli.cell import CellChoice, cell_options, choose_cell
from lmctl.cli.console import ask_confirmation, print_data, print_json, print_message
from lmctl.cli.paths import InputFile
from lmctl.errors import LmctlError, MachineError, UsageError

if TYPE_CHECKING:
    from lmctl.machine.manual.inspect_motion import MotionReading
    from lmctl.machine.manual.settings import WrittenSettings

#: Exit code of a comparison that finds differences.
_DIFFERENT = 1


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("assignments", nargs=-1, metavar="[32=1 110=6000 ...]")
@cell_options
@click.option("--backup", type=click.Path(path_type=Path), help="Keep all settings in a new file.")
@click.option("--compare", type=InputFile(),
              help="Show how the controller differs from a file; exit code 1 where it does.")
@click.option("--apply", "applied", type=InputFile(),
              help="Write the settings in a file that differ; shown and asked first.")
@click.option("--yes", is_flag=True, help="Do not ask before writing.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.pass_context
def settings(
    ctx: click.Context, assignments: tuple[str, ...], machine: Path | None, sim: bool,
    bench: Path | None, runs_dir: Path, backup: Path | None, compare: Path | None,
    applied: Path | None, yes: bool, as_json: bool,
) -> None:
    """Show the firmware's settings ($$), or write those named as NUMBER=VALUE.

    What is written is shown and asked first, and read back afterwards; what the controller does not
    take is said. Nothing is written while the machine moves or a run has it.
    """
    if (bool(assignments) + (backup is not None) + (compare is not None)
            + (applied is not None)) > 1:
        raise UsageError("NUMBER=VALUE, --backup, --compare and --apply exclude each other",
                         hint="give one of them")
    wanted = _wanted(assignments, applied)
    kept = None if compare is None else _kept(compare)
    cell = choose_cell(machine, sim, bench)
    reading = _read(cell, runs_dir)
    if backup is not None:
        _backup(reading, cell, backup)
    elif kept is not None:
        if _compare(reading.settings, kept, as_json=as_json):
            ctx.exit(_DIFFERENT)
    elif wanted is not None:
        _apply(cell, runs_dir, reading, wanted, yes=yes, as_json=as_json)
    elif as_json:
        print_json({"firmware": _firmware(reading), "settings": {
            str(number): value for number, value in reading.settings.items()}})
    else:
        _show(reading, cell)


def _wanted(assignments: tuple[str, ...], applied: Path | None) -> dict[int, str] | None:
    """The settings to be written, None where none are. Raises UsageError, ConfigError."""
    from lmctl.machine.manual.settings_file import parse_setting

    if applied is not None:
        return _kept(applied)
    found: dict[int, str] = {}
    for word in assignments:
        number, value = parse_setting(word)
        if number in found:
            raise UsageError(f"${number} is named twice", hint="give each setting once")
        found[number] = value
    return found or None


def _kept(path: Path) -> dict[int, str]:
    from lmctl.machine.manual.settings_file import read_settings_file

    return read_settings_file(path)


def _read(cell: CellChoice, runs_dir: Path) -> MotionReading:
    """The controller's settings. Raises MachineError where they cannot be read."""
    from lmctl.config.machine import MachineProfile
    from lmctl.machine.manual.controller import open_motion_controller
    from lmctl.machine.manual.inspect_motion import inspect_controller, read_motion
    from lmctl.run.cell.ownership import lock_machine

    async def look(profile: MachineProfile) -> MotionReading:
        with lock_machine(profile, "lmctl machine settings", runs_dir):
            if profile.safety is not None and profile.safety.relay_timeout_s is not None:
                # Behind an open watchdog relay a controller answers nothing.
                async with open_motion_controller(profile) as motion:
                    return await read_motion(motion)
            return await inspect_controller(profile.motion.endpoint, baud=profile.motion.baud)

    reading = cell.run_on_cell(look)
    if reading.identity is None or not reading.settings:
        raise MachineError(
            f"the controller does not report its settings in state {reading.report.state}",
            hint="`lmctl machine doctor` says what to do about that",
        )
    return reading


def _firmware(reading: MotionReading) -> str:
    identity = reading.identity
    return "" if identity is None else f"{identity.dialect.name} {identity.version}"


def _show(reading: MotionReading, cell: CellChoice) -> None:
    from lmctl.run.cell.setting_conditions import setting_conditions

    print_data(f"{_firmware(reading)}, {len(reading.settings)} settings")
    for number, value in reading.settings.items():
        print_data(_row(number, f"{value:<14}"))
    assert reading.identity is not None
    unmet = [one for one in setting_conditions(
        reading.identity, reading.settings, reading.offset_mm, cell.profile) if not one.is_met]
    for condition in unmet:
        print_data(f"✗ {condition.text}")
        print_data(f"    what to do: {condition.hint}")


def _row(number: int, value: str) -> str:
    from firmware_protocol.setting_names import setting_name

    return f"  ${number:<5}{value} {setting_name(number)}".rstrip()


def _backup(reading: MotionReading, cell: CellChoice, path: Path) -> None:
    from lmctl.machine.manual.settings_file import write_settings_file

    wall = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
    write_settings_file(path, reading.settings, [
        f"{cell.profile.name}: {_firmware(reading)}, {wall}",
        "put back with `lmctl machine settings --apply`",
    ])
    print_data(f"{len(reading.settings)} settings kept in {path}")


def _compare(here: Mapping[int, str], kept: Mapping[int, str], *, as_json: bool) -> bool:
    """Show what differs; returns whether anything does."""
    from lmctl.machine.manual.settings_file import is_same_value

    different = {
        number: (here.get(number), kept.get(number)) for number in sorted(here.keys() | kept.keys())
        if number not in here or number not in kept or not is_same_value(kept[number], here[number])
    }
    if as_json:
        print_json({"different": {
            str(number): {"controller": one, "file": other}
            for number, (one, other) in different.items()}})
    elif not different:
        print_data(f"no difference in {len(kept)} settings")
    else:
        print_data(f"  {'':<6}{'controller':<15}{'file':<15}")
        for number, (one, other) in different.items():
            print_data(_row(number, f"{one or '-':<14} {other or '-':<14}"))
    return bool(different)


def _apply(
    cell: CellChoice, runs_dir: Path, reading: MotionReading, wanted: Mapping[int, str], *,
    yes: bool, as_json: bool,
) -> None:
    """Show, ask, write and verify. Raises MachineError where anything could not be written."""
    from lmctl.machine.manual.settings_file import is_same_value

    here = reading.settings
    changes = {number: value for number, value in wanted.items()
               if number not in here or not is_same_value(value, here[number])}
    if not changes:
        if as_json:
            print_json({"written": {}, "refused": {}, "also_changed": {}})
        else:
            print_data("nothing to write: the controller has these values already")
        return
    for number, value in changes.items():
        print_message(_row(number, f"{here.get(number, 'missing')} -> {value:<10}"))
    count = "this setting" if len(changes) == 1 else f"these {len(changes)} settings"
    if not ask_confirmation(f"Write {count} to the controller?", yes):
        raise click.Abort
    done = _write(cell, runs_dir, changes, {n: here[n] for n in changes if n in here})
    if as_json:
        print_json({
            "written": {str(number): value for number, value in done.written.items()},
            "refused": {str(number): why for number, why in done.refused.items()},
            "also_changed": {str(number): list(values)
                             for number, values in done.also_changed.items()},
        })
    else:
        _put_written(done)
    if done.refused:
        raise MachineError(
            f"{len(done.refused)} of {len(changes)} settings could not be written",
            where=[f"${number}: {why}" for number, why in done.refused.items()],
            hint="see the firmware's manual for these"
            + ("; the others are written and read back" if done.written else ""),
        )


def _put_written(done: WrittenSettings) -> None:
    for number, value in done.written.items():
        print_data(_row(number, f"{value:<14}") + "  written, and read back")
    for number, (old, new) in done.also_changed.items():
        print_data(_row(number, f"{old} -> {new}") + "  changed by the controller itself")
    for message in done.messages:
        print_data(f"  the controller says {message}")
    if done.position_lost:
        print_data(
            "hint: what a position means has changed: `lmctl machine home`, or without homing "
                   "`lmctl machine offset --here`, before anything moves")


def _write(
    cell: CellChoice, runs_dir: Path, changes: Mapping[int, str], before: Mapping[int, str]
) -> WrittenSettings:
    from lmctl.cli.machine_actions import run_journaled, run_with_motion
    from lmctl.config.machine import MachineProfile
    from lmctl.machine.manual.settings import apply_settings

    async def act(profile: MachineProfile) -> WrittenSettings:
        what = {"do": "settings", "wanted": {str(n): v for n, v in changes.items()},
                "before": {str(n): v for n, v in before.items()}}
        return await run_journaled(profile, runs_dir, what, lambda whereabouts: run_with_motion(
            profile, whereabouts, lambda motion: apply_settings(motion, changes)))

    try:
        return cell.run_on_cell(act)
    except LmctlError as error:
        raise MachineError(error.what, where=error.where, hint="; ".join(filter(None, (
            error.hint, "`lmctl machine settings --compare` shows which were written",
        )))) from error
