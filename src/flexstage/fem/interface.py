"""Stiffness of a part between its faces, and motion of a face by others."""

from collections.abc import Sequence
from dataclasses import dataclass

import ngsolve as ng
import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.elasticity import Continuum
from flexstage.elasticity.continuum import rigid_fields
from flexstage.elasticity.resources import parallel, require_memory
from flexstage.elasticity.shapes import METRE

_STEPS = 60
_TOLERANCE = 1e-8  # of eigenvalues of a part with mean interfaces


def require_memory_of(continuum: Continuum) -> None:
    """Refuse a mesh that is too large for the memory, before its stiffness is factorised."""
    if continuum._solver is None:
        low, high = continuum.mesh.ngmesh.bounding_box
        sides = [high[c] - low[c] for c in range(3)]
        require_memory(continuum.size, 3, continuum.order, box=sides)


def interface_motion(continuum: Continuum, boundary: str, at: Sequence[float]) -> Array:
    r"""Return the mean motion of an interface: the rigid one nearest to its own in mean square.

    .. math:: q = G^{-1} \int R^T u, \quad G = \int R^T R

    with the six rigid motions R about a point. The same rows are the loads of unit forces and
    moments at that point that leave the interface free to deform.

    Displacements [m] and rotations [rad] for each degree of freedom, shape (6, n); the point is in
    metres, and `boundary` a regular expression.
    """
    continuum.measure(boundary=boundary)  # refuses an unknown one
    fields = rigid_fields(at)
    where = continuum.mesh.Boundaries(boundary)
    area = float(ng.Integrate(ng.CoefficientFunction(1.0), continuum.mesh, definedon=where))
    gram = np.array(
        [
            [
                float(ng.Integrate(ng.InnerProduct(p, q), continuum.mesh, definedon=where))
                for q in fields
            ]
            for p in fields
        ]
    )
    rows = np.array([area * continuum.mean(boundary, p) for p in fields])
    return np.asarray(np.linalg.solve(gram, rows), dtype=float)


def interface_stiffness(
    continuum: Continuum,
    moving: str | Sequence[str],
    fixed: str | Sequence[str],
    *,
    at: Sequence[float] = (0.0, 0.0, 0.0),
    rigid: bool = True,
) -> Array:
    r"""Return the stiffness of interfaces of a part, moved as one, while others are fixed.

    A *rigid* interface moves as a stiff plate would that is welded to it. A *mean* interface is
    free to deform, and its mean motion is fixed, moved or loaded: forces are distributed over it as
    a rigid motion is. The part between rigid interfaces is always the stiffer.

    Forces [N] and moments about the point `at` [N m] over displacements [m] and rotations [rad],
    shape (6, 6). `moving` and `fixed` are regular expressions, one for each interface: of several
    mean ones each has the required motion, or none. Rigid interfaces must be among the fixed
    boundaries of the part; for mean ones no boundary may be fixed, and a `shift` must be given, of
    any size below its lowest natural frequency.

    Examples
    --------
    A bar of 20 x 3 x 2 mm bends as a beam does that shear softens by 3 %:

    >>> from netgen.occ import Box
    >>> from flexstage.fem.part import Part
    >>> from flexstage.fem.part_mesh import PartMesh
    >>> from flexstage.quantities.material import material
    >>> bar = Part.from_shape(Box((0, 0, 0), (20.0, 3.0, 2.0)))
    >>> ends = [bar.boundary(bar.select("x", end)) for end in ("max", "min")]
    >>> mesh = bar.mesh(PartMesh(order=1, size=4e-3))
    >>> part = Continuum(mesh, material("Al 6061-T6"), order=3, shift=1e8)
    >>> k = interface_stiffness(part, *ends, at=(20e-3, 1.5e-3, 1e-3), rigid=False)
    >>> round(float(k[2, 2] * (20e-3) ** 3 / (12 * 68.9e9 * 2e-12)), 2)
    0.97
    """
    moved, fixed_names = _each(moving), _each(fixed)
    for name in (*moved, *fixed_names):
        continuum.measure(boundary=name)  # refuses an unknown one
    require_memory_of(continuum)
    if rigid:
        return _rigid_stiffness(continuum, [("|".join(moved), at)], "|".join(fixed_names))
    return _between_mean(continuum, moved, fixed_names, at)


def _each(names: str | Sequence[str]) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)


def _rigid_stiffness(
    continuum: Continuum, moving: Sequence[tuple[str, Sequence[float]]], fixed: str
) -> Array:
    """Return the stiffness of rigid interfaces about a point each, shape (6 k, 6 k)."""
    free = np.array(continuum.space.FreeDofs(), dtype=bool)
    owners = np.zeros(free.size, dtype=int)
    for name in (*(name for name, _ in moving), fixed):
        on = np.array(continuum.space.GetDofs(continuum.mesh.Boundaries(name)), dtype=bool)
        if (free & on).any():
            names = "|".join((*(name for name, _ in moving), fixed))
            raise ModelError(
                "a rigid interface must be among the fixed boundaries of the part: create the "
                f"continuum with fixed='{names}'"
            )
        owners += on
    if owners.max(initial=0) > 1:
        raise ModelError(
            f"two of the rigid interfaces {', '.join((*(name for name, _ in moving), fixed))} "
            "touch each other, so neither can move alone: choose separate faces, or mean interfaces"
        )
    columns, forces = [], []
    for name, at in moving:
        where = continuum.mesh.Boundaries(name)
        for motion in rigid_fields(at):
            prescribed = ng.GridFunction(continuum.space)
            prescribed.Set(motion, definedon=where)
            displacement = prescribed.vec.FV().NumPy().copy()
            total = displacement - continuum.solve(_stiffness_times(continuum, displacement))
            columns.append(displacement)
            forces.append(_stiffness_times(continuum, total))
    stiffness = np.array(columns) @ np.array(forces).T
    return 0.5 * (stiffness + stiffness.T)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotionRatio:
    """Motion of an interface of a part while two others are pushed apart, or together."""

    direction: Array
    """Unit vector from the second of the two to the first, along which they move, shape (3,)."""
    motion: Array
    """Displacement [1] and rotation [rad/m] of the third one, about its centroid, for each metre
    that the two move apart, shape (6,).
    """
    stiffness: float
    """Force over the distance by which the two move apart [N/m]."""

    @property
    def ratio(self) -> float:
        """Displacement of the third one over the relative displacement of the two [1]."""
        return float(np.linalg.norm(self.motion[:3]))


def interface_ratio(
    continuum: Continuum,
    apart: tuple[str, str],
    output: str,
    fixed: str | Sequence[str],
    *,
    rigid: bool = True,
) -> MotionRatio:
    """Return the motion of an interface while two others are pushed apart by opposite forces.

    All are regular expressions: `apart` the ends of a drive, along the line through whose centroids
    the forces act, `output` the one that is measured. The part, and several fixed interfaces, are
    as in `interface_stiffness`; all interfaces must be rigid in that case, and must not touch.

    Examples
    --------
    A bar that is drawn longer grows thinner by Poisson's ratio, 0.33:

    >>> from netgen.occ import Box
    >>> from flexstage.fem.part import Part
    >>> from flexstage.fem.part_mesh import PartMesh
    >>> from flexstage.quantities.material import material
    >>> bar = Part.from_shape(Box((0, 0, 0), (9.0, 3.0, 2.0)))
    >>> right, left, top, bottom = (
    ...     bar.boundary(bar.select(*s))
    ...     for s in (("x", "max"), ("x", "min"), ("z", "max"), ("z", "min"))
    ... )
    >>> part = Continuum(
    ...     bar.mesh(PartMesh(order=1, size=4e-3)), material("Al 6061-T6"), order=3, shift=1e8
    ... )
    >>> found = interface_ratio(part, (right, left), top, bottom, rigid=False)
    >>> (found.motion[:3] * 9.0 / 2.0).round(2) + 0.0
    array([ 0.  ,  0.  , -0.33])
    """
    fixed_names = _each(fixed)
    for name in (*apart, output, *fixed_names):
        continuum.measure(boundary=name)  # refuses an unknown one
    require_memory_of(continuum)
    first, second, end = (_centroid(continuum, name) for name in (*apart, output))
    direction = np.subtract(first, second)
    length = float(np.linalg.norm(direction))
    if not length > 0.0:
        raise ModelError(
            f"the interfaces {apart[0]} and {apart[1]} have the same centroid, so there is no ratio"
        )
    direction /= length
    if rigid:
        moving = [(apart[0], first), (apart[1], second), (output, end)]
        stiffness = _rigid_stiffness(continuum, moving, "|".join(fixed_names))
        force = np.concatenate([direction, [0.0] * 3, -direction, [0.0] * 9])
        solution = np.linalg.solve(stiffness, force)
        opened = float(direction @ (solution[:3] - solution[6:9]))
        motion = solution[12:]
    else:
        _require_floating(continuum)
        pull = direction @ (
            interface_motion(continuum, apart[0], first)[:3]
            - interface_motion(continuum, apart[1], second)[:3]
        )
        u = _floating(continuum, pull)
        base, *others = (interface_motion(continuum, name, end) for name in fixed_names)
        if others:  # kept where the first is, by forces between them
            between = np.vstack([other - base for other in others])
            answers = np.column_stack([_floating(continuum, row) for row in between])
            u = u - answers @ np.linalg.solve(between @ answers, between @ u)
        opened = float(pull @ u)
        motion = (interface_motion(continuum, output, end) - base) @ u
    motion = np.asarray(motion / opened, dtype=float)
    return MotionRatio(direction=direction, motion=motion, stiffness=1.0 / opened)


def _centroid(continuum: Continuum, boundary: str) -> tuple[float, ...]:
    """Return the centroid of an interface [m]."""
    where = continuum.mesh.Boundaries(boundary)
    area = ng.Integrate(ng.CoefficientFunction(1.0), continuum.mesh, definedon=where)
    parts = [ng.Integrate(c, continuum.mesh, definedon=where) for c in (ng.x, ng.y, ng.z)]
    return tuple(float(c) / float(area) / METRE for c in parts)


def _stiffness_times(continuum: Continuum, u: Array) -> Array:
    """Return K u element by element, because the assembled matrix is condensed."""
    form = continuum._form()
    displacement = ng.GridFunction(continuum.space)
    displacement.vec.FV().NumPy()[:] = u
    result = displacement.vec.CreateVector()
    with parallel():
        form.Apply(displacement.vec, result)
    return result.FV().NumPy().copy()


def _require_floating(continuum: Continuum) -> None:
    if not continuum.shift or not all(continuum.space.FreeDofs()):
        raise ModelError(
            "with mean interfaces the part must be free: create the continuum with a shift and "
            "no fixed boundary"
        )


def _between_mean(
    continuum: Continuum, moving: Sequence[str], fixed: Sequence[str], at: Sequence[float]
) -> Array:
    _require_floating(continuum)
    # Unit loads on one interface and their reactions on another are in balance, so that they have a
    # static answer, up to a rigid motion, without any support.
    first, *others = (interface_motion(continuum, name, at) for name in (*fixed, *moving))
    apart = np.vstack([other - first for other in others])
    compliance = apart @ np.column_stack([_floating(continuum, row) for row in apart])
    stiffness = np.linalg.inv(0.5 * (compliance + compliance.T))
    # those that are held stay where the first of them is, and those that move have one motion
    n, still = len(moving), 6 * (len(fixed) - 1)
    blocks = stiffness[still:, still:].reshape(n, 6, n, 6)
    return np.asarray(blocks.sum(axis=(0, 2)), dtype=float)


def interface_modes(continuum: Continuum, fixed: Sequence[str], count: int) -> tuple[Array, Array]:
    r"""Return the natural modes of a part whose interfaces are fixed in the mean.

    The mean motion of each interface is zero by forces that are distributed over it; the
    interface itself may deform. With P the mean motions and :math:`A = (K + sM)^{-1}`,
    the iterated operator is :math:`A - A P^T (P A P^T)^{-1} P A`.

    Returns omega [rad/s], shape (count,), and shapes with phi^T M phi = 1, shape (n, count), of a
    part with a shift.
    """
    for name in fixed:
        continuum.measure(boundary=name)  # refuses an unknown one
    require_memory_of(continuum)
    motion = np.vstack([interface_motion(continuum, name, (0.0, 0.0, 0.0)) for name in fixed])
    moved = continuum.solve(motion.T)
    inner = np.linalg.inv(motion @ moved)

    def answer(load: Array) -> Array:
        u = continuum.solve(load)
        return u - moved @ (inner @ (motion @ u))

    return continuum.modes(count, respond=answer, tolerance=_TOLERANCE)


def _floating(continuum: Continuum, load: Array) -> Array:
    """Solve K u = f for a free part and balanced loads, without the mass of the shift."""
    rigid = _rigid_basis(continuum)
    weighted = continuum.mass_times(rigid)

    def settled(u: Array) -> Array:
        return u - rigid @ (weighted.T @ u)

    first = u = settled(continuum.solve(load))
    last = np.inf
    for _ in range(_STEPS):
        more = settled(continuum.solve(load + continuum.shift * continuum.mass_times(u)))
        change = float(np.linalg.norm(more - u) / np.linalg.norm(first))
        u = more
        if change < 1e-10 or (change < 1e-7 and change > 0.5 * last):
            return u  # at the tolerance, or at the level of rounding
        last = change
    raise ConvergenceError(
        "the solution of the free part did not converge: give a shift well below the square of "
        "its lowest natural angular frequency"
    )


def _rigid_basis(continuum: Continuum) -> Array:
    """Return the rigid motions, made orthonormal with the mass, shape (n, 6)."""
    columns = []
    for motion in rigid_fields((0.0, 0.0, 0.0)):
        function = ng.GridFunction(continuum.space)
        function.Set(motion)
        columns.append(function.vec.FV().NumPy().copy())
    basis = np.column_stack(columns)
    factor = np.linalg.cholesky(basis.T @ continuum.mass_times(basis))
    return np.asarray(np.linalg.solve(factor, basis.T).T, dtype=float)
