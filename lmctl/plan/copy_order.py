"""In which order the layers of several copies are deposited."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from lmctl.plan.geometry import LayerGeometry
from lmctl.plan.geometry.copied_layer import layer_of_copies

if TYPE_CHECKING:
    from lmctl.part.part import Part
    from lmctl.preflight.placement import Placement


def times_deposited(part: Part) -> int:
    """How often each layer of the part is a layer of the job."""
    return len(part.copies) if _is_part_by_part(part) else 1


def layers_in_order(
    layers: Iterable[tuple[LayerGeometry, bool]], part: Part
) -> Iterator[tuple[LayerGeometry, bool, bool]]:
    """Layers of the job from those of one part: the layer, whether it is the job's last, and
    whether a copy is begun after another is finished.

    layers : of the part, each with whether it is its last. Part by part all of them are kept
    """
    if not _is_part_by_part(part):
        for geometry, is_last in layers:
            copied = layer_of_copies(geometry, part.copies) if part.copies else geometry
            yield copied, is_last, False
        return
    kept = list(layers)
    for number, copy in enumerate(part.copies):
        for place, (geometry, is_last) in enumerate(kept):
            yield (layer_of_copies(geometry, (copy,)), is_last and copy is part.copies[-1],
                   number > 0 and place == 0)


def copies_totals(part: Part, placement: Placement) -> dict[str, Any]:
    """What the totals of a job hold of copies; nothing of a part alone.

    x_mm, y_mm : of the part's own origin, in program coordinates
    """
    if not part.copies:
        return {}
    x, y = placement.offset_mm[:2].tolist()
    return {"copy_order": part.process.copy_order, "copies": [
        {"name": copy.name, "x_mm": round(copy.position_mm[0] + x, 4),
         "y_mm": round(copy.position_mm[1] + y, 4), "turn_deg": copy.turn_deg}
        for copy in part.copies]}


def _is_part_by_part(part: Part) -> bool:
    return len(part.copies) > 1 and part.process.copy_order == "part-by-part"
