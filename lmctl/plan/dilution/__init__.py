"""Dilution: how much of the layer below a bead takes up, and what is fed to make up for it.

```text
dilution_law ──> compensation ──> laid_deviation (to the next layer)
 δ of energy      mixture to feed    where the fed mixture could not make up for all of it
```
"""

from lmctl.plan.dilution.compensation import (
    CompensatedLayer,
    DilutionCompensation,
    compensation_of,
    with_known_dilution,
)
from lmctl.plan.dilution.dilution_law import DilutionLaw, dilution_law
from lmctl.plan.dilution.dilution_statistics import DilutionStatistics

__all__ = [
    "CompensatedLayer", "DilutionCompensation", "DilutionLaw", "DilutionStatistics",
    "compensation_of", "dilution_law", "with_known_dilution",
]
