"""The simulated operator: hands at the scale, beside a bench."""

from __future__ import annotations

import asyncio

from simulators.bench import Bench

#: Hands take so long to follow a request [s].
_HANDS_S = 3.217


class SimulatedOperator:
    """Does what a test asks an operator for. bench : the cell that is stood beside"""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    async def put_on_weight(self, weight_g: float) -> None:
        """Put the weight that lies beside the scale onto it, whatever is asked for."""
        await asyncio.sleep(_HANDS_S)
        scale = self._bench.scale
        if scale is not None:
            scale.put_on(scale.config.weight_g)

    async def take_off_weight(self, weight_g: float) -> None:
        """Take it off again."""
        await asyncio.sleep(_HANDS_S)
        scale = self._bench.scale
        if scale is not None:
            scale.put_on(-scale.config.weight_g)
