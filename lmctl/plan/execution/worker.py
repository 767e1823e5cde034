"""Entry points of the pure stages in a worker. A process keeps each part it works on."""

from __future__ import annotations

import hashlib
import pickle
from typing import TYPE_CHECKING

from lmctl.errors import PlanError
from lmctl.plan.geometry import LayerGeometry, layer_geometry
from lmctl.plan.program_text import LayerLines, packed_layer
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.job.packed_layer import PackedLayer
    from lmctl.part.part import Part

#: By `part_key`.
_parts: dict[str, Part] = {}


def part_key(part: Part) -> str:
    """Key of a part: a digest of its file's text and of its data files."""
    said = [part.text, *(f"{name} {digest}" for name, digest in sorted(dict(part.sources).items()))]
    return hashlib.sha256("\n".join(said).encode()).hexdigest()


def keep_part(key: str, part: Part) -> None:
    """Make a part known to this process; `geometry_stage` finds it by its key."""
    _parts[key] = part


def receive_part(key: str, data: bytes, digest: str) -> None:
    """Make a part known to this process from its pickle.

    digest : SHA-256 of `data`, hexadecimal. Raises PlanError where it is another
    """
    if hashlib.sha256(data).hexdigest() != digest:
        raise PlanError("the part did not reach a planning worker as it was sent",
                        where=f"{len(data):,} bytes", hint="plan again")
    keep_part(key, pickle.loads(data))


def drop_part(key: str) -> None:
    """Forget a part; nothing where it is not known."""
    _parts.pop(key, None)


def geometry_stage(key: str, placement: Placement, layer: int) -> LayerGeometry:
    """Geometry of one layer. Raises PlanError where this process has another part or none."""
    part = _parts.get(key)
    if part is None:
        raise PlanError("a planning worker has no copy of the part", where=f"part {key[:12]}",
                        hint="start the workers again, and plan again")
    return layer_geometry(part, placement, layer)


def text_stage(layer: LayerLines) -> PackedLayer:
    """The bytes of one layer."""
    return packed_layer(layer)
