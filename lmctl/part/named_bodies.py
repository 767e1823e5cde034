"""The bodies that a part is made of, by the names its file gives them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config import bodies as config
from lmctl.config.part_file import PartFile

if TYPE_CHECKING:
    from lmctl.part.bodies import Body
    from lmctl.part.tree import BodyTree


@dataclass(frozen=True)
class NamedBodies:
    """Named bodies where the part has them; what is cut away is none of them."""

    bodies: tuple[tuple[str, Body], ...] = ()

    def name_at(self, point_mm: FloatArray) -> str | None:
        """The name of the body that a place (3,) lies in, or is nearest to.

        None where fewer than two bodies have names, so that a name would say nothing.
        """
        if len(self.bodies) < 2:
            return None
        depth = [float(body.distance_at(np.reshape(point_mm, (1, 3)))[0])
                 for _, body in self.bodies]
        return self.bodies[int(np.argmax(depth))][0]


NO_NAMED_BODIES = NamedBodies()


def named_bodies(part: PartFile, tree: BodyTree) -> NamedBodies:
    """Of a body made of others those, as far as they have names; else its own name."""
    number = {body.name: n for n, body in enumerate(part.body) if body.name}

    def within(n: int) -> list[int]:
        body = part.body[n]
        inner: list[int] = []
        if isinstance(body, config.BooleanBody):
            of = body.of[:1] if body.kind == "difference" else body.of
            inner = [found for name in of for found in within(number[name])]
        return inner or ([n] if body.name else [])

    roots = part.root_body_indices()
    if part.combine == "difference":
        roots = roots[:1]
    found = dict.fromkeys(n for root in roots for n in within(root))
    if len(found) < 2:
        return NO_NAMED_BODIES
    return NamedBodies(tuple((part.body[n].name or "", tree.body_in_place(n)) for n in found))
