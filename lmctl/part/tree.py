"""From the bodies a part file lists to a tree that answers, and to the rule that goes with it.

Data is read first, then the pitch is settled, then bodies are built from the part downwards; a body
that several others name is built once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lmctl.config import bodies as config
from lmctl.config.composition import FaceFeature, SheetFeature
from lmctl.config.part_file import PartFile
from lmctl.errors import InputError
from lmctl.field.cloud import cloud_field
from lmctl.field.grid import Grid
from lmctl.part.bodies import Body, FieldSolid, MeshSolid
from lmctl.part.cloud_files import Cloud
from lmctl.part.combined import Combined
from lmctl.part.composition import Carried, Mixed, Rule, Uniform
from lmctl.part.cost import CLOUD_S, MESH_S, OPERAND_S, Cost, Item
from lmctl.part.data import Data
from lmctl.part.formulas import Box, Cone, Cylinder, HalfSpace, Sphere, Torus
from lmctl.part.measured import Bounds, is_closed, without_specks
from lmctl.part.mesh_files import Mesh
from lmctl.part.moved import Motion, Moved, motion
from lmctl.part.offset import Offset
from lmctl.part.overlap import Overlap
from lmctl.part.prism import Prism, closed_polygon
from lmctl.part.resolution import boundary_grid, checked_grid, choose_pitch
from lmctl.part.rules import Surroundings, rule_of

FloatArray = NDArray[np.float64]
Operation = Literal["union", "difference", "intersection"]


class Tree:
    """The bodies of a checked part file with their data.

    data : what their files hold; it also collects what there is to say
    """

    def __init__(self, part: PartFile, data: Data) -> None:
        self._part = part
        self._data = data
        self._number = {body.name: n for n, body in enumerate(part.body) if body.name}
        self._roots = part.roots()
        self._boxes: dict[int, Bounds] = {}
        self._built: dict[tuple[int, bool], Body] = {}
        self.box = self._joint_box(part.combine, self._roots)
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
        return self._joined(self._part.combine, self._roots, whole=True)

    def cost(self) -> Cost:
        """What has to be made before the part can answer. Raises InputError as building would."""
        items = []
        if self._part.combine is not None:
            grid = self._boundary_grid(self._part.combine, self._roots, True)
            items.append(Item("the combination", grid.n_nodes, OPERAND_S * len(self._roots), False))
        for number, body in enumerate(self._part.body):
            name = self._called([number])
            if isinstance(body, config.MeshBody | config.CloudBody):
                grid = checked_grid(*self._box(number), body.pitch_mm or self.pitch_mm, stored=True)
                each_s = MESH_S if isinstance(body, config.MeshBody) else CLOUD_S
                items.append(Item(name, grid.n_nodes, each_s, True))
            elif isinstance(body, config.BooleanBody):
                of = [self._number[other] for other in body.of]
                grid = self._boundary_grid(body.kind, of, True)
                items.append(Item(name, grid.n_nodes, OPERAND_S * len(of), False))
        return Cost(tuple(items))

    @cached_property
    def rule(self) -> Rule:
        """Of what it is."""
        if self._part.composition is not None:
            return rule_of(self._part.composition, self.body, self._around)
        if len(self._part.material) == 1:
            return Uniform((1.0,))
        return self._joint_rule(self._part.combine, self._roots)

    def _joint_box(self, operation: Operation | None, numbers: Sequence[int]) -> Bounds:
        """The box that bodies combined so lie in."""
        boxes = [self._box(number) for number in numbers]
        lows, highs = [box[0] for box in boxes], [box[1] for box in boxes]
        if operation == "intersection":
            low, high = np.max(lows, axis=0), np.min(highs, axis=0)
            if (low >= high).any():
                raise InputError("the intersection of the bodies leaves nothing",
                                 where=f"of {self._called(numbers)}",
                                 hint="check where the bodies lie")
            return low, high
        if operation == "union":
            return np.min(lows, axis=0), np.max(highs, axis=0)
        return boxes[0]

    def _box(self, number: int) -> Bounds:
        """The box a body lies in, without building it; perhaps a little large, perhaps infinite."""
        if number not in self._boxes:
            self._boxes[number] = self._measured_box(number)
        return self._boxes[number]

    def _measured_box(self, number: int) -> Bounds:
        body = self._part.body[number]
        match body:
            case config.MeshBody() | config.CloudBody():
                points = self._data.points(body)
                return points.min(axis=0), points.max(axis=0)
            case config.ShellBody():
                low, high = self._box(self._number[body.of])
                if (high - low).min() <= 2 * body.from_mm:
                    raise InputError(
                        f"nothing of {body.of!r} lies deeper than {body.from_mm:g} mm",
                        where=f"it is {float((high - low).min()):.4g} mm thick at most",
                        hint="lower from_mm of the shell",
                    )
                return low + body.from_mm, high - body.from_mm
            case config.MovedBody():
                low, high = self._box(self._number[body.of])
                return _moved_box(low, high, _motion(body))
            case config.BooleanBody():
                return self._joint_box(body.kind, [self._number[name] for name in body.of])
            case _:
                return self._formula(body, number).bounds_mm

    def _joined(
        self, operation: Operation | None, numbers: Sequence[int], *, whole: bool
    ) -> Body:
        """Bodies combined. whole : in the part's own place, so that only its box matters."""
        if operation is None or len(numbers) == 1:
            return self._solid(numbers[0], whole)
        bodies = tuple(self._solid(number, whole) for number in numbers)
        return Combined(operation, bodies, self._boundary_grid(operation, numbers, whole))

    def _boundary_grid(
        self, operation: Operation, numbers: Sequence[int], whole: bool
    ) -> Grid:
        low, high = self._joint_box(operation, numbers)
        if whole:
            room = 4 * self.pitch_mm
            low, high = np.maximum(low, self.box[0] - room), np.minimum(high, self.box[1] + room)
            low, high = np.minimum(low, self.box[1]), np.maximum(high, self.box[0])
        if not np.isfinite([low, high]).all():
            raise InputError(f"the {operation} of {self._called(numbers)} has no end",
                             hint="cut its half-spaces with a body that has one")
        return boundary_grid(low, high, self.pitch_mm)

    def _solid(self, number: int, whole: bool) -> Body:
        key = (number, whole)
        if key not in self._built:
            self._built[key] = self._build(number, whole)
        return self._built[key]

    def _build(self, number: int, whole: bool) -> Body:
        body = self._part.body[number]
        match body:
            case config.MeshBody():
                return self._mesh(self._data.mesh(body), body.pitch_mm)
            case config.CloudBody():
                return self._cloud(self._data.cloud(body), body.pitch_mm)
            case config.ShellBody():
                return self._shell(body, whole)
            case config.MovedBody():
                of = self._number[body.of]
                inner = self._part.body[of]
                if isinstance(inner, config.MeshBody):  # its triangles give exact outlines
                    mesh = self._data.mesh(inner)
                    moved = Mesh(_motion(body).there(mesh.vertices), mesh.triangles)
                    return self._mesh(moved, inner.pitch_mm)
                return self._carried(self._solid(of, False), _motion(body), self._box(number))
            case config.BooleanBody():
                numbers = [self._number[name] for name in body.of]
                return self._joined(body.kind, numbers, whole=whole)
            case _:
                return self._formula(body, number)

    def _carried(self, body: Body, by: Motion, box: Bounds) -> Body:
        """A body moved elsewhere; of a boolean each of its bodies is, so that it stays one."""
        if not isinstance(body, Combined):
            return Moved(body, by)
        return body.carried(lambda inner: Moved(inner, by), boundary_grid(*box, self.pitch_mm))

    def _shell(self, body: config.ShellBody, whole: bool) -> Body:
        of = self._solid(self._number[body.of], whole)
        low, high = self._box(self._number[body.of])
        least = min(body.from_mm, 0.0)
        if not np.isfinite([low, high]).all():
            raise InputError(f"the shell of {body.of!r} has no end",
                             hint="cut it with a body that has one")
        grid = boundary_grid(low + least, high - least, self.pitch_mm)
        outer = of if body.from_mm == 0 else Offset(of, body.from_mm, grid)
        if body.to_mm is None:
            return outer
        return Combined("difference", (outer, Offset(of, body.to_mm, grid)), grid)

    def _mesh(self, mesh: Mesh, pitch_mm: float | None) -> Body:
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        return MeshSolid(mesh, checked_grid(low, high, pitch_mm or self.pitch_mm, stored=True))

    def _cloud(self, cloud: Cloud, pitch_mm: float | None) -> Body:
        low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
        grid = checked_grid(low, high, pitch_mm or self.pitch_mm, stored=True)
        stored = cloud_field(cloud.points, grid)
        if not is_closed(stored):
            raise InputError(
                "the surface fitted to the point cloud is not closed",
                where=f"its inside reaches the edge of its grid at a pitch of {grid.pitch_mm:g} mm",
                hint="scan the missing places, or give a larger pitch_mm",
            )
        stored, specks = without_specks(stored)
        self._data.warnings += stored.remarks
        if specks:
            self._data.notes.append(f"{specks} specks of the fitted cloud smoothed away")
        return FieldSolid(stored, math.pi / 4 * self._part.process.bead_width_mm**2)

    def _formula(self, body: config.Body, number: int) -> Body:
        match body:
            case config.BoxBody():
                return Box(body.low_mm, body.high_mm)
            case config.SphereBody():
                return Sphere(body.centre_mm, body.radius_mm)
            case config.CylinderBody():
                return Cylinder(body.base_mm, body.top_mm, body.radius_mm)
            case config.ConeBody():
                return Cone(body.base_mm, body.top_mm, body.base_radius_mm, body.top_radius_mm)
            case config.TorusBody():
                return Torus(body.centre_mm, body.axis, body.radius_mm, body.tube_radius_mm)
            case config.HalfSpaceBody():
                return HalfSpace(body.point_mm, body.outward)
            case config.PrismBody():
                corners = np.array(body.outline_mm, dtype=np.float64)
                loop = closed_polygon(corners, self._called([number]))
                return Prism(loop, body.low_mm, body.high_mm)
        raise TypeError(body.kind)

    @cached_property
    def _around(self) -> Surroundings:
        return Surroundings(
            tuple(material.name for material in self._part.material),
            lambda name: self._solid(self._number[name], False),
            self._triangles,
        )

    def _triangles(self, feature: FaceFeature | SheetFeature) -> FloatArray:
        if isinstance(feature, SheetFeature):
            return self._data.sheet(feature)
        of = self._part.body[self._number[feature.of]]
        if not isinstance(of, config.MeshBody):
            raise InputError(f"{feature.of!r} has no faces to choose from",
                             where=f"it is a {of.kind}", hint="faces are patches of a mesh")
        return self._data.face(of, feature)

    def _joint_rule(self, operation: Operation | None, numbers: Sequence[int]) -> Rule:
        """What becomes of the bodies' materials when they are combined (method.md 4)."""
        if operation is None or operation == "difference":
            return self._rule(numbers[0])
        ruled = [n for n in numbers if operation == "union" or self._has_rule(n)]
        rules = tuple(self._rule(number) for number in ruled)
        if len(rules) == 1:
            return rules[0]
        bodies = tuple(self._solid(number, True) for number in ruled)
        grid = self._boundary_grid(operation, ruled, True)
        return Mixed(bodies, rules, Overlap(bodies, grid))

    def _rule(self, number: int) -> Rule:
        body = self._part.body[number]
        if body.composition is not None:
            return rule_of(body.composition, self._solid(number, True), self._around)
        match body:
            case config.ShellBody():
                return self._rule(self._number[body.of])
            case config.MovedBody():
                return Carried(self._rule(self._number[body.of]), _motion(body))
            case config.BooleanBody():
                return self._joint_rule(body.kind, [self._number[name] for name in body.of])
        raise InputError(f"it is not said of what {self._called([number])} is",
                         hint="give it a composition")

    def _has_rule(self, number: int) -> bool:
        body = self._part.body[number]
        if body.composition is not None:
            return True
        below = [self._number[name] for name in config.named_by(body)]
        if isinstance(body, config.BooleanBody) and body.kind == "difference":
            below = below[:1]
        return any(self._has_rule(n) for n in below)

    def _called(self, numbers: Sequence[int]) -> str:
        """Bodies as people know them: by name, else by their number in the file."""
        named = [self._part.body[n].name for n in numbers]
        return ", ".join(
            repr(name) if name else f"body[{n + 1}]" for n, name in zip(numbers, named, strict=True)
        )


def _motion(body: config.MovedBody) -> Motion:
    turn = body.turn or config.Turn(axis=(0.0, 0.0, 1.0), degrees=0.0)
    return motion(body.scale, turn.axis, turn.degrees, turn.through_mm, body.by_mm)


def _moved_box(low: FloatArray, high: FloatArray, by: Motion) -> Bounds:
    if not np.isfinite([low, high]).all():
        return np.full(3, -np.inf), np.full(3, np.inf)
    return Moved(Box(tuple(low), tuple(high)), by).bounds_mm


def _reach(box: Bounds) -> str:
    return "without end along " + ", ".join(
        axis for axis, a, b in zip("xyz", *box, strict=True) if not np.isfinite([a, b]).all()
    )
