"""How tractions pass through a neck in space: of the half notch alone, once for each profile."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from flexstage.arrays import Array
from flexstage.fem.layered_plate import LayeredPlate
from flexstage.fem.neck_rows import neck_weights
from flexstage.fem.through_thickness import ThroughThickness

_ROOT = "root"
_NEAR = 1e-9  # two points are one [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class NeckMotion:
    """A mean over a neck: of one displacement with a function through the thickness."""

    direction: int
    """0 along the hinge, 1 across it, 2 through the plate."""
    function: int
    """Number of the function through the thickness."""
    weight: tuple[float, ...]
    """Weight over the neck by the powers of eta, -1 to 1 across."""


@lru_cache(maxsize=64)
def neck_motions(
    through: ThroughThickness, degree: int
) -> tuple[tuple[NeckMotion, ...], tuple[NeckMotion, ...], int, int]:
    """Return the motions that necks pass on, and those without resultant, each pulled then sheared.

    Pulled are those along the hinge, sheared the others; the numbers say how many of each are
    pulled. The motions that are passed on come in the order of
    `flexstage.fem.plate_condensation.neck_coordinates`.
    """
    beam, normal, shear = (table.tolist() for table in neck_weights(degree))
    mean, parabola, turn = beam
    slope = [-w for w in turn]
    plane, across = through.functions["plane"], through.functions["across"]

    def motions(direction: int, numbers: range, weights: list[list[float]]) -> list[NeckMotion]:
        return [
            NeckMotion(direction=direction, function=k, weight=tuple(w))
            for k in numbers
            for w in weights
        ]

    both, more = range(plane.passed), range(plane.passed, len(plane.values))
    own, others = range(across.passed), range(across.passed, len(across.values))
    pulled = motions(0, both, [mean, turn])
    sheared = motions(1, both, [parabola]) + motions(2, own, [mean, slope])
    pulled_more = motions(0, range(len(plane.values)), normal) + motions(0, more, [mean, turn])
    sheared_more = (
        motions(1, range(len(plane.values)), shear)
        + motions(1, more, [parabola])
        + motions(2, range(len(across.values)), normal)
        + motions(2, others, [mean, slope])
    )
    return (
        (*pulled, *sheared),
        (*pulled_more, *sheared_more),
        len(pulled),
        len(pulled_more),
    )


def motion_rows(
    plate: LayeredPlate,
    means: Array,
    motions: tuple[NeckMotion, ...],
    direction: tuple[float, float] = (1.0, 0.0),
    mix: Array | None = None,
) -> Array:
    """Return motions of a neck as rows of a plate, or what is mixed of them, shape (m, n).

    `means` are those of `flexstage.fem.neck_rows.edge_means`, `direction` is the hinge's.
    """
    c, s = direction
    axes = (((0, c), (1, s)), ((0, -s), (1, c)), ((2, 1.0),))
    field = {(d, k): i for i, (d, _, k) in enumerate(plate.through.components)}
    near = np.flatnonzero(means.any(axis=0))
    local = np.zeros((len(motions), len(field), near.size))
    for row, motion in zip(local, motions, strict=True):
        weights = np.array(motion.weight) @ means[:, near] / np.sqrt(plate.through.thickness)
        for d, factor in axes[motion.direction]:
            row[field[d, motion.function]] += factor * weights
    if mix is not None:
        local = np.tensordot(mix, local, axes=1)
    number = plate.numbers(near)
    free = number >= 0
    found = np.zeros((len(local), plate.size))
    found[:, number[free]] = local[:, free]
    return found
