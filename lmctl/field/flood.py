"""Spread tags over a grid along the widest ways: a priority flood.

The watershed of F. Meyer (1991) on the grid's six-connections: what is reached by a wide way is
tagged before what is reached by a narrow one, so a tag passes through a gap only where no other
tag comes by a wider way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.field.kernel import kernel

LEVELS = 64

NONE = np.empty(0, dtype=np.int64)


def flood(
    level: NDArray[np.uint8],
    tags: NDArray[np.int8],
    late: NDArray[np.int64] = NONE,
    late_tags: NDArray[np.int8] = np.empty(0, dtype=np.int8),  # noqa: B008 (never written)
) -> None:
    """Tag every node, in place.

    level : (nz, ny, nx) uint8 below 64, how wide it is at each node; on return how wide the
        narrowest place is on the widest way there from a tagged node
    tags : (nz, ny, nx) int8, 0 where a tag is wanted
    late : (m,) int64, flat indices of nodes, widest first, that take their own tag, `late_tags`
        (m,) int8, unless a wider way has brought another by the time their width is come to
    """
    following = np.full(level.size, -2, dtype=np.int32)
    head = np.full(LEVELS, -1, dtype=np.int32)
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
    for n in range(tags.size):
        if tags[n] != 0:
            following[n] = head[level[n]]
            head[level[n]] = n
    at, turn = LEVELS - 1, 0
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
