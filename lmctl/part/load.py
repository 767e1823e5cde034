"""From a part file, or a bare mesh or cloud, to a part."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lmctl.config import part_file as config
from lmctl.config.composition import Feature
from lmctl.config.deposition_heat import DepositionHeatSettings
from lmctl.config.free_numbers import resolve_free_numbers
from lmctl.config.part_rules import load_part_file, parse_part_file
from lmctl.config.toml_file import parse_tables
from lmctl.errors import InputError
from lmctl.field.grid import Grid
from lmctl.part import bodies  # each body's module is loaded where it is used
from lmctl.part.copies import copies_of
from lmctl.part.materials.build_heat import resolve_build_heat
from lmctl.part.materials.powders import resolve_materials
from lmctl.part.materials.profile_warnings import flat_profile_warnings
from lmctl.part.named_bodies import named_bodies
from lmctl.part.part import Part
from lmctl.part.part_alloy_rules import part_alloy_rules
from lmctl.part.part_data import PartData
from lmctl.part.resolution import checked_grid, section_plane_grid
from lmctl.part.sources.files import CLOUD_SUFFIXES, MESH_SUFFIXES
from lmctl.part.tree import BodyTree
from lmctl.part.up_axis import turned_body_text

if TYPE_CHECKING:
    from lmctl.part.bodies import Body
    from lmctl.part.materials import CompositionField
    from lmctl.part.materials import Feature as MeasuredFeature
    from lmctl.part.substrate import SubstrateSurface

#: What a bare mesh or cloud is made of.
DEFAULT_MATERIAL = "316L"

Report = Callable[[str], None]


def load_part(path: Path, report: Report | None = None) -> Part:
    """The part a part file describes.

    report : receives the memory and time that the part will need, before loading begins

    Raises ConfigError (the file; all mistakes at once) and InputError (its data).
    """
    checked, text = load_part_file(path)
    return _build(checked, text, path.parent, report=report)


@dataclass(frozen=True, eq=False)
class MeasuredPart:
    """A part with its file and what may be measured from it.

    feature : a feature as part files state them, made measurable
    """

    part: Part
    file: config.PartFile
    feature: Callable[[Feature], MeasuredFeature]


def load_measured_part(path: Path, report: Report | None = None) -> MeasuredPart:
    """As `load_part`, with the means to measure from features that no composition names."""
    checked, text = load_part_file(path)
    tree = _read_tree(checked, path.parent)
    part = _part_of(checked, text, tree, report)
    return MeasuredPart(part, checked, tree.measured_feature)


class CompositionFamily:
    """The compositions of one part file for other values of its free numbers.

    text : of the part file; name : of it in messages; folder : where its data files are
    """

    def __init__(self, text: str, name: str, folder: Path) -> None:
        self._text, self._name = text, name
        self._tree = _read_tree(parse_part_file(text, name=name), folder)

    def composition(self, values: Mapping[str, float]) -> CompositionField:
        """The composition for values by name. Raises as `load_part`."""
        return self._with(values).composition_field

    def body(self, values: Mapping[str, float]) -> Body:
        """The solid for values by name: shells among its bodies may change it."""
        return self._with(values).body

    def _with(self, values: Mapping[str, float]) -> BodyTree:
        part = parse_part_file(self._text, name=self._name, values=values)
        return self._tree.with_other_numbers(part)


def part_from_text(text: str, folder: Path, name: str) -> Part:
    """The part that the text of a part file describes, as a job holds it.

    folder : where its data files are; name : of the text, in messages
    Raises ConfigError (the text; all mistakes at once) and InputError (its data).
    """
    return _build(parse_part_file(text, name=name), text, folder)


def part_from_model(
    path: Path, units: str | None = None, report: Report | None = None, up: str = "z",
) -> Part:
    """A mesh or cloud file alone as a part, with defaults that its warnings and notes name.

    units : "mm", "cm", "m" or "inch"; None takes mm, and reports that
    up : the axis of the model that points up, of `up_axis.UP_AXES`
    Raises InputError.
    """
    suffix = path.suffix.lower().removeprefix(".")
    if suffix not in {*MESH_SUFFIXES, *CLOUD_SUFFIXES}:
        raise InputError(
            f"{path} is neither a part file, a mesh nor a point cloud",
            hint="TOML, STL, PLY, OBJ, OFF, 3MF, XYZ, CSV, PTS and ASC files can be read; the "
            "ending must say which",
        )
    kind = "mesh" if suffix in MESH_SUFFIXES else "cloud"
    if suffix == "ply" and not _has_faces(path):
        kind = "cloud"
    said = [f"no material is stated: all of it is {DEFAULT_MATERIAL}"]
    if units is None and suffix != "3mf":
        said.insert(0, f"{path.name} states no units: taken as mm")
    name = path.stem[:100] or "part"
    text = (
        f"name = {_quoted(name)}\n\n[[material]]\nname = {_quoted(DEFAULT_MATERIAL)}\n\n"
        "[[body]]\n" + ("" if up == "z" else 'name = "model"\n')
        + f"kind = {_quoted(kind)}\nfile = {_quoted(path.name)}\n"
        + (f"units = {_quoted(units or 'mm')}\n" if units or suffix != "3mf" else "")
        + turned_body_text("model", up)
    )
    return _build(parse_part_file(text, name=str(path)), text, path.parent, said, report)


def _build(
    part: config.PartFile, text: str, folder: Path, said: Sequence[str] = (),
    report: Report | None = None,
) -> Part:
    return _part_of(part, text, _read_tree(part, folder, said), report)


def _read_tree(part: config.PartFile, folder: Path, said: Sequence[str] = ()) -> BodyTree:
    data = PartData(folder, part.process.bead_width_mm)
    data.warnings += said
    data.read(part)
    return BodyTree(part, data)


def _part_of(part: config.PartFile, text: str, tree: BodyTree, report: Report | None) -> Part:
    materials, data = resolve_materials(part), tree.data
    for number in part.reference_body_indices():
        of = part.body[number]
        findings = data.notes if of.composition is None else data.warnings
        findings.append(f"{of.name!r} is only measured from: it is no part of the solid")
    cost = tree.cost()
    cost.refuse_if_too_large()
    if report is not None and cost.summary():
        report(cost.summary())
    body = tree.body
    match body:
        case bodies.MeshSolid() | bodies.FieldSolid():
            grid = body.grid
        case _:
            grid = checked_grid(*body.tight_bounds_mm, tree.pitch_mm, stored=False)
    rule = tree.composition_field
    data.warnings += [*_coarse(body, grid), *flat_profile_warnings(rule, body)]
    data.notes += [note for material in materials if (note := material.note())]
    if free := resolve_free_numbers(parse_tables(text, name=part.name)).free:
        data.notes.append(f"{len(free)} free numbers have their starting values; `lmctl optimise` "
                          "chooses them")
    surface = _substrate_surface(part, tree)
    rules = part_alloy_rules(part, data)
    # power and speed are the materials' own or the library's, and named there
    unwritten = set(config.ProcessSettings.model_fields) - part.process.model_fields_set
    if keys := sorted(unwritten - _not_noted(part.process)):
        values = ", ".join(f"{key} {getattr(part.process, key)}" for key in keys)
        data.notes.append(f"process: by default {values}")
    return Part(
        name=part.name,
        text=text,
        sources=data.sources,
        materials=materials,
        process=part.process,
        placement_mm=None if part.placement is None else part.placement.origin_mm,
        warnings=tuple(data.warnings),
        notes=tuple(data.notes),
        body=body,
        composition_field=rule,
        grid=grid,
        plane=section_plane_grid(grid, part.process.bead_width_mm),
        surface_error_mm=tree.surface_error_mm,
        named_bodies=named_bodies(part, tree),
        build_heat=resolve_build_heat(part),
        strategy_bodies={region.body: tree.named_body(region.body)
                         for region in part.process.region if region.body is not None},
        substrate=part.substrate,
        substrate_surface=surface,
        copies=copies_of(part.copies) if part.copies else (),
        alloy_rules=rules,
    )


def _substrate_surface(part: config.PartFile, tree: BodyTree) -> SubstrateSurface | None:
    """The surface under the part; None for a level plate under its lowest point."""
    settings = part.substrate
    if not settings.has_shape:
        return None
    from lmctl.part.substrate import substrate_surface_of  # late: few parts have one

    nominal = None if settings.of is None else tree.named_body(settings.of)
    return substrate_surface_of(settings, tree.body, nominal, tree.data, part.process.bead_width_mm)


def _not_noted(process: config.ProcessSettings) -> set[str]:
    """Keys whose defaults nobody need be told: named elsewhere, or of another strategy."""
    keys = {"power_W", "speed_mm_s", "region", "dilution", "height_check_every",
            "height_tolerance_mm", "copy_order"}
    if process.strategy != "hatch" and not any(r.strategy == "hatch" for r in process.region):
        keys |= {"hatch", "hatch_angle_deg", "hatch_turn_deg", "hatch_blocks", "outline_tracks"}
    if process.strategy != "auto":
        keys.add("dead_time_error_s")
    if process.interpass_max_C is None:
        keys |= set(DepositionHeatSettings.model_fields)
    return keys | ({"hatch_block_mm"} if process.hatch_blocks == "none" else set())


def _coarse(body: Body, grid: Grid) -> list[str]:
    """A warning where the part is thin for its pitch and its outlines come from its field."""
    low, high = body.tight_bounds_mm
    thinnest, pitch = float((high - low).min()), grid.pitch_mm
    if thinnest >= 3 * pitch or not isinstance(body, bodies.FieldSolid):
        return []
    return [
        f"the part is only {thinnest:.3g} mm thick, a pitch of {pitch:g} mm is coarse for it; "
        f"pitch_mm = {thinnest / 5:.2g} would resolve it"
    ]


def _has_faces(path: Path) -> bool:
    """Whether a PLY's head declares faces; the reader reports any other error in it."""
    try:
        with path.open("rb") as file:
            head = file.read(100_000).partition(b"end_header")[0]
    except OSError:
        return True
    return any(
        line.split()[:2] == [b"element", b"face"] and line.split()[2:] != [b"0"]
        for line in head.splitlines()
    )


def _quoted(text: str) -> str:
    """A TOML string. Raises InputError where a file's name cannot be written in one."""
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        raise InputError("the file's name is not valid text", where=repr(text),
                         hint="rename it") from None
    escaped = "".join(
        f"\\u{ord(c):04x}" if ord(c) < 0x20 or ord(c) == 0x7F or c in '"\\' else c for c in text
    )
    return f'"{escaped}"'
