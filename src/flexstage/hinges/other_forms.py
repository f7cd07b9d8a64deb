"""Closed forms by Wu and Zhou, Schotborgh and others, Smith and others, and O'Donnell.

They take the neck thickness t, the sizes of the notch (radius R of circles; half length l and depth
c on a side; length l of a leaf) and the width b [m], and Young's modulus E or, in plane strain,
E/(1 - nu^2) [Pa]. Rotation by a moment is in rad/(N m), extension by an axial force in m/N.
"""

import numpy as np

from flexstage.hinges.paros_weisbord import paros_weisbord_axial


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
