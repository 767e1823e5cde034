"""Reads a voxel map (docs/reference/voxel-map.md), and refuses a file that is not one."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lmctl.as_built.built_volume import BuiltPath, BuiltVolume, PowderUse
from lmctl.errors import InputError, MissingFileError

_FORMAT = "voxel-map-1"
#: Bytes of an unpacked array; more is no map of ours.
MAX_ARRAY_BYTES = 4_000_000_000
_HINT = "run the job again on a bench with a table [process]"

#: Arrays and their dimensions: k materials, n pieces of path, x, y, z voxels, m notes.
_SHAPES = {
    "origin_mm": ("3",), "voxel_mm": ("3",), "powders": ("k",), "substrate_material": (),
    "deposited_mm3": ("k", "x", "y", "z"), "height_mm": ("x", "y"), "substrate_z_mm": (),
    "density_g_mm3": ("k",), "fed_g": ("k",), "beam_on_g": ("k",), "beam_off_g": ("k",),
    "place_mm": ("n", "3"), "beam_on_mm": ("n",), "delivered": ("n", "k"), "surface_mm": ("n",),
    "line": ("n",), "notes": ("m",),
}
_TEXTS = ("powders", "substrate_material", "notes")
#: NaN has a meaning in these.
_MAY_BE_UNKNOWN = ("delivered", "surface_mm", "density_g_mm3")


def read_voxel_map(path: Path) -> BuiltVolume:
    """What the simulated process built.

    Raises MissingFileError; InputError where the file is damaged or no voxel map, with all that is
    wrong with it.
    """
    arrays = _arrays(path)
    if wrong := _mistakes(arrays):
        raise InputError(f"{path} is not a voxel map", where=wrong, hint=_HINT)
    number = {name: arrays[name].astype(np.float64) for name in _SHAPES if name not in _TEXTS
              and name not in ("deposited_mm3", "line")}
    return BuiltVolume(
        "simulated", number["origin_mm"], number["voxel_mm"],
        tuple(str(name) for name in arrays["powders"]), str(arrays["substrate_material"]),
        arrays["deposited_mm3"].astype(np.float32, copy=False), number["height_mm"],
        float(number["substrate_z_mm"]),
        BuiltPath(number["place_mm"], number["beam_on_mm"], number["delivered"],
                  number["surface_mm"], arrays["line"].astype(np.int64)),
        PowderUse(number["density_g_mm3"], number["fed_g"], number["beam_on_g"],
                  number["beam_off_g"]),
        tuple(str(note) for note in arrays["notes"]),
    )


def _arrays(path: Path) -> dict[str, Any]:
    try:
        with zipfile.ZipFile(path) as packed:
            if any(member.file_size > MAX_ARRAY_BYTES for member in packed.infolist()):
                raise InputError(f"{path} is not a voxel map", where="an array is too large",
                                 hint=_HINT)
        with np.load(path, allow_pickle=False) as file:
            if "format" not in file or str(file["format"]) != _FORMAT:
                raise InputError(f"{path} is not a voxel map", where=f"its format is not {_FORMAT}",
                                 hint=_HINT)
            return {name: file[name] for name in _SHAPES if name in file}
    except FileNotFoundError:
        raise MissingFileError.for_path(path, hint=_HINT) from None
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, NotImplementedError,
            MemoryError) as error:
        raise InputError(f"{path} is not a voxel map, or is damaged", where=str(error)[:200],
                         hint=_HINT) from None


def _mistakes(arrays: Mapping[str, Any]) -> list[str]:
    """Everything that is wrong with the arrays; nothing where they can be used."""
    wrong = [f"there is no array {name}" for name in _SHAPES if name not in arrays]
    size: dict[str, int] = {"3": 3}
    for name, array in arrays.items():
        wanted = _SHAPES[name]
        if array.ndim != len(wanted) or any(
            size.setdefault(axis, length) != length
            for axis, length in zip(wanted, array.shape, strict=True)
        ):
            wrong.append(f"{name} has the shape {array.shape}, not ({', '.join(wanted)})")
        elif name in _TEXTS:
            if array.dtype.kind != "U":
                wrong.append(f"{name} is not text")
        elif array.dtype.kind not in "fiu":
            wrong.append(f"{name} is not of numbers")
        elif not (np.isfinite(array) | (np.isnan(array) if name in _MAY_BE_UNKNOWN else False)
                  ).all():
            wrong.append(f"{name} holds values that are no numbers")
    if wrong:
        return wrong
    if (arrays["voxel_mm"] <= 0).any():
        wrong.append("voxel_mm is not above 0")
    elif count := _pieces_beside_the_voxels(arrays):
        wrong.append(f"place_mm: {count} of {size['n']} pieces of the path lie beside the voxels")
    if arrays["deposited_mm3"].min(initial=0.0) < -1e-6:
        wrong.append("deposited_mm3 is below 0")
    if size["k"] < 2 or len(set(arrays["powders"].tolist())) != size["k"]:
        wrong.append("powders are not different names of at least one powder and the substrate")
    return wrong


def _pieces_beside_the_voxels(arrays: Mapping[str, Any]) -> int:
    """Pieces of the path with no voxel under them; a map covers all of its path."""
    place = arrays["place_mm"][:, :2].astype(np.float64)
    column = np.floor((place - arrays["origin_mm"][:2]) / arrays["voxel_mm"][:2])
    return int(((column < 0) | (column >= arrays["height_mm"].shape)).any(axis=1).sum())
