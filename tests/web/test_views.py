"""Views of one snapshot: metrics, SHDR and OPC UA show its values and have no way to act."""

from __future__ import annotations

import asyncio
import re
from contextlib import suppress
from datetime import UTC, datetime

import pytest

from lmctl.run.state.transitions import RunState
from lmctl.web.metrics import metrics_text
from lmctl.web.run_snapshot import live_snapshot
from lmctl.web.shdr import EXECUTION, ShdrAdapter, shdr_items, shdr_line

NOW = {
    "run": "run-0007", "part": 'a "part" \\ of two\nlines | halves', "machine": "cell",
    "operator": "Ada", "state": "depositing", "layer": 3, "layers": 12, "line": 120, "lines": 900,
    "done_s": 12.5, "remaining_s": 60.0, "override_percent": 80, "power_W": 1674.0,
    "speed_mm_s": 8.0, "shield_gas_L_min": None, "answer_age_s": 0.1,
    "position_mm": [1.5, -2.0, 0.8], "hoppers": ["A", "B"], "materials": ["316L", "WC-12Co"],
    "set_g_min": [2.87, 9.66], "measured_g_min": [2.8, None], "carrier_L_min": [4.0, 4.0],
    "reading_age_s": [1.25, 2.5],
    "levels": [{"hopper": "A", "level_percent": 85.0, "weight_g": None}],
    "warnings": [], "alarms": [], "interlocks": [
        {"name": "door", "state": "ok", "what": "", "hint": ""},
        {"name": "oxygen", "state": "not fitted", "what": "", "hint": ""},
        {"name": "path", "state": "tripped", "what": "off its path", "hint": "look"}],
    "origins": {"power_W": {"kind": "reported", "source": "x", "age_s": 0.3}},
    "mixture": {"materials": ["316L", "WC-12Co"], "planned": None, "commanded": [0.4, 0.6],
                "nozzle": [0.45, 0.55],
                "origins": {kind: {"age_s": 0.4} for kind in ("planned", "commanded", "nozzle")}},
}
ALARM = {"name": "door", "what": "the safety door is open", "where": [], "hint": "close it",
         "at_s": 3.0, "cleared_s": None}
_SAMPLE = re.compile(r'^(lmctl_\w+)(?:\{((?:\w+="(?:[^"\\\n]|\\.)*",?)*)\})? (-?[0-9.e+]+)$')


def samples(text):
    """{(name, labels): value}; fails for a line that is not of the exposition format."""
    found = {}
    for line in text.splitlines():
        if line.startswith(("# HELP ", "# TYPE ")):
            continue
        parsed = _SAMPLE.match(line)
        assert parsed, line
        key = parsed[1], parsed[2] or ""
        assert key not in found
        found[key] = float(parsed[3])
    return found


def test_metrics_are_the_snapshots_values_and_what_is_unknown_has_none():
    text = metrics_text([NOW, NOW | {"run": "run-0008"}])
    found = samples(text)
    assert found["lmctl_runs", ""] == 2

    def value(name, *labels):
        ones = [v for (n, own), v in found.items()
                if n == f"lmctl_{name}" and all(one in own for one in ('"run-0007"', *labels))]
        return ones[0] if len(ones) == 1 else ones

    assert value("beam_power_watts") == 1674.0
    assert value("shield_gas_litres_per_minute") == []
    assert value("powder_reported_grams_per_minute", 'hopper="A"') == 2.8
    assert value("powder_reported_grams_per_minute", 'hopper="B"') == []
    assert value("mixture_fraction", 'mixture="nozzle"', 'material="WC-12Co"') == 0.55
    assert value("mixture_fraction", 'mixture="planned"') == []
    assert value("interlock_ok", 'interlock="path"') == 0
    assert value("interlock_ok", 'interlock="oxygen"') == []
    assert value("state", 'state="depositing"') == 1
    assert len(re.findall("^# TYPE lmctl_layer gauge$", text, re.M)) == 1
    assert metrics_text([]).splitlines()[-1] == "lmctl_runs 0"


def test_a_run_of_an_older_version_is_shown_by_every_view_with_what_it_tells():
    opcua = pytest.importorskip("lmctl.web.opcua", reason="the extra `opcua` is not installed")
    old = {"run": "run-0001", "part": "p", "machine": "m", "operator": "", "layers": 2,
           "lines": 10, "hoppers": ["A"], "materials": ["316L"], "state": "calibrating"}
    now = live_snapshot(old, None, 0.25)
    assert (now["live"], now["power_W"], now["reading_age_s"]) == (True, None, [None])
    assert samples(metrics_text([now]))["lmctl_runs", ""] == 1
    assert shdr_items(now)["execution"] == "UNAVAILABLE"
    read = opcua.opcua_readings(now)
    assert read["JobManagement/RunInformation", "State"] == ("calibrating", 0.25)
    assert read["Equipment/Feedstock/A", "FlowActual"] == (None, None)


def test_every_state_has_an_execution_of_mtconnect():
    assert set(EXECUTION) == set(RunState)
    vocabulary = {"READY", "ACTIVE", "INTERRUPTED", "FEED_HOLD", "PROGRAM_STOPPED",
                  "PROGRAM_COMPLETED"}
    assert set(EXECUTION.values()) == vocabulary


def test_a_text_cannot_add_items_or_lines_to_shdr():
    at = datetime(2026, 3, 1, 8, tzinfo=UTC)
    plain, condition = shdr_line(shdr_items(NOW | {"alarms": [ALARM]}), at)
    assert plain.count(b"\n") == condition.count(b"\n") == 1
    fields = plain.decode().rstrip("\n").split("|")
    assert fields[0] == "2026-03-01T08:00:00.000Z"
    items = dict(zip(fields[1::2], fields[2::2], strict=True))
    assert items["program"] == 'a "part" \\ of two lines   halves'
    assert items["shield_gas"] == items["powder_actual_B"] == "UNAVAILABLE"
    assert (items["execution"], items["line"], items["path_feedrate"]) == ("ACTIVE", "120", "8")
    assert condition.decode().split("|")[1:] == [
        "system", "FAULT", "door", "1", "", "the safety door is open\n"]


def test_an_agent_gets_all_then_what_changes_and_nothing_it_sends_acts():
    shown = [dict(NOW)]

    async def main():
        adapter = ShdrAdapter(lambda: shown)
        async with adapter.serving("127.0.0.1", 0) as address:
            host, port = address.split(":")
            reader, writer = await asyncio.open_connection(host, int(port))
            first = [await reader.readline() for _ in range(2)]
            writer.write(b"* PING\n" + b"2026-03-01T08:00:00Z|execution|READY\n")
            assert await reader.readline() == b"* PONG 10000\n"
            shown[0] = shown[0] | {"line": 121, "alarms": [ALARM]}
            changed = [await reader.readline() for _ in range(2)]
            shown.clear()
            ended = [await reader.readline() for _ in range(2)]
            writer.write(b"x" * 100_000)
            with suppress(ConnectionResetError):
                assert await reader.read() == b""
            writer.close()
            return first, changed, ended

    first, changed, ended = asyncio.run(main())
    assert b"|avail|AVAILABLE|execution|ACTIVE|" in first[0]
    assert first[1].endswith(b"|system|NORMAL||||\n")
    assert changed[0].split(b"|", 1)[1] == b"line|121\n"
    assert b"|FAULT|door|" in changed[1]
    assert b"|execution|READY" in ended[0]
    assert b"powder_actual_A|UNAVAILABLE" in ended[0]


def test_an_opc_ua_client_reads_and_cannot_write():
    asyncua = pytest.importorskip("asyncua", reason="the extra `opcua` is not installed")
    from lmctl.web.opcua import NAMESPACE, OpcuaDoor

    shown = [NOW | {"alarms": [ALARM]}]

    async def main():
        async with (
            OpcuaDoor(lambda: shown, "127.0.0.1", 0) as address,
            asyncua.Client(address) as client,
        ):
            index = await client.get_namespace_index(NAMESPACE)

            async def node(path):
                steps = [f"{index}:{one}" for one in ("Machines", "LaserCladdingMachine",
                                                      *path.split("/"))]
                return await client.nodes.objects.get_child(steps)

            async def value(path):
                return await (await node(path)).read_value()

            assert await value("Identification/ComponentName") == "cell"
            assert await value("Equipment/Feedstock/B/Material") == "WC-12Co"
            assert await value("Equipment/Feedstock/A/FlowActual") == 2.8
            assert await value("JobManagement/RunInformation/State") == "depositing"
            assert await value("JobManagement/RunInformation/CurrentLayer") == 3
            assert await value("Monitoring/Process/MixtureAtNozzleInferred/316L") == 0.45
            assert await value("Monitoring/Health/path") == "tripped"
            assert await value("Notification/Messages/FirstAlarmRemedy") == "close it"
            power = await node("Monitoring/Process/BeamPower")
            read = await power.read_data_value()
            age_s = (read.ServerTimestamp - read.SourceTimestamp).total_seconds()
            assert (read.Value.Value, round(age_s, 3)) == (1674.0, 0.3)
            read = await (await node("Equipment/Feedstock/A/FlowActual")).read_data_value()
            age_s = (read.ServerTimestamp - read.SourceTimestamp).total_seconds()
            assert round(age_s, 3) == 1.25
            unknown = await (await node("Equipment/Feedstock/B/FlowActual")).read_data_value(
                raise_on_bad_status=False)
            assert not unknown.StatusCode.is_good()

            refusals = (asyncua.ua.UaStatusCodeError,)
            with pytest.raises(refusals):
                await power.write_value(0.0)
            with pytest.raises(refusals):
                await client.nodes.objects.add_object(index, "Mine")
            with pytest.raises(refusals):
                await client.delete_nodes([power])
            shown[0] = shown[0] | {"line": 121, "power_W": None}
            for _ in range(300):
                if await value("JobManagement/RunInformation/CurrentLine") == 121:
                    break
                await asyncio.sleep(0.1)
            gone = await power.read_data_value(raise_on_bad_status=False)
            assert not gone.StatusCode.is_good()
            shown.clear()
            for _ in range(300):
                if await value("JobManagement/RunInformation/State") == "no run":
                    break
                await asyncio.sleep(0.1)
            assert await value("JobManagement/RunInformation/State") == "no run"

    asyncio.run(main())
