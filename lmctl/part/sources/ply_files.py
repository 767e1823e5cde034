"""PLY files, as text or binary: elements that are rows of numbers and lists of numbers.

What the head declares is compared with the file's length *before* anything is read, so that a
truncated file is called truncated and a hostile count allocates nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.part.sources.files import DataFile
from lmctl.part.sources.recognition import unreadable_file

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_MAX_HEAD = 100_000


@dataclass(frozen=True)
class PlyProperty:
    """One number of a row, or (count is not None) a list: how long it is, then its numbers."""

    name: str
    type: np.dtype[np.generic]
    count: np.dtype[np.generic] | None = None


@dataclass(frozen=True)
class PlyElement:
    """rows of the same properties."""

    name: str
    row_count: int
    properties: tuple[PlyProperty, ...]


@dataclass(frozen=True)
class PlyColumns:
    """What was read of an element.

    numbers : {property: (rows,) float64}; lists : {property: (sizes (rows,), values (sum,))}
    """

    numbers: dict[str, FloatArray]
    lists: dict[str, tuple[IntArray, FloatArray]]


def read_ply(file: DataFile) -> dict[str, PlyColumns]:
    """All elements of a PLY file, by name. Raises InputError."""
    order, elements, body = read_ply_head(file)
    found = {}
    if order == "":
        lines = iter([w for line in body.decode("ascii", "replace").splitlines()
                      if (w := line.split())])
        for element in elements:
            found[element.name] = _from_lines(file, element, list(islice(lines, element.row_count)))
    else:
        at = 0
        for element in elements:
            with np.errstate(invalid="ignore"):  # what is no number is refused by its user
                found[element.name], at = _from_bytes(file, element, body, at)
    return found


def read_ply_head(file: DataFile) -> tuple[str, list[PlyElement], bytes]:
    """The byte order ("" for text), the elements and the bytes that follow the head.

    Raises InputError where there is none, or it declares more than the file can hold.
    """
    head, found, body = file.data.partition(b"end_header")
    if not head.startswith(b"ply") or not found or len(head) > _MAX_HEAD:
        raise unreadable_file(file, "it does not begin with `ply` … `end_header`")
    body = body[2:] if body.startswith(b"\r\n") else body[1:]
    order, elements = None, list[PlyElement]()
    for line in head.decode("ascii", "replace").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            order = _ORDERS.get(words[1] if len(words) > 1 else "")
        elif words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isdigit() or len(words[2]) > 18:
                raise unreadable_file(file, f"its head says {line[:80]!r}")
            elements.append(PlyElement(words[1], int(words[2]), ()))
        elif words[:1] == ["property"]:
            if not elements or (stated := _property(words, order or "")) is None:
                raise unreadable_file(file, f"its head says {line[:80]!r}")
            last = elements[-1]
            elements[-1] = PlyElement(last.name, last.row_count, (*last.properties, stated))
    if order is None:
        raise unreadable_file(file, "its head names no format that is known")
    rows = sum(element.row_count for element in elements)
    held = body.strip().count(b"\n") + 1 if order == "" else len(body)
    if held < rows:
        raise InputError(
            f"{file.path} is truncated",
            where=f"its head promises {rows:,} elements, it has {held:,} "
            + ("lines" if order == "" else "bytes"),
            hint="export or copy it again",
        )
    return order, elements, body


def _property(words: list[str], order: str) -> PlyProperty | None:
    if len(words) == 3 and words[1] in _TYPES:
        return PlyProperty(words[2], np.dtype(order + _TYPES[words[1]]))
    if len(words) == 5 and words[1] == "list" and words[2] in _TYPES and words[3] in _TYPES:
        count = np.dtype(order + _TYPES[words[2]])
        if count.kind in "iu":
            return PlyProperty(words[4], np.dtype(order + _TYPES[words[3]]), count)
    return None


def _from_lines(file: DataFile, element: PlyElement, lines: list[list[str]]) -> PlyColumns:
    columns = PlyColumns({}, {})
    try:
        if all(p.count is None for p in element.properties):
            wanted = len(element.properties)
            table = np.array([w[:wanted] for w in lines], dtype=np.float64).reshape(-1, wanted)
            columns.numbers.update({p.name: table[:, n] for n, p in enumerate(element.properties)})
        else:
            _lists_from_lines(element, lines, columns)
    except (ValueError, OverflowError):
        raise unreadable_file(file,
                              f"a {element.name} is not the numbers its head promises") from None
    if len(lines) < element.row_count:
        raise _short(file, element, len(lines))
    return columns


def _lists_from_lines(
    element: PlyElement, lines: list[list[str]], columns: PlyColumns
) -> None:
    sizes: list[list[int]] = [[] for _ in element.properties]
    values: list[list[str]] = [[] for _ in element.properties]
    for words in lines:
        at = 0
        for number, stated in enumerate(element.properties):
            size = 1
            if stated.count is not None:
                size, at = int(words[at]) if at < len(words) else -1, at + 1
                sizes[number].append(size)
            if size < 0 or at + size > len(words):
                raise ValueError
            values[number] += words[at : at + size]
            at += size
    for number, stated in enumerate(element.properties):
        read = np.array(values[number], dtype=np.float64)
        if stated.count is None:
            columns.numbers[stated.name] = read
        else:
            columns.lists[stated.name] = np.array(sizes[number], dtype=np.int64), read


def _from_bytes(
    file: DataFile, element: PlyElement, body: bytes, start: int
) -> tuple[PlyColumns, int]:
    """An element's columns, and where the next one begins.

    Rows with lists have no common length. Nearly always all lists are as long as the first row's:
    then the rows are one array. Else each row is walked to find the next.
    """
    if element.row_count == 0:
        empty = np.empty(0)
        return PlyColumns(
            {p.name: empty for p in element.properties if p.count is None},
            {p.name: (np.empty(0, dtype=np.int64), empty)
             for p in element.properties if p.count is not None},
        ), start
    places, _ = _walk(file, element, body, start, 1)
    row = np.dtype([
        (f"{n}{part}", of)
        for n, p in enumerate(element.properties)
        for part, of in (
            [("value", p.type)] if p.count is None else
            [("size", p.count), ("value", (p.type, int(places[n][0][1])))])
    ])
    if start + row.itemsize * element.row_count <= len(body):
        table = np.frombuffer(body, dtype=row, count=element.row_count, offset=start)
        listed = [n for n, p in enumerate(element.properties) if p.count is not None]
        if all((table[f"{n}size"] == places[n][0][1]).all() for n in listed):
            return _from_table(element, table), start + row.itemsize * element.row_count
    places, end = _walk(file, element, body, start, element.row_count)
    columns = PlyColumns({}, {})
    raw = np.frombuffer(body, dtype=np.uint8)
    for n, stated in enumerate(element.properties):
        at, sizes = np.array(places[n], dtype=np.int64).T
        width = stated.type.itemsize
        inner = np.arange(int(sizes.sum())) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        begins = np.repeat(at, sizes) + width * inner
        values = np.ascontiguousarray(raw[begins[:, None] + np.arange(width)])
        read = values.view(stated.type).ravel().astype(np.float64)
        if stated.count is None:
            columns.numbers[stated.name] = read
        else:
            columns.lists[stated.name] = sizes, read
    return columns, end


def _from_table(element: PlyElement, table: NDArray[np.void]) -> PlyColumns:
    columns = PlyColumns({}, {})
    for n, stated in enumerate(element.properties):
        values = table[f"{n}value"].astype(np.float64)
        if stated.count is None:
            columns.numbers[stated.name] = values
        else:
            sizes = table[f"{n}size"].astype(np.int64)
            columns.lists[stated.name] = sizes, values.ravel()
    return columns


def _walk(
    file: DataFile, element: PlyElement, body: bytes, start: int, rows: int
) -> tuple[list[list[tuple[int, int]]], int]:
    """For each property where its numbers begin in each row, and how many; and the end."""
    places: list[list[tuple[int, int]]] = [[] for _ in element.properties]
    at, length = start, len(body)
    stated = [
        (places[n], p.type.itemsize, p.count.itemsize if p.count is not None else 0,
         "big" if p.count is not None and p.count.str[0] == ">" else "little",
         p.count is not None and p.count.kind == "i")
        for n, p in enumerate(element.properties)
    ]
    for row in range(rows):
        for into, width, count_width, order, signed in stated:
            size = 1
            if count_width:
                size = int.from_bytes(
                    body[at : at + count_width], "big" if order == "big" else "little",
                    signed=signed)
                at += count_width
            into.append((at, size))
            at += width * size
            if size < 0 or at > length:
                raise _short(file, element, row)
    return places, at


def _short(file: DataFile, element: PlyElement, held: int) -> InputError:
    return InputError(
        f"{file.path} is damaged",
        where=f"its head promises {element.row_count:,} of element {element.name!r}, "
              f"{held:,} can be read", hint="export or copy it again",
    )
