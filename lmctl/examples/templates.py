"""The examples as template files that the user can start from."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from lmctl.errors import UsageError
from lmctl.reference.schema_files import schema_file

#: Name of each template and what it is, in one line.
TEMPLATES: dict[str, str] = {
    "gear": "a spur gear from a scan, graded by distance from its axis",
    "box": "a block with a hard skin, graded by depth below its own surface",
    "two-bodies": "a shaft with a hard ring: two bodies, each of its own material",
    "three-powders": "a bar graded through three powders, with a cell of three hoppers",
    "sphere": "half a ball, graded by distance from its centre",
    "cutter": "a boring cutter, steel to carbide along its axis, built along x",
    "cutter-parabolic": "the same, by a parabola",
    "blade": "a turbine blade: hard shell, graded shell, metal core with three passages",
    "repair": "a worn bar filled up again, deposited on its scan",
    "shaft": "a hard strip along a shaft, layers parallel to it",
    "cutter-service": "a cutter that cools: the exponent of its gradient to be chosen",
    "gear-service": "a gear with heat from its teeth, levels of its material to be chosen",
    "blade-service": "a blade in hot gas: six numbers of its shells to be chosen",
    "pressed-cylinder": "a thick tube under pressure, levels of its material to be chosen",
    "fig3-sphere": "a sphere graded from a point",
    "fig3-cylinder": "a cylinder graded from a line",
    "fig3-box": "a box graded from an axis",
    "fig3-surface": "a wavy plate graded from a spline",
    "fig4-point": "a block graded from a point",
    "fig4-line": "the block graded from a line",
    "fig4-blend": "the block graded from both, 0.3 point and 0.7 line",
    "fig4-blend-reversed": "the block graded from both, 0.7 point and 0.3 line",
    "fig6-contained": "a union in which one body lies in the other",
    "fig7-hole": "a body less one that lies in it",
    "fig8-union": "the union of two bodies that overlap, materials passing into each other",
    "fig9-intersection": "what two bodies of different materials share",
}

#: The simulated cell, whose files accompany every template.
CELL_FILES = ("cell.toml", "bench.toml")
#: Cells of templates that need another one: the examples that are written as cell.toml, bench.toml.
_OWN_CELLS = {"three-powders": ("cell-three.toml", "bench-three.toml")}
#: Folder of the JSON schemas beside a template, which the first line of each file names.
SCHEMA_FOLDER_NAME = "schemas"


#: Kinds of a template's files, in their order.
_KINDS = ("part", "machine", "bench")


def write_template(name: str, folder: Path) -> list[Path]:
    """Write a template and copies of the simulated cell's files into an existing folder.

    Files of these names that are there already are replaced. The first line of each names its JSON
    schema, in a folder beside it, so that editors complete and check keys.
    returns : what was written but for the schemas, the part file first
    raises : UsageError where the folder cannot be written to
    """
    part = f"{name}.toml"
    written = [folder / file for file in (part, *CELL_FILES)]
    sources = (part, *_OWN_CELLS.get(name, CELL_FILES))
    try:
        (folder / SCHEMA_FOLDER_NAME).mkdir(exist_ok=True)
        for path, source, kind in zip(written, sources, _KINDS, strict=True):
            schema = f"{SCHEMA_FOLDER_NAME}/{kind}.json"
            (folder / schema).write_text(schema_file(kind).read_text("utf-8"), encoding="utf-8")
            path.write_text(f"#:schema {schema}\n{_text(source)}", encoding="utf-8")
        if name == "gear":
            from lmctl.examples.gear_cloud import write_gear_cloud  # with numpy, for the gear alone

            written.append(folder / "gear_cloud.xyz")
            write_gear_cloud(written[-1])
        elif name == "repair":
            from lmctl.examples.worn_bar import write_nominal_bar, write_worn_bar  # late, as above

            written += [folder / "nominal_bar.stl", folder / "worn_bar.csv"]
            write_nominal_bar(written[-2])
            write_worn_bar(written[-1])
    except OSError as error:
        raise UsageError.cannot_write(folder, error) from None
    return written


def write_gear_template(folder: Path) -> Path:
    """The main example, scan included, in an existing folder; returns its part file."""
    return write_template("gear", folder)[0]


def _text(name: str) -> str:
    return resources.files("lmctl.examples").joinpath(name).read_text(encoding="utf-8")
