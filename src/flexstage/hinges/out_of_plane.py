"""The compliance of a notch out of its plane: along the normal, and in the two tilts.

It tells how errors of manufacture share themselves out among the hinges of a plate; motion in the
plane does not need it.
"""

import math

import numpy as np

from flexstage.arrays import Array
from flexstage.hinges.profile import Profile

_TERMS = np.arange(1, 40, 2)


def torsion_constant(one: Array, other: Array) -> Array:
    r"""Return the torsion constant of rectangles [m^4].

    :math:`J = \tfrac13 a^3 b\,[1 - \tfrac{192}{\pi^5}\tfrac ab \sum_{n\ \mathrm{odd}} n^{-5}
    \tanh(n\pi b/2a)]`, a the shorter side and b the longer one (S. P. Timoshenko, J. N. Goodier,
    Theory of Elasticity, 3rd ed. 1970, section 109, eq. 160).

    The sides are in m, of any shape that is broadcast.

    Examples
    --------
    >>> print(f"{torsion_constant(np.array(1.0), np.array(2.0)):.4f}")  # 0.229 of b a^3
    0.4574
    """
    a, b = np.minimum(one, other)[..., None], np.maximum(one, other)[..., None]
    series = np.sum(np.tanh(_TERMS * math.pi * b / (2.0 * a)) / _TERMS**5, axis=-1)
    a, b = a[..., 0], b[..., 0]
    return a**3 * b / 3.0 * (1.0 - 192.0 / math.pi**5 * a / b * series)


def out_of_plane_compliance(
    profile: Profile, modulus: float, poisson: float, width: float
) -> Array:
    r"""Return the compliance of a notch out of its plane, about its neck.

    Slices of a beam along the hinge, h high and b wide, with J of `torsion_constant`:

    .. math::

        C_w = \int \frac{12 x^2}{E h b^3} + \frac{6}{5 G h b}\,dx,\qquad
        C_\tau = \int \frac{dx}{G J},\qquad C_\beta = \int \frac{12\,dx}{E h b^3}

    (T. Koseki et al., Advanced Robotics 16 (2002) 251, has the same six compliances of a circular
    notch). The two halves of a notch are alike, so force and moments at the neck do not couple.

    Parameters
    ----------
    profile : Profile
        The notch.
    modulus : float
        Young's modulus E [Pa].
    poisson : float
        Poisson's ratio nu [1].
    width : float
        Width b of the hinge, the thickness of the plate [m].

    Returns
    -------
    numpy.ndarray
        Motion along the normal [m/N], rotation about the hinge's own line and about the direction
        across it [rad/(N m)], shape (3,).

    Notes
    -----
    Validity: small deformation of a beam whose ends are rigid. A notch is short against its width,
    which a beam does not know, and bodies bend and twist: by finite elements in space the platform
    of a parallelogram is half as stiff along the normal as its hinges alone would have it.

    Examples
    --------
    >>> from flexstage.hinges import Leaf
    >>> leaf = Leaf(neck_thickness=0.5e-3, leaf_length=12e-3, notch_depth=1e-3)
    >>> c = out_of_plane_compliance(leaf, 71.7e9, 0.33, 10e-3)
    >>> print(f"{1.0 / c[2]:.0f} N m")  # E h b^3/(12 L)
    249 N m
    """
    x, depth, angle, ds = profile.samples()
    dx = 2.0 * np.cos(angle) * ds
    h = profile.neck_thickness + profile.sides * depth
    shear = modulus / (2.0 * (1.0 + poisson))
    bending = 12.0 / (modulus * h * width**3)
    return np.array(
        [
            np.sum((x**2 * bending + 1.2 / (shear * h * width)) * dx),
            np.sum(dx / (shear * torsion_constant(h, np.full_like(h, width)))),
            np.sum(bending * dx),
        ]
    )
