"""Whole parts with feeders that have register maps of their own."""

from __future__ import annotations

import asyncio

import pytest

from firmware_protocol.map_file import load_map
from lmctl.config.machine import SafetySettings, load_profile
from lmctl.job.reader import JobReader
from lmctl.run.executor import RunExecutor
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from tests.machine.independent_feeders import FEEDERS
from tests.run.whole.conftest import EXAMPLES, wired

#: A bench with a safety device whose relay is in the drives of feeders without watchdog.
SAFETY = (("[scale]", "[safety]\nwatchdog_relay = true\n[scale]"),)
PTY = (('endpoint = "modbus-tcp://127.0.0.1:5021"', 'endpoint = "pty"'),)
#: What a device resolves of a flow, over the flow of 6 g/min.
SHARE = {"coils": 0.01 / 2 / 6, "rtu": 0.0, "tcp": 0.0, "analog": 75 / 27648 / 2 / 6}


@pytest.fixture(scope="module")
def cell():
    """The shipped cell, with its first feeder by one of the example maps."""
    profile = load_profile(EXAMPLES / "cell.toml")

    def with_map(name):
        device_map = load_map(EXAMPLES / f"feeder-{name}.toml")
        first, *others = profile.feeder
        first = first.model_copy(update={
            "map": name, "stopped_by_relay": not device_map.feeder.has_watchdog})
        return profile.model_copy(update={
            "feeder": (first.with_device_map(device_map), *others),
            "safety": SafetySettings(endpoint="modbus-tcp://127.0.0.1:1", relay_timeout_s=0.3),
        })

    return with_map


@pytest.fixture
def varying_job(tmp_path, job_file, profile):
    """Three layers of squares whose mixture changes along the way."""
    layers = job_file.squares(layers=3, per_layer=2, side_mm=8.0)
    flow = [(0.0, (0.10, 0.10)), (6.0, (0.10, 0.10)), (9.0, (0.16, 0.04)), (14.0, (0.05, 0.15)),
            (40.0, (0.05, 0.15))]
    job_file(tmp_path / "job.lmj", profile, layers, flow=flow)
    return tmp_path / "job.lmj"


@pytest.fixture
def as_pmx(run, varying_job):
    """The same job on the bench as it ships."""
    return run(varying_job)


@pytest.mark.parametrize("name", FEEDERS)
def test_a_part_is_deposited_with_a_device_made_from_the_map(name, cell, run, varying_job, as_pmx):
    """As evenly as with a PMX: only its registers, and the steps of a set-point, differ."""
    one = run(varying_job, profile=cell(name), bench=SAFETY + (PTY if name == "rtu" else ()))
    assert one.error is None
    assert one.result.state == "done"
    assert one.flow_error().max() <= as_pmx.flow_error().max() + 0.01 + SHARE[name]
    one.check_safe()
    told = [notice for notice in one.notices if "no watchdog" in notice]
    assert len(told) == (0 if name in ("rtu", "coils") else 1)


@pytest.mark.parametrize("name", FEEDERS)
def test_a_part_is_deposited_with_a_device_written_by_hand(
    name, cell, tmp_path, varying_job, as_pmx
):
    async def main():
        text = (EXAMPLES / "bench.toml").read_text().replace(*SAFETY[0])
        by_hand = FEEDERS[name]()
        async with (
            Bench(BenchConfig.parse(text), ephemeral_ports=True) as bench,
            by_hand.served() as endpoint,
        ):
            profile = wired(cell(name), {**bench.endpoints, "F1": endpoint})
            executor = RunExecutor(varying_job, profile, tmp_path / "runs", operator="Ada")
            return (await executor.run()), by_hand.fed_g(1), by_hand

    result, fed_g, by_hand = virtual_time.run_in_virtual_time(main())
    assert result.state == "done"
    assert by_hand.flows_g_min == (0.0, 0.0)
    assert max(flows[1] for _, flows in by_hand.history) == 0.0  # a hopper that is not in use
    hopper = as_pmx.bench.feeders["F1"].hoppers[1]
    # Both feed the whole job and the time to settle before it, which a period more or less moves.
    assert fed_g == pytest.approx(hopper.process.fed_g(1e9), rel=0.05)
    with JobReader(varying_job) as job:
        most = max(float(layer.flow_g_s[:, 0].max()) for layer in job.iterate_layers())
    assert 60 * most <= max(flows[0] for _, flows in by_hand.history) <= 60 * 1.1 * most


@pytest.mark.parametrize("name", ["tcp", "analog"])
def test_the_relay_stops_a_feeder_without_watchdog_when_the_host_is_gone(name, cell, varying_job,
                                                                        tmp_path):
    """The host is suspended: heartbeats to the safety device end, and its relay opens."""
    async def main():
        text = (EXAMPLES / "bench.toml").read_text().replace(*SAFETY[0])
        profile = cell(name)
        bench = Bench(BenchConfig.parse(text), ephemeral_ports=True,
                      maps={"F1": profile.feeder[0].device_map}, relay_feeders=["F1"])
        async with bench:
            executor = RunExecutor(varying_job, wired(profile, bench.endpoints),
                                   tmp_path / "runs", operator="Ada")
            task = asyncio.create_task(executor.run())
            device = bench.feeders["F1"]
            while not device.discs_on:
                assert not task.done()
                await asyncio.sleep(0.1)
            await asyncio.sleep(5.0)
            gone_s = asyncio.get_running_loop().time()
            for edge in bench.edges.values():
                edge.to_device = lambda data, take: None  # nothing of the host arrives any more
            await asyncio.sleep(3.0)
            device.advance_to_now()
            assert not device.discs_on
            assert device.spans[-1].end_s - gone_s < 0.5
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    virtual_time.run_in_virtual_time(main())

