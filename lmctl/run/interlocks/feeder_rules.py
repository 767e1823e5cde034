"""Rules about powder: what feeders report about gas, discs and weight."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lmctl.run.interlocks.inputs import STALE_PERIODS, InterlockInputs
from lmctl.run.interlocks.rule import InterlockFinding

_CARRIER_SHARE = 0.8
_DISC_SHARE, _DISC_LEAST_G_MIN = 0.02, 0.05
_WEIGHED_SHARE, _WEIGHED_LEAST_G_MIN = 0.15, 0.5


def feeder_silence_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    for feeder in facts.feeders:
        if feeder.age_s > STALE_PERIODS * feeder.period_s:
            seen = f": {feeder.wire_symptoms}" if feeder.wire_symptoms else ""
            yield InterlockFinding(
                f"feeder {feeder.name}: no answer for {feeder.age_s:.1f} s{seen}",
                "check its power and cable", feeder.name,
            )


def mixer_pressure_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    """Mixer pressure too high. The feeder's own alarm comes later: with the nozzle already shut."""
    for feeder in facts.feeder_readings:
        mbar, most_mbar = feeder.mixer_mbar, feeder.mixer_max_mbar
        if mbar is not None and most_mbar is not None and mbar > most_mbar:
            yield InterlockFinding(
                f"feeder {feeder.name}: the mixer pressure is {mbar:.0f} mbar, {most_mbar:g} mbar "
                "is allowed",
                "look for a clogged nozzle or kinked hose", feeder.name,
            )


def clipped_setpoint_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    """A clipped set-point changes the mixture. Disc and weight match it; only this shows it."""
    for feeder in facts.feeder_readings:
        if feeder.clipped is not None:
            of = " and ".join(f"hopper {name}" for name in feeder.clipped) or "a hopper"
            yield InterlockFinding(
                f"feeder {feeder.name}: the set-point of {of} was clipped: the mixture is not the "
                "one planned",
                "look at its display whether a disc was given another highest speed, then resume",
                feeder.name,
            )


def carrier_gas_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    for feeder in facts.feeder_readings:
        for hopper, reading in feeder.hoppers:
            flow, wanted = reading.carrier_L_min, hopper.carrier_L_min
            if flow is not None and flow < _CARRIER_SHARE * wanted:
                yield InterlockFinding(
                    f"hopper {hopper.name}: carrier gas flows at {flow:.1f} L/min, "
                    f"{wanted:g} L/min is set",
                    f"check gas supply and hose of feeder {feeder.name}", hopper.name,
                    reading.time_s,
                )


def disc_speed_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    for feeder in facts.feeder_readings:
        for hopper, reading in feeder.hoppers:
            flow, wanted = reading.flow_estimated_g_min, reading.setpoint_g_min
            # Recipe and reading are one request: the disc may still follow the set-point before it.
            meant = (wanted, *reading.previous_setpoints_g_min)
            if _is_off(flow, meant, _DISC_LEAST_G_MIN, _DISC_SHARE):
                yield InterlockFinding(
                    f"hopper {hopper.name}: its disc feeds {flow:.2f} g/min, {wanted:.2f} g/min "
                    f"is set",
                    f"look whether the disc of feeder {feeder.name} is jammed", hopper.name,
                    reading.time_s,
                )


def weighed_flow_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    for feeder in facts.feeder_readings:
        for hopper, reading in feeder.hoppers:
            weighed, wanted = reading.flow_weighed_g_min, reading.setpoint_g_min
            if _is_off(weighed, (wanted,), _WEIGHED_LEAST_G_MIN, _WEIGHED_SHARE):
                yield InterlockFinding(
                    f"hopper {hopper.name}: by weight it loses {weighed:.2f} g/min, "
                    f"{wanted:.2f} g/min is set",
                    f"look whether powder moves in feeder {feeder.name}", hopper.name,
                    reading.time_s,
                )


def _is_off(flow: float | None, meant: Sequence[float], least: float, share: float) -> bool:
    """Whether a flow that is known lies outside those meant by more than a share, and the least."""
    if flow is None:
        return False
    nearest = min(max(flow, min(meant)), max(meant))
    return abs(flow - nearest) > max(least, share * nearest)
