"""The link to a feeder: PMX registers, whether the device has them or its map is translated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from firmware_protocol.map_file import shipped_map
from firmware_protocol.pmx import mirror_register
from lmctl.config.feeders import FeederSettings, HopperSettings
from lmctl.machine.feeder.identity import FeederIdentity, identify_feeder
from lmctl.machine.modbus.client import ModbusLink
from lmctl.machine.modbus.observation import WireObservation


class FeederLink(Protocol):
    """Requests to one feeder; they raise as those of `ModbusLink` do."""

    @property
    def wire_observation(self) -> WireObservation:
        """What has come since the last good answer."""

    async def read_input(self, address: int, count: int) -> Sequence[int]:
        """Input registers."""

    async def write(self, address: int, words: Sequence[int]) -> None:
        """Holding registers."""

    async def exchange(
        self, write_address: int, words: Sequence[int], read_address: int, count: int
    ) -> Sequence[int]:
        """Write holding registers, then read some."""

    async def close(self) -> None:
        """Disconnect."""


class IdentifiedFeederLink(FeederLink, Protocol):
    """A link that knows its device by its map."""

    async def identify(self) -> FeederIdentity:
        """What the device is. Raises MachineError where it is another."""


async def open_feeder_link(
    feeder: FeederSettings, hoppers: Sequence[HopperSettings], timeout_s: float
) -> ModbusLink | IdentifiedFeederLink:
    """Connect to a feeder, as its map requires.

    Raises ConfigError for a bad endpoint, MachineError where it cannot be reached.
    """
    device = feeder.device_map
    if device is None or device is shipped_map("pmx"):
        return await ModbusLink.open(feeder, timeout_s=timeout_s, mirror=mirror_register)
    from lmctl.machine.feeder.mapped.link import MappedFeederLink  # only few feeders need it

    return await MappedFeederLink.open(feeder, device, hoppers, timeout_s)


async def identify_by_map(
    link: ModbusLink | IdentifiedFeederLink, feeder: FeederSettings,
    hoppers: Sequence[HopperSettings],
) -> FeederIdentity:
    """What the device is, before anything is written. Raises MachineError where it is another."""
    if isinstance(link, ModbusLink):
        return await identify_feeder(link, feeder, hoppers)
    return await link.identify()
