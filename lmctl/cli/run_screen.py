"""What the terminal of a run shows: state, what is done and for how long, hoppers, what comes next.

A screen is a few lines made from a snapshot of the run (`lmctl.run.status.snapshot`), and nothing
else but what turns flows into a mixture.
"""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lmctl.cli.console import format_duration, print_notice

if TYPE_CHECKING:
    from lmctl.config.machine import MachineProfile
    from lmctl.report.reported_values import PartScales

_BAR = 20
_KEY = 8

Snapshot = dict[str, Any]


def screen_lines(
    now: Snapshot, width: int = 80, scales: PartScales | None = None
) -> list[str]:
    """The lines for one snapshot, none longer than `width`.

    scales : of the job on this cell; None: no mixture is shown
    """
    done = now["done_s"] / now["total_s"] if now["total_s"] > 0.0 else 0.0
    filled = round(_BAR * min(max(done, 0.0), 1.0))
    lines = [
        f"{now['run']}  {now['state'].upper():<10}  {'━' * filled}{'╌' * (_BAR - filled)}  "
        f"{100 * done:3.0f} %  layer {now['layer']} of {now['layers']}, "
        f"{format_duration(now['remaining_s'])} left",
    ]
    rows = [("now", _doing(now))] if now["state"] != now["doing"] else []
    if now["held_by"]:
        rows.append(("held by", now["held_by"]))
    if scales is not None and (text := mixture_text(now, scales)):
        rows.append(("mixture", text))
    if now["levels"]:
        rows.append(("powder", ", ".join(map(level_text, now["levels"]))))
    rows += [("warning", one["what"]) for one in now["warnings"]]
    rows += [("next", f"{one['command']}: {one['does']}") for one in now["next"]]
    for key, text in rows:
        lines += textwrap.wrap(
            text, width, initial_indent=f"  {key:<{_KEY}}", subsequent_indent=" " * (_KEY + 2),
            break_long_words=False, break_on_hyphens=False)
    return [line[:width] for line in lines]


def _doing(now: Snapshot) -> str:
    left_s = now["doing_left_s"]
    return now["doing"] if left_s is None else f"{now['doing']}, {format_duration(left_s)} left"


def mixture_text(now: Snapshot, scales: PartScales) -> str:
    """Volume fractions as people read them: 316L 0.702/0.700, WC-12Co 0.298/0.300. "" where no
    powder is commanded, or the part has one material."""
    if now["set_g_min"] is None or len(scales.materials) < 2 or not scales.deposit_mm3_g:
        return ""
    import numpy as np  # late: a run has loaded it, `lmctl --help` has not

    (commanded,) = scales.fractions(np.array([now["set_g_min"]]) / 60.0, now["materials"])
    if not np.isfinite(commanded).all():
        return ""
    designed = now["designed"] or {}
    each = (f"{name} {f'{designed[name]:.3f}' if name in designed else '–'}/{fraction:.3f}"
            for name, fraction in zip(scales.materials, commanded, strict=True))
    return f"{', '.join(each)} (designed/commanded)"


def level_text(level: Snapshot) -> str:
    """A hopper's level as people read it: A 85 % 17.0 kg."""
    percent, grams = level["level_percent"], level["weight_g"]
    words = [f"{percent:.0f} %"] if percent is not None else []
    words += [f"{grams / 1000:.2f} kg"] if grams is not None else []
    return f"{level['hopper']} {' '.join(words)}"


@dataclass(frozen=True)
class RunScreen:
    """watcher : takes snapshots, None where there is no terminal; notice : prints a line above"""

    watcher: Callable[[Snapshot], None] | None
    notice: Callable[[str], None]


@contextmanager
def run_screen(job: Path, profile: MachineProfile) -> Iterator[RunScreen]:
    """A screen on standard error while a job runs on a cell, only where that is a terminal."""
    if not sys.stderr.isatty():
        yield RunScreen(None, print_notice)
        return
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    from lmctl.report.part_report import scales_on_cell

    console, scales = Console(stderr=True), scales_on_cell(job, profile)

    def say_above(line: str) -> None:
        with suppress(OSError, ValueError):
            console.print(line, markup=False, highlight=False, soft_wrap=True)

    with Live(console=console, transient=True, refresh_per_second=5) as live:

        def show(now: Snapshot) -> None:
            lines = screen_lines(now, min(console.width, 100), scales)
            live.update(Text("\n".join(lines), no_wrap=True, overflow="ellipsis"))

        yield RunScreen(show, say_above)
