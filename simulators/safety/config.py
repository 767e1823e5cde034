"""True parameters of a simulated safety-input device, known only to the simulators."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.registers import WordOrder


@dataclass(frozen=True)
class SafetyConfig:
    """watchdog_relay : it has one, wired to the motion controller's door input
    laser_circuit : e-stop chain, door and relay are in the laser's own safety circuit as well
    laser_enable : it has a laser-enable output, which is in the laser's own circuit
    device_id : its unit id
    boot_s : time from power-up until it answers writes
    shield_gas_L_min, chiller_C, chiller_L_min, oxygen_ppm, extraction_Pa : what its inputs measure
    word_order : of 32-bit values
    """

    device_id: int = 1
    watchdog_relay: bool = False
    laser_circuit: bool = False
    laser_enable: bool = False
    boot_s: float = 0.0
    shield_gas_L_min: float = 15.0
    chiller_C: float = 22.0
    chiller_L_min: float = 10.0
    oxygen_ppm: float = 20.0
    extraction_Pa: float = 800.0
    word_order: WordOrder = WordOrder.ABCD
