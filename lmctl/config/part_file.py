"""The part file: bodies, materials, process, as written in TOML; data only, no geometry.

`lmctl.part` turns it into something that answers; `lmctl.plan` reads `process` from it.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from lmctl.config.toml_file import Model

Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(gt=0, le=1)]


class Material(Model):
    """One powder, as the process sees it (process.md 3.1).

    density_g_cm3, apparent_g_cm3 : solid and loose-powder density; None takes the library's
    catch_efficiency : share of the fed powder that ends in the bead, η in (0, 1]
    power_W, speed_mm_s : recipe of the pure material; mixtures interpolate by volume fraction
    """

    name: str
    density_g_cm3: Positive | None = None
    apparent_g_cm3: Positive | None = None
    catch_efficiency: Share | None = None
    power_W: Positive | None = None
    speed_mm_s: Positive | None = None


class Process(Model):
    """How beads are laid. Defaults are the medium DED class of process.md 3.3, and are named.

    overlap : share of the bead width by which neighbours overlap; pitch = width · (1 − overlap)
    fraction_step : quantum of volume fraction along a path (ε_c, process.md 4)
    lead_in_mm : run-up and run-out with the beam off at each end of a path
    """

    bead_width_mm: Positive = 2.0
    overlap: Annotated[float, Field(ge=0, lt=0.9)] = 0.333
    layer_height_mm: Positive = 0.8
    speed_mm_s: Positive = 10.0
    travel_speed_mm_s: Positive = 50.0
    power_W: Positive = 1500.0
    fraction_step: Annotated[float, Field(ge=0.001, le=0.5)] = 0.02
    lead_in_mm: Annotated[float, Field(ge=0, le=20)] = 1.0
    strategy: Literal["in-plane", "iso-3d"] = "in-plane"
    powder: Literal["lead", "dwell", "none"] = "lead"
    dwell_s: Annotated[float, Field(ge=0, le=600)] = 30.0
