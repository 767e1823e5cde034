"""Triangles from STL, PLY, OBJ, OFF and 3MF files.

trimesh parses all but binary STL, which is one array, and 3MF (`threemf`); nothing it would fetch,
merge or repair on its own is let happen. What a header promises is compared with the file's length
*before* parsing, so that a truncated file is called truncated and a hostile count allocates
nothing.
"""

from __future__ import annotations

import io
import struct
import warnings
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lmctl.config.quantities import FARTHEST_MM, MM_PER_UNIT
from lmctl.errors import InputError
from lmctl.part.sources.files import DataFile
from lmctl.part.sources.threemf import read_3mf

MESH_SUFFIXES = ("stl", "ply", "obj", "off", "3mf")

#: More triangles than this would take minutes and gigabytes to bring onto any grid.
MOST_TRIANGLES = 5_000_000

#: A part smaller or larger than this was most likely written in other units.
SMALLEST_PART_MM, LARGEST_PART_MM = 1.0, 2000.0


@dataclass(frozen=True)
class Mesh:
    """Triangles and their corners. vertices: (n, 3) float64 [mm]; triangles: (m, 3) int64."""

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]


def read_mesh(file: DataFile, units: str | None) -> Mesh:
    """The triangles of a mesh file, as they stand in it, in mm.

    units : None for a 3MF file, which states its own

    Raises InputError where it cannot be read, holds no triangles, coordinates that are not numbers,
    corners that are not there, or a size no part of this machine's kind has.
    """
    if file.suffix not in MESH_SUFFIXES:
        raise InputError(
            f"{file.path} is not a kind of mesh file that can be read",
            hint="STL, PLY, OBJ, OFF and 3MF files can; the ending must say which it is",
        )
    if file.suffix == "3mf":
        vertices, triangles = read_3mf(file, units)
        units = "mm"
    elif units is None:
        raise InputError(f"{file.path} does not state its units",
                         hint="say them in the part file: units = \"mm\"")
    else:
        vertices, triangles = _from_binary_stl(file) if _is_binary_stl(file) else _parsed(file)
    if len(triangles) == 0:
        raise InputError(
            f"{file.path} holds no triangles",
            hint='is it a point cloud? then write kind = "cloud"' if file.suffix == "ply" else
            "export the part as a mesh",
        )
    if len(triangles) > MOST_TRIANGLES:
        raise InputError(
            f"{file.path} has {len(triangles):,} triangles; at most {MOST_TRIANGLES:,} are read",
            hint="reduce the mesh: detail far below the bead width is lost anyway",
        )
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise InputError(
            f"{file.path} names a corner that is not there",
            where=f"corner {int(triangles.max()) + 1} of {len(vertices)}",
            hint="the file is damaged; export it again",
        )
    used = np.zeros(len(vertices), dtype=bool)
    used[triangles] = True
    vertices = checked_points(file, vertices, units, used=np.flatnonzero(used), what="corner")
    return Mesh(vertices, triangles)


def _from_binary_stl(file: DataFile) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Corners (3m, 3) and triangles (m, 3) of a binary STL whose length agrees with its head."""
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets = np.frombuffer(file.data, dtype=facet, offset=84)
    corners = facets["corners"].astype(np.float64).reshape(-1, 3)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _parsed(file: DataFile) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Corners and triangles of the forms that trimesh parses; polygons are cut into triangles."""
    promised = 0
    if file.suffix in ("ply", "off"):
        promised = check_ply(file).get("face", 0) if file.suffix == "ply" else _off_faces(file)
    loaded = parse(file, "load_mesh")
    vertices = np.asarray(getattr(loaded, "vertices", np.empty((0, 3))), dtype=np.float64)
    triangles = np.asarray(getattr(loaded, "faces", np.empty((0, 3))), dtype=np.int64)
    if 0 < len(triangles) < promised:
        raise InputError(
            f"{file.path} is damaged",
            where=f"its head promises {promised:,} faces, {len(triangles):,} can be read",
            hint="export or copy it again",
        )
    return vertices, triangles


def _off_faces(file: DataFile) -> int:
    """How many faces an OFF's head promises; 0 where it cannot be told."""
    lines = (line.partition(b"#")[0] for line in file.data[:10_000].splitlines())
    words = b" ".join(lines).split()
    counts = words[1:3] if words and not words[0].isdigit() else words[:2]
    told = len(counts) == 2 and counts[1].isdigit() and len(counts[1]) <= 18
    return int(counts[1]) if told else 0


def parse(file: DataFile, loader: Literal["load_mesh", "load"]) -> Any:
    """What one of trimesh's loaders makes of the bytes; InputError for whatever it raises."""
    import trimesh  # takes a second and a half, which a part without mesh need not spend

    data = file.data
    if file.suffix in ("obj", "off") or (file.suffix == "stl" and _is_text_stl(data)):
        if b"\0" in data:
            raise InputError(f"{file.path} is not text, as {file.suffix.upper()} files of its kind "
                             "are", hint="it is damaged or of another kind; export it again")
        data = data.decode("utf-8", errors="replace").encode()  # names in other encodings
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about numbers, which are checked afterwards
            # numpy stops at a word that is not a number, with this warning; the rest would be lost
            warnings.filterwarnings("error", message="string or file could not be read")
            return getattr(trimesh, loader)(
                io.BytesIO(data), file_type=file.suffix, process=False, skip_materials=True
            )
    except Exception as error:  # a parser of foreign bytes raises what it likes
        raise InputError(
            f"{file.path} is not a readable {file.suffix.upper()} file",
            where=" ".join(str(error).split())[:120] or type(error).__name__,
            hint="it is damaged or of another kind; export it again",
        ) from None


def checked_points(
    file: DataFile, points: NDArray[np.float64], units: str, *, used: NDArray[np.int64] | None,
    what: str,
) -> NDArray[np.float64]:
    """Points in mm, known to be finite and of the size of a part.

    used : indices that matter, None for all. what : what to call a point in messages.
    """
    seen = points if used is None else points[used]
    bad = np.flatnonzero(~np.isfinite(seen).all(axis=1))
    if len(bad):
        first = int(bad[0] if used is None else used[bad[0]])
        raise InputError(
            f"{file.path} has coordinates that are not numbers",
            where=f"{len(bad)} of {len(seen)} {what}s; the first is {what} {first + 1}: "
            f"{points[first].tolist()}",
            hint="export it again, or remove them",
        )
    scaled = points * MM_PER_UNIT[units]
    seen = scaled if used is None else scaled[used]
    low, high = seen.min(axis=0), seen.max(axis=0)
    size = float((high - low).max())
    if not SMALLEST_PART_MM <= size <= LARGEST_PART_MM:
        _refuse_size(file, size, units)
    if (high - low).min() <= 0:
        axis = "xyz"[int(np.argmin(high - low))]
        raise InputError(
            f"{file.path} is flat: all {what}s have the same {axis}", hint="a part needs a volume"
        )
    if max(abs(low).max(), abs(high).max()) > FARTHEST_MM:
        raise InputError(
            f"{file.path} lies too far from its origin",
            where=f"{max(abs(low).max(), abs(high).max()):.4g} mm; at most {FARTHEST_MM:g} mm",
            hint="move it to the origin in the program it came from",
        )
    if used is not None:  # unused corners may hold anything; nobody may stumble over them later
        scaled = np.where(np.isfinite(scaled), scaled, 0.0)
    return np.asarray(scaled, dtype=np.float64)


def _refuse_size(file: DataFile, size_mm: float, units: str) -> None:
    fitting = [
        unit
        for unit, factor in MM_PER_UNIT.items()
        if SMALLEST_PART_MM <= size_mm / MM_PER_UNIT[units] * factor <= LARGEST_PART_MM
    ]
    raise InputError(
        f"{file.path} is {size_mm:.4g} mm across when read in {units}",
        where=f"a part is between {SMALLEST_PART_MM:g} mm and {LARGEST_PART_MM / 1000:g} m",
        hint=f"is it in {' or '.join(fitting)}? say so with `units`, or --units where there is no "
        "part file" if fitting else
        "scale it in the program it came from",
    )


def _is_binary_stl(file: DataFile) -> bool:
    """Whether it is an STL in the binary form, of just the length its head promises.

    Raises InputError for an STL of either form that is not whole.
    """
    data = file.data
    if file.suffix != "stl":
        return False
    if _is_text_stl(data):
        if b"endsolid" not in data[-2000:].lower():
            raise InputError(
                f"{file.path} is truncated",
                where="a text STL ends with `endsolid`, this one does not",
                hint="export or copy it again",
            )
        return False
    if len(data) < 84:
        raise InputError(
            f"{file.path} is not an STL file",
            where=f"{len(data)} bytes; the shortest has 84",
            hint="it is damaged or of another kind; export it again",
        )
    (count,) = struct.unpack_from("<I", data, 80)
    if len(data) != 84 + 50 * count:
        raise InputError(
            f"{file.path} is not a whole STL file",
            where=f"its head promises {count:,} triangles, its {len(data):,} bytes are "
            f"{(len(data) - 84) / 50:,.8g}",
            hint="it is damaged or of another kind; export or copy it again",
        )
    return True


def _is_text_stl(data: bytes) -> bool:
    """Whether it is the text form; binary ones may begin with the word `solid` too."""
    return data[:5].lower() == b"solid" and b"facet" in data[:2000].lower()


def check_ply(file: DataFile) -> dict[str, int]:
    """How many of each element a PLY's head promises, e.g. {"vertex": 8, "face": 12}.

    Raises InputError where the head is not one, or promises more than the file can hold.
    """
    head, found, body = file.data.partition(b"end_header")
    if not head.startswith(b"ply") or not found or len(head) > 100_000:
        raise InputError(
            f"{file.path} is not a PLY file",
            where="it does not begin with `ply` … `end_header`",
            hint="it is damaged or of another kind; export it again",
        )
    counts: dict[str, int] = {}
    for line in head.decode("ascii", errors="replace").splitlines():
        words = line.split()
        if words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isdigit() or len(words[2]) > 18:
                raise InputError(
                    f"{file.path} is not a PLY file", where=line[:80],
                    hint="it is damaged or of another kind; export it again",
                )
            counts[words[1]] = int(words[2])
    rows = sum(counts.values())
    text = b"format ascii" in head
    held = body.strip().count(b"\n") + 1 if text else len(body)
    if held < rows:
        raise InputError(
            f"{file.path} is truncated",
            where=f"its head promises {rows:,} elements, it has {held:,} "
            + ("lines" if text else "bytes"),
            hint="export or copy it again",
        )
    return counts
