"""Commands and set-points of a feeder with a register map of its own.

What a device does by itself on a PMX (recipes that change at once, post-flow of gas) is carried out
here where the device does not: set-points in order and read back, gas off after its time.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence

from firmware_protocol.device_map import DeviceMap
from firmware_protocol.feeder_map import FeederMap, MappedAction
from firmware_protocol.pmx import FeederCommandBits
from firmware_protocol.registers import RegisterValue
from lmctl.config.feeders import FeederSettings
from lmctl.machine.feeder.mapped.registers import MappedRegisters, Place

#: Bits of the command word that a map's commands carry out, in the order in which they come on.
COMMAND_BITS = {
    "remote": FeederCommandBits.ENABLE_REMOTE, "gas": FeederCommandBits.GAS_ON,
    "feed": FeederCommandBits.FEED_ON, "refill": FeederCommandBits.REFILL_HOLD,
}
FLOW, CARRIER = "flow_setpoint_g_min", "carrier_setpoint_L_min"


class MappedOutputs:
    """What this host has commanded, and writes.

    channels : of the hoppers in use; the others are set to 0 and never switched on
    command : the last command, carried out but for gas whose post-flow is not over
    applied : number of the last recipe that the device was seen to hold
    gas_since_s : since when gas is on; infinite while it is off
    clipped_channels : hoppers whose registers hold less than was to be set
    """

    def __init__(
        self, registers: MappedRegisters, device: DeviceMap, feeder_map: FeederMap,
        feeder: FeederSettings, channels: Sequence[int],
    ) -> None:
        self.command = FeederCommandBits(0)
        self.applied = 0
        self._confirmed = True
        self.gas_since_s = math.inf
        self.clipped_channels: frozenset[int] = frozenset()
        self.stabilise_s = feeder.stabilise_s
        self._registers = registers
        self._device = device
        self._map = feeder_map
        self._feeder = feeder
        self._channels = tuple(channels)
        self._post_flow_s = feeder.gas_postflow_s
        self._gas_off_s = math.inf  # when gas is to go off, after its post-flow
        self._powder_off_s = -math.inf
        self._flows_g_min: dict[int, float] = {}
        self._carrier_L_min: dict[int, float] = {}
        self._sequence = 0
        self._words: dict[Place, int] = {}
        self._prepared = False
        self._loop = asyncio.get_running_loop()

    @property
    def is_feeding(self) -> bool:
        """Whether powder runs by what was commanded and read back: an order that was not carried
        out leaves everything as it was."""
        return (FeederCommandBits.FEED_ON in self.command) is self._confirmed

    @property
    def is_post_flowing(self) -> bool:
        """Whether gas flows on only to empty the hose, timed by this host."""
        return self._gas_off_s < math.inf

    async def prepare(self, *, stabilise_s: float, post_flow_s: float) -> None:
        """Write the map's settings and the times of the profile, once."""
        self.stabilise_s, self._post_flow_s = stabilise_s, post_flow_s
        if self._prepared:
            return
        for name, value in self._map.settings:
            await self._registers.write(
                {place: _whole(value) for place in self._registers.places(name, self._channels)})
        times = {"stabilise_s": stabilise_s, "post_flow_s": post_flow_s}
        for name, time_s in times.items():
            if (quantity := self._map.quantities.get(name)) is not None:
                await self._registers.write(
                    {(None, quantity.register): quantity.to_register(time_s)})
        if self._map.watchdog_timeout is not None:
            row = next(r for r in self._device.rows if r.name == self._map.watchdog_timeout)
            per_s = 1000.0 if row.unit == "ms" else 1.0
            await self._registers.write({(None, row.name): self._feeder.watchdog_s * per_s})
        self._prepared = True

    async def beat(self, heartbeat: int) -> None:
        """Write the heartbeat, where the device watches for one."""
        if self._map.heartbeat is not None:
            row = next(r for r in self._device.rows if r.name == self._map.heartbeat)
            value = heartbeat % 2 if row.space.has_bits else heartbeat  # a coil changes with each
            await self._registers.write({(None, row.name): value})

    async def set_recipe(
        self, sequence: int, flows_g_min: dict[int, float], carrier_L_min: dict[int, float]
    ) -> None:
        """Make flows the recipe number `sequence`: at once where the device can, else in order."""
        self._flows_g_min, self._carrier_L_min = flows_g_min, carrier_L_min
        self._sequence = sequence
        await self._write_setpoints(
            stopped="feed" in self._map.missing and FeederCommandBits.FEED_ON not in self.command)

    async def set_command(self, command: FeederCommandBits) -> None:
        """Carry out a whole command word: first what goes off, then what comes on.

        Gas goes off at once where the device times its post-flow itself, or none is due.
        """
        now_s = self._loop.time()
        gas, feed = FeederCommandBits.GAS_ON, FeederCommandBits.FEED_ON
        if feed not in command and feed in self.command:
            self._powder_off_s = now_s
        if gas in command:
            self._gas_off_s = math.inf
        elif gas in self.command and "post_flow" in self._map.missing:
            gas_off_s = self._powder_off_s + self._post_flow_s
            self._gas_off_s = gas_off_s if now_s < gas_off_s else math.inf
        await self._carry_out(command)
        flows = gas in command or self.is_post_flowing
        self.gas_since_s = min(self.gas_since_s, now_s) if flows else math.inf

    async def end_post_flow(self) -> None:
        """Gas off now."""
        if (quantity := self._map.quantities.get("post_flow_s")) is not None:
            await self._registers.write({(None, quantity.register): quantity.to_register(0.0)})
        if self.is_post_flowing:
            self._gas_off_s = self._loop.time()
            await self.advance()

    async def advance(self) -> None:
        """Switch gas off where its post-flow is over."""
        if self._gas_off_s <= self._loop.time():
            self._gas_off_s = math.inf
            try:
                await self._carry_out(self.command)
            except BaseException:
                self._gas_off_s = self._loop.time()  # it is tried again
                raise
            self.gas_since_s = math.inf

    async def reset_alarms(self) -> None:
        """The writes of the command `alarm_reset`."""
        for action in self._map.commands.get("alarm_reset", ()):
            for place in self._registers.places(action.register, self._channels):
                if action.mask:
                    word = self._words.get(place, 0)
                    await self._registers.write({place: word | action.mask})
                    await self._registers.write({place: word})
                else:
                    await self._registers.write({place: action.on})
                    if action.off is not None:
                        await self._registers.write({place: action.off})

    async def _carry_out(self, command: FeederCommandBits) -> None:
        """Write the registers of every command that a map has, those that go off first.

        The command counts as given once all are written.
        """
        given = {name: bit in command for name, bit in COMMAND_BITS.items()}
        given["gas"] = given["gas"] or self.is_post_flowing
        by_flow, feeds = "feed" in self._map.missing, given["feed"]
        if by_flow and not feeds:
            await self._write_setpoints(stopped=True)
        words: dict[Place, int] = {}
        for name in given:
            for action in self._map.commands.get(name, ()):
                for place in self._registers.places(action.register, self._channels):
                    if action.mask:
                        before = words.get(place, self._base_word(action))
                        words[place] = before | action.mask if given[name] else (
                            before & ~action.mask)
        for on in (False, True):
            for name in given if on else reversed(given):
                if given[name] is on:
                    await self._switch(self._map.commands.get(name, ()), words, on=on)
        if by_flow and feeds:
            await self._write_setpoints(stopped=False)
        elif not by_flow and self._map.missing.get("feeding") == "commanded":
            held = await self._registers.read(self._words)
            self._confirmed = held == self._words
            if not self._confirmed:
                self._words.clear()
        self.command = command

    async def _switch(
        self, actions: Sequence[MappedAction], words: dict[Place, int], *, on: bool
    ) -> None:
        for action in actions:
            for place in self._registers.places(action.register, self._channels):
                value = words[place] if action.mask else action.on if on else action.off
                if value is None or (action.mask and self._words.get(place) == value):
                    continue
                self._words.pop(place, None)
                await self._registers.write({place: value})
                self._words[place] = value

    def _base_word(self, action: MappedAction) -> int:
        """What a command word holds besides its commands: as the map's settings say."""
        return next((int(value) for name, value in self._map.settings
                     if name == action.register), 0)

    async def _write_setpoints(self, *, stopped: bool) -> None:
        """Set-points in the map's order, then the commit; read back where there is none.

        stopped : flows are 0, whatever the recipe
        """
        written: dict[Place, RegisterValue] = {}
        clipped: set[int] = set()
        for name in self._map.recipe_order:
            quantity = self._map.hopper_quantities.get(name)
            if quantity is None:
                continue
            wanted = self._flows_g_min if name == FLOW else self._carrier_L_min
            values: dict[Place, RegisterValue] = {}
            for channel in self._device.channels:
                value = 0.0 if stopped and name == FLOW else wanted.get(channel, 0.0)
                place = (channel, quantity.register)
                values[place], is_limited = self._registers.nearest(
                    place, quantity.to_register(value))
                if is_limited:
                    clipped.add(channel)
            await self._registers.write(values)
            written |= values
        self.clipped_channels = frozenset(clipped)
        if self._map.commit is not None:
            await self._registers.write({(None, self._map.commit): self._sequence})
            return
        is_held = await self._registers.read(written) == written
        if "feed" in self._map.missing:
            self._confirmed = is_held
        if is_held:
            self.applied = self._sequence


def _whole(value: float) -> RegisterValue:
    return int(value) if value.is_integer() else value
