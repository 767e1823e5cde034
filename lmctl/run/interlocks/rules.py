"""The interlock table (docs/explanation/safety-and-sequences.md, Interlock table) as data.

Pure: rules look at facts that carry their own ages. A stale input is a tripped input.
"""

from __future__ import annotations

from lmctl.run.interlocks import cell_rules, feeder_rules, motion_rules
from lmctl.run.interlocks.rule import InterlockRule, Reaction

#: The controller holds by itself; a relay that has just closed shows in its next report only.
_DOOR_S = 0.5

_SHIELD_GAS_S, _MIXER_S, _CARRIER_GAS_S, _DISC_S, _WEIGHED_S = 0.5, 1.0, 1.0, 2.0, 20.0

#: The first row that holds is the first alarm, where several hold at once.
INTERLOCK_RULES: tuple[InterlockRule, ...] = (
    InterlockRule("emergency stop", cell_rules.estop, Reaction.RESET, needs_safety_device=True),
    InterlockRule("door", cell_rules.door, needs_safety_device=True),
    InterlockRule("controller's door", motion_rules.controller_door, for_s=_DOOR_S),
    InterlockRule("laser", cell_rules.laser, needs_safety_device=True),
    InterlockRule("chiller", cell_rules.chiller, needs_safety_device=True),
    InterlockRule("shield gas", cell_rules.shield_gas, for_s=_SHIELD_GAS_S,
                  needs_safety_device=True),
    InterlockRule("oxygen", cell_rules.oxygen, needs_safety_device=True),
    InterlockRule("safety inputs silent", cell_rules.silent, needs_safety_device=True),
    InterlockRule("watchdog relay", cell_rules.relay, is_latched=True, needs_safety_device=True),
    InterlockRule("motion silent", motion_rules.silent),
    InterlockRule("position", motion_rules.not_following, Reaction.RESET),
    InterlockRule("path", motion_rules.off_path),
    InterlockRule("wait", motion_rules.ahead_of_program),
    InterlockRule("feed and power", motion_rules.uncommanded_output),
    InterlockRule("feeder silent", feeder_rules.silent),
    InterlockRule("mixer pressure", feeder_rules.mixer_pressure, for_s=_MIXER_S,
                  uses_feeder_readings=True),
    InterlockRule("set-point", feeder_rules.clipped_setpoint, uses_feeder_readings=True),
    InterlockRule("carrier gas", feeder_rules.carrier_gas, for_s=_CARRIER_GAS_S,
                  uses_feeder_readings=True),
    InterlockRule("disc", feeder_rules.disc_speed, for_s=_DISC_S, uses_feeder_readings=True),
    InterlockRule("weighed flow", feeder_rules.weighed_flow, for_s=_WEIGHED_S,
                  uses_feeder_readings=True),
    InterlockRule("extraction", cell_rules.extraction, Reaction.PATH_END, needs_safety_device=True),
)

#: The same for a cell without a safety-input device.
INTERLOCK_RULES_WITHOUT_SAFETY = tuple(
    rule for rule in INTERLOCK_RULES if not rule.needs_safety_device)
