"""The simulated operator: hands at the scale and the balance, beside a bench."""

from __future__ import annotations

import asyncio

import numpy as np

from simulators.bench import Bench

#: Hands take so long to follow a request [s]; a coupon cools so long before it is weighed or cut.
_HANDS_S = 3.217
_COOLING_S = 600.0
#: Of every plate that is clamped, and the step of the balance [g].
_PLATE_G = 412.37
_BALANCE_G = 0.01
#: A part is measured with a gauge of so fine a scale [mm], in so long [s].
_GAUGE_MM = 0.05
_GAUGE_S = 60.0


class SimulatedOperator:
    """Does what a test asks an operator for. bench : the cell that is stood beside

    One plate serves for all coupons: what counts are differences.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._cut_until_s = 0.0

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

    async def weigh_plate(self, request: str) -> str:
        """Weigh the plate with all that was deposited on it, as a balance shows it."""
        await asyncio.sleep(_COOLING_S)
        path = self._bench.record.beam_on_path()
        density = {h.config.material: h.config.density_g_mm3
                   for feeder in self._bench.feeders.values() for h in feeder.hoppers.values()}
        per_material = np.array([density[name] for name in path.materials])
        laid_g = float((path.deposit_mm3_s * path.duration_s[:, None]).sum(axis=0) @ per_material)
        shown_g = round((_PLATE_G + laid_g) / _BALANCE_G) * _BALANCE_G
        return f"{shown_g:.2f} g"

    async def measure_height(self) -> float | None:
        """Height of the part above the plate, by a depth gauge: mean over what is a bead inside.

        None on a bench without a table [process], where nothing grows.
        """
        from simulators.process.build import build_from_record

        process = self._bench.config.process
        await asyncio.sleep(_GAUGE_S)
        built = None if process is None else build_from_record(self._bench.record, process)
        if built is None:
            return None
        assert process is not None
        top = built.height_mm > 0.5 * float(built.height_mm.max())
        inside = top.copy()
        for _ in range(round(process.bead_width_mm / process.voxel_mm)):
            padded = np.pad(inside, 1)
            inside = (padded[1:-1, 1:-1] & padded[2:, 1:-1] & padded[:-2, 1:-1]
                      & padded[1:-1, 2:] & padded[1:-1, :-2])
        height_mm = float(built.height_mm[inside if inside.any() else top].mean())
        return round(round(height_mm / _GAUGE_MM) * _GAUGE_MM, 3)

    async def analyse_track(self, request: str) -> str:
        """Analyse the last track: share of the plate in its pool, to a tenth of a per cent.

        Needs a bench with a table [process]; else there is nothing to analyse.
        """
        from simulators.process.pool import dilution

        process = self._bench.config.process
        if process is None:
            return "no analysis: this bench has no [process]"
        await asyncio.sleep(_COOLING_S)
        path = self._bench.record.beam_on_path()
        track = path.time_s > self._cut_until_s
        self._cut_until_s = float(path.time_s[-1])
        speed = path.length_mm[track] / path.duration_s[track]
        power = path.power_fraction[track] * process.max_power_W
        volume = path.deposit_mm3_s[track].sum(axis=1) * path.duration_s[track]
        kept = (volume > 0) & (speed > 0)
        share = dilution(process, power[kept], speed[kept])
        return f"{100 * float(np.average(share, weights=volume[kept])):.1f} %"
