"""What a first layer on another alloy reaches at best, by order and width of its beads.

Straight beads of one mixture a kind lie side by side in two layers on a plate of the first of two
powders, and the simulated process deposits them at a dilution of 20 %: no planner is asked. The
part is of one mixture, which differs from the plate by so much; mixtures are fed that differ from
the part's by a share of this difference. That share is searched for each kind of bead (first and
second round of the first layer, second layer), so that the most of the volume is within ±0.03.

Prints the shares of the volume of layers one after the other, and with every other bead first and
wider than a pitch by so much: at each difference, and their mean, which is that of a box graded
from the one to the other.

    python -m tests.benchmarks.mixture_rows.first_layer_bound
"""

from __future__ import annotations

import json

import numpy as np

from simulators.array_types import FloatArray
from simulators.process.deposition import lay_pieces

BEAD_MM, PITCH_MM, LAYER_MM, CELL_MM = 2.0, 4 / 3, 0.8, 0.25
DILUTION, TOLERANCE = 0.2, 0.03
#: Voxels of the plate, and above it; extent of the block across and along its beads.
BELOW, ABOVE, WIDTH_MM, LENGTH_MM = 8, 16, 26.0, 3.0
DIFFERENCES = (0.2, 0.35, 0.5, 0.65, 0.8)
#: The grid of voxels lies differently to the beads.
SHIFTS_MM = (0.0, 0.08, 0.16)


def block(rounds: int, wider: float, shift_mm: float) -> FloatArray:
    """Volumes in the voxels (n, kinds + 1) in the middle of a block, last that of the plate."""
    place, kind, section = [], [], []
    for layer in range(2):
        x = np.arange(4.0 + shift_mm, WIDTH_MM - 4.0, PITCH_MM)
        turns = rounds if layer == 0 else 1
        for bead in np.concatenate([np.arange(len(x))[one::turns] for one in range(turns)]):
            y = np.arange(CELL_MM / 4, LENGTH_MM, CELL_MM / 2)
            place.append(np.column_stack(
                [np.full(len(y), x[bead]), y + 1.0, np.full(len(y), LAYER_MM * (layer + 1))]))
            kind.append(np.full(len(y), rounds if layer else bead % rounds))
            more = wider * (1 - 2 * (bead % 2)) if layer == 0 and rounds == 2 else 0.0
            section.append(np.full(len(y), PITCH_MM * LAYER_MM * (1 + more)))
    at, of_kind = np.vstack(place), np.concatenate(kind)
    n, kinds = len(at), rounds + 1
    volume = np.zeros((n, kinds))
    volume[np.arange(n), of_kind] = np.concatenate(section) * CELL_MM / 2
    step = np.linalg.norm(np.diff(at, axis=0), axis=1)
    advance = np.concatenate([[0.0], np.where(step > CELL_MM, 1e6, step)])
    shape = (round(WIDTH_MM / CELL_MM), round((LENGTH_MM + 2) / CELL_MM), BELOW + ABOVE)
    voxels = np.zeros((*shape, kinds + 1))
    voxels[:, :, :BELOW, -1] = CELL_MM**3
    lay_pieces(
        at, np.tile([0.0, 1.0], (n, 1)), np.full(n, CELL_MM / 2), advance, np.full(n, BEAD_MM),
        np.full(n, DILUTION / (1 - DILUTION)), volume, np.zeros(kinds), LAYER_MM, CELL_MM, CELL_MM,
        -BELOW * CELL_MM, np.zeros(shape[:2]), voxels, np.zeros((n, kinds)), np.zeros(n))
    middle = voxels[36:68, 6:14, BELOW:].reshape(-1, kinds + 1)
    return np.asarray(middle[middle.sum(axis=1) > 0.05 * CELL_MM**3])


def best_share(voxels: FloatArray, difference: float) -> float:
    """Within tolerance, with the mixture of each kind searched."""
    volume = voxels.sum(axis=1)
    part = voxels / volume[:, None]
    more = np.array([DILUTION / (1 - DILUTION)] * (voxels.shape[1] - 2) + [0.0])

    def share(more: FloatArray) -> float:
        off = np.abs(part[:, :-1] @ more - part[:, -1]) * difference
        return float(volume[off <= TOLERANCE].sum() / volume.sum())

    for _ in range(4):
        for kind in range(len(more)):
            for to in np.linspace(-0.1, 0.4, 101):
                tried = more.copy()
                tried[kind] = to
                if share(tried) > share(more) + 1e-9:
                    more = tried
    return share(more)


def rows() -> dict[str, list[float] | float]:
    """Shares at each of DIFFERENCES, and their mean, by order of the first layer."""
    found: dict[str, list[float] | float] = {}
    orders = {"in_turn": (1, 0.0)} | {
        f"every_other_wider_{wider:.0%}": (2, wider) for wider in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)}
    for name, (rounds, wider) in orders.items():
        voxels = np.vstack([block(rounds, wider, shift) for shift in SHIFTS_MM])
        each = [best_share(voxels, difference) for difference in DIFFERENCES]
        found[name] = [round(one, 4) for one in each]
        found[f"{name}_mean"] = round(float(np.mean(each)), 4)
    return found


if __name__ == "__main__":
    print(json.dumps(rows(), indent=1))
