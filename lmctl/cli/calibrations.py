"""The calibration that a profile names: found, judged, and put in place of typed-in values."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from lmctl.cli.console import print_message, wrapped
from lmctl.config.machine import MachineProfile
from lmctl.errors import ConfigError, MissingFileError

if TYPE_CHECKING:
    from lmctl.calibration.calibration_file import Calibration
    from lmctl.calibration.validity import CalibrationFinding


@dataclass(frozen=True)
class JudgedCalibration:
    """The calibration of a profile. found : None where the file is not there yet"""

    path: Path
    found: Calibration | None
    findings: list[CalibrationFinding]


def calibration_path(profile: MachineProfile, profile_path: Path | None) -> Path:
    """Where a profile's calibration is, or would be; beside the profile."""
    from lmctl.config.measuring import CalibrationSettings

    settings = profile.calibration or CalibrationSettings()
    return (Path() if profile_path is None else profile_path.parent) / settings.file


def judged_calibration(
    profile: MachineProfile, profile_path: Path | None
) -> JudgedCalibration | None:
    """The calibration that a profile names and what is doubtful about it; None where it names none.

    Raises ConfigError where the file cannot be used at all.
    """
    from lmctl.calibration.calibration_file import load_calibration
    from lmctl.calibration.validity import CalibrationFinding, calibration_findings

    if profile.calibration is None:
        return None
    path = calibration_path(profile, profile_path)
    try:
        found = load_calibration(path)
    except MissingFileError:
        return JudgedCalibration(path, None, [CalibrationFinding(
            "calibration", f"{path} is not there yet: the profile's own values are used; "
            "`lmctl machine feeder-test` makes it", refuses=False)])
    return JudgedCalibration(path, found,
                             list(calibration_findings(found, profile, datetime.now(UTC))))


def apply_calibration(profile: MachineProfile, profile_path: Path | None) -> MachineProfile:
    """The profile with what was measured; doubts are reported, or refused where it says so.

    Raises ConfigError.
    """
    from lmctl.calibration.validity import calibrated_profile, refuse_invalid

    judged = judged_calibration(profile, profile_path)
    if judged is None:
        return profile
    refuse_invalid(judged.findings, str(judged.path))
    for finding in judged.findings:
        print_message(wrapped(f"warning: {finding.what}: {finding.text}"))
    return profile if judged.found is None else calibrated_profile(profile, judged.found)


def stored_calibration(path: Path, machine: str) -> Calibration:
    """The calibration in a file to which a measurement is added; a new one where there is none.

    Raises ConfigError for a file that is none, or of another machine.
    """
    from lmctl.calibration.calibration_file import Calibration, load_calibration

    try:
        found = load_calibration(path)
    except MissingFileError:
        return Calibration(machine=machine)
    if found.machine != machine:
        raise ConfigError(f"{path} is the calibration of {found.machine!r}, not of {machine!r}",
                          hint="give --output another file")
    return found
