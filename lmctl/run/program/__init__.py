"""Where in its program a run is: which lines may go, and how the nozzle gets back to its path."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.run.program.beam_off import without_beam as without_beam
    from lmctl.run.program.feed_override import FeedOverride as FeedOverride
    from lmctl.run.program.job_window import JobWindow as JobWindow
    from lmctl.run.program.layer_program import LayerProgram as LayerProgram
    from lmctl.run.program.layer_program import PathSpan as PathSpan
    from lmctl.run.program.layer_program import layer_program_of as layer_program_of
    from lmctl.run.program.line_energy import LineEnergyCheck as LineEnergyCheck
    from lmctl.run.program.line_releaser import LineReleaser as LineReleaser
    from lmctl.run.program.override_limits import OverrideRange as OverrideRange
    from lmctl.run.program.override_limits import override_range as override_range
    from lmctl.run.program.program_clock import ProgramClock as ProgramClock
    from lmctl.run.program.reentry import ProgramPlace as ProgramPlace
    from lmctl.run.program.reentry import Reentry as Reentry
    from lmctl.run.program.reentry import layer_of as layer_of
    from lmctl.run.program.reentry import plan_reentry as plan_reentry
    from lmctl.run.program.remaining_time import RemainingTime as RemainingTime
    from lmctl.run.program.reported_power import energy_ratio as energy_ratio

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "FeedOverride": "lmctl.run.program.feed_override",
    "JobWindow": "lmctl.run.program.job_window",
    "LayerProgram": "lmctl.run.program.layer_program",
    "LineEnergyCheck": "lmctl.run.program.line_energy",
    "LineReleaser": "lmctl.run.program.line_releaser",
    "OverrideRange": "lmctl.run.program.override_limits",
    "PathSpan": "lmctl.run.program.layer_program",
    "ProgramClock": "lmctl.run.program.program_clock",
    "ProgramPlace": "lmctl.run.program.reentry",
    "Reentry": "lmctl.run.program.reentry",
    "RemainingTime": "lmctl.run.program.remaining_time",
    "energy_ratio": "lmctl.run.program.reported_power",
    "layer_of": "lmctl.run.program.reentry",
    "layer_program_of": "lmctl.run.program.layer_program",
    "override_range": "lmctl.run.program.override_limits",
    "plan_reentry": "lmctl.run.program.reentry",
    "without_beam": "lmctl.run.program.beam_off",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
