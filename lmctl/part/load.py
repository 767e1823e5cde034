"""From a part file, or a bare mesh or cloud, to a part."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lmctl.config import part_file as config
from lmctl.config.part_rules import load_part_file, parse_part_file
from lmctl.errors import InputError
from lmctl.field.cloud import cloud_field
from lmctl.field.grid import Grid
from lmctl.part.bodies import Body, FieldSolid, MeshSolid
from lmctl.part.cloud_files import CLOUD_SUFFIXES, Cloud, read_cloud
from lmctl.part.combined import Combined
from lmctl.part.composition import rule_of
from lmctl.part.files import read_data
from lmctl.part.formulas import Box, Cylinder, Sphere
from lmctl.part.materials import resolve_materials
from lmctl.part.measured import Bounds, is_closed, without_specks
from lmctl.part.mesh_files import MESH_SUFFIXES, Mesh, read_mesh
from lmctl.part.mesh_report import mend
from lmctl.part.part import Part
from lmctl.part.resolution import checked_grid, choose_pitch, plane_around

#: What a bare mesh or cloud is made of.
DEFAULT_MATERIAL = "316L"


@dataclass
class _Said:
    """What reading a part found to say, and the digests of what it read."""

    sources: dict[str, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def load_part(path: Path) -> Part:
    """The part a part file describes.

    Raises ConfigError (the file; all mistakes at once) and InputError (its data).
    """
    checked, text = load_part_file(path)
    return _build(checked, text, path.parent, _Said())


def part_from_model(path: Path, units: str | None = None) -> Part:
    """A mesh or cloud file alone as a part, with defaults that its warnings and notes name.

    units : "mm", "cm", "m" or "inch"; None takes mm, and says so
    Raises InputError.
    """
    suffix = path.suffix.lower().removeprefix(".")
    if suffix not in {*MESH_SUFFIXES, *CLOUD_SUFFIXES}:
        raise InputError(
            f"{path} is neither a part file, a mesh nor a point cloud",
            hint="TOML, STL, PLY, OBJ, XYZ and CSV files can be read; the ending must say which",
        )
    kind = "mesh" if suffix in MESH_SUFFIXES else "cloud"
    if suffix == "ply" and not _has_faces(path):
        kind = "cloud"
    said = _Said()
    if units is None:
        said.warnings.append(f"{path.name} states no units: taken as mm")
    said.warnings.append(f"no material is stated: all of it is {DEFAULT_MATERIAL}")
    name = path.stem[:100] or "part"
    text = (
        f"name = {_quoted(name)}\n\n[[material]]\nname = {_quoted(DEFAULT_MATERIAL)}\n\n"
        f"[[body]]\nkind = {_quoted(kind)}\nfile = {_quoted(path.name)}\n"
        f"units = {_quoted(units or 'mm')}\n"
    )
    return _build(parse_part_file(text, name=str(path)), text, path.parent, said)


def _build(part: config.PartFile, text: str, folder: Path, said: _Said) -> Part:
    materials = resolve_materials(part)
    bodies = _Bodies(part, folder, said)
    body = bodies.build()
    if isinstance(body, MeshSolid | FieldSolid | Combined):
        grid = body.grid
        said.warnings += _coarse(part, body)
    else:
        grid = checked_grid(*body.bounds_mm, bodies.pitch_mm, stored=False)
    said.notes += [note for material in materials if (note := material.note())]
    # power and speed are the materials' own or the library's, and named there
    unwritten = set(config.Process.model_fields) - part.process.model_fields_set
    if keys := sorted(unwritten - {"power_W", "speed_mm_s"}):
        values = ", ".join(f"{key} {getattr(part.process, key)}" for key in keys)
        said.notes.append(f"process: by default {values}")
    return Part(
        name=part.name,
        text=text,
        sources=said.sources,
        materials=materials,
        process=part.process,
        placement_mm=None if part.placement is None else part.placement.origin_mm,
        warnings=tuple(said.warnings),
        notes=tuple(said.notes),
        body=body,
        rule=rule_of(part, body),
        grid=grid,
        plane=plane_around(grid, part.process.bead_width_mm),
    )


def _coarse(part: config.PartFile, body: MeshSolid | FieldSolid | Combined) -> list[str]:
    """A warning where the part is thin for its pitch and depths or outlines come from its field."""
    low, high = body.bounds_mm
    thinnest, pitch = float((high - low).min()), body.grid.pitch_mm
    by_depth = part.process.strategy == "iso-3d" or (
        part.composition is not None
        and isinstance(part.composition.feature, config.SurfaceFeature)
    )
    if thinnest >= 3 * pitch or (isinstance(body, MeshSolid) and not by_depth):
        return []
    return [
        f"the part is only {thinnest:.3g} mm thick, a pitch of {pitch:g} mm is coarse for it; "
        f"pitch_mm = {thinnest / 5:.2g} would resolve it"
    ]


class _Bodies:
    """Reads the data of all bodies, then settles the pitch, then builds the tree."""

    def __init__(self, part: config.PartFile, folder: Path, said: _Said) -> None:
        self._part = part
        self._said = said
        self._read = [self._data(body, folder) for body in part.body]
        low, high = _around([_extent(item) for item in self._read], part.combine)
        if part.pitch_mm is None:
            self.pitch_mm = choose_pitch(low, high, part.process.bead_width_mm)
            said.notes.append(f"pitch_mm: by default {self.pitch_mm:g}")
        else:
            self.pitch_mm = part.pitch_mm
        self._box = low, high

    def build(self) -> Body:
        bodies = tuple(self._solid(item) for item in self._read)
        if self._part.combine is None:
            return bodies[0]
        grid = checked_grid(*self._box, self.pitch_mm, stored=True)
        return Combined(self._part.combine, bodies, grid)

    def _data(self, body: config.Body, folder: Path) -> Mesh | Cloud | Body:
        match body:
            case config.MeshBody():
                file = read_data(body.file, folder)
                self._said.sources[body.file] = file.sha256
                mesh, warnings = mend(
                    read_mesh(file, body.units), body.file, self._part.process.bead_width_mm
                )
                self._said.warnings += warnings
                return mesh
            case config.CloudBody():
                file = read_data(body.file, folder)
                self._said.sources[body.file] = file.sha256
                cloud = read_cloud(file, body.units)
                self._said.notes += cloud.notes
                return cloud
            case config.BoxBody():
                return Box(body.low_mm, body.high_mm)
            case config.SphereBody():
                return Sphere(body.centre_mm, body.radius_mm)
            case config.CylinderBody():
                return Cylinder(body.base_mm, body.top_mm, body.radius_mm)

    def _solid(self, item: Mesh | Cloud | Body) -> Body:
        if isinstance(item, Mesh):
            return MeshSolid(item, self._grid(item))
        if isinstance(item, Cloud):
            stored = cloud_field(item.points, self._grid(item))
            if not is_closed(stored):
                raise InputError(
                    "the surface fitted to the point cloud is not closed",
                    where=f"its inside reaches the edge of its grid at a pitch of "
                    f"{self.pitch_mm:g} mm",
                    hint="scan the missing places, or give a larger pitch_mm",
                )
            stored, specks = without_specks(stored)
            self._said.warnings += stored.remarks
            if specks:
                self._said.notes.append(f"{specks} specks of the fitted cloud smoothed away")
            bead_mm = self._part.process.bead_width_mm
            return FieldSolid(stored, math.pi / 4 * bead_mm**2)
        return item

    def _grid(self, item: Mesh | Cloud) -> Grid:
        return checked_grid(*_extent(item), self.pitch_mm, stored=True)


def _extent(item: Mesh | Cloud | Body) -> Bounds:
    if isinstance(item, Mesh):
        points = item.vertices
    elif isinstance(item, Cloud):
        points = item.points
    else:
        return item.bounds_mm
    return points.min(axis=0), points.max(axis=0)


def _around(boxes: list[Bounds], combine: str | None) -> Bounds:
    """The box the combination of bodies in these boxes lies in."""
    lows, highs = [box[0] for box in boxes], [box[1] for box in boxes]
    if combine == "intersection":
        low, high = np.max(lows, axis=0), np.min(highs, axis=0)
        if (low >= high).any():
            raise InputError("the intersection of the bodies leaves nothing",
                             hint="check where the bodies lie")
        return low, high
    if combine == "difference":
        return boxes[0]
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _has_faces(path: Path) -> bool:
    """Whether a PLY's head promises faces; whatever else is wrong with it is told on reading."""
    try:
        with path.open("rb") as file:
            head = file.read(100_000).partition(b"end_header")[0]
    except OSError:
        return True
    return any(
        line.split()[:2] == [b"element", b"face"] and line.split()[2:] != [b"0"]
        for line in head.splitlines()
    )


def _quoted(text: str) -> str:
    """A TOML string. Raises InputError where a file's name cannot be written in one."""
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        raise InputError("the file's name is not valid text", where=repr(text),
                         hint="rename it") from None
    escaped = "".join(
        f"\\u{ord(c):04x}" if ord(c) < 0x20 or ord(c) == 0x7F or c in '"\\' else c for c in text
    )
    return f'"{escaped}"'
