"""The XML model in a 3MF file: its unit, its objects and what of these it builds.

The core of the format is read (meshes, components, build items and their transforms), and the
references to other model files of its production extension. Volumetric data leaves a mesh what it
is, and is read elsewhere (`volumetric_3mf`); a shape given by a function is refused. So is a model
that requires any other extension, as the format demands of readers without that extension.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.part.sources.threemf_package import NAMESPACE_END, ThreemfPackage, part_name

Transform = FloatArray

#: Millimetres in each unit of the format.
MM_PER_3MF_UNIT = {
    "micron": 0.001, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8,
    "meter": 1000.0,
}

PRODUCTION_NAMESPACE = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
VOLUMETRIC_NAMESPACE = "http://schemas.3mf.io/3dmanufacturing/volumetric/2022/01"

#: Extensions that a model may require: of the last, functions, only volumetric data makes use.
READ_NAMESPACES = (
    PRODUCTION_NAMESPACE, VOLUMETRIC_NAMESPACE,
    "http://schemas.3mf.io/3dmanufacturing/implicit/2023/12",
)

#: What extensions are called that a model may require.
EXTENSION_NAMES = {
    "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02": "beam lattice",
    "http://schemas.microsoft.com/3dmanufacturing/beamlattice/balls/2020/07": "beam lattice balls",
    "http://schemas.microsoft.com/3dmanufacturing/slice/2015/07": "slices",
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02": "materials and properties",
    "http://schemas.microsoft.com/3dmanufacturing/securecontent/2019/04": "secure content",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07": "triangle sets",
    "http://schemas.3mf.io/3dmanufacturing/booleanoperations/2023/07": "boolean operations",
    "http://schemas.3mf.io/3dmanufacturing/displacement/2023/10": "displacement",
}

#: Objects of this type, and those that state none, are solid.
SOLID_OBJECT_TYPE = "model"


@dataclass(frozen=True)
class PlacedObject:
    """An object placed: the part it is in, its id there, and where it goes."""

    part: str
    id: str
    transform: Transform


@dataclass(eq=False)
class ModelObject:
    """An object of a model: triangles of its own, or others placed.

    type : "model", "support", "solidsupport", "surface" or "other"
    """

    type: str
    corners: list[tuple[float, float, float]] = field(default_factory=list)
    faces: list[tuple[int, int, int]] = field(default_factory=list)
    components: list[PlacedObject] = field(default_factory=list)

    def arrays(self) -> tuple[FloatArray, IntArray]:
        """vertices (n, 3), triangles (m, 3). Raises ValueError where they cannot be meant."""
        points = np.array(self.corners, dtype=np.float64).reshape(-1, 3)
        triangles = np.array(self.faces, dtype=np.int64).reshape(-1, 3)
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(points):
            raise ValueError("a triangle names a corner that is not there")
        if not np.isfinite(points).all():
            raise ValueError("coordinates that are not numbers")
        return points, triangles


@dataclass(eq=False)
class ThreemfModel:
    """What a model part holds. left_out : build items it marks as not to be printed."""

    unit: str = "millimeter"
    objects: dict[str, ModelObject] = field(default_factory=dict)
    items: list[PlacedObject] = field(default_factory=list)
    left_out: int = 0


def read_model(package: ThreemfPackage, part: str) -> ThreemfModel:
    """The model in a part of a package. Raises InputError."""
    model = ThreemfModel()
    prefixes: dict[str, str] = {}
    namespace: list[str] = []
    current: list[ModelObject] = []

    def start(full_name: str, attributes: dict[str, str]) -> None:
        of, _, name = full_name.rpartition(NAMESPACE_END)
        if not namespace:
            if name != "model":
                raise package.damage_error(f"{part} begins with <{name}>, not <model>")
            namespace.append(of)
            model.unit = attributes.get("unit", model.unit)
            _check_extensions(package, attributes.get("requiredextensions", ""), prefixes)
        if of == VOLUMETRIC_NAMESPACE and name == "levelset":
            raise InputError(f"{package.file.path} gives a shape by a function (a level set)",
                             hint="export it as triangles")
        if of != namespace[0]:
            return
        match name:
            case "vertex" if current:
                x, y, z = (_number(attributes[axis]) for axis in "xyz")
                current[-1].corners.append((x, y, z))
            case "triangle" if current:
                a, b, c = (_index(attributes[key]) for key in ("v1", "v2", "v3"))
                current[-1].faces.append((a, b, c))
            case "object":
                number = attributes["id"]
                if number in model.objects:
                    raise ValueError(f"two objects have the id {number}")
                current.append(ModelObject(attributes.get("type", SOLID_OBJECT_TYPE)))
                model.objects[number] = current[-1]
            case "component" if current:
                current[-1].components.append(_reference(part, attributes))
            case "item":
                if attributes.get("printable", "1") in ("0", "false"):
                    model.left_out += 1
                else:
                    model.items.append(_reference(part, attributes))

    def start_namespace(prefix: str | None, uri: str) -> None:
        prefixes[prefix or ""] = uri

    package.parse(part, start, StartNamespaceDeclHandler=start_namespace)
    if model.unit not in MM_PER_3MF_UNIT:
        raise package.damage_error(f"unknown unit {model.unit!r}")
    return model


def _check_extensions(package: ThreemfPackage, required: str, prefixes: dict[str, str]) -> None:
    """Raises InputError, with their names, where any is not known here."""
    unknown = []
    for prefix in required.split():
        uri = prefixes.get(prefix, "")
        if uri not in READ_NAMESPACES:
            known = EXTENSION_NAMES.get(uri)
            unknown.append(f"{known} ({uri})" if known else uri or f"{prefix!r}, not declared")
    if unknown:
        raise InputError(
            f"{package.file.path} requires extensions of 3MF that are not known here",
            where=unknown, hint="export it without them, as plain triangles",
        )


def _reference(part: str, attributes: dict[str, str]) -> PlacedObject:
    path = attributes.get(PRODUCTION_NAMESPACE + NAMESPACE_END + "path")
    return PlacedObject(
        part if path is None else part_name(path, part), attributes["objectid"],
        _transform(attributes.get("transform")),
    )


def _transform(text: str | None) -> Transform:
    """(4, 3): rows of the turn, then the shift, as the format writes them."""
    if text is None:
        return np.vstack([np.eye(3), np.zeros(3)])
    by = np.array([_number(word) for word in text.split()], dtype=np.float64)
    if by.shape != (12,) or not np.isfinite(by).all():
        raise ValueError("a transform is not twelve numbers")
    return by.reshape(4, 3)


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise ValueError(f"{word[:40]!r} is not a number") from None


def _index(word: str) -> int:
    try:
        return int(word)
    except ValueError:
        raise ValueError(f"{word[:40]!r} is not a whole number") from None
