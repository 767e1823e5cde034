"""Firmware settings written over real wires: read back, and said where they are not taken."""

from __future__ import annotations

import asyncio

import pytest

from lmctl.errors import ConfigError, MachineError, UsageError
from lmctl.machine.manual.homing import clear_work_offsets
from lmctl.machine.manual.settings import apply_settings
from lmctl.machine.manual.settings_file import (
    is_same_value,
    parse_setting,
    read_settings_file,
    write_settings_file,
)
from tests.machine.motion.test_motion_with_simulator import both_dialects, every_wire, machine


def applied(run, name, wire, wanted, **settings):
    """What became of them, the controller's table afterwards, and whether its place is trusted."""

    async def main():
        async with machine(name, wire, None, **settings) as (sim, driver):
            done = await apply_settings(driver, wanted)
            listing = dict(sim._controller.machine.settings.listing())
            return done, listing, driver.position_trusted

    return run(main())


@both_dialects
@every_wire
def test_settings_that_differ_are_written_and_read_back(in_virtual_time, name, wire):
    done, listing, trusted = applied(in_virtual_time, name, wire, {
        110: "4000", 11: "0.02", 32: "1", 24: "25.0"})
    assert done.written == {110: "4000.000", 11: "0.020"}
    assert (done.refused, done.also_changed, done.position_lost) == ({}, {}, False)
    assert (listing[110], listing[11]) == ("4000.000", "0.020")
    assert trusted


@both_dialects
def test_what_the_controller_does_not_take_is_said_and_the_rest_is_written(in_virtual_time, name):
    done, listing, _ = applied(in_virtual_time, name, "tcp", {
        999: "1", 110: "-5", 13: "0.5", 112: "3000"})
    assert done.written == {112: "3000.000"}
    assert done.refused.keys() == {999, 110, 13}
    assert "no such setting" in done.refused[999]
    assert "refused: error" in done.refused[110]
    assert done.refused[13] == "it was taken, and reads back as 0"
    assert listing[112] == "3000.000"


@both_dialects
def test_a_setting_that_needs_another_is_written_after_it(in_virtual_time, name):
    done, listing, trusted = applied(in_virtual_time, name, "tcp", {20: "1", 22: "1"})
    assert done.written == {20: "1", 22: "1"}
    assert (listing[20], listing[22]) == ("1", "1")
    assert done.position_lost
    assert not trusted


@both_dialects
def test_what_the_controller_changes_by_itself_is_said(in_virtual_time, name):
    done, _, _ = applied(in_virtual_time, name, "tcp", {22: "0"}, s22=1, s20=1)
    assert done.written == {22: "0"}
    assert done.also_changed == {20: ("1", "0")}


@both_dialects
def test_nothing_is_written_while_the_machine_moves(in_virtual_time, name):
    async def main():
        async with machine(name, "tcp") as (sim, driver):
            await driver.send_command("$J=G91X50F600")
            await asyncio.sleep(0.5)
            with pytest.raises(MachineError, match="cannot be written in state Jog"):
                await apply_settings(driver, {110: "4000"})
            assert dict(sim._controller.machine.settings.listing())[110] != "4000.000"

    in_virtual_time(main())


@both_dialects
@every_wire
def test_offsets_that_a_reset_forgets_are_cleared(in_virtual_time, name, wire):
    async def main():
        async with machine(name, wire) as (_, driver):
            for line in ("G10 L2 P1 X1 Y2 Z3", "G55", "G92 X-5 Y7", "G43.1 Z2"):
                await driver.send_command(line)
            assert await clear_work_offsets(driver) == (1.0, 2.0, 3.0)
            assert "G54" in " ".join(await driver.send_command("$G"))

    in_virtual_time(main())


# --- the file -----------------------------------------------------------------------------------


def test_settings_kept_come_back_as_they_were(tmp_path):
    kept = {0: "5.0", 10: "511", 74: "a name", 110: "6000.000"}
    write_settings_file(tmp_path / "kept.txt", kept, ["bench cell"])
    assert read_settings_file(tmp_path / "kept.txt") == kept
    with pytest.raises(UsageError, match="there already"):
        write_settings_file(tmp_path / "kept.txt", {}, [])


def test_files_of_other_senders_are_read(tmp_path):
    (tmp_path / "old.txt").write_text(
        "; a comment\r\n\r\n(another)\n$0=10 (step pulse, usec)\n32=1\n")
    assert read_settings_file(tmp_path / "old.txt") == {0: "10", 32: "1"}


@pytest.mark.parametrize(("text", "what"), [
    ("", "no setting in it"), ("G1 X5\n", "line 1: 'G1 X5' is no setting"),
    ("$H\n", "'$H' is no setting"), ("$N0=G55\n", "is no setting"),
    ("$J=G91X5F100\n", "no setting"),
    ("$32=1\n$32=0\n", "line 2: $32 is set twice"), ("$74=a?b\n", "does not take as text"),
    ("$74=a!b\n", "does not take"), ("$74=a~b\n", "does not take"), ("$74=\x18\n", "does not take"),
    ("$74=\u00e4\n", "does not take"), (f"$74={'x' * 71}\n", "longer than 70"),
    ("$12345=1\n", "no setting"), ("$-1=1\n", "no setting"),
])
def test_a_file_that_holds_anything_else_is_refused_whole(tmp_path, text, what):
    (tmp_path / "wrong.txt").write_text("$110=6000\n" * bool(text) + text, encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        read_settings_file(tmp_path / "wrong.txt")
    assert what.replace("line 1", "line 2").replace("line 2: $32", "line 3: $32") in (
        refused.value.render())


def test_values_are_compared_as_the_controller_prints_them():
    assert is_same_value("0.0125", "0.013")
    assert is_same_value("6000", "6000.000")
    assert not is_same_value("0.0115", "0.013")
    assert not is_same_value("1.5", "1")
    assert not is_same_value("yes", "1")
    assert parse_setting("$32=1") == parse_setting("32=1") == (32, "1")
