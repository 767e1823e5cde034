"""`Devices.xml` describes the items that the SHDR adapter sends: all of them, and no others."""

from __future__ import annotations

from collections import Counter
from datetime import UTC, datetime
from xml.etree import ElementTree

from lmctl.cli.__main__ import main
from lmctl.config.machine import load_profile
from lmctl.web.mtconnect_devices import NAMESPACE, devices_xml
from lmctl.web.shdr import shdr_items
from tests.run.whole.conftest import EXAMPLES
from tests.web.test_views import ALARM, NOW

AT = datetime(2026, 3, 1, 8, tzinfo=UTC)
ODD = ["A", "B 2", "Ni<&>\"5"]
_NAME = f"{{{NAMESPACE}}}"


def items_of(text):
    """{name: attributes} of every data item; no name and no identifier occurs twice."""
    root = ElementTree.fromstring(text)
    found = [one.attrib for one in root.iter(f"{_NAME}DataItem")]
    identifiers = Counter(one.get("id") for one in root.iter() if one.get("id"))
    assert set(identifiers.values()) == {1}
    assert all(one.replace("_", "").isalnum() for one in identifiers)
    assert len({one["name"] for one in found}) == len(found)
    return {one["name"]: one for one in found}


def test_every_item_that_is_sent_is_described_and_no_other():
    flows = [1.0] * len(ODD)
    now = NOW | {"hoppers": ODD, "set_g_min": flows, "measured_g_min": flows, "alarms": [ALARM]}
    described = items_of(devices_xml("cell", ODD, AT))
    assert described.keys() == shdr_items(now).keys()
    assert shdr_items(None).keys() <= described.keys()


def test_categories_units_and_form_are_those_of_what_is_sent():
    described = items_of(devices_xml("cell", ["A"], AT))
    sent = shdr_items(NOW | {"hoppers": ["A"], "shield_gas_L_min": 12.0})
    for name, item in described.items():
        is_condition = item["category"] == "CONDITION"
        assert is_condition == ("|" in sent[name])
        if item["category"] == "SAMPLE":
            float(sent[name])
            assert item["units"]
    assert described["path_feedrate"]["units"] == "MILLIMETER/SECOND"  # speed_mm_s is sent
    assert described["shield_gas"]["nativeUnits"] == "LITER/MINUTE"    # L/min is sent
    assert described["powder_actual_A"]["units"] == "x:GRAM_PER_MINUTE"
    assert described["x_act"]["coordinateSystem"] == "WORK"


def test_a_description_is_written_for_the_cell_of_a_profile(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cell.toml").write_text((EXAMPLES / "cell.toml").read_text())
    assert main(["machine", "devices-xml", "--machine", "cell.toml", "-o", "Devices.xml"]) == 0
    text = (tmp_path / "Devices.xml").read_text("utf-8")
    profile = load_profile(EXAMPLES / "cell.toml")
    assert {name for name in items_of(text) if name.startswith("powder_actual")} == {
        f"powder_actual_{one.name}" for one in profile.hopper}
    device = ElementTree.fromstring(text).find(f"{_NAME}Devices/{_NAME}Device")
    assert device.get("name") == profile.name
    capsys.readouterr()
    assert main(["machine", "devices-xml"]) == 0
    assert "MTConnectDevices" in capsys.readouterr().out
    assert main(["machine", "devices-xml", "-o", "no/such/folder.xml"]) == 2
    assert "cannot write" in capsys.readouterr().err
