"""Which act each kind of fault is: the table between `kinds` and the modules that carry them out.

An act makes a fault real at once, and returns what ends it where it lasts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from simulators.faults import cell_acts, feeder_acts, link_acts, motion_acts
from simulators.faults.kinds import Fault
from simulators.faults.scene import Scene, Undo

Act = Callable[[Scene, Fault], Undo | None]

ACTS: Mapping[str, Act] = MappingProxyType({
    "controller_reboots": motion_acts.reboot,
    "controller_silent": motion_acts.fall_silent,
    "controller_stalls": motion_acts.stall,
    "controller_lies": motion_acts.lie,
    "hard_limit": motion_acts.meet_limit_switch,
    "soft_limit": motion_acts.leave_travel,
    "motion_door": motion_acts.open_door,
    "motion_estop": motion_acts.open_estop,
    "panel_hold": motion_acts.press_hold,
    "panel_start": motion_acts.press_start,
    "panel_override": motion_acts.turn_overrides,
    "ok_lost": link_acts.lose_answers,
    "ok_doubled": link_acts.double_answers,
    "reports_garbled": motion_acts.garble_reports,
    "reports_lost": motion_acts.lose_reports,
    "reports_extended": motion_acts.extend_reports,
    "reports_slow": motion_acts.slow_reports,
    "word_garbled": link_acts.garble_word,
    "link_closed": link_acts.close_link,
    "bytes_lost": link_acts.lose_bytes,
    "bytes_doubled": link_acts.double_bytes,
    "bytes_flipped": link_acts.flip_bytes,
    "bytes_late": link_acts.delay_bytes,
    "garbage_echoed": link_acts.echo_garbage,
    "modbus_exception": link_acts.refuse_requests,
    "passing_exceptions": link_acts.pass_exceptions,
    "half_open": link_acts.forget_connections,
    "stray_bytes": link_acts.add_stray_bytes,
    "requests_echoed": link_acts.echo_requests,
    "replies_slow": link_acts.delay_replies,
    "replies_dropped": link_acts.drop_replies,
    "replies_doubled": link_acts.double_replies,
    "device_silent": link_acts.silence,
    "feeder_restarts": feeder_acts.restart,
    "feeder_local": feeder_acts.turn_local,
    "feeder_estop": feeder_acts.open_estop,
    "watchdog_trips": feeder_acts.trip_watchdog,
    "data_stale": feeder_acts.freeze,
    "feeder_lies": feeder_acts.lie,
    "recipe_ignored": feeder_acts.ignore_recipes,
    "supply_low": feeder_acts.lower_supply,
    "over_pressure": feeder_acts.raise_pressure,
    "feeder_warns": feeder_acts.warn,
    "disc_stalls": feeder_acts.stall_disc,
    "speed_deviates": feeder_acts.turn_disc_wrong,
    "flow_readback_off": feeder_acts.read_flow_wrong,
    "hose_clogs": feeder_acts.clog,
    "hopper_empty": feeder_acts.empty_hopper,
    "hopper_level": feeder_acts.set_level,
    "carrier_low": feeder_acts.lower_carrier,
    "lid_open": feeder_acts.open_lid,
    "below_n_min": feeder_acts.raise_n_min,
    "disc_limited": feeder_acts.limit_disc,
    "shield_gas_low": cell_acts.lower_shield_gas,
    "chiller_fails": cell_acts.fail_chiller,
    "oxygen_high": cell_acts.raise_oxygen,
    "analyser_invalid": cell_acts.invalidate_analyser,
    "extraction_low": cell_acts.lower_extraction,
    "safety_stuck": cell_acts.freeze_safety,
    "laser_enable_stuck": cell_acts.stick_laser_enable,
    "laser_enable_drops": cell_acts.drop_laser_enable,
    "safety_restarts": cell_acts.restart_safety,
    "estop": cell_acts.press_estop,
    "door": cell_acts.open_door,
    "host_killed": cell_acts.kill_host,
})
