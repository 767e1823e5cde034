"""One layer of a job as checked bytes, so that it can be made apart from the writer."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import JobError
from lmctl.job import container
from lmctl.job.layer_rules import first_broken_rule
from lmctl.job.schema import JobLayer, LayerEntry


@dataclass(frozen=True)
class PackedLayer:
    """entry : the layer's place in the manifest; members : bytes, as `container.LAYER_MEMBERS`
    first_flow_g_s, last_flow_g_s : (n_hoppers,) float64, powder flow at its start and its end
    """

    entry: LayerEntry
    members: tuple[bytes, ...]
    first_flow_g_s: FloatArray
    last_flow_g_s: FloatArray


def pack_layer(layer: JobLayer, first_path: int) -> PackedLayer:
    """A layer as bytes; first_path : number of its first path in the job. Raises as `pack` does."""
    return pack_layer_arrays(
        index=layer.index, z_mm=layer.z_mm, first_line=layer.first_line,
        first_path=first_path,
        program=("\n".join(layer.program) + "\n").encode("ascii"), lines=layer.lines,
        flow_s=layer.flow_s, flow_g_s=layer.flow_g_s)


def pack_layer_arrays(
    *, index: int, z_mm: float, first_line: int, first_path: int, program: bytes,
    lines: NDArray[np.void], flow_s: FloatArray, flow_g_s: FloatArray,
) -> PackedLayer:
    """A layer as bytes.

    program : one line of text a line of the table, a line end after each; others as in `JobLayer`
    Raises ValueError where a rule of the format is broken (a planner's mistake, not a user's),
    JobError where the layer is too large for a job file.
    """
    text = program.decode("ascii")
    layer = JobLayer(index, z_mm, first_line, tuple(text.removesuffix("\n").split("\n")), lines,
                     flow_s, flow_g_s)
    broken = first_broken_rule(layer, lines.dtype["fractions"].shape[0], flow_g_s.shape[-1])
    if broken:
        raise ValueError(f"layer {index}: {broken}")
    if flow_s[-1] != lines["end_s"][-1]:
        raise ValueError(f"layer {index}: flow and lines do not end together")
    paths = np.unique(lines["path"])
    paths = paths[paths >= 0]
    if len(paths) and (paths[0] != first_path or paths[-1] - paths[0] + 1 != len(paths)):
        raise ValueError(f"layer {index}: paths are not numbered on from {first_path}")
    members = (program, _npy(lines), _npy(flow_s), _npy(flow_g_s))
    if max(len(member) for member in members) > container.MAX_MEMBER_BYTES:
        raise JobError(f"layer {index} is too large for a job file",
                       where=f"{len(lines):,} lines",
                       hint="plan with a wider bead or a coarser pitch")
    entry = LayerEntry(
        index=index, z_mm=z_mm, first_line=first_line, n_lines=len(lines), first_path=first_path,
        n_paths=len(paths), start_s=float(flow_s[0]), end_s=float(flow_s[-1]),
        sha256=container.layer_digest(members))
    return PackedLayer(entry, members, flow_g_s[0].copy(), flow_g_s[-1].copy())


def _npy(array: NDArray[Any]) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, np.ascontiguousarray(array), (1, 0), allow_pickle=False)
    return buffer.getvalue()
