"""One look at a feeder, or at the safety device: registers are read, and none is written."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from firmware_protocol.pmx import PMX_MAP, SYSTEM_BLOCK, hopper_register_name
from firmware_protocol.registers import RegisterError, WordOrder
from firmware_protocol.safety_io import CYCLIC_BLOCK, mirror_address_of
from lmctl.config.machine import FeederSettings, HopperSettings, SafetySettings
from lmctl.config.modbus_device import ModbusDevice
from lmctl.errors import MachineError
from lmctl.machine.feeder.feeder_link import (
    FeederLink,
    IdentifiedFeederLink,
    identify_by_map,
    open_feeder_link,
)
from lmctl.machine.feeder.identity import FeederIdentity
from lmctl.machine.feeder.readings import HopperReader
from lmctl.machine.feeder.status import FeederStatus, read_feeder_status
from lmctl.machine.feeder.warnings import WarningReader
from lmctl.machine.modbus.client import (
    ModbusExceptionError,
    ModbusLink,
    NoReplyError,
    PassingExceptionError,
)
from lmctl.machine.modbus.probe import probe_other_settings
from lmctl.machine.safety.identity import describe_device
from lmctl.machine.safety.identity import identify_safety_device as identify_safety
from lmctl.machine.safety.status import SafetyStatus, read_safety_status

_TIMEOUT_S = 1.0
#: Between the two readings that show whether the device's clock runs.
_BETWEEN_S = 0.5
_TICKS = 65_536
_LIMITS = ("N_MIN", "N_MAX", "CARRIER_MIN", "CARRIER_MAX", "LEVEL_WARN", "LEVEL_STOP")


@dataclass(frozen=True)
class FeederInspection:
    """What a feeder reports about itself.

    clock_ratio : how far its clock moved while ours moved by 1; 0 for data that do not change
    hopper_limits : of each hopper of the profile, by name: N_MIN, N_MAX [rpm], CARRIER_MIN,
        CARRIER_MAX [L/min], LEVEL_WARN, LEVEL_STOP [%]
    reply_time_s : time of one exchange
    """

    identity: FeederIdentity
    status: FeederStatus
    clock_ratio: float
    hopper_limits: Mapping[str, Mapping[str, float]]
    reply_time_s: float


async def inspect_feeder(feeder: FeederSettings,
                         hoppers: Sequence[HopperSettings]) -> FeederInspection:
    """Read a feeder's identity and state.

    Raises MachineError where it is unreachable, no PMX, or lacks what the profile states;
    ConfigError for a bad endpoint.
    """
    try:
        link = await open_feeder_link(feeder, hoppers, _TIMEOUT_S)
        try:
            return await _read_feeder(link, feeder, hoppers)
        finally:
            await link.close()
    except NoReplyError as error:
        place = f"{feeder.endpoint}, device {feeder.device_id}"
        raise await _with_neighbours(f"feeder {feeder.name}", error, place, feeder) from error
    except ModbusExceptionError as error:
        raise MachineError(
            f"feeder {feeder.name}: {error.what}",
            where=f"{feeder.endpoint}, device {feeder.device_id}", hint=error.hint,
        ) from error
    except RegisterError as error:
        raise MachineError(f"feeder {feeder.name}: its answer makes no sense: {error}",
                           hint="is it a PMX?") from error


async def _read_feeder(
    link: ModbusLink | IdentifiedFeederLink, feeder: FeederSettings,
    hoppers: Sequence[HopperSettings],
) -> FeederInspection:
    loop = asyncio.get_running_loop()
    identity = await identify_by_map(link, feeder, hoppers)
    warnings = WarningReader(
        feeder.name, {h.channel: h.name for h in hoppers}, identity.n_hoppers,
        alarms=identity.alarms, substitutions=identity.substitutions,
    )
    order = WordOrder(feeder.word_order)
    before = await _status(link, {}, warnings, order)
    readings, limits = {}, {}
    for hopper in hoppers:
        reader = HopperReader(hopper, identity.feed_factor_g_rev[hopper.name], order)
        words = await link.read_input(reader.address, reader.count)
        readings[hopper.name] = reader.decode_reading(words, loop.time())
        if not isinstance(link, ModbusLink):
            continue  # limits of a device with its own map are in the map
        (block,
         ) = PMX_MAP.plan_reads([hopper_register_name(hopper.channel, name) for name in _LIMITS])
        values: dict[str, Any] = block.decode(await link.read_holding(block.address, block.count))
        limits[hopper.name] = {
            name: float(values[hopper_register_name(hopper.channel,
                                                    name)] or 0.0) for name in _LIMITS
        }
    await asyncio.sleep(_BETWEEN_S)
    asked_s = loop.time()
    after = await _status(link, readings, warnings, order)
    moved_s = (after.tick_ms - before.tick_ms) % _TICKS / 1000.0
    return FeederInspection(
        identity, after, moved_s / (after.time_s - before.time_s), limits, loop.time() - asked_s
    )


async def _status(
    link: FeederLink, readings: Mapping[str, Any], warnings: WarningReader, order: WordOrder
) -> FeederStatus:
    words = await link.read_input(SYSTEM_BLOCK.address, SYSTEM_BLOCK.count)
    try:
        return read_feeder_status(
            words, asyncio.get_running_loop().time(), readings, warnings, order)
    except ValueError as error:
        raise RegisterError(str(error)) from error


async def inspect_safety(safety: SafetySettings) -> SafetyStatus:
    """Read the state of the cell's safety circuits from the safety device.

    Raises MachineError where it is unreachable or not what the profile means; ConfigError for a
    bad endpoint.
    """
    try:
        link = await ModbusLink.open(safety, timeout_s=_TIMEOUT_S, mirror=mirror_address_of)
        try:
            await identify_safety(link, safety)
            words = await link.read_input(CYCLIC_BLOCK.address, CYCLIC_BLOCK.count)
            return read_safety_status(words, asyncio.get_running_loop().time(), safety)
        finally:
            await link.close()
    except NoReplyError as error:
        raise await _with_neighbours("safety device", error, describe_device(safety),
                                     safety) from error
    except ModbusExceptionError as error:
        raise MachineError(
            f"safety device: {error.what}", where=describe_device(safety), hint=error.hint
        ) from error


async def _with_neighbours(
    name: str, error: NoReplyError, place: str, device: ModbusDevice
) -> MachineError:
    """The error for a silent device, with what answers at other ids or other line settings."""
    found = None if isinstance(error, PassingExceptionError) else await probe_other_settings(device)
    if found is None:
        return MachineError(f"{name}: {error.what}", where=place, hint=error.hint)
    return MachineError(
        f"{name}: {error.what}; {found.sentence}", where=place, hint=found.hint)
