"""Whatever is not wholly a job is refused in words: damaged, foreign, or made to hurt."""

import dataclasses
import io
import json
import zipfile

import numpy as np
import pytest

from lmctl.errors import JobError, MissingFileError
from lmctl.job import container
from lmctl.job.reader import JobReader


def read_all(path):
    with JobReader(path) as job:
        for _ in job.iterate_layers():
            pass


def refused(path):
    with pytest.raises(JobError) as caught:
        read_all(path)
    text = caught.value.render()
    assert str(path) in text
    assert caught.value.hint
    return text


def test_truncation_at_any_place(job_path):
    whole = job_path.read_bytes()
    for length in [*range(0, len(whole), 37), *range(len(whole) - 120, len(whole))]:
        job_path.write_bytes(whole[:length])
        refused(job_path)


def test_a_flipped_byte_anywhere(job_path):
    whole = bytearray(job_path.read_bytes())
    for place in [*range(0, len(whole) - 400, 5), *range(len(whole) - 400, len(whole))]:
        whole[place] ^= 0x10
        job_path.write_bytes(whole)
        refused(job_path)
        whole[place] ^= 0x10


def test_bytes_added_before_or_behind(job_path):
    whole = job_path.read_bytes()
    job_path.write_bytes(whole + b"\n")
    assert "truncated" in refused(job_path)
    job_path.write_bytes(b"\n" + whole)
    refused(job_path)


@pytest.mark.parametrize("content", [b"", b"\0" * 5000, b"G1 X1\n" * 1000, b"solid cube\n" * 99])
def test_other_files(tmp_path, content):
    path = tmp_path / "a.lmj"
    path.write_bytes(content)
    refused(path)


def test_a_zip_that_is_no_job(tmp_path):
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme", "hello")
    assert "no job file" in refused(path)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(MissingFileError, match="there is no file"):
        read_all(tmp_path / "a")
    with pytest.raises(JobError, match="is a folder"):
        read_all(tmp_path)


def test_another_version(job_path):
    whole = job_path.read_bytes()
    job_path.write_bytes(whole.replace(b"lmctl-job 3 sha256", b"lmctl-job 1 sha256"))
    assert "format 1" in refused(job_path)


# From here on the digest is right: the file was made by someone who knows the format.

def remake(path, change):
    """Rewrite a job with its members changed, and sign it."""
    with zipfile.ZipFile(path) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    change(members)
    with path.open("wb+") as file:
        with zipfile.ZipFile(file, "w") as archive:
            for name, data in members.items():
                if isinstance(data, tuple):
                    archive.writestr(name, data[0], compress_type=data[1])
                else:
                    archive.writestr(container.new_member(name), data)
            archive.comment = container.unsigned_trailer()
        container.write_digest(file)


def reseal(members, index):
    """Give the manifest the digest of a changed layer."""
    manifest = json.loads(members["manifest.json"])
    data = tuple(members[name] for name in container.layer_member_names(index))
    manifest["layers"][index]["sha256"] = container.layer_digest(data)
    members["manifest.json"] = json.dumps(manifest).encode()


def npy(array, **options):
    buffer = io.BytesIO()
    np.save(buffer, array, **options)
    return buffer.getvalue()


def test_a_remade_job_without_change_is_read(job_path):
    remake(job_path, lambda members: None)
    read_all(job_path)


@pytest.mark.parametrize("name", ["manifest.json", "part.toml", "layer-00001/lines.npy"])
def test_missing_members(job_path, name):
    remake(job_path, lambda members: members.pop(name))
    refused(job_path)


def test_a_member_too_many(job_path):
    remake(job_path, lambda members: members.update({"../../etc/cron.d/x": b"boo"}))
    assert "its members" in refused(job_path)


def test_a_compressed_bomb(job_path):
    def bomb(members):
        members["layer-00000/program.txt"] = (b"\0" * 50_000_000, zipfile.ZIP_DEFLATED)

    remake(job_path, bomb)
    assert job_path.stat().st_size < 200_000
    assert "compressed or too large" in refused(job_path)


def test_a_size_the_file_does_not_have(job_path):
    whole = bytearray(job_path.read_bytes())
    entry = whole.rindex(b"PK\x01\x02", 0, whole.rindex(b"manifest.json"))
    whole[entry + 20 : entry + 28] = b"\xff\xff\xff\x7f" * 2
    sign_again(job_path, whole)
    refused(job_path)


def test_a_directory_the_file_does_not_have(job_path):
    whole = bytearray(job_path.read_bytes())
    end = whole.rindex(b"PK\x05\x06")
    whole[end + 12 : end + 16] = b"\xff\xff\xff\x7f"
    sign_again(job_path, whole)
    assert "directory" in refused(job_path)


def test_a_file_of_a_trailer_alone(tmp_path):
    sign_again(tmp_path / "a.lmj", container.unsigned_trailer())
    assert "is not a job file" in refused(tmp_path / "a.lmj")


def test_an_archive_that_is_signed_and_none(job_path):
    whole = bytearray(job_path.read_bytes())
    entry = whole.index(b"PK\x01\x02")
    whole[entry : entry + 4] = b"LMJ!"
    sign_again(job_path, whole)
    assert "is not a job file" in refused(job_path)


def test_a_member_that_was_damaged_before_it_was_signed(job_path):
    whole = bytearray(job_path.read_bytes())
    whole[whole.index(b"N0 G1")] = ord("M")
    sign_again(job_path, whole)
    assert "layer-00000/program.txt cannot be read" in refused(job_path)


def test_a_part_file_that_is_no_text(job_path):
    remake(job_path, lambda members: members.update({"part.toml": b"name = '\xff'"}))
    assert "the part file in it is not text" in refused(job_path)


def test_a_name_that_no_file_can_have(tmp_path):
    with pytest.raises(JobError, match="cannot read") as caught:
        read_all(tmp_path / f"{'j' * 300}.lmj")
    assert caught.value.where == ("File name too long",)


def sign_again(path, data):
    with path.open("wb+") as file:
        file.write(data)
        container.write_digest(file)


def test_a_pickle_is_not_opened(job_path, tmp_path):
    class Trap:
        def __reduce__(self):
            return (open, (str(tmp_path / "trapped"), "w"))

    def spoil(members):
        members["layer-00000/lines.npy"] = npy(np.array([Trap()], object), allow_pickle=True)
        reseal(members, 0)

    remake(job_path, spoil)
    refused(job_path)
    assert not (tmp_path / "trapped").exists()


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("flow_s.npy", npy(np.zeros(3, np.float32))),
        ("flow_s.npy", npy(np.zeros((3, 1)))),
        ("flow_s.npy", npy(np.zeros(3))[:-1]),
        ("flow_s.npy", b"\x93NUMPY\x01\x00\xff\xff"),
        ("flow_s.npy", b""),
        ("flow_g_s.npy", npy(np.zeros((3, 3)))),
        ("flow_g_s.npy", npy(np.full((3, 2), np.nan))),
        ("lines.npy", npy(np.zeros(6))),
        ("lines.npy", npy(np.zeros(0)).replace(b"(0,)", b"(10**12,)")),
        ("program.txt", b"N0 G1 X1\n" * 6),
        ("program.txt", b"$H\n" * 6),
        ("program.txt", b"\xff" * 6),
        ("program.txt", b""),
    ],
)
def test_a_layer_that_is_none(job_path, name, data):
    def spoil(members):
        members[f"layer-00000/{name}"] = data
        reseal(members, 0)

    remake(job_path, spoil)
    refused(job_path)


@pytest.mark.parametrize(
    "line", ["N3 $H", "N3 G1 X1 ?", "N3 M3 S1000\x18", "N3 G1 X1 (!)", "N3 T1", "N3 G1 X1\u00e9"]
)
def test_words_that_must_not_reach_the_machine(job_path, line):
    def spoil(members):
        program = members["layer-00000/program.txt"].decode().split("\n")
        program[3] = line
        members["layer-00000/program.txt"] = "\n".join(program).encode("latin-1")
        reseal(members, 0)

    remake(job_path, spoil)
    assert "layer 0" in refused(job_path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("layers", []),
        ("layers", [1]),
        ("layers", "x" * 100),
        ("materials", []),
        ("hoppers", []),
        ("s_max", "lots"),
        ("totals", None),
        ("bounds_mm", [[0, 0, 0]]),
    ],
)
def test_a_manifest_that_is_none(job_path, key, value):
    def spoil(members):
        manifest = json.loads(members["manifest.json"])
        manifest[key] = value
        members["manifest.json"] = json.dumps(manifest).encode()

    remake(job_path, spoil)
    assert "manifest" in refused(job_path)


@pytest.mark.parametrize("text", [b"", b"{", b"[" * 100_000, b"\xff", b"null", b"{}"])
def test_a_manifest_that_is_not_json(job_path, text):
    remake(job_path, lambda members: members.update({"manifest.json": text}))
    assert "manifest" in refused(job_path)


@pytest.mark.parametrize(
    "change",
    [{"n_lines": 10**12}, {"n_lines": -6}, {"first_line": 1}, {"index": 2}, {"first_path": 5},
     {"start_s": 3.0}, {"end_s": -1.0}, {"end_s": float("nan")}, {"z_mm": float("inf")}],
)
def test_a_layer_table_with_absurd_entries(job_path, change):
    def spoil(members):
        manifest = json.loads(members["manifest.json"])
        manifest["layers"][1] |= change
        members["manifest.json"] = json.dumps(manifest).encode()

    remake(job_path, spoil)
    refused(job_path)


def test_another_part_than_the_one_planned(job_path):
    remake(job_path, lambda members: members.update({"part.toml": b'name = "other"\n'}))
    assert "not the one planned" in refused(job_path)


def test_a_layer_changed_while_the_job_is_open(job_path):
    with JobReader(job_path) as job:
        entry = job.manifest.layers[1]
        job.manifest = dataclasses.replace(
            job.manifest,
            layers=(job.manifest.layers[0], dataclasses.replace(entry, sha256="0" * 64)),
        )
        with pytest.raises(JobError, match="damaged or altered"):
            job.read_layer(1)
