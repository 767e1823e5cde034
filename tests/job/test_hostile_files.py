"""Files made to hurt: nothing in a job, part or profile file makes lmctl run code, write elsewhere,
hang, or take unbounded memory. Beside `test_refusals.py`, which damages jobs.
"""

from __future__ import annotations

import json
import os
import tracemalloc
import warnings
import zipfile
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path

import pytest

from lmctl.config.machine import load_profile
from lmctl.errors import ConfigError, InputError, JobError, LmctlError, MissingFileError
from lmctl.job import container
from lmctl.job.reader import JobReader
from lmctl.part.load import load_part
from lmctl.run.journal import run_folders

CELL = (files("lmctl.examples") / "cell.toml").read_text()
MOST_MB = 60


@contextmanager
def bounded_memory():
    """What happens inside takes at most MOST_MB at once."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < MOST_MB * 1e6
    finally:
        tracemalloc.stop()


def read_all(path: Path) -> None:
    with JobReader(path) as job:
        for _ in job.iterate_layers():
            pass


def remade(path: Path, change) -> None:
    """Rewrite a job with its members changed, the digests made right, as its maker would."""
    with zipfile.ZipFile(path) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    change(members)
    manifest = json.loads(members["manifest.json"])
    for index, layer in enumerate(manifest["layers"]):
        data = tuple(members[name] for name in container.layer_member_names(index))
        layer["sha256"] = container.layer_digest(data)
    members["manifest.json"] = json.dumps(manifest).encode()
    with path.open("wb+") as file:
        with zipfile.ZipFile(file, "w") as archive:
            for name, data in members.items():
                archive.writestr(container.new_member(name), data)
            archive.comment = container.unsigned_trailer()
        container.write_digest(file)


# jobs --------------------------------------------------------------------------------------------


def npy_header(text: str, version: bytes = b"\x01\x00") -> bytes:
    size = len(text).to_bytes(2 if version == b"\x01\x00" else 4, "little")
    return b"\x93NUMPY" + version + size + text.encode("latin-1")


@pytest.mark.parametrize("data", [
    npy_header("{'descr': '<f8', 'fortran_order': False, 'shape': (10**15,)}\n"),
    npy_header("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,)}\n"),
    npy_header("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}\n"),
    npy_header("{'descr': '|V2000000000', 'fortran_order': False, 'shape': (3,)}\n"),
    npy_header("{'descr': '|O', 'fortran_order': False, 'shape': (3,)}\n") + b"cos\nsystem\n(S'id'",
    npy_header("__import__('os').mkdir('owned')\n"),
    npy_header("{'descr': __import__('os').mkdir('owned'), 'shape': (3,)}\n"),
    npy_header("(" * 9000 + "\n"),
    npy_header("{" + "'a': 1, " * 5_000_000 + "}\n", b"\x02\x00"),
    b"\x93NUMPY\x02\x00\xff\xff\xff\xff",
    b"\x93NUMPY\x03\x00\xff\xff\xff\x7f{}",
    b"\x80\x04cos\nmkdir\n(S'owned'\ntR.",
], ids=range(12))
def test_an_array_that_is_none(job_path, tmp_path, monkeypatch, data):
    monkeypatch.chdir(tmp_path)
    remade(job_path, lambda members: members.update({"layer-00001/flow_s.npy": data}))
    # numpy reads the header that is there before it looks at its length: 40 MB, once.
    with pytest.raises(JobError) as refused:
        read_all(job_path)
    assert "layer 1" in refused.value.render()
    assert not (tmp_path / "owned").exists()


@pytest.mark.parametrize("words", [
    "M3 S1000", "G28.1", "G30.1", "G28", "G92 X0", "G10 P1 X0", "G20", "G91", "G54", "G93",
    "G53 X0", "M6", "M8", "M30", "M62 P0", "M67 P1", "G38.2 Z-5", "G2 X1 Y1", "$X",
    "G1 X1e9", "G1 X1 #5=1",
    "O100 X1", "G1 X--1", "G1 X1.", "G1 x1", "G1 X1 ", "G1  X1", "g1 X1",
])
def test_words_no_plan_is_made_of(job_path, words):
    def spoil(members):
        program = members["layer-00000/program.txt"].decode().split("\n")
        program[3] = f"N3 {words}"
        members["layer-00000/program.txt"] = "\n".join(program).encode()

    remade(job_path, spoil)
    with pytest.raises(JobError, match=r"damaged|words") as refused:
        read_all(job_path)
    assert "layer 0" in refused.value.render()


def test_a_manifest_with_more_layers_than_memory(job_path):
    def spoil(members):
        manifest = json.loads(members["manifest.json"])
        manifest["layers"][1]["n_lines"] = 10**15
        members["manifest.json"] = json.dumps(manifest).encode()

    remade(job_path, spoil)
    with bounded_memory(), pytest.raises(JobError):
        read_all(job_path)


@pytest.mark.parametrize("name", ["../evil", "/tmp/evil", "layer-00000/../../evil", "a\\..\\evil",
                                  "layer-00000/lines.npy/x", ""])
def test_names_that_lead_out_are_no_members(job_path, tmp_path, name):
    remade(job_path, lambda members: members.update({name: b"boo"}))
    with pytest.raises(JobError):
        read_all(job_path)
    assert not list(tmp_path.glob("**/evil"))


def test_a_member_twice_or_a_link_is_none(job_path):
    for again, attributes in (("part.toml", 0o644), ("part.toml", 0o120777)):
        with zipfile.ZipFile(job_path) as archive:
            members = [(info.filename, archive.read(info)) for info in archive.infolist()]
        with job_path.open("wb+") as file:
            with zipfile.ZipFile(file, "w") as archive, warnings.catch_warnings():
                warnings.simplefilter("ignore")  # zipfile notices
                for name, data in [*members, (again, b"/etc/passwd")]:
                    info = container.new_member(name)
                    info.external_attr = attributes << 16
                    archive.writestr(info, data)
                archive.comment = container.unsigned_trailer()
            container.write_digest(file)
        with pytest.raises(JobError):
            read_all(job_path)


@pytest.mark.parametrize("path", ["/dev/zero", "/dev/null"])
def test_a_device_is_no_job(path):
    with bounded_memory(), pytest.raises(JobError):
        read_all(Path(path))


# profiles and parts ------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [
    "name = " + "1" * 5000,
    "name = 0x" + "f" * 500_000,
    "x = " + "[" * 100_000,
    "x = " + "{a=" * 100_000,
    ".".join(["a"] * 200_000) + " = 1",
    ". ".join(['"a"'] * 100_000) + " = 1",
    "[" + ".".join(["a"] * 200_000) + "]",
    CELL + '\n[[hopper]]\nname = "x"\n' * 30_000,
    CELL + "\n[[feeder]]" * 80_000,
    'name = "' + "x" * 900_000 + '"',
    "\n".join(f"k{n} = 1" for n in range(15_000)),
    "a" * 999_999,
    "\x00" * 1000,
    "name = nan",
], ids=range(14))
def test_a_profile_or_part_made_to_hurt(tmp_path, text):
    path = tmp_path / "p.toml"
    path.write_text(text)
    for load in (load_profile, load_part):
        with pytest.raises(LmctlError) as refused:
            load(path)
        assert len(refused.value.render()) < 200_000
        assert str(path) in refused.value.render()


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e999"])
def test_what_is_no_number_is_none_in_a_profile(tmp_path, value):
    path = tmp_path / "cell.toml"
    path.write_text(CELL.replace("dead_time_s = 3.0", f"dead_time_s = {value}"))
    assert value in path.read_text()
    with pytest.raises(ConfigError):
        load_profile(path)


def test_a_configuration_that_never_ends():
    with bounded_memory(), pytest.raises(ConfigError, match="too large"):
        load_profile(Path("/dev/zero"))


@pytest.fixture
def part_naming(tmp_path):
    """Loads the shipped gear with its cloud called `name`."""
    folder = tmp_path / "parts"
    folder.mkdir()
    cloud = "".join(f"{n % 10} {n // 10 % 10} {n // 100}\n" for n in range(1000))
    for path in (tmp_path / "secret.xyz", folder / "cloud.xyz"):
        path.write_text(cloud)
    text = (files("lmctl.examples") / "gear.toml").read_text()

    def load(name: str):
        path = folder / "part.toml"
        path.write_text(text.replace('"gear_cloud.xyz"', json.dumps(name)))
        return load_part(path)

    return load


@pytest.mark.parametrize("name", ["../secret.xyz", "./../secret.xyz", "sub/../../secret.xyz",
                                  "/dev/zero", "/proc/self/mem", "a\x00.xyz", "", "x" * 5000,
                                  "~/secret.xyz", "pipe.xyz", "link.xyz", "loop.xyz", "."])
def test_data_files_that_are_none_of_the_parts(part_naming, tmp_path, name):
    folder = tmp_path / "parts"
    os.mkfifo(folder / "pipe.xyz")
    (folder / "link.xyz").symlink_to(tmp_path / "secret.xyz")
    (folder / "loop.xyz").symlink_to(folder / "loop.xyz")
    with bounded_memory(), pytest.raises((InputError, ConfigError, MissingFileError)) as refused:
        part_naming(name)
    assert "mistake" not in refused.value.render() or len(name) in (0, 5000)


def test_a_data_file_beside_the_part_is_read(part_naming):
    assert list(part_naming("cloud.xyz").sources) == ["cloud.xyz"]


def test_a_runs_folder_of_links_is_listed_and_nothing_is_written_through_them(
    tmp_path, job_path
):
    """Links called run-0001 and run-0002 to a file and a folder of another user."""
    elsewhere, runs = tmp_path / "elsewhere", tmp_path / "runs"
    elsewhere.mkdir()
    runs.mkdir()
    (tmp_path / "file").write_text("mine")
    (runs / "run-0001").symlink_to(tmp_path / "file")
    (runs / "run-0002").symlink_to(elsewhere, target_is_directory=True)
    (runs / "run-0003").symlink_to(tmp_path / "nowhere")
    (runs / "run-0005").symlink_to(runs / "run-0005")
    assert {run.state for run in run_folders.list_runs(runs)} == {"no journal"}
    made = run_folders.create_run_folder(runs, job_path)
    assert made.run == "run-0006"
    assert not made.path.is_symlink()
    assert list(elsewhere.iterdir()) == []
    assert (tmp_path / "file").read_text() == "mine"
    assert not (tmp_path / "nowhere").exists()
