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
    InterlockRule("emergency stop", cell_rules.estop_findings, Reaction.RESET,
                  needs_safety_device=True),
    InterlockRule("door", cell_rules.door_findings, needs_safety_device=True),
    InterlockRule("controller's door", motion_rules.controller_door_findings,
                  min_duration_s=_DOOR_S),
    InterlockRule("laser", cell_rules.laser_findings, needs_safety_device=True),
    InterlockRule("chiller", cell_rules.chiller_findings, needs_safety_device=True),
    InterlockRule("shield gas", cell_rules.shield_gas_findings, min_duration_s=_SHIELD_GAS_S,
                  needs_safety_device=True),
    InterlockRule("oxygen", cell_rules.oxygen_findings, needs_safety_device=True),
    InterlockRule("safety inputs silent", cell_rules.safety_silence_findings,
                  needs_safety_device=True),
    InterlockRule("watchdog relay", cell_rules.watchdog_relay_findings, is_latched=True,
                  needs_safety_device=True),
    InterlockRule("motion silent", motion_rules.motion_silence_findings),
    InterlockRule("position", motion_rules.standstill_findings, Reaction.RESET),
    InterlockRule("path", motion_rules.off_path_findings),
    InterlockRule("wait", motion_rules.ahead_of_program_findings),
    InterlockRule("feed and power", motion_rules.uncommanded_output_findings),
    InterlockRule("feeder silent", feeder_rules.feeder_silence_findings),
    InterlockRule("mixer pressure", feeder_rules.mixer_pressure_findings, min_duration_s=_MIXER_S,
                  uses_feeder_readings=True),
    InterlockRule("set-point", feeder_rules.clipped_setpoint_findings, uses_feeder_readings=True),
    InterlockRule("carrier gas", feeder_rules.carrier_gas_findings, min_duration_s=_CARRIER_GAS_S,
                  uses_feeder_readings=True),
    InterlockRule("disc", feeder_rules.disc_speed_findings, min_duration_s=_DISC_S,
                  uses_feeder_readings=True),
    InterlockRule("weighed flow", feeder_rules.weighed_flow_findings, min_duration_s=_WEIGHED_S,
                  uses_feeder_readings=True),
    InterlockRule("extraction", cell_rules.extraction_findings, Reaction.PATH_END,
                  needs_safety_device=True),
)

#: The same for a cell without a safety-input device.
INTERLOCK_RULES_WITHOUT_SAFETY = tuple(
    rule for rule in INTERLOCK_RULES if not rule.needs_safety_device)
