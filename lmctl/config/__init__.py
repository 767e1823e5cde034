"""Configuration files: parts, machine profiles, materials; TOML in, checked models out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.config.bodies import CloudBody as CloudBody
    from lmctl.config.bodies import MeshBody as MeshBody
    from lmctl.config.bodies import ShellBody as ShellBody
    from lmctl.config.composition import FaceFeature as FaceFeature
    from lmctl.config.composition import SheetFeature as SheetFeature
    from lmctl.config.composition import features_of as features_of
    from lmctl.config.composition import measured_bodies as measured_bodies
    from lmctl.config.file_kind import FileKind as FileKind
    from lmctl.config.file_kind import file_kind_of as file_kind_of
    from lmctl.config.file_kind import refuse_other_kind as refuse_other_kind
    from lmctl.config.machine import FeederSettings as FeederSettings
    from lmctl.config.machine import HopperSettings as HopperSettings
    from lmctl.config.machine import LaserSettings as LaserSettings
    from lmctl.config.machine import MachineProfile as MachineProfile
    from lmctl.config.machine import MotionSettings as MotionSettings
    from lmctl.config.machine import SafetyInput as SafetyInput
    from lmctl.config.machine import SafetySettings as SafetySettings
    from lmctl.config.machine import load_profile as load_profile
    from lmctl.config.materials import suggest_name as suggest_name
    from lmctl.config.modbus_device import ModbusDevice as ModbusDevice
    from lmctl.config.modbus_device import WordOrderName as WordOrderName
    from lmctl.config.part_file import MaterialSettings as MaterialSettings
    from lmctl.config.part_file import PartFile as PartFile
    from lmctl.config.part_file import ProcessSettings as ProcessSettings
    from lmctl.config.part_rules import load_part_file as load_part_file
    from lmctl.config.part_rules import parse_part_file as parse_part_file
    from lmctl.config.toml_file import parse_tables as parse_tables
    from lmctl.config.toml_file import read_text as read_text

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "CloudBody": "lmctl.config.bodies",
    "FaceFeature": "lmctl.config.composition",
    "FeederSettings": "lmctl.config.machine",
    "FileKind": "lmctl.config.file_kind",
    "HopperSettings": "lmctl.config.machine",
    "LaserSettings": "lmctl.config.machine",
    "MachineProfile": "lmctl.config.machine",
    "MaterialSettings": "lmctl.config.part_file",
    "MeshBody": "lmctl.config.bodies",
    "ModbusDevice": "lmctl.config.modbus_device",
    "MotionSettings": "lmctl.config.machine",
    "PartFile": "lmctl.config.part_file",
    "ProcessSettings": "lmctl.config.part_file",
    "SafetyInput": "lmctl.config.machine",
    "SafetySettings": "lmctl.config.machine",
    "SheetFeature": "lmctl.config.composition",
    "ShellBody": "lmctl.config.bodies",
    "WordOrderName": "lmctl.config.modbus_device",
    "features_of": "lmctl.config.composition",
    "file_kind_of": "lmctl.config.file_kind",
    "load_part_file": "lmctl.config.part_rules",
    "load_profile": "lmctl.config.machine",
    "measured_bodies": "lmctl.config.composition",
    "parse_part_file": "lmctl.config.part_rules",
    "parse_tables": "lmctl.config.toml_file",
    "read_text": "lmctl.config.toml_file",
    "refuse_other_kind": "lmctl.config.file_kind",
    "suggest_name": "lmctl.config.materials",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
