"""What a host must say first of each fault, and how soon it can know."""

from __future__ import annotations

#: Regular expressions on the first alarm, by kind of fault.
EXPECTED = {
    "controller_reboots": "restarted|lost|not reported|refused",
    "controller_silent": "not reported|silent|no answer|lost",
    "controller_stalls": "not reported|silent|no answer|lost",
    "controller_lies": "position has not changed|still moves|off the programmed path",
    "hard_limit": "limit", "soft_limit": "travel|limit",
    "motion_door": "door", "motion_estop": "e-stop|emergency", "panel_hold": "hold",
    "panel_start": "", "panel_override": "",
    "reports_garbled": "", "reports_lost": "", "reports_extended": "", "reports_slow": "",
    "ok_lost": "unanswered|no answer|answer is missing", "ok_doubled": "answer",
    "word_garbled": "program asks for|programmed path|purge position",
    "link_closed": "lost|no answer|not answer|closed|not been read|not reported", "bytes_lost": "",
    "bytes_doubled": "", "bytes_flipped": "", "bytes_late": "", "garbage_echoed": "",
    "modbus_exception": "", "passing_exceptions": "no answer|not been read", "half_open": "",
    "stray_bytes": "", "requests_echoed": "", "replies_slow": "", "replies_dropped": "",
    "replies_doubled": "",
    "device_silent": "no answer|not answer|not been read|silent",
    "feeder_restarts": "feeder F1", "feeder_local": "LOCAL|feeder F1",
    "feeder_estop": "emergency|e-stop",
    "watchdog_trips": "watchdog", "data_stale": "same data", "feeder_lies": "weight|weighed",
    "recipe_ignored": "recipe", "supply_low": "pressure", "over_pressure": "pressure",
    "disc_stalls": "disc|stall", "speed_deviates": "speed|disc", "flow_readback_off": "disc|flow",
    "hose_clogs": "pressure|clog", "hopper_empty": "empty", "hopper_level": "level",
    "disc_limited": "clipped", "feeder_warns": "",
    "carrier_low": "carrier|gas", "lid_open": "lid", "below_n_min": "disc|least speed|stop",
    "shield_gas_low": "shield gas", "chiller_fails": "chiller", "oxygen_high": "oxygen",
    "analyser_invalid": "analyser", "extraction_low": "extraction",
    "laser_enable_stuck": "laser-enable", "laser_enable_drops": "laser-enable",
    "safety_stuck": "safety device|safety inputs", "safety_restarts": "safety|relay|door",
    "estop": "emergency|e-stop", "door": "door",
}

#: Longest time from a fault to its first alarm while beads are laid [s], by how it shows.
SEEN_WITHIN_S = {
    "default": 2.0,
    # A contact that stays closed shows when it is told to open.
    "laser_enable_stuck": 60.0,
    # A hopper is read once in four cycles, and its disc may deviate for two seconds.
    "flow_readback_off": 3.5, "speed_deviates": 3.5, "disc_stalls": 3.5, "below_n_min": 3.5,
    "carrier_low": 2.5,
    # The path is laid to its end.
    "extraction_low": 60.0,
}

#: How long a fault stands [s]; one that shows only when all is done stands until then.
STANDS_S = {"default": 10.0, "laser_enable_stuck": 30.0}

#: Faults that the small job is too short for: a hopper that lies is found by its weight, and that
#: takes 20 s (tests/run/test_interlocks.py has the rule).
UNSEEN = frozenset({"feeder_lies"})
