"""Compares what was built with the part itself, never with the job that was planned of it.

Volumes are compared voxel by voxel with the part's own distance and composition, the path piece by
piece with the composition at the middle of its layer under the tool point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IndexArray
from lmctl.as_built.believed_dilution import with_melted_below
from lmctl.as_built.built_volume import BuiltVolume
from lmctl.as_built.deposit_of_interest import around_part, over_substrate
from lmctl.as_built.design_voxels import DesignVoxels, design_on_voxels
from lmctl.as_built.figures import (
    TOLERANCES,
    AsBuiltSummary,
    BuiltLayer,
    CompositionError,
    MaterialBalance,
)
from lmctl.as_built.layer_heights import built_layers, layer_index_of_pieces
from lmctl.as_built.work_offset import work_offset_mm
from lmctl.errors import InputError
from lmctl.part.copies import part_in_place

if TYPE_CHECKING:
    from lmctl.job.reader import JobReader
    from lmctl.part.copies import PartCopy
    from lmctl.part.part import Part

#: Most voxels of a comparison: memory.
MAX_VOXELS = 200_000_000
#: A voxel filled by less has no composition.
_LEAST_FILLED = 0.05


@dataclass(frozen=True)
class AsBuiltComparison:
    """Built and designed on one grid of (nx, ny, nz) voxels that holds both.

    corner_mm, voxel_mm : (3,) of the grid, in the part's own coordinates
    materials : of the part, then others that were built; columns of both below
    filled : share of each voxel that is filled, without the plate
    design : the part on the grid
    built_fractions, design_fractions : (m, n_materials) of the voxels `rows`, inside and filled
    error : (m,) greatest difference of a fraction
    """

    summary: AsBuiltSummary
    corner_mm: FloatArray
    voxel_mm: FloatArray
    materials: tuple[str, ...]
    filled: NDArray[np.float32]
    design: DesignVoxels
    rows: IndexArray
    built_fractions: FloatArray
    design_fractions: FloatArray
    error: FloatArray


def compare_with_design(
    built: BuiltVolume, part: Part, job: JobReader, copy: PartCopy | None = None
) -> AsBuiltComparison:
    """Compare a build with the part of its job.

    copy : that is compared, where there are several; None: the part alone
    Raises InputError where nothing of the part can be compared, or the grid would be too large.
    """
    offset = np.asarray(job.manifest.part_offset_mm) + work_offset_mm(built, job)
    if copy is not None:
        part = part_in_place(part, copy)
        built = around_part(built, part, offset)
    over = over_substrate(built, part, offset)
    built, part = over.built, over.part
    first = built.first_plane
    plate_corner = np.array([*built.origin_mm[:2], built.plate_z_mm])
    volumes, corner = _on_common_grid(
        built.deposited_mm3[:, :, :, first:], plate_corner - offset, built.voxel_mm, part)
    core_mm = part.process.bead_width_mm
    design = design_on_voxels(part, corner, built.voxel_mm, volumes.shape[1:], core_mm)
    voxel = built.voxel_volume_mm3
    filled = (volumes.sum(axis=0) / np.float32(voxel)).astype(np.float32)
    designed_mm3 = float(design.inside.sum(dtype=np.float64)) * voxel
    if designed_mm3 <= 0:
        raise InputError("no voxel lies in the part",
                         where=f"voxels are {built.voxel_mm.round(3).tolist()} mm long",
                         hint="lower voxel_mm of the bench, and run the job again")
    names = [material.name for material in part.materials]
    counted_as = _counted_as(built, names)
    materials = (*names, *(name for name in dict.fromkeys(counted_as) if name not in names))
    kept = design.rows[filled.ravel()[design.rows] >= _LEAST_FILLED]
    found = np.zeros((len(kept), len(materials)))
    for row, name in enumerate(counted_as):
        found[:, materials.index(name)] += volumes[row].ravel()[kept]
    amount = found.sum(axis=1)
    found /= amount[:, None]
    wanted = np.zeros_like(found)
    wanted[:, : len(names)] = design.fractions[np.searchsorted(design.rows, kept)]
    error = np.abs(found - wanted).max(axis=1, initial=0.0)
    core = design.distance_mm >= core_mm
    n_core = int(core.sum())
    void = height = planned = None
    if built.built_by == "simulated" and n_core:  # a prediction lays strips of the planned height
        void = float(np.maximum(1 - filled[core], 0).mean(dtype=np.float64))
        height, planned = (_height_over(core, share, built.voxel_mm)
                           for share in (filled, design.inside))
    layers, layer_mm = _layers(built, job)
    summary = AsBuiltSummary(
        built.built_by, designed_mm3,
        float(volumes.sum(dtype=np.float64)),
        float(np.maximum(design.inside - filled, 0).sum(dtype=np.float64)) * voxel,
        float(np.maximum(filled - design.inside, 0).sum(dtype=np.float64)) * voxel,
        n_core * voxel, void, height, planned, composition_error(error, amount),
        _by_path(built, part, job, offset, materials, layer_mm), layers, _balance(built),
        built.notes,
    )
    return AsBuiltComparison(summary, corner, built.voxel_mm, materials, filled, design, kept,
                             found, wanted, error)


def _counted_as(built: BuiltVolume, names: Sequence[str]) -> tuple[str, ...]:
    """What each built material counts as: a plate of one of the part's materials is that one."""
    plate = built.plate_material
    return (*built.materials[:-1], plate if plate in names else built.materials[-1])


def composition_error(error: FloatArray, weight: FloatArray) -> CompositionError | None:
    """Weighted figures of errors (n,); an error of infinity is beyond every tolerance.

    returns : None without weight
    """
    total = float(weight.sum())
    if total <= 0:
        return None
    known = np.isfinite(error)
    mean, mean_square = 0.0, 0.0
    share = weight[known] / max(float(weight[known].sum()), 1e-300)
    if known.any():
        mean = float(share @ error[known])
        mean_square = float(share @ error[known] ** 2)
    order = np.argsort(error[known])
    reached = np.cumsum(share[order])
    ranked = np.append(error[known][order], 0.0)  # the last where nothing is known
    p95, p99 = (float(ranked[min(int(np.searchsorted(reached, q - 1e-12)), max(len(order) - 1, 0))])
                for q in (0.95, 0.99))
    within = {t: float(weight[known & (error <= t + 1e-9)].sum()) / total for t in TOLERANCES}
    return CompositionError(mean, mean_square**0.5, p95, p99, within)


def _on_common_grid(
    volumes: NDArray[np.float32], corner_mm: FloatArray, voxel_mm: FloatArray, part: Part
) -> tuple[NDArray[np.float32], FloatArray]:
    """The build's voxels on a grid that holds the whole part too."""
    low, high = (np.asarray(end, dtype=np.float64) for end in part.bounds_mm)
    shape = np.array(volumes.shape[1:])
    before = np.maximum(np.ceil((corner_mm - low) / voxel_mm - 1e-6), 0).astype(int)
    after = np.maximum(np.ceil((high - corner_mm) / voxel_mm - 1e-6) - shape, 0).astype(int)
    if float(np.prod((before + shape + after).astype(float))) > MAX_VOXELS:
        raise InputError("the part and the build lie too far apart, or the voxels are too fine",
                         where=f"the build begins at {corner_mm.round(2).tolist()} mm of the part",
                         hint="check the placement of the part, or raise voxel_mm of the bench")
    padding = [(0, 0), *zip(before.tolist(), after.tolist(), strict=True)]
    return np.pad(volumes, padding), corner_mm - before * voxel_mm


def _height_over(
    core: NDArray[np.bool_], filled: NDArray[np.float32], voxel_mm: FloatArray
) -> float:
    """Mean height of what fills the columns of the core."""
    columns = core.any(axis=2)
    return float(filled[columns].sum(axis=1, dtype=np.float64).mean() * voxel_mm[2])


def _layers(built: BuiltVolume, job: JobReader) -> tuple[tuple[BuiltLayer, ...], float]:
    entries = job.manifest.layers
    layer_mm = entries[1].z_mm - entries[0].z_mm if len(entries) > 1 else entries[0].z_mm
    return built_layers(built, job, layer_index_of_pieces(built, job)), float(layer_mm)


def _by_path(
    built: BuiltVolume, part: Part, job: JobReader, offset_mm: FloatArray,
    materials: tuple[str, ...], layer_mm: float,
) -> CompositionError | None:
    """The path against the part's composition, in the middle of the layer under the tool point.

    Powder of a job that makes up for dilution is another than the part's: it is compared with what
    it melts from below, by the dilution that the job believes.
    """
    path = built.path
    if not len(path.line):
        return None
    under = path.place_mm - offset_mm - [0.0, 0.0, layer_mm / 2]
    wanted = np.zeros((len(under), len(materials)))
    wanted[:, : len(part.materials)] = part.composition(under)
    found = np.zeros_like(wanted)
    for row, name in enumerate(_counted_as(built, materials)):
        found[:, materials.index(name)] += path.delivered[:, row]
    found = with_melted_below(found, under, part, job, layer_mm, materials)
    error = np.abs(found - wanted).max(axis=1)
    return composition_error(np.where(np.isnan(error), np.inf, error), path.beam_on_mm)


def _balance(built: BuiltVolume) -> tuple[MaterialBalance, ...]:
    powder = built.powder
    if powder is None:
        return ()
    volume = built.deposited_mm3.sum(axis=(1, 2, 3), dtype=np.float64)
    balances = []
    for row, name in enumerate(built.materials[:-1]):
        deposited = float(volume[row] * powder.density_g_mm3[row])
        fed, on, off = (float(column[row]) for column in (
            powder.fed_g, powder.beam_on_g, powder.beam_off_g))
        rest = fed - on - off
        balances.append(MaterialBalance(name, fed, deposited, on - deposited, off, rest,
                                        rest / fed if fed else 0.0))
    return tuple(balances)
