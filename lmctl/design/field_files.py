"""Fields of a simulation for ParaView: on the mesh itself (.vtu), or on a grid (.vti)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.design.performance_model import PerformanceModel
from lmctl.design.recovery import RecoveredFields
from lmctl.design.stress_measures import STRESS_MEASURES, stress_measure

#: VTK's numbers of quadratic triangles and tetrahedra, whose nodes are in scikit-fem's order.
_CELL_TYPE = {2: 22, 3: 24}


def nodal_arrays(model: PerformanceModel, fields: RecoveredFields) -> dict[str, FloatArray]:
    """Every field at the nodes, by the name it has in files."""
    found = {f"stress {measure} [MPa]": stress_measure(fields.stress_MPa, measure)
             for measure in STRESS_MEASURES}
    found["stress error [MPa]"] = fields.stress_error_MPa
    found["temperature [C]"] = fields.temperature_C
    moved = np.zeros((len(fields.displacement_mm), 3))
    moved[:, model.space.part_axes] = fields.displacement_mm
    found["displacement [mm]"] = moved
    for name, column in zip(model.phases.names, fields.fractions.T, strict=True):
        found[f"fraction {name}"] = column
    return found


def write_vtu(model: PerformanceModel, fields: RecoveredFields, target: Path) -> None:
    """The mesh with all nodal fields as a VTK unstructured grid. Raises OSError."""
    d = model.discretisation
    dim = model.space.dim
    cells = d.element_nodes
    blocks: list[bytes] = []
    offset = 0

    def array(name: str, values: np.ndarray, kind: str) -> str:
        nonlocal offset
        data = np.ascontiguousarray(values).tobytes()
        blocks.append(np.uint64(len(data)).tobytes() + data)
        components = values.shape[1] if values.ndim == 2 else 1
        text = (f'<DataArray type="{kind}" Name="{_escaped(name)}" '
                f'NumberOfComponents="{components}" format="appended" offset="{offset}"/>\n')
        offset += 8 + len(data)
        return text

    points = array("points", model.space.part_points(d.nodes_mm).astype("<f8"), "Float64")
    topology = (array("connectivity", cells.astype("<i8").ravel(), "Int64")
                + array("offsets", cells.shape[1] * np.arange(1, len(cells) + 1, dtype="<i8"),
                        "Int64")
                + array("types", np.full(len(cells), _CELL_TYPE[dim], dtype="u1"), "UInt8"))
    data = "".join(array(name, values.astype("<f4"), "Float32")
                   for name, values in nodal_arrays(model, fields).items())
    head = (
        '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" '
        'byte_order="LittleEndian" header_type="UInt64">\n<UnstructuredGrid>\n'
        f'<Piece NumberOfPoints="{d.n_nodes}" NumberOfCells="{len(cells)}">\n'
        f"<Points>\n{points}</Points>\n<Cells>\n{topology}</Cells>\n"
        f"<PointData>\n{data}</PointData>\n</Piece>\n</UnstructuredGrid>\n"
        '<AppendedData encoding="raw">\n_')
    with target.open("wb") as file:
        file.write(head.encode("utf-8"))
        for block in blocks:
            file.write(block)
        file.write(b"\n</AppendedData>\n</VTKFile>\n")


def write_vti(model: PerformanceModel, fields: RecoveredFields, target: Path) -> None:
    """All fields on a grid of the mesh's size; NaN outside the part. Raises OSError."""
    d = model.discretisation
    dim, size = model.space.dim, d.fitted.size_mm
    low, high = d.nodes_mm.min(axis=0), d.nodes_mm.max(axis=0)
    counts = np.maximum(np.rint((high - low) / size).astype(int), 1) + 1
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)]
    grid = np.stack(np.meshgrid(*axes[::-1], indexing="ij")[::-1], axis=-1).reshape(-1, dim)
    weights, nodes, inside = point_interpolation(model, grid)
    spacing, extent, origin = np.ones(3), np.ones(3, dtype=int), np.zeros(3)
    of = list(model.space.part_axes)
    spacing[of] = [axis[1] - axis[0] for axis in axes]
    extent[of], origin[of] = counts, low
    if dim == 2:
        origin[2 if model.space.kind != "axisymmetric" else 1] = (
            model.space.section_mm if model.space.kind != "axisymmetric" else 0.0)
    box = " ".join(f"0 {n - 1}" for n in extent)
    blocks, arrays, offset = [], "", 0
    for name, values in nodal_arrays(model, fields).items():
        found = np.einsum("na,na...->n...", weights, values[nodes])
        found[~inside] = np.nan
        data = found.astype("<f4").tobytes()
        arrays += (f'<DataArray type="Float32" Name="{_escaped(name)}" NumberOfComponents='
                   f'"{1 if values.ndim == 1 else 3}" format="appended" offset="{offset}"/>\n')
        blocks.append(np.uint64(len(data)).tobytes() + data)
        offset += 8 + len(data)
    with target.open("wb") as file:
        file.write((
            '<?xml version="1.0"?>\n<VTKFile type="ImageData" version="1.0" '
            'byte_order="LittleEndian" header_type="UInt64">\n'
            f'<ImageData WholeExtent="{box}" Origin="{" ".join(f"{v:.9g}" for v in origin)}" '
            f'Spacing="{" ".join(f"{v:.9g}" for v in spacing)}">\n<Piece Extent="{box}">\n'
            f"<PointData>\n{arrays}</PointData>\n</Piece>\n</ImageData>\n"
            '<AppendedData encoding="raw">\n_').encode())
        for block in blocks:
            file.write(block)
        file.write(b"\n</AppendedData>\n</VTKFile>\n")


def point_interpolation(
    model: PerformanceModel, points: FloatArray
) -> tuple[FloatArray, np.ndarray, np.ndarray]:
    """Weights (n, corners) and nodes of the straight element around each point, and whether any."""
    from scipy.spatial import cKDTree

    d = model.discretisation
    dim = model.space.dim
    corners = d.element_nodes[:, : dim + 1]
    places = d.nodes_mm[corners]
    tree = cKDTree(places.mean(axis=1))
    _, near = tree.query(points, k=min(24, len(corners)))
    near = near.reshape(len(points), -1)
    best = np.full(len(points), -np.inf)
    weights = np.zeros((len(points), dim + 1))
    chosen = np.zeros(len(points), dtype=np.int64)
    for column in near.T:
        of = places[column]
        edges = np.moveaxis(of[:, 1:] - of[:, :1], 1, 2)
        share = np.linalg.solve(edges, (points - of[:, 0])[..., None])[..., 0]
        share = np.concatenate([1.0 - share.sum(axis=1, keepdims=True), share], axis=1)
        better = share.min(axis=1) > best
        best[better] = share[better].min(axis=1)
        weights[better], chosen[better] = share[better], column[better]
    return weights, corners[chosen], best > -0.05


def _escaped(name: str) -> str:
    return name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
