"""Closed forms of circular notches by J. M. Paros and L. Weisbord.

They take the neck thickness t, the radius R of the circles and the width b [m], and Young's modulus
E or, in plane strain, E/(1 - nu^2) [Pa]. Rotation by a moment is in rad/(N m), extension by an
axial force and deflection at the neck by a shear force there in m/N.
"""

import numpy as np


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
