"""Safety wiring of a cell: which devices receive door, e-stop chain and watchdog relay."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterable

from simulators.feeder.device import PmxFeederDevice
from simulators.motion.simulator import MotionSimulator
from simulators.safety.device import SimulatedSafetyDevice

#: Delay from an open safety circuit to beam off: a safe-off takes less than 50 ms.
LASER_OFF_DELAY_S = 0.02


class SafetyWiring:
    """Connects the safety device to the controller, the feeders and the laser.

    Door and relay are in series at the controller's door input. The e-stop chain is wired to the
    e-stop input of the controller and of every feeder; the relay, to the drives of those feeders
    that have no watchdog of their own. If so configured, all three and the
    laser-enable output also open the laser's own safety circuit. Works on the running loop's clock
    until closed.
    """

    def __init__(
        self, safety: SimulatedSafetyDevice, motion: MotionSimulator,
        feeders: Iterable[PmxFeederDevice], relay_feeders: Iterable[PmxFeederDevice] = (),
    ) -> None:
        self._safety = safety
        self._motion = motion
        self._feeders = tuple(feeders)
        self._relay_feeders = tuple(relay_feeders)
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._door = self._estop = self._relay = False
        safety.on_change = self._drive
        self._drive()

    def close(self) -> None:
        self._safety.on_change = lambda: None
        if self._timer is not None:
            self._timer.cancel()

    def _drive(self) -> None:
        """Set every input to the level of its wire, and schedule a check when the relay is due."""
        safety = self._safety
        door, estop = safety.is_door_open or safety.is_relay_open, safety.is_estop_open
        if estop != self._estop:
            self._estop = estop
            self._motion.set_estop(estop)
            for feeder in self._feeders:
                feeder.set_estop_open(estop)
        if safety.is_relay_open != self._relay:
            self._relay = safety.is_relay_open
            for feeder in self._relay_feeders:
                feeder.set_enable_open(self._relay)
        circuit = safety.config.laser_circuit
        if circuit or safety.config.laser_enable:
            is_cut = (circuit and (door or estop)) or safety.is_laser_enable_off
            self._motion.set_laser_circuit_open(is_cut, LASER_OFF_DELAY_S)
        if door != self._door:
            self._door = door
            self._motion.set_door(door)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        due_s = safety.next_due_s()
        if due_s < math.inf:
            self._timer = self._loop.call_at(due_s, self._look)

    def _look(self) -> None:
        """The relay is due: it opens, unless heartbeats have postponed it."""
        self._timer = None
        self._safety.advance_to_now()
        if self._timer is None:
            self._drive()
