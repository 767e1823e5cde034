"""Whether a connected cell is accepted for a run, and as what: before anything of it is moved."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from lmctl.config.machine import MachineProfile
from lmctl.errors import MachineError
from lmctl.job.reader import JobReader
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.machine.manual.inspect_motion import read_motion
from lmctl.machine.motion.driver import MotionDriver
from lmctl.run.cell.condition import StartCondition, refuse_unmet
from lmctl.run.cell.devices import Cell
from lmctl.run.cell.feeder_conditions import FeederSnapshot, feeder_conditions
from lmctl.run.cell.motion_conditions import can_read_door_and_estop, motion_conditions
from lmctl.run.cell.safety_conditions import safety_conditions
from lmctl.run.journal.earlier_run import EarlierRun
from lmctl.run.journal.last_known_position import LastKnownPosition
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.program.beam_off import line_without_beam

#: A machine that has not moved reports the same place [mm].
_SAME_MM = 0.01


async def accept_machine(
    cell: Cell, profile: MachineProfile, job: JobReader, recorder: RunRecorder,
    whereabouts: LastKnownPosition, *, run: str, continues: EarlierRun | None,
) -> bool:
    """Judge the machine, journal what it is, and note that `run` will move it.

    continues : what an earlier run has left, so latched alarms are reset first
    Returns whether the beam stays off: every power of the job is then sent as zero, and the job
    has been read through for lines that this would refuse.
    Raises MachineError, JobError.
    """
    motion, identity = cell.motion, cell.motion.identity
    whereabouts.judge_position(motion)
    # Beam on only where door and emergency stop are monitored, or on a bench, which has no beam.
    beam_off = not (identity.is_bench or can_read_door_and_estop(profile))
    recorder.record_machine(
        dialect=identity.dialect.name, version=identity.version, info=identity.info,
        rx_bytes=identity.rx_bytes, planner_blocks=identity.planner_blocks,
        is_bench=identity.is_bench, beam_off=beam_off,
        position_trusted=motion.position_trusted,
    )
    if continues is not None:
        _refuse_displaced(motion, continues)
        if continues.is_position_trusted:
            motion.trust_position()
        await reset_alarms(cell, [f for f in cell.feeders if f.status and f.status.alarm])
    reading = await read_motion(motion)
    refuse_unmet({
        f"motion controller at {profile.motion.endpoint}": motion_conditions(reading, profile),
        **{f"feeder {feeder.name}": await _feeder_conditions(feeder, profile)
           for feeder in cell.feeders},
        **_safety_conditions(cell, profile),
    })
    cell.offset_mm = reading.offset_mm or ()
    whereabouts.record_run_start(motion, run, profile.motion)
    if beam_off:
        await _read_through(job)
    return beam_off


async def _feeder_conditions(driver: FeederDriver, profile: MachineProfile) -> list[StartCondition]:
    status = await driver.complete_status()
    (feeder,) = [one for one in profile.feeder if one.name == driver.name]
    reading = FeederSnapshot(driver.identity, status, {}, is_commanded_by_this_host=True)
    return list(feeder_conditions(reading, feeder, driver.hoppers,
                                  send_horizon_s=profile.motion.send_horizon_s))


def _safety_conditions(cell: Cell, profile: MachineProfile) -> dict[str, list[StartCondition]]:
    if cell.safety is None or cell.safety.status is None or profile.safety is None:
        return {}
    return {"safety device": list(safety_conditions(cell.safety.status, profile.safety))}


def _refuse_displaced(motion: MotionDriver, continues: EarlierRun) -> None:
    """Raise MachineError where the machine is not where it was when the recovery was decided on.

    Some boards restart when their port is opened, and then report position zero.
    """
    at_mm, expected_mm = motion.position_mm, continues.standstill_mm
    if expected_mm is None or at_mm is None:
        return
    if any(abs(now - then) > _SAME_MM for now, then in zip(at_mm, expected_mm, strict=False)):
        raise MachineError(
            "the controller says another place than a moment ago: it has restarted, or was moved",
            where=f"it reports {_text(at_mm)}, and reported {_text(expected_mm)} before",
            hint="keep the board from restarting when its port is opened (DTR); "
                 f"then recover {continues.run} again",
        )


def _text(at_mm: Sequence[float]) -> str:
    return " ".join(f"{axis}{value:.3f}" for axis, value in zip("XYZ", at_mm, strict=False))


def refuse_unready(active: Sequence[MachineError]) -> None:
    """Raise MachineError where interlocks keep the run from starting, all in one."""
    if active:
        raise MachineError(
            "the cell is not ready", where=[alarm.what for alarm in active],
            hint="; ".join(dict.fromkeys(alarm.hint for alarm in active if alarm.hint)),
        )


async def reset_alarms(cell: Cell, faulty: Sequence[FeederDriver]) -> None:
    """Close an open watchdog relay, and reset these feeders' alarms where their cause is gone.

    Raises MachineError.
    """
    safety = cell.safety
    if safety is not None and safety.status is not None and safety.status.relay_closed is False:
        await safety.reset_watchdog_relay()
    await cell.for_each_feeder(FeederDriver.reset_alarms, faulty)


async def _read_through(job: JobReader) -> None:
    """Have every line refused now that would be refused in the middle of the part."""
    for layer in job.iterate_layers():
        for line in layer.program:
            line_without_beam(line.encode("ascii"))
        await asyncio.sleep(0)
