"""A feeder with a register map of its own, as a link to a PMX: one driver drives both.

Requests come in the registers of a PMX. Recipe and command are carried out by `outputs`, and what
is read is put into the words of a PMX by `readings`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from firmware_protocol.device_map import DeviceMap
from firmware_protocol.pmx import (
    MIRROR_ADDRESS,
    SYSTEM_BLOCK,
    FeederCommandBits,
    hopper_register_name,
    mirror_offset,
    recipe_register_names,
    register_map,
)
from firmware_protocol.registers import MAX_READ_REGISTERS, RegisterError, RegisterValue
from lmctl.config.feeders import FeederSettings, HopperSettings
from lmctl.errors import MachineError
from lmctl.machine.feeder.identity import FeederIdentity
from lmctl.machine.feeder.mapped.outputs import MappedOutputs
from lmctl.machine.feeder.mapped.readings import MappedReadings
from lmctl.machine.feeder.mapped.registers import MappedRegisters
from lmctl.machine.modbus.client import ModbusLink
from lmctl.machine.modbus.observation import WireObservation
from lmctl.machine.modbus.opening_retries import answer_with_retries

_BUSY_PAUSE_S = 0.2
_HOPPER_STRIDE = 100


class MappedFeederLink:
    """A connection to one device, by its map.

    hoppers : those of the profile that are on it
    """

    def __init__(
        self, link: ModbusLink, device: DeviceMap, feeder: FeederSettings,
        hoppers: Sequence[HopperSettings],
    ) -> None:
        assert device.feeder is not None, "profiles are checked for that"
        self._link = link
        self._device = device
        self._feeder = feeder
        channels = sorted(hopper.channel for hopper in hoppers)
        self._channels = channels
        self._names = [hopper.name for hopper in hoppers]
        self._registers = MappedRegisters(link, device)
        self._outputs = MappedOutputs(self._registers, device, device.feeder, feeder, channels)
        self._readings = MappedReadings(self._registers, device, device.feeder, feeder, channels)
        table = register_map(device.hoppers)
        self._recipe = table.contiguous_block(recipe_register_names(device.hoppers))
        self._addresses = {name: table.wire_address(name)
                           for name in ("COMMAND", "WD_RESET", "POSTFLOW", "LAST_REFUSAL")}
        self._loop = asyncio.get_running_loop()
        # What is one request to a PMX is several here: none may come between them.
        self._one_at_a_time = asyncio.Lock()

    @classmethod
    async def open(
        cls, feeder: FeederSettings, device: DeviceMap, hoppers: Sequence[HopperSettings],
        timeout_s: float,
    ) -> MappedFeederLink:
        """Connect. Raises ConfigError for a bad endpoint, MachineError where it is not reached."""
        limited = feeder.model_copy(update={
            "max_registers": min(feeder.max_registers, device.max_registers),
            "function_codes": tuple(
                code for code in feeder.function_codes if code in device.function_codes),
        })
        return cls(await ModbusLink.open(limited, timeout_s=timeout_s), device, feeder, hoppers)

    @property
    def wire_observation(self) -> WireObservation:
        """What has come since the last good answer."""
        return self._link.wire_observation

    async def identify(self) -> FeederIdentity:
        """Read what the device is. Raises MachineError where it is another."""
        place = f"{self._feeder.endpoint}, device {self._feeder.device_id}"
        identity, device = self._device.identity, self._device
        if identity is not None:
            found = await self._retried(identity.register)
            if found != identity.value:
                raise MachineError(
                    f"the device for feeder {self._feeder.name} is no {device.name}",
                    where=[place, f"its {identity.register} is {found}, not {identity.value}"],
                    hint="check endpoint, device_id and map of the feeder in the machine profile",
                )
        feeder_map = device.feeder
        assert feeder_map is not None
        return FeederIdentity(
            map_version=(1, 1), firmware=(0, 0), serial=0, n_hoppers=device.hoppers, heartbeat=0,
            has_mirror=True,
            feed_factor_g_rev=dict.fromkeys(self._names, 1.0),
            device=device.name, unreported=self._readings.unreported_flags(),
            alarms=self._readings.alarm_texts(), substitutions=tuple(feeder_map.substitutions()),
            reports_uptime="uptime_s" in feeder_map.quantities,
            reports_tick="tick_ms" in feeder_map.quantities,
        )

    async def read_input(self, address: int, count: int) -> Sequence[int]:
        """The PMX input registers of the device, or of one hopper."""
        async with self._one_at_a_time:
            await self._outputs.advance()
            if address < _HOPPER_STRIDE:
                return (await self._system())[address : address + count]
            channel, first = divmod(address, _HOPPER_STRIDE)
            values = await self._registers.read(self._readings.hopper_places)
            system = self._readings.system_words(values, self._outputs, self._loop.time())
            words = self._readings.hopper_words(
                channel, values, self._outputs, feeding=self._readings.is_feeding(system))
            return words[first : first + count]

    async def write(self, address: int, words: Sequence[int]) -> None:
        """Heartbeat or recipe, command, reset of alarms, or the end of the post-flow."""
        async with self._one_at_a_time:
            await self._write(address, words)

    async def exchange(
        self, write_address: int, words: Sequence[int], read_address: int, count: int
    ) -> Sequence[int]:
        """Write, then read in the mirror of the input registers."""
        first = read_address - MIRROR_ADDRESS
        assert 0 <= first < MAX_READ_REGISTERS, "only the mirror is read in an exchange"
        async with self._one_at_a_time:
            await self._write(write_address, words)
            return (await self._mirror(first + count))[first:]

    async def _write(self, address: int, words: Sequence[int]) -> None:
        await self._outputs.advance()
        if address == self._addresses["COMMAND"]:
            await self._outputs.set_command(FeederCommandBits(words[0]))
        elif address == self._addresses["WD_RESET"]:
            await self._outputs.reset_alarms()
        elif address == self._addresses["POSTFLOW"]:
            await self._outputs.end_post_flow()
        elif address == self._recipe.address:
            await self._outputs.beat(words[0])
            if len(words) == self._recipe.count:
                await self._set_recipe(words)
        else:
            raise AssertionError(f"register {address} is none that a feeder is driven by")

    async def close(self) -> None:
        """Disconnect. Gas whose post-flow this host was timing goes off with it."""
        try:
            if self._outputs.is_post_flowing:
                await self._outputs.end_post_flow()
        except (MachineError, RegisterError):
            pass  # the device is gone
        finally:
            await self._link.close()

    async def _retried(self, register: str) -> object:
        async def words() -> Sequence[int]:
            values = await self._registers.read([(None, register)])
            return [int(value) for value in values.values() if isinstance(value, int | float)]

        found = await answer_with_retries(words, _BUSY_PAUSE_S)
        return found[0] if found else None

    async def _set_recipe(self, words: Sequence[int]) -> None:
        values = self._recipe.decode(words)

        def by_channel(name: str) -> dict[int, float]:
            return {channel: _number(values[hopper_register_name(channel, name)])
                    for channel in self._device.channels}

        await self._outputs.prepare(stabilise_s=_number(values["STABILISE"]),
                                    post_flow_s=_number(values["POSTFLOW"]))
        await self._outputs.set_recipe(int(_number(values["SEQ"])), by_channel("FLOW_SP"),
                                       by_channel("CARRIER_SP"))

    async def _system(self) -> list[int]:
        values = await self._registers.read(self._readings.status_places)
        return self._readings.system_words(values, self._outputs, self._loop.time())

    async def _mirror(self, count: int) -> list[int]:
        """The first words of the mirror: of the device, then of the hoppers as far as asked for."""
        if count <= SYSTEM_BLOCK.count:
            return (await self._system())[:count]
        values = await self._registers.read(self._readings.hopper_places)
        words = self._readings.system_words(values, self._outputs, self._loop.time())
        feeding = self._readings.is_feeding(words)
        words += [0] * (count - len(words))
        for channel in self._channels:
            at = mirror_offset(channel)
            own = self._readings.hopper_words(channel, values, self._outputs, feeding=feeding)
            words[at : at + len(own)] = own
        return words[:count]


def _number(value: RegisterValue) -> float:
    return float(value) if isinstance(value, int | float) else 0.0
