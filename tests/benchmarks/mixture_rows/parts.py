"""Part files of the mixture benchmark: shipped examples, and shapes of known gradients."""

from __future__ import annotations

from pathlib import Path

from lmctl.examples.templates import write_template

_TWO = """
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
"""
_PROCESS = """
[process]
strategy = "auto"
bead_width_mm = 2.0
layer_height_mm = 0.8
overlap = 0.333
speed_mm_s = 10
"""

PLATE = f"""
name = "plate with a sharp material step"
{_TWO}
[[body]]
name = "left"
kind = "box"
low_mm = [0, 0, 0]
high_mm = [20, 20, 4]
composition.profile = {{ kind = "constant", of = {{ "316L" = 0.9, "WC-12Co" = 0.1 }} }}
[[body]]
name = "right"
kind = "box"
low_mm = [20, 0, 0]
high_mm = [40, 20, 4]
composition.profile = {{ kind = "constant", of = {{ "316L" = 0.3, "WC-12Co" = 0.7 }} }}
[[body]]
kind = "union"
of = ["left", "right"]
{_PROCESS}
"""

#: Graded by 0.0175 per mm along its tracks: 0.04 s of dead time are 0.007.
BOX = f"""
name = "box graded along its tracks"
{_TWO}
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [40, 20, 4]
[composition]
feature = {{ kind = "coordinate", along = "x" }}
[composition.profile]
kind = "linear"
near = {{ "316L" = 0.9, "WC-12Co" = 0.1 }}
far = {{ "316L" = 0.2, "WC-12Co" = 0.8 }}
over_mm = [0, 40]
{_PROCESS}
"""

#: The shipped gear, graded the more steeply the farther out.
STEEP = [(8, 0.1), (24, 0.3), (30, 0.8)]


def write_part(name: str, folder: Path) -> Path:
    """The part file of a row of the benchmark, with strategy "auto"."""
    file = folder / f"{name}.toml"
    if name in ("plate_step", "box"):
        file.write_text(PLATE if name == "plate_step" else BOX)
        return file
    template = {"fig8_union": "fig8-union", "gear_steep": "gear"}.get(name, name)
    text = write_template(template, folder)[0].read_text()
    if name == "gear_steep":
        text = _with_profile(text)
    text = "\n".join(line for line in text.splitlines() if not line.startswith("strategy"))
    file.write_text(text.replace("[process]", '[process]\nstrategy = "auto"'))
    return file


def _with_profile(text: str) -> str:
    head, _, rest = text.partition("points = [")
    points = ",\n".join(
        f'{{ at_mm = {at}, of = {{ "316L" = {1 - hard:.1f}, "WC-12Co" = {hard} }} }}'
        for at, hard in STEEP)
    return f"{head}points = [\n{points}\n{rest[rest.index(']'):]}"
