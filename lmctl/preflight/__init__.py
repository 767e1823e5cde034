"""Check a job against a machine profile: hoppers, limits, travel. Planning and running use it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.preflight.hoppers import hopper_for_material as hopper_for_material
    from lmctl.preflight.job_check import check_job as check_job
    from lmctl.preflight.job_check import check_limits as check_limits
    from lmctl.preflight.job_check import travel_violations as travel_violations
    from lmctl.preflight.part_check import check_part as check_part
    from lmctl.preflight.placement import Placement as Placement
    from lmctl.preflight.program_check import check_program as check_program
    from lmctl.preflight.s_word import s_word_decimals as s_word_decimals

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "Placement": "lmctl.preflight.placement",
    "check_job": "lmctl.preflight.job_check",
    "check_limits": "lmctl.preflight.job_check",
    "check_part": "lmctl.preflight.part_check",
    "check_program": "lmctl.preflight.program_check",
    "hopper_for_material": "lmctl.preflight.hoppers",
    "s_word_decimals": "lmctl.preflight.s_word",
    "travel_violations": "lmctl.preflight.job_check",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
