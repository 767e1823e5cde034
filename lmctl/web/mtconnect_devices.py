"""`Devices.xml` of a cell for an MTConnect agent: what the items mean that the SHDR adapter sends.

Form: MTConnectDevices 2.0. Flow of powder by mass is no type of the standard, and has an extended
one, `x:POWDER_FLOW`.
"""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import NamedTuple
from xml.etree import ElementTree

from lmctl import __version__

VERSION = "2.0"
NAMESPACE = f"urn:mtconnect.org:MTConnectDevices:{VERSION}"
#: Of extended types; an agent is told of it in its `StreamsNamespaces`.
EXTENSION = "urn:lmctl:mtconnect:1"

#: Kept by an agent; what a file of ours says of it has no effect.
_HEADER = {"instanceId": "1", "bufferSize": "131072", "assetBufferSize": "1024", "assetCount": "0"}


class DataItem(NamedTuple):
    """One data item. name : that of its SHDR item

    native : the unit that is sent, where the standard has another one; the agent converts
    """

    name: str
    category: str
    type: str
    sub_type: str = ""
    units: str = ""
    native: str = ""
    coordinates: str = ""


_AVAILABILITY = DataItem("avail", "EVENT", "AVAILABILITY")
_AXES = {axis: DataItem(f"{axis.lower()}_act", "SAMPLE", "POSITION", "ACTUAL", "MILLIMETER",
                        coordinates="WORK") for axis in "XYZ"}
_CONTROLLER = (DataItem("system", "CONDITION", "SYSTEM"),)
_PATH = (
    DataItem("execution", "EVENT", "EXECUTION"), DataItem("program", "EVENT", "PROGRAM"),
    DataItem("line", "EVENT", "LINE_NUMBER", "ABSOLUTE"),
    DataItem("path_feedrate", "SAMPLE", "PATH_FEEDRATE", "ACTUAL", "MILLIMETER/SECOND"),
    DataItem("path_feedrate_override", "EVENT", "PATH_FEEDRATE_OVERRIDE", "PROGRAMMED"),
)
_BEAM = (DataItem("laser_power", "SAMPLE", "WATTAGE", "ACTUAL", "WATT"),)
_GAS = DataItem("shield_gas", "SAMPLE", "FLOW", "", "LITER/SECOND", "LITER/MINUTE")


def devices_xml(machine: str, hoppers: Sequence[str], at: datetime) -> str:
    """The document of one cell. machine, hoppers : names of its profile; at : UTC"""
    stamp = at.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    root = ElementTree.Element("MTConnectDevices", {"xmlns": NAMESPACE, "xmlns:x": EXTENSION})
    ElementTree.SubElement(root, "Header", {
        "version": VERSION, "creationTime": stamp, "deviceModelChangeTime": stamp,
        "sender": "lmctl", **_HEADER})
    device = ElementTree.SubElement(ElementTree.SubElement(root, "Devices"), "Device", {
        "id": "cell", "name": machine, "uuid": str(uuid.uuid5(uuid.NAMESPACE_URL,
                                                              f"urn:lmctl:{machine}"))})
    description = ElementTree.SubElement(device, "Description")
    description.text = f"laser cladding machine, sent by lmctl {__version__}"
    _add_items(device, (_AVAILABILITY,))
    parts = ElementTree.SubElement(device, "Components")
    axes = ElementTree.SubElement(_component(parts, "Axes", "axes", ()), "Components")
    for axis, item in _AXES.items():
        _component(axes, "Linear", f"axis_{axis.lower()}", (item,), axis)
    controller = _component(parts, "Controller", "controller", _CONTROLLER)
    _component(ElementTree.SubElement(controller, "Components"), "Path", "path", _PATH)
    systems = ElementTree.SubElement(_component(parts, "Systems", "systems", ()), "Components")
    _component(systems, "ProcessPower", "laser", _BEAM)
    auxiliaries = ElementTree.SubElement(
        _component(parts, "Auxiliaries", "auxiliaries", ()), "Components")
    _component(auxiliaries, "Deposition", "deposition", (_GAS, *(
        DataItem(f"powder_{which}_{name}", "SAMPLE", "x:POWDER_FLOW", sub_type,
                 "x:GRAM_PER_MINUTE")
        for name in hoppers
        for which, sub_type in (("commanded", "COMMANDED"), ("actual", "ACTUAL")))))
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, "unicode")}\n'


def _component(
    into: ElementTree.Element, kind: str, identifier: str, items: Sequence[DataItem],
    name: str = "",
) -> ElementTree.Element:
    made = ElementTree.SubElement(into, kind, {"id": identifier, "name": name or identifier})
    if items:
        _add_items(made, items)
    return made


def _add_items(into: ElementTree.Element, items: Sequence[DataItem]) -> None:
    """Identifiers are numbered, since names of hoppers may hold what an identifier may not."""
    listed = ElementTree.SubElement(into, "DataItems")
    for number, item in enumerate(items, 1):
        optional = {"subType": item.sub_type, "units": item.units, "nativeUnits": item.native,
                    "coordinateSystem": item.coordinates}
        ElementTree.SubElement(listed, "DataItem", {
            "id": f"{into.get('id')}_{number}", "name": item.name, "category": item.category,
            "type": item.type, **{key: value for key, value in optional.items() if value}})
