"""Heights at which something of a body begins or ends along z: tops, bottoms, saddles left out.

Between two of them a piece may lie that no section elsewhere meets.
"""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.part.bodies.allowance import AllowanceBody
from lmctl.part.bodies.body import Body
from lmctl.part.bodies.mesh_solid import MeshSolid


def turning_heights_mm(body: Body) -> FloatArray:
    """Rising heights, (h,) float64 [mm], each once.

    Of a mesh those of corners without a higher or without a lower neighbour; of bodies combined
    those of each; of others their lowest and highest point.
    """
    if isinstance(body, AllowanceBody):
        return turning_heights_mm(body.inner)
    if isinstance(body, MeshSolid):
        return _of_mesh(body.mesh.vertices[:, 2], body.mesh.triangles)
    from lmctl.part.booleans.combined import CombinedBody  # late: few parts are combined

    if isinstance(body, CombinedBody):
        each = np.concatenate([turning_heights_mm(inner) for inner in body.bodies])
        heights: FloatArray = np.unique(each)
        return heights
    low, high = body.tight_bounds_mm
    ends = np.array([low[2], high[2]])
    finite: FloatArray = ends[np.isfinite(ends)]
    return finite


def _of_mesh(z_mm: FloatArray, triangles: IntArray) -> FloatArray:
    has_lower = np.zeros(len(z_mm), dtype=np.bool_)
    has_higher = np.zeros(len(z_mm), dtype=np.bool_)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        first, second = triangles[:, a], triangles[:, b]
        rises = z_mm[second] > z_mm[first]
        falls = z_mm[second] < z_mm[first]
        has_higher[first[rises]] = has_lower[second[rises]] = True
        has_lower[first[falls]] = has_higher[second[falls]] = True
    used = np.unique(triangles)
    turning: FloatArray = np.unique(z_mm[used[~(has_lower[used] & has_higher[used])]])
    return turning
