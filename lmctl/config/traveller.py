"""What accompanies a part on paper: numbers, lots and certificates that no machine can report.

A part file may state them under `[traveller]`, and `lmctl report --set KEY=VALUE` adds or replaces
them; what is not stated is left as a ruled blank to be filled in by hand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Annotated

from pydantic import Field

from lmctl.config.toml_file import ConfigModel
from lmctl.errors import UsageError

Text = Annotated[str, Field(min_length=1, max_length=200)]

#: Table of the powders within the traveller: its keys are names of materials.
POWDER = "powder"


class PowderLot(ConfigModel):
    """One powder as it was filled in.

    reuse_count : how often it has been through a machine before
    lot, certificate, supplier : as on the can
    sieve : mesh or aperture it passed
    """

    lot: Text | None = None
    certificate: Text | None = None
    supplier: Text | None = None
    reuse_count: Annotated[int, Field(ge=0, le=10_000)] | None = None
    sieve: Text | None = None


class TravellerSettings(ConfigModel):
    """Numbers and names of one part. Every key may be absent.

    nozzle : its name or number
    part_number, serial, order, customer, drawing, drawing_revision : of the part
    machine_serial : of the machine
    gas_lot : of the gas
    substrate, substrate_lot : what is deposited on
    gas : shield and carrier gas with their grade
    procedure : the qualified procedure the part is made by
    powder : lots by the name of the material
    """

    part_number: Text | None = None
    serial: Text | None = None
    order: Text | None = None
    customer: Text | None = None
    drawing: Text | None = None
    drawing_revision: Text | None = None
    procedure: Text | None = None
    machine_serial: Text | None = None
    nozzle: Text | None = None
    substrate: Text | None = None
    substrate_lot: Text | None = None
    gas: Text | None = None
    gas_lot: Text | None = None
    powder: dict[Text, PowderLot] = Field(default_factory=dict)


def with_stated_values(
    traveller: TravellerSettings, assignments: Sequence[str], materials: Sequence[str]
) -> TravellerSettings:
    """The traveller with what `--set KEY=VALUE` states.

    assignments : "serial=17", "powder.316L.lot=A4711"; later ones win
    Raises UsageError with every mistake at once.
    """
    mistakes: list[str] = []
    values = traveller.model_dump(exclude_none=True)
    for text in assignments:
        key, equals, value = text.partition("=")
        if not equals or not key.strip() or not value.strip():
            mistakes.append(f"{text!r} is not KEY=VALUE")
            continue
        found = _place_of(key.strip(), materials)
        if isinstance(found, str):
            mistakes.append(found)
            continue
        settled = _checked(found[-1], value.strip())
        if settled is None:
            mistakes.append(f"{key.strip()}: {value.strip()[:60]!r} cannot be its value")
            continue
        table = values
        for step in found[:-1]:
            table = table.setdefault(step, {})
        table[found[-1]] = settled
    if mistakes:
        raise UsageError("--set cannot be understood", where=mistakes,
                         hint="keys are " + ", ".join(_keys(materials)))
    return TravellerSettings.model_validate(values)


def _place_of(key: str, materials: Sequence[str]) -> tuple[str, ...] | str:
    """The steps to a key; or what is wrong with it. Names of materials may hold dots."""
    if key in TravellerSettings.model_fields and key != POWDER:
        return (key,)
    for material in materials:
        name, dot, last = key.rpartition(".")
        if dot and name == f"{POWDER}.{material}" and last in PowderLot.model_fields:
            return (POWDER, material, last)
    near = get_close_matches(key, _keys(materials), n=1, cutoff=0.5)
    return f"there is no key {key!r}" + (f"; did you mean {near[0]!r}?" if near else "")


def _checked(key: str, value: str) -> str | int | None:
    if key != "reuse_count":
        return value if len(value) <= 200 else None
    return int(value) if value.isascii() and value.isdigit() and len(value) <= 4 else None


def _keys(materials: Sequence[str]) -> list[str]:
    return [
        *(key for key in TravellerSettings.model_fields if key != POWDER),
        *(f"{POWDER}.{name}.{key}" for name in materials for key in PowderLot.model_fields),
    ]


def unknown_powders(powder: Mapping[str, object], materials: Sequence[str]) -> list[str]:
    """Names in the powder table that are no material of the part."""
    return [name for name in powder if name not in materials]
