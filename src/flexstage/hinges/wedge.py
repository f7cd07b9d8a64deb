r"""Strain energy of a tapered strip, from the exact solution of the elastic wedge, and its ends.

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
plane body do not depend on it), so it is omitted here. Slices of neighbouring angles are joined so
that the energy agrees with the two-term asymptotic expansion of plane elasticity in the slope h' of
the thickness h,

.. math::

    2EbU' = \frac{12M^2}{h^3} + \frac{12V^2}{5h} - \frac{12MVh'}{5h^2} + \frac{18M^2h'^2}{5h^3}
          + \frac{N^2}{h}\Bigl(1 + \frac{h'^2}{6}\Bigr),

which holds for any smooth profile, and stays finite where the contour becomes perpendicular.

*Ends.* All are parts of the compliance about the neck, times E b, for one end. Forces at the end
are built from those at the neck: the shear V and the moment about the middle of the section there.

*Overlap.* The last slice of the wedge solution is an arc, and bulges into the body behind the root,
where the straight strip of the body is counted again. The bulge is a circular segment; from one
side only there is also the triangle between its leaning chord and the root. The strip's energy in
the triangle is exact for a gentle slope :math:`T = \tan(\alpha/2)`:

.. math::

    \frac{T}{2}\Bigl(N^2 + 2.4(1+\nu)V^2\Bigr) + \frac{6T}{H^2}M^2 + \frac{2T}{H}MN
    + \frac{4.8T^2}{H}MV,

with a term in :math:`T^3` for the shear and for the coupling, found together with the two factors
of the segment from plane finite elements of circular notches.

*Step.* A strip that ends at a sharp step was solved by plane finite elements for steps from 0.05 to
16 times its thickness; the polynomials below in :math:`p = 1 - t/H` reproduce them to 0.02. Their
logarithms are exact: the fan of a half plane (two steps) or of a quarter plane (one). For a deep
step on both sides the moment gives :math:`5.0 M/(E b t^2)` of rotation; W. J. O'Donnell (J. Appl.
Mech. 27 (1960) 461) has 16.67/pi = 5.3, from a linear stress over the joint: an upper bound.
"""

import numpy as np

from flexstage.hinges.profile import Array, Profile

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


# Of the strip's compliance in the segment these parts come off, one number each for every t/R.
SEGMENT_AXIAL = 0.31
SEGMENT_SHEAR = 0.64
# The triangle's terms in T**3: coupling of axial force and moment, and shear.
LEAN_COUPLING = 0.58
LEAN_SHEAR = -2.48

_HALF_PLANE = 2.0 / np.pi
_QUARTER_PLANE = 0.5 * (1.0 / (np.pi / 4.0 + 0.5) + 1.0 / (np.pi / 4.0 - 0.5))
# Powers 1 to 5 of p = 1 - t/H, next to the logarithms in the axial and the shear term.
_STEP = {
    2: {
        "NN": (-0.6097, 0.6532, -0.6794, 0.507, -0.1577),
        "MM": (1.0878, 23.9026, -38.2932, 25.7855, -7.4974),
        "NM": (0.0, 0.0, 0.0, 0.0, 0.0),
        "MV": (-1.2736, 2.1041, 1.573, -2.2359, 0.7088),
        "VV": (-0.6368, -0.4448, 1.0029, -0.4878, 0.0941),
    },
    1: {
        "NN": (-2.0815, -0.1317, -4.7762, 4.2079, -1.3176),
        "MM": (1.8367, 43.6009, -79.046, 59.2044, -17.9982),
        "NM": (-0.3324, -6.4653, 19.2996, -15.1238, 4.4838),
        "MV": (-1.3703, 6.4065, 3.5167, -9.5049, 3.9894),
        "VV": (-2.1497, -1.2667, 6.0658, -4.6254, 0.985),
    },
}


def end_of_wedge(profile: Profile, nu: float, side: float) -> Array:
    """Return the contribution of the end of the wedge: Poisson's part, less the overlap.

    About the neck, times E b, shape (3, 3). `side` is 1 for the end in body b, -1 for that in body
    a; `nu` is that of the plane problem.
    """
    height = profile.root_height
    offset = 0.5 * profile.depth if profile.one_sided else 0.0
    force, shear, moment = _forces(0.5 * profile.length, offset, side)
    c = 1.2 * nu / height * _pair(moment, shear)
    _, _, angle, _ = profile.pieces()[-1](np.array([1.0]))
    half = 0.5 * float(angle[0]) if profile.one_sided else float(angle[0])
    if half < 1e-9:
        return c
    chord = 1.0 / np.cos(half) if profile.one_sided else 1.0
    sin, cos = np.sin(half), np.cos(half)
    segment = chord**2 * (half - sin * cos) / (4.0 * sin**2)
    slip = 2.4 * (1.0 + nu)
    axial, across = SEGMENT_AXIAL * segment, SEGMENT_SHEAR * segment * slip
    if profile.one_sided:
        lean = np.tan(half)
        axial += 0.5 * lean
        across += 0.5 * slip * lean + LEAN_SHEAR * lean**3
        c -= 6.0 * lean / height**2 * np.outer(moment, moment)
        c -= (lean - LEAN_COUPLING * lean**3) / height * _pair(force, moment)
        c -= 2.4 * lean**2 / height * _pair(moment, shear)
    return c - axial * np.outer(force, force) - across * np.outer(shear, shear)


def sharp_step(profile: Profile, side: float) -> Array:
    """Return what a sharp step at the root adds to the compliance of a notch.

    About the neck, times E b, shape (3, 3); the step is at the end of the part of constant
    thickness. `side` is 1 for the end in body b, -1 for that in body a.
    """
    t = profile.neck_thickness
    ratio = t / profile.root_height
    powers = (1.0 - ratio) ** np.arange(1.0, 6.0)
    k = {name: float(powers @ row) for name, row in _STEP[profile.sides].items()}
    fan = (_QUARTER_PLANE if profile.one_sided else _HALF_PLANE) * float(np.log(1.0 / ratio))
    force, shear, moment = _forces(0.5 * profile.length, 0.0, side)
    return (
        (k["NN"] + fan) * np.outer(force, force)
        + (k["VV"] + fan) * np.outer(shear, shear)
        + k["MM"] / t**2 * np.outer(moment, moment)
        + k["NM"] / t * _pair(force, moment)
        + k["MV"] / t * _pair(moment, shear)
    )


def _forces(x: float, offset: float, side: float) -> tuple[Array, Array, Array]:
    """Axial force, shear (towards the thicker end) and moment at a section, from the neck's."""
    return (
        np.array([1.0, 0.0, 0.0]),
        np.array([0.0, -side, 0.0]),
        np.array([offset, -side * x, 1.0]),
    )


def _pair(a: Array, b: Array) -> Array:
    return np.outer(a, b) + np.outer(b, a)
