"""Write a job a layer at a time, in constant memory; it appears whole or not at all."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import os
import zipfile
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import JobError
from lmctl.job import container
from lmctl.job.layer_rules import broken_rule
from lmctl.job.manifest_json import part_digest, to_json
from lmctl.job.schema import JobLayer, JobManifest, LayerEntry


class JobWriter:
    """Writes one job file. Use as a context manager; `finish` makes the file appear.

    The bytes go to a hidden file in the same folder, which takes the job's name only after they
    are durable. On any exception, KeyboardInterrupt included, it is removed and whatever bore
    the job's name before is left as it was.

    Raises JobError where the file cannot be written, ValueError where a layer breaks a rule of
    the format (a planner's mistake, not a user's).
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        self._entries: list[LayerEntry] = []
        self._last_flow: NDArray[np.float64] | None = None
        self._finished = False

    def __enter__(self) -> Self:
        if self._path.is_dir():
            raise JobError(f"{self._path} is a folder, not a file name")
        try:
            self._file = self._temporary.open("xb+")
        except OSError as error:
            raise self._cannot_write(error) from None
        self._zip = zipfile.ZipFile(self._file, "w", zipfile.ZIP_STORED)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if not self._finished:
            self._discard()
            if error is None:
                raise ValueError("the job was not finished")

    def add_layer(self, layer: JobLayer) -> LayerEntry:
        """Append the next layer. Its index, first line and first time go on from the last."""
        self._check(layer)
        data = (
            ("\n".join(layer.program) + "\n").encode("ascii"),
            _npy(layer.lines), _npy(layer.flow_s), _npy(layer.flow_g_s),
        )
        if max(len(member) for member in data) > container.LARGEST_MEMBER_BYTES:
            raise JobError(f"layer {layer.index} is too large for a job file",
                           where=f"{len(layer.program):,} lines",
                           hint="plan with a wider bead or a coarser pitch")
        self._write(dict(zip(container.layer_names(layer.index), data, strict=True)))
        paths = np.unique(layer.lines["path"])
        paths = paths[paths >= 0]
        first_path = self._entries[-1].first_path + self._entries[-1].n_paths \
            if self._entries else 0
        if len(paths) and (paths[0] != first_path or paths[-1] - paths[0] + 1 != len(paths)):
            raise ValueError(f"layer {layer.index}: paths are not numbered on from {first_path}")
        entry = LayerEntry(
            index=layer.index, z_mm=layer.z_mm, first_line=layer.first_line,
            n_lines=len(layer.program), first_path=first_path, n_paths=len(paths),
            start_s=float(layer.flow_s[0]), end_s=float(layer.flow_s[-1]),
            sha256=container.layer_digest(data),
        )
        self._entries.append(entry)
        self._last_flow = layer.flow_g_s[-1]
        return entry

    def finish(self, manifest: JobManifest, part_text: str) -> JobManifest:
        """Complete the file and give it its name; returns the manifest with its layer table."""
        if not self._entries:
            raise ValueError("a job needs at least one layer")
        if manifest.part_sha256 != part_digest(part_text):
            raise ValueError("part_sha256 is not that of the part's text")
        manifest = dataclasses.replace(manifest, layers=tuple(self._entries))
        self._write({container.PART: part_text.encode(), container.MANIFEST: to_json(manifest)})
        try:
            self._zip.comment = container.unsigned_trailer()
            self._zip.close()
            container.sign(self._file)
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self._temporary.replace(self._path)
            _sync_folder(self._path.parent)
        except OSError as error:
            raise self._cannot_write(error) from None
        self._finished = True
        return manifest

    def _check(self, layer: JobLayer) -> None:
        if len(self._entries) == container.MOST_LAYERS:
            raise JobError(f"the job has more than {container.MOST_LAYERS:,} layers",
                           hint="raise process.layer_height_mm or split the part")
        n_materials = layer.lines.dtype["fractions"].shape[0]
        broken = broken_rule(layer, n_materials, layer.flow_g_s.shape[-1])
        if broken:
            raise ValueError(f"layer {layer.index}: {broken}")
        if layer.flow_s[-1] != layer.lines["end_s"][-1]:
            raise ValueError(f"layer {layer.index}: flow and lines do not end together")
        if layer.index != len(self._entries):
            raise ValueError(f"layer {layer.index} given where {len(self._entries)} is next")
        if self._entries:
            last = self._entries[-1]
            if layer.first_line != last.first_line + last.n_lines:
                raise ValueError(f"layer {layer.index}: lines are not numbered on")
            if layer.flow_s[0] != last.end_s or not np.array_equal(
                layer.flow_g_s[0], np.asarray(self._last_flow)
            ):
                raise ValueError(f"layer {layer.index}: powder flow does not go on from the last")

    def _write(self, members: dict[str, bytes]) -> None:
        try:
            for name, data in members.items():
                self._zip.writestr(container.member(name), data)
        except OSError as error:
            raise self._cannot_write(error) from None

    def _discard(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            self._zip.close()  # else it would try when it is collected
        with contextlib.suppress(OSError):
            self._file.close()
        self._temporary.unlink(missing_ok=True)

    def _cannot_write(self, error: OSError) -> JobError:
        return JobError(f"cannot write {self._path}", where=str(error.strerror or error),
                        hint="check that the folder exists, is writable and has room")


def _npy(array: NDArray[Any]) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, np.ascontiguousarray(array), (1, 0), allow_pickle=False)
    return buffer.getvalue()


def _sync_folder(folder: Path) -> None:
    """Make the new name durable, where the system can do that."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
