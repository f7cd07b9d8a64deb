r"""Equilibrium with finite rotations, the path of a probe over the stroke, linear buckling.

Rigid bodies buckle as links between springs; a notch or leaf adds the effect of its own deflection
on its axial force, by the shapes of a beam of its height.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag, eigh, null_space

from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.hinges.deflection import deflection_integrals
from flexstage.hinges.hinge_spring import PlaneState, plane_moduli
from flexstage.lumped.assemble import hinge_springs
from flexstage.lumped.finite_rotation import NonlinearMechanism, nonlinear
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
    drive_force: dict[str, float]
    """Force of each drive whose displacement is imposed, positive if it pushes [N]."""
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
    start: Array | None = None,
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
    start : numpy.ndarray, optional
        Coordinates to start from, shape (n,).

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
    names = list(displacements)
    targets = np.array([displacements[name] for name in names], dtype=float)
    pushes = dict(forces or {})
    n, m = model.order, len(names)
    q = q_start = np.zeros(n) if start is None else np.array(start, dtype=float)
    multiplier = np.zeros(m)
    previous = np.inf
    for iteration in range(1, _ITERATIONS + 1):
        stiffness = model.tangent(q)
        residual = model.force(q)
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
        right = np.concatenate((-residual * scale, gap / weight))
        try:
            solution = np.linalg.solve(bordered, right)
        except np.linalg.LinAlgError as error:
            raise ModelError(
                "the mechanism can move without deforming a hinge, so it has no equilibrium: "
                "fix a body or add a hinge"
            ) from error
        step = solution[:n] * scale
        q = q + step
        multiplier = solution[n:] / weight
        size = float(np.linalg.norm(solution[:n]) ** 2)
        if not np.isfinite(size):
            break
        # where nothing is left in the end, what is rounding goes by where it began
        whole_size = max(float(np.linalg.norm(x / scale) ** 2) for x in (q, q_start))
        # converged, or down to what rounding leaves
        if size <= _TOLERANCE * whole_size or previous / 4.0 <= size <= _ROUNDING * whole_size:
            return Equilibrium(
                q=q,
                drive_force=dict(zip(names, multiplier.tolist(), strict=True)),
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
        Position and rotation along the way, straightness, parasitic rotation.

    Raises
    ------
    ConvergenceError
        A step is too long.
    ModelError
        The drive or the probe does not exist, or the probe reads a rotation.

    Notes
    -----
    Validity: bodies are rigid; the arcs of lever and link mechanisms are exact, the sideways motion
    that comes from bending of platforms is not in the model.
    """
    if isinstance(stage, Stage):
        stage = mechanism(stage)
    model = nonlinear(stage) if isinstance(stage, Mechanism) else stage
    if any(p.name == probe and p.direction is None for p in model.mechanism.probes):
        raise ModelError(f"probe '{probe}' reads a rotation, so it has no path to follow")
    elongations = np.atleast_1d(np.asarray(displacement, dtype=float))
    path = np.zeros((elongations.size, model.order))
    force = np.zeros(elongations.size)
    start = None
    for k, value in enumerate(elongations):
        if k >= 2 and elongations[k - 1] != elongations[k - 2]:
            # straight on from the last two states
            ahead = (value - elongations[k - 1]) / (elongations[k - 1] - elongations[k - 2])
            start = path[k - 1] + ahead * (path[k - 1] - path[k - 2])
        state = equilibrium(model, {drive: float(value)}, start=start)
        path[k], force[k] = state.q, state.drive_force[drive]
        start = path[k]
    reading = model.reading(probe, path)
    return StrokePath(
        drive=drive,
        probe=probe,
        displacement=elongations,
        drive_force=force,
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
    springs' forces as the bodies turn, less that of the drives' own forces (the derivative by the
    load of the tangent of `flexstage.lumped.nonlinear`), and of each notch with its axial force N
    (positive in tension), its deformation :math:`v, \vartheta` and the slopes :math:`s_v,
    s_\vartheta` of its deflection in the frame of the mean rotation of its ends

    .. math::

        N\Bigl(v^2\!\int\! s_v^2\,dx
               + \vartheta^2\bigl(\textstyle\int\! s_\vartheta^2\,dx - \tfrac l4\bigr)\Bigr),

    which for a leaf is the consistent geometric stiffness of a beam (J. S. Przemieniecki, Theory of
    Matrix Structural Analysis, 1968, eq. 15.8): 6/5 N v^2/l - N l theta^2/6. Two deflections of
    each notch between ends at rest are coordinates of their own, a full wave, by which a leaf
    buckles alone, and what its sway at the load of Euler's column differs by from that at rest.

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
    drive turns with the body that it reacts on. Leaves are within 0.1 % of Euler's columns, with
    fillets of beam elements, bars between two notches within 3 % of plane finite elements. The
    factors of guides and pivots with leaves are within 2 % of those of the plane model (gantry 39,
    linked parallelogram 12). Between notches, and above about a quarter of Young's modulus over the
    largest stress, that model has no factor to compare with: it finds wrinkles of the surface of a
    neck, whose factor decreases as the mesh is refined.

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
    q, _ = solve_stiffness(stiffness, load[:, None], np.zeros((n, 0)))
    deformation = model.deformation_rates(rest)
    spring = (model.stiffness @ (deformation @ q))[..., 0]
    # the two own deflections of each notch stand behind the coordinates of the bodies
    count = model.hinges.count
    elastic, geometric = np.zeros((2, n + 2 * count, n + 2 * count))
    elastic[:n, :n] = stiffness
    geometric[:n, :n] = model.geometric_stiffness(rest, spring) - turning
    for h, hinge_spring in enumerate(hinge_springs(stage, method=method, plane=plane)):
        profile, axial, at = hinge_spring.hinge.profile, spring[h, 0], n + 2 * h
        modulus, _ = plane_moduli(
            stage.material.youngs_modulus, stage.material.poissons_ratio, hinge_spring.plane
        )
        slopes, bending = deflection_integrals(profile)
        shape = np.zeros((4, n + 2 * count))
        shape[:2, :n] = deformation[h, 1:]
        shape[2, at] = shape[3, at + 1] = 1.0
        # only the coordinates of its two bodies, and its own, take part
        used = np.flatnonzero(shape.any(axis=0))
        part = shape[:, used]
        geometric[np.ix_(used, used)] += axial * part.T @ slopes @ part
        elastic[at, at], elastic[at + 1, at + 1] = modulus * stage.thickness * bending
    free = np.asarray(block_diag(null_space(locked), np.eye(2 * count)), dtype=np.float64)
    inverse = eigh(-free.T @ geometric @ free, free.T @ elastic @ free, eigvals_only=True)[-1]
    return 1.0 / float(inverse) if inverse > 0.0 else math.inf


# of one stage for all of its axes
@lru_cache(maxsize=8)
def _model(stage: Stage, method: str, plane: PlaneState | Literal["auto"]) -> NonlinearMechanism:
    return nonlinear(mechanism(stage, method=method, plane=plane))
