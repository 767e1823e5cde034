"""A part whose numbers are being edited: data is read once, the solid kept while it can be."""

from __future__ import annotations

from pathlib import Path

from lmctl.array_types import FloatArray
from lmctl.config.part_file import PartFile
from lmctl.config.part_rules import parse_part_file
from lmctl.part.bodies.body import Body
from lmctl.part.materials.composition import CompositionField
from lmctl.part.part_data import PartData
from lmctl.part.tree import BodyTree


class EditedPart:
    """Solid and composition of a part file's text as it stands.

    text : of the part file; name : of it in messages; folder : where its data files are
    Raises ConfigError (the text; all mistakes at once) and InputError (its data).
    """

    def __init__(self, text: str, name: str, folder: Path) -> None:
        self._name = name
        self._file = parse_part_file(text, name=name)
        data = PartData(folder, self._file.process.bead_width_mm)
        data.read(self._file)
        self._tree = BodyTree(self._file, data)
        self._field: CompositionField = self._tree.composition_field

    def take(self, text: str) -> None:
        """Another text, which may differ in numbers. Raises as above, and then nothing changes."""
        file = parse_part_file(text, name=self._name)
        tree = self._tree.with_other_numbers(file)
        self._field = tree.composition_field
        self._file, self._tree = file, tree

    @property
    def file(self) -> PartFile:
        """The part file, checked."""
        return self._file

    @property
    def body(self) -> Body:
        """The solid: the same object until a number of a body changes."""
        return self._tree.body

    @property
    def box_mm(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest x, y, z of a box around the solid, each (3,) float64 [mm]."""
        low, high = self._tree.box
        return low, high

    def composition(self, points_mm: FloatArray) -> FloatArray:
        """(n, 3) [mm] -> (n, n_materials) volume fractions, in the order of its materials."""
        return self._field.fractions(points_mm)
