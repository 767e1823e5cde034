"""What a host must say first of each fault, and how soon it can know."""

from __future__ import annotations

#: What a headline says of a link that loses, doubles, flips or delays bytes, or echoes them: that
#: a line or report was damaged, an answer is missing or too many, or that nothing comes.
_LINK = "damaged|unreadable|answer|not reported|not been read"

#: Words for faults that are ridden out: no headline may come of them at all.
_NOTHING = "(?!)"

#: Regular expressions on the headline, by kind of fault: the cause, not what follows from it.
EXPECTED = {
    "controller_reboots": "restarted",
    "controller_silent": "not reported",
    "controller_stalls": "not reported",
    "controller_lies": "position has not changed",
    "hard_limit": "limit", "soft_limit": "travel|limit",
    "motion_door": "door", "motion_estop": "e-stop|emergency", "panel_hold": "hold",
    "panel_start": _NOTHING, "panel_override": _NOTHING,
    "reports_garbled": _NOTHING, "reports_lost": _NOTHING, "reports_extended": _NOTHING,
    "reports_slow": _NOTHING,
    "ok_lost": "unanswered|no answer|answer is missing",
    "ok_doubled": "a reply came",
    "word_garbled": "program asks for|programmed path|damaged on its way",
    "link_closed": "was lost|there is no connection",
    "bytes_lost": _LINK, "bytes_doubled": _LINK, "bytes_flipped": _LINK, "bytes_late": _LINK,
    "garbage_echoed": _LINK, "modbus_exception": "refuses a request",
    "passing_exceptions": "no answer|not been read", "half_open": _LINK, "stray_bytes": _LINK,
    "requests_echoed": _LINK, "replies_slow": _LINK, "replies_dropped": _LINK,
    "replies_doubled": _NOTHING,
    "device_silent": "no answer|not been read",
    "feeder_restarts": "feeder F1: the device restarted", "feeder_local": "LOCAL",
    "feeder_estop": "emergency|e-stop",
    "watchdog_trips": "watchdog", "data_stale": "same data", "feeder_lies": "weight|weighed",
    "recipe_ignored": "recipe", "supply_low": "pressure", "over_pressure": "pressure",
    "disc_stalls": "disc|stall", "speed_deviates": "speed|disc", "flow_readback_off": "disc|flow",
    "hose_clogs": "pressure|clog", "hopper_empty": "empty", "hopper_level": "level",
    "disc_limited": "clipped", "feeder_warns": _NOTHING,
    "carrier_low": "carrier|gas", "lid_open": "lid", "below_n_min": "disc|least speed|stop",
    "shield_gas_low": "shield gas", "chiller_fails": "chiller", "oxygen_high": "oxygen",
    "analyser_invalid": "analyser", "extraction_low": "extraction",
    "laser_enable_stuck": "laser-enable", "laser_enable_drops": "laser-enable",
    "safety_stuck": "same data", "safety_restarts": "the device restarted",
    "estop": "emergency|e-stop", "door": "door",
}

#: Longest time from a fault to its first alarm during deposition [s], by how it shows.
SEEN_WITHIN_S = {
    "default": 2.0,
    # A contact that stays closed shows when it is commanded to open.
    "laser_enable_stuck": 60.0,
    # A hopper is read once in four cycles, and its disc may deviate for two seconds.
    "flow_readback_off": 3.5, "speed_deviates": 3.5, "disc_stalls": 3.5, "below_n_min": 3.5,
    "carrier_low": 2.5,
    # The path is deposited to its end.
    "extraction_low": 60.0,
}

#: How long a fault lasts [s]; one that shows only at the end of the run lasts until then.
LASTS_S = {"default": 10.0, "laser_enable_stuck": 30.0}

#: Faults that the small job is too short for: a hopper that lies is found by its weight, and that
#: takes 20 s (tests/run/test_interlocks.py has the rule).
UNSEEN = frozenset({"feeder_lies"})
