"""The layers of a part with the mixtures to feed, which make up for what they melt.

That is taken to be what the layer below was deposited as, under the middle of the bead;
`fitted_mixtures` looks at all of the bead once the order of beads is known. Where that layer was
fed what it should be it is the part's own composition there, a function of place alone, which the
geometry stage gives. Elsewhere the deviation is carried from layer to layer (`laid_deviation`); it
fades as δ, δ², δ³. Under the first layer is the substrate. So text and geometry of a layer still
depend on nothing but it.

Deposits are counted in the part's materials and one more: a substrate of none of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.plan.dilution.dilution_law import DilutionAlong, DilutionLaw, dilution_law
from lmctl.plan.dilution.fed_mixtures import mixture_to_feed
from lmctl.plan.dilution.laid_deviation import LaidDeviation
from lmctl.plan.geometry.layer_geometry import LayerGeometry
from lmctl.plan.melted_below import MeltedBelow
from lmctl.plan.recipe import Recipe
from lmctl.plan.substrate_mixture import substrate_mixture

if TYPE_CHECKING:
    from lmctl.config.machine import MachineProfile
    from lmctl.part.part import Part

#: δ depends on the mixture that is fed, by its power and speed: so often it is put in again.
_ROUNDS = 2


@dataclass(frozen=True)
class CompensatedLayer:
    """A layer with the mixtures to feed in place of the part's.

    melted : at its vertices; along : their dilution, with its interval
    deviation : (n, materials + 1), what is deposited less the part's composition
    """

    geometry: LayerGeometry
    melted: MeltedBelow
    along: DilutionAlong
    deviation: FloatArray


class DilutionCompensation:
    """Turns the part's mixtures into those to feed, layer by layer in order.

    substrate : share of each material in the substrate's alloy and of a foreign one
        (materials + 1,); None where its alloy is not known: the first layer is fed as designed
    power_factor : on the recipe's beam power in a layer, by its number
    """

    def __init__(
        self, law: DilutionLaw, recipe: Recipe, substrate: FloatArray | None,
        power_factor: Callable[[int], float] = lambda number: 1.0,
    ) -> None:
        self._law = law
        self._recipe = recipe
        self._substrate = substrate
        self._power_factor = power_factor
        self._deviation: LaidDeviation | None = None

    @property
    def knows_substrate(self) -> bool:
        """Whether the first layer is compensated too."""
        return self._substrate is not None

    def compensated(self, geometry: LayerGeometry, number: int) -> CompensatedLayer | None:
        """The next layer. number : in the job, 0 for the one on the substrate

        None where it is fed as designed: nothing is known of what lies below it.
        """
        designed = np.column_stack([geometry.fractions, np.zeros(len(geometry.fractions))])
        below = self._below(geometry, number)
        if below is None or geometry.n_tracks == 0:
            self._deviation = None
            return None
        fed = geometry.fractions
        for _ in range(_ROUNDS):
            along = self._law.along(fed, self._power_factor(number) * self._energy_J_mm(
                fed, geometry.strip_width_mm))
            fed = mixture_to_feed(designed, below, along.share)
        melted = MeltedBelow(designed, below, along.share, geometry.fractions_across)
        deviation = melted.laid(fed) - designed
        self._deviation = LaidDeviation.of_layer(number, geometry.points_mm, deviation)
        return CompensatedLayer(replace(geometry, fractions=fed, melted=melted), melted, along,
                                deviation)

    def _below(self, geometry: LayerGeometry, number: int) -> FloatArray | None:
        if number == 0:
            if self._substrate is None:
                return None
            return np.broadcast_to(self._substrate, (len(geometry.points_mm),
                                                     len(self._substrate)))
        if geometry.fractions_below is None:
            return None
        below = np.column_stack([geometry.fractions_below, np.zeros(len(geometry.points_mm))])
        if self._deviation is not None and self._deviation.layer == number - 1:
            below += self._deviation.at(geometry.points_mm)
        return below

    def _energy_J_mm(self, fed: FloatArray, strip_width_mm: FloatArray) -> FloatArray:
        """Energy per length at the recipe's power: speed follows the strip, power does not."""
        recipe = self._recipe
        return np.asarray(recipe.power(fed) / (
            recipe.speed(fed) * recipe.strip_speed_factor(strip_width_mm)))


def with_known_dilution(part: Part, profile: MachineProfile) -> Part:
    """The part as it is planned on a machine: without compensation where no dilution is known, or
    there is but one powder to feed; and with the order of its first layer.

    Every other track first means wide slow strips and narrow fast ones. Where one dilution is
    stated for all energies per length, that would be believed of both.
    """
    process = part.process
    law = None if process.dilution == "ignore" else dilution_law(
        profile.dilution, [material.name for material in part.materials])
    if law is None or len(part.materials) < 2:
        return replace(part, process=process.model_copy(update={"dilution": "ignore"}))
    if process.first_layer_order != "auto":
        return part
    order = "every-other" if law.follows_energy else "in-turn"
    return replace(part, process=process.model_copy(update={"first_layer_order": order}))


def compensation_of(
    part: Part, profile: MachineProfile, recipe: Recipe
) -> DilutionCompensation | None:
    """What makes up for dilution in a part's plan; None where nothing is to, or δ is not known."""
    names = [material.name for material in part.materials]
    law = None if part.process.dilution == "ignore" else dilution_law(profile.dilution, names)
    if law is None:
        return None
    # power that follows temperature keeps the molten pool, and so what it melts, as it is
    return DilutionCompensation(
        law, recipe, substrate_mixture(part), part.process.power_factor)
