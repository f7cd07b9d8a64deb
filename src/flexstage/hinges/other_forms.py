"""Closed forms of the other notches: elliptical, corner-filleted, parabolic, hyperbolic, leaf.

They take the neck thickness t, the sizes of the notch and the width b [m], and Young's modulus E
or, in plane strain, E/(1 - nu^2) [Pa]. Sizes are the half length l and the depth c on a side; the
length l, fillets included, and the radius r of fillets; the length l of a leaf. Rotation by a
moment is in rad/(N m), extension by an axial force in m/N.
"""

import numpy as np

from flexstage.hinges.circular_forms import (
    lobontiu_axial,
    lobontiu_rotation,
    paros_weisbord_axial,
)


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
