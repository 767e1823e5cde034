"""Snapshots as Prometheus text (exposition format 0.0.4), for `/metrics`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from lmctl.run.state.transitions import RunState

Labels = Mapping[str, str]

#: (name, help, key of the snapshot)
_GAUGES = (
    ("layer", "Layer under way, from 1.", "layer"),
    ("layers", "Layers of the job.", "layers"),
    ("lines_executed", "Program lines executed.", "line"),
    ("lines", "Program lines of the job.", "lines"),
    ("program_time_seconds", "Program time done.", "done_s"),
    ("remaining_seconds", "Machine time to the end of the program, planned.", "remaining_s"),
    ("override_percent", "Feed override commanded.", "override_percent"),
    ("beam_power_watts", "Beam power, from the S word reported.", "power_W"),
    ("speed_mm_per_second", "Speed of the nozzle, reported.", "speed_mm_s"),
    ("shield_gas_litres_per_minute", "Shield gas, reported.", "shield_gas_L_min"),
    ("answer_age_seconds", "Age of the run's last answer.", "answer_age_s"),
)
_OF_HOPPERS = (
    ("powder_commanded_grams_per_minute", "Powder flow commanded.", "set_g_min"),
    ("powder_reported_grams_per_minute", "Powder flow reported.", "measured_g_min"),
    ("carrier_gas_litres_per_minute", "Carrier gas, reported.", "carrier_L_min"),
)
_OF_LEVELS = (
    ("hopper_level_percent", "Level of a hopper, reported.", "level_percent"),
    ("hopper_weight_grams", "Weight of a hopper's powder, reported.", "weight_g"),
)
_MIXTURES = ("planned", "commanded", "nozzle")


def metrics_text(snapshots: Sequence[Mapping[str, Any]]) -> str:
    """One text for all runs under way. What is not known has no sample."""
    lines: list[str] = ["# HELP lmctl_runs Runs under way.", "# TYPE lmctl_runs gauge",
                        f"lmctl_runs {len(snapshots)}"]
    families: dict[tuple[str, str], list[str]] = {}
    for now in snapshots:
        labels = {"run": str(now["run"]), "part": str(now["part"]),
                  "machine": str(now["machine"])}
        for name, text, own, value in _samples(now):
            if isinstance(value, bool | int | float):
                families.setdefault((name, text), []).append(
                    f"lmctl_{name}{_labels({**labels, **own})} {float(value):g}")
    for (name, text), samples in families.items():
        lines += [f"# HELP lmctl_{name} {text}", f"# TYPE lmctl_{name} gauge", *samples]
    return "\n".join(lines) + "\n"


def _samples(now: Mapping[str, Any]) -> Iterator[tuple[str, str, Labels, Any]]:
    for name, text, key in _GAUGES:
        yield name, text, {}, now.get(key)
    for state in RunState:
        yield "state", "1 for the state of the run.", {"state": state}, now["state"] == state
    for name, text, key in _OF_HOPPERS:
        yield from (
            (name, text, {"hopper": hopper}, value)
            for hopper, value in zip(now["hoppers"], now.get(key) or (), strict=False))
    for level in now.get("levels") or ():
        for name, text, key in _OF_LEVELS:
            yield name, text, {"hopper": level["hopper"]}, level[key]
    yield "alarms", "Alarms, cleared ones included.", {}, len(now.get("alarms") or ())
    yield "warnings", "Warnings of feeders.", {}, len(now.get("warnings") or ())
    for row in now.get("interlocks") or ():
        yield ("interlock_ok", "1 where an interlock finds nothing; none where it is not fitted.",
               {"interlock": row["name"]},
               None if row["state"] == "not fitted" else row["state"] == "ok")
    mixture = now.get("mixture")
    if mixture is not None:
        for kind in _MIXTURES:
            yield from _mixture_samples(kind, mixture["materials"], mixture[kind] or ())


def _mixture_samples(
    kind: str, materials: Iterable[str], fractions: Iterable[float]
) -> Iterator[tuple[str, str, Labels, Any]]:
    for material, fraction in zip(materials, fractions, strict=False):
        yield ("mixture_fraction", "Volume fraction; nozzle: inferred.",
               {"material": material, "mixture": kind}, fraction)


def _labels(labels: Labels) -> str:
    return "{" + ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items()) + "}"


def _escaped(value: str) -> str:
    return value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
