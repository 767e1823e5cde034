"""The interlock table (process.md 5.4) as data.

Pure: rules look at facts that carry their own ages. A stale input is a tripped input.
"""

from __future__ import annotations

from lmctl.run.interlocks import of_cell, of_feeders, of_motion
from lmctl.run.interlocks.rule import Reaction, Rule

#: The controller holds by itself; a relay that has just closed shows in its next report only.
_DOOR_S = 0.5

_SHIELD_GAS_S, _MIXER_S, _CARRIER_GAS_S, _DISC_S, _WEIGHED_S = 0.5, 1.0, 1.0, 2.0, 20.0

#: The first row that holds is the first alarm, where several hold at once.
RULES: tuple[Rule, ...] = (
    Rule("emergency stop", of_cell.estop, Reaction.RESET, of_safety=True),
    Rule("door", of_cell.door, of_safety=True),
    Rule("controller's door", of_motion.controllers_door, for_s=_DOOR_S),
    Rule("laser", of_cell.laser, of_safety=True),
    Rule("chiller", of_cell.chiller, of_safety=True),
    Rule("shield gas", of_cell.shield_gas, for_s=_SHIELD_GAS_S, of_safety=True),
    Rule("oxygen", of_cell.oxygen, of_safety=True),
    Rule("safety inputs silent", of_cell.silent, of_safety=True),
    Rule("watchdog relay", of_cell.relay, latched=True, of_safety=True),
    Rule("motion silent", of_motion.silent),
    Rule("position", of_motion.not_following, Reaction.RESET),
    Rule("path", of_motion.off_path),
    Rule("wait", of_motion.early),
    Rule("feed and power", of_motion.unasked),
    Rule("feeder silent", of_feeders.silent),
    Rule("mixer pressure", of_feeders.mixer, for_s=_MIXER_S, of_answers=True),
    Rule("set-point", of_feeders.clipped, of_answers=True),
    Rule("carrier gas", of_feeders.carrier_gas, for_s=_CARRIER_GAS_S, of_answers=True),
    Rule("disc", of_feeders.disc, for_s=_DISC_S, of_answers=True),
    Rule("weighed flow", of_feeders.weighed, for_s=_WEIGHED_S, of_answers=True),
    Rule("extraction", of_cell.extraction, Reaction.PATH_END, of_safety=True),
)

#: The same for a cell without a safety-input device.
RULES_WITHOUT_SAFETY = tuple(rule for rule in RULES if not rule.of_safety)
