"""Build the tree of bodies that a part file lists, and its composition field.

Data is read first, then the pitch is settled, then bodies are built from the part downwards; a body
that several others name is built once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config import bodies as config
from lmctl.config.composition import (
    FaceFeature,
    Feature,
    SheetFeature,
    SurfaceFeature,
    measured_bodies,
)
from lmctl.config.part_file import PartFile
from lmctl.errors import InputError
from lmctl.field.grid import Grid
from lmctl.part import bodies, booleans, materials  # modules are loaded where they are used
from lmctl.part.cost import CLOUD_S, OPERAND_S, CostItem, PartCost
from lmctl.part.extents import BodyExtents, analytic_body, transform_of
from lmctl.part.materials.composition import (
    CompositionField,
    OverlapComposition,
    TransformedComposition,
    UniformComposition,
)
from lmctl.part.part_data import PartData
from lmctl.part.resolution import boundary_grid, checked_grid, choose_pitch
from lmctl.part.sources.mesh_files import Mesh

if TYPE_CHECKING:
    from lmctl.part.bodies import Body, Bounds, SimilarityTransform
    from lmctl.part.booleans import Operation
    from lmctl.part.materials import CompositionContext
    from lmctl.part.sources.cloud_files import PointCloud


class BodyTree:
    """The bodies of a checked part file with their data.

    data : what their files hold; it also collects warnings and notes
    surface_error_mm : of the surfaces fitted to clouds, where a tolerance is stated
    """

    def __init__(self, part: PartFile, data: PartData) -> None:
        self.surface_error_mm: float | None = None
        self._part = part
        self.data = data
        self._number = {body.name: n for n, body in enumerate(part.body) if body.name}
        self._roots = part.root_body_indices()
        self._extents = BodyExtents(part, data, self._number)
        self._built: dict[tuple[int, bool], Body] = {}
        self.box = self._extents.combined_box(part.combine, self._roots)
        if not np.isfinite(self.box).all():
            raise InputError("the part has no end", where=f"it reaches {_reach(self.box)}",
                             hint="cut its half-spaces with a body that has one")
        if part.pitch_mm is None:
            self.pitch_mm = choose_pitch(*self.box, part.process.bead_width_mm)
            data.notes.append(f"pitch_mm: by default {self.pitch_mm:g}")
        else:
            self.pitch_mm = part.pitch_mm

    @cached_property
    def body(self) -> Body:
        """What the part is."""
        return self._joined(self._part.combine, self._roots, in_place=True)

    def body_in_place(self, number: int) -> Body:
        """One of its bodies, as and where the part has it. number : in the file, from 0"""
        return self._solid(number, True)

    def cost(self) -> PartCost:
        """What has to be computed before the part is ready. Raises InputError as building would."""
        items = []
        if self._part.combine is not None:
            grid = self._boundary_grid(self._part.combine, self._roots)
            each_s = OPERAND_S * sum(self._leaves(root) for root in self._roots)
            items.append(CostItem("the combination", grid.n_nodes, each_s, False))
        asked = self._asked()
        for number, body in enumerate(self._part.body):
            name = self._extents.display_names([number])
            if isinstance(body, config.CloudBody):
                low, high = self._extents.enclosing_box(number)
                grid = checked_grid(low, high, body.pitch_mm or self.pitch_mm, stored=True)
                items.append(CostItem(name, grid.n_nodes, CLOUD_S, True))
            elif isinstance(body, config.BooleanBody):
                of = [self._number[other] for other in body.of]
                grid = self._boundary_grid(body.kind, of)
                if number in asked:
                    each_s = OPERAND_S * self._leaves(number)
                    items.append(CostItem(name, grid.n_nodes, each_s, False))
        return PartCost(tuple(items))

    def _asked(self) -> set[int]:
        """Bodies whose distance is evaluated, so that booleans among them need a boundary of their
        own. Booleans that are only part of other booleans do not."""
        if self._part.composition is None and len(self._part.material) > 1:
            return set(range(len(self._part.body)))  # materials are mixed by their bodies' depths
        names = {body.of for body in self._part.body if isinstance(body, config.ShellBody)}
        if self._part.composition is not None:
            names |= measured_bodies(self._part.composition)
        asked = {self._number[name] for name in names}
        waiting = [*asked, *(self._roots if self._part.combine is None else ())]
        while waiting:
            number = waiting.pop()
            asked.add(number)
            body = self._part.body[number]
            if isinstance(body, config.MovedBody):
                waiting.append(self._number[body.of])
        return asked

    def _leaves(self, number: int) -> int:
        """Number of bodies that a boundary of this one evaluates."""
        body = self._part.body[number]
        if isinstance(body, config.BooleanBody):
            return sum(self._leaves(self._number[name]) for name in body.of)
        return self._leaves(self._number[body.of]) if isinstance(body, config.MovedBody) else 1

    @cached_property
    def composition_field(self) -> CompositionField:
        """The composition of the part."""
        if self._part.composition is not None:
            return materials.composition_field_of(
                self._part.composition, self.body, self._around)
        if len(self._part.material) == 1:
            return UniformComposition((1.0,))
        return self._joint_rule(self._part.combine, self._roots, in_place=True)

    def with_other_numbers(self, part: PartFile) -> BodyTree:
        """The tree of a part file that differs in numbers, with the same data.

        Bodies are shared where the file differs in compositions only.
        """
        other = BodyTree(part, self.data)
        if _without_compositions(part) == _without_compositions(self._part):
            other._built = self._built
            if part.composition is not None or "body" in self.__dict__:  # the same solid
                other.__dict__["body"] = self.body
        return other

    def measured_feature(self, feature: Feature) -> materials.Feature:
        """A feature that no composition need name. Raises InputError where its data is not there.

        A surface without `of` is that of the part.
        """
        if isinstance(feature, SurfaceFeature) and feature.of is not None:
            of = self._solid(self._number[feature.of], True)
            return materials.DepthBelowSurface(of, feature.level_mm)
        return materials.feature_of(feature, self.body, self._around)

    def named_body(self, name: str) -> Body:
        """A body of the part file as it stands in the part, its allowance included."""
        return self.body_in_place(self._number[name])

    def _joined(
        self, operation: Operation | None, numbers: Sequence[int], *, in_place: bool
    ) -> Body:
        """Bodies combined. in_place : where the part has them, not where a motion finds them"""
        if operation is None or len(numbers) == 1:
            return self._solid(numbers[0], in_place)
        of = tuple(self._solid(number, in_place) for number in numbers)
        grid = self._boundary_grid(operation, numbers, in_place=in_place)
        return booleans.CombinedBody(operation, of, grid)

    def _boundary_grid(
        self, operation: Operation, numbers: Sequence[int], *, in_place: bool = True
    ) -> Grid:
        """Around all of bodies combined, as depths need it: the part may be a small piece of them.

        Without end only in the part's own place, where what is far off no longer matters.
        """
        low, high = self._extents.combined_box(operation, numbers)
        if in_place:
            low = np.where(np.isfinite(low), low, self._far[0])
            high = np.where(np.isfinite(high), high, self._far[1])
        if not np.isfinite([low, high]).all():
            raise InputError(
                f"the {operation} of {self._extents.display_names(numbers)} has no end",
                hint="cut its half-spaces with a body that has one")
        return boundary_grid(low, high, self.pitch_mm)

    @cached_property
    def _far(self) -> Bounds:
        """A box that reaches the surface of each half-space and back from anywhere in the part."""
        low, high = self.box
        middle = 0.5 * (low + high)
        cuts = [bodies.HalfSpace(body.point_mm, body.outward) for body in self._part.body
                if isinstance(body, config.HalfSpaceBody)]
        away = max((abs(float(cut.distance_at(middle[None])[0])) for cut in cuts), default=0.0)
        reach = away + float(np.linalg.norm(high - low))
        return low - reach, high + reach

    def _solid(self, number: int, in_place: bool) -> Body:
        key = (number, in_place)
        if key not in self._built:
            built = self._build(number, in_place)
            allowance_mm = self._allowance_mm(number) if in_place else 0.0
            self._built[key] = bodies.AllowanceBody(built, allowance_mm) if allowance_mm else built
        return self._built[key]

    def _allowance_mm(self, number: int) -> float:
        """A body's own allowance, with that of the body it is a moved copy of."""
        body = self._part.body[number]
        inner = self._allowance_mm(self._number[body.of]) if isinstance(
            body, config.MovedBody) else 0.0
        return body.allowance_mm + inner

    def _build(self, number: int, in_place: bool) -> Body:
        body = self._part.body[number]
        match body:
            case config.MeshBody():
                return self._mesh(self.data.mesh(body), body.pitch_mm)
            case config.CloudBody():
                return self._cloud(self.data.cloud(body), body.pitch_mm)
            case config.ShellBody():
                return self._shell(body, in_place)
            case config.MovedBody():
                of = self._number[body.of]
                inner = self._part.body[of]
                if isinstance(inner, config.MeshBody):  # its triangles give exact outlines
                    mesh = self.data.mesh(inner)
                    moved = Mesh(transform_of(body).apply(mesh.vertices), mesh.triangles)
                    return self._mesh(moved, inner.pitch_mm)
                box = self._extents.enclosing_box(number)
                return self._carried(self._solid(of, False), transform_of(body), box)
            case config.BooleanBody():
                numbers = [self._number[name] for name in body.of]
                return self._joined(body.kind, numbers, in_place=in_place)
            case _:
                return analytic_body(body, self._extents.display_names([number]))

    def _carried(self, body: Body, by: SimilarityTransform, box: Bounds) -> Body:
        """A transformed body; a boolean stays one, as each of its bodies is transformed."""
        if not isinstance(body, booleans.CombinedBody):
            return bodies.TransformedBody(body, by)
        return body.transformed(lambda inner: bodies.TransformedBody(inner, by),
                                boundary_grid(*box, self.pitch_mm))

    def _shell(self, body: config.ShellBody, in_place: bool) -> Body:
        from lmctl.part.shells import make_shell  # late: few parts have one

        of = self._solid(self._number[body.of], in_place)
        box = self._extents.enclosing_box(self._number[body.of])
        return make_shell(of, box, body, self.pitch_mm)

    def _mesh(self, mesh: Mesh, pitch_mm: float | None) -> Body:
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        grid = checked_grid(low, high, pitch_mm or self.pitch_mm, stored=False)
        return bodies.MeshSolid(mesh, grid)

    def _cloud(self, cloud: PointCloud, pitch_mm: float | None) -> Body:
        low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
        grid = checked_grid(low, high, pitch_mm or self.pitch_mm, stored=True)
        # late: these take much of scipy
        from lmctl.field.cloud.cloud_field import cloud_field
        from lmctl.part.tolerance import cloud_within_tolerance

        if self._part.tolerance_mm is None:
            stored = cloud_field(cloud.points, grid, cloud.normals)
        else:
            surface = cloud_within_tolerance(
                cloud.points, cloud.normals, grid.pitch_mm, self._part.tolerance_mm,
                is_fixed=bool(pitch_mm or self._part.pitch_mm))
            stored, grid = surface.stored, surface.stored.grid
            self.surface_error_mm = max(self.surface_error_mm or 0.0, surface.error_mm)
            self.data.notes.append(
                f"the fitted surface is within {surface.error_mm:.2g} mm of the samples "
                f"(estimated from them, at a pitch of {grid.pitch_mm:.3g} mm); tolerance_mm is "
                f"{self._part.tolerance_mm:g}")
        if not bodies.is_closed(stored):
            raise InputError(
                "the surface fitted to the point cloud is not closed",
                where=f"its inside reaches the edge of its grid at a pitch of {grid.pitch_mm:g} mm",
                hint="scan the missing places, or give a larger pitch_mm",
            )
        stored, specks = bodies.remove_specks(stored)
        self.data.warnings += stored.remarks
        if specks:
            self.data.notes.append(f"{specks} specks of the fitted cloud smoothed away")
        return bodies.FieldSolid(stored, math.pi / 4 * self._part.process.bead_width_mm**2)

    @cached_property
    def _around(self) -> CompositionContext:
        return materials.CompositionContext(
            tuple(material.name for material in self._part.material),
            lambda name: self._solid(self._number[name], False),
            self._triangles,
            lambda sampled: self.data.voxels(sampled, self._part),
        )

    def _triangles(self, feature: FaceFeature | SheetFeature) -> FloatArray:
        if isinstance(feature, SheetFeature):
            return self.data.sheet(feature)
        of = self._part.body[self._number[feature.of]]
        if not isinstance(of, config.MeshBody):
            raise InputError(f"{feature.of!r} has no faces to choose from",
                             where=f"it is a {of.kind}", hint="faces are patches of a mesh")
        return self.data.face(of, feature)

    def _joint_rule(
        self, operation: Operation | None, numbers: Sequence[int], *, in_place: bool
    ) -> CompositionField:
        """The composition field of the bodies when they are combined.

        Source: docs/explanation/multi-colour-distance-field.md, Booleans.
        """
        if operation is None or operation == "difference":
            return self._rule(numbers[0], in_place)
        ruled = [n for n in numbers if operation == "union" or self._has_rule(n)]
        rules = tuple(self._rule(number, in_place) for number in ruled)
        if len(rules) == 1:
            return rules[0]
        of = tuple(self._solid(number, in_place) for number in ruled)
        grid = self._boundary_grid(operation, ruled, in_place=in_place)
        return OverlapComposition(of, rules, booleans.OverlapWeights(of, grid))

    def _rule(self, number: int, in_place: bool) -> CompositionField:
        body = self._part.body[number]
        if body.composition is not None:
            return materials.composition_field_of(
                body.composition, self._solid(number, in_place), self._around)
        match body:
            case config.ShellBody():
                return self._rule(self._number[body.of], in_place)
            case config.MovedBody():
                return TransformedComposition(self._rule(self._number[body.of], False),
                                              transform_of(body))
            case config.BooleanBody():
                numbers = [self._number[name] for name in body.of]
                return self._joint_rule(body.kind, numbers, in_place=in_place)
        raise AssertionError(f"body {number} has no composition: the part file is checked for that")

    def _has_rule(self, number: int) -> bool:
        body = self._part.body[number]
        if body.composition is not None:
            return True
        below = [self._number[name] for name in config.referenced_bodies(body)]
        if isinstance(body, config.BooleanBody) and body.kind == "difference":
            below = below[:1]
        return any(self._has_rule(n) for n in below)


def _without_compositions(part: PartFile) -> list[config.Body]:
    return [body.model_copy(update={"composition": None}) for body in part.body]


def _reach(box: Bounds) -> str:
    return "without end along " + ", ".join(
        axis for axis, a, b in zip("xyz", *box, strict=True) if not np.isfinite([a, b]).all()
    )
