"""Choose how finely a part is resolved, and refuse what does not fit into memory."""

from __future__ import annotations

import math
import os

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.errors import InputError, UsageError
from lmctl.field.array_storage import is_stored_on_disk
from lmctl.field.grid import Grid
from lmctl.field.plane import PlaneGrid

#: Memory of a stored field while it is made: values, sources, squares, crossings, surface points.
BYTES_PER_NODE = 20

#: Of these the two arrays of four bytes that stay; large ones are kept in files
#: (`field.array_storage`).
ARRAYS_KEPT_PER_NODE = 2
BYTES_KEPT_PER_NODE = 4 * ARRAYS_KEPT_PER_NODE

#: Memory that parts may take, unless the user sets another limit: in megabytes, in this
#: environment variable. No file can set it, as a file may come from another user.
MEMORY_LIMIT_VARIABLE = "LMCTL_MEMORY_MB"
DEFAULT_MEMORY_LIMIT_MB = 2000

#: A boolean's boundary needs to be found, not resolved: eight bytes a node while it is.
MAX_BOUNDARY_NODES = 3_000_000

#: A grid that is only walked by slabs may be larger, but not endless.
MAX_WALKED_NODES = 4_000_000_000

#: Nodes of one section; its distance is made anew for every layer.
MAX_PLANE_NODES = 30_000_000

#: Nodes to spare around a body, each side.
PADDING_NODES = 3

#: A field's default pitch, and a section's largest, as shares of the bead width: the error of an
#: outline is far below its pitch, and both stay far below a bead.
FIELD_PITCHES_PER_BEAD = 4
PLANE_PITCHES_PER_BEAD = 8


def choose_pitch(low: FloatArray, high: FloatArray, bead_width_mm: float) -> float:
    """A quarter of the bead width, or the finest pitch of a field that memory alone can hold."""
    most = int(memory_limit_bytes() / BYTES_PER_NODE)
    return max(bead_width_mm / FIELD_PITCHES_PER_BEAD, finest_pitch_for_nodes(low, high, most))


def memory_limit_bytes() -> float:
    """What the user allows parts to take of the memory. Raises UsageError where it is no number."""
    said = os.environ.get(MEMORY_LIMIT_VARIABLE, str(DEFAULT_MEMORY_LIMIT_MB))
    try:
        megabytes = float(said)
    except ValueError:
        megabytes = math.nan
    if not 50 <= megabytes <= 1e7:
        raise UsageError(f"{MEMORY_LIMIT_VARIABLE} = {said!r} is no amount of memory",
                         hint=f"say megabytes, such as {DEFAULT_MEMORY_LIMIT_MB}")
    return megabytes * 1e6


def max_stored_nodes() -> int:
    """Nodes of the largest field that can be made within the limit."""
    limit = memory_limit_bytes()
    in_memory = int(limit / BYTES_PER_NODE)
    return int(limit / (
        BYTES_PER_NODE - BYTES_KEPT_PER_NODE)) if field_disk_bytes(in_memory) else in_memory


def field_disk_bytes(nodes: float) -> float:
    """What a stored field keeps on the disk: all that stays of it, or nothing."""
    return BYTES_KEPT_PER_NODE * nodes if is_stored_on_disk(
        BYTES_KEPT_PER_NODE / ARRAYS_KEPT_PER_NODE * nodes) else 0.0


def field_peak_memory_bytes(nodes: float) -> float:
    """The memory a stored field takes while it is made."""
    return BYTES_PER_NODE * nodes - field_disk_bytes(nodes)


def checked_grid(low: FloatArray, high: FloatArray, pitch_mm: float, *, stored: bool) -> Grid:
    """The grid around a box, known to be of a size that can be held (stored) or walked.

    Raises InputError with the nodes and memory it would need and the pitch that fits.
    """
    most = max_stored_nodes() if stored else MAX_WALKED_NODES
    nodes = _nodes(low, high, pitch_mm)
    if nodes > most:
        size = " × ".join(f"{v:.4g}" for v in high - low)
        raise InputError(
            f"a pitch of {pitch_mm:g} mm needs {nodes:.2g} grid nodes"
            + (f", {_taken(nodes)}" if stored else ""),
            where=f"the part is {size} mm; at most {most:.2g} nodes"
            + (f", {_taken(most)}" if stored else ""),
            hint=f"give a pitch_mm of at least {finest_pitch_for_nodes(low, high, most):g}"
            + (f", or allow more memory with {MEMORY_LIMIT_VARIABLE}" if stored else ""),
        )
    return Grid.enclosing(low, high, pitch_mm, PADDING_NODES)


def boundary_grid(low: FloatArray, high: FloatArray, pitch_mm: float) -> Grid:
    """The grid on which a boolean's boundary is looked for: of the pitch, or coarser where that
    would be more than can be held. What is found on it is exact at any pitch."""
    most = max(pitch_mm, finest_pitch_for_nodes(low, high, MAX_BOUNDARY_NODES))
    return Grid.enclosing(low, high, most, PADDING_NODES)


def finest_pitch_for_nodes(low: FloatArray, high: FloatArray, most_nodes: int) -> float:
    """The least pitch, to two digits, at which the padded box has at most so many nodes [mm]."""
    least, enough = 1e-9, float((high - low).max()) + 1.0
    for _ in range(100):
        middle = math.sqrt(least * enough)
        if _nodes(low, high, middle) > most_nodes:
            least = middle
        else:
            enough = middle
    digits = 1 - math.floor(math.log10(enough))
    scale = 10.0**digits
    return math.ceil(enough * scale) / scale


def section_plane_grid(grid: Grid, bead_mm: float) -> PlaneGrid:
    """The nodes of every section of a part on this grid: no coarser than an eighth of a bead.

    Nodes lie on multiples of the pitch. Raises InputError where that is more than can be held.
    """
    low = np.array(grid.origin_mm[:2])
    high = low + grid.pitch_mm * (np.array(grid.shape[:0:-1]) - 1)
    pitch = min(grid.pitch_mm, bead_mm / PLANE_PITCHES_PER_BEAD)
    if float(np.prod((high - low) / pitch)) > MAX_PLANE_NODES:
        pitch = bead_mm / PLANE_PITCHES_PER_BEAD  # a finer field pitch is not needed here
    nodes = float(np.prod((high - low) / pitch))
    if nodes > MAX_PLANE_NODES:
        size = " × ".join(f"{v:.4g}" for v in high - low)
        raise InputError(
            f"a bead of {bead_mm:g} mm is too fine for a part of {size} mm",
            where=f"a section needs {nodes:.2g} nodes; at most {MAX_PLANE_NODES:.2g}",
            hint="check the units of the part, or give a larger process.bead_width_mm",
        )
    first = np.floor(low / pitch).astype(int) - 1
    last = np.ceil(high / pitch).astype(int) + 1
    nx, ny = (int(n) for n in last - first + 1)
    return PlaneGrid((float(first[0] * pitch), float(first[1] * pitch)), pitch, (ny, nx))


def _nodes(low: FloatArray, high: FloatArray, pitch_mm: float) -> float:
    return float(np.prod((high - low) / pitch_mm + 2 * PADDING_NODES + 2))


def _taken(nodes: float) -> str:
    disk = f" and {format_bytes(field_disk_bytes(nodes))} of disk" if field_disk_bytes(
        nodes) else ""
    return f"{format_bytes(field_peak_memory_bytes(nodes))} of memory{disk}"


def format_bytes(count: float) -> str:
    for unit in ("bytes", "kB", "MB", "GB", "TB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} PB"
