"""Published closed forms of notches, and a list of them.

They take the neck thickness t, the sizes of the notch and the width b [m], and Young's modulus E
and Poisson's ratio nu or, in plane strain, E/(1 - nu^2) [Pa] and nu/(1 - nu). Sizes are the radius
R of circles; the half length l and the depth c on a side; the length l, fillets included, and the
radius r of fillets; the length l of a leaf. Rotation by a moment is in rad/(N m), extension by an
axial force and deflection at the neck by a shear force there in m/N.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.base.errors import HingeError
from flexstage.hinges.hinge_spring import PlaneState, plane_moduli, plane_state
from flexstage.hinges.profile import Profile


def paros_weisbord_rotation(
    neck_thickness: float, radius: float, modulus: float, width: float
) -> float:
    r"""Rotation of a circular notch: J. M. Paros and L. Weisbord 1965, the full form.

    .. math::

        \frac{\alpha_z}{M_z} = \frac{3}{2EbR^2}\,\frac{1}{2\beta+\beta^2}\left[
        \frac{1}{\gamma} + \frac{3+2\beta+\beta^2}{\gamma(2\beta+\beta^2)}
        + \frac{6(1+\beta)}{(2\beta+\beta^2)^{3/2}}\arctan\sqrt{\frac{2+\beta}{\beta}}\right],
        \quad \beta = \frac{t}{2R},\ \gamma = 1+\beta

    Machine Design 37 (1965) 151; here with the notch a full half circle.

    Notes
    -----
    Validity: beam theory, an exact integral of it. Against plane finite elements
    1.9 % too stiff at t/R = 0.05, 20 % at 0.8.

    Examples
    --------
    >>> round(paros_weisbord_rotation(0.5e-3, 1e-3, 71.7e9, 10e-3), 5)
    0.10441
    """
    beta = 0.5 * neck_thickness / radius
    gamma, p = 1.0 + beta, 2.0 * beta + beta**2
    arc = np.arctan(np.sqrt((2.0 + beta) / beta))
    bracket = 1.0 / gamma + (3.0 + p) / (gamma * p) + 6.0 * gamma / p**1.5 * arc
    return float(1.5 / (modulus * width * radius**2) * bracket / p)


def paros_weisbord_axial(
    neck_thickness: float, radius: float, modulus: float, width: float
) -> float:
    r"""Extension of a circular notch: J. M. Paros and L. Weisbord 1965, the full form.

    .. math::

        \frac{\Delta x}{F_x} = \frac{1}{Eb}\left[\frac{2(1+\beta)}{\sqrt{2\beta+\beta^2}}
        \arctan\sqrt{\frac{2+\beta}{\beta}} - \frac{\pi}{2}\right],
        \quad \beta = \frac{t}{2R}

    Machine Design 37 (1965) 151; here with the notch a full half circle.

    Notes
    -----
    Validity: beam theory, an exact integral of it. Against plane finite elements
    10 % too stiff at t/R = 0.05, 20 % at 0.8.
    """
    beta = 0.5 * neck_thickness / radius
    p = 2.0 * beta + beta**2
    arc = np.arctan(np.sqrt((2.0 + beta) / beta))
    return float((2.0 * (1.0 + beta) / np.sqrt(p) * arc - 0.5 * np.pi) / (modulus * width))


def paros_weisbord_shear(
    neck_thickness: float, radius: float, modulus: float, width: float
) -> float:
    r"""Shear of a circular notch about its neck, bending only: Paros and Weisbord's integral.

    .. math::

        \frac{\Delta y}{F_y} = \frac{3}{2Eb}\left[(1-\gamma^2)I_3 + 2\gamma I_2 - I_1\right],
        \quad I_n = \int_{-\pi/2}^{\pi/2}\frac{\cos\theta\,d\theta}{(\gamma-\cos\theta)^n},
        \quad \gamma = 1+\frac{t}{2R}

    J. M. Paros and L. Weisbord, Machine Design 37 (1965) 151, give the deflection of the end by a
    force there, which is this and the rotation's part :math:`R^2\alpha_z/M_z`.

    Notes
    -----
    Validity: bending of a beam, without shear deformation.
    """
    gamma = 1.0 + 0.5 * neck_thickness / radius
    s = np.sqrt(gamma**2 - 1.0)
    arc = np.arctan(np.sqrt((gamma + 1.0) / (gamma - 1.0)))
    i1 = 4.0 * gamma * arc / s - np.pi
    i2 = 4.0 * arc / s**3 + 2.0 / s**2
    i3 = 6.0 * gamma * arc / s**5 + (2.0 * gamma + 1.0 / gamma) / s**4
    return float(1.5 * (2.0 * gamma * i2 - s**2 * i3 - i1) / (modulus * width))


def paros_weisbord_simplified_rotation(
    neck_thickness: float, radius: float, modulus: float, width: float
) -> float:
    r"""Rotation of a thin circular notch: Paros and Weisbord 1965, the simplified form.

    .. math:: \frac{\alpha_z}{M_z} \approx \frac{9\pi\sqrt{R}}{2Ebt^{5/2}}

    J. M. Paros and L. Weisbord, Machine Design 37 (1965) 151.

    Notes
    -----
    Validity: t much smaller than R. Against plane finite elements 1.3 % too stiff at t/R = 0.05,
    11 % at 0.8: nearer than the full form, by chance.
    """
    return float(4.5 * np.pi * np.sqrt(radius) / (modulus * width * neck_thickness**2.5))


def paros_weisbord_simplified_axial(
    neck_thickness: float, radius: float, modulus: float, width: float
) -> float:
    r"""Extension of a thin circular notch: Paros and Weisbord 1965, the simplified form.

    .. math:: \frac{\Delta x}{F_x} \approx \frac{1}{Eb}\left[\pi\sqrt{R/t} - 2.57\right]

    J. M. Paros and L. Weisbord, Machine Design 37 (1965) 151.

    Notes
    -----
    Validity: t much smaller than R. Against plane finite elements 12 % too stiff at t/R = 0.05,
    58 % at 0.8.
    """
    return float((np.pi * np.sqrt(radius / neck_thickness) - 2.57) / (modulus * width))


def wu_zhou_rotation(neck_thickness: float, radius: float, modulus: float, width: float) -> float:
    r"""Rotation of a circular notch: Y. Wu and Z. Zhou 2002.

    .. math::

        C = \frac{12}{EbR^2}\left[\frac{2s^3(6s^2+4s+1)}{(2s+1)(4s+1)^2}
        + \frac{12s^4(2s+1)}{(4s+1)^{5/2}}\arctan\sqrt{4s+1}\right],\quad s = R/t

    Review of Scientific Instruments 73 (2002) 3101.

    Notes
    -----
    Validity: beam theory, an exact integral of it. Against plane finite elements
    1.9 % too stiff at t/R = 0.05, 20 % at 0.8.
    """
    s = radius / neck_thickness
    p = 4.0 * s + 1.0
    first = 2.0 * s**3 * (6.0 * s**2 + p) / ((2.0 * s + 1.0) * p**2)
    second = 12.0 * s**4 * (2.0 * s + 1.0) / p**2.5 * np.arctan(np.sqrt(p))
    return float(12.0 * (first + second) / (modulus * width * radius**2))


def wu_zhou_axial(neck_thickness: float, radius: float, modulus: float, width: float) -> float:
    r"""Extension of a circular notch: Y. Wu and Z. Zhou 2002.

    .. math::

        C = \frac{1}{Eb}\left[\frac{2(2s+1)}{\sqrt{4s+1}}\arctan\sqrt{4s+1}
        - \frac{\pi}{2}\right],\quad s = R/t

    Review of Scientific Instruments 73 (2002) 3101.

    Notes
    -----
    Validity: beam theory, an exact integral of it. Against plane finite elements
    10 % too stiff at t/R = 0.05, 20 % at 0.8.
    """
    p = 4.0 * radius / neck_thickness + 1.0
    arc = np.arctan(np.sqrt(p))
    return float(((p + 1.0) / np.sqrt(p) * arc - 0.5 * np.pi) / (modulus * width))


def schotborgh_rotation(
    neck_thickness: float, radius: float, modulus: float, width: float
) -> float:
    r"""Rotation of a circular notch: W. O. Schotborgh et al. 2005, a fit to finite elements.

    .. math::

        C = \left\{\frac{Ebt^2}{12}\left[-0.0089 + 1.3556\sqrt{\frac{t}{2R}}
        - 0.5227\,\frac{t}{2R}\right]\right\}^{-1}

    W. O. Schotborgh, F. G. M. Kokkeler, H. Tragter, F. J. A. M. van Houten, Precision Engineering
    29 (2005) 41.

    Notes
    -----
    Validity: t/R from 0.05 to 0.8; against plane finite elements -2.6 to +5.7 %.
    """
    root = np.sqrt(0.5 * neck_thickness / radius)
    share = -0.0089 + 1.3556 * root - 0.5227 * root**2
    return float(12.0 / (modulus * width * neck_thickness**2 * share))


def schotborgh_axial(neck_thickness: float, radius: float, modulus: float, width: float) -> float:
    r"""Extension of a circular notch: W. O. Schotborgh et al. 2005, a fit to finite elements.

    .. math::

        C = \left\{Eb\left[0.0010 + 0.4162\sqrt{\frac{t}{2R}}
        + 0.3546\,\frac{t}{2R}\right]\right\}^{-1}

    W. O. Schotborgh, F. G. M. Kokkeler, H. Tragter, F. J. A. M. van Houten, Precision Engineering
    29 (2005) 41.

    Notes
    -----
    Validity: t/R from 0.05 to 0.8; against plane finite elements -1 to +5 %.
    """
    root = np.sqrt(0.5 * neck_thickness / radius)
    return float(1.0 / (modulus * width * (0.0010 + 0.4162 * root + 0.3546 * root**2)))


def lobontiu_rotation(neck_thickness: float, radius: float, modulus: float, width: float) -> float:
    r"""Rotation of a circular notch: N. Lobontiu 2003.

    .. math::

        C = \frac{24R}{Ebt^3(2R+t)(4R+t)^3}\left[t(4R+t)(6R^2+4Rt+t^2)
        + 6R(2R+t)^2\sqrt{t(4R+t)}\arctan\sqrt{1+\frac{4R}{t}}\right]

    N. Lobontiu, Compliant Mechanisms: Design of Flexure Hinges, CRC Press 2003, section 2.2.

    Notes
    -----
    Validity: beam theory, an exact integral of it. Against plane finite elements
    1.9 % too stiff at t/R = 0.05, 20 % at 0.8.
    """
    return 12.0 * _lobontiu_inverse_cubes(neck_thickness, radius) / (modulus * width)


def lobontiu_axial(neck_thickness: float, radius: float, modulus: float, width: float) -> float:
    r"""Extension of a circular notch: N. Lobontiu 2003.

    .. math::

        C = \frac{1}{Eb}\left[\frac{2(2R+t)}{\sqrt{t(4R+t)}}\arctan\sqrt{1+\frac{4R}{t}}
        - \frac{\pi}{2}\right]

    N. Lobontiu, Compliant Mechanisms: Design of Flexure Hinges, CRC Press 2003, section 2.2.

    Notes
    -----
    Validity: beam theory, an exact integral of it. Against plane finite elements
    10 % too stiff at t/R = 0.05, 20 % at 0.8.
    """
    return _lobontiu_inverses(neck_thickness, radius) / (modulus * width)


def lobontiu_shear(
    neck_thickness: float, radius: float, modulus: float, poisson: float, width: float
) -> float:
    r"""Shear of a circular notch about its neck, with shear deformation: N. Lobontiu 2003.

    .. math::

        C_{end} = \frac{3}{4Eb(2R+t)}\left\{2(2+\pi)R + \pi t
        + \frac{8R^3(44R^2+28Rt+5t^2)}{t^2(4R+t)^2}
        + \frac{(2R+t)\sqrt{t(4R+t)}\,P - 8(2R+t)^4(t^2+4Rt-6R^2)\arctan\sqrt{1+4R/t}}
        {\sqrt{t^5(4R+t)^5}}\right\},

        P = -80R^4 + 24R^3t + 8(3+2\pi)R^2t^2 + 4(1+2\pi)Rt^3 + \pi t^4

    is the deflection of the end by a force there; about the neck it is less by :math:`R^2` times
    the rotation, and shear deformation adds :math:`\tfrac65\tfrac EG` times the extension.
    N. Lobontiu, Compliant Mechanisms: Design of Flexure Hinges, CRC Press 2003, section 2.2.

    Notes
    -----
    Validity: beam theory, an exact integral of it. Against plane finite elements
    4 to 9 % too stiff for t/R from 0.05 to 0.65.
    """
    t, r = neck_thickness, radius
    p = (
        -80.0 * r**4
        + 24.0 * r**3 * t
        + 8.0 * (3.0 + 2.0 * np.pi) * r**2 * t**2
        + 4.0 * (1.0 + 2.0 * np.pi) * r * t**3
        + np.pi * t**4
    )
    q = t * (4.0 * r + t)
    arc = np.arctan(np.sqrt(1.0 + 4.0 * r / t))
    end = (
        2.0 * (2.0 + np.pi) * r
        + np.pi * t
        + 8.0 * r**3 * (44.0 * r**2 + 28.0 * r * t + 5.0 * t**2) / q**2
        + (2.0 * r + t) * p / q**2
        - 8.0 * (2.0 * r + t) ** 4 * (t**2 + 4.0 * r * t - 6.0 * r**2) / q**2.5 * arc
    )
    bending = 0.75 * end / (2.0 * r + t) - 12.0 * r**2 * _lobontiu_inverse_cubes(t, r)
    slip = 2.4 * (1.0 + poisson) * _lobontiu_inverses(t, r)
    return float((bending + slip) / (modulus * width))


def _lobontiu_inverse_cubes(t: float, r: float) -> float:
    """Integral of 1/h^3 along a circular notch."""
    arc = np.arctan(np.sqrt(1.0 + 4.0 * r / t))
    q = t * (4.0 * r + t)
    bracket = q * (6.0 * r**2 + 4.0 * r * t + t**2)
    bracket += 6.0 * r * (2.0 * r + t) ** 2 * np.sqrt(q) * arc
    return float(2.0 * r * bracket / (q**3 * (2.0 * r + t)))


def _lobontiu_inverses(t: float, r: float) -> float:
    """Integral of 1/h along a circular notch."""
    arc = np.arctan(np.sqrt(1.0 + 4.0 * r / t))
    return float(2.0 * (2.0 * r + t) / np.sqrt(t * (4.0 * r + t)) * arc - 0.5 * np.pi)


def smith_rotation(
    neck_thickness: float, half_length: float, notch_depth: float, modulus: float, width: float
) -> float:
    r"""Rotation of an elliptical notch: S. T. Smith et al. 1997.

    .. math::

        C = \frac{3l}{2Ebc^3}\,\frac{1}{2\beta+\beta^2}\left[
        \frac{3+4\beta+2\beta^2}{(1+\beta)(2\beta+\beta^2)}
        + \frac{6(1+\beta)}{(2\beta+\beta^2)^{3/2}}\arctan\sqrt{\frac{2+\beta}{\beta}}\right],
        \quad \beta = \frac{t}{2c}

    with semi-axes l and c: S. T. Smith, V. G. Badami, J. S. Dale, Y. Xu, Review of Scientific
    Instruments 68 (1997) 1474.

    Notes
    -----
    Validity: beam theory, an exact integral of it; the longer the ellipse, the better.
    """
    beta = 0.5 * neck_thickness / notch_depth
    p = 2.0 * beta + beta**2
    arc = np.arctan(np.sqrt((2.0 + beta) / beta))
    bracket = (3.0 + 2.0 * p) / ((1.0 + beta) * p) + 6.0 * (1.0 + beta) / p**1.5 * arc
    return float(1.5 * half_length / (modulus * width * notch_depth**3) * bracket / p)


def smith_axial(
    neck_thickness: float, half_length: float, notch_depth: float, modulus: float, width: float
) -> float:
    r"""Extension of an elliptical notch: S. T. Smith et al. 1997.

    .. math::

        C = \frac{l}{Ebc}\left[\frac{2(1+\beta)}{\sqrt{2\beta+\beta^2}}
        \arctan\sqrt{\frac{2+\beta}{\beta}} - \frac{\pi}{2}\right],\quad \beta = \frac{t}{2c}

    the circular form scaled along the hinge: S. T. Smith, V. G. Badami, J. S. Dale, Y. Xu, Review
    of Scientific Instruments 68 (1997) 1474.

    Notes
    -----
    Validity: beam theory, an exact integral of it; the longer the ellipse, the better.
    """
    circle = paros_weisbord_axial(neck_thickness, notch_depth, modulus, width)
    return half_length / notch_depth * circle


def lobontiu_corner_filleted_rotation(
    neck_thickness: float, notch_length: float, fillet_radius: float, modulus: float, width: float
) -> float:
    r"""Rotation of a corner-filleted notch: N. Lobontiu et al. 2001.

    .. math::

        C = \frac{12}{Eb}\left[\frac{l-2r}{t^3} + \int_{circle}\frac{dx}{h^3}\right]

    with the integral of N. Lobontiu's circular form: N. Lobontiu, J. S. N. Paine, E. Garcia,
    M. Goldfarb, Journal of Mechanical Design 123 (2001) 346.

    Notes
    -----
    Validity: beam theory, an exact integral of it.
    """
    flat = 12.0 * (notch_length - 2.0 * fillet_radius) / (modulus * width * neck_thickness**3)
    return flat + lobontiu_rotation(neck_thickness, fillet_radius, modulus, width)


def lobontiu_corner_filleted_axial(
    neck_thickness: float, notch_length: float, fillet_radius: float, modulus: float, width: float
) -> float:
    r"""Extension of a corner-filleted notch: N. Lobontiu et al. 2001.

    .. math::

        C = \frac{1}{Eb}\left[\frac{l-2r}{t} + \frac{2(2r+t)}{\sqrt{t(4r+t)}}
        \arctan\sqrt{1+\frac{4r}{t}} - \frac{\pi}{2}\right]

    N. Lobontiu, J. S. N. Paine, E. Garcia, M. Goldfarb, Journal of Mechanical Design 123 (2001)
    346.

    Notes
    -----
    Validity: beam theory, an exact integral of it.
    """
    flat = (notch_length - 2.0 * fillet_radius) / (modulus * width * neck_thickness)
    return flat + lobontiu_axial(neck_thickness, fillet_radius, modulus, width)


def parabolic_rotation(
    neck_thickness: float, half_length: float, notch_depth: float, modulus: float, width: float
) -> float:
    r"""Rotation of a parabolic notch: the integral of N. Lobontiu et al. 2002.

    .. math::

        C = \frac{3l}{Ebt^3}\left[\frac{5+3k}{(1+k)^2}
        + \frac{3\arctan\sqrt k}{\sqrt k}\right],\quad k = \frac{2c}{t}

    N. Lobontiu, J. S. N. Paine, E. O'Malley, M. Samuelson, Precision Engineering 26 (2002) 183;
    written here in k.

    Notes
    -----
    Validity: beam theory, an exact integral of it.
    """
    k = 2.0 * notch_depth / neck_thickness
    bracket = (5.0 + 3.0 * k) / (1.0 + k) ** 2 + 3.0 * np.arctan(np.sqrt(k)) / np.sqrt(k)
    return float(3.0 * half_length * bracket / (modulus * width * neck_thickness**3))


def parabolic_axial(
    neck_thickness: float, half_length: float, notch_depth: float, modulus: float, width: float
) -> float:
    r"""Extension of a parabolic notch: the integral of N. Lobontiu et al. 2002.

    .. math:: C = \frac{2l}{Ebt}\,\frac{\arctan\sqrt k}{\sqrt k},\quad k = \frac{2c}{t}

    N. Lobontiu, J. S. N. Paine, E. O'Malley, M. Samuelson, Precision Engineering 26 (2002) 183;
    written here in k.

    Notes
    -----
    Validity: beam theory, an exact integral of it.
    """
    root = np.sqrt(2.0 * notch_depth / neck_thickness)
    return float(2.0 * half_length * np.arctan(root) / (root * modulus * width * neck_thickness))


def hyperbolic_rotation(
    neck_thickness: float, half_length: float, notch_depth: float, modulus: float, width: float
) -> float:
    r"""Rotation of a hyperbolic notch: the integral of N. Lobontiu et al. 2002.

    .. math:: C = \frac{24l}{Ebt^2(2c+t)}

    N. Lobontiu, J. S. N. Paine, E. O'Malley, M. Samuelson, Precision Engineering 26 (2002) 183.

    Notes
    -----
    Validity: beam theory, an exact integral of it.
    """
    t = neck_thickness
    return 24.0 * half_length / (modulus * width * t**2 * (2.0 * notch_depth + t))


def hyperbolic_axial(
    neck_thickness: float, half_length: float, notch_depth: float, modulus: float, width: float
) -> float:
    r"""Extension of a hyperbolic notch: the integral of N. Lobontiu et al. 2002.

    .. math::

        C = \frac{l}{Eb\sqrt{c(c+t)}}\,\operatorname{arsinh}\frac{2\sqrt{c(c+t)}}{t}

    N. Lobontiu, J. S. N. Paine, E. O'Malley, M. Samuelson, Precision Engineering 26 (2002) 183;
    written here with one logarithm.

    Notes
    -----
    Validity: beam theory, an exact integral of it.
    """
    q = np.sqrt(notch_depth * (notch_depth + neck_thickness))
    return float(half_length * np.arcsinh(2.0 * q / neck_thickness) / (q * modulus * width))


def odonnell_leaf_rotation(
    neck_thickness: float, leaf_length: float, modulus: float, width: float
) -> float:
    r"""Rotation of a leaf between half planes: W. J. O'Donnell 1960.

    .. math:: C = \frac{12l}{Ebt^3} + 2\,\frac{16.67}{\pi Ebt^2}

    The first part is Euler's beam, the second the two roots: W. J. O'Donnell, Journal of Applied
    Mechanics 27 (1960) 461.

    Notes
    -----
    Validity: a step much deeper than the leaf is thick. The linear stress over the joint is an
    upper bound: plane finite elements give 6 % less for the roots.
    """
    t = neck_thickness
    return (12.0 * leaf_length / t + 2.0 * 16.67 / np.pi) / (modulus * width * t**2)


_BEAM = "slender beam: too stiff where t/R is not small"


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedForm:
    """A published formula for one compliance of one profile cut from both sides."""

    name: str
    """Name in tables."""
    kind: str
    """Kind of profile."""
    quantity: str
    """``axial``, ``shear`` or ``rotation``."""
    function: Callable[..., float]
    """Takes the `arguments`, then modulus, Poisson's ratio if the form has one, and width."""
    arguments: tuple[str, ...]
    """Fields of the profile that it takes, in order."""
    equals: str | None = None
    """The method whose quadrature it is the exact integral of; None for a fit or a limit."""
    takes_poisson: bool = False
    """True if Poisson's ratio is one of its arguments."""
    validity: str = _BEAM
    """Range of validity."""


_CIRCLE = ("circular", ("neck_thickness", "radius"))
_HALF = ("neck_thickness", "half_length", "notch_depth")
_ELLIPSE, _PARABOLA, _HYPERBOLA = (
    (kind, _HALF) for kind in ("elliptical", "parabolic", "hyperbolic")
)
_FILLET = ("corner-filleted", ("neck_thickness", "notch_length", "fillet_radius"))
_LEAF = ("leaf", ("neck_thickness", "leaf_length"))
_PAROS, _WU, _LOBONTIU = "Paros and Weisbord 1965", "Wu and Zhou 2002", "Lobontiu 2003"
_THIN, _SCHOTBORGH = f"{_PAROS}, simplified", "Schotborgh et al. 2005"
_OF_2001, _OF_2002 = "Lobontiu et al. 2001", "Lobontiu et al. 2002"

#: Every closed form.
CLOSED_FORMS: tuple[ClosedForm, ...] = (
    *(
        ClosedForm(
            name=name,
            kind=kind,
            quantity=quantity,
            function=function,
            arguments=arguments,
            equals="timoshenko" if function is lobontiu_shear else "euler-bernoulli",
            takes_poisson=function is lobontiu_shear,
        )
        for name, (kind, arguments), quantity, function in (
            (_PAROS, _CIRCLE, "rotation", paros_weisbord_rotation),
            (_PAROS, _CIRCLE, "axial", paros_weisbord_axial),
            (_PAROS, _CIRCLE, "shear", paros_weisbord_shear),
            (_WU, _CIRCLE, "rotation", wu_zhou_rotation),
            (_WU, _CIRCLE, "axial", wu_zhou_axial),
            (_LOBONTIU, _CIRCLE, "rotation", lobontiu_rotation),
            (_LOBONTIU, _CIRCLE, "axial", lobontiu_axial),
            (_LOBONTIU, _CIRCLE, "shear", lobontiu_shear),
            ("Smith et al. 1997", _ELLIPSE, "rotation", smith_rotation),
            ("Smith et al. 1997", _ELLIPSE, "axial", smith_axial),
            (_OF_2001, _FILLET, "rotation", lobontiu_corner_filleted_rotation),
            (_OF_2001, _FILLET, "axial", lobontiu_corner_filleted_axial),
            (_OF_2002, _PARABOLA, "rotation", parabolic_rotation),
            (_OF_2002, _PARABOLA, "axial", parabolic_axial),
            (_OF_2002, _HYPERBOLA, "rotation", hyperbolic_rotation),
            (_OF_2002, _HYPERBOLA, "axial", hyperbolic_axial),
        )
    ),
    *(
        ClosedForm(
            name=name,
            kind=kind,
            quantity=quantity,
            function=function,
            arguments=arguments,
            validity=validity,
        )
        for name, (kind, arguments), quantity, function, validity in (
            (
                *(_THIN, _CIRCLE, "rotation", paros_weisbord_simplified_rotation),
                "thin neck: -1.3 % at t/R = 0.05, -11 % at 0.8",
            ),
            (
                *(_THIN, _CIRCLE, "axial", paros_weisbord_simplified_axial),
                "thin neck: -12 % at t/R = 0.05, -58 % at 0.8",
            ),
            (
                *(_SCHOTBORGH, _CIRCLE, "rotation", schotborgh_rotation),
                "fit, t/R from 0.05 to 0.8: -2.6 to +5.7 %",
            ),
            (
                *(_SCHOTBORGH, _CIRCLE, "axial", schotborgh_axial),
                "fit, t/R from 0.05 to 0.8: -1 to +5 %",
            ),
            (
                *("O'Donnell 1960", _LEAF, "rotation", odonnell_leaf_rotation),
                "step much deeper than the leaf is thick: upper bound",
            ),
        )
    ),
)


def closed_forms(profile: Profile) -> tuple[ClosedForm, ...]:
    """Return the closed forms that hold for a profile.

    Parameters
    ----------
    profile : Profile
        The notch.

    Returns
    -------
    tuple of ClosedForm
        None for a notch cut from one side only, for which none is published here.

    Examples
    --------
    >>> from flexstage.hinges import Leaf
    >>> leaf = Leaf(neck_thickness=0.3e-3, leaf_length=5e-3, notch_depth=2e-3)
    >>> [form.name for form in closed_forms(leaf)]
    ["O'Donnell 1960"]
    """
    if profile.one_sided:
        return ()
    return tuple(form for form in CLOSED_FORMS if form.kind == profile.kind)


def closed_form_compliance(
    form: ClosedForm,
    profile: Profile,
    modulus: float,
    poisson: float,
    width: float,
    *,
    plane: PlaneState | Literal["auto"] = "auto",
) -> float:
    """Evaluate a closed form for a profile.

    Parameters
    ----------
    form : ClosedForm
        One of `CLOSED_FORMS`.
    profile : Profile
        The notch.
    modulus : float
        Young's modulus E [Pa].
    poisson : float
        Poisson's ratio nu [1].
    width : float
        Width b of the hinge [m].
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by width against neck.

    Returns
    -------
    float
        The compliance [m/N, or rad/(N m) for the rotation].

    Raises
    ------
    HingeError
        The form belongs to another profile.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=1e-3)
    >>> form = closed_forms(notch)[0]
    >>> round(closed_form_compliance(form, notch, 71.7e9, 0.33, 10e-3, plane="stress"), 5)
    0.10441
    """
    if form not in closed_forms(profile):
        cut = "one-sided" if profile.one_sided else "two-sided"
        raise HingeError(
            f"'{form.name}' ({form.quantity}) holds for a two-sided {form.kind} notch, "
            f"not for a {cut} {profile.kind} one"
        )
    state = plane_state(width, profile.neck_thickness, plane)
    e, nu = plane_moduli(modulus, poisson, state)
    sizes = [getattr(profile, name) for name in form.arguments]
    extra = [nu] if form.takes_poisson else []
    return form.function(*sizes, e, *extra, width)
