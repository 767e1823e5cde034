"""Makes what ships about keys from the models: rows for `lmctl help`, JSON schemas, documents.

python -m tests.house.reference          writes what has changed
python -m tests.house.reference --check  says what has, and fails
"""

from __future__ import annotations

import json
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from firmware_protocol import device_map, feeder_map, map_file
from firmware_protocol.registers import Register
from lmctl.cli.bench import load_bench
from lmctl.config.free_numbers import resolve_free_numbers
from lmctl.config.machine import MachineProfile
from lmctl.config.part_file import PartFile
from lmctl.reference.key_row import FILE_KINDS, KIND_OF_TABLE, KeyRow, as_toml, unit_of_key
from lmctl.reference.model_rows import model_rows
from lmctl.reference.schemas import schema_of_model, schema_of_rows
from simulators import bench_config
from simulators.faults.kinds import FAULT_KINDS
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.motion.config import MotionConfig
from simulators.process.config import ProcessConfig
from simulators.process.substrate_heights import SubstrateHeights
from simulators.safety.config import SafetyConfig
from simulators.scale.config import ScaleConfig
from tests.house.command_page import command_page
from tests.house.key_pages import pages
from tests.house.reader_rows import documented_by, reader_rows

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "lmctl/examples"
REFERENCE = ROOT / "lmctl/reference"

_MORE_OF_BENCH = {
    "endpoint": "where it answers: an address as in a machine profile, or \"pty\"",
    "bench.process": "what the pool makes of the powder; without it no voxel map is written",
    "bench.motion": "the motion controller", "bench.safety": "the safety-input device",
    "bench.scale": "the catch scale", "bench.feeder": "the feeders, by the names in the profile",
    "bench.motion.settings": "`$` numbers with their values",
}
_MORE_OF_MAP = {
    "register": "the name of a row", "bit": "bits of which one is set, by number or name",
    "is": "values, by number or name", "inverted": "it is so where the bit or value is not",
    "of": "of a register that each hopper has: in any or in all of them",
    "on": "what is written to switch on", "off": "what is written to switch off",
    "value": "what is written, or found", "code": "the device's number",
    "text": "in words", "remedy": "what to do about it",
    "commit": "the row whose change makes all set-points the recipe at once",
    "applied": "the row that shows the number of the recipe that runs",
    "order": "in which set-points are written",
    "heartbeat": "the row that a host must change",
    "timeout": "the row for the time after which powder stops without heartbeats",
    "map.register": "registers of the device", "map.hopper_register": "registers of each hopper",
    "map.bits": "[bits.REGISTER]: names of its bits", "map.codes":
    "[codes.REGISTER]: names of its values", "map.identity": "how the device is recognised",
    "map.values": "registers of the device's quantities",
    "map.hopper_values": "registers of each hopper's quantities",
    "map.conditions": "registers that show how the device is",
    "map.hopper_conditions": "registers that show how each hopper is",
    "map.commands": "writes of each command", "map.recipe": "how set-points become the recipe",
    "map.watchdog": "of the device itself", "map.setting": "written as the device is opened",
    "map.alarm": "its alarms in words", "map.refusal": "why it refuses a write, in words",
    "map.missing": "what takes the place of what the device lacks",
    "input_base": "what its manual calls the input register at wire address 0",
    "step": "how much higher the next hopper's address is",
    "type": "how its words are read",
    "space": "holding: function codes 3 and 16; input: 4; coil: 1 and 15; discrete input: 2",
    "coil_base": "what its manual calls the coil at wire address 0",
    "discrete_base": "what its manual calls the discrete input at wire address 0",
    "unit": "of the value", "length": "registers of a text", "writable": "whether a host may write",
    "description": "in a line", "name": "unique in the file",
    "zero": "what the register holds for 0, in its own unit",
    "full_scale": "what the register's `maximum` means, in the unit of the value",
    "map.name": "of the device", "minimum": "least value, in its unit",
    "maximum": "greatest value, in its unit",
}


#: Values that make sense, of keys that no file has and whose least value makes none.
_TYPICAL = {
    "interpass_max_C": "400", "expansion_1e6_K": "16", "timeout_s": "0.2", "pitch_mm": "0.5",
    "direction": "[0, 0, 1]", "normal": "[0, 0, 1]", "outward": "[0, 0, 1]", "facing": "[0, 0, 1]",
    "over_mm": "[0, 10]", "force_N": "[0, 0, -500]", "traction_MPa": "[0, 0, -10]",
    "at_mm": "[10, 20, 5]", "point_mm": "[10, 20, 5]", "centre_mm": "[10, 20, 5]",
    "start_mm": "[0, 0, 5]", "end_mm": "[40, 0, 5]", "origin_mm": "[100, 100, 0]",
    "position_mm": "[60, 0]",
}


def all_rows() -> list[KeyRow]:
    """Every key of every kind of file, with an example where one ships."""
    rows = [*model_rows(PartFile, "part"), *model_rows(MachineProfile, "machine"),
            *bench_rows(), *fault_rows(), *map_rows()]
    examples = dict(_examples())
    return [row._replace(example=_shipped(row, examples) or _typical(row) or _possible(row))
            for row in rows]


def bench_rows() -> list[KeyRow]:
    """Keys of a bench file."""
    places = {
        "bench": [bench_config.BenchConfig], "bench.motion": [MotionConfig],
        "bench.safety": [SafetyConfig], "bench.scale": [ScaleConfig],
        "bench.process": [ProcessConfig], "bench.feeder": [bench_config._feeder, FeederConfig],
        "bench.feeder.hopper": [HopperConfig],
        "bench.process.substrate_heights": [SubstrateHeights],
    }
    return reader_rows("bench", bench_config._bench, documented_by(places, _MORE_OF_BENCH))


def map_rows() -> list[KeyRow]:
    """Keys of a register map."""
    places = {
        "map": [device_map.DeviceMap], "map.register": [Register],
        "map.hopper_register": [Register], "map.identity": [device_map.DeviceIdentity],
    }
    meaning = documented_by(places, _MORE_OF_MAP)

    def text(table: str, key: str) -> str:
        if table == "map.missing":
            return "; ".join(feeder_map.SUBSTITUTES[key].values())
        return (feeder_map.MEANINGS.get(key, "") if table.count(".") == 1 else "") or meaning(
            table, key)

    return reader_rows("map", map_file._device_map, text)


def fault_rows() -> Iterator[KeyRow]:
    """Keys of a fault file; parameters by the kind of the fault."""
    def row(key: str, kind: str, text: str, *, allowed: str = "", required: bool = False) -> KeyRow:
        return KeyRow(f"fault.fault.{key}", kind, unit_of_key(key), "", required, allowed, "", text,
                      "")

    yield KeyRow("fault.fault", "list of tables", "", "", True, "", "", "what goes wrong", "")
    yield row("kind", "text", "which fault", required=True,
              allowed=", ".join(map(as_toml, FAULT_KINDS)))
    yield row("device", "text", "the device, by its name in the bench")
    yield row("channel", "whole number", "the hopper's channel", allowed="from 1 to 4")
    yield row("at_s", "number", "when it happens: seconds after the run began; or at_line, or "
              "at_level_g", allowed="from 0 to 10 000 000")
    yield row("at_line", "whole number", "when the axes begin this line",
              allowed="from 0 to 9 999 999")
    yield row("at_level_g", "table", "when at most so much powder is left in a hopper")
    yield row("at_level_g.feeder", "text", "the feeder's name", required=True)
    yield row("at_level_g.channel", "whole number", "the hopper's channel",
              allowed="from 1 to 4")._replace(default="1")
    yield row("at_level_g.grams", "number", "the powder left", required=True)._replace(unit="g")
    yield row("for_s", "number", "how long it lasts; without it no limit", allowed="above 0")
    for name, kind in FAULT_KINDS.items():
        yield row(name, KIND_OF_TABLE, kind.description)
        for one in kind.parameters:
            number = "whole number" if one.is_integer else "number"
            limits = f"from {one.minimum:g} to {one.maximum:g}"
            is_switch, choices = isinstance(one.default, bool), one.choices
            yield KeyRow(
                f"fault.fault.{name}.{one.name}",
                "text" if choices else "true or false" if is_switch else number,
                unit_of_key(one.name), "" if one.default is None else as_toml(one.default),
                one.default is None,
                ", ".join(map(as_toml, choices)) if choices else "" if is_switch else limits, "",
                one.description, "")


def files() -> dict[Path, str]:
    """Everything that is made, by its path."""
    rows = all_rows()
    found = {REFERENCE / "keys.json": "[\n" + ",\n".join(
        json.dumps(list(row), ensure_ascii=False) for row in rows) + "\n]\n"}
    schemas: dict[str, dict[str, Any]] = {
        "part": schema_of_model(PartFile, FILE_KINDS["part"], free_numbers=True),
        "machine": schema_of_model(MachineProfile, FILE_KINDS["machine"]),
        **{kind: schema_of_rows(rows, kind) for kind in ("bench", "fault", "map")},
    }
    for kind, schema in schemas.items():
        found[REFERENCE / "schemas" / f"{kind}.json"] = json.dumps(
            schema, ensure_ascii=False, indent=1) + "\n"
    found[ROOT / "docs/reference/commands.md"] = command_page()
    for name, text in pages(rows).items():
        found[ROOT / "docs/reference" / name] = text
    return found


def stale() -> list[Path]:
    """Files that are not what the models make."""
    return [path for path, text in files().items()
            if not path.exists() or path.read_text(encoding="utf-8") != text]


def undocumented(rows: list[KeyRow]) -> list[str]:
    """What to add where, for each key that has no meaning yet."""
    return [f"{row.path}: its model's docstring does not say what it means; add a line "
            f"`{row.key} : ...`" for row in rows if not row.text]


def _examples() -> Iterator[tuple[str, str]]:
    """Values of keys in the files that ship, by the paths of the rows."""
    for path in sorted(EXAMPLES.glob("*.toml")):
        kind = ("machine" if path.name.startswith("cell") else "bench" if
                path.name.startswith("bench") else "map" if path.name.startswith("feeder-")
                else "part")
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        yield from _values(resolve_free_numbers(data).data if kind == "part" else data, kind)


def _values(table: dict[str, Any], path: str) -> Iterator[tuple[str, str]]:
    tag = table.get("kind")
    for key, value in table.items():
        for here in (f"{path}.{key}", *([f"{path}.{tag}.{key}"] if isinstance(tag, str) else [])):
            items = value if isinstance(value, list) else [value]
            if items and all(isinstance(item, dict) for item in items):
                for item in items:
                    yield from _values(item, here)
                    if len(item) < 4 and not any(isinstance(v, dict | list) for v in item.values()):
                        yield here, as_toml(value) if isinstance(value, dict) else ""
            elif len(as_toml(value)) <= 60:
                yield here, as_toml(value)


def _shipped(row: KeyRow, examples: dict[str, str]) -> str:
    """The value of a key in a file that ships; a body's composition has the keys of a part's."""
    of_part = row.path.replace("part.body.composition.", "part.composition.")
    return examples.get(row.path, "") or examples.get(of_part, "")


def _typical(row: KeyRow) -> str:
    value = _TYPICAL.get(row.key, "")
    fits = row.type.startswith("list") if value.startswith("[") else row.type == "number"
    return value if fits else ""


def _possible(row: KeyRow) -> str:
    """An example by type and range, for a key that no file has."""
    if row.default or row.type == KIND_OF_TABLE:
        return row.default
    if row.allowed.startswith('"'):
        return row.allowed.split(", ")[0]
    return {"text": '"..."', "true or false": "true", "table": "{ ... }",
            "list of tables": "[[...]]"}.get(row.type, _number(row))


def _number(row: KeyRow) -> str:
    words = row.allowed.split()
    low = words[1] if words[:1] in (["from"], ["above"]) and len(words) > 1 else "1"
    number = low if words[:1] == ["from"] and low != "0" else "1"
    if row.type.startswith("list of lists of "):
        kind = row.type.removeprefix("list of ").replace("lists", "list")
        inner = _number(row._replace(type=kind, allowed=""))
        return f"[{inner}, {inner.replace('1', '2')}, {inner.replace('1', '3', 1)}]"
    if row.type.startswith("list of "):
        count = row.type.split()[2]
        return f"[{', '.join([number] * (int(count) if count.isdigit() else 1))}]"
    return number if "number" in row.type else "..."


def main(arguments: list[str]) -> int:
    load_bench(None)  # what ships is read, too
    if missing := undocumented(all_rows()):
        print("\n".join(missing))
        return 1
    changed = stale()
    for path in changed:
        print(path.relative_to(ROOT))
    if arguments == ["--check"]:
        return 1 if changed else 0
    made = files()
    for path in changed:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(made[path], encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
