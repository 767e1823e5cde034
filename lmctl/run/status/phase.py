"""What a run does at this moment, in words, and how long that still takes.

A state may have several effects, one after the other; the operator needs to see which one is
under way.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.machine.feeder.recipe import post_flow_duration_s, settling_time_s
from lmctl.run.state.transitions import Effect, RunState

_WORDS = {
    Effect.CONNECT: "connecting to the devices",
    Effect.CHECK_MACHINE: "checking the machine",
    Effect.MOVE_TO_PURGE: "moving to the purge position",
    Effect.GAS_ON: "carrier gas on, pre-flow",
    Effect.POWDER_ON: "powder on",
    Effect.AWAIT_STABLE: "purging: powder into the catcher until it is steady",
    Effect.ARM_BEAM: "arming the beam at zero",
    Effect.LEAD_POWDER: "leading powder up to the first line",
    Effect.START_MOTION: "depositing",
    Effect.FEED_HOLD: "beam off, slowing down on the path",
    Effect.CLEAR_MOTION: "at rest, clearing the controller",
    Effect.AWAIT_OPERATOR: "waiting for the operator, beam and powder off; then the run stops",
    Effect.OPEN_HOPPER: "gas post-flow; then the hopper may be opened",
    Effect.CLOSE_HOPPER: "weighing the refilled hopper",
    Effect.ACKNOWLEDGE: "acknowledging alarms",
    Effect.LEAVE_PART: "leaving the part for the purge position",
    Effect.REST_BEAM: "coming to rest, beam off",
    Effect.STOP_MOTION: "beam and motion off",
    Effect.POWDER_OFF: "powder off",
    Effect.GAS_OFF: "gas post-flow empties the hoses",
    Effect.GAS_OFF_NOW: "gas off, without post-flow",
}


class Phase(NamedTuple):
    """What a run does now.

    remaining_s : machine time until it is over, None where that is not known
    """

    description: str
    remaining_s: float | None


class PhaseClock:
    """Follows the effects of one run. held_at_most_s : a held run is stopped after so long"""

    def __init__(
        self, profile: MachineProfile, hoppers: Sequence[HopperSettings], powder_mode: str,
        held_at_most_s: float,
    ) -> None:
        of_feeder = [
            (feeder, of_it) for feeder in profile.feeder
            if (of_it := [h for h in hoppers if h.feeder == feeder.name])
        ]
        leads_s = (h.dead_time_s for h in hoppers if powder_mode == "lead")
        self.postflow_s = max((post_flow_duration_s(*used) for used in of_feeder), default=0.0)
        self._lasts_s = {
            Effect.GAS_ON: max((feeder.gas_preflow_s for feeder, _ in of_feeder), default=0.0),
            Effect.AWAIT_STABLE: profile.purge_measuring_s + max(
                (max(feeder.stabilise_s, settling_time_s(of_it)) for feeder, of_it in of_feeder),
                default=0.0),
            Effect.LEAD_POWDER: max(leads_s, default=0.0),
            Effect.AWAIT_OPERATOR: held_at_most_s,
            Effect.GAS_OFF: self.postflow_s, Effect.OPEN_HOPPER: self.postflow_s,
        }
        self._do: Effect | None = None
        self._since_t = 0.0

    def begin_effect(self, do: Effect, t: float) -> None:
        """An effect begins at t [s, of the loop's clock]."""
        self._do, self._since_t = do, t

    def current_phase(self, state: RunState, t: float) -> Phase:
        """What is done at t."""
        if self._do is None or state is RunState.DEPOSITING:
            return Phase(state.value, None)
        lasts_s = self._lasts_s.get(self._do)
        left_s = None if lasts_s is None else max(0.0, lasts_s - (t - self._since_t))
        return Phase(_WORDS[self._do], left_s)
