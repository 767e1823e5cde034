"""Which machine profile a command works with: the one named, or the bench cell that ships.

What an endpoint may look like is known to the drivers that open it, and configuration does not know
drivers: here both are at hand, so that all mistakes of a profile are reported at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from lmctl.config import toml_file
from lmctl.config.file_kind import FileKind, refuse_other_kind
from lmctl.config.machine import MachineProfile, with_device_maps
from lmctl.errors import ConfigError, Finding
from lmctl.machine.modbus.endpoint import parse_modbus_endpoint
from lmctl.machine.motion.endpoint import parse_motion_endpoint


def load_profile_or_default(path: Path | None, *, calibrated: bool = True) -> MachineProfile:
    """The profile in `path`, or the example cell. Raises ConfigError.

    calibrated : with what the calibration it names has measured; doubts about that are reported, or
        refused where the profile says so
    """
    if path is not None:
        profile = load_checked_profile(path)
        if not calibrated or profile.calibration is None:
            return profile
        from lmctl.cli.calibrations import apply_calibration

        return apply_calibration(profile, path)
    with as_file(files("lmctl.examples") / "cell.toml") as shipped:
        return load_checked_profile(shipped)


def load_checked_profile(path: Path) -> MachineProfile:
    """The profile in a file, whose endpoints can be opened. Raises ConfigError: every mistake."""
    text = toml_file.read_text(path)
    refuse_other_kind(toml_file.parse_tables(text, name=str(path)), FileKind.PROFILE, path)
    profile: MachineProfile | None = None
    findings: list[Finding] = []
    unlisted = 0
    try:
        profile = toml_file.parse_toml(text, MachineProfile, name=str(path))
    except ConfigError as error:
        if not error.findings:  # not TOML at all
            raise
        findings += error.findings
        unlisted = error.unlisted
    findings += _endpoint_findings(toml_file.parse_tables(text, name=str(path)))
    if findings or profile is None:
        raise ConfigError.of_findings(path, findings, unlisted=unlisted)
    return with_device_maps(profile, path)


def _endpoint_findings(data: dict[str, Any]) -> Iterator[Finding]:
    """Endpoints that name no place, in a profile as plain data, of whatever shape it is."""
    feeders = data.get("feeder")
    devices: list[tuple[str, Any, Callable[[str], object]]] = [
        ("motion", data.get("motion"), parse_motion_endpoint),
        *((f"feeder[{number}]", feeder, parse_modbus_endpoint)
          for number, feeder in enumerate(feeders if isinstance(feeders, list) else [], start=1)),
        ("safety", data.get("safety"), parse_modbus_endpoint),
        ("scale", data.get("scale"), parse_modbus_endpoint),
    ]
    for key, device, parsed in devices:
        endpoint = device.get("endpoint") if isinstance(device, dict) else None
        if not isinstance(endpoint, str):
            continue  # reported as missing, or as of another kind
        try:
            parsed(endpoint)
        except ConfigError as error:
            yield Finding(f"{key}.endpoint", f"{error.what}: {error.hint}")
