"""The slicers that planning is measured against, as Debian 12 has them.

    apt-get install prusa-slicer cura-engine
    apt-get download cura && dpkg -x cura_*.deb SOMEWHERE   # CuraEngine's definitions
    export CURA_DEFINITIONS=SOMEWHERE/usr/share/cura/resources/definitions

100 % concentric, one perimeter, no skirt, brim or supports. PrusaSlicer's extrusion width w gives
a spacing of w − h(1 − π/4) at layer height h (its manual, "Flow Math").
"""

from __future__ import annotations

import os
from math import pi
from pathlib import Path

DEFINITIONS = Path(os.environ.get("CURA_DEFINITIONS", "/usr/share/cura/resources/definitions"))


def prusa(stl: Path, gcode: Path, spacing_mm: float, layer_mm: float,
          generator: str = "classic") -> list[str]:
    """PrusaSlicer's command. generator : "classic" or "arachne"."""
    width = spacing_mm + layer_mm * (1 - pi / 4)
    return [
        "prusa-slicer", "--export-gcode", str(stl), "--output", str(gcode),
        "--fill-density", "100%", "--fill-pattern", "concentric",
        "--top-fill-pattern", "concentric", "--bottom-fill-pattern", "concentric",
        "--perimeter-generator", generator, "--perimeters", "1",
        "--layer-height", f"{layer_mm:g}", "--first-layer-height", f"{layer_mm:g}",
        "--nozzle-diameter", f"{max(spacing_mm, layer_mm / 0.75):g}",
        "--extrusion-width", f"{width:.4f}", "--first-layer-extrusion-width",
        f"{spacing_mm:g}",  # wider, the organic mesh's tip would have no first layer
        "--skirts", "0", "--brim-width", "0", "--support-material=0",
        "--bed-shape", "0x0,300x0,300x300,0x300", "--center", "150,150",
    ]


def cura(stl: Path, gcode: Path, spacing_mm: float, layer_mm: float) -> list[str]:
    """CuraEngine's command; its settings are given to the scene and to its extruder."""
    values = dict.fromkeys(
        ("line_width", "wall_line_width", "wall_line_width_0", "wall_line_width_x",
         "skin_line_width", "infill_line_width", "infill_line_distance", "machine_nozzle_size"),
        f"{spacing_mm:g}")
    values |= dict.fromkeys(("layer_height", "layer_height_0", "infill_sparse_thickness"),
                            f"{layer_mm:g}")
    values |= dict.fromkeys(("machine_width", "machine_depth", "machine_height"), "300")
    values |= {
        "wall_line_count": "1", "infill_sparse_density": "100", "infill_pattern": "concentric",
        "top_layers": "0", "bottom_layers": "0", "adhesion_type": "none",
        "support_enable": "false", "center_object": "true",
        "initial_layer_line_width_factor": "100",
    }
    settings = [word for key, value in values.items() for word in ("-s", f"{key}={value}")]
    return ["CuraEngine", "slice", "-j", str(DEFINITIONS / "fdmprinter.def.json"),
            *settings, "-e0", *settings, "-l", str(stl), "-o", str(gcode)]


def cura_environment() -> dict[str, str]:
    return {"CURA_ENGINE_SEARCH_PATH": str(DEFINITIONS)}


def starts(gcode: Path) -> int:
    """How often a slicer's program begins to extrude after a travel."""
    count, extrudes, total = 0, False, 0.0
    for line in gcode.read_text().splitlines():
        words = line.partition(";")[0].split()
        if not words or words[0] not in ("G0", "G1", "G92"):
            continue
        said = {word[0]: word[1:] for word in words[1:]}
        before, total = total, float(said.get("E", total))
        if words[0] == "G92" or not {"X", "Y"} & said.keys():
            continue
        now = total > before
        count += now and not extrudes
        extrudes = now
    return count
