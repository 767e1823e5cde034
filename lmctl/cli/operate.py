"""`lmctl hold|resume|stop|override|refill|height|status`: a run driven from another terminal."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from lmctl.cli.console import format_duration, print_data, print_json
from lmctl.cli.number_types import FiniteRange
from lmctl.cli.operator import operator_option
from lmctl.cli.run_screen import level_text

#: A hold is waited for so long; it takes a tenth of a second on any common machine.
_HELD_S = 10.0
_POLL_S = 0.1
_NOT_YET_HELD = ("depositing", "holding", "purging", "resuming")

_Decorator = Callable[[Callable[..., None]], Callable[..., None]]


def _common(command: Callable[..., None]) -> Callable[..., None]:
    """The argument and options that all of these commands have."""
    decorators: list[_Decorator] = [
        click.argument("run", required=False),
        click.option("--runs", "runs_dir", type=click.Path(path_type=Path), default=Path("runs"),
                     show_default=True, help="Folder of runs."),
        click.option("--json", "as_json", is_flag=True, help="Print the status as JSON."),
    ]
    for decorate in reversed(decorators):
        command = decorate(command)
    return command


@click.command()
@_common
@operator_option
def hold(run: str | None, runs_dir: Path, operator: str | None, as_json: bool) -> None:
    """Stop RUN on its path: beam off, position kept. RUN is the only one under way by default."""
    folder, now = _act(run, runs_dir, "hold", operator)
    # The run is another process, in real time; here is no loop whose clock could be asked.
    deadline_s = time.monotonic() + _HELD_S
    while now["state"] in _NOT_YET_HELD and time.monotonic() < deadline_s:
        time.sleep(_POLL_S)
        now = _ask(folder, "status")
    if as_json:
        _put_status(now)
    elif now["state"] == "held":
        print_data(f"{now['run']} is held at {now['place']}: beam off, position kept")
        print_data(f"hint: `{_command('resume', folder)}` purges the hose and goes on; "
                   f"`{_command('stop', folder)}` ends it")
    else:
        print_data(f"{now['run']} was held and is {now['state']}")
        _put_alarms(now)


@click.command()
@_common
@operator_option
def resume(run: str | None, runs_dir: Path, operator: str | None, as_json: bool) -> None:
    """End a hold of RUN: powder first, and the beam returns once the hose is purged."""
    folder, now = _act(run, runs_dir, "resume", operator)
    _say(now, as_json, "resumes: powder first, then motion and beam",
         f"`{_command('status', folder)}` shows when it deposits again")


@click.command()
@_common
@operator_option
def stop(run: str | None, runs_dir: Path, operator: str | None, as_json: bool) -> None:
    """End RUN: beam and motion, then powder, then gas. A second stop skips the post-flow."""
    _, now = _act(run, runs_dir, "stop", operator)
    _say(now, as_json, "stops: beam and motion, then powder, then gas after its post-flow",
         "a second stop skips the post-flow")


@click.command()
@click.argument("percent", type=int)
@_common
@operator_option
def override(
    percent: int, run: str | None, runs_dir: Path, operator: str | None, as_json: bool
) -> None:
    """Scale speed, beam and powder of RUN together to PERCENT (50 to 200) of the plan.

    It takes effect in the next travel that powder can be made to follow.
    """
    _, now = _act(run, runs_dir, "override", operator, percent=percent)
    _say(now, as_json, f"goes to {percent} % in the next travel that powder can follow", "")


@click.command()
@click.argument("hopper")
@_common
@click.option("--lot", help="Lot of the powder filled in: the hopper is filled and closed.")
@click.option("--mass", "mass_g", type=FiniteRange(0, 1e6, min_open=True), metavar="GRAMS",
              help="Mass filled in, as weighed by you.")
@operator_option
def refill(
    hopper: str, run: str | None, runs_dir: Path, operator: str | None, as_json: bool,
    lot: str | None, mass_g: float | None,
) -> None:
    """Refill HOPPER of RUN. First without options: the run is held at the end of its path, powder
    and gas go off, and the hopper may be opened once the state is "refilling". Then, filled and
    closed, with --lot and --mass: it is weighed, and `lmctl resume` goes on.
    """
    from lmctl.errors import UsageError

    if (lot is None) != (mass_g is None):
        raise UsageError("a refill needs both --lot and --mass",
                         hint="without them the hopper is made ready to be opened")
    if lot is None:
        folder, now = _act(run, runs_dir, "refill", operator, hopper=hopper)
        _say(now, as_json, f"makes hopper {hopper} ready: it is held at the end of its path, then "
             "powder and gas go off",
             f"open it when `{_command('status', folder)}` says \"refilling\"; then "
             f"`lmctl refill {hopper} --lot LOT --mass GRAMS`")
        return
    folder, now = _act(
        run, runs_dir, "refill", operator, hopper=hopper, lot=lot, mass_g=mass_g)
    _say(now, as_json, f"weighs hopper {hopper}",
         f"`{_command('resume', folder)}` when `{_command('status', folder)}` says \"held\"")


@click.command()
@click.argument("height_mm", type=FiniteRange(0, 10_000, min_open=True), required=False,
                metavar="[MM]")
@_common
@click.option("--skip", is_flag=True, help="It is not measured: powder stays as it is.")
@operator_option
def height(
    height_mm: float | None, run: str | None, runs_dir: Path, operator: str | None, as_json: bool,
    skip: bool,
) -> None:
    """Enter the height of the part, MM above what it stands on, in a RUN that is held for it.

    The powder of the next layers is scaled by up to 10 %, so that they reach their planned height.
    """
    from lmctl.errors import UsageError

    if (height_mm is None) != skip:
        raise UsageError("a height is entered as MM, or left out with --skip",
                         hint="lmctl height 8.15")
    folder, now = _act(run, runs_dir, "height", operator, height_mm=height_mm)
    _say(now, as_json, "has no height to go by" if skip else f"is {height_mm:g} mm high",
         f"`{_command('resume', folder)}` goes on")


@click.command()
@_common
@click.option("--watch", "every_s", type=FiniteRange(0.1, 3600), metavar="SECONDS",
              help="Print the status so often, in a line, until the run ends.")
def status(run: str | None, runs_dir: Path, as_json: bool, every_s: float | None) -> None:
    """Show the state of RUN: state, place, time left, override, alarms with what to do."""
    from lmctl.errors import JournalError
    from lmctl.run.control import client as control_client
    from lmctl.run.journal import run_folders

    folder = control_client.find_run(runs_dir, run)
    if every_s is not None:
        for now in control_client.watch_status(folder, every_s):
            _put_status(now) if as_json else print_data(_in_a_line(now))
        return
    try:
        now = control_client.send_request(folder, "status")
    except JournalError:
        ended = run_folders.run_summary(run_folders.RunFolder(folder))
        if ended.state == "running":
            raise
        if as_json:
            print_json(asdict(ended))
        else:
            print_data(f"{ended.run} is not under way: {ended.state}")
            print_data(f"hint: `{_command('log', folder)}` shows how far it came")
        return
    if as_json:
        _put_status(now)
    else:
        print_data(status_text(now))
        _put_alarms(now)


def status_text(now: dict[str, Any]) -> str:
    """The state of a run, in a few lines for people."""
    by = f" (operator {now['operator']})" if now["operator"] else ""
    lines = [
        f"{now['run']}: {now['state']}, {now['part']} on {now['machine']}{by}",
        *_doing(now),
        f"  layer      {now['layer']} of {now['layers']}, program line {now['line']} of "
        f"{now['lines']}",
        f"  time left  {format_duration(now['remaining_s'])}",
        f"  override   {now['override_percent']} %",
    ]
    if now["position_mm"] is not None:
        x, y, z = now["position_mm"][:3]
        lines.append(f"  nozzle     X {x:.2f}  Y {y:.2f}  Z {z:.2f} mm")
        flows = zip(now["hoppers"], now["set_g_min"], now["measured_g_min"], strict=False)
        lines.append("  powder     " + ", ".join(
            f"{name} {'-' if is_g is None else f'{is_g:.2f}'} of {set_g:.2f} g/min"
            for name, set_g, is_g in flows
        ))
    if now["levels"]:
        lines.append("  hoppers    " + ", ".join(map(level_text, now["levels"])))
    if now["beam_off"] and now["state"] not in ("ready", "connecting", "checking"):
        lines.append("  beam       stays off in this run")
    lines += [f"  next       `{one['command']}` {one['does']}" for one in now["next"]]
    return "\n".join(lines)


def _doing(now: dict[str, Any]) -> list[str]:
    """What is done at this moment, and why a held run is held."""
    left_s = now["doing_left_s"]
    left = "" if left_s is None else f", {format_duration(left_s)} left"
    lines = [] if now["doing"] == now["state"] else [f"  now        {now['doing']}{left}"]
    return lines + ([f"  held by    {now['held_by']}"] if now["held_by"] else [])


def _in_a_line(now: dict[str, Any]) -> str:
    alarm = f"  ALARM {now['alarms'][0]['what']}" if now["alarms"] else "".join(
        f"  warning: {warning['what']}" for warning in now.get("warnings", ())[:1]
    )
    return (f"{now['run']}  {now['state']:<10}  layer {now['layer']}/{now['layers']}  "
            f"line {now['line']}/{now['lines']}  {format_duration(now['remaining_s'])} left  "
            f"{now['override_percent']} %{alarm}")


def _put_alarms(now: dict[str, Any]) -> None:
    for number, alarm in enumerate(now["alarms"]):
        print_data(f"  {'alarm' if number == 0 else 'then'}{' ' * (6 if number == 0 else 7)}"
                   f"{alarm['what']}")
        for place in alarm["where"]:
            print_data(f"             {place}")
        if alarm["hint"]:
            print_data(f"             what to do: {alarm['hint']}")
    for warning in now.get("warnings", ()):  # a run of an older version reports none
        print_data(f"  warning    {warning['what']}")
        print_data(f"             what to do: {warning['hint']}")


def _act(
    run: str | None, runs_dir: Path, do: str, operator: str | None, **values: Any
) -> tuple[Path, dict[str, Any]]:
    from lmctl.run.control import client as control_client

    folder = control_client.find_run(runs_dir, run)
    if operator:
        values["operator"] = operator
    return folder, control_client.send_request(folder, do, **values)


def _ask(folder: Path, do: str) -> dict[str, Any]:
    from lmctl.run.control import client as control_client

    return control_client.send_request(folder, do)


def _command(do: str, folder: Path) -> str:
    from lmctl.run.journal.run_folders import RunFolder

    return RunFolder(folder).command(do)


def _say(now: dict[str, Any], as_json: bool, what: str, hint: str) -> None:
    if as_json:
        _put_status(now)
        return
    print_data(f"{now['run']} {what}")
    if hint:
        print_data(f"hint: {hint}")


def _put_status(now: dict[str, Any]) -> None:
    print_json({key: value for key, value in now.items() if key != "ok"})
