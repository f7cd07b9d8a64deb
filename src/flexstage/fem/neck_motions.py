"""Motions of necks: their names, and the rows over the unknowns of a plate that read them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import ngsolve as ng
import numpy as np
from numpy.polynomial import Legendre, Polynomial
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.elasticity.shapes import METRE
from flexstage.fem.geometry import exactly, neck_edge
from flexstage.fem.layered_plate import LayeredPlate
from flexstage.fem.substructure import CutNeck
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.stage import ExtraMass
from flexstage.stage.outline import Point

#: Loads inside a body: forces and moment on its mean motion, one kelvin, one kelvin by metre.
LOADS = ("x", "y", "rotation", "temperature", "temperature gradient x", "temperature gradient y")
#: The same out of its plane.
LOADS_OUT_OF_PLANE = ("z", "rotation x", "rotation y", "temperature gradient z")

_TURNS = ("rotation by", "slope of it")


def neck_coordinates(through: ThroughThickness) -> tuple[str, ...]:
    """Name the motions of a neck, in order: each is a mean over its width and its thickness."""
    plane, across = (("z", "z^3"), ("1", "z^2")) if through.out_of_plane else (("1", "z^2"), ("z",))
    plane, across = (
        names[: through.functions[kind].passed]
        for names, kind in ((plane, "plane"), (across, "across"))
    )
    return (
        *(f"{motion} by {k}" for k in plane for motion in ("along", "rotation")),
        *(f"across by {k}" for k in plane),
        *(f"{motion} by {k}" for k in across for motion in ("through the plate", "slope of it")),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Freedom:
    """Degrees of freedom of the interfaces of the bodies of a stage, in its plane or out of it."""

    necks: tuple[str, ...]
    """Name and unit of each motion of a neck."""
    loads: tuple[str, ...]
    """Loads inside each body; the first three are those on its mean motion."""
    axes: str = "xy"
    """Directions in which bodies are displaced: ``xy`` or ``z``."""

    @property
    def turning(self) -> NDArray[np.bool_]:
        """Motions of a neck that are a rotation times half of the thickness of the neck."""
        return np.array([name.startswith(_TURNS) for name in self.necks])

    @property
    def out_of_plane(self) -> bool:
        """Whether it is the motion out of the plane."""
        return self.axes == "z"

    def carried(self, motion: Array, centre: Point, at: Point) -> Array:
        """Transfer the motion of a body, one a row, from its centre to another point."""
        x, y = at[0] - centre[0], at[1] - centre[1]
        moved = motion.copy()
        if self.out_of_plane:  # displacement z, rotations about x and y
            moved[0] += y * motion[1] - x * motion[2]
        else:  # displacements x and y, rotation
            moved[0] -= y * motion[2]
            moved[1] += x * motion[2]
        return moved

    def read(self, centre: Point, at: Point) -> Array:
        """Return the displacements of a point of a body by the motions of its centre, shape (k, 3).

        The same rows are the loads of unit forces at the point on these motions.
        """
        return self.carried(np.eye(3), centre, at)[: len(self.axes)]

    def inertia(self, extra: ExtraMass) -> Array:
        """Return the inertia of an extra mass by motions; out of the plane it is a point."""
        out = (extra.mass, 0.0, 0.0)
        return np.array(out if self.out_of_plane else (extra.mass, extra.mass, extra.inertia))


def freedom(through: ThroughThickness) -> Freedom:
    """Return the degrees of freedom of bodies condensed with functions through the thickness."""
    out = through.out_of_plane
    return Freedom(
        necks=tuple(f"{name} [m]" for name in neck_coordinates(through)),
        loads=LOADS_OUT_OF_PLANE if out else LOADS,
        axes="z" if out else "xy",
    )


# Tractions without resultant go up to this degree; a neck is often one element wide.
_HIGHEST = 6


def edge_means(
    mesh: ng.Mesh, order: int, necks: Sequence[CutNeck], highest: int | None = None
) -> list[Array]:
    """Return the means over necks of the powers of eta, -1 to 1 across, times a displacement.

    For each neck for each unknown of one component, up to the highest power p, the order of the
    space where none is given, shape (p + 1, n); the necks are named by their number.
    """
    highest = order if highest is None else highest
    scalar = ng.H1(mesh, order=order)
    names = [exactly(neck_edge(str(i))) for i in range(len(necks))]
    eta = {}
    for name, neck in zip(names, necks, strict=True):
        c, s = math.cos(neck.direction), math.sin(neck.direction)
        across = (ng.y / METRE - neck.at[1]) * c - (ng.x / METRE - neck.at[0]) * s
        eta[name] = across * (2.0 / neck.profile.neck_thickness)
    coordinate = mesh.BoundaryCF(eta, default=0.0)
    powers = [ng.CoefficientFunction(1.0)]
    while len(powers) <= highest:
        powers.append(powers[-1] * coordinate)
    v = scalar.TestFunction()
    rows = []
    for power in powers:
        form = ng.LinearForm(scalar)
        form += power * v * ng.ds("|".join(names), bonus_intorder=highest)
        form.Assemble()
        rows.append(form.vec.FV().NumPy().copy())
    of_all = np.array(rows)
    means = []
    for name, neck in zip(names, necks, strict=True):
        own = np.array(scalar.GetDofs(mesh.Boundaries(name)), dtype=bool)
        means.append(np.where(own, of_all, 0.0) / (METRE * neck.profile.neck_thickness))
    return means


@lru_cache(maxsize=16)
def neck_weights(degree: int) -> tuple[Array, Array, Array]:
    """Weights over a neck, by the powers of eta up to a degree: of a beam, normal and shear.

    Those of a beam are for displacement along and across and for rotation times half the neck.
    Those without resultant are the Legendre polynomials from the second on for the normal
    displacement and, for the other one, the shear tractions (1 - eta^2) P'_k, which vanish at the
    surfaces as the parabola does.
    """
    highest = min(degree, _HIGHEST)
    bubble = Polynomial([1.0, 0.0, -1.0])
    legendre = [Legendre.basis(k).convert(kind=Polynomial) for k in range(highest + 1)]
    parabola = 1.5 * bubble if degree > 1 else Polynomial([1.0])
    beam = [Polynomial([1.0]), parabola, Polynomial([0.0, -3.0])]
    normal, shear = legendre[2:], [bubble * p.deriv() for p in legendre[2:-1]]

    def table(weights: Sequence[Polynomial]) -> Array:
        rows = np.zeros((len(weights), degree + 1))
        for row, weight in zip(rows, weights, strict=True):
            row[: len(weight.coef)] = weight.coef
        return rows

    return table(beam), table(normal), table(shear)


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
    """Return the motions that necks transmit, and those without resultant.

    Both begin with the motions along the hinge (pulled), whose numbers are returned too; the others
    are sheared. The transmitted motions are in the order of `neck_coordinates`.
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


def neck_mix(flexibility: Array, through: ThroughThickness, degree: int) -> Array:
    r"""Return the composition of each motion that a neck transmits, by all `neck_motions`.

    About a notch that is the same on both sides a pull or a moment keeps the neck plane and its
    shear traction zero, and a shear force moves the neck uniformly and keeps its normal traction
    zero. The tractions without resultant that make it so are a part of each, for pulled and sheared
    motions by themselves: :math:`\lambda_e = -F_{ee}^{-1} F_{er}\lambda_r` with the flexibility F
    of the neck, shape (r + e, r + e). Shape (r, r + e).
    """
    passed, rest, pulled, pulled_more = neck_motions(through, degree)
    r, e = len(passed), len(rest)
    mix = np.eye(r, r + e)
    for mine, others in (
        (np.arange(pulled), r + np.arange(pulled_more)),
        (np.arange(pulled, r), r + np.arange(pulled_more, e)),
    ):
        inner, right = flexibility[np.ix_(others, others)], flexibility[np.ix_(others, mine)]
        mix[np.ix_(mine, others)] = -np.linalg.lstsq(inner, right, rcond=1e-10)[0].T
    return mix


def motion_rows(
    plate: LayeredPlate,
    means: Array,
    motions: tuple[NeckMotion, ...],
    direction: tuple[float, float] = (1.0, 0.0),
    mix: Array | None = None,
) -> Array:
    """Return motions of a neck as rows of a plate, or combinations of them, shape (m, n).

    `means` are those of `edge_means`, `direction` is the hinge's.
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
