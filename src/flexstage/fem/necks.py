"""Necks of a stage: cuts, motions as rows over the unknowns of a plate, stress on the surface."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import ngsolve as ng
import numpy as np
from numpy.polynomial import Legendre, Polynomial
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.elasticity import Continuum
from flexstage.elasticity.loaded import COMPONENTS
from flexstage.elasticity.resources import parallel
from flexstage.elasticity.shapes import METRE
from flexstage.fem.geometry import exactly, neck_edge, surface_edge
from flexstage.fem.layered_plate import LayeredPlate
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.hinges import Profile
from flexstage.hinges.hinge_spring import PlaneState
from flexstage.hinges.profile import Vertex
from flexstage.stage import ExtraMass, Stage
from flexstage.stage.outline import Point


@dataclass(frozen=True, slots=True, kw_only=True)
class CutNeck:
    """A neck at which a body is cut from its neighbour."""

    at: Point
    """Centre of the neck [m]."""
    direction: float
    """Direction of the hinge [rad]."""
    which: int
    """0 where the body is the first of the hinge's bodies, 1 where it is the second."""
    profile: Profile
    """The notch."""
    contour: tuple[Vertex, ...]
    """Contour."""
    plane: PlaneState
    """``stress`` or ``strain``."""


#: Loads inside a body: forces and moment on its mean motion, one kelvin, one kelvin by metre.
LOADS = ("x", "y", "rotation", "temperature", "temperature gradient x", "temperature gradient y")
#: The same out of its plane.
LOADS_OUT_OF_PLANE = ("z", "rotation x", "rotation y", "temperature gradient z")

_TURNS = ("rotation by", "slope of it")


def neck_coordinates(through: ThroughThickness) -> tuple[str, ...]:
    """Name the motions of a neck, in order: each is a mean over its width and its thickness."""
    plane, across = (("z", "z^3"), ("1", "z^2")) if through.out_of_plane else (("1", "z^2"), ("z",))
    plane, across = (
        names[: through.functions[kind].transmitted]
        for names, kind in ((plane, "plane"), (across, "across"))
    )
    return (
        *(f"{motion} by {k}" for k in plane for motion in ("along", "rotation")),
        *(f"across by {k}" for k in plane),
        *(f"{motion} by {k}" for k in across for motion in ("through the plate", "slope of it")),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class InterfaceDofs:
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
        """True if it is the motion out of the plane."""
        return self.axes == "z"

    def transferred(self, motion: Array, centre: Point, at: Point) -> Array:
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
        return self.transferred(np.eye(3), centre, at)[: len(self.axes)]

    def inertia(self, extra: ExtraMass) -> Array:
        """Return the inertia of an extra mass by motions; out of the plane it is a point."""
        out = (extra.mass, 0.0, 0.0)
        return np.array(out if self.out_of_plane else (extra.mass, extra.mass, extra.inertia))


def interface_dofs(through: ThroughThickness) -> InterfaceDofs:
    """Return the degrees of freedom of bodies condensed with functions through the thickness."""
    out = through.out_of_plane
    return InterfaceDofs(
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
        on_neck = np.array(scalar.GetDofs(mesh.Boundaries(name)), dtype=bool)
        means.append(np.where(on_neck, of_all, 0.0) / (METRE * neck.profile.neck_thickness))
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


class NeckMotions(NamedTuple):
    """The motions of necks; pulled ones, along the hinge, come before the sheared ones."""

    transmitted: tuple[NeckMotion, ...]
    """Motions that necks transmit, in the order of `neck_coordinates`."""
    self_balanced: tuple[NeckMotion, ...]
    """Motions whose tractions have no resultant."""
    pulled: int
    """Number of pulled motions among the transmitted ones."""
    pulled_self_balanced: int
    """Number of pulled motions among those without resultant."""

    @property
    def every(self) -> tuple[NeckMotion, ...]:
        """All motions, the transmitted ones first."""
        return (*self.transmitted, *self.self_balanced)


@lru_cache(maxsize=64)
def neck_motions(through: ThroughThickness, degree: int) -> NeckMotions:
    """Return the motions that necks transmit, and those without resultant."""
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

    lowest, higher = range(plane.transmitted), range(plane.transmitted, len(plane.values))
    pulled = motions(0, lowest, [mean, turn])
    pulled_balanced = motions(0, range(len(plane.values)), normal)
    pulled_balanced += motions(0, higher, [mean, turn])
    sheared = motions(1, lowest, [parabola])
    sheared_balanced = motions(1, range(len(plane.values)), shear)
    sheared_balanced += motions(1, higher, [parabola])
    lowest, higher = range(across.transmitted), range(across.transmitted, len(across.values))
    sheared += motions(2, lowest, [mean, slope])
    sheared_balanced += motions(2, range(len(across.values)), normal)
    sheared_balanced += motions(2, higher, [mean, slope])
    return NeckMotions(
        transmitted=(*pulled, *sheared),
        self_balanced=(*pulled_balanced, *sheared_balanced),
        pulled=len(pulled),
        pulled_self_balanced=len(pulled_balanced),
    )


def neck_mix(flexibility: Array, through: ThroughThickness, degree: int) -> Array:
    r"""Return the composition of each motion that a neck transmits, by all `neck_motions`.

    About a notch that is the same on both sides a pull or a moment keeps the neck plane and its
    shear traction zero, and a shear force moves the neck uniformly and keeps its normal traction
    zero. The tractions without resultant that make it so are a part of each, for pulled and sheared
    motions by themselves: :math:`\lambda_e = -F_{ee}^{-1} F_{er}\lambda_r` with the flexibility F
    of the neck, shape (r + e, r + e). Shape (r, r + e).
    """
    transmitted, balanced, pulled, pulled_balanced = neck_motions(through, degree)
    r, e = len(transmitted), len(balanced)
    mix = np.eye(r, r + e)
    for mine, others in (
        (np.arange(pulled), r + np.arange(pulled_balanced)),
        (np.arange(pulled, r), r + np.arange(pulled_balanced, e)),
    ):
        inner, right = flexibility[np.ix_(others, others)], flexibility[np.ix_(others, mine)]
        mix[np.ix_(mine, others)] = -np.linalg.lstsq(inner, right, rcond=1e-10)[0].T
    return mix


def constraint_matrix(
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
    rows = np.zeros((len(local), plate.size))
    rows[:, number[free]] = local[:, free]
    return rows


#: Indices of the components of stress in a plane model: xx, yy, zz and xy.
IN_PLANE = (0, 1, 2, 5)
#: Points along an edge; its ends lie on vertices, where adjacent elements are averaged.
ALONG = (0.0, 0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NeckPoints:
    """Points on the surfaces of the notches, each once for every element that touches it."""

    hinges: tuple[str, ...]
    """Names of the hinges."""
    places: NDArray[np.void]
    """Points of the mesh, shape (m,)."""
    position: Array
    """Their positions [m], shape (m, 3)."""
    owner: NDArray[np.intp]
    """Index into `hinges`, shape (m,)."""

    @property
    def point(self) -> NDArray[np.intp]:
        """Number of the point that each place belongs to, shape (m,)."""
        key = np.column_stack((self.owner, np.round(self.position * 1e9).astype(np.int64)))
        _, point = np.unique(key, axis=0, return_inverse=True)
        return point.ravel()

    def of(self, hinge: int) -> "NeckPoints":
        """Return those of one hinge."""
        of_hinge = self.owner == hinge
        return replace(
            self,
            places=self.places[of_hinge],
            position=self.position[of_hinge],
            owner=self.owner[of_hinge],
        )


def neck_points(mesh: ng.Mesh, stage: Stage) -> NeckPoints:
    """Return the points at which the stress of the notches is computed."""
    return surface_points(mesh, tuple(h.name for h in stage.hinges))


def surface_points(mesh: ng.Mesh, hinges: tuple[str, ...]) -> NeckPoints:
    """Return points along every element's edge or face on the surfaces of notches."""
    rules = {ng.ET.SEGM: _rule([(s, 0.0, 0.0) for s in ALONG])}
    if mesh.dim == 3:
        rules = {ng.ET.QUAD: _rule([(s, t, 0.0) for s in ALONG for t in ALONG])}
    places_by_hinge, owner = [], []
    for i, name in enumerate(hinges):
        surface = mesh.Boundaries(exactly(surface_edge(name)))
        places = mesh.MapToAllElements(rules, surface)
        places_by_hinge.append(places)
        owner.append(np.full(len(places), i, dtype=np.intp))
    if not places_by_hinge:
        nothing = np.zeros(0, dtype=np.intp)
        return NeckPoints(
            hinges=(), places=np.zeros(0, dtype="V1"), position=np.zeros((0, 3)), owner=nothing
        )
    places = np.concatenate(places_by_hinge)
    position = np.asarray(ng.CoefficientFunction((ng.x, ng.y, ng.z))(places)) / METRE
    return NeckPoints(
        hinges=hinges,
        places=places,
        position=position,
        owner=np.concatenate(owner),
    )


def _rule(points: list[tuple[float, float, float]]) -> ng.IntegrationRule:
    return ng.IntegrationRule(points=points, weights=[1.0] * len(points))


def neck_stress(
    continuum: Continuum, points: NeckPoints, u: Array, temperature: float = 0.0
) -> Array:
    """Return the stress at the points of the notches.

    Components xx, yy, zz, yz, xz, xy [Pa], shape (m, 6) or, of r displacements, (m, 6, r);
    `temperature` is a uniform change that goes with them [K].
    """
    if not points.owner.size:
        return np.zeros((0, 6, *u.shape[1:]))
    if u.ndim == 2:
        columns = [neck_stress(continuum, points, column, temperature) for column in u.T]
        return np.stack(columns, axis=-1)
    stress = continuum.stress(u, temperature)
    # compiled, what the components share is computed once
    six = ng.CoefficientFunction(tuple(stress[i, j] for i, j in COMPONENTS)).Compile()
    with parallel():
        return np.asarray(ng.BoundaryFromVolumeCF(six)(points.places))


def layered_stress(plate: LayeredPlate, points: NeckPoints, basis: Array) -> Array:
    """Return the stress of displacements of a plate at the points of its notches, level by level.

    Components [Pa] are those of `COMPONENTS`, of a plane model those of `IN_PLANE`; shape
    (l, m, c, r).
    """
    r = basis.shape[1]
    through, strained = plate.through, plate.plane.strained
    parts, z = through.components, through.levels
    selected = range(len(COMPONENTS)) if through.in_space else IN_PLANE
    if not len(points.places):
        return np.zeros((z.size, 0, len(selected), r))
    fields = plate.expanded(basis)
    values, slopes = _slopes_at(points, plate.plane.mesh, plate.plane.order, fields)
    functions = through.values_at(z)
    gradient = np.zeros((z.size, len(values), 3, 3, r))  # of displacement i along j
    for i, (d, kind, k) in enumerate(parts):
        value, slope = (f[k][:, None, None] for f in functions[kind])
        gradient[:, :, d, 0] += value * slopes[None, :, i, :, 0]
        gradient[:, :, d, 1] += value * slopes[None, :, i, :, 1]
        gradient[:, :, d, 2] += slope * values[None, :, i]
    gradient = gradient.reshape(-1, 3, 3, r)
    shear, (lame, more) = plate.shear_modulus, plate.lame
    where: Array | float = 0.0
    if strained is not None:
        where = np.asarray(ng.BoundaryFromVolumeCF(strained)(points.places)).reshape(-1, 1)
    volume = (lame + more * where) * np.einsum("miir->mr", gradient)
    # a plane model strains nothing across the plate, and is stressed there in plane strain alone
    across = volume if through.in_space else where * volume
    gradients = np.stack(
        [
            ((across if i == 2 else volume) if i == j else 0.0)
            + shear * (gradient[:, i, j] + gradient[:, j, i])
            for i, j in (COMPONENTS[k] for k in selected)
        ],
        axis=1,
    )
    return gradients.reshape(z.size, -1, len(selected), r)


def _slopes_at(points: NeckPoints, mesh: ng.Mesh, order: int, u: Array) -> tuple[Array, Array]:
    """Return fields in a plane and their derivatives [1/m] at the points of notches.

    Of c components of r displacements, shape (c, n, r): shapes (m, c, r) and (m, c, r, 2).
    """
    c, _, r = u.shape
    # all fields as the components of one function: they are evaluated at once
    function = ng.GridFunction(ng.H1(mesh, order=order, dim=c * r))
    function.vec.FV().NumPy()[:] = u.transpose(1, 0, 2).reshape(-1)
    columns = []
    for field in (function, ng.Grad(function)):
        columns.append(np.asarray(ng.BoundaryFromVolumeCF(field)(points.places)))
    return columns[0].reshape(-1, c, r), METRE * columns[1].reshape(-1, c, r, 2)


def stress_of_other_half(stress: Array, lengthwise: NDArray[np.bool_]) -> Array:
    """Return stress for unit forces on a neck, mirrored to the other half of its notch.

    Shape (l, m, c, r); `lengthwise` are the forces that act along the hinge, which are mirrored
    too, shape (r,).
    """
    odd = np.array([(i == 0) != (j == 0) for i, j in _components(stress)])
    return np.where(odd[:, None] != lengthwise, -stress, stress)


def stress_in_direction(stress: Array, direction: float) -> Array:
    """Return stress components in the axes of a stage, of a hinge in some direction [rad].

    Shape (l, m, c, r).
    """
    components = _components(stress)
    c, s = math.cos(direction), math.sin(direction)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    mix = np.array(
        [
            [
                turn[i, k] * turn[j, m] + (turn[i, m] * turn[j, k] if k != m else 0.0)
                for k, m in components
            ]
            for i, j in components
        ]
    )
    return mix @ stress


def _components(stress: Array) -> tuple[tuple[int, int], ...]:
    """Return the indices of the components of stress, shape (l, m, c, r)."""
    if stress.shape[2] == len(IN_PLANE):
        return tuple(COMPONENTS[k] for k in IN_PLANE)
    return COMPONENTS
