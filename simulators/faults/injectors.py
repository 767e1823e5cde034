"""Maps each fault kind in `kinds` to the function that injects it.

The function injects the fault at once, and returns its undo if the fault is lasting.
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
    "controller_silent": motion_faults.silence_controller,
    "controller_stalls": motion_faults.stall_axes,
    "controller_lies": motion_faults.freeze_status_reports,
    "hard_limit": motion_faults.trip_limit_switch,
    "soft_limit": motion_faults.exceed_soft_limit,
    "motion_door": motion_faults.open_door,
    "motion_estop": motion_faults.open_estop,
    "panel_hold": motion_faults.press_hold_at_panel,
    "panel_start": motion_faults.press_start_at_panel,
    "panel_override": motion_faults.change_overrides_at_panel,
    "ok_lost": link_faults.drop_ok_replies,
    "ok_doubled": link_faults.duplicate_ok_replies,
    "reports_garbled": motion_faults.garble_status_reports,
    "reports_lost": motion_faults.drop_status_reports,
    "reports_extended": motion_faults.add_unknown_report_fields,
    "reports_slow": motion_faults.delay_status_reports,
    "word_garbled": link_faults.garble_gcode_word,
    "link_closed": link_faults.close_link,
    "bytes_lost": link_faults.drop_bytes,
    "bytes_doubled": link_faults.duplicate_bytes,
    "bytes_flipped": link_faults.flip_bytes,
    "bytes_late": link_faults.delay_bytes,
    "garbage_echoed": link_faults.echo_garbage,
    "modbus_exception": link_faults.refuse_requests,
    "passing_exceptions": link_faults.pass_exceptions,
    "half_open": link_faults.make_connections_half_open,
    "stray_bytes": link_faults.add_stray_bytes,
    "requests_echoed": link_faults.echo_requests,
    "replies_slow": link_faults.delay_replies,
    "replies_dropped": link_faults.drop_modbus_replies,
    "replies_doubled": link_faults.duplicate_modbus_replies,
    "device_silent": link_faults.silence_link,
    "feeder_restarts": feeder_faults.restart_feeder,
    "feeder_local": feeder_faults.switch_to_local_mode,
    "feeder_estop": feeder_faults.open_estop,
    "watchdog_trips": feeder_faults.trip_watchdog,
    "data_stale": feeder_faults.freeze_registers,
    "feeder_lies": feeder_faults.report_false_flow,
    "recipe_ignored": feeder_faults.ignore_recipes,
    "supply_low": feeder_faults.lower_supply,
    "over_pressure": feeder_faults.raise_pressure,
    "feeder_warns": feeder_faults.raise_warning,
    "disc_stalls": feeder_faults.stall_disc,
    "speed_deviates": feeder_faults.turn_disc_at_wrong_speed,
    "flow_readback_off": feeder_faults.read_flow_wrong,
    "hose_clogs": feeder_faults.clog_nozzle,
    "hopper_empty": feeder_faults.empty_hopper,
    "hopper_level": feeder_faults.set_hopper_level,
    "carrier_low": feeder_faults.lower_carrier_gas,
    "lid_open": feeder_faults.open_lid,
    "below_n_min": feeder_faults.raise_min_disc_speed,
    "disc_limited": feeder_faults.lower_max_disc_speed,
    "shield_gas_low": cell_faults.lower_shield_gas,
    "chiller_fails": cell_faults.fail_chiller,
    "oxygen_high": cell_faults.raise_oxygen,
    "analyser_invalid": cell_faults.invalidate_analyser,
    "extraction_low": cell_faults.lower_extraction,
    "safety_stuck": cell_faults.freeze_safety_device,
    "laser_enable_stuck": cell_faults.stick_laser_enable,
    "laser_enable_drops": cell_faults.drop_laser_enable,
    "safety_restarts": cell_faults.restart_safety_device,
    "estop": cell_faults.press_estop,
    "door": cell_faults.open_door,
    "host_killed": cell_faults.kill_host,
})
