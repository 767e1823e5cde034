"""The manifest as JSON and back, checked as untrusted input."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from functools import cache
from typing import TYPE_CHECKING

from lmctl.errors import JobError
from lmctl.job.container import MAX_LAYERS, REPLAN_HINT
from lmctl.job.schema import JobManifest

if TYPE_CHECKING:
    from pydantic import TypeAdapter


def manifest_to_json(manifest: JobManifest) -> bytes:
    """The manifest as UTF-8 JSON with sorted keys. Raises ValueError on NaN and infinities."""
    data = dataclasses.asdict(manifest)
    text = json.dumps(data, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False)
    return text.encode() + b"\n"


def manifest_from_json(data: bytes, name: str) -> JobManifest:
    """Read a manifest. Raises JobError where it is not one or contradicts itself."""
    from pydantic import ValidationError  # late: writing needs none of it

    try:
        manifest = _adapter().validate_json(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(step) for step in first["loc"])
        raise JobError(f"{name}: its manifest cannot be read",
                       where=f"{place}: {first['msg']}" if place else first["msg"],
                       hint=REPLAN_HINT) from None
    broken = _contradiction(manifest)
    if broken:
        raise JobError(f"{name}: its manifest contradicts itself", where=broken, hint=REPLAN_HINT)
    return manifest


@cache
def _adapter() -> TypeAdapter[JobManifest]:
    from pydantic import TypeAdapter

    return TypeAdapter(JobManifest)


def part_digest(part_text: str) -> str:
    """SHA-256 of the part file's text, as `JobManifest.part_sha256` holds it."""
    return hashlib.sha256(part_text.encode()).hexdigest()


def _contradiction(manifest: JobManifest) -> str | None:
    if not manifest.materials or not manifest.hoppers:
        return "no materials or no hoppers"
    if not 0 < len(manifest.layers) <= MAX_LAYERS:
        return f"{len(manifest.layers)} layers"
    line, path, time_s = 0, 0, manifest.layers[0].start_s
    for i, layer in enumerate(manifest.layers):
        if layer.index != i or layer.first_line != line or layer.n_lines <= 0:
            return f"layer {i} does not begin where the one before it ends"
        if layer.first_path != path or layer.n_paths < 0:
            return f"the paths of layer {i} are not numbered on from the layer before it"
        if not (math.isfinite(layer.end_s) and math.isfinite(layer.z_mm)):
            return f"time or height of layer {i} is not a number"
        if layer.start_s != time_s or layer.end_s < layer.start_s:
            return f"layer {i} does not begin when the one before it ends"
        line, path, time_s = line + layer.n_lines, path + layer.n_paths, layer.end_s
    return None
