"""What each layer of a job takes, holds included, and its line in the journal.

A hold ends a deposition in the middle of a layer. What that layer has taken by then goes on to the
deposition that takes it up again, as a `LayerTally`.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from lmctl.run.journal.recorder import Recorder
from lmctl.run.powder.feed import PowderFeed
from lmctl.run.program.window import JobWindow


@dataclass
class LayerTally:
    """What a layer has taken so far, holds included. began_t : loop time, None before it began."""

    layer: int = 0
    began_t: float | None = None
    fed_g: dict[str, float] = field(default_factory=dict)


class Layers:
    """The layers of one deposition, one after the other.

    tally : of the layer under way
    last_line : up to this line there is nothing new to count; −1 before that has been looked up
    """

    def __init__(
        self, window: JobWindow, feed: PowderFeed, recorder: Recorder, tally: LayerTally | None
    ) -> None:
        self.tally = tally or LayerTally(window.begin().index)
        self.last_line = -1
        self._window = window
        self._feed = feed
        self._recorder = recorder
        self._loop = asyncio.get_running_loop()

    def begin(self) -> None:
        """Lines are about to be sent: what was fed until now was for the hose, not for the part."""
        if self.tally.began_t is None:
            self.tally.began_t = self._loop.time()
        self._recorder.purged(self._feed.take_fed_g())

    def executed(self, lines: int) -> None:
        """So many lines of the job have been executed: journal the layers they end."""
        while self.tally.layer < len(self._window.manifest.layers):
            self.last_line = self._window.stretch(self.tally.layer).last_line
            if lines <= self.last_line:
                return
            self._done()
        self.last_line = self._window.n_lines

    def done_before(self, layer: int) -> None:
        """All layers before one are finished, though lines without beam at their end were not."""
        while self.tally.layer < layer:
            self._done()

    def count_fed(self) -> None:
        """What was fed until now went into this layer."""
        fed_g = self.tally.fed_g
        for name, fed in self._feed.take_fed_g().items():
            fed_g[name] = fed_g.get(name, 0.0) + fed

    def _done(self) -> None:
        tally, stretch = self.tally, self._window.stretch(self.tally.layer)
        t = self._loop.time()
        self.count_fed()
        self._recorder.layer(
            layer=tally.layer, z_mm=stretch.z_mm, lines=[stretch.first_line, stretch.last_line],
            paths=len(stretch.paths), beam_s=round(stretch.beam_s, 3),
            beam_mm=round(stretch.beam_mm, 3), energy_J=round(stretch.energy_J, 1),
            planned_s=round(float(stretch.end_s[-1] - stretch.start_s[0]), 3),
            lasted_s=round(t - (t if tally.began_t is None else tally.began_t), 3),
            fed_g={name: round(fed, 3) for name, fed in tally.fed_g.items()},
        )
        self.tally = LayerTally(tally.layer + 1, t)
