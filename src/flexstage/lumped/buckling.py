r"""Linear buckling of the lumped model: by what factor the load of a stroke may grow.

Rigid bodies buckle as links between springs; a notch or leaf adds what its own deflection does to
the axial force that it carries, by the shapes that a beam of its height takes.
"""

import math
from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import block_diag, eigh, null_space

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.hinges import Profile
from flexstage.hinges.hinge_spring import plane_moduli
from flexstage.lumped.assemble import hinge_springs
from flexstage.lumped.finite_rotation import nonlinear
from flexstage.lumped.rigid_bodies import mechanism
from flexstage.stage.model import Stage


def lumped_buckling(stage: Stage, forces: Mapping[str, float]) -> float:
    r"""Return the factor of the forces of some drives at which the lumped model buckles.

    .. math:: (K + \lambda K_g)\,\phi = 0,\qquad d^T\phi = 0

    with the geometric stiffness :math:`K_g` of the linear state under the forces: what the springs'
    forces add as the bodies turn, less that of the drives' own forces (the derivative by the load
    of the tangent of `flexstage.lumped.nonlinear`), and of each notch with its axial force N
    (positive in tension), its deformation :math:`v, \vartheta` and the slopes
    :math:`s_v, s_\vartheta` of its deflection in the frame of the mean rotation of its ends

    .. math::

        N\Bigl(v^2\!\int\! s_v^2\,dx
               + \vartheta^2\bigl(\textstyle\int\! s_\vartheta^2\,dx - \tfrac l4\bigr)\Bigr),

    which for a leaf is the consistent geometric stiffness of a beam (J. S. Przemieniecki, Theory of
    Matrix Structural Analysis, 1968, eq. 15.8): 6/5 N v^2/l - N l theta^2/6. Two deflections of
    each notch between ends at rest, a full wave and its antisymmetric sister, are coordinates of
    their own, so that a leaf may buckle alone.

    Parameters
    ----------
    stage : Stage
        The stage.
    forces : Mapping
        Force by drive [N]; these drives keep their length while the stage buckles, all others are
        removed.

    Returns
    -------
    float
        The smallest positive factor [1]; infinite where the stage does not buckle.

    Raises
    ------
    ModelError
        A drive does not exist, or every body is fixed.

    Notes
    -----
    Validity: bifurcation from a straight path, in the plane; bodies are rigid. Leaves within 0.1 %
    of Euler's columns. Where bodies bend, the factor is too large: see `docs/explanation` and the
    buckling factor of the plane model.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> round(lumped_buckling(design("parallelogram"), {"x": 10.0}), 1)
    0.0
    """
    model = nonlinear(mechanism(stage))
    n, rest = model.order, np.zeros(model.order)
    stiffness, load, turning = model.tangent(rest), np.zeros(n), np.zeros((n, n))
    held = np.zeros((len(forces), n))
    for k, (name, force) in enumerate(forces.items()):
        _, held[k], hessian = model.elongation(name, rest)
        load += force * held[k]
        turning += force * hessian
    try:
        q = np.linalg.solve(stiffness, load)
    except np.linalg.LinAlgError as error:
        raise ModelError(
            "the mechanism can move without deforming a hinge, so it has no state to buckle from: "
            "fix a body or add a hinge"
        ) from error
    deformation = model.deformation_rates(rest)
    spring = (model.stiffness @ (deformation @ q)[..., None])[..., 0]
    geometric = model.geometric_stiffness(rest, spring) - turning

    # the two own deflections of each notch stand behind the coordinates of the bodies
    count = model.hinges.count
    elastic = block_diag(stiffness, np.zeros((2 * count, 2 * count)))
    geometric = block_diag(geometric, np.zeros((2 * count, 2 * count)))
    for h, found in enumerate(hinge_springs(stage)):
        profile, axial, at = found.hinge.profile, spring[h, 0], n + 2 * h
        modulus, _ = plane_moduli(
            stage.material.youngs_modulus, stage.material.poissons_ratio, found.plane
        )
        slopes, bending = _deflections(profile)
        shape = np.zeros((4, n + 2 * count))
        shape[:2, :n] = deformation[h, 1:]
        shape[2, at] = shape[3, at + 1] = 1.0
        take = np.flatnonzero(shape.any(axis=0))
        part = shape[:, take]
        geometric[np.ix_(take, take)] += axial * part.T @ slopes @ part
        elastic[at, at], elastic[at + 1, at + 1] = modulus * stage.thickness * bending
    free = block_diag(null_space(held), np.eye(2 * count))
    inverse = eigh(-free.T @ geometric @ free, free.T @ elastic @ free, eigvals_only=True)
    return 1.0 / float(inverse[-1]) if inverse[-1] > 0.0 else math.inf


# a stage has dozens of hinges but a handful of profiles
@lru_cache(maxsize=1024)
def _deflections(profile: Profile) -> tuple[Array, Array]:
    """Integrals of the products of four slopes over a notch, and the bending of the last two.

    The slopes are those of a deformation v across, of one in rotation, of an even and of an odd
    deflection between ends at rest, in the frame of the mean rotation of the ends; of the rotation,
    what two rigid ends have is taken off. Shape (4, 4), and (2,): the integrals of h^3/12 s'^2.
    """
    x, depth, angle, ds = profile.samples()
    dx, half = np.cos(angle) * ds, 0.5 * profile.length
    h = profile.neck_thickness + profile.sides * depth
    flexibility = 1.0 / h**3

    def up_to(values: Array) -> Array:
        """Integral from the neck to each point."""
        return cumulative_trapezoid(np.r_[values[0], values], np.r_[0.0, x], initial=0.0)[1:]

    shear, turn = up_to(x * flexibility), up_to(flexibility)
    wave = np.pi * x / half
    # (even, odd) slopes: integrals over both halves vanish between one and the other
    across = (np.sum(x * flexibility * dx) - shear) / (2.0 * np.sum(x**2 * flexibility * dx))
    rotation = 0.5 * turn / np.sum(flexibility * dx)
    odd, even = np.sin(wave), np.cos(wave) + np.cos(2.0 * wave)
    slopes = np.zeros((4, 4))
    for i, one in ((0, across), (3, even)):
        for j, other in ((0, across), (3, even)):
            slopes[i, j] = 2.0 * np.sum(one * other * dx)
    for i, one in ((1, rotation), (2, odd)):
        for j, other in ((1, rotation), (2, odd)):
            slopes[i, j] = 2.0 * np.sum(one * other * dx)
    slopes[1, 1] -= 0.25 * profile.length
    curved = np.array([np.cos(wave), np.sin(wave) + 2.0 * np.sin(2.0 * wave)]) * np.pi / half
    return slopes, 2.0 * np.sum(h**3 / 12.0 * curved**2 * dx, axis=1)
