r"""Linear buckling of the lumped model: by what factor the load of a stroke may grow.

Rigid bodies buckle as links between springs; a notch or leaf adds what its own deflection does to
the axial force that it carries, by the shapes that a beam of its height takes.
"""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Literal

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import block_diag, eigh, null_space

from flexstage.arrays import Array
from flexstage.hinges import Profile
from flexstage.hinges.hinge_spring import PlaneState, plane_moduli
from flexstage.lumped.assemble import hinge_springs
from flexstage.lumped.finite_rotation import NonlinearMechanism, nonlinear
from flexstage.lumped.rigid_bodies import mechanism
from flexstage.stage.model import Stage
from flexstage.system.linalg import solve_stiffness


def lumped_buckling(
    stage: Stage,
    forces: Mapping[str, float],
    *,
    method: str = "wedge",
    plane: PlaneState | Literal["auto"] = "auto",
) -> float:
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
        How hinge stiffness is found, one of `flexstage.hinges.compliance.METHODS`.
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
    drive turns with the body that it stands on. Leaves are within 0.1 % of Euler's columns, with
    fillets of beam elements, bars between two notches within 3 % of plane finite elements. The
    factors of guides and pivots with leaves are within 2 % of those of the plane model (gantry 39,
    linked parallelogram 12). Between notches, and above about a quarter of Young's modulus over the
    largest stress, that model has no factor to compare with: what it finds are wrinkles of the
    surface of a neck, whose factor falls as the mesh is made finer.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> round(lumped_buckling(design("linked-parallelogram"), {"x": 5.0}), 1)
    12.1
    """
    model = _model(stage, method, plane)
    n, rest = model.order, np.zeros(model.order)
    stiffness, load, turning = model.tangent(rest), np.zeros(n), np.zeros((n, n))
    held = np.zeros((len(forces), n))
    for k, (name, force) in enumerate(forces.items()):
        _, held[k], hessian = model.elongation(name, rest)
        load += force * held[k]
        turning += force * hessian
    q, _ = solve_stiffness(stiffness, load[:, None], np.zeros((n, 0)))
    deformation = model.deformation_rates(rest)
    spring = (model.stiffness @ (deformation @ q))[..., 0]
    # the two own deflections of each notch stand behind the coordinates of the bodies
    count = model.hinges.count
    elastic, geometric = np.zeros((2, n + 2 * count, n + 2 * count))
    elastic[:n, :n] = stiffness
    geometric[:n, :n] = model.geometric_stiffness(rest, spring) - turning
    for h, found in enumerate(hinge_springs(stage, method=method, plane=plane)):
        profile, axial, at = found.hinge.profile, spring[h, 0], n + 2 * h
        modulus, _ = plane_moduli(
            stage.material.youngs_modulus, stage.material.poissons_ratio, found.plane
        )
        slopes, bending = _deflections(profile)
        shape = np.zeros((4, n + 2 * count))
        shape[:2, :n] = deformation[h, 1:]
        shape[2, at] = shape[3, at + 1] = 1.0
        # only the coordinates of its two bodies, and its own, take part
        taken = np.flatnonzero(shape.any(axis=0))
        part = shape[:, taken]
        geometric[np.ix_(taken, taken)] += axial * part.T @ slopes @ part
        elastic[at, at], elastic[at + 1, at + 1] = modulus * stage.thickness * bending
    free = np.asarray(block_diag(null_space(held), np.eye(2 * count)), dtype=np.float64)
    inverse = eigh(-free.T @ geometric @ free, free.T @ elastic @ free, eigvals_only=True)[-1]
    return 1.0 / float(inverse) if inverse > 0.0 else math.inf


# of one stage for all of its axes
@lru_cache(maxsize=8)
def _model(stage: Stage, method: str, plane: PlaneState | Literal["auto"]) -> NonlinearMechanism:
    return nonlinear(mechanism(stage, method=method, plane=plane))


# a uniform column is right at once, one with fillets of a seventh of its length 5e-5 too strong
_WAVE_STEPS = 3


# a stage has dozens of hinges but a handful of profiles
@lru_cache(maxsize=1024)
def _deflections(profile: Profile) -> tuple[Array, Array]:
    """Integrals of the products of four slopes over a notch, and the bending of the last two.

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

    whole = np.sum(flexibility * dx)
    turn = 0.5 * up_to(flexibility) / whole
    shear_curvature, shear_slope = across(x)
    sway_curvature, sway_slope = across(np.sin(0.5 * np.pi * x / half))
    wave_slope, wave_curvature = np.sin(np.pi * x / half), np.zeros_like(x)
    for _ in range(_WAVE_STEPS):
        moment = -up_to(wave_slope)
        moment -= np.sum(moment * flexibility * dx) / whole
        wave_curvature = moment / np.abs(moment).max() * flexibility / whole
        wave_slope = up_to(wave_curvature)
    slopes = np.array([shear_slope, turn, wave_slope, sway_slope - shear_slope])
    # over both halves, the product of an even and an odd slope vanishes
    even = np.array([True, False, False, True])
    products = 2.0 * (slopes * dx) @ slopes.T * (even == even[:, None])
    products[1, 1] -= 0.25 * profile.length
    curved = np.array([wave_curvature, sway_curvature - shear_curvature])
    return products, 2.0 * np.sum(h**3 / 12.0 * curved**2 * dx, axis=1)
