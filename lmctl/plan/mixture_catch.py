"""Catch efficiency of powders that are fed together: each one's own, changed by the others.

    η_i(s) = η_i · (1 + Σ_j κ_ij s_j),  κ_ij = κ_ji

s are shares of the mass fed. A coupon of two powders has one mass, so that it gives one κ for the
pair: both are taken to be changed alike (docs/explanation/powder-delivery.md, Volume, mass and
catch).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.mixture_catch import MixtureCatchSettings
from lmctl.errors import PlanError

#: Efficiencies lie within these shares of 1, whatever κ says.
_LEAST, _MOST = 0.01, 1.0
#: Flows of a mixture and its catch are found in turn until they change by less than this share.
_SETTLED = 1e-10
_MOST_ROUNDS = 60


@dataclass(frozen=True)
class MixtureCatch:
    """alone : (m,) η of each powder by itself; interaction : (m, m) κ, symmetric, diagonal 0"""

    alone: FloatArray
    interaction: FloatArray

    def efficiency(self, flow_g_s: FloatArray) -> FloatArray:
        """Catch of each powder fed at flows (..., m) of any unit: (..., m)."""
        total = flow_g_s.sum(axis=-1, keepdims=True)
        shares = np.divide(flow_g_s, total, out=np.zeros_like(flow_g_s), where=total > 0)
        found = self.alone * (1.0 + shares @ self.interaction)
        return np.asarray(np.clip(found, _LEAST, _MOST))

    def flow_to_deposit(self, deposited_g_s: FloatArray) -> FloatArray:
        """The flows (..., m) of which deposits (..., m) stay, found by turns."""
        flow = deposited_g_s / self.alone
        for _ in range(_MOST_ROUNDS):
            better = deposited_g_s / self.efficiency(flow)
            if (np.abs(better - flow) <= _SETTLED * np.abs(flow)).all():
                return np.asarray(better)
            flow = better
        return np.asarray(flow)


def mixture_catch(
    stated: Sequence[MixtureCatchSettings], materials: Sequence[str], alone: FloatArray
) -> MixtureCatch | None:
    """The catch of a part's materials together; None where no mixture of them is stated.

    alone : (m,) catch efficiency of each by itself
    Raises PlanError for a mixture that none of a pair could be caught like.
    """
    sums = np.zeros((2, len(materials), len(materials)))
    for one in stated:
        if not one.mass_shares.keys() <= set(materials):
            continue
        i, j = (materials.index(name) for name in one.mass_shares)
        share = np.array(list(one.mass_shares.values()))
        share /= share.sum()
        by_themselves = float(share @ alone[[i, j]])
        # κ multiplies this much of the efficiency; several coupons of a pair: least squares
        reach = float((share * (1.0 - share)) @ alone[[i, j]])
        for a, b in ((i, j), (j, i)):
            sums[0, a, b] += reach * (one.efficiency - by_themselves)
            sums[1, a, b] += reach**2
    if not sums[1].any():
        return None
    interaction = np.divide(sums[0], sums[1], out=np.zeros_like(sums[0]), where=sums[1] > 0)
    if (interaction <= -1.0).any():
        i, j = (int(n) for n in np.unravel_index(interaction.argmin(), interaction.shape))
        raise PlanError(
            f"a mixture of {materials[i]} and {materials[j]} is stated to be caught so badly that "
            "little of one in the other would not be caught at all",
            where="mixture_catch of the profile, or the coupon of the mixture",
            hint="weigh the coupon of the mixture again: `lmctl machine catch-test`")
    return MixtureCatch(alone, interaction)
