"""Stress in a notch: concentration by its contour, largest stress, largest rotation."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.base.errors import HingeError
from flexstage.hinges.compliance import compliance
from flexstage.hinges.hinge_spring import PlaneState, plane_state
from flexstage.hinges.profile import Array, Profile
from flexstage.quantities.material import Material

_NEUBER = "H. Neuber, Kerbspannungslehre (1937), deep hyperbolic notch on both sides"
_FILLET = "plane finite elements of corner-filleted notches, z = fillet radius / neck thickness"

# 1 + (1 + a z)/(b + c z + d z^2) within 0.4 % of finite elements at z = 0.1, 0.2, 0.4, 0.7, 1, 2
# and 4; the fillet is as deep as its radius, so z is the only proportion.
_FILLET_AXIAL = {2: (0.7618, 0.8811, 1.933, 3.4233), 1: (472.4367, 5.0863, 313.1227, 2211.0274)}
_FILLET_BENDING = {
    2: (19.0124, 1.1844, 13.6875, 121.9678),
    1: (2.9577, 0.9192, 3.9327, 14.1116),
}
# The straight side of a one-sided notch is bent where the axial force enters; log(z) to factor.
_STRAIGHT = (
    np.log([0.1, 0.2, 0.4, 0.7, 1.0, 2.0, 4.0]),
    np.array([1.157, 1.251, 1.327, 1.316, 1.282, 1.289, 1.313]),
)

# Series in x of Neuber's two factors; their closed forms cancel like 1/x.
_SMALL = 0.02
_AXIAL_SERIES = (1.0, 2 / 3, -7 / 45, 64 / 945, -512 / 14175, 10048 / 467775)
_BENDING_SERIES = (1.0, 2 / 5, -17 / 175, 128 / 2625, -31168 / 1010625, 1437952 / 65690625)


@dataclass(frozen=True, slots=True, kw_only=True)
class Concentration:
    """Stress concentration factors of a notch, on nominal beam stress at its neck."""

    axial: tuple[float, float]
    """Factor on N/(b t), at the left surface (the cut one of a one-sided notch) and the right [1].
    """
    bending: tuple[float, float]
    """Factor on 6 M/(b t^2), left and right [1]."""
    source: str
    """Source of the factors."""
    validity: str
    """Range of validity."""


def concentration(profile: Profile) -> Concentration:
    r"""Return the stress concentration factors of a notch.

    A smooth notch is taken as Neuber's deep hyperbolic one of the same neck radius
    :math:`\rho`, with :math:`x = t/2\rho`:

    .. math::

        K_N = \frac{2(x+1)\sqrt x}{(x+1)\arctan\sqrt x + \sqrt x},\qquad
        K_M = \frac{4x\sqrt x}{3\left(\sqrt x + (x-1)\arctan\sqrt x\right)}.

    One cut from one side only is half as curved in thickness, and its middle line has the radius
    :math:`2\rho`, which adds the curved-bar terms :math:`\pm t/10\rho` (axial) and
    :math:`\pm t/6\rho` (bending), the first order of H. Golovin's solution (1881; Timoshenko and
    Goodier, Theory of Elasticity, 3rd ed., sections 29 and 33). Higher orders are from plane finite
    elements of one-sided circular notches.

    The fillets of a corner-filleted notch have factors from plane finite elements of that very
    shape. The charts of a stepped flat bar (W. D. Pilkey, Peterson's Stress Concentration Factors,
    2nd ed., 1997, charts 3.1 and 3.7) are up to 9 % higher in tension and 4 % lower in bending.

    Parameters
    ----------
    profile : Profile
        The notch.

    Returns
    -------
    Concentration
        The factors, their source and validity.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> factors = concentration(RightCircular(neck_thickness=0.4e-3, radius=1e-3))
    >>> round(factors.axial[0], 4), round(factors.bending[0], 4)
    (1.1276, 1.0765)
    """
    if profile.flat_length > 0.0 or profile.neck_radius <= 0.0:
        return _stepped(profile)
    t, rho = profile.neck_thickness, profile.neck_radius
    if rho == float("inf"):
        return Concentration(
            axial=(1.0, 1.0),
            bending=(1.0, 1.0),
            source="beam stress: the contour is straight at the neck",
            validity="the neck itself; the stress can be larger where the contour rises steeply",
        )
    if not profile.one_sided:
        axial, bending = _neuber(0.5 * t / rho)
        return Concentration(
            axial=(axial, axial),
            bending=(bending, bending),
            source=_NEUBER,
            validity="smooth notch, deep against its neck; within 1 % of plane finite elements",
        )
    axial, bending = _neuber(0.25 * t / rho)
    bend = t / rho
    more_axial = bend / 10.0 / (1.0 + 0.08 * bend)
    more_bending = bend / 6.0 / (1.0 + 0.2 * bend)
    return Concentration(
        axial=(axial + more_axial, axial - more_axial),
        bending=(bending + more_bending, bending - more_bending),
        source=_NEUBER + "; curved middle line: H. Golovin (1881)",
        validity="smooth notch on one side, neck not thicker than its radius; within 2 % there",
    )


def _neuber(x: float) -> tuple[float, float]:
    """Neuber's factors in tension and in bending, for half neck over neck radius."""
    if x < _SMALL:
        powers = x ** np.arange(len(_AXIAL_SERIES))
        return float(powers @ _AXIAL_SERIES), float(powers @ _BENDING_SERIES)
    root = np.sqrt(x)
    arc = np.arctan(root)
    axial = 2.0 * (x + 1.0) * root / ((x + 1.0) * arc + root)
    bending = 4.0 * x * root / (3.0 * (root + (x - 1.0) * arc))
    return float(axial), float(bending)


def _stepped(profile: Profile) -> Concentration:
    """Shoulders at the ends of a part of constant thickness."""
    t, radius = profile.neck_thickness, profile.neck_radius
    if radius <= 0.0:
        return Concentration(
            axial=(1.0, 1.0),
            bending=(1.0, 1.0),
            source="beam stress: elasticity gives an infinite stress in a sharp corner",
            validity=(
                "none for the corner itself: give it a fillet (corner-filleted) to evaluate it"
            ),
        )
    z = radius / t
    axial = _fillet_factor(_FILLET_AXIAL[profile.sides], z)
    bending = _fillet_factor(_FILLET_BENDING[profile.sides], z)
    straight = float(np.interp(np.log(z), *_STRAIGHT))
    return Concentration(
        axial=(axial, straight if profile.one_sided else axial),
        bending=(bending, 1.0 if profile.one_sided else bending),
        source=_FILLET,
        validity="fillet radius 0.1 to 4 necks, bodies of the height of the root; within 2 %",
    )


def _fillet_factor(fit: tuple[float, float, float, float], z: float) -> float:
    a, b, c, d = fit
    return 1.0 + (1.0 + a * z) / (b + c * z + d * z**2)


@dataclass(frozen=True, slots=True, kw_only=True)
class LargestRotation:
    """Rotation of a hinge under a pure moment at which its surface reaches a limit."""

    before_yield: float | None
    """Rotation at the yield strength [rad]; None where the material has none."""
    before_fatigue: float | None
    """Amplitude of rotation at the fatigue limit [rad]; None where the material has none."""
    source: str
    """Source of the stress concentration factor."""


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
    Validity: as `flexstage.hinges.stress.concentration` says for the profile. Shear alone is
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
    factors = concentration(profile)
    t, half = profile.neck_thickness, 0.5 * profile.flat_length
    in_stress = plane_state(width, t, plane) == "stress"
    equivalent = 1.0 if in_stress else float(np.sqrt(1.0 - poisson + poisson**2))
    rows = []
    for x in (-half, half) if half > 0.0 else (0.0,):
        for sign, axial, bending in zip((-1.0, 1.0), factors.axial, factors.bending, strict=True):
            per_moment = sign * 6.0 * bending / (width * t**2)
            rows.append((axial / (width * t), -x * per_moment, per_moment))
    return equivalent * np.array(rows)


def largest_rotation(
    profile: Profile,
    material: Material,
    width: float,
    *,
    plane: PlaneState | Literal["auto"] = "auto",
) -> LargestRotation:
    """Return the rotation under a pure moment at which a hinge yields, and at which it fatigues.

    Parameters
    ----------
    profile : Profile
        The notch.
    material : Material
        Material of the plate.
    width : float
        Width b of the hinge [m].
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by width against neck.

    Returns
    -------
    LargestRotation
        The two rotations.

    Raises
    ------
    HingeError
        The width is not positive.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> from flexstage.quantities.material import material
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=1e-3)
    >>> limit = largest_rotation(notch, material("Al 7075-T6"), 10e-3)
    >>> round(1e3 * limit.before_yield, 2)
    23.68
    """
    e, nu = material.youngs_modulus, material.poissons_ratio
    spring = compliance(profile, e, nu, width, plane=plane)
    rows = stress_rows(profile, width, nu, plane)
    per_rotation = float(np.max(np.abs(rows[:, 2])) / spring.matrix[2, 2])

    def allowed(limit: float | None) -> float | None:
        return None if limit is None else limit / per_rotation

    return LargestRotation(
        before_yield=allowed(material.yield_strength),
        before_fatigue=allowed(material.fatigue_limit),
        source=concentration(profile).source,
    )
