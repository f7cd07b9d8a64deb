"""Closed forms by N. Lobontiu and others.

They take the neck thickness t, the sizes of the notch and the width b [m], and Young's modulus E
and Poisson's ratio nu or, in plane strain, E/(1 - nu^2) [Pa] and nu/(1 - nu). Sizes are the radius
R of circles; the length l, fillets included, and radius r of fillets; the half length l and the
depth c on a side. Rotation by a moment is in rad/(N m), extension by an axial force and deflection
at the neck by a shear force there in m/N.
"""

import numpy as np


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
