"""Where in its program a run is: which lines may be sent, and how the nozzle returns."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.run.program.approach import axis_limit_along as axis_limit_along
    from lmctl.run.program.beam_off import line_without_beam as line_without_beam
    from lmctl.run.program.feed_override import FeedOverride as FeedOverride
    from lmctl.run.program.job_lines import after_bead_mm as after_bead_mm
    from lmctl.run.program.job_lines import bead_between_mm as bead_between_mm
    from lmctl.run.program.job_lines import before_motion_mm as before_motion_mm
    from lmctl.run.program.job_lines import rows_between as rows_between
    from lmctl.run.program.job_window import JobWindow as JobWindow
    from lmctl.run.program.layer_program import LayerProgram as LayerProgram
    from lmctl.run.program.layer_program import PathSpan as PathSpan
    from lmctl.run.program.layer_program import layer_program_of as layer_program_of
    from lmctl.run.program.line_energy import LineEnergyCheck as LineEnergyCheck
    from lmctl.run.program.line_releaser import LineReleaser as LineReleaser
    from lmctl.run.program.override_limits import OverrideRange as OverrideRange
    from lmctl.run.program.override_limits import override_range as override_range
    from lmctl.run.program.place import Known as Known
    from lmctl.run.program.place import PlaceReached as PlaceReached
    from lmctl.run.program.place import ProgramPlace as ProgramPlace
    from lmctl.run.program.place import known_place as known_place
    from lmctl.run.program.place import unknown_place as unknown_place
    from lmctl.run.program.program_clock import ProgramClock as ProgramClock
    from lmctl.run.program.reentry import Reentry as Reentry
    from lmctl.run.program.reentry import layer_of as layer_of
    from lmctl.run.program.reentry import plan_reentry as plan_reentry
    from lmctl.run.program.remaining_time import RemainingTime as RemainingTime
    from lmctl.run.program.reported_power import reported_energy_ratio as reported_energy_ratio

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "FeedOverride": "lmctl.run.program.feed_override",
    "JobWindow": "lmctl.run.program.job_window",
    "Known": "lmctl.run.program.place",
    "LayerProgram": "lmctl.run.program.layer_program",
    "LineEnergyCheck": "lmctl.run.program.line_energy",
    "LineReleaser": "lmctl.run.program.line_releaser",
    "OverrideRange": "lmctl.run.program.override_limits",
    "PathSpan": "lmctl.run.program.layer_program",
    "PlaceReached": "lmctl.run.program.place",
    "ProgramClock": "lmctl.run.program.program_clock",
    "ProgramPlace": "lmctl.run.program.place",
    "Reentry": "lmctl.run.program.reentry",
    "RemainingTime": "lmctl.run.program.remaining_time",
    "after_bead_mm": "lmctl.run.program.job_lines",
    "axis_limit_along": "lmctl.run.program.approach",
    "bead_between_mm": "lmctl.run.program.job_lines",
    "before_motion_mm": "lmctl.run.program.job_lines",
    "known_place": "lmctl.run.program.place",
    "layer_of": "lmctl.run.program.reentry",
    "layer_program_of": "lmctl.run.program.layer_program",
    "line_without_beam": "lmctl.run.program.beam_off",
    "override_range": "lmctl.run.program.override_limits",
    "plan_reentry": "lmctl.run.program.reentry",
    "reported_energy_ratio": "lmctl.run.program.reported_power",
    "rows_between": "lmctl.run.program.job_lines",
    "unknown_place": "lmctl.run.program.place",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
