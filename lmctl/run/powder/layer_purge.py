"""Purges between layers, where the profile asks for them: the run leaves the part, and goes on."""

from __future__ import annotations

from lmctl.job.schema import JobManifest
from lmctl.run.powder.height_control import LayerBoundary


class LayerPurges:
    """The purges between the layers of one run. every : layers between them, above 0

    is_due : a boundary has been reached, and the purge has not begun
    """

    def __init__(self, manifest: JobManifest, every: int) -> None:
        self.is_due = False
        self._every = every
        self._layers = manifest.layers

    def next_boundary(self, layer: int) -> LayerBoundary | None:
        """Where a run that enters layer `layer`, from 0, is purged next; None where it is not."""
        layers = (layer // self._every + 1) * self._every
        if layers >= len(self._layers):
            return None
        return LayerBoundary(layers, self._layers[layers].first_line)

    def on_boundary(self, boundary: LayerBoundary) -> None:
        """The run has come to a boundary, and is about to be held."""
        self.is_due = True

    def take_due(self) -> bool:
        """Whether a purge is to begin now; reading it clears the request."""
        is_due, self.is_due = self.is_due, False
        return is_due
