"""Links cut, hosts killed, controllers restarted at random moments, then recovered.

cut_kill_restart_moments       scenarios: Grbl and grblHAL, with and without laser-enable and homing
recovered                      of these, parts that were completed
missing_mm                     bead that lies nowhere, over all parts (gaps of 0.2 mm and more)
largest_gap_mm                 the longest stretch without bead
repeated_beyond_overlap_mm     bead that lies twice, beyond the 0.5 mm allowed at an entry
largest_overlap_mm             the longest doubled stretch
continued_at_unproven_place    parts on which something was deposited off its path
overlap_deposit_worst          most deposit in any 2 mm around an entry, over that of a whole bead
overlap_deposit_least          least of the same
entry_mixture_error_worst      volume fraction within 50 mm of an entry, from the job's, by 1 mm
operator_asked                 scenarios in which `recover` asked what is on the part
position_refused               ... in which it refused to believe the controller's position
harmless_refused               ... of these, after a plain stop

A scenario that falls short is printed to standard error; `python -m tests.faults.moments SEED`
repeats it.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from tests.faults.moments import run_scenario, scenario, shortfalls, undisturbed

SEEDS = range(300)


def rows() -> dict[str, float | int]:
    parts, deposits, mixtures = [], [1.0], [0.0]
    recovered = asked = lost = needless = 0
    with tempfile.TemporaryDirectory() as name:
        whole = {}
        for seed in SEEDS:
            one = scenario(seed)
            cell = one.dialect, one.has_laser_enable
            if cell not in whole:
                whole[cell] = undisturbed(one.dialect, has_laser_enable=one.has_laser_enable,
                                          folder=Path(name) / f"whole-{len(whole)}")
            reported = run_scenario(one, Path(name) / str(seed))
            for shortfall in shortfalls(reported, whole[cell]):
                print(f"{one}: {shortfall}", file=sys.stderr)
            asked += reported.asked > 0
            lost += reported.lost > 0
            needless += reported.needless
            if reported.part is not None and not reported.refused:
                recovered += 1
                parts.append(reported.part)
                deposits += reported.part.entry_deposit(whole[cell])
                mixtures.append(reported.part.entry_mixture_error())
    return {
        "cut_kill_restart_moments": len(SEEDS),
        "recovered": recovered,
        "missing_mm": round(sum(part.missing_mm for part in parts), 2),
        "largest_gap_mm": round(max(part.largest_gap_mm for part in parts), 3),
        "repeated_beyond_overlap_mm": round(sum(part.repeated_mm for part in parts), 2),
        "largest_overlap_mm": round(max(part.largest_overlap_mm for part in parts), 3),
        "continued_at_unproven_place": sum(part.off_path_mm > 0.1 for part in parts),
        "overlap_deposit_worst": round(max(deposits), 3),
        "overlap_deposit_least": round(min(deposits), 3),
        "entry_mixture_error_worst": round(max(mixtures), 4),
        "operator_asked": asked,
        "position_refused": lost,
        "harmless_refused": needless,
    }
