"""The viewer of a job or of its runs as one HTML file that needs no network."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from html import escape
from importlib.resources import files
from typing import Any

#: One script in the page, in this order.
SCRIPTS = ("layer_data.js", "layer_drawing.js", "controls.js")


def viewer_page(
    head: dict[str, Any], layers: Iterable[dict[str, Any]], first_layer: int
) -> Iterator[str]:
    """The page in pieces, so that a job larger than memory likes can be written layer by layer.

    first_layer : index of the layer shown first
    """
    folder = files("lmctl.report.job_viewer")
    page = (folder / "viewer.html").read_text("utf-8")
    page = page.replace("@TITLE@", escape(str(head["part"])))
    page = page.replace("@STYLE@", (folder / "viewer.css").read_text("utf-8"))
    page = page.replace("@FIRST@", str(first_layer))
    page = page.replace("@SCRIPT@", "\n".join(
        (folder / name).read_text("utf-8") for name in SCRIPTS))
    before, _, rest = page.partition("@HEAD@")
    between, _, after = rest.partition("@LAYERS@")
    yield before + _embedded(head) + between + "["
    for number, layer in enumerate(layers):
        yield (",\n" if number else "") + _embedded(layer)
    yield "]" + after


def _embedded(data: Any) -> str:
    """JSON that cannot end the script element it stands in."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
