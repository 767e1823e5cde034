"""The register maps that a machine profile names: read, checked, and held against the profile."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from firmware_protocol.device_map import DeviceMap
from firmware_protocol.feeder_map import SETPOINTS
from firmware_protocol.map_file import SHIPPED_MAPS, MapFileError, load_map, shipped_map
from firmware_protocol.registers import Register, RegisterError
from lmctl.config.feeders import FeederSettings, HopperSettings
from lmctl.errors import ConfigError, Finding, MissingFileError


def named_device_map(name: str, folder: Path) -> DeviceMap:
    """A map by the name that ships, or by its file, relative to a folder. Raises as the latter."""
    return shipped_map(name) if name in SHIPPED_MAPS else read_device_map(folder / name)


def read_device_map(path: Path) -> DeviceMap:
    """The map in a file. Raises ConfigError with every mistake of the file; MissingFileError."""
    try:
        return load_map(path)
    except FileNotFoundError:
        raise MissingFileError.for_path(
            path, hint=f"maps that ship are {' and '.join(SHIPPED_MAPS)}") from None
    except OSError as error:
        raise ConfigError.cannot_read(path, error) from None
    except MapFileError as error:
        findings = [Finding(*_key_and_reason(mistake)) for mistake in error.mistakes]
        raise ConfigError.of_findings(
            f"the register map {path}", findings,
            hint="docs/reference/device-maps.md lists every key") from None


def feeders_with_maps(
    feeders: Sequence[FeederSettings], hoppers: Sequence[HopperSettings], path: Path
) -> tuple[FeederSettings, ...]:
    """The feeders of a profile, each with the map that it names. path : of the profile's file.

    Raises ConfigError with every mistake of every map, and what contradicts the profile.
    """
    findings: list[Finding] = []
    complete = []
    for number, feeder in enumerate(feeders, start=1):
        if feeder.map is None:
            complete.append(feeder)
            continue
        key = f"feeder[{number}]"
        try:
            device_map = named_device_map(feeder.map, path.parent)
        except ConfigError as error:
            findings += [Finding(f"{key}.map: {feeder.map}: {one.path}", one.reason)
                         for one in error.findings] or [
                             Finding(f"{key}.map", ": ".join((error.what, *error.where)))]
        except MissingFileError as error:
            findings.append(Finding(f"{key}.map", f"{error.what}; {error.hint}"))
        else:
            own = [hopper for hopper in hoppers if hopper.feeder == feeder.name]
            findings += [Finding(key, reason)
                         for reason in _contradictions(device_map, feeder, own)]
            complete.append(feeder.with_device_map(device_map))
    if findings:
        raise ConfigError.of_findings(path, findings)
    return tuple(complete)


def _contradictions(
    device: DeviceMap, feeder: FeederSettings, hoppers: Sequence[HopperSettings]
) -> Iterator[str]:
    """What of the profile the device of the map cannot do."""
    if device.feeder is None:
        yield f"map {feeder.map!r} describes a {device.device} device, and no feeder"
        return
    if not device.feeder.has_watchdog and not feeder.stopped_by_relay:
        yield (f"{device.name} has no watchdog: powder would go on when this host stops. Wire the "
               "watchdog relay of a safety device so that it switches the feeder off, and write "
               "stopped_by_relay = true")
    if feeder.word_order != "ABCD":
        yield "word_order belongs into the register map"
    for hopper in hoppers:
        if hopper.channel > device.hoppers:
            yield (f"hopper {hopper.name!r} is on channel {hopper.channel}, and {device.name} has "
                   f"{device.hoppers}")
            continue
        setpoint_g_min = (hopper.max_flow_g_min - hopper.offset_g_min) / hopper.slope
        values = (setpoint_g_min, hopper.carrier_L_min)
        for name, value in zip(SETPOINTS, values, strict=True):
            if reason := unreachable_setpoint(device, hopper.channel, name, value):
                yield f"hopper {hopper.name!r}: {reason}"


def unreachable_setpoint(device: DeviceMap, channel: int, name: str, value: float) -> str:
    """Why a device cannot be set to a value; "" where it can.

    name : of `SETPOINTS`; value : in the unit of its name
    """
    feeder = device.feeder
    quantity = None if feeder is None else feeder.hopper_quantities.get(name)
    if quantity is None:
        return ""
    row_name = f"H{channel}.{quantity.register}" if quantity.in_hopper else quantity.register
    table = device.registers_of_unit(device.unit_of(channel) if quantity.in_hopper else None)
    row: Register = table[row_name]
    try:
        table.encode(row_name, quantity.to_register(value))
    except RegisterError as error:
        unit = "g/min" if name == SETPOINTS[0] else "L/min"
        return (f"{device.name} cannot be set to {value:g} {unit}: {error} "
                f"(register {row.address})")
    return ""


def _key_and_reason(mistake: str) -> tuple[str, str]:
    key, colon, reason = mistake.partition(": ")
    return (key, reason) if colon else ("", mistake)
