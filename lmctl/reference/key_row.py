"""One key of one kind of file: its type, unit, default, range, an example and what it means."""

from __future__ import annotations

from typing import Any, NamedTuple

#: Kinds of files, by the first word of a key's path, each in words.
FILE_KINDS = {
    "part": "the part file", "machine": "the machine profile", "bench": "the simulated cell",
    "fault": "faults of the simulated cell", "map": "the register map of a device",
}

#: Type of a row that stands for tables of one kind, and not for a key.
KIND_OF_TABLE = "kind of table"

#: Units by the end of a key's name, the longest first.
_UNITS = {
    "_g_mm3": "g/mm³", "_g_cm3": "g/cm³", "_mm_min": "mm/min", "_mm_s2": "mm/s²", "_mm_s": "mm/s",
    "_g_min": "g/min", "_g_rev": "g/rev", "_L_min": "L/min", "_W_m_K": "W/(m·K)",
    "_W_mm2_K": "W/(mm²·K)", "_W_mm2": "W/mm²", "_J_mm3": "J/mm³", "_1e6_K": "10⁻⁶/K",
    "_per_h": "1/h", "_per_kg": "1/kg", "_per_s": "1/s", "_per_K": "1/K", "_mbar": "mbar",
    "_ppm": "ppm", "_GPa": "GPa", "_MPa": "MPa", "_percent": "%", "_days": "d", "_deg": "°",
    "_rpm": "1/min", "_mm3": "mm³", "_mm2": "mm²", "_mm": "mm", "_um": "µm", "_ms": "ms",
    "_s": "s", "_W": "W", "_J": "J", "_N": "N", "_C": "°C", "_K": "K", "_g": "g", "_Pa": "Pa",
    "_h": "h", "_V": "V",
}


class KeyRow(NamedTuple):
    """path : dotted, the file's kind first; a table that has kinds is followed by the kind

    type : in words; unit : "" for none
    default : as TOML; "" where the key must be given or is left out
    allowed : limits or choices, in words
    example : as TOML
    text : what it means, in a sentence or less
    same_as : the table whose keys it has, where they are described there
    """

    path: str
    type: str
    unit: str
    default: str
    is_required: bool
    allowed: str
    example: str
    text: str
    same_as: str

    @property
    def key(self) -> str:
        """The key itself."""
        return self.path.rpartition(".")[2]


def unit_of_key(key: str) -> str:
    """The unit in a key's name; "" for none.

    >>> unit_of_key("max_speed_mm_s")
    'mm/s'
    """
    return next((unit for end, unit in _UNITS.items() if key.endswith(end)), "")


def as_toml(value: Any) -> str:
    """A value as TOML writes it.

    >>> as_toml({"316L": 1.0, "on": True})
    '{ 316L = 1.0, on = true }'
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
    if isinstance(value, int | float):
        return f"{value:_}" if isinstance(value, int) and abs(value) >= 100_000 else repr(value)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, dict):
        inner = ", ".join(f"{_bare(key)} = {as_toml(item)}" for key, item in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    return ""


def _bare(key: str) -> str:
    plain = key.replace("-", "").replace("_", "").isalnum() and key.isascii()
    return key if plain else as_toml(key)
