"""Which act each kind of fault is: the table between `kinds` and the modules that carry them out.

An act makes a fault real at once, and returns what ends it where it lasts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from simulators.faults import cell_faults, feeder_faults, link_faults, motion_faults
from simulators.faults.fault_context import FaultContext, Undo
from simulators.faults.kinds import Fault

InjectFunction = Callable[[FaultContext, Fault], Undo | None]

INJECTORS: Mapping[str, InjectFunction] = MappingProxyType({
    "controller_reboots": motion_faults.reboot_controller,
    "controller_silent": motion_faults.fall_silent,
    "controller_stalls": motion_faults.stall_axes,
    "controller_lies": motion_faults.freeze_status_reports,
    "hard_limit": motion_faults.trip_limit_switch,
    "soft_limit": motion_faults.exceed_soft_limit,
    "motion_door": motion_faults.open_door,
    "motion_estop": motion_faults.open_estop,
    "panel_hold": motion_faults.press_hold,
    "panel_start": motion_faults.press_start,
    "panel_override": motion_faults.turn_overrides,
    "ok_lost": link_faults.lose_answers,
    "ok_doubled": link_faults.double_answers,
    "reports_garbled": motion_faults.garble_reports,
    "reports_lost": motion_faults.lose_reports,
    "reports_extended": motion_faults.extend_reports,
    "reports_slow": motion_faults.slow_reports,
    "word_garbled": link_faults.garble_word,
    "link_closed": link_faults.close_link,
    "bytes_lost": link_faults.lose_bytes,
    "bytes_doubled": link_faults.double_bytes,
    "bytes_flipped": link_faults.flip_bytes,
    "bytes_late": link_faults.delay_bytes,
    "garbage_echoed": link_faults.echo_garbage,
    "modbus_exception": link_faults.refuse_requests,
    "passing_exceptions": link_faults.pass_exceptions,
    "half_open": link_faults.forget_connections,
    "stray_bytes": link_faults.add_stray_bytes,
    "requests_echoed": link_faults.echo_requests,
    "replies_slow": link_faults.delay_replies,
    "replies_dropped": link_faults.drop_replies,
    "replies_doubled": link_faults.double_replies,
    "device_silent": link_faults.silence_link,
    "feeder_restarts": feeder_faults.restart_feeder,
    "feeder_local": feeder_faults.turn_local,
    "feeder_estop": feeder_faults.open_estop,
    "watchdog_trips": feeder_faults.trip_watchdog,
    "data_stale": feeder_faults.freeze_registers,
    "feeder_lies": feeder_faults.report_false_flow,
    "recipe_ignored": feeder_faults.ignore_recipes,
    "supply_low": feeder_faults.lower_supply,
    "over_pressure": feeder_faults.raise_pressure,
    "feeder_warns": feeder_faults.raise_warning,
    "disc_stalls": feeder_faults.stall_disc,
    "speed_deviates": feeder_faults.turn_disc_wrong,
    "flow_readback_off": feeder_faults.read_flow_wrong,
    "hose_clogs": feeder_faults.clog_nozzle,
    "hopper_empty": feeder_faults.empty_hopper,
    "hopper_level": feeder_faults.set_level,
    "carrier_low": feeder_faults.lower_carrier,
    "lid_open": feeder_faults.open_lid,
    "below_n_min": feeder_faults.raise_n_min,
    "disc_limited": feeder_faults.limit_disc,
    "shield_gas_low": cell_faults.lower_shield_gas,
    "chiller_fails": cell_faults.fail_chiller,
    "oxygen_high": cell_faults.raise_oxygen,
    "analyser_invalid": cell_faults.invalidate_analyser,
    "extraction_low": cell_faults.lower_extraction,
    "safety_stuck": cell_faults.freeze_safety,
    "laser_enable_stuck": cell_faults.stick_laser_enable,
    "laser_enable_drops": cell_faults.drop_laser_enable,
    "safety_restarts": cell_faults.restart_safety,
    "estop": cell_faults.press_estop,
    "door": cell_faults.open_door,
    "host_killed": cell_faults.kill_host,
})
