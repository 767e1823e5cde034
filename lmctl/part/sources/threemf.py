"""Triangles of what a 3MF file builds: its start part's build items, wherever their objects lie."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.config.quantities import MM_PER_UNIT
from lmctl.errors import InputError
from lmctl.part.sources.files import DataFile
from lmctl.part.sources.threemf_model import (
    MM_PER_3MF_UNIT,
    SOLID_OBJECT_TYPE,
    PlacedObject,
    ThreemfModel,
    Transform,
    read_model,
)
from lmctl.part.sources.threemf_package import ThreemfPackage

#: Most meshes that nested components may place.
MAX_PLACED_MESHES = 10_000
MAX_COMPONENT_DEPTH = 16


def read_3mf(file: DataFile, units: str | None) -> tuple[FloatArray, IntArray, tuple[str, ...]]:
    """Corners (n, 3) float64 and triangles (m, 3) int64 of what the file builds, in mm; and notes.

    units : as the part file states them, None to take the file's own
    raises : InputError where it cannot be read, or states other units than the part file
    """
    build = _Build(ThreemfPackage(file))
    if units is not None and MM_PER_UNIT[units] != MM_PER_3MF_UNIT[build.unit]:
        raise InputError(
            f"{file.path} states its units itself: {build.unit}",
            where=f"the part file says {units}", hint="leave `units` out for this file",
        )
    placed = list(itertools.islice(build.meshes(), MAX_PLACED_MESHES + 1))
    if len(placed) > MAX_PLACED_MESHES:
        raise build.package.damage_error(f"it places more than {MAX_PLACED_MESHES:,} meshes")
    if not placed:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64), build.notes()
    starts = np.cumsum([0] + [len(v) for v, _ in placed])
    vertices = np.concatenate([v for v, _ in placed])
    triangles = np.concatenate([t + n for (_, t), n in zip(placed, starts[:-1], strict=True)])
    return vertices * MM_PER_3MF_UNIT[build.unit], triangles, build.notes()


class _Build:
    """The build of a package's start part; other model parts are read when it names them."""

    def __init__(self, package: ThreemfPackage) -> None:
        self.package = package
        self._start = package.start_part()
        self._models: dict[str, ThreemfModel] = {}
        self._not_solid: set[str] = set()
        self.unit = self._model(self._start).unit

    def meshes(self) -> Iterator[tuple[FloatArray, IntArray]]:
        """Vertices (n, 3) in the file's unit and triangles (m, 3) of each mesh that is placed."""
        for item in self._model(self._start).items:
            yield from self._placed(item, _identity(), 0)

    def notes(self) -> tuple[str, ...]:
        """What was left out, for the user."""
        notes = []
        if self._not_solid:
            notes.append("objects that are no solids are left out: "
                         + ", ".join(sorted(self._not_solid)))
        if left_out := self._model(self._start).left_out:
            notes.append(f"{left_out} of its build items are not to be printed: left out")
        return tuple(f"{self.package.file.path.name}: {note}" for note in notes)

    def _placed(
        self, at: PlacedObject, by: Transform, depth: int
    ) -> Iterator[tuple[FloatArray, IntArray]]:
        if depth > MAX_COMPONENT_DEPTH:
            raise self.package.damage_error("objects of objects too deep, or in a circle")
        found = self._model(at.part).objects.get(at.id)
        if found is None:
            raise self.package.damage_error(f"there is no object {at.id} in {at.part}")
        if found.type != SOLID_OBJECT_TYPE:
            self._not_solid.add(f"object {at.id} ({found.type})")
            return
        combined = np.vstack([at.transform[:3] @ by[:3], at.transform[3] @ by[:3] + by[3]])
        try:
            vertices, triangles = found.arrays()
        except (ValueError, OverflowError) as error:
            raise self.package.damage_error(f"object {at.id} in {at.part}: {error}") from None
        if len(triangles):
            mirrored = np.linalg.det(combined[:3]) < 0.0  # which turns triangles inside out
            yield (vertices @ combined[:3] + combined[3],
                   triangles[:, ::-1] if mirrored else triangles)
        for component in found.components:
            yield from self._placed(component, combined, depth + 1)

    def _model(self, part: str) -> ThreemfModel:
        if part not in self._models:
            model = read_model(self.package, part)
            if self._models and model.unit != self.unit:
                raise self.package.damage_error(
                    f"{part} is in {model.unit}, the model that builds it in {self.unit}")
            self._models[part] = model
        return self._models[part]


def _identity() -> Transform:
    return np.vstack([np.eye(3), np.zeros(3)])
