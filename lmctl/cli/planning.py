"""What `plan` and `demo` share: open whatever the user named as a part, plan it, say the totals."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lmctl.cli.console import format_duration, print_message, progress_bar, wrapped
from lmctl.cli.interrupts import interruptible
from lmctl.config.machine import MachineProfile
from lmctl.config.measuring import calibration_text
from lmctl.errors import UsageError
from lmctl.job.dilution_text import dilution_text
from lmctl.job.margins_text import margins_text
from lmctl.part.up_axis import UP_AXES

if TYPE_CHECKING:
    from lmctl.job.schema import JobManifest
    from lmctl.part.part import Part
    from lmctl.plan.planner import PlanOptions

#: Of the commands that open a part.
units_option = click.option(
    "--units", type=click.Choice(["mm", "cm", "m", "inch"]), help="Units of a bare mesh or cloud."
)
up_option = click.option(
    "--up", type=click.Choice(UP_AXES), help="Axis of a bare mesh or cloud that points up [z]."
)


def check_bare_options(path: Path, units: str | None, up: str | None) -> None:
    """Raise UsageError where options of a bare mesh or cloud are given for another file."""
    if path.suffix.lower() not in (".toml", ".lmj"):
        return
    if units is not None:
        raise UsageError("--units is for a bare mesh or cloud", where=str(path),
                         hint="a part file states the units of each of its bodies")
    if up is not None:
        raise UsageError("--up is for a bare mesh or cloud", where=str(path),
                         hint='in a part file a body of kind "moved" turns another: '
                         "`lmctl help part.body.moved`")


@interruptible()
def open_part(path: Path, units: str | None = None, up: str | None = None) -> Part:
    """A part file, or a bare mesh or cloud; reports what was taken by default."""
    from lmctl.part.load import load_part, part_from_model

    check_bare_options(path, units, up)
    if path.is_dir():
        inside = [file for file in sorted(path.glob("*.toml")) if file.stem == path.name]
        raise UsageError(f"{path} is a folder, not a part",
                         hint=f"did you mean {inside[0]}?" if inside else "name a file in it")
    if path.suffix.lower() != ".toml":
        part = part_from_model(path, units=units, up=up or "z", report=print_message)
    else:
        part = load_part(path, report=print_message)
    for text in part.notes:
        print_message(wrapped(f"note: {text}"))
    return part


def check_target_writable(target: Path) -> None:
    """Raise UsageError where no file can be written to."""
    if target.is_dir():
        raise UsageError(f"{target} is a folder", hint="give -o a file name, such as part.lmj")
    if not target.parent.is_dir():
        raise UsageError(f"there is no folder {target.parent}", hint="make it first")


def plan_to_file(
    part: Part, profile: MachineProfile, target: Path, options: PlanOptions | None = None
) -> JobManifest:
    """Plan a part into `target`, with a progress bar on a terminal; all of the file or nothing."""
    from lmctl.plan.execution import usable_cores
    from lmctl.plan.planner import PlanOptions, plan_job

    check_target_writable(target)
    begin_s = time.monotonic()
    with progress_bar("planning") as update, interruptible() as check_interrupt:
        def layer_done(done: int, total: int) -> None:
            check_interrupt()
            left_s = (time.monotonic() - begin_s) / done * (total - done)
            update(done, total, f"layer {done} of {total}, {format_duration(left_s)} left")

        return plan_job(part, profile, target, layer_done,
                        options or PlanOptions(jobs=usable_cores()))


def job_summary(manifest: JobManifest, target: Path) -> str:
    """A job in a few lines, for people."""
    totals = manifest.totals
    powder = ", ".join(f"{name} {grams:.1f} g" for name, grams in totals["powder_g"].items())
    lines = [
        f"{manifest.part_name}: {totals['layers']} layers, {totals['contours']} contours, "
        f"{totals['vertices']} vertices",
        f"  path      {totals['path_length_mm'] / 1000:.2f} m, "
        f"beam on {format_duration(totals['laser_on_s'])} "
        f"of {format_duration(totals['duration_s'])}",
        f"  powder    {powder}",
        f"  built     {totals['built_fraction']:.2%} of the part's volume inside its surface, "
        f"{totals['surplus_fraction']:.2%} beside it",
        f"  machine   {manifest.machine}, powder mode {manifest.powder_mode}",
        *_heat_lines(totals.get("predicted_heat")),
        *([f"  measured  calibration {calibration_text(manifest.calibration)}"]
          if manifest.calibration else []),
        f"  job       {target}",
    ]
    if copies := totals.get("copies"):
        order = totals["copy_order"].replace("-", " ")
        lines[1:1] = [f"  copies    {len(copies)}, {order}; shares built hold for each"]
    lines[4:4] = [f"  tracks    {found['text'].removeprefix('strategy ')}"
                  for found in manifest.verdict if found["text"].startswith("strategy")]
    if dilution := dilution_text(totals, len(manifest.materials)):
        lines.insert(-1, f"  dilution  {dilution}")
    if margins := margins_text(totals):
        lines.insert(-1, f"  mixture   {margins}")
    lines += [f"  alloy     {found['text'].removeprefix('alloy ')}" for found in manifest.verdict
              if found["text"].startswith("alloy rule ")]
    lines += [f"  warning   {text}" for text in totals["warnings"]]
    return "\n".join(lines)


def _heat_lines(heat: dict[str, Any] | None) -> list[str]:
    """What is predicted of temperature, where the part limits it."""
    if heat is None:
        return []
    least = 100 * float(heat["least_power_factor"])
    power = f"; beam power down to {least:.0f} % of the recipe's" if least < 99.5 else ""
    return [f"  heat      interpass predicted at most {heat['interpass_C']:.0f} °C in layer "
            f"{heat['layer']}, limit {heat['interpass_max_C']:g} °C; waits of "
            f"{format_duration(heat['wait_s'])} in {heat['layers_with_waits']} layers{power}"]
