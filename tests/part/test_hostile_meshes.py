"""Mesh files with random damage: read or refused in words, never with a library's own sentence.

`python tests/part/test_hostile_meshes.py FIRST LAST` tries more of them.
"""

from __future__ import annotations

import io
import re
import sys
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # also as a script

from lmctl.errors import InputError
from lmctl.part.sources.mesh_files import read_mesh
from lmctl.part.sources.mesh_repair import repair_mesh
from tests.part import angle_solid as angle

FILES_A_SEED = 60
#: Words of numpy, zlib, zipfile and Python that only a programmer understands.
FOREIGN = re.compile(
    r"ndarray|dtype|array\(|numpy|Traceback|manifold|broadcast|invalid literal|could not convert|"
    r"operands|out of bounds|NoneType|object has|reshape|KeyError|codec|struct\b|Error -3|magic")
WORDS = (b"nan", b"inf", b"-1", b"0", b"99999999999999999999999", b"1e999", b"x", b"", b"1e-320",
         b"-9", b"2147483648", b"\xff", b"1/2/3", b"//", b"1e30", b"1.5")
NUMBERS = (b"\xff\xff\xff\xff", b"\0\0\0\0", b"\0\0\xc0\x7f", b"\1\0\x80\x7f", b"\xff\xff\xff\x7f")
SOUND: dict[str, list[bytes]] = {
    "stl": [angle.binary_stl(), angle.text_stl().encode()],
    "obj": [angle.obj().encode(), b"g a\n" + angle.obj("\t").encode()],
    "ply": [angle.ply(order, polygons, flags)
            for order in ("ascii", "binary_little_endian", "binary_big_endian")
            for polygons in (angle.POLYGONS, tuple(map(tuple, angle.TRIANGLES.tolist())))
            for flags in (False, True)],
    "off": [angle.off().encode()],
    "3mf": [angle.model_xml(angle.object_xml("1")).encode()],
}


def damaged(rng: np.random.Generator) -> tuple[bytes, str]:
    """A file with up to five random defects, and its ending."""
    suffix = str(rng.choice(list(SOUND)))
    sound = SOUND[suffix][int(rng.integers(len(SOUND[suffix])))]
    harmed = bytes_changed(sound, rng) if rng.random() < 0.5 else words_changed(sound, rng)
    if suffix != "3mf":
        return harmed, suffix
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", harmed)
    packed = content.getvalue()
    return (bytes_changed(packed, rng) if rng.random() < 0.3 else packed), suffix


def bytes_changed(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(len(changed)))
        match int(rng.integers(5)):
            case 0:
                changed[at] ^= 1 << int(rng.integers(8))
            case 1:
                del changed[at : at + int(rng.integers(1, 30))]
            case 2:
                changed[at:at] = rng.bytes(int(rng.integers(1, 9)))
            case 3:
                source, size = int(rng.integers(len(changed))), int(rng.integers(1, 40))
                changed[at : at + size] = changed[source : source + size]
            case _:
                changed[at : at + 4] = NUMBERS[int(rng.integers(len(NUMBERS)))]
        if not changed:
            break
    return bytes(changed)


def words_changed(data: bytes, rng: np.random.Generator) -> bytes:
    words = re.split(rb"(\s+)", data)
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(len(words)))
        match int(rng.integers(4)):
            case 0:
                words[at] = WORDS[int(rng.integers(len(WORDS)))]
            case 1:
                words[at] = words[int(rng.integers(len(words)))]
            case 2:
                del words[at : at + int(rng.integers(1, 6))]
            case _:
                source = int(rng.integers(len(words)))
                words[at:at] = words[source : source + int(rng.integers(1, 6))]
        if not words:
            break
    return b"".join(words)


@pytest.mark.parametrize("seed", range(5))
def test_damaged_files_are_read_or_refused_in_words(
    seed: int, capfd: pytest.CaptureFixture[str]
) -> None:
    try_files(seed)
    assert capfd.readouterr() == ("", "")


def try_files(seed: int) -> None:
    """Raises what a reader lets through."""
    rng = np.random.default_rng(seed)
    for number in range(FILES_A_SEED):
        data, suffix = damaged(rng)
        if not data:
            continue
        file = angle.data_file(data, suffix)
        try:
            mesh = read_mesh(file, None if suffix == "3mf" else "mm")
            reported = repair_mesh(mesh, "part", 2.0)[1]
        except InputError as error:
            reported = (error.render(),)
        found = FOREIGN.search(" ".join(reported))
        assert found is None, f"seed {seed}, file {number}: {reported}"


if __name__ == "__main__":
    warnings.simplefilter("error")
    for chosen in range(int(sys.argv[1]), int(sys.argv[2])):
        try_files(chosen)
