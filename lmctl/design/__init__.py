"""Simulate what a part does in service, and choose its materials by that."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.design.conditions import ModelConditions as ModelConditions
    from lmctl.design.discretisation import Discretisation as Discretisation
    from lmctl.design.effective_properties import MixingRules as MixingRules
    from lmctl.design.fitted_mesh import fit_mesh as fit_mesh
    from lmctl.design.model_space import ModelSpace as ModelSpace
    from lmctl.design.performance_model import PerformanceModel as PerformanceModel
    from lmctl.design.performance_model import PerformanceSolution as PerformanceSolution
    from lmctl.design.phases import PhaseConstants as PhaseConstants
    from lmctl.design.phases import phase_constants as phase_constants
    from lmctl.design.recovery import recover_fields as recover_fields

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "Discretisation": "lmctl.design.discretisation",
    "MixingRules": "lmctl.design.effective_properties",
    "ModelConditions": "lmctl.design.conditions",
    "ModelSpace": "lmctl.design.model_space",
    "PerformanceModel": "lmctl.design.performance_model",
    "PerformanceSolution": "lmctl.design.performance_model",
    "PhaseConstants": "lmctl.design.phases",
    "fit_mesh": "lmctl.design.fitted_mesh",
    "phase_constants": "lmctl.design.phases",
    "recover_fields": "lmctl.design.recovery",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
