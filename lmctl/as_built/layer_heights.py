"""Planned and built height of each layer, from the surface that the next one met."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.as_built.built_volume import BuiltVolume
from lmctl.as_built.figures import BuiltLayer
from lmctl.job.reader import JobReader


def layer_index_of_pieces(built: BuiltVolume, job: JobReader) -> IndexArray:
    """(n,) index of the layer that each piece of the path belongs to, by its program line."""
    first = np.array([entry.first_line for entry in job.manifest.layers])
    return np.maximum(np.searchsorted(first, built.path.line, side="right") - 1, 0)


def built_layers(built: BuiltVolume, job: JobReader, layer: IndexArray) -> tuple[BuiltLayer, ...]:
    """Every layer with a path. layer : (n,) of the pieces.

    A pool always lies a little on its neighbour, so a surface met is compared with the one that the
    first layer met, which was the plate; of copies deposited one after the other each has its own.
    The last layer's is the height of the part there.
    """
    path, layers = built.path, []
    met = {
        int(number): _mean(path.surface_mm[layer == number], path.beam_on_mm[layer == number])
        for number in np.unique(layer)
    }
    lowest = job.manifest.layers[0].z_mm
    first = next((n for n in sorted(met) if job.manifest.layers[n].z_mm <= lowest + 1e-6), None)
    for number in sorted(met):
        entry = job.manifest.layers[number]
        of_it = layer == number
        top: float | None = None
        if first is not None and number + 1 in met and (
            job.manifest.layers[number + 1].z_mm > entry.z_mm
        ):
            top = met[number + 1] - met[first]
        elif number == max(met) and built.built_by == "simulated":
            top = _height_under(built, of_it)
        layers.append(BuiltLayer(
            number + 1, entry.z_mm - job.manifest.layers[0].z_mm + _first_height(job),
            top if top is not None and np.isfinite(top) else None,
            float(path.beam_on_mm[of_it].sum())))
    return tuple(layers)


def _first_height(job: JobReader) -> float:
    """Height of the first layer; all layers are equally high."""
    entries = job.manifest.layers
    return entries[1].z_mm - entries[0].z_mm if len(entries) > 1 else entries[0].z_mm


def _height_under(built: BuiltVolume, of_it: FloatArray) -> float:
    """Mean height of the surface under some pieces."""
    place = built.path.place_mm[of_it, :2]
    cells = ((place - built.origin_mm[:2]) / built.voxel_mm[:2]).astype(int)
    return _mean(built.height_mm[cells[:, 0], cells[:, 1]], built.path.beam_on_mm[of_it])


def _mean(values: FloatArray, weight: FloatArray) -> float:
    known = np.isfinite(values)
    total = float(weight[known].sum())
    return float(values[known] @ weight[known]) / total if total > 0 else float("nan")
