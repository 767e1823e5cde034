"""A mapped feeder's registers in the words of a PMX, so that one driver reads both.

What a map does not have is "not available"; what a map declares missing is replaced as it says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from firmware_protocol.device_map import DeviceMap
from firmware_protocol.feeder_map import FeederMap, MappedCondition
from firmware_protocol.pmx import (
    DEVICE_ID,
    PMX_MAP,
    SYSTEM_BLOCK,
    FeederCommandBits,
    FeederMode,
    FeederStateCode,
    FeederStatusBits,
    HopperStatusBits,
    hopper_input_names,
)
from firmware_protocol.pmx_alarms import SETPOINT_CLIPPED_BIT, FeederAlarm
from firmware_protocol.registers import RegisterValue
from lmctl.config.feeders import FeederSettings
from lmctl.machine.feeder.mapped.outputs import FLOW, MappedOutputs
from lmctl.machine.feeder.mapped.registers import MappedRegisters, Place

_MAP_VERSION = 0x0101  # with the mirror: everything is read in one go
_MOST = 655.34
_MOST_AGE_MS = 65_535
#: Codes of alarms that a device shows by a bit and not by a code.
_FIRST_BIT_ALARM, _BARE_ALARM = 60_000, 59_999

#: A counter of seconds that has not moved for longer stands still.
_UPTIME_STEP_S = 1.5

Values = Mapping[Place, RegisterValue]


class MappedReadings:
    """Turns rows into words. places : of every row that status and hoppers need."""

    def __init__(
        self, registers: MappedRegisters, device: DeviceMap, feeder_map: FeederMap,
        feeder: FeederSettings, channels: Sequence[int],
    ) -> None:
        self._registers = registers
        self._device = device
        self._map = feeder_map
        self._feeder = feeder
        self._channels = tuple(channels)
        self._feeding_since_s: float | None = None
        self._uptime_s, self._uptime_since_s = -1.0, 0.0
        self._blocks = {channel: PMX_MAP.contiguous_block(hopper_input_names(channel))
                        for channel in self._channels}
        conditions = [*feeder_map.conditions.values(),
                      *(alarm.condition for alarm in feeder_map.alarms if alarm.condition)]
        hopper_names = [one.register for one in feeder_map.hopper_quantities.values()]
        names = [quantity.register for quantity in feeder_map.quantities.values()]
        names += [condition.register for condition in conditions]
        names += [feeder_map.applied] if feeder_map.applied else []
        # Low levels and clipped set-points are warnings of the device too.
        names += [one.register for one in feeder_map.hopper_conditions.values()]
        self.status_places = self._placed(names)
        self.hopper_places = self._placed([*names, *hopper_names])

    def _placed(self, names: Sequence[str]) -> tuple[Place, ...]:
        return tuple(dict.fromkeys(
            place for name in names for place in self._registers.places(name, self._channels)))

    def alarm_texts(self) -> dict[int, FeederAlarm]:
        """The alarms of the map by the codes that `system_words` reports."""
        texts = {_BARE_ALARM: FeederAlarm(_BARE_ALARM, "it reports an alarm",
                                          "see its own display")}
        for at, alarm in enumerate(self._map.alarms):
            code = _FIRST_BIT_ALARM + at if alarm.code is None else alarm.code
            texts[code] = FeederAlarm(code, alarm.text, alarm.remedy)
        return texts

    def unreported_flags(self) -> FeederStatusBits:
        """Status bits that this device does not report."""
        return FeederStatusBits(sum(
            bit for name, bit in (
                ("remote", FeederStatusBits.REMOTE),
                ("estop_closed", FeederStatusBits.ESTOP_CHAIN_OK),
                ("lids_closed", FeederStatusBits.LID_CLOSED),
                ("config_valid", FeederStatusBits.CONFIG_VALID),
                ("watchdog_tripped", FeederStatusBits.WATCHDOG_TRIPPED),
            ) if name not in self._map.conditions))

    def system_words(self, values: Values, outputs: MappedOutputs, now_s: float) -> list[int]:
        """The block of the whole device. now_s : loop time"""
        alarm = self._alarm_code(values)
        tripped = self._is("watchdog_tripped", values, otherwise=False)
        feeding = self._is("feeding", values, otherwise=outputs.is_feeding)
        gas_since_s = outputs.gas_since_s
        gas_ok = self._is("gas_ok", values,
                          otherwise=now_s - gas_since_s >= self._feeder.gas_preflow_s)
        stable = feeding and self._is("stable", values, otherwise=self._is_settled(
            feeding, outputs.stabilise_s, now_s))
        remote = self._is("remote", values,
                          otherwise=FeederCommandBits.ENABLE_REMOTE in outputs.command)
        estop_open = not self._is("estop_closed", values, otherwise=True)
        low = any(self._hopper_is("level_low", values, channel) for channel in self._channels)
        clipped = any(self._is_clipped(values, channel, outputs) for channel in self._channels)
        flags = (
            _flag(FeederStatusBits.READY, not alarm) | _flag(FeederStatusBits.REMOTE, remote)
            | _flag(FeederStatusBits.GAS_OK, gas_ok) | _flag(FeederStatusBits.FEEDING, feeding)
            | _flag(FeederStatusBits.STABLE, stable) | _flag(FeederStatusBits.ALARM, bool(alarm))
            | _flag(FeederStatusBits.WATCHDOG_TRIPPED, tripped)
            | _flag(FeederStatusBits.ESTOP_CHAIN_OK, not estop_open)
            | _flag(FeederStatusBits.LID_CLOSED, self._is("lids_closed", values, otherwise=True))
            | _flag(FeederStatusBits.CONFIG_VALID, self._is("config_valid", values, otherwise=True))
        )
        gas_ordered = FeederCommandBits.GAS_ON in outputs.command
        own_post_flow = "post_flow" not in self._map.missing and gas_ok and not gas_ordered
        state = (
            FeederStateCode.ESTOP if estop_open
            else FeederStateCode.FAULT if (alarm or tripped) and not feeding
            else FeederStateCode.FEEDING if feeding and stable
            else FeederStateCode.STABILISING if feeding
            else FeederStateCode.STOPPING if outputs.is_post_flowing or own_post_flow
            else FeederStateCode.GAS_PREFLOW if gas_ordered
            else FeederStateCode.READY if remote else FeederStateCode.NOT_READY
        )
        applied = outputs.applied
        if self._map.applied is not None:
            applied = int(_number(values.get((None, self._map.applied))) or 0)
        return SYSTEM_BLOCK.encode({
            **dict.fromkeys((row.name for row in SYSTEM_BLOCK.rows), 0),
            "DEVICE_ID": DEVICE_ID, "MAP_VERSION": _MAP_VERSION,
            "N_HOPPERS": self._device.hoppers, "STATUS": int(flags),
            "WARNING": int(low) | (SETPOINT_CLIPPED_BIT if clipped else 0),
            "FIRST_ALARM_CODE": alarm, "HEARTBEAT_AGE": _MOST_AGE_MS,
            "UPTIME": int(self._quantity("uptime_s", values) or 0),
            "MODE": int(FeederMode.REMOTE), "STATE": int(state), "TOTAL_FLOW": None,
            "MIXER_PRESSURE": _clipped(self._quantity("mixer_pressure_mbar", values), 32_000),
            "TOTAL_GAS": _clipped(self._quantity("total_gas_L_min", values), _MOST),
            "SUPPLY_PRESSURE": None, "SEQ_APPLIED": applied & 0xFFFF,
            "LAST_REFUSAL": int(self._quantity("refusal_code", values) or 0) & 0xFFFF,
            "TICK": self._tick_ms(values, now_s) & 0xFFFF,
        })

    def hopper_words(
        self, channel: int, values: Values, outputs: MappedOutputs, *, feeding: bool
    ) -> list[int]:
        """The block of one hopper in use."""
        weighed = self._hopper_quantity("weighed_flow_g_min", values, channel)
        refilling = FeederCommandBits.REFILL_HOLD in outputs.command
        if "refilling" in self._map.hopper_conditions:
            refilling = self._hopper_is("refilling", values, channel)
        # Without a reading, a hopper is taken to be under pressure for as long as gas flows.
        pressurised = outputs.gas_since_s < float("inf")
        if "pressurised" in self._map.hopper_conditions:
            pressurised = self._hopper_is("pressurised", values, channel)
        low = self._hopper_is("level_low", values, channel)
        flags = (
            HopperStatusBits.PRESENT | HopperStatusBits.ENABLED
            | _hopper_flag(HopperStatusBits.RUNNING, feeding)
            | _hopper_flag(HopperStatusBits.LEVEL_LOW, low)
            | _hopper_flag(HopperStatusBits.LEVEL_EMPTY, self._hopper_is("empty", values, channel))
            | _hopper_flag(HopperStatusBits.REFILLING, refilling)
            | _hopper_flag(HopperStatusBits.PRESSURISED, pressurised)
            | _hopper_flag(HopperStatusBits.LIW_VALID, weighed is not None and not refilling)
            | _hopper_flag(HopperStatusBits.LIMITED, self._is_clipped(values, channel, outputs))
        )
        # As of a PMX: what the disc is asked to feed now, and nothing while powder is off.
        setpoint = self._hopper_quantity(FLOW, values, channel) if feeding else 0.0
        reported = {
            "STATUS": int(flags), "ALARM": 0,
            # A device that is set in g/min is a disc that feeds 1 g in a turn.
            "DISC_RAMPED": _clipped(max(setpoint or 0.0, 0.0), _MOST),
            "FLOW_EST": _clipped(self._hopper_quantity("flow_g_min", values, channel), _MOST),
            "FLOW_LIW": _clipped(weighed, _MOST),
            "WEIGHT": self._hopper_quantity("weight_g", values, channel),
            "LEVEL": _clipped(self._hopper_quantity("level_percent", values, channel), 100.0),
            "CARRIER_ACT": _clipped(self._hopper_quantity("carrier_L_min", values, channel), _MOST),
        }
        block = self._blocks[channel]
        return block.encode({row.name: reported.get(row.name.partition(".")[2])
                             for row in block.rows})

    def is_feeding(self, system: Sequence[int]) -> bool:
        """Whether powder runs, by the words of the device."""
        state = SYSTEM_BLOCK.decode(system)["STATE"]
        return state in (FeederStateCode.STABILISING, FeederStateCode.FEEDING)

    def _is_settled(self, feeding: bool, stabilise_s: float, now_s: float) -> bool:
        """Whether powder has run for its time, where the device does not say so itself."""
        if not feeding:
            self._feeding_since_s = None
        elif self._feeding_since_s is None:
            self._feeding_since_s = now_s
        return self._feeding_since_s is not None and now_s - self._feeding_since_s >= stabilise_s

    def _tick_ms(self, values: Values, now_s: float) -> int:
        """A time stamp that stands still when the device's data do.

        One of seconds only moves on with this host's clock until the next is due. Where the device
        has no clock at all, which the map declares, this host's takes its place.
        """
        if (tick_ms := self._quantity("tick_ms", values)) is not None:
            return int(tick_ms)
        uptime_s = self._quantity("uptime_s", values)
        if uptime_s is None:
            return int(now_s * 1000)
        if uptime_s != self._uptime_s:
            self._uptime_s, self._uptime_since_s = uptime_s, now_s
        return int(1000 * (uptime_s + min(now_s - self._uptime_since_s, _UPTIME_STEP_S)))

    def _alarm_code(self, values: Values) -> int:
        code = int(self._quantity("alarm_code", values) or 0)
        if code:
            return code
        for at, alarm in enumerate(self._map.alarms):
            if alarm.condition is not None and self._met(alarm.condition, values):
                return _FIRST_BIT_ALARM + at
        return _BARE_ALARM if self._is("alarm", values, otherwise=False) else 0

    def _is(self, name: str, values: Values, *, otherwise: bool) -> bool:
        condition = self._map.conditions.get(name)
        return otherwise if condition is None else self._met(condition, values)

    def _met(self, condition: MappedCondition, values: Values) -> bool:
        found = [condition.is_met(values[place])
                 for place in self._registers.places(condition.register, self._channels)]
        return all(found) if condition.of_all else any(found)

    def _hopper_is(self, name: str, values: Values, channel: int) -> bool:
        condition = self._map.hopper_conditions.get(name)
        return condition is not None and condition.is_met(values[channel, condition.register])

    def _is_clipped(self, values: Values, channel: int, outputs: MappedOutputs) -> bool:
        """Whether a hopper feeds less than is set: by the device, or by the limits of its map."""
        return channel in outputs.clipped_channels or self._hopper_is("clipped", values, channel)

    def _quantity(self, name: str, values: Values) -> float | None:
        quantity = self._map.quantities.get(name)
        return None if quantity is None else quantity.from_register(values[None, quantity.register])

    def _hopper_quantity(self, name: str, values: Values, channel: int) -> float | None:
        quantity = self._map.hopper_quantities.get(name)
        return None if quantity is None else quantity.from_register(
            values[channel, quantity.register])


def _flag(flag: FeederStatusBits, on: bool) -> FeederStatusBits:
    return flag if on else FeederStatusBits(0)


def _hopper_flag(flag: HopperStatusBits, on: bool) -> HopperStatusBits:
    return flag if on else HopperStatusBits(0)


def _number(value: RegisterValue) -> float | None:
    return value if isinstance(value, int | float) else None


def _clipped(value: float | None, most: float) -> float | None:
    """Within what the word holds."""
    return None if value is None else min(max(value, -most if most > 1000 else 0.0), most)


