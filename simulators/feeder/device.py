"""The PMX device: commands, recipes, watchdog and alarms.

Source: docs/explanation/powder-delivery.md, Feeders.

The device stores events (gas on since, discs on since, latched alarms); its STATE follows from
them. Nothing runs between requests: `advance_to_now` carries out what fell due since the last one,
each at its exact time. The watchdog therefore trips at its timeout, even if the next request comes
later.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from firmware_protocol.pmx import (
    ALARM_RESET_KEY,
    WATCHDOG_RESET_KEY,
    FeederCommandBits,
    FeederStateCode,
    SetpointMode,
    WatchdogAction,
    WriteRefusalCode,
    hopper_register_name,
)
from firmware_protocol.pmx_alarms import EMPTY, ESTOP, WATCHDOG, hopper_alarm_code
from simulators.feeder.alarms import AlarmLatch
from simulators.feeder.config import FeederConfig
from simulators.feeder.holding_registers import HoldingRegisters
from simulators.feeder.hopper import FeedInterval, SimulatedHopper
from simulators.feeder.injected_defects import InjectedDefects
from simulators.feeder.write_permissions import (
    ALARM_RESET_ADDRESS,
    COMMAND_ADDRESS,
    WATCHDOG_RESET_ADDRESS,
    reason_refused,
)
from simulators.modbus_errors import BUSY, REFUSED, ExceptionReplyError

#: How often a slope that drifts is brought up to date while discs turn.
_DRIFT_STEP_S = 10.0


class PmxFeederDevice:
    """One device. now : the simulation's clock.

    hoppers : by channel. spans : when powder was fed, oldest first.
    gas : (time, whether carrier gas flows from then on)
    defects : injected defects, if any
    local : the switch is at LOCAL; estop_open : the emergency-stop chain is open
    enable_open : the circuit that lets the drives run is open
    """

    def __init__(self, config: FeederConfig, now: Callable[[], float]) -> None:
        self.config = config
        self.now = now
        self.holding = HoldingRegisters(config)
        self.hoppers = {h.channel: SimulatedHopper.from_config(h) for h in config.hoppers}
        self.defects: InjectedDefects | None = None
        self.gas: list[tuple[float, bool]] = []
        self.gas_since_s = math.inf
        self.alarms = AlarmLatch()
        self.spans: list[FeedInterval] = []
        self.local = False
        self.estop_open = self.enable_open = False
        self._power_up(now())

    def _power_up(self, time_s: float) -> None:
        self.powered_s = time_s
        self.holding.reset_volatile()
        self.command = FeederCommandBits(0)
        self.alarms = AlarmLatch()
        self.refusal = WriteRefusalCode.NONE
        self.heartbeat_s = time_s
        self.watchdog_tripped = False
        self._gas_off(time_s)
        self._starting_s = math.inf  # discs are to start: powder waits for the gas pre-flow
        self._drift_due_s = math.inf
        self.discs_on = False
        self.discs_off_s = -math.inf
        self.seq_applied = 0

    # --- operator actions

    def restart(self) -> None:
        """Switch power off and on: discs stop, volatile state is lost."""
        time_s = self.advance_to_now()
        self._stop_discs(time_s)
        self._power_up(time_s)

    def set_local_mode(self, local: bool) -> None:
        """Turn the LOCAL/REMOTE switch; LOCAL ends the host's commands."""
        time_s = self.advance_to_now()
        self.local = local
        if local:
            self._obey(FeederCommandBits(0), time_s)

    def set_max_disc_rpm(self, channel: int, most_rpm: float) -> None:
        """Set the highest speed of a disc; it takes effect at once."""
        time_s = self.advance_to_now()
        self.holding.set_raw_word(hopper_register_name(channel, "N_MAX"), round(100 * most_rpm))
        self._commit(time_s)

    def set_estop_open(self, is_open: bool) -> None:
        time_s = self.advance_to_now()
        self.estop_open = is_open
        if is_open:
            self._fault(ESTOP, time_s, gas_off=True)

    def set_enable_open(self, is_open: bool) -> None:
        """Open the circuit that lets the drives run: discs stop, and wait for a new command."""
        time_s = self.advance_to_now()
        self.enable_open = is_open
        if is_open:
            self._obey(self.command & ~FeederCommandBits.FEED_ON, time_s)

    def raise_alarm(self, code: int) -> None:
        """Raise an alarm and stop powder."""
        self._fault(code, self.advance_to_now(), gas_off=code == ESTOP)

    def trip_watchdog(self) -> None:
        """Trip the watchdog, regardless of the host."""
        self._trip(self.advance_to_now())

    # --- state

    def is_stable(self, time_s: float) -> bool:
        return self.discs_on and time_s >= self.spans[-1].stable_s

    def is_gas_flowing(self, time_s: float) -> bool:
        return self.gas_since_s <= time_s

    def is_gas_ok(self, time_s: float) -> bool:
        return self.gas_since_s + self.config.preflow_s <= time_s

    def is_booting(self, time_s: float) -> bool:
        return time_s < self.powered_s + self.config.boot_s

    def state(self, time_s: float) -> FeederStateCode:
        """STATE after `advance_to_now`."""
        if self.is_booting(time_s):
            return FeederStateCode.BOOT
        if self.estop_open or ESTOP in self.alarms:
            return FeederStateCode.ESTOP
        if self.alarms and not self.discs_on:
            return FeederStateCode.FAULT
        if self.discs_on:
            return FeederStateCode.FEEDING if self.is_stable(
                time_s) else FeederStateCode.STABILISING
        if time_s < self._postflow_ends_s():
            return FeederStateCode.STOPPING
        if self.is_gas_flowing(time_s):
            return FeederStateCode.GAS_PREFLOW
        if FeederCommandBits.ENABLE_REMOTE in self.command:
            return FeederStateCode.READY
        return FeederStateCode.NOT_READY

    def _postflow_ends_s(self) -> float:
        return self.discs_off_s + self.holding["POSTFLOW"]

    # --- time

    def advance_to_now(self) -> float:
        """Carry out everything due until now; returns now."""
        now_s = self.now()
        while (due_s := self._next_due_s()) <= now_s:
            self._do_due(due_s)
        if FeederCommandBits.GAS_ON not in self.command and now_s >= self._postflow_ends_s():
            self._gas_off(self._postflow_ends_s())
        return now_s

    def _next_due_s(self) -> float:
        """When something happens by itself: discs start, the watchdog trips, a hopper is empty."""
        due_s = min(self._starting_s, self._watchdog_s(), self._drift_due_s)
        for hopper in self.hoppers.values():
            if hopper.process.empty_s < due_s and self._empty_code(hopper) not in self.alarms:
                due_s = hopper.process.empty_s
        return due_s

    def _do_due(self, due_s: float) -> None:
        if self._starting_s == due_s:
            self._start_discs(due_s)
            return
        if self._drift_due_s == due_s:
            self._drift_due_s += _DRIFT_STEP_S
            for hopper in self.hoppers.values():
                if hopper.config.slope_drifts:
                    hopper.process.follow_drift(due_s)
            return
        for hopper in self.hoppers.values():
            code = self._empty_code(hopper)
            if hopper.process.empty_s == due_s and code not in self.alarms:
                self._fault(code, due_s, gas_off=False)
                return
        self._trip(due_s)

    @staticmethod
    def _empty_code(hopper: SimulatedHopper) -> int:
        return hopper_alarm_code(hopper.config.channel, EMPTY)

    def _watchdog_s(self) -> float:
        """When the host's silence trips the watchdog; it watches while the host is in command."""
        watches = self.config.has_watchdog and FeederCommandBits.ENABLE_REMOTE in self.command
        if self.watchdog_tripped or not watches:
            return math.inf
        return self.heartbeat_s + self.holding.raw_word("WD_TIMEOUT") / 1000.0

    def _trip(self, time_s: float) -> None:
        self.watchdog_tripped = True
        action = self.holding.raw_word("WD_ACTION")
        if action == WatchdogAction.HOLD:
            self.alarms.latch(WATCHDOG)
        else:
            self._fault(WATCHDOG, time_s, gas_off=action == WatchdogAction.ALL_STOP)

    def _fault(self, code: int, time_s: float, *, gas_off: bool) -> None:
        """Latch an alarm and stop powder; nothing starts again without a new command."""
        self.alarms.latch(code)
        kept = FeederCommandBits.ENABLE_REMOTE
        if not gas_off:
            kept |= FeederCommandBits.GAS_ON
        self._stop_discs(time_s)
        self._take(self.command & kept)
        if gas_off:
            self._gas_off(time_s)
            self.discs_off_s = -math.inf

    def _gas_on(self, time_s: float) -> None:
        if self.gas_since_s == math.inf:
            self.gas.append((time_s, True))
        self.gas_since_s = min(self.gas_since_s, time_s)

    def _gas_off(self, time_s: float) -> None:
        if self.gas_since_s < math.inf:
            self.gas.append((max(time_s, self.gas[-1][0]), False))
        self.gas_since_s = math.inf

    # --- requests

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write holding registers: all of them, or none.

        Raises ExceptionReplyError, with the reason for code 4 in LAST_REFUSAL.
        """
        time_s = self.advance_to_now()
        if self.is_booting(time_s):
            raise ExceptionReplyError(BUSY)
        new = dict(enumerate(words, address))
        self.holding.check_write(new)
        if refusal := reason_refused(self, new):
            self.refusal = refusal
            raise ExceptionReplyError(REFUSED)
        sequence, heartbeat = self.holding.raw_word("SEQ"), self.holding.raw_word("HEARTBEAT")
        self.holding.store(new)
        if self.holding.raw_word("HEARTBEAT") != heartbeat:
            self.heartbeat_s = time_s
        if new.get(WATCHDOG_RESET_ADDRESS) == WATCHDOG_RESET_KEY:
            self.watchdog_tripped = False
        if new.get(ALARM_RESET_ADDRESS) == ALARM_RESET_KEY:
            self.alarms.clear()
        self.holding.set_raw_word("WD_RESET", 0)
        self.holding.set_raw_word("ALARM_RESET", 0)
        if self.holding.raw_word("SEQ") != sequence:
            self._commit(time_s)
        if COMMAND_ADDRESS in new:
            wanted = FeederCommandBits(new[COMMAND_ADDRESS])
            if FeederCommandBits.ENABLE_REMOTE in wanted & ~self.command:
                self.heartbeat_s = time_s  # the host's time starts when it takes command
            self._obey(wanted, time_s)

    def _take(self, command: FeederCommandBits) -> None:
        self.command = command
        self.holding.set_raw_word("COMMAND", int(command))

    def alarm_cause_persists(self) -> bool:
        """Whether the cause of an alarm persists, after `advance_to_now`."""
        if self.defects is not None and self.defects.causes:
            return True
        return any(hopper.process.empty_s <= self.now() for hopper in self.hoppers.values())

    def _obey(self, command: FeederCommandBits, time_s: float) -> None:
        self._take(command)
        feed = FeederCommandBits.FEED_ON in command and not (
            FeederCommandBits.STOP in command or self.enable_open)
        if not feed:
            self._stop_discs(time_s)
        if FeederCommandBits.GAS_ON in command:
            self._gas_on(time_s)
        elif time_s >= self._postflow_ends_s():
            self._gas_off(time_s)
        if feed and not self.discs_on and self._starting_s == math.inf:
            self._starting_s = max(time_s, self.gas_since_s + self.config.preflow_s)
            self.advance_to_now()

    def _start_discs(self, time_s: float) -> None:
        self._starting_s = math.inf
        self.discs_on = True
        self.spans.append(FeedInterval(time_s, time_s + self.holding["STABILISE"], math.inf))
        if any(hopper.config.slope_drifts for hopper in self.hoppers.values()):
            self._drift_due_s = time_s + _DRIFT_STEP_S
        for hopper in self.hoppers.values():
            hopper.start_disc(time_s, self.holding["RAMP"])

    def _stop_discs(self, time_s: float) -> None:
        self._starting_s = self._drift_due_s = math.inf
        if self.discs_on:
            self.discs_on = False
            for hopper in self.hoppers.values():
                hopper.stop(time_s)
            self.spans[-1] = FeedInterval(self.spans[-1].start_s, self.spans[-1].stable_s, time_s)
            self.discs_off_s = time_s

    def _commit(self, time_s: float) -> None:
        """Make the whole shadow block the running recipe."""
        ignored = self.defects is not None and self.defects.ignores_recipes
        if not ignored:
            self.seq_applied = self.holding.raw_word("SEQ")
        by_flow = self.holding.raw_word("SETPOINT_MODE") == SetpointMode.G_MIN
        ramp_s = self.holding["RAMP"]
        for channel, hopper in self.hoppers.items():
            if by_flow:
                flow_g_min = self.holding[hopper_register_name(channel, "FLOW_SP")]
                rpm = flow_g_min / self.holding[hopper_register_name(channel, "FEED_FACTOR")]
            else:
                rpm = self.holding[hopper_register_name(channel, "DISC_SP")]
            most_rpm = self.holding[hopper_register_name(channel, "N_MAX")]
            if ignored:
                if self.discs_on:
                    hopper.fault_free_process.command_rpm(time_s, min(rpm, most_rpm), ramp_s)
                continue
            hopper.apply_setpoint(rpm, most_rpm)
            hopper.set_carrier(
                time_s, self.holding[hopper_register_name(channel, "CARRIER_SP")])
            hopper.stirrer_rpm = self.holding[hopper_register_name(channel, "STIRRER_SP")]
            if self.discs_on:
                hopper.start_disc(time_s, ramp_s)
