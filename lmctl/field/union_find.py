"""Union-find for kernels: the root of a piece is its lowest element."""

from __future__ import annotations

from typing import Any

from lmctl.field.kernel import inner_kernel


@inner_kernel
def unite(parent: Any, a: Any, b: Any) -> None:
    """Make one piece of those of a and b. parent : (n,) int, of each element one of its piece."""
    while parent[a] != a:
        parent[a] = parent[parent[a]]
        a = parent[a]
    while parent[b] != b:
        parent[b] = parent[parent[b]]
        b = parent[b]
    parent[max(a, b)] = min(a, b)
