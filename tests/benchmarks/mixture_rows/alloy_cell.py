"""A simulated cell of four hoppers, for parts under alloy rules."""

from __future__ import annotations

from importlib.resources import files

from lmctl.config.machine import MachineProfile
from lmctl.config.toml_file import parse_toml
from simulators.bench_config import BenchConfig

EXAMPLES = files("lmctl.examples")
#: Powder, density [g/cm³], catch efficiency, dead time [s], lag [s], least flow [g/min].
POWDERS = (
    ("Fe", 7.87, 0.75, 3.0, 1.0, 0.5),
    ("V", 6.11, 0.70, 2.7, 0.9, 0.5),
    ("Ti", 4.51, 0.75, 2.4, 1.1, 0.4),
    ("Ni", 8.90, 0.75, 2.6, 0.8, 0.5),
)


def alloy_profile() -> MachineProfile:
    """The shipped cell's profile with one feeder for each powder."""
    head = (EXAMPLES / "cell.toml").read_text().split("[[feeder]]")[0]
    text = head
    for number, (name, _, _, dead_s, lag_s, least) in enumerate(POWDERS, start=1):
        text += (
            f'[[feeder]]\nname = "F{number}"\nendpoint = "modbus-tcp://127.0.0.1:{5020 + number}"\n'
            f"device_id = 1\nwatchdog_s = 4\n"
            f'[[hopper]]\nname = "{"ABCD"[number - 1]}"\nfeeder = "F{number}"\nchannel = 1\n'
            f'material = "{name}"\ndead_time_s = {dead_s}\nlag_s = {lag_s}\n'
            f"min_flow_g_min = {least}\nmax_flow_g_min = 60\n")
    return parse_toml(text, MachineProfile, name="the alloy cell")


def alloy_bench() -> BenchConfig:
    """The bench that the profile describes."""
    text = (EXAMPLES / "bench.toml").read_text().split("[[feeder]]")[0]
    for number, (name, density, catch, dead_s, lag_s, _) in enumerate(POWDERS, start=1):
        text += (
            f'[[feeder]]\nname = "F{number}"\nendpoint = "modbus-tcp://127.0.0.1:{5020 + number}"\n'
            f"device_id = 1\n[[feeder.hopper]]\nchannel = 1\nmaterial = \"{name}\"\n"
            f"density_g_mm3 = {density / 1000}\ncatch_efficiency = {catch}\n"
            f"dead_time_s = {dead_s}\nlag_s = {lag_s}\ndrive_lag_s = 0.0\n"
            f"feed_factor_g_rev = 2.594\nn_min_rpm = 0.05\nn_max_rpm = 40.0\nfill_g = 20000\n")
    return BenchConfig.parse(text)


def materials_text(names: tuple[str, ...]) -> str:
    """The [[material]] tables of a part file."""
    return "".join(
        f'[[material]]\nname = "{name}"\ndensity_g_cm3 = {density}\ncatch_efficiency = {catch}\n'
        "power_W = 1500\nspeed_mm_s = 10\n"
        for name, density, catch, *_ in POWDERS if name in names)
