"""`lmctl check`: everything that is wrong with a part file, a profile or a job, at once."""

from __future__ import annotations

from pathlib import Path

import click

from lmctl.cli.console import print_data, print_message
from lmctl.cli.interrupts import interruptible
from lmctl.cli.paths import InputFile
from lmctl.cli.planning import check_bare_options, units_option, up_option
from lmctl.cli.profiles import load_profile_or_default
from lmctl.config import toml_file
from lmctl.config.file_kind import FileKind, file_kind_of
from lmctl.config.machine import MachineProfile
from lmctl.errors import UsageError


@click.command()
@click.argument("file", type=InputFile())
@click.option("-m", "--machine", type=InputFile(),
              help="Profile to check a part or job against [the bench cell].")
@units_option
@up_option
def check(file: Path, machine: Path | None, units: str | None, up: str | None) -> None:
    """Check FILE: a part file, a mesh or cloud, a machine profile, a bench, a map, or a job."""
    check_bare_options(file, units, up)
    kind = _kind_of(file)
    if kind in (FileKind.PROFILE, FileKind.BENCH):
        if machine is not None:
            raise UsageError(f"{file} is {kind}: it is checked by itself",
                             hint="--machine is for a part or a job")
        print_data(f"{file}: {kind}, {_profile_or_bench(file, kind)}; nothing wrong")
    elif kind is FileKind.MAP:
        _check_map(file)
    elif kind is FileKind.FAULTS:
        raise UsageError(f"{file} is {kind}: what it may name is known to a simulated cell only",
                         hint="`lmctl run JOB --sim --faults FILE` checks it before it runs")
    elif file.suffix.lower() == ".lmj":
        _check_job(file, load_profile_or_default(machine))
    else:
        _check_part(file, units, up, load_profile_or_default(machine))


def _kind_of(file: Path) -> FileKind | None:
    if file.suffix.lower() != ".toml":
        return None
    return file_kind_of(toml_file.parse_tables(toml_file.read_text(file), name=str(file)))


def _profile_or_bench(file: Path, kind: FileKind) -> str:
    """What is in it, in words. Raises ConfigError."""
    if kind is FileKind.BENCH:
        from lmctl.cli.bench import load_bench

        feeders = [one.name for one in load_bench(file).feeders]
        return f"with {len(feeders)} feeders: {', '.join(feeders)}"
    profile = load_profile_or_default(file)  # with its calibration: doubts are told, or refused
    used = profile.calibration_use
    measured = "" if used is None else f", calibration {used.text}"
    return f"{len(profile.hopper)} hoppers on {len(profile.feeder)} feeders{measured}"


def _check_map(file: Path) -> None:
    """A register map, and what a run does in place of what the device lacks. Raises ConfigError."""
    from firmware_protocol.map_checks import describe_map
    from lmctl.config.feeder_maps import read_device_map

    device = read_device_map(file)
    if device.feeder is not None:
        for feature, meaning in device.feeder.substitutions():
            print_message(f"without {feature}: {meaning}")
    print_data(f"{file}: {FileKind.MAP} of {device.name}, {describe_map(device)}; nothing wrong")


@interruptible()
def _check_job(file: Path, profile: MachineProfile) -> None:
    from lmctl.job.reader import JobReader
    from lmctl.preflight.job_check import check_job
    from lmctl.preflight.program_check import check_program

    with JobReader(file) as job:
        check_job(job.manifest, profile)
        check_program(job, profile)  # opening a layer verifies its digest, too
        print_data(f"{file}: a whole job of {len(job.manifest.layers)} layers for "
                   f"{job.manifest.machine}; nothing wrong")


@interruptible()
def _check_part(
    file: Path, units: str | None, up: str | None, profile: MachineProfile
) -> None:
    from lmctl.cli.planning import open_part
    from lmctl.plan.layer_range import place_layers

    part = open_part(file, units, up)
    for text in part.warnings:
        print_message(f"warning: {text}")
    place_layers(part, profile)
    low, high = part.bounds_mm
    size = " × ".join(f"{b - a:.1f}" for a, b in zip(low, high, strict=True))
    print_data(f"{file}: {part.name}, {size} mm, {', '.join(m.name for m in part.materials)}; "
               "nothing wrong; `lmctl plan` tells whether it can be deposited")
