"""Compute the speed, beam power and powder flow of each mixture from its volume fractions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmctl.array_types import FloatArray
from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.config.part_file import ProcessSettings
from lmctl.errors import PlanError
from lmctl.plan.mixture_catch import MixtureCatch, mixture_catch
from lmctl.preflight.hoppers import hopper_for_material

if TYPE_CHECKING:
    from lmctl.part.materials.powders import MaterialSpec
    from lmctl.part.part import Part

#: To follow the strip width speed is lower or higher than the recipe's by at most these factors; a
#: strip beyond them is deposited too low or too high, which the built fraction reports.
MOST_SLOWER_FACTOR, MOST_FASTER_FACTOR = 1.5, 2.0
#: Mixtures at a hopper's least flow are found in so many turns where the catch depends on them.
_CATCH_ROUNDS = 25
#: A flow below this is none [g/s].
_NO_FLOW_G_S = 1e-12


def hopper_flows_g_min(
    fractions: ArrayLike, density_g_mm3: ArrayLike, catch_efficiency: ArrayLike,
    volume_rate_mm3_s: ArrayLike,
) -> FloatArray:
    """Powder flow of each hopper that deposits a wanted mixture at a wanted rate.

    m_i = 60 V_i ρ_i Q_v / η_i: the paper mixes by volume, feeders meter mass, and every powder
    is caught with its own efficiency (docs/explanation/powder-delivery.md, Volume, mass and catch).

    fractions : (..., n_hoppers) float64, volume fractions V_i of the deposit, sum 1
    density_g_mm3, catch_efficiency : (n_hoppers,) float64, solid density ρ_i, η_i in (0, 1]
    volume_rate_mm3_s : Q_v, number or (..., 1) float64
    returns : (..., n_hoppers) float64 [g/min]

    >>> hopper_flows_g_min([0.5, 0.5], [0.00785, 0.0143], [0.75, 0.55], 7.8).round(4)
    array([2.4492, 6.084 ])
    """
    per_volume = np.asarray(density_g_mm3, np.float64) / np.asarray(catch_efficiency, np.float64)
    rate = np.asarray(volume_rate_mm3_s, np.float64)
    return np.asarray(60 * np.asarray(fractions, np.float64) * per_volume * rate)


@dataclass(frozen=True)
class Recipe:
    """The process of one part on one machine; arrays are (n_materials,) float64.

    pitch_mm : nominal track spacing a(1 − overlap)
    hoppers : the hopper of each material, in the part's order
    idle : hoppers that hold one of the materials too, and are not used
    mixture_catch : of the materials together; None where each is taken to be caught as by itself
    """

    materials: tuple[MaterialSpec, ...]
    hoppers: tuple[HopperSettings, ...]
    density_g_mm3: FloatArray
    catch_efficiency: FloatArray
    power_W: FloatArray
    speed_mm_s: FloatArray
    min_flow_g_s: FloatArray
    max_flow_g_s: FloatArray
    dead_time_s: FloatArray
    lag_s: FloatArray
    bead_mm: float
    pitch_mm: float
    layer_height_mm: float
    idle: tuple[HopperSettings, ...] = ()
    mixture_catch: MixtureCatch | None = None

    def speed(self, fractions: FloatArray) -> FloatArray:
        """Speed of mixtures (..., m): between the pure recipes by volume fraction [mm/s]."""
        return np.asarray(fractions @ self.speed_mm_s)

    def power(self, fractions: FloatArray) -> FloatArray:
        """Beam power of mixtures (..., m), between the pure recipes [W]."""
        return np.asarray(fractions @ self.power_W)

    def strip_speed_factor(self, strip_width_mm: FloatArray) -> FloatArray:
        """Factor on the speed for a strip: nominal pitch over its width, within limits."""
        return np.clip(
            self.pitch_mm / strip_width_mm, 1 / MOST_SLOWER_FACTOR, MOST_FASTER_FACTOR)

    def flow_g_s(self, fractions: FloatArray, speed_factor: FloatArray | float = 1.0) -> FloatArray:
        """Flow of each hopper for mixtures (..., m) deposited at `speed_factor` times the recipe's
        speed."""
        rate = self.pitch_mm * self.layer_height_mm * self.speed(fractions) * speed_factor
        if self.mixture_catch is not None:
            return self.mixture_catch.flow_to_deposit(
                np.asarray(fractions, np.float64) * self.density_g_mm3 * rate[..., None])
        flows = hopper_flows_g_min(
            fractions, self.density_g_mm3, self.catch_efficiency, rate[..., None])
        return flows / 60

    def catch_at(self, flow_g_s: FloatArray) -> FloatArray:
        """Catch efficiency of each powder at flows (..., m) of all."""
        return (self.catch_efficiency if self.mixture_catch is None
                else self.mixture_catch.efficiency(flow_g_s))

    def deposited_fractions(self, flow_g_s: FloatArray) -> FloatArray:
        """Volume fractions that flows (..., m) deposit: V_i = m_i η_i / ρ_i, normalised."""
        volume = flow_g_s * self.catch_at(flow_g_s) / self.density_g_mm3
        total = volume.sum(axis=-1, keepdims=True)
        return np.asarray(np.divide(volume, total, out=np.zeros_like(volume), where=total > 0))

    def deliverable_mixtures(self, fractions: FloatArray) -> FloatArray:
        """Mixtures (n, m) with each flow between 0 and a hopper's least set to the nearer one.

        The other materials share the difference in proportion. The flow of a single remaining
        powder may still be too low.
        """
        result = np.array(fractions, dtype=np.float64)
        result /= result.sum(axis=1, keepdims=True)
        flow = self.flow_g_s(result)
        rows = np.flatnonzero((self._is_weak(flow) & (flow > _NO_FLOW_G_S)).any(axis=1))
        if len(rows) == 0:
            return result
        wanted, which = np.unique(result[rows], axis=0, return_inverse=True)
        result[rows] = self._rounded_to_least(wanted)[which.reshape(-1)]
        return result

    def _is_weak(self, flow_g_s: FloatArray) -> NDArray[np.bool_]:
        return np.asarray(flow_g_s < self.min_flow_g_s * (1 - 1e-9))

    def _rounded_to_least(self, wanted: FloatArray) -> FloatArray:
        """Mixtures (n, m) that hoppers can meter. Each round settles one powder of every mixture
        that is not metered yet: to its hopper's least flow or to none, whichever is nearer."""
        mixture = wanted.copy()
        none = self.flow_g_s(wanted) <= _NO_FLOW_G_S
        least = np.zeros_like(none)
        todo = np.arange(len(wanted))
        while len(todo):
            flow = self.flow_g_s(mixture[todo])
            free = ~(none[todo] | least[todo])
            weak = self._is_weak(flow) & free
            alone = free.sum(axis=1) <= 1
            open_ = weak.any(axis=1) & (~alone | least[todo].any(axis=1))
            todo, flow, weak, alone = todo[open_], flow[open_], weak[open_], alone[open_]
            ratio = np.where(weak, flow / np.maximum(self.min_flow_g_s, 1e-12), np.inf)
            weakest = ratio.argmin(axis=1)
            raised = ~alone & (ratio.min(axis=1, initial=np.inf) >= 0.5)
            least[todo[raised], weakest[raised]] = True
            dropped = ~alone & ~raised
            none[todo[dropped], weakest[dropped]] = True
            # Others at their least leave too little for the last: drop the scarcest of all.
            short = todo[alone]
            scarcest = np.where(none[short], np.inf, wanted[short]).argmin(axis=1)
            none[short, scarcest], least[short, scarcest] = True, False
            full = short[~(~none[short] & ~least[short]).any(axis=1)]
            least[full, np.where(least[full], wanted[full], -1.0).argmax(axis=1)] = False
            mixture[todo] = self._with_least(wanted[todo], none[todo], least[todo])
        return mixture

    def _with_least(
        self, wanted: FloatArray, none: NDArray[np.bool_], least: NDArray[np.bool_]
    ) -> FloatArray:
        """Mixtures (n, m) whose materials `least` flow at their hoppers' least and `none` not at
        all; the others share the rest as in `wanted`.

        A flow is k_i V_i v with the mixture's own speed v, so V_i = c_i / v for c_i = least / k_i.
        With u = 1/v, C = Σ c_i, A = Σ c_i v_i over `least` and S the speed of the others' mixture,
        v = A u + (1 − C u) S, that is (A − C S) u² + S u − 1 = 0.
        """
        share = np.where(none | least, 0.0, wanted)
        share /= share.sum(axis=1, keepdims=True)
        if self.mixture_catch is None:
            return self._raised_to_least(share, least, self.catch_efficiency)
        mixture = wanted
        for _ in range(_CATCH_ROUNDS):  # the catch depends on the mixture that it decides
            mixture = self._raised_to_least(share, least, self.catch_at(self.flow_g_s(mixture)))
        return mixture

    def _raised_to_least(
        self, share: FloatArray, least: NDArray[np.bool_], catch: FloatArray
    ) -> FloatArray:
        per_speed = self.pitch_mm * self.layer_height_mm * self.density_g_mm3 / catch
        at_least = np.where(least, self.min_flow_g_s / per_speed, 0.0)
        total, own = at_least.sum(axis=1), at_least @ self.speed_mm_s
        others = share @ self.speed_mm_s
        square = others**2 + 4 * (own - total * others)
        raised = at_least * (2 / (others + np.sqrt(np.maximum(square, 0.0))))[:, None]
        rest = np.maximum(0.0, 1 - raised.sum(axis=1, keepdims=True))
        rest[square < 0] = 0.0  # no speed leaves the others anything
        mixture = raised + share * rest
        return np.asarray(mixture / mixture.sum(axis=1, keepdims=True))

    def check_deliverable(self, fractions: FloatArray, where: str) -> None:
        """Raise PlanError where a mixture (n, m) needs a flow outside a hopper's range."""
        if len(fractions) == 0:
            return
        flow = self.flow_g_s(fractions)
        excess = flow / self.max_flow_g_s
        if excess.max() > 1 + 1e-9:
            self._refuse(fractions, flow, excess, where, "at most", self.max_flow_g_s, "lower")
        shortage = np.where(flow > 0, flow / np.maximum(self.min_flow_g_s, 1e-12), np.inf)
        if shortage.min() < 1 - 1e-6:
            self._refuse(fractions, flow, shortage, where, "at least", self.min_flow_g_s, "raise")

    def check_feasible(self, only: FloatArray | None) -> None:
        """Raise PlanError where hoppers cannot deliver what is known before any geometry is made.

        only : (m,) the mixture of all of the part; None where it varies, and then only what no
            mixture could change is refused
        """
        if only is not None:
            self.check_deliverable(self.deliverable_mixtures(only[None]), "all of the part")
            return
        per_speed = self.flow_g_s(np.eye(len(self.hoppers))).diagonal() / self.speed_mm_s
        most = float((self.max_flow_g_s / per_speed).sum())  # speed at which all deliver their most
        if most < self.speed_mm_s.min():
            raise PlanError(
                f"all hoppers together deliver enough for {most:.3g} mm/s; no material of the part "
                f"is deposited below {self.speed_mm_s.min():.3g}",
                where=f"pitch {self.pitch_mm:.3g} mm, layer height {self.layer_height_mm:g} mm",
                hint=f"lower speed_mm_s to at most {most * 0.99:.3g}, or the layer height in "
                     "proportion")
        ratio = per_speed * self.speed_mm_s.max() / np.maximum(self.min_flow_g_s, 1e-12)
        if ratio.max() < 1:
            least = self.speed_mm_s.max() / float(ratio.max())
            raise PlanError(
                "every hopper's least flow is more than any mixture of the part takes",
                where=f"at most {self.speed_mm_s.max():.3g} mm/s, pitch {self.pitch_mm:.3g} mm, "
                      f"layer height {self.layer_height_mm:g} mm",
                hint=f"raise speed_mm_s to at least {least * 1.01:.3g}, or the layer height in "
                     "proportion")

    def _refuse(
        self, fractions: FloatArray, flow: FloatArray, ratio: FloatArray, where: str, bound: str,
        limit_g_s: FloatArray, change: str,
    ) -> None:
        worst = np.argmax(ratio) if change == "lower" else np.argmin(ratio)
        row, column = np.unravel_index(int(worst), ratio.shape)
        hopper = self.hoppers[column]
        speed = float(self.speed(fractions[row]))
        # a little beyond the bound, so that three digits of it are on the right side
        enough = speed / ratio[row, column] * (0.99 if change == "lower" else 1.01)
        idle = [h.name for h in self.idle if h.material == hopper.material]
        raise PlanError(
            f"hopper {hopper.name} ({hopper.material}) would have to deliver "
            f"{flow[row, column] * 60:.4g} g/min; it delivers {bound} {limit_g_s[column] * 60:g}",
            where=(where, f"{fractions[row, column]:.0%} {hopper.material} at {speed:.3g} mm/s, "
                   f"pitch {self.pitch_mm:.3g} mm, layer height {self.layer_height_mm:g} mm",
                   *(f"hopper {name} holds {hopper.material} too, and is not used: a material "
                     "is fed from one hopper" for name in idle)),
            hint=f"{change} speed_mm_s to {bound} {enough:.3g}, or the layer height in proportion",
        )


def recipe_of(part: Part, profile: MachineProfile, layer_height_mm: float) -> Recipe:
    """The recipe of a part on a machine, with what needs no geometry found feasible.

    Raises PlanError: a material has no hopper, or hoppers cannot deliver it in any layer.
    """
    recipe = make_recipe(part.materials, part.process, profile)
    # Layers fitted to the part's height are deposited as much faster as they are lower: volume per
    # second, power, and so energy per volume stay the recipe's.
    faster = recipe.layer_height_mm / layer_height_mm
    recipe = replace(recipe, layer_height_mm=layer_height_mm, speed_mm_s=recipe.speed_mm_s * faster)
    only = part.uniform_mixture()
    recipe.check_feasible(None if only is None else np.asarray(only, dtype=np.float64))
    return recipe


def make_recipe(
    materials: Sequence[MaterialSpec], process: ProcessSettings, profile: MachineProfile
) -> Recipe:
    """The recipe of a part's materials on a machine. Raises PlanError: a material has no hopper, or
    a mixture of two is stated to be caught impossibly badly.

    Catch efficiencies that were measured on the machine stand in for the part file's.
    """
    hoppers = [hopper_for_material(material.name, profile) for material in materials]

    def column(values: list[float]) -> FloatArray:
        return np.array(values, dtype=np.float64)

    catch = column([hopper.catch_efficiency or material.catch_efficiency
                    for hopper, material in zip(hoppers, materials, strict=True)])
    return Recipe(
        materials=tuple(materials),
        hoppers=tuple(hoppers),
        density_g_mm3=column([m.density_g_mm3 for m in materials]),
        catch_efficiency=catch,
        power_W=column([m.power_W for m in materials]),
        speed_mm_s=column([m.speed_mm_s for m in materials]),
        min_flow_g_s=column([h.min_flow_g_min for h in hoppers]) / 60,
        max_flow_g_s=column([h.max_flow_g_min for h in hoppers]) / 60,
        dead_time_s=column([h.dead_time_s for h in hoppers]),
        lag_s=column([h.lag_s for h in hoppers]),
        bead_mm=process.bead_width_mm,
        pitch_mm=process.bead_width_mm * (1 - process.overlap),
        layer_height_mm=process.layer_height_mm,
        idle=tuple(
            hopper for hopper in profile.hopper
            if hopper not in hoppers and any(hopper.material == h.material for h in hoppers)),
        mixture_catch=mixture_catch(
            profile.mixture_catch, [material.name for material in materials], catch),
    )
