r"""Strain energy of a tapered strip, from the exact solution of the elastic wedge.

Beam theory puts the whole height of a notch to work at once. Stress needs length to spread, so a
notch is softer than its beam integral: by 2 to 20 % in rotation and 10 to 20 % axially for circular
notches. Here each element of the notch is taken as a slice of the wedge with the local opening
angle, for which plane elasticity is solved exactly (J. H. Michell, Proc. London Math. Soc. 32
(1900) 35; C. E. Inglis, Trans. Inst. Naval Arch. 64 (1922) 253; Timoshenko and Goodier, Theory of
Elasticity, 3rd ed., sections 38 and 39).

For half angle :math:`\alpha` a wedge under axial force N, shear force V and moment M about its apex
has

.. math::

    \sigma_r^N = \frac{N\cos\theta}{r(\alpha + \sin 2\alpha/2)},\quad
    \sigma_r^V = \frac{V\sin\theta}{r(\alpha - \sin 2\alpha/2)},\quad
    \sigma_r^M = \frac{2M\sin 2\theta}{r^2 D},\quad
    \tau^M = \frac{M(\cos 2\theta - \cos 2\alpha)}{r^2 D},\quad
    D = \sin 2\alpha - 2\alpha\cos 2\alpha

and the energy per length of contour follows by integration over the arc. Poisson's ratio enters
the energy of a traction-loaded strip only through its ends (the stresses of a simply connected
plane body do not depend on it), so it is left out here. Slices of neighbouring angles are joined so
that the energy agrees with the two-term asymptotic expansion of plane elasticity in the slope h' of
the thickness h,

.. math::

    2EbU' = \frac{12M^2}{h^3} + \frac{12V^2}{5h} - \frac{12MVh'}{5h^2} + \frac{18M^2h'^2}{5h^3}
          + \frac{N^2}{h}\Bigl(1 + \frac{h'^2}{6}\Bigr),

which holds for any smooth profile, and stays finite where the contour becomes perpendicular.
"""

import numpy as np

from flexstage.hinges.profile import Array

# Series of the three functions below in the half angle; the closed forms cancel like angle**-4.
_SMALL = 0.2
_MM = (
    12.0,
    42 / 5,
    -349 / 70,
    12773 / 10500,
    -0.14605636982065553,
    0.014263980437551866,
)
_MV = (
    -24 / 5,
    1124 / 175,
    -1851 / 875,
    0.37337637600494743,
    -0.035750310747453605,
    0.0030445349344533018,
)
_VV = (
    12 / 5,
    -276 / 175,
    1341 / 1750,
    -3659 / 20625,
    0.024202034632034632,
    -0.0018776890003420616,
)


def densities(half_angle: Array) -> tuple[Array, Array, Array, Array]:
    r"""Return the coefficients of the energy of a tapered strip, per length of contour.

    .. math:: 2EbU' = nn\,N^2/h + mm\,M^2/h^3 + mv\,MV/h^2 + vv\,V^2/h

    with M the moment about the middle of the section and V positive if it makes M grow towards the
    thicker end.

    The half angle between the surfaces is 0 to pi/2 [rad]; returns nn, mm, mv, vv [1].

    Examples
    --------
    >>> nn, mm, mv, vv = densities(np.array([0.0]))
    >>> float(nn[0]), float(mm[0]), float(vv[0])
    (1.0, 12.0, 2.4)
    """
    a = np.asarray(half_angle, dtype=np.float64)
    small = a < _SMALL
    a2 = np.where(small, a, 0.0) ** 2
    series = [np.polynomial.polynomial.polyval(a2, c) for c in (_MM, _MV, _VV)]
    series[1] = series[1] * np.where(small, a, 0.0)

    w = np.where(small, 1.0, a)
    sin1, cos1, sin2, cos2, sin4 = np.sin(w), np.cos(w), np.sin(2 * w), np.cos(2 * w), np.sin(4 * w)
    d = sin2 - 2 * w * cos2
    n = w - sin2 / 2
    sigma = (4 * w - sin4) / d**2
    tau = (w - 0.75 * sin4 + 2 * w * cos2**2) / d**2
    cross = (2 * sin1 - 2 / 3 * np.sin(3 * w)) / (d * n)
    # the arc through the surface points of a section of height 1 has this radius
    r = 0.5 / sin1
    apex = r * cos1
    moment = (sigma + 2 * tau) / r**3
    mm = moment + tau / r**3
    mv = -2 * apex * moment + 2 * cross / r**2 - apex * tau / r**3
    vv = apex**2 * moment - 2 * cross * apex / r**2 + 1 / (n * r)
    nn = np.where(a == 0.0, 1.0, 2 * sin1 / (w + sin2 / 2))
    axial = np.where(small, 2 * np.sinc(a / np.pi) / (1 + np.sinc(2 * a / np.pi)), nn)
    return (
        axial,
        np.where(small, series[0], mm),
        np.where(small, series[1], mv),
        np.where(small, series[2], vv),
    )
