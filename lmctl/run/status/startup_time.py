"""How long a run still takes to get ready for its lines: gas, powder, and powder led up to them."""

from __future__ import annotations

from collections.abc import Sequence

from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.machine.feeder.recipe import settling_time_s
from lmctl.run.state.transitions import RunState

#: Of each state before lines run: what it waits for itself, and what is waited for after it.
#: A held run goes through all of it once it is resumed.
_GAS, _POWDER, _LEAD, _CONNECT = range(4)
#: Devices are watched until their uptime counts: a second at most (machine.modbus.word_order).
_CONNECT_S = 1.0
_AHEAD: dict[str, tuple[tuple[int, ...], tuple[int, ...]]] = {
    **dict.fromkeys((RunState.READY, RunState.CONNECTING), ((_CONNECT,), (_GAS, _POWDER, _LEAD))),
    **dict.fromkeys(
        (RunState.CHECKING, RunState.HOLDING, RunState.HELD, RunState.OPENING, RunState.REFILLING,
         RunState.WEIGHING), ((), (_GAS, _POWDER, _LEAD))),
    RunState.GAS: ((_GAS,), (_POWDER, _LEAD)),
    RunState.POWDER: ((_POWDER,), (_LEAD,)),
    RunState.PURGING: ((_GAS, _POWDER), (_LEAD,)),
    RunState.ARMED: ((_LEAD,), ()),
    RunState.RESUMING: ((_LEAD,), ()),
}


class StartupTime:
    """The waits that the profile sets for a run. Moves and device delays come on top."""

    def __init__(
        self, profile: MachineProfile, hoppers: Sequence[HopperSettings], powder_mode: str
    ) -> None:
        feeders = {
            feeder: [h for h in hoppers if h.feeder == feeder.name] for feeder in profile.feeder
        }
        used = {feeder: of_it for feeder, of_it in feeders.items() if of_it}
        self._waits_s = (
            max((feeder.gas_preflow_s for feeder in used), default=0.0),
            profile.purge_measuring_s + max(
                (max(feeder.stabilise_s, settling_time_s(of_it)) for feeder, of_it in used.items()),
                default=0.0),
            max((h.dead_time_s for h in hoppers), default=0.0) if powder_mode == "lead" else 0.0,
            _CONNECT_S,
        )
        self._seen = ("", 0.0)

    def remaining_s(self, state: str, t: float) -> float:
        """Machine time until lines run; 0 where they run, or never will.

        A state's own wait counts down from the first call in that state.
        """
        if state != self._seen[0]:
            self._seen = (state, t)
        own, later = _AHEAD.get(state, ((), ()))
        left_s = max(0.0, sum(self._waits_s[wait] for wait in own) - (t - self._seen[1]))
        return left_s + sum(self._waits_s[wait] for wait in later)
