"""What the first layer is deposited on: `[substrate]` of a part file, its shape and its alloy.

Without the table a part is deposited on a flat plate of unknown alloy. All places are in the part
file's own coordinates.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from lmctl.config.quantities import Direction, FileName, Length, Name, Units, Vector
from lmctl.config.toml_file import ConfigModel

SubstrateKind = Literal["plate", "plane", "cylinder", "mesh", "scan"]
LayerShape = Literal["auto", "level", "shifted", "parallel", "blended"]

#: The keys that a kind needs, and those it may have beside what all kinds share.
_NEEDED: dict[str, tuple[str, ...]] = {
    "plate": (), "plane": ("point_mm",), "cylinder": ("point_mm", "radius_mm"),
    "mesh": ("file",), "scan": ("file", "units"),
}
_ALLOWED: dict[str, tuple[str, ...]] = {
    "plate": (), "plane": ("normal",), "cylinder": ("axis",),
    "mesh": ("units", "of", "registration_mm"), "scan": ("of", "registration_mm"),
}
_OF_A_KIND = {name for keys in (*_NEEDED.values(), *_ALLOWED.values()) for name in keys}


class SubstrateSettings(ConfigModel):
    """The surface under the first layer.

    kind : "plate" is flat and level under the part's lowest point; "plane" may be tilted;
        "cylinder" is the upper side of a round bar; "mesh" and "scan" are the upper side of a
        surface of triangles or of measured points from a file
    material : its alloy; of the part's powders or of the material library where it is used
    point_mm : a point of the plane, or of the cylinder's axis; normal : of the plane, upwards
    axis : direction of the cylinder's axis, level; radius_mm : of the bar
    file, units : of the mesh or scan; in the part's own coordinates, registered to it
    of : the body whose worn state a mesh or scan is; it must then lie on that body, but where it is
        worn, within registration_mm
    registration_mm : how far a mesh or scan may lie off that body where it is not worn
    layers : "level" ignores the shape; "shifted": each layer is the surface, raised; "parallel":
        at a distance from it (planes and cylinders); "blended": from the surface to a level top;
        "auto": level where it is flat within standoff_tolerance_mm, else parallel, or shifted for a
        mesh or scan
    standoff_tolerance_mm : how far the nozzle's height over the surface may be off
    max_slope_deg : steepest slope of the surface that is deposited on, from level
    temperature_C : of the substrate at the start, and of the table under it for good
    thickness_mm : of the plate; contact_W_m2_K : between it and the table, 0 where it is insulated.
        These three count where `process.interpass_max_C` is stated
    """

    kind: SubstrateKind = "plate"
    material: Name | None = None
    point_mm: Vector | None = None
    normal: Direction = (0.0, 0.0, 1.0)
    axis: Direction = (1.0, 0.0, 0.0)
    radius_mm: Length | None = None
    file: FileName | None = None
    units: Units | None = None
    of: Name | None = None
    registration_mm: Annotated[float, Field(gt=0, le=10)] = 0.5
    layers: LayerShape = "auto"
    standoff_tolerance_mm: Annotated[float, Field(gt=0, le=10)] = 0.3
    max_slope_deg: Annotated[float, Field(ge=0, le=60)] = 35.0
    temperature_C: Annotated[float, Field(ge=-50, le=1500)] = 20.0
    thickness_mm: Annotated[float, Field(ge=1, le=1000)] = 20.0
    contact_W_m2_K: Annotated[float, Field(ge=0, le=1e6)] = 1000.0

    @model_validator(mode="after")
    def _consistent(self) -> SubstrateSettings:
        wrong = [f"a {self.kind} needs {name}" for name in _NEEDED[self.kind]
                 if getattr(self, name) is None]
        own = {*_NEEDED[self.kind], *_ALLOWED[self.kind]}
        wrong += [f"a {self.kind} has no {name}"
                  for name in sorted((_OF_A_KIND - own) & self.model_fields_set)]
        if self.kind == "plate" and "layers" in self.model_fields_set:
            wrong.append("layers on a plate are level: say the shape of the substrate with kind")
        if self.kind in ("mesh", "scan") and self.layers == "parallel":
            wrong.append('layers = "parallel" needs a plane or a cylinder; a mesh or scan takes '
                         '"shifted" or "blended"')
        if self.kind == "plane" and self.normal[2] <= 0:
            wrong.append("normal does not point up")
        if self.kind == "cylinder" and abs(self.axis[2]) > 1e-9:
            wrong.append("axis is not level: lay the bar down, and the part with it")
        if wrong:
            raise ValueError("; ".join(wrong))
        return self

    @property
    def has_shape(self) -> bool:
        """Whether it is more than a level plate under the part's lowest point."""
        return self.kind != "plate"
