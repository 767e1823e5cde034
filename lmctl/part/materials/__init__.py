"""Material composition of a part."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.part.materials.composition import CompositionField as CompositionField
    from lmctl.part.materials.composition import OverlapComposition as OverlapComposition
    from lmctl.part.materials.composition import TransformedComposition as TransformedComposition
    from lmctl.part.materials.composition import UniformComposition as UniformComposition
    from lmctl.part.materials.features import DepthBelowSurface as DepthBelowSurface
    from lmctl.part.materials.features import Feature as Feature
    from lmctl.part.materials.powders import MaterialSpec as MaterialSpec
    from lmctl.part.materials.powders import resolve_materials as resolve_materials
    from lmctl.part.materials.profile_warnings import flat_profile_warnings as flat_profile_warnings
    from lmctl.part.materials.rules import CompositionContext as CompositionContext
    from lmctl.part.materials.rules import composition_field_of as composition_field_of
    from lmctl.part.materials.rules import feature_of as feature_of

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "CompositionContext": "lmctl.part.materials.rules",
    "CompositionField": "lmctl.part.materials.composition",
    "DepthBelowSurface": "lmctl.part.materials.features",
    "Feature": "lmctl.part.materials.features",
    "MaterialSpec": "lmctl.part.materials.powders",
    "OverlapComposition": "lmctl.part.materials.composition",
    "TransformedComposition": "lmctl.part.materials.composition",
    "UniformComposition": "lmctl.part.materials.composition",
    "composition_field_of": "lmctl.part.materials.rules",
    "feature_of": "lmctl.part.materials.rules",
    "flat_profile_warnings": "lmctl.part.materials.profile_warnings",
    "resolve_materials": "lmctl.part.materials.powders",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
