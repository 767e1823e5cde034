"""Recognise a kind of file by its first bytes, for the hint where its name is wrong."""

from __future__ import annotations

from lmctl.errors import InputError
from lmctl.part.sources.files import DataFile

#: How files of other kinds begin, and what to call them.
_BEGINNINGS = (
    (b"PK\x03\x04", "3mf", "a zip archive, such as a 3MF file"),
    (b"ply\n", "ply", "a PLY file"),
    (b"ply\r", "ply", "a PLY file"),
    (b"ISO-10303-21", "step", "a STEP file"),
    (b"version https://git-lfs", "", "a Git LFS pointer, without the content"),
    (b"glTF", "glb", "a binary glTF file"),
    (b"\x1f\x8b", "gz", "a compressed file (gzip)"),
    (b"7z\xbc\xaf", "7z", "a compressed file (7z)"),
    (b"%PDF", "pdf", "a PDF file"),
    (b"<!DOCTYPE", "html", "a web page"),
    (b"<html", "html", "a web page"),
    (b"<?xml", "xml", "an XML file"),
    (b"{", "json", "a JSON file"),
)

#: A line of text is expected in so many first bytes.
_HEAD_BYTES = 2000


def recognise_content(data: bytes) -> tuple[str, str]:
    """The ending and the name of the kind of file that bytes look like; "", "" if of none."""
    start = data[:_HEAD_BYTES].lstrip()
    for beginning, suffix, name in _BEGINNINGS:
        if start.startswith(beginning):
            return suffix, name
    first = start.split(maxsplit=1)[:1]
    if first and first[0] in (b"OFF", b"COFF", b"NOFF"):
        return "off", "an OFF file"
    if start[:5].lower() == b"solid" and b"facet" in start.lower():
        return "stl", "a text STL file"
    lines = start.splitlines()
    if sum(line.startswith((b"v ", b"v\t", b"f ", b"vn ", b"o ", b"g ")) for line in lines) > 2:
        return "obj", "an OBJ file"
    return "", ""


def unreadable_file(file: DataFile, where: str, hint: str = "") -> InputError:
    """The error for a file that is damaged, or whose content does not match its ending."""
    suffix, name = recognise_content(file.data)
    article = "an" if file.suffix[:1] in "aeo" or file.suffix.startswith(("x", "st")) else "a"
    message = f"{file.path} is not {article} {file.suffix.upper()} file that can be read"
    if name and suffix != file.suffix:
        return InputError(message, where=f"it looks like {name}",
                          hint="give it the right ending, or export it again")
    return InputError(message, where=where,
                      hint=hint or "it is damaged or of another kind; export it again")
