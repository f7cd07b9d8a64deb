"""Static equilibrium with finite rotations, and the path of a probe over the whole stroke."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import ConvergenceError, ModelError
from flexstage.lumped.finite_rotation import NonlinearMechanism, nonlinear
from flexstage.lumped.rigid_bodies import Mechanism, mechanism
from flexstage.short_repr import short_repr
from flexstage.stage.model import Stage

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
    """Newton steps that were taken."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StrokePath:
    """Motion of a probe's point over the stroke of a drive."""

    drive: str
    """Name of the drive."""
    probe: str
    """Name of the probe."""
    displacement: Array
    """Elongation of the drive [m], shape (k,)."""
    drive_force: Array
    """Force that it takes [N], shape (k,)."""
    along: Array
    """Displacement along the probe's direction [m], shape (k,)."""
    across: Array
    """Displacement to the left of it [m], shape (k,)."""
    rotation: Array
    """Rotation of the probed body [rad], shape (k,)."""
    q: Array
    """Coordinates, shape (k, n)."""

    __repr__ = short_repr

    @property
    def deviation(self) -> Array:
        """Distance of the path from its least-squares straight line [m], shape (k,)."""
        design = np.stack((np.ones_like(self.along), self.along), axis=1)
        fit, *_ = np.linalg.lstsq(design, self.across, rcond=None)
        return (self.across - design @ fit) / np.hypot(1.0, fit[1])

    @property
    def straightness(self) -> float:
        """Largest less smallest deviation from the least-squares straight line [m]."""
        return float(np.ptp(self.deviation))

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
        Newton's method does not converge; smaller steps from a known state mend it.
    ModelError
        A drive does not exist, or the mechanism can move freely.
    """
    names = list(displacements)
    wanted = np.array([displacements[name] for name in names], dtype=float)
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
            gap[k] = wanted[k] - g
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
        whole = np.block(
            [[stiffness * np.outer(scale, scale), -scaled], [scaled.T, np.zeros((m, m))]]
        )
        right = np.concatenate((-residual * scale, gap / weight))
        try:
            solution = np.linalg.solve(whole, right)
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
        The drive or the probe does not exist, the probe reads a rotation, or a hinge bends over a
        length, as a leaf does.

    Notes
    -----
    Validity: bodies are rigid; the arcs of lever and link mechanisms are exact, the sideways motion
    that comes from bending of platforms is not in the model.
    """
    if isinstance(stage, Stage):
        stage = mechanism(stage)
    model = nonlinear(stage) if isinstance(stage, Mechanism) else stage
    if any(p.name == probe and p.direction is None for p in model.mechanism.probes):
        raise ModelError(f"probe '{probe}' reads a rotation, whose point has no path to follow")
    bent = [hinge.name for hinge in model.mechanism.hinges if hinge.flat_length > 0.0]
    if bent:
        # its chord is 0.6 d^2/L shorter than it is long, which one spring at its middle has not
        more = f" and {len(bent) - 4} more" if len(bent) > 4 else ""
        raise ModelError(
            f"{', '.join(bent[:4])}{more} bend over a length and shorten as they do, which a hinge "
            "of the lumped model does not: take the path of plane finite elements "
            "(`flexstage analyse --model plane --stroke`)"
        )
    wanted = np.atleast_1d(np.asarray(displacement, dtype=float))
    path = np.zeros((wanted.size, model.order))
    force = np.zeros(wanted.size)
    start = None
    for k, value in enumerate(wanted):
        if k >= 2 and wanted[k - 1] != wanted[k - 2]:
            # straight on from the last two states
            ahead = (value - wanted[k - 1]) / (wanted[k - 1] - wanted[k - 2])
            start = path[k - 1] + ahead * (path[k - 1] - path[k - 2])
        state = equilibrium(model, {drive: float(value)}, start=start)
        path[k], force[k] = state.q, state.drive_force[drive]
        start = path[k]
    reading = model.reading(probe, path)
    return StrokePath(
        drive=drive,
        probe=probe,
        displacement=wanted,
        drive_force=force,
        along=reading[:, 0],
        across=reading[:, 1],
        rotation=reading[:, 2],
        q=path,
    )
