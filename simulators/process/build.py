"""From the record of a bench to what was built: the process on a grid that holds the whole path."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulators.array_types import FloatArray
from simulators.bench_record import BeamOnPath, BenchRecord
from simulators.process.config import ProcessConfig
from simulators.process.deposition import SLICES_PER_VOXEL, lay_pieces
from simulators.process.pool import bead_width_mm, dilution
from simulators.process.powder_totals import PowderTotals, powder_totals
from simulators.process.voxel_map import VoxelMap

#: Depth of the plate that can be melted, in bead widths.
_PLATE_WIDTHS = 1.0
#: The grid is at first so many bead widths higher than the tool point comes.
_ROOM_WIDTHS = 1.5
#: Voxels times materials; eight bytes each while the build is made.
MAX_CELLS = 400_000_000
#: A stop longer than this makes a new bead, even at the same place [s].
_NEW_BEAD_S = 1.0
_NEW_BEAD_MM = 1e6


class BuildError(ValueError):
    """The process cannot be carried out on this bench; says what to change."""


def build_from_record(record: BenchRecord, config: ProcessConfig) -> VoxelMap | None:
    """Build what the record's path with the beam on builds; None where it deposits nothing.

    Raises BuildError where the grid would be too large, or a powder is called as the substrate.
    """
    path = record.beam_on_path(config.voxel_mm / SLICES_PER_VOXEL)
    if config.substrate in path.materials:
        raise BuildError(f"process.substrate: {config.substrate!r} is a powder too; rename one")
    volume = path.deposit_mm3_s * path.duration_s[:, None]
    kept = np.flatnonzero((volume.sum(axis=1) > 0) & (path.length_mm > 0))
    if not len(kept):
        return None
    speed = path.length_mm / np.maximum(path.duration_s, 1e-12)
    power = path.power_fraction * config.max_power_W
    width = bead_width_mm(config, power[kept], speed[kept])
    share = dilution(config, power[kept], speed[kept])
    powder = powder_totals(record, path)
    corner, shape = _grid(path.position_mm[kept], float(width.max()), config)
    advance = _advance(path.position_mm[kept], path.time_s[kept])
    room = shape[2]
    while True:
        _refuse_too_large((shape[0], shape[1], room), len(path.materials) + 1, config)
        plate = _plate_top(corner, shape, config)
        top = plate.copy()
        voxels = np.zeros((shape[0], shape[1], room, len(path.materials) + 1))
        floor = corner[2] + config.voxel_height_mm * np.arange(room)
        filled = np.clip((plate[:, :, None] - floor) / config.voxel_height_mm, 0.0, 1.0).round(9)
        voxels[..., -1] = config.voxel_mm**2 * config.voxel_height_mm * filled
        caught = np.zeros((len(kept), len(path.materials)))
        surface = np.zeros(len(kept))
        place = path.position_mm[kept] - np.array([corner[0], corner[1], 0.0])
        overflows = lay_pieces(
            place, path.direction[kept, :2].copy(), path.length_mm[kept], advance, width,
            share / (1.0 - share), volume[kept], powder.falloff_mm, config.best_standoff_mm,
            config.voxel_mm, config.voxel_height_mm, float(corner[2]), top, voxels, caught, surface)
        if not overflows:
            break
        room += room // 2 + 1
    return _voxel_map(powder, config, path, kept, corner, top - plate, voxels, caught, surface)


def _plate_top(
    corner: FloatArray, shape: tuple[int, int, int], config: ProcessConfig
) -> FloatArray:
    """(nx, ny) z of the plate's top at the middle of each column."""
    if config.substrate_heights is None:
        return np.full(shape[:2], config.substrate_z_mm)
    x, y = (corner[axis] + (np.arange(shape[axis]) + 0.5) * config.voxel_mm for axis in (0, 1))
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=2).reshape(-1, 2)
    heights = config.substrate_heights.height_mm(places).reshape(shape[:2])
    return np.asarray(config.substrate_z_mm + heights)


def _grid(
    position_mm: FloatArray, width_mm: float, config: ProcessConfig
) -> tuple[FloatArray, tuple[int, int, int]]:
    """Lowest corner and voxels along x, y, z; a plane of voxels ends at the plate's top."""
    cell, height = config.voxel_mm, config.voxel_height_mm
    margin = 0.75 * width_mm + 4 * cell
    low = np.floor((position_mm[:, :2].min(axis=0) - margin) / cell) * cell
    across = np.ceil((position_mm[:, :2].max(axis=0) + margin - low) / cell)
    below = int(np.ceil(_PLATE_WIDTHS * width_mm / height))
    highest = max(float(position_mm[:, 2].max()) - config.substrate_z_mm, 0.0)
    above = int(np.ceil((highest + _ROOM_WIDTHS * width_mm) / height))
    corner = np.array([*low, config.substrate_z_mm - below * height])
    return corner, (int(across[0]), int(across[1]), below + above)


def _refuse_too_large(
    shape: tuple[int, int, int], n_materials: int, config: ProcessConfig
) -> None:
    cells = shape[0] * shape[1] * shape[2] * n_materials
    if cells > MAX_CELLS:
        raise BuildError(
            f"process.voxel_mm: {shape[0]} x {shape[1]} x {shape[2]} voxels of {config.voxel_mm:g} "
            f"mm for {n_materials} materials are too many; raise voxel_mm and voxel_height_mm")


def _advance(position_mm: FloatArray, time_s: FloatArray) -> FloatArray:
    """Way of the nozzle since the piece before, (n,); long where a new bead begins."""
    step = np.linalg.norm(np.diff(position_mm, axis=0), axis=1)
    step[np.diff(time_s) > _NEW_BEAD_S] += _NEW_BEAD_MM
    return np.concatenate([[0.0], step])


def _voxel_map(
    powder: PowderTotals, config: ProcessConfig, path: BeamOnPath, kept: NDArray[np.intp],
    corner: FloatArray, height: FloatArray, voxels: FloatArray, caught: FloatArray,
    surface: FloatArray,
) -> VoxelMap:
    n = len(path.time_s)
    stayed = np.zeros((n, len(path.materials) + 1))
    stayed[kept, :-1] = caught
    total = stayed.sum(axis=1, keepdims=True)
    below = np.full(n, np.nan)
    below[kept] = surface - config.substrate_z_mm
    return VoxelMap(
        origin_mm=corner,
        voxel_mm=np.array([config.voxel_mm, config.voxel_mm, config.voxel_height_mm]),
        powders=(*path.materials, config.substrate),
        substrate_material=config.substrate_material,
        deposited_mm3=np.ascontiguousarray(np.moveaxis(voxels, 3, 0), dtype=np.float32),
        height_mm=height,
        substrate_z_mm=config.substrate_z_mm,
        density_g_mm3=np.append(powder.density_g_mm3, np.nan),
        fed_g=np.append(powder.fed_g, 0.0),
        beam_on_g=np.append(powder.beam_on_g, 0.0),
        beam_off_g=np.append(powder.beam_off_g, 0.0),
        place_mm=path.position_mm, time_s=path.time_s, beam_on_mm=path.length_mm,
        delivered=np.divide(stayed, total, out=np.full_like(stayed, np.nan), where=total > 0),
        surface_mm=below, line=path.line.astype(np.int32),
        notes=tuple(_notes(config, path, below)),
    )


def _notes(config: ProcessConfig, path: BeamOnPath, below_mm: FloatArray) -> list[str]:
    """What went wrong in the process itself."""
    gap = path.position_mm[:, 2] - config.substrate_z_mm - below_mm
    touching = np.flatnonzero(gap < -config.nozzle_gap_mm)
    notes = []
    if len(touching):
        at = path.position_mm[touching[0]]
        notes.append(f"the nozzle ran into the deposit at x {at[0]:.1f}, y {at[1]:.1f}, "
                     f"z {at[2]:.1f} mm")
    starved = path.volume_rate_mm3_s <= 0
    if starved.any():
        length = float(path.length_mm[starved].sum())
        notes.append(f"no powder came along {length:.1f} mm of the path with the beam on")
    return notes
