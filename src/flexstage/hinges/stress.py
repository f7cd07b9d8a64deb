"""The largest stress in a notch from the forces in its neck, and the rotation that it allows."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.errors import HingeError
from flexstage.hinges.compliance import compliance
from flexstage.hinges.concentration import concentration
from flexstage.hinges.hinge_spring import PlaneState, plane_state
from flexstage.hinges.profile import Array, Profile
from flexstage.material import Material


@dataclass(frozen=True, slots=True, kw_only=True)
class LargestRotation:
    """How far a hinge turns under a pure moment before its surface reaches a limit."""

    before_yield: float | None
    """Rotation at the yield strength [rad]; None where the material has none."""
    before_fatigue: float | None
    """Amplitude of rotation at the fatigue limit [rad]; None where the material has none."""
    source: str
    """Where the stress concentration factor comes from."""


def stress_rows(
    profile: Profile,
    width: float,
    poisson: float,
    plane: PlaneState | Literal["auto"] = "auto",
) -> Array:
    r"""Return the rows that map the forces in the neck to the stress at its critical points.

    The stress along the surface is :math:`K_N N/(bt) \mp 6 K_M M(x)/(bt^2)` on the left and on the
    right, with :math:`M(x) = M - Vx`. A free surface in plane strain also carries
    :math:`\nu\sigma` along the width, so its equivalent stress (R. von Mises 1913) is
    :math:`\sqrt{1-\nu+\nu^2}` of that.

    Parameters
    ----------
    profile : Profile
        The notch.
    width : float
        Width b of the hinge [m].
    poisson : float
        Poisson's ratio nu [1].
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by width against neck.

    Returns
    -------
    numpy.ndarray
        Signed equivalent stress at each point for (N, V, M) about the neck [1/m^2, 1/m^2, 1/m^3],
        positive in tension, shape (m, 3). Two points, left then right surface at the neck, for a
        smooth notch; four, those at the end in body a and then in body b, for one with a flat part.

    Raises
    ------
    HingeError
        The width is not positive.

    Notes
    -----
    Validity: as `flexstage.hinges.concentration.concentration` says for the profile. Shear alone is
    largest away from the neck of a smooth notch and has no row there: the moment about the neck
    governs in a stage, where hinges are much further apart than they are long.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> notch = RightCircular(neck_thickness=0.4e-3, radius=1e-3)
    >>> rows = stress_rows(notch, 10e-3, 0.33, "stress")
    >>> [round(float(s) / 1e6, 3) for s in rows @ [0.0, 0.0, 0.1]]
    [-403.673, 403.673]
    """
    if not width > 0.0:
        raise HingeError(f"the width of a hinge must be positive, got {width!r}")
    t = profile.neck_thickness
    state = plane_state(width, t) if plane == "auto" else plane
    factors = concentration(profile)
    equivalent = 1.0 if state == "stress" else float(np.sqrt(1.0 - poisson + poisson**2))
    half = 0.5 * profile.flat_length
    stations = (-half, half) if half > 0.0 else (0.0,)
    rows = []
    for x in stations:
        for left, axial, bending in zip((True, False), factors.axial, factors.bending, strict=True):
            per_moment = (-6.0 if left else 6.0) * bending / (width * t**2)
            rows.append((axial / (width * t), -x * per_moment, per_moment))
    return equivalent * np.array(rows)


def largest_rotation(
    profile: Profile,
    material: Material,
    width: float,
    *,
    plane: PlaneState | Literal["auto"] = "auto",
    method: str = "wedge",
) -> LargestRotation:
    """Return the rotation under a pure moment at which a hinge yields, and at which it fatigues.

    Parameters
    ----------
    profile : Profile
        The notch.
    material : Material
        What it is cut from.
    width : float
        Width b of the hinge [m].
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by width against neck.
    method : str
        How the compliance is found, one of `flexstage.hinges.compliance.METHODS`.

    Returns
    -------
    LargestRotation
        The two rotations.

    Raises
    ------
    HingeError
        The method is unknown, or the width is not positive.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> from flexstage.material import material
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=1e-3)
    >>> limit = largest_rotation(notch, material("Al 7075-T6"), 10e-3)
    >>> round(1e3 * limit.before_yield, 2)
    23.68
    """
    e, nu = material.youngs_modulus, material.poissons_ratio
    spring = compliance(profile, e, nu, width, method=method, plane=plane)
    rows = stress_rows(profile, width, nu, plane)
    per_rotation = float(np.max(np.abs(rows[:, 2])) / spring.matrix[2, 2])

    def allowed(limit: float | None) -> float | None:
        return None if limit is None else limit / per_rotation

    return LargestRotation(
        before_yield=allowed(material.yield_strength),
        before_fatigue=allowed(material.fatigue_limit),
        source=concentration(profile).source,
    )
