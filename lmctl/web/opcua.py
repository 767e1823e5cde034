"""OPC UA server for reading: the snapshot of the run under way under the names of OPC 40540.

Names and arrangement are those of OPC 40540 (additive manufacturing) and of what it builds on:
`Machines`, `Identification`, `Equipment/Feedstock`, `Monitoring/Process`, `Monitoring/Health`,
`JobManagement/RunInformation` and `Notification/Messages`. Types are plain objects and variables
in a namespace of our own: its node sets are not loaded and no conformity is claimed. Nothing can be
written and there are no methods.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from types import TracebackType
from typing import Any

from asyncua import Server, ua

from lmctl import __version__
from lmctl.errors import UsageError

NAMESPACE = "urn:lmctl:live"

#: Between two updates of the nodes [s].
_PERIOD_S = 0.5

#: (folder, name, key of the snapshot, unit) of single values
_VALUES = (
    ("Monitoring/Process", "BeamPower", "power_W", "W"),
    ("Monitoring/Process", "FeedSpeed", "speed_mm_s", "mm/s"),
    ("Monitoring/Process", "ShieldGasFlow", "shield_gas_L_min", "L/min"),
    ("Monitoring/Process", "FeedOverride", "override_percent", "%"),
    ("JobManagement/RunInformation", "CurrentLayer", "layer", ""),
    ("JobManagement/RunInformation", "NumberOfLayers", "layers", ""),
    ("JobManagement/RunInformation", "CurrentLine", "line", ""),
    ("JobManagement/RunInformation", "RemainingTime", "remaining_s", "s"),
)
_TEXTS = (
    ("Identification", "ComponentName", "machine"),
    ("JobManagement/RunInformation", "RunId", "run"),
    ("JobManagement/RunInformation", "PartName", "part"),
    ("JobManagement/RunInformation", "State", "state"),
    ("JobManagement/RunInformation", "Operator", "operator"),
)
_OF_HOPPER = (
    ("FlowCommanded", "set_g_min", "g/min"), ("FlowActual", "measured_g_min", "g/min"),
    ("CarrierGasFlow", "carrier_L_min", "L/min"),
)
_OF_LEVEL = (("Level", "level_percent", "%"), ("RemainingAmount", "weight_g", "g"))

Reading = tuple[Any, float | None]


class OpcuaDoor:
    """The server. Use as an async context manager; entering gives its address.

    snapshots : of the runs under way, oldest first; the last one is shown
    Entering raises UsageError where the port is in use.
    """

    def __init__(
        self, snapshots: Callable[[], list[dict[str, Any]]], host: str, port: int
    ) -> None:
        self._snapshots = snapshots
        self._endpoint = f"opc.tcp://{host}:{port or _free_port(host)}/lmctl"
        self._server = Server()
        self._nodes: dict[tuple[str, str], Any] = {}
        self._folders: dict[str, Any] = {}
        self._shown: dict[tuple[str, str], Reading] = {}
        self._index = 0
        self._updating: asyncio.Task[None] | None = None

    async def __aenter__(self) -> str:
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        await self._server.init()
        self._server.set_endpoint(self._endpoint)
        self._server.set_server_name("lmctl")
        self._server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        self._index = await self._server.register_namespace(NAMESPACE)
        await self._update()
        try:
            await self._server.start()
        except OSError as error:
            raise UsageError(f"cannot listen at {self._endpoint}",
                             where=str(error.strerror or error),
                             hint="--opcua names another port") from None
        self._updating = asyncio.create_task(self._update_on(), name="OPC UA nodes")
        return self._endpoint

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._updating is not None:
            self._updating.cancel()
            await asyncio.gather(self._updating, return_exceptions=True)
        with suppress(Exception):  # a client that hangs must not keep the page from ending
            async with asyncio.timeout(2.0):
                await self._server.stop()

    async def _update_on(self) -> None:
        try:
            while True:
                await self._update()
                await asyncio.sleep(_PERIOD_S)
        except Exception:  # values that no longer change must not look as if they did
            await self._server.stop()
            raise

    async def _update(self) -> None:
        live = self._snapshots()
        readings = opcua_readings(live[-1] if live else None)
        for place, (value, _) in self._shown.items():
            if place not in readings and value is not None:
                readings[place] = None, None
        for place, reading in readings.items():
            if self._shown.get(place) != reading or place not in self._nodes:
                await self._write(place, reading)
        self._shown = readings

    async def _write(self, place: tuple[str, str], reading: Reading) -> None:
        value, age_s = reading
        node = self._nodes.get(place)
        if node is None:
            folder = await self._folder(place[0])
            initial = ua.Variant(value, _type_of(value)) if value is not None else ua.Variant(
                None, ua.VariantType.Null)
            node = self._nodes[place] = await folder.add_variable(
                ua.NodeId(f"{place[0]}/{place[1]}", self._index), f"{self._index}:{place[1]}",
                initial, datatype=None if value is not None else ua.NodeId(
                    ua.ObjectIds.BaseDataType))
        now = datetime.now(UTC)
        status = ua.StatusCodes.Good if value is not None else ua.StatusCodes.BadNoData
        await node.write_value(ua.DataValue(
            ua.Variant(value, _type_of(value)), ua.StatusCode(status),
            SourceTimestamp=now - timedelta(seconds=age_s or 0.0), ServerTimestamp=now))

    async def _folder(self, path: str) -> Any:
        """The object at a path below the machine; made where it is missing."""
        if path not in self._folders:
            before, _, name = path.rpartition("/")
            if not before and name != _MACHINE:
                before = _MACHINE
            parent = self._server.nodes.objects
            if name == _MACHINE and not before:
                parent = await parent.add_folder(
                    ua.NodeId("Machines", self._index), f"{self._index}:Machines")
            else:
                parent = await self._folder(before)
            self._folders[path] = await parent.add_object(
                ua.NodeId(path, self._index), f"{self._index}:{name}")
        return self._folders[path]


#: The object of the machine below `Machines`.
_MACHINE = "LaserCladdingMachine"


def opcua_readings(now: Mapping[str, Any] | None) -> dict[tuple[str, str], Reading]:
    """{(folder, name): value and its age [s]} of a snapshot; None: no run is under way."""
    readings: dict[tuple[str, str], Reading] = {
        ("Identification", "Manufacturer"): ("", None),
        ("Identification", "SoftwareRevision"): (f"lmctl {__version__}", None),
        ("Identification", "AMTechnologyIdentifier"): ("Directed Energy Deposition", None),
        ("JobManagement/RunInformation", "State"): ("no run", None),
        ("Notification/Messages", "NumberOfAlarms"): (0, None),
    }
    if now is None:
        return readings
    origins = now["origins"]

    def age_s(key: str) -> float | None:
        age: float | None = origins.get(key, {}).get("age_s", now["answer_age_s"])
        return age

    for folder, name, key in _TEXTS:
        readings[folder, name] = str(now[key]), now["answer_age_s"]
    for folder, name, key, _ in _VALUES:
        readings[folder, name] = now[key], age_s(key)
    for axis, value in zip("XYZ", now["position_mm"] or (None,) * 3, strict=False):
        readings["Monitoring/Process", f"Position{axis}"] = value, age_s("position_mm")
    levels = {level["hopper"]: level for level in now["levels"]}
    for at, hopper in enumerate(now["hoppers"]):
        folder = f"Equipment/Feedstock/{hopper}"
        readings[folder, "Material"] = now["materials"][at], None
        read_s = now["reading_age_s"][at]
        for name, key, _ in _OF_HOPPER:
            readings[folder, name] = (
                now[key][at] if now[key] else None,
                age_s(key) if key == "set_g_min" else read_s)
        for name, key, _ in _OF_LEVEL:
            readings[folder, name] = levels.get(hopper, {}).get(key), read_s
    mixture = now["mixture"]
    if mixture is not None:
        for kind, name in (("planned", "MixturePlanned"), ("commanded", "MixtureCommanded"),
                           ("nozzle", "MixtureAtNozzleInferred")):
            for material, fraction in zip(
                mixture["materials"], mixture[kind] or [None] * len(mixture["materials"]),
                strict=True,
            ):
                readings[f"Monitoring/Process/{name}", material] = (
                    fraction, mixture["origins"][kind]["age_s"])
    for row in now["interlocks"]:
        readings["Monitoring/Health", row["name"]] = row["state"], now["answer_age_s"]
    active = [one for one in now["alarms"] if one["cleared_s"] is None]
    readings["Notification/Messages", "NumberOfAlarms"] = len(active), now["answer_age_s"]
    for name, key in (("FirstAlarm", "what"), ("FirstAlarmRemedy", "hint")):
        readings["Notification/Messages", name] = (
            active[0][key] if active else ""), now["answer_age_s"]
    return readings


def _free_port(host: str) -> int:
    """A free port; the server cannot be asked which one the system gave it."""
    with socket.create_server((host, 0)) as listening:
        port: int = listening.getsockname()[1]
        return port


def _type_of(value: Any) -> Any:
    if value is None:
        return ua.VariantType.Null
    if isinstance(value, bool):
        return ua.VariantType.Boolean
    return {int: ua.VariantType.Int64, float: ua.VariantType.Double}.get(
        type(value), ua.VariantType.String)
