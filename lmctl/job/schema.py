"""What a job holds: program text, a table of its lines, powder flow, totals, digests.

The table gives each line's planned time, path and kind; the flow is what the nozzle must deliver
against program time.

*Program time* s is the planned time since the program's first line starts at the purge position,
without overrides or holds. Units: mm, s, g, W; positions in program coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Version of the job format; a reader refuses any other.
FORMAT_VERSION = 3

#: Line numbers (N words) repeat after this many lines (error 27 above it in both firmwares).
N_WORD_MODULUS = 10_000_000


class LineKind(IntEnum):
    """What a program line does. Only BEAD lines have the beam on."""

    SETUP = 0   # modal words, spindle mode; no motion
    TRAVEL = 1  # from path to path, beam off; G1 at S0, so that a feed override scales it too
    LEAD = 2    # G1 at S0: run-up or run-out, beam off
    BEAD = 3    # G1 at S > 0
    DWELL = 4   # G4


def line_dtype(n_materials: int) -> np.dtype[Any]:
    """Record of one program line.

    end_s : float64, program time at which the line ends
    x_mm, y_mm, z_mm : float64, position at its end
    speed_mm_s : float32, programmed speed, 0 for lines without motion
    power_W : float32, beam power, 0 for all but BEAD
    bead_width_mm : float32, width of the bead deposited, 0 for all but BEAD
    path : int32, global number of the path the line belongs to, −1 for none. A path is one
        stretch from lead-in to lead-out: beam on once, off once.
    kind : uint8, a LineKind
    fractions : (n_materials,) float32, volume fractions at the line's end as the program feeds
        them: what the hoppers can deliver, with dilution made up for where it is known
    designed : (n_materials,) float32, volume fractions that the part file has there; zeros for all
        but BEAD, and on beads of which it is not known
    """
    return np.dtype(
        [
            ("end_s", "<f8"), ("x_mm", "<f8"), ("y_mm", "<f8"), ("z_mm", "<f8"),
            ("speed_mm_s", "<f4"), ("power_W", "<f4"), ("bead_width_mm", "<f4"),
            ("path", "<i4"), ("kind", "u1"),
            ("fractions", "<f4", (n_materials,)), ("designed", "<f4", (n_materials,)),
        ]
    )


@dataclass(frozen=True)
class JobLayer:
    """One layer of a job.

    program : final text of each line, without line end; ASCII, N word first
    lines : (len(program),) of `line_dtype`
    flow_s : (k,) float64, program times, strictly rising; the first equals the layer's start
    flow_g_s : (k, n_hoppers) float64, mass flow wanted at the nozzle, linear between knots;
        the last knot of a layer and the first of the next agree in time and value
    """

    index: int
    z_mm: float
    first_line: int
    program: tuple[str, ...]
    lines: NDArray[np.void]
    flow_s: NDArray[np.float64]
    flow_g_s: NDArray[np.float64]


@dataclass(frozen=True)
class LayerEntry:
    """A layer's place in the manifest, so that readers need not open every layer."""

    index: int
    z_mm: float
    first_line: int
    n_lines: int
    first_path: int
    n_paths: int
    start_s: float
    end_s: float
    sha256: str


@dataclass(frozen=True)
class JobHopper:
    """A hopper as the job uses it, with the values that planning assumed, calibrated ones included.

    min_flow_g_min, max_flow_g_min : that it meters; what it feeds is offset + slope · set-point
    """

    name: str
    material: str
    dead_time_s: float
    lag_s: float
    max_flow_g_min: float
    min_flow_g_min: float = 0.0
    slope: float = 1.0
    offset_g_min: float = 0.0


@dataclass(frozen=True)
class LayerMixture:
    """What the beads of one layer are made of: volume fractions in the materials' order, each the
    mean over the length of bead.

    layer : index; designed : as the part file has it along the beads; planned : as the program
    feeds it; predicted : as the bead is predicted to be, with what it melts of the layer below
    where dilution is compensated
    """

    layer: int
    designed: tuple[float, ...]
    planned: tuple[float, ...]
    predicted: tuple[float, ...]


@dataclass(frozen=True)
class LayerHeat:
    """Temperature that the plan predicts for one layer, and what it chose for it.

    layer : index; interpass_C : hottest place that the beam comes back to, as predicted
    x_mm, y_mm : where that is, program coordinates
    wait_s : beam off for heat, beside the time that travel and powder take
    cuts : places where a path is interrupted for such a wait
    power_factor : on the recipe's beam power
    order : of tracks of equal mixture: "nearest" first; "coolest" first; or far "apart", each from
        the last ones
    """

    layer: int
    interpass_C: float
    x_mm: float
    y_mm: float
    wait_s: float
    cuts: int
    power_factor: float
    order: str = "nearest"


@dataclass(frozen=True)
class JobManifest:
    """Everything about a job that is not a layer.

    profile_digest : MachineProfile.planning_digest() of the profile planned for
    bounds_mm : least and greatest x, y, z the nozzle goes to
    totals : what `lmctl plan --json` prints: layers, contours, vertices, path_length_mm,
        laser_on_s, duration_s, powder_g (by material), warnings, ...; of these `check_job` reads
        longest_line_s, peak_power_W and peak_flow_g_min (by hopper)
    verdict : findings only geometry can prove, as {"level": "ok"|"warning", "text": ...}
    excerpt : numbers of the first and last layer, from 1, where only these are planned, for
        looking; no machine takes such a job
    part_offset_mm : program coordinates of the part's own origin
    calibration : digest and dates of the calibration whose values were planned with, as
        `CalibrationUse.as_json` gives it; None where all were typed in
    sources : {file name: sha256} of the data files the part was made from
    mixtures : of every layer that has beads, in order; empty in jobs of earlier versions
    heat : of every layer that has beads, in order; empty where no temperature is limited
    """

    part_name: str
    part_sha256: str
    sources: dict[str, str]
    machine: str
    profile_digest: str
    software: str
    powder_mode: str
    s_max: int
    max_power_W: float
    send_horizon_s: float
    materials: tuple[str, ...]
    hoppers: tuple[JobHopper, ...]
    bounds_mm: tuple[tuple[float, float, float], tuple[float, float, float]]
    totals: dict[str, Any]
    verdict: tuple[dict[str, str], ...]
    part_offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    excerpt: tuple[int, int] | None = None
    mixtures: tuple[LayerMixture, ...] = ()
    heat: tuple[LayerHeat, ...] = ()
    calibration: dict[str, Any] | None = None
    layers: tuple[LayerEntry, ...] = field(default=())
