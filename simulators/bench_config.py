"""A simulated cell as written in TOML: the truth behind the endpoints of a machine profile."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from firmware_protocol.dialect import GRBL, GRBLHAL
from firmware_protocol.pmx import MAX_HOPPERS
from firmware_protocol.table_reader import TableReader
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.motion.config import MotionConfig
from simulators.motion.settings import FirmwareSettings, SettingError
from simulators.process.config import ProcessConfig, read_process
from simulators.safety.config import SafetyConfig
from simulators.scale.config import ScaleConfig, read_scale_config

_DIALECTS = {"grbl": GRBL, "grblhal": GRBLHAL}
_SETTING_ERRORS = {
    3: "the firmware has no such setting", 10: "soft limits ($20) need homing ($22)",
}
#: Largest value of a feeder's flow registers [g/min].
_MAX_FLOW = 655.0


class BenchConfigError(ValueError):
    """The text does not describe a bench; one line per mistake."""

    def __init__(self, mistakes: list[str]) -> None:
        super().__init__("\n".join(mistakes))
        self.mistakes = tuple(mistakes)


@dataclass(frozen=True)
class Address:
    """Where a device answers: a TCP host and port (0: any free one), or a new pty."""

    host: str = ""
    port: int = 0
    pty: bool = False


@dataclass(frozen=True)
class BenchConfig:
    """One motion controller, its feeders, and a safety-input device and a scale where there are.

    name : of the cell
    motion, feeders, safety, scale : what it consists of
    addresses : by "motion", "safety", "scale" and the feeders' names
    process : what the pool makes of the powder, where that is simulated too
    """

    name: str
    motion: MotionConfig
    feeders: tuple[FeederConfig, ...]
    addresses: Mapping[str, Address]
    safety: SafetyConfig | None = None
    scale: ScaleConfig | None = None
    process: ProcessConfig | None = None

    @classmethod
    def parse(cls, text: str) -> BenchConfig:
        """Raises BenchConfigError with every mistake, each with the path of its key."""
        try:
            data = tomllib.loads(text)
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            raise BenchConfigError([f"not valid TOML: {error}"]) from None
        mistakes: list[str] = []
        config = _bench(TableReader(data, "", mistakes))
        if mistakes:
            raise BenchConfigError(mistakes)
        return config

    @classmethod
    def load(cls, path: Path) -> BenchConfig:
        """Raises OSError where the file cannot be read; BenchConfigError."""
        try:
            return cls.parse(path.read_text(encoding="utf-8"))
        except UnicodeDecodeError as error:
            raise BenchConfigError([f"not text: byte {error.start} is not UTF-8"]) from None


def _bench(top: TableReader) -> BenchConfig:
    name = top.text("name", "bench")
    addresses: dict[str, Address] = {}
    motion = _motion(top.table("motion"), addresses)
    safety = _safety(top.table("safety", {}), addresses) if top.has_key("safety") else None
    scale = _scale(top.table("scale", {}), addresses) if top.has_key("scale") else None
    process = read_process(top.table("process", {})) if top.has_key("process") else None
    feeders = []
    for table in top.tables("feeder"):
        feeders.append(_feeder(table, addresses))
    top.report_unknown_keys()
    if process is not None and process.substrate in {
        hopper.material for feeder in feeders for hopper in feeder.hoppers
    }:
        top.report_mistake("process.substrate", f"{process.substrate!r} is a powder too")
    ports = [address.port for address in addresses.values() if address.port]
    for port in sorted({port for port in ports if ports.count(port) > 1}):
        top.report_mistake("", f"two devices answer at port {port}")
    return BenchConfig(name, motion, tuple(feeders), addresses, safety, scale, process)


def _motion(table: TableReader, addresses: dict[str, Address]) -> MotionConfig:
    dialect = table.choice("dialect", _DIALECTS, "grblhal")
    addresses["motion"] = _address(table, "tcp", "tcp://127.0.0.1:0")
    firmware = _DIALECTS[dialect]
    rx_bytes = table.integer("rx_bytes", firmware.rx_bytes, least=64, most=65_536)
    blocks = table.integer("planner_blocks", firmware.planner_blocks, least=4, most=1000)
    settings = table.table("settings", {})
    values = settings.numbers_by_integer_key()
    table.report_unknown_keys()
    for number, value in values.items():
        # $20 needs $22, so that each is tried together with what it needs
        tried = {number: value} if number != 20 else {22: values.get(22, 0.0), 20: value}
        try:
            FirmwareSettings(firmware, tried)
        except SettingError as error:
            if f"${number}:" in str(error):
                settings.report_mistake(
                    str(number), _SETTING_ERRORS.get(error.code, f"the firmware refuses {value:g}")
                )
    return MotionConfig(
        dialect=dialect, rx_bytes=rx_bytes, planner_blocks=blocks, settings=values
    )


def _safety(table: TableReader, addresses: dict[str, Address]) -> SafetyConfig:
    addresses["safety"] = _address(table, "modbus-tcp", "modbus-tcp://127.0.0.1:0")
    usual = SafetyConfig()
    safety = SafetyConfig(
        device_id=table.integer("device_id", usual.device_id, least=1, most=247),
        watchdog_relay=table.boolean("watchdog_relay", usual.watchdog_relay),
        laser_circuit=table.boolean("laser_circuit", usual.laser_circuit),
        laser_enable=table.boolean("laser_enable", usual.laser_enable),
        boot_s=table.number("boot_s", usual.boot_s, least=0, most=3600),
        shield_gas_L_min=table.number(
            "shield_gas_L_min", usual.shield_gas_L_min, least=0, most=600
        ),
        chiller_C=table.number("chiller_C", usual.chiller_C, least=-50, most=150),
        chiller_L_min=table.number("chiller_L_min", usual.chiller_L_min, least=0, most=600),
        oxygen_ppm=table.number("oxygen_ppm", usual.oxygen_ppm, least=0, most=1e6),
        extraction_Pa=table.number(
            "extraction_Pa", usual.extraction_Pa, least=-30_000, most=30_000
        ),
    )
    if safety.laser_enable and not safety.watchdog_relay:
        table.report_mistake("laser_enable", "needs watchdog_relay = true: it drops with the relay")
    table.report_unknown_keys()
    return safety


def _scale(table: TableReader, addresses: dict[str, Address]) -> ScaleConfig:
    addresses["scale"] = _address(table, "modbus-tcp", "modbus-tcp://127.0.0.1:0")
    scale = read_scale_config(table)
    table.report_unknown_keys()
    return scale


def _feeder(table: TableReader, addresses: dict[str, Address]) -> FeederConfig:
    """A table [[feeder]].

    name : of the feeder, as in the machine profile
    map_version : of its registers; "1.0" has no mirror, so that a cycle takes two requests
    hopper : its hoppers, channels without gap from 1
    """
    name = table.text("name")
    if name in addresses:
        table.report_mistake("name", f"{name!r} is taken")
    addresses[name] = _address(table, "modbus-tcp", "modbus-tcp://127.0.0.1:0")
    device_id = table.integer("device_id", 1, least=1, most=247)
    boot_s = table.number("boot_s", 0.0, least=0, most=3600)
    preflow_s = table.number("preflow_s", 3.0, least=0, most=3600)
    map_version = table.choice("map_version", ("1.0", "1.1"), "1.1")
    hoppers = [_hopper(hopper) for hopper in table.tables("hopper")]
    channels = sorted(hopper.channel for hopper in hoppers)
    if not channels or channels != list(range(1, len(channels) + 1)):
        table.report_mistake("hopper", "channels must be 1, 2, … without gap or repetition")
    table.report_unknown_keys()
    return FeederConfig(
        name, tuple(hoppers), device_id, boot_s, preflow_s, int(map_version.partition(".")[2])
    )


def _hopper(table: TableReader) -> HopperConfig:
    known = len(table.mistakes)
    n_min = table.number("n_min_rpm", 0.3, least=0, most=1000)
    factor = table.number("feed_factor_g_rev", above=0, most=65)
    slope = table.number("slope_factor", 1.0, least=0.2, most=5)
    calibrated = table.number("calibrated_g_rev", factor, above=0, most=65)
    hopper = HopperConfig(
        channel=table.integer("channel", 1, least=1, most=MAX_HOPPERS),
        material=table.text("material"),
        density_g_mm3=table.number("density_g_mm3", above=0, most=0.1),
        catch_efficiency=table.number("catch_efficiency", above=0, most=1),
        dead_time_s=table.number("dead_time_s", 3.0, least=0, most=60),
        lag_s=table.number("lag_s", 1.0, least=0, most=60),
        drive_lag_s=table.number("drive_lag_s", 0.0, least=0, most=60),
        feed_factor_g_rev=factor,
        offset_g_min=table.number("offset_g_min", 0.0, least=-factor * slope * n_min, most=100),
        calibrated_g_rev=calibrated,
        n_min_rpm=n_min,
        n_max_rpm=table.number("n_max_rpm", above=n_min, most=600),
        fill_g=table.number("fill_g", above=0, most=1e6),
        noise_rsd=table.number("noise_rsd", 0.0, least=0, most=0.2),
        seed=table.integer("seed", 0, least=0, most=2**31),
        noise_time_s=table.number("noise_time_s", 1.0, least=0.05, most=60),
        pulsation_rsd=table.number("pulsation_rsd", 0.0, least=0, most=0.5),
        pulses_per_rev=table.number("pulses_per_rev", 10.0, above=0, most=1000),
        slope_factor=slope,
        slope_drift_per_h=table.number("slope_drift_per_h", 0.0, least=-0.5, most=0.5),
        slope_change_to_empty=table.number("slope_change_to_empty", 0.0, least=-0.5, most=0.5),
        carrier_L_min=table.number("carrier_L_min", 4.0, above=0, most=100),
        carrier_share=table.number("carrier_share", 0.0, least=0, most=1),
        catch_in_mixture=table.number("catch_in_mixture", 0.0, least=-0.9, most=0.9),
        catch_falloff_mm=table.number("catch_falloff_mm", 0.0, least=0, most=100),
    )
    most_caught = hopper.catch_efficiency * (1 + hopper.catch_in_mixture)
    if most_caught > 1 and len(table.mistakes) == known:
        table.report_mistake("catch_in_mixture", "more powder would be caught than arrives")
    if max(factor * slope, calibrated) * hopper.n_max_rpm > _MAX_FLOW:
        table.report_mistake("n_max_rpm",
                             f"makes more than {_MAX_FLOW:g} g/min with the feed factor")
    table.report_unknown_keys()
    return hopper


def _address(table: TableReader, scheme: str, default: str) -> Address:
    """Parse "SCHEME://HOST:PORT" or "pty"."""
    known = len(table.mistakes)
    text = table.text("endpoint", default)
    if text == "pty" or len(table.mistakes) > known:
        return Address(pty=True)
    try:
        parts = urlsplit(text)
        if parts.scheme == scheme and parts.hostname and parts.port is not None and (
            parts.path in ("", "/") and not parts.query
        ):
            return Address(parts.hostname, parts.port)
    except ValueError:
        pass
    table.report_mistake("endpoint", f'must be "{scheme}://HOST:PORT" or "pty"')
    return Address(pty=True)
