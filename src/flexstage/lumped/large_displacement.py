r"""Equilibrium with finite rotations, the path of a probe over the stroke, linear buckling.

Rigid bodies buckle as links between springs; a notch or leaf adds the effect of its own deflection
on its forces.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import block_diag, eigh, null_space

from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.hinges.hinge_spring import PlaneState, plane_moduli
from flexstage.hinges.profile import Profile
from flexstage.lumped.assemble import hinge_springs
from flexstage.lumped.finite_rotation import NonlinearMechanism, nonlinear
from flexstage.lumped.leaf import LeafState
from flexstage.lumped.rigid_bodies import Mechanism, mechanism
from flexstage.stage.model import Stage
from flexstage.system.statics import StrokeMotion, solve_stiffness

_ITERATIONS = 30
# part of the elastic energy that a last correction may still carry: displacements to 1e-12
_TOLERANCE = 1e-24
# and what it may carry where corrections no longer shrink
_ROUNDING = 1e-16


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Equilibrium:
    """A state of equilibrium."""

    q: Array
    """Coordinates, shape (n,)."""
    leaves: LeafState
    """State of the leaves."""
    drive_force: dict[str, float]
    """Force of each drive whose displacement is imposed, positive if it pushes [N]."""
    drive_stiffness: dict[str, float]
    """Tangent stiffness against each of them, the others held [N/m]."""
    iterations: int
    """Number of Newton steps."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StrokePath(StrokeMotion):
    """Motion of a probe's point over the stroke of a drive."""

    drive: str
    """Name of the drive."""
    probe: str
    """Name of the probe."""
    drive_force: Array
    """Force that it takes [N], shape (k,)."""
    drive_stiffness: Array
    """Tangent stiffness, the derivative of the force by the displacement [N/m], shape (k,)."""
    hinge_stress: dict[str, Array]
    """Largest equivalent stress in every hinge [Pa], each of shape (k,); empty where the
    mechanism does not tell.
    """
    q: Array
    """Coordinates, shape (k, n)."""

    @property
    def parasitic_rotation(self) -> float:
        """Largest less smallest rotation over the stroke [rad]."""
        return float(np.ptp(self.rotation))


def equilibrium(
    model: NonlinearMechanism,
    displacements: Mapping[str, float],
    *,
    forces: Mapping[str, float] | None = None,
    start: Array | Equilibrium | None = None,
) -> Equilibrium:
    r"""Find the equilibrium with the elongation of some drives imposed, by Newton's method.

    Solves :math:`\nabla V(q) = \sum_d \lambda_d \nabla g_d(q)` with :math:`g_d(q) = \delta_d`; the
    multiplier of a drive is its force. Drives that are not named are removed.

    Parameters
    ----------
    model : NonlinearMechanism
        The model.
    displacements : Mapping
        Elongation by drive [m].
    forces : Mapping, optional
        Force by drive, of drives without an imposed displacement [N].
    start : numpy.ndarray or Equilibrium, optional
        Coordinates to start from, shape (n,), or a state: where leaves bend far, only a state
        leads on from one load to the next.

    Returns
    -------
    Equilibrium
        The state.

    Raises
    ------
    ConvergenceError
        Newton's method does not converge; take smaller steps from a known state.
    ModelError
        A drive does not exist, or the mechanism can move freely.
    """
    if isinstance(start, Equilibrium):
        q, leaves = start.q, start.leaves
    else:
        q = np.zeros(model.order) if start is None else np.array(start, dtype=float)
        leaves = model.leaf_states(q)
    return _equilibrium(model, displacements, dict(forces or {}), q, leaves)


def _equilibrium(
    model: NonlinearMechanism,
    displacements: Mapping[str, float],
    pushes: Mapping[str, float],
    q: Array,
    leaves: LeafState,
) -> Equilibrium:
    names = list(displacements)
    targets = np.array([displacements[name] for name in names], dtype=float)
    n, m = model.order, len(names)
    q_start, p_start = q, leaves.p
    multiplier = np.zeros(m)
    previous = np.inf
    for iteration in range(1, _ITERATIONS + 1):
        stiffness, residual, leaf = model.linearised(q, leaves)
        gradients = np.zeros((n, m))
        gap = np.zeros(m)
        for k, name in enumerate(names):
            g, gradients[:, k], hessian = model.elongation(name, q)
            gap[k] = targets[k] - g
            stiffness = stiffness - multiplier[k] * hessian
        for name, push in pushes.items():
            _, gradient, hessian = model.elongation(name, q)
            residual = residual - push * gradient
            stiffness = stiffness - push * hessian
        # a unit diagonal makes metres and radians comparable
        scale = 1.0 / np.sqrt(np.abs(np.diag(stiffness)))
        scaled = gradients * scale[:, None]
        weight = np.linalg.norm(scaled, axis=0)
        scaled = scaled / weight
        bordered = np.block(
            [[stiffness * np.outer(scale, scale), -scaled], [scaled.T, np.zeros((m, m))]]
        )
        # the step, and what a further displacement of each drive would do
        right = np.zeros((n + m, 1 + m))
        right[:, 0] = np.concatenate((-residual * scale, gap / weight))
        right[n:, 1:] = np.diag(1.0 / weight)
        try:
            solution = np.linalg.solve(bordered, right)
        except np.linalg.LinAlgError as error:
            raise ModelError(
                "the mechanism can move without deforming a hinge, so it has no equilibrium: "
                "fix a body or add a hinge"
            ) from error
        step = solution[:n, 0] * scale
        followed = leaf.after(step)
        q = q + step
        multiplier = solution[n:, 0] / weight
        # twice the energies of the step
        size = float(np.sum(solution[:n, 0] ** 2) + np.sum((followed.p - leaves.p) ** 2))
        leaves = followed
        if not np.isfinite(size):
            break
        # where nothing is left in the end, what is rounding goes by where it began
        whole_size = max(
            float(np.sum((x / scale) ** 2) + np.sum(p**2))
            for x, p in ((q, leaves.p), (q_start, p_start))
        )
        # converged, or down to what rounding leaves
        if size <= _TOLERANCE * whole_size or previous / 4.0 <= size <= _ROUNDING * whole_size:
            drive_stiffness = np.diag(solution[n:, 1:]) / weight
            return Equilibrium(
                q=q,
                leaves=leaves,
                drive_force=dict(zip(names, multiplier.tolist(), strict=True)),
                drive_stiffness=dict(zip(names, drive_stiffness.tolist(), strict=True)),
                iterations=iteration,
            )
        previous = size
    raise ConvergenceError(
        f"no equilibrium within {_ITERATIONS} Newton steps for "
        f"{', '.join(f'{k} = {v:.3g} m' for k, v in displacements.items()) or 'the given forces'}: "
        "approach it in smaller steps"
    )


def stroke_path(
    stage: Stage | Mechanism | NonlinearMechanism,
    drive: str,
    probe: str,
    displacement: ArrayLike,
) -> StrokePath:
    """Follow a probe over the stroke of a drive, with finite rotations.

    Parameters
    ----------
    stage : Stage or Mechanism or NonlinearMechanism
        The stage, or a model of it.
    drive : str
        Name of the drive; the others are removed.
    probe : str
        Name of the probe.
    displacement : ArrayLike
        Elongations of the drive, each within reach of the one before [m], shape (k,).

    Returns
    -------
    StrokePath
        Position and rotation along the way, straightness, parasitic rotation, force and stiffness
        of the drive, stress in the hinges.

    Raises
    ------
    ConvergenceError
        A step is too long.
    ModelError
        The drive or the probe does not exist, or the probe reads a rotation.

    Notes
    -----
    Validity: bodies are rigid; the arcs of lever and link mechanisms are exact, the sideways motion
    that comes from bending of platforms is not in the model. Against solids of a parallelogram of
    leaves (H. Su, B. Survey, 2026), under three series of loads with 26 of them that move it by
    0.02 to 0.3 of its length, the travel is within 0.5 %, the motion across within 2 %, the
    rotation within 3 %.
    """
    if isinstance(stage, Stage):
        stage = mechanism(stage)
    model = nonlinear(stage) if isinstance(stage, Mechanism) else stage
    if any(p.name == probe and p.direction is None for p in model.mechanism.probes):
        raise ModelError(f"probe '{probe}' reads a rotation, so it has no path to follow")
    elongations = np.atleast_1d(np.asarray(displacement, dtype=float))
    states: list[Equilibrium] = []
    for k, value in enumerate(elongations):
        q, leaves = np.zeros(model.order), model.leaves.at_rest()
        if states:
            q, leaves = states[-1].q, states[-1].leaves
        if k >= 2 and elongations[k - 1] != elongations[k - 2]:
            # straight on from the last two states
            ahead = (value - elongations[k - 1]) / (elongations[k - 1] - elongations[k - 2])
            before = states[-2]
            q = q + ahead * (q - before.q)
            leaves = LeafState(
                *(now + ahead * (now - old) for now, old in zip(leaves, before.leaves, strict=True))
            )
        states.append(_equilibrium(model, {drive: float(value)}, {}, q, leaves))
    path = np.array([state.q for state in states]).reshape(-1, model.order)
    leaves = model.leaves.at_rest((len(states),))
    for k, state in enumerate(states):
        leaves.p[k], leaves.force[k] = state.leaves
    reading = model.reading(probe, path)
    return StrokePath(
        drive=drive,
        probe=probe,
        displacement=elongations,
        drive_force=np.array([state.drive_force[drive] for state in states]),
        drive_stiffness=np.array([state.drive_stiffness[drive] for state in states]),
        hinge_stress=model.hinge_stress(path, leaves),
        along=reading[:, 0],
        across=reading[:, 1],
        rotation=reading[:, 2],
        q=path,
    )


def lumped_buckling(
    stage: Stage,
    forces: Mapping[str, float],
    *,
    method: str = "wedge",
    plane: PlaneState | Literal["auto"] = "auto",
) -> float:
    r"""Return the factor of the forces of some drives at which the lumped model buckles.

    .. math:: (K + \lambda K_g)\,\phi = 0,\qquad d^T\phi = 0

    with the geometric stiffness :math:`K_g` of the linear state under the forces: the effect of the
    hinges' forces as the bodies turn, less that of the drives' own forces (the derivative by the
    load of the tangent of `flexstage.lumped.nonlinear`), and what a hinge deflects between its
    bodies. A leaf is the beam of `flexstage.lumped.leaf`, whose modes between ends at rest are
    coordinates of their own. A notch with the axial force N (positive in tension), its deformation
    :math:`v, \vartheta` and the slopes :math:`s_v, s_\vartheta` of its deflection in the frame of
    the mean rotation of its ends adds

    .. math::

        N\Bigl(v^2\!\int\! s_v^2\,dx
               + \vartheta^2\bigl(\textstyle\int\! s_\vartheta^2\,dx - \tfrac l4\bigr)\Bigr),

    and has two coordinates of its own: a full wave between ends at rest, and what its sway at the
    load of Euler's column differs by from that at rest.

    Parameters
    ----------
    stage : Stage
        The stage.
    forces : Mapping
        Force by drive [N]; these drives keep their length while the stage buckles, all others are
        removed.
    method : str
        Method of hinge stiffness, one of `flexstage.hinges.compliance.METHODS`.
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by the width of each notch against its neck.

    Returns
    -------
    float
        The smallest positive factor [1]; infinite where the stage does not buckle.

    Raises
    ------
    ModelError
        A drive does not exist, every body is fixed, or the stage is a mechanism.

    Notes
    -----
    Validity: bifurcation from a straight path, in the plane; bodies are rigid, and the force of a
    drive turns with the body that it reacts on. Leaves are Euler's columns, with fillets within
    0.02 % of beam elements, bars between two notches within 3 % of plane finite elements. The
    factors of guides and pivots with leaves are within 2 % of those of the plane model in plane
    stress, and within 2.5 % in plane strain (gantry 38, linked parallelogram 12). Between notches,
    and above about a quarter of Young's modulus over the largest stress, that model has no factor
    to compare with: it finds wrinkles of the surface of a neck, whose factor decreases as the mesh
    is refined. A factor does not hold where it stands for a mean stress of leaves above a tenth of
    Young's modulus: a leaf in tension buckles as a beam that shears, at 5/6 of the shear modulus.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> round(lumped_buckling(design("linked-parallelogram"), {"x": 5.0}), 1)
    12.1
    """
    model = _model(stage, method, plane)
    n, rest = model.order, np.zeros(model.order)
    stiffness, load, turning = model.tangent(rest), np.zeros(n), np.zeros((n, n))
    locked = np.zeros((len(forces), n))
    for k, (name, force) in enumerate(forces.items()):
        _, locked[k], hessian = model.elongation(name, rest)
        load += force * locked[k]
        turning += force * hessian
    q = solve_stiffness(stiffness, load[:, None], np.zeros((n, 0)))[0][:, 0]
    _, rates = model.notches.rates(rest)
    notches = rates @ model.notches.spread
    spring = (model.stiffness @ (notches @ q)[..., None])[..., 0]
    leaf_step = model.leaf_step(rest, model.leaves.at_rest())
    ends, leaf = leaf_step.rates @ model.leaf_ends.spread, leaf_step.after(q)
    # what notches and leaves deflect by themselves stands behind the coordinates of the bodies
    parts = _notch_parts(stage, model, notches, spring, method, plane)
    parts += _leaf_parts(model, ends, leaf.force)
    size = n + sum(len(part.elastic) for part in parts)
    elastic, geometric = np.zeros((2, size, size))
    elastic[:n, :n] = stiffness
    geometric[:n, :n] = model.geometric_stiffness(rest, spring, leaf.force) - turning
    at = n
    for part in parts:
        local_columns = np.arange(at, at + len(part.elastic))
        used = np.concatenate((part.columns, local_columns))
        geometric[np.ix_(used, used)] += part.geometric
        elastic[np.ix_(local_columns, local_columns)] = part.elastic
        at += local_columns.size
    free = np.asarray(block_diag(null_space(locked), np.eye(size - n)), dtype=np.float64)
    inverse = eigh(-free.T @ geometric @ free, free.T @ elastic @ free, eigvals_only=True)[-1]
    return 1.0 / float(inverse) if inverse > 0.0 else math.inf


class _LocalPart(NamedTuple):
    """What a hinge deflects by itself, between bodies at rest."""

    columns: NDArray[np.intp]  # coordinates of its bodies
    elastic: Array  # of its own
    geometric: Array  # of the coordinates of its bodies, then its own


def _notch_parts(
    stage: Stage,
    model: NonlinearMechanism,
    deformation: Array,
    spring: Array,
    method: str,
    plane: PlaneState | Literal["auto"],
) -> list[_LocalPart]:
    """Return the full wave and the sway of each notch, and the effect of its axial force."""
    parts = []
    springs = [
        s
        for s, h in zip(
            hinge_springs(stage, method=method, plane=plane), model.mechanism.hinges, strict=True
        )
        if h.leaf is None
    ]
    for h, notch in enumerate(springs):
        modulus, _ = plane_moduli(
            stage.material.youngs_modulus, stage.material.poissons_ratio, notch.plane
        )
        slopes, bending = _deflection_integrals(notch.hinge.profile)
        columns = np.flatnonzero(deformation[h, 1:].any(axis=0))
        shape = np.asarray(block_diag(deformation[h, 1:, columns].T, np.eye(2)))
        parts.append(
            _LocalPart(
                columns,
                np.diag(modulus * stage.thickness * bending),
                spring[h, 0] * shape.T @ slopes @ shape,
            )
        )
    return parts


def _leaf_parts(model: NonlinearMechanism, deformation: Array, force: Array) -> list[_LocalPart]:
    """Return the modes of each leaf between ends at rest, and the effect of its forces."""
    still = model.leaves.at_rest().p
    parts = []
    for rates, curvature, moved in zip(
        model.leaves.rates(still), model.leaves.curvature(still, force), deformation, strict=True
    ):
        columns = np.flatnonzero(moved.any(axis=0))
        modes = null_space(rates)
        # where its ends move, a leaf has the deflection of least energy
        shape = np.concatenate((np.linalg.pinv(rates) @ moved[:, columns], modes), axis=1)
        parts.append(_LocalPart(columns, np.eye(modes.shape[1]), -shape.T @ curvature @ shape))
    return parts


# of one stage for all of its axes
@lru_cache(maxsize=8)
def _model(stage: Stage, method: str, plane: PlaneState | Literal["auto"]) -> NonlinearMechanism:
    return nonlinear(mechanism(stage, method=method, plane=plane))


# a uniform column is right at once, one with fillets of a seventh of its length 5e-5 too strong
_WAVE_STEPS = 3


# a stage has dozens of hinges but a handful of profiles
@lru_cache(maxsize=1024)
def _deflection_integrals(profile: Profile) -> tuple[Array, Array]:
    """Return integrals of the products of four slopes over a notch, and the bending of two.

    The slopes are those of a deformation v across, of one in rotation, of a full wave and of a sway
    between ends at rest, in the frame of the mean rotation of the ends; of the rotation,
    what two rigid ends have is taken off. A notch bends where it is thin: a shape is given by its
    moment, and that of the wave is its own deflection, as in a column that buckles. Shape (4, 4),
    and (2,): the integrals of h^3/12 s'^2.
    """
    x, depth, angle, ds = profile.samples()
    dx, half = np.cos(angle) * ds, 0.5 * profile.length
    h = profile.neck_thickness + profile.sides * depth
    flexibility = 1.0 / h**3

    def up_to(values: Array) -> Array:
        """Integral from the neck to each point."""
        return cumulative_trapezoid(np.r_[values[0], values], np.r_[0.0, x], initial=0.0)[1:]

    def across(moment: Array) -> tuple[Array, Array]:
        """Curvature and slope of a unit displacement of ends that stay parallel."""
        curvature = moment * flexibility
        size = 2.0 * np.sum(x * curvature * dx)
        return -curvature / size, (np.sum(curvature * dx) - up_to(curvature)) / size

    total = np.sum(flexibility * dx)
    turn = 0.5 * up_to(flexibility) / total
    shear_curvature, shear_slope = across(x)
    sway_curvature, sway_slope = across(np.sin(0.5 * np.pi * x / half))
    wave_slope, wave_curvature = np.sin(np.pi * x / half), np.zeros_like(x)
    for _ in range(_WAVE_STEPS):
        moment = -up_to(wave_slope)
        moment -= np.sum(moment * flexibility * dx) / total
        wave_curvature = moment / np.abs(moment).max() * flexibility / total
        wave_slope = up_to(wave_curvature)
    slopes = np.array([shear_slope, turn, wave_slope, sway_slope - shear_slope])
    # over both halves, the product of an even and an odd slope vanishes
    even = np.array([True, False, False, True])
    products = 2.0 * (slopes * dx) @ slopes.T * (even == even[:, None])
    products[1, 1] -= 0.25 * profile.length
    curved = np.array([wave_curvature, sway_curvature - shear_curvature])
    return products, 2.0 * np.sum(h**3 / 12.0 * curved**2 * dx, axis=1)
