"""Check that this is the PMX feeder of the profile, before anything is written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from firmware_protocol.pmx import (
    DEVICE_ID,
    FIRST_MINOR_VERSION_WITH_MIRROR,
    MAP_MAJOR_VERSION,
    MAX_HOPPERS,
    PMX_MAP,
    SYSTEM_BLOCK,
    FeederStatusBits,
    hopper_register_name,
    recipe_register_names,
    register_map,
)
from firmware_protocol.pmx_alarms import FeederAlarm
from firmware_protocol.registers import RegisterValue, WordOrder
from lmctl.config.machine import FeederSettings, HopperSettings
from lmctl.errors import MachineError
from lmctl.machine.modbus.client import ModbusLink
from lmctl.machine.modbus.opening_retries import answer_with_retries
from lmctl.machine.modbus.word_order import address_base_hint, detect_word_order

#: A device that is busy is asked again after this [s].
_BUSY_PAUSE_S = 0.2
_NONE = FeederStatusBits(0)
_UPTIME = PMX_MAP.contiguous_block(["UPTIME"])


@dataclass(frozen=True)
class FeederIdentity:
    """heartbeat : the last one written to the device, by this host or an earlier one
    has_mirror : map 1.1, where one FC 23 request writes a recipe and reads the status back
    feed_factor_g_rev : what the device believes one turn of each used hopper's disc feeds
    device : the name of its register map, where that is not the PMX's; then map_version, firmware
        and serial say nothing
    unreported : status bits that it does not report
    alarms : its alarms by code, in words; empty for those of a PMX
    substitutions : what it lacks, and what takes its place: (feature, in words)
    reports_uptime : whether a restart of the device shows
    reports_tick : whether it stamps its data with a clock finer than seconds
    """

    map_version: tuple[int, int]
    firmware: tuple[int, int]
    serial: int
    n_hoppers: int
    heartbeat: int
    has_mirror: bool
    feed_factor_g_rev: Mapping[str, float]
    device: str = ""
    unreported: FeederStatusBits = _NONE
    alarms: Mapping[int, FeederAlarm] = field(default_factory=dict)
    substitutions: tuple[tuple[str, str], ...] = ()
    reports_uptime: bool = True
    reports_tick: bool = True


async def identify_feeder(
    link: ModbusLink, feeder: FeederSettings, hoppers: Sequence[HopperSettings]
) -> FeederIdentity:
    """Read what the device is.

    Raises MachineError where it is no PMX feeder of a known map, sends its words in another order,
    lacks a hopper of the profile, or cannot feed as much as the profile states.
    """
    place = [f"feeder {feeder.name}: {feeder.endpoint}, device {feeder.device_id}"]
    order = WordOrder(feeder.word_order)
    words = await answer_with_retries(
        lambda: link.read_input(SYSTEM_BLOCK.address, SYSTEM_BLOCK.count), _BUSY_PAUSE_S
    )
    values = SYSTEM_BLOCK.with_word_order(order).decode(words)
    if values["DEVICE_ID"] != DEVICE_ID:
        raise MachineError(
            f"the device for feeder {feeder.name} is no PMX feeder",
            where=[*place, f"its DEVICE_ID is {values['DEVICE_ID']}, not {DEVICE_ID}"],
            hint=address_base_hint(words, DEVICE_ID, feeder)
            or "check the feeder's endpoint and device_id in the machine profile",
        )
    major, minor = _pair(values["MAP_VERSION"])
    if major != MAP_MAJOR_VERSION:
        raise MachineError(
            f"feeder {feeder.name} speaks another register map",
            where=[*place, f"map {major}.{minor}; map {MAP_MAJOR_VERSION} is known here"],
            hint="this feeder needs another version of lmctl, or other firmware",
        )
    n_hoppers = _integer(values["N_HOPPERS"])
    missing = [h for h in hoppers if h.channel > n_hoppers]
    if missing or not 1 <= n_hoppers <= MAX_HOPPERS:
        raise MachineError(
            f"feeder {feeder.name} has {n_hoppers} hoppers",
            where=[*place, *(f"hopper {h.name} is on channel {h.channel}" for h in missing)],
            hint="check the hoppers' channels in the machine profile",
        )
    recipe_words = register_map(n_hoppers).contiguous_block(recipe_register_names(n_hoppers)).count
    if recipe_words > feeder.max_registers:
        raise MachineError(
            f"feeder {feeder.name} moves {feeder.max_registers} registers in one request, and a "
            f"recipe is {recipe_words}",
            where=place, hint="a recipe is one write, so that no mixture is half changed: raise "
            "max_registers in the machine profile if the device, and a gateway before it, take it",
        )
    factors = {h.name: await _feed_factor(link, h, place) for h in hoppers}
    counted = await detect_word_order(link, _UPTIME, order)
    if counted not in (None, order):
        raise MachineError(
            f"feeder {feeder.name} sends its 32-bit values in another word order",
            where=[*place, f"its uptime counts as {counted.value}, and {order.value} is expected"],
            hint=f'write word_order = "{counted.value}" for it into the machine profile',
        )
    return FeederIdentity(
        map_version=(major, minor),
        firmware=_pair(values["FW_VERSION"]),
        serial=_integer(values["SERIAL"]),
        n_hoppers=n_hoppers,
        heartbeat=_integer(values["HEARTBEAT_ECHO"]),
        has_mirror=minor >= FIRST_MINOR_VERSION_WITH_MIRROR,
        feed_factor_g_rev=factors,
    )


async def _feed_factor(link: ModbusLink, hopper: HopperSettings, place: list[str]) -> float:
    """The stored factor [g/rev]. Raises MachineError where the hopper cannot feed its maximum."""
    names = [hopper_register_name(hopper.channel, name) for name in ("FEED_FACTOR", "N_MIN",
                                                                     "N_MAX")]
    (block,) = PMX_MAP.plan_reads(names)
    values = block.decode(
        await answer_with_retries(lambda: link.read_holding(block.address, block.count),
                                  _BUSY_PAUSE_S)
    )
    factor, _, most_rpm = (float(values[name] or 0.0) for name in names)
    if factor * most_rpm < hopper.max_flow_g_min:
        raise MachineError(
            f"hopper {hopper.name} cannot feed {hopper.max_flow_g_min:g} g/min",
            where=[*place, f"channel {hopper.channel}: {factor:g} g/rev at most {most_rpm:g} rpm "
                           f"make {factor * most_rpm:.1f} g/min"],
            hint="lower its max_flow_g_min in the machine profile, or calibrate the feeder",
        )
    return factor


def _integer(value: RegisterValue) -> int:
    return value if isinstance(value, int) else 0


def _pair(value: RegisterValue) -> tuple[int, int]:
    return _integer(value) >> 8, _integer(value) & 0xFF
