"""Spread tags over a grid along the widest ways: a priority flood.

The watershed of F. Meyer (1991) on the grid's six-connections: what is reached by a wide way is
tagged before what is reached by a narrow one, so a tag passes through a gap only where no other
tag comes by a wider way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.field.kernel import inner_kernel, kernel

LEVEL_COUNT = 64

NO_LATE_NODES = np.empty(0, dtype=np.int64)


def flood_tags(
    level: NDArray[np.uint8],
    tags: NDArray[np.int8],
    late: NDArray[np.int64] = NO_LATE_NODES,
    late_tags: NDArray[np.int8] = np.empty(0, dtype=np.int8),  # noqa: B008 (never written)
) -> None:
    """Tag every node, in place.

    level : (nz, ny, nx) uint8 below 64, how wide it is at each node; on return how wide the
        narrowest place is on the widest way there from a tagged node
    tags : (nz, ny, nx) int8, 0 where a tag is wanted
    late : (m,) int64, flat indices of nodes, widest first, that take their own tag, `late_tags`
        (m,) int8, unless a wider way has brought another before the flood reaches their width
    """
    following = np.full(level.size, -2, dtype=np.int32)
    head = np.full(LEVEL_COUNT, -1, dtype=np.int32)
    _flood_kernel(
        level.reshape(-1), tags.reshape(-1), late, late_tags, following, head, *level.shape
    )


@kernel
def _flood_kernel(
    level: NDArray[np.uint8], tags: NDArray[np.int8], late: NDArray[np.int64],
    late_tags: NDArray[np.int8], following: NDArray[np.int32], head: NDArray[np.int32],
    nz: int, ny: int, nx: int,
) -> None:
    """The nodes of a level wait in a linked list; −2 is a node not met yet, −1 the list's end."""
    plane = ny * nx
    _spread_widest(level, tags, nz, ny, nx)
    for n in range(tags.size):
        if tags[n] != 0:
            following[n] = -1
    n = -1
    for k in range(nz):
        for j in range(ny):
            for i in range(nx):
                n += 1
                # Only at the rim of what has a tag is there anything to do.
                if tags[n] != 0 and (
                    (i > 0 and tags[n - 1] == 0) or (i < nx - 1 and tags[n + 1] == 0)
                    or (j > 0 and tags[n - nx] == 0) or (j < ny - 1 and tags[n + nx] == 0)
                    or (k > 0 and tags[n - plane] == 0) or (k < nz - 1 and tags[n + plane] == 0)
                ):
                    following[n] = head[level[n]]
                    head[level[n]] = n
    at, turn = LEVEL_COUNT - 1, 0
    while at >= 0:
        while turn < late.size and level[late[turn]] >= at:
            n = late[turn]
            if following[n] == -2:
                tags[n] = late_tags[turn]
                following[n] = head[level[n]]
                head[level[n]] = n
            turn += 1
        n = head[at]
        if n < 0:
            at -= 1
            continue
        head[at] = following[n]
        i, j, k = n % nx, n // nx % ny, n // plane
        for side in range(6):
            if side == 0:
                inside, m = i > 0, n - 1
            elif side == 1:
                inside, m = i < nx - 1, n + 1
            elif side == 2:
                inside, m = j > 0, n - nx
            elif side == 3:
                inside, m = j < ny - 1, n + nx
            elif side == 4:
                inside, m = k > 0, n - plane
            else:
                inside, m = k < nz - 1, n + plane
            if inside and following[m] == -2:
                level[m] = min(level[m], np.uint8(at))
                tags[m] = tags[n]
                following[m] = head[level[m]]
                head[level[m]] = m


@inner_kernel
def _spread_widest(
    level: NDArray[np.uint8], tags: NDArray[np.int8], nz: int, ny: int, nx: int
) -> None:
    """Most nodes are of the widest level and next to such with a tag: one pass each way, in order,
    reaches nearly all of them. No list is as quick.
    """
    plane, widest = ny * nx, np.uint8(LEVEL_COUNT - 1)
    wanted = False
    for n in range(tags.size):
        wanted = wanted or (tags[n] == 0 and level[n] == widest)
    for direction in range(2 if wanted else 0):
        step = 1 - 2 * direction
        n = -1 if step > 0 else tags.size
        for k in range(nz):
            for j in range(ny):
                for i in range(nx):
                    # On the backward pass i, j, k count from the end.
                    n += step
                    if tags[n] != 0 or level[n] != widest:
                        continue
                    if i > 0 and level[n - step] == widest:
                        tags[n] = tags[n - step]
                    if tags[n] == 0 and j > 0 and level[n - step * nx] == widest:
                        tags[n] = tags[n - step * nx]
                    if tags[n] == 0 and k > 0 and level[n - step * plane] == widest:
                        tags[n] = tags[n - step * plane]
