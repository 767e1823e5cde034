"""One part file open in the designer: what the page asks for, as plain data for JSON."""

from __future__ import annotations

import base64
import tomllib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from lmctl.config.machine import MachineProfile
from lmctl.designer.adjustable_numbers import adjustable_numbers
from lmctl.designer.layer_verdict import layer_verdict
from lmctl.designer.part_document import KeyPath, PartDocument
from lmctl.designer.part_preview import PartPreview, SectionView
from lmctl.part.edited_part import EditedPart
from lmctl.report.composition_colours import material_colours


class DesignSession:
    """A part file, its edits and its pictures; not for several threads at a time.

    profile : the machine that a layer's verdict is for
    Raises ConfigError, MissingFileError, InputError where the part cannot be loaded.
    """

    def __init__(self, path: Path, profile: MachineProfile) -> None:
        self._document = PartDocument(path)
        self._profile = profile
        self._part = EditedPart(self._document.text, str(path), path.parent)
        self._preview = PartPreview(self._part)

    def state(self) -> dict[str, Any]:
        """Numbers, materials and text as they stand."""
        document, part = self._document, self._part
        names = [material.name for material in part.file.material]
        low, high = part.box_mm
        numbers = adjustable_numbers(tomllib.loads(document.text), names, part.box_mm)
        return {
            "name": part.file.name, "file": str(document.path), "text": document.text,
            "saved": document.is_saved, "can_undo": document.can_undo,
            "can_redo": document.can_redo, "machine": self._profile.name,
            "low_mm": low.tolist(), "high_mm": high.tolist(),
            "materials": [{"name": name, "colour": [round(255 * one) for one in colour]}
                          for name, colour in zip(names, material_colours(len(names)).tolist(),
                                                  strict=True)],
            "numbers": [asdict(number) for number in numbers],
        }

    def section(self, view: SectionView) -> dict[str, Any]:
        """A plane of the part, as a picture."""
        picture = self._preview.section(view)
        return {"png": _base64(picture.png), "low_mm": picture.low_mm, "high_mm": picture.high_mm,
                "axes": picture.axes, "axis": view.axis, "at_mm": view.at_mm}

    def surface(self) -> dict[str, Any]:
        """Triangles of the surface, with its colours."""
        mesh = self._preview.surface()
        return {"vertices_mm": _base64(mesh.vertices_mm.tobytes()),
                "triangles": _base64(mesh.triangles.tobytes()), **self.colours()}

    def colours(self) -> dict[str, Any]:
        """Colours of the surface's vertices."""
        return {"colours": _base64(self._preview.surface_colours().tobytes())}

    def adjust(self, path: KeyPath, value: float, *, continuing: bool) -> bool:
        """Set a number; returns whether the solid is another one now.

        Raises ConfigError, InputError, UsageError where the part would be none; nothing changes.
        """
        return self._edited(
            lambda: self._document.set_number(path, value, continuing=continuing))

    def undo(self) -> bool:
        """As `adjust`."""
        return self._edited(self._document.undo)

    def redo(self) -> bool:
        """As `adjust`."""
        return self._edited(self._document.redo)

    def save(self) -> None:
        """Write the part file. Raises UsageError."""
        self._document.save()

    def verdict(self, layer: int | None) -> dict[str, Any]:
        """What the plan says of one layer. Raises as `layer_verdict`."""
        path = self._document.path
        found = layer_verdict(self._document.text, path.parent, str(path), self._profile, layer)
        return {**asdict(found), "picture": _base64(found.picture)}

    def _edited(self, edit: Callable[[], None]) -> bool:
        before, body = self._document.text, self._part.body
        edit()
        try:
            self._part.take(self._document.text)
        except Exception:
            self._document.restore(before)
            raise
        return self._part.body is not body


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
