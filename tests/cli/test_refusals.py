"""Bad input through the command line: a message with what, where and next, the right exit code,
no traceback, and nothing half-written."""

from __future__ import annotations

import socket
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.part_files import block_file

Refused = Callable[..., str]

BOX = block_file((12, 9, 1.6))


def left_over(folder: Path, *expected: str) -> list[str]:
    """Files in a folder that should not be there."""
    return sorted(path.name for path in folder.iterdir() if path.name not in expected)


def write(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


# --- the part file and its data -------------------------------------------------------------


def test_a_part_that_is_not_there(refused: Refused, tmp_path: Path) -> None:
    assert "there is no file missing.toml" in refused("plan", "missing.toml", code=2)
    assert left_over(tmp_path) == []


def test_all_data_that_cannot_be_used_at_once(refused: Refused, tmp_path: Path) -> None:
    write(tmp_path / "two.xyz", b"0 0 0\n1 1 1\n")
    part = write(tmp_path / "part.toml", """
name = "p"
combine = "union"
[[material]]
name = "316L"
[[body]]
kind = "cloud"
units = "mm"
file = "two.xyz"
[[body]]
kind = "mesh"
units = "mm"
file = "gone.stl"
[[body]]
kind = "mesh"
units = "mm"
file = "gone.stl"
""")
    talk = refused("check", part, code=1)
    assert "2 data files" in talk
    assert "two.xyz has 2 points" in talk
    assert "scan the surface more densely" in talk  # what to do about each is not lost
    assert talk.count("there is no file") == 1  # one file, however many bodies are made of it


def test_the_file_of_a_sheet_is_missed_together_with_the_bodies(
    refused: Refused, tmp_path: Path
) -> None:
    mixtures = 'near = { "316L" = 1 }, far = { IN625 = 1 }, over_mm = [0, 5]'
    part = write(tmp_path / "part.toml", f"""
name = "p"
[[material]]
name = "316L"
[[material]]
name = "IN625"
[[body]]
kind = "mesh"
units = "mm"
file = "gone.stl"
[[composition.blend]]
weight = 0.5
feature = {{ kind = "sheet", file = "face.stl", units = "mm" }}
profile = {{ kind = "linear", {mixtures} }}
[[composition.blend]]
weight = 0.5
feature = {{ kind = "sheet", file = "gone.stl", units = "mm" }}
profile = {{ kind = "linear", {mixtures} }}
""")
    talk = refused("check", part, code=2)
    assert "2 data files cannot be used" in talk
    assert talk.count("gone.stl") == 1  # one file, however it is used
    assert "there is no file" in talk.partition("face.stl")[0].splitlines()[-1]


def test_a_bare_mesh_in_metres_is_shown_how_to_say_so_and_can_be_checked(
    refused: Refused, lmctl: Callable[..., Any], tmp_path: Path
) -> None:
    mesh = tmp_path / "metres.stl"
    trimesh.creation.box([0.02, 0.02, 0.01]).export(mesh)
    assert "--units" in refused("check", mesh, code=1)
    outcome = lmctl("check", mesh, "--units", "m")
    assert outcome.code == 0
    assert "20.0 × 20.0 × 10.0 mm" in outcome.data
    part = write(tmp_path / "block.toml", BOX)
    assert "bare mesh or cloud" in refused("check", part, "--units", "m", code=2)


def test_a_part_narrower_than_a_bead_is_found_by_checking(refused: Refused, tmp_path: Path) -> None:
    part = write(tmp_path / "block.toml", BOX + "[process]\nbead_width_mm = 30\nspeed_mm_s = 4\n")
    assert "nothing as wide as half a bead" in refused("check", part, code=1)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.stl", b""),
        ("garbage.stl", bytes(range(256)) * 40),
        ("truncated.stl", b"\0" * 80 + (5000).to_bytes(4, "little") + b"\0" * 70),
        ("empty.xyz", b""),
        ("words.xyz", b"this is not a cloud\n" * 30),
        ("nan.xyz", b"0 0 0\n1 0 nan\n0 1 0\n0 0 1\n" * 10),
        ("two.xyz", b"0 0 0\n1 1 1\n"),
        ("garbage.ply", b"\x89PNG\r\n\x1a\n" + b"\0" * 100),
        ("empty.obj", b""),
    ],
)
def test_data_that_cannot_be_used(
    refused: Refused, tmp_path: Path, name: str, content: bytes
) -> None:
    write(tmp_path / name, content)
    assert name in refused("plan", name, code=1)
    assert left_over(tmp_path, name) == []


def test_an_ending_that_says_nothing(refused: Refused, tmp_path: Path) -> None:
    write(tmp_path / "part.step", "ISO-10303-21;")
    assert "part.step" in refused("plan", "part.step", code=1)


def test_a_gigantic_file_is_not_read(refused: Refused, tmp_path: Path) -> None:
    with (tmp_path / "huge.toml").open("wb") as file:
        file.truncate(5_000_000_000)
    assert "too large" in refused("plan", "huge.toml", code=3)
    with (tmp_path / "huge.stl").open("wb") as file:
        file.truncate(50_000_000_000)
    assert "huge.stl" in refused("plan", "huge.stl", code=1)


def test_an_open_mesh(refused: Refused, tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=10)
    mesh.update_faces(np.arange(len(mesh.faces)) >= 300)
    mesh.export(tmp_path / "bowl.stl")
    said = refused("plan", "bowl.stl", "--units", "mm", code=1)
    assert "open" in said


def test_a_cloud_too_sparse_for_its_pitch(refused: Refused, tmp_path: Path) -> None:
    directions = np.random.default_rng(5).normal(size=(400, 3))
    points = 20 * directions / np.linalg.norm(directions, axis=1)[:, None]
    np.savetxt(tmp_path / "ball.xyz", points)
    write(tmp_path / "ball.toml", BOX.split("[[body]]")[0].replace(
        "[[material]]", "pitch_mm = 0.2\n[[material]]"
    ) + '[[body]]\nkind = "cloud"\nfile = "ball.xyz"\nunits = "mm"\n')
    said = refused("plan", "ball.toml", code=1)
    assert "0.2 mm" in said
    assert "pitch" in said.split("hint: ")[1]


def test_every_mistake_of_a_part_file_at_once(refused: Refused, tmp_path: Path) -> None:
    write(tmp_path / "part.toml", BOX.replace("low_mm", "lowest_mm").replace("316L", "316M") + """
[composition]
feature = { kind = "point", at_mm = [0, 0, 0] }
profile = { kind = "constant", of = { "316M" = 0.6, "WC" = 0.3 } }
[process]
bead_width_mm = -1
colour = "red"
""")
    said = refused("plan", "part.toml", code=3, hint=False)
    for key in ("body[1]", "lowest_mm", "material[1]", "WC", "0.9", "process.bead_width_mm",
                "process.colour"):
        assert key in said, key


@pytest.mark.parametrize("text", ["name = ", "\x00\x01", "[[material", "a = " + "[" * 5000])
def test_toml_that_is_none(refused: Refused, tmp_path: Path, text: str) -> None:
    write(tmp_path / "part.toml", text)
    refused("plan", "part.toml", code=3, hint=False)


def test_a_part_outside_the_travel(refused: Refused, tmp_path: Path) -> None:
    write(tmp_path / "part.toml", BOX.replace("[12, 9, 1.6]", "[400, 9, 1.6]"))
    said = refused("plan", "part.toml", code=1)
    assert "travel" in said
    assert left_over(tmp_path, "part.toml") == []


def test_a_material_the_machine_has_no_hopper_for(refused: Refused, tmp_path: Path) -> None:
    write(tmp_path / "part.toml", BOX.replace("316L", "IN625"))
    said = refused("plan", "part.toml", code=1)
    assert "IN625" in said
    assert "316L" in said  # what there is


def test_output_that_cannot_be_written(refused: Refused, tmp_path: Path) -> None:
    write(tmp_path / "part.toml", BOX)
    refused("plan", "part.toml", "-o", "nowhere/part.lmj", code=2)
    refused("plan", "part.toml", "-o", tmp_path, code=2)
    assert left_over(tmp_path, "part.toml") == []


# --- profiles, jobs and machines ------------------------------------------------------------


@pytest.fixture
def job(lmctl: Callable[..., Any], tmp_path: Path) -> Path:
    write(tmp_path / "part.toml", BOX)
    assert lmctl("plan", "part.toml").code == 0
    return tmp_path / "part.lmj"


def cell_file(folder: Path, **replaced: str) -> Path:
    text = files("lmctl.examples").joinpath("cell.toml").read_text()
    for old, new in replaced.items():
        assert old in text
        text = text.replace(old, new)
    return write(folder / "cell.toml", text)


def test_every_mistake_of_a_profile_at_once(refused: Refused, tmp_path: Path) -> None:
    profile = write(tmp_path / "cell.toml", """
name = "cell"
[motion]
endpoint = "tcp://127.0.0.1:1"
travel_mm = { x = [300, 0], y = [0, 300], z = [0, 200] }
max_speed_mm_s = [100, 100, -1]
acceleration_mm_s2 = [500, 500]
purge_mm = [10, 10, 20]
[laser]
max_power_W = 0
colour = "green"
""")
    said = refused("check", profile, code=3, hint=False)
    for key in ("motion.travel_mm.x", "max_speed_mm_s", "acceleration_mm_s2", "laser.max_power_W",
                "laser.colour", "feeder", "hopper"):
        assert key in said, key


@pytest.mark.parametrize(
    ("name", "usual", "given", "key"),
    [
        ("cell.toml", "tcp://127.0.0.1:2323", "tcp://host:99999", "motion"),
        ("cell.toml", "tcp://127.0.0.1:2323", "tcp://host", "motion"),
        ("cell.toml", "tcp://127.0.0.1:2323", "usb://host:1", "motion"),
        ("cell.toml", "tcp://127.0.0.1:2323", "", "motion"),
        ("cell.toml", "modbus-tcp://127.0.0.1:5022", "tcp://127.0.0.1:5022", "feeder[2]"),
        ("cell.toml", "modbus-tcp://127.0.0.1:5022", "modbus-tcp://host:0", "feeder[2]"),
        ("cell-safe.toml", "modbus-tcp://127.0.0.1:5023", "modbus-rtu:///dev/tty?baud=x", "safety"),
    ],
)
def test_an_endpoint_that_names_no_place_is_found_by_checking_with_all_else(
    refused: Refused, tmp_path: Path, name: str, usual: str, given: str, key: str
) -> None:
    text = files("lmctl.examples").joinpath(name).read_text()
    assert f'"{usual}"' in text
    text = text.replace(f'"{usual}"', f'"{given}"')
    said = refused("check", write(tmp_path / "bad.toml", text), code=3, hint=False)
    assert "bad.toml has 1 mistake" in said
    assert f"{key}.endpoint: {given!r} is not an endpoint" in said
    worse = text.replace("s_max = 1000", "s_max = 0")
    said = refused("machine", "status", "-m", write(tmp_path / "bad.toml", worse), code=3,
                   hint=False)
    assert "bad.toml has 2 mistakes" in said
    assert "laser.s_max" in said
    assert f"{key}.endpoint" in said


@pytest.mark.parametrize("text", ["x = " + "9" * 5000, "x = " + "[" * 5000, "a = b"])
def test_what_is_no_toml_is_reported_by_checking(
    refused: Refused, tmp_path: Path, text: str
) -> None:
    assert "is not valid TOML" in refused("check", write(tmp_path / "it.toml", text), code=3,
                                          hint=False)


def test_run_needs_to_know_where(refused: Refused, job: Path) -> None:
    assert "--sim" in refused("run", job, code=2)


def test_a_job_that_is_none(refused: Refused, tmp_path: Path) -> None:
    refused("run", "missing.lmj", "--sim", code=2)
    write(tmp_path / "garbage.lmj", b"not a job" * 1000)
    refused("run", "garbage.lmj", "--sim", code=1)
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("damage", ["truncated", "altered"])
def test_a_damaged_job(refused: Refused, job: Path, damage: str) -> None:
    data = bytearray(job.read_bytes())
    if damage == "truncated":
        data = data[: len(data) * 2 // 3]
    else:
        data[len(data) // 2] ^= 1
    job.write_bytes(data)
    refused("run", job, "--sim", code=1)
    refused("check", job, code=1)
    refused("show", job, code=1)


def test_a_job_planned_for_another_profile(refused: Refused, job: Path, tmp_path: Path) -> None:
    other = cell_file(tmp_path, **{"max_power_W = 3000": "max_power_W = 2000"})
    said = refused("run", job, "--sim", "--machine", other, code=1)
    assert "full power in W: 2000, planned with 3000" in said


def test_a_port_that_is_absent(refused: Refused, job: Path, tmp_path: Path) -> None:
    absent = cell_file(tmp_path, **{"tcp://127.0.0.1:2323": "serial:///dev/ttyNONE9"})
    assert "/dev/ttyNONE9" in refused("run", job, "--machine", absent, code=4)


def test_ports_where_no_one_listens_make_one_report(
    refused: Refused, job: Path, tmp_path: Path
) -> None:
    with socket.socket() as one, socket.socket() as other:
        for free in (one, other):
            free.bind(("127.0.0.1", 0))
        port, others_port = one.getsockname()[1], other.getsockname()[1]
    deaf = cell_file(tmp_path, **{':2323"': f':{port}"', ':5021"': f':{port}"',
                                  ':5022"': f':{others_port}"'})
    said = refused("run", job, "--machine", deaf, code=4)
    assert said.count("error:") == 1
    assert "motion controller" in said
    assert "feeder F1" in said
    assert "F2" not in said  # its hopper holds nothing the job needs


def test_a_layer_that_is_not_there(refused: Refused, job: Path) -> None:
    assert "layers go from 1 to 2" in refused("show", job, "--layer", 9, code=2)
    refused("show", job, "-o", "picture.bmp", code=2)


def test_a_job_has_no_planes_and_no_units(refused: Refused, job: Path) -> None:
    assert "-z are for parts" in refused("show", job, "-z", 1, code=2)
    assert "bare mesh or cloud" in refused("show", job, "--units", "m", code=2)


def test_a_run_that_is_not_there(refused: Refused) -> None:
    refused("log", "run-0007", code=2)


def test_words_that_are_no_command(lmctl: Callable[..., Any]) -> None:
    for arguments in (("blend",), ("plan",), ("plan", "a", "b"), ("run", "x.lmj", "--speed", "0")):
        outcome = lmctl(*arguments)
        assert outcome.code == 2, arguments
        assert "Traceback" not in outcome.talk


@pytest.mark.parametrize("speed", ["nan", "inf", "-1", "0"])
def test_a_speed_that_is_none(refused: Refused, job: Path, speed: str) -> None:
    refused("run", job, "--sim", f"--speed={speed}", code=2, hint=False)


@pytest.mark.parametrize(("options", "said"), [
    (("--jobs", "0"), "0 is not in the range"),
    (("--layers", "5-3"), "are no layers"),
    (("--layers", "all"), "are no layers"),
    (("--jobs", "2", "--scheduler", "tcp://127.0.0.1:1"), "--scheduler for a cluster"),
])
def test_options_of_planning_that_say_nothing(
    refused: Refused, tmp_path: Path, options: tuple[str, ...], said: str
) -> None:
    part = write(tmp_path / "block.toml", BOX)
    assert said in refused("plan", part, *options, code=2)
    assert not list(tmp_path.glob("*.lmj"))
