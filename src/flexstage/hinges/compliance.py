"""The compliance of a notch about its neck: in its plane, and out of it.

The axes are those of `flexstage.hinges.hinge_spring`. The compliance out of the plane serves for
the effect of manufacturing errors on the hinges of a plate; motion in the plane does not need it.
"""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import HingeError
from flexstage.hinges.hinge_spring import (
    ROOT_REACH,
    HingeCompliance,
    PlaneState,
    plane_moduli,
    plane_state,
    strip_compliance,
)
from flexstage.hinges.profile import Profile, increments
from flexstage.hinges.wedge import densities, end_of_wedge, sharp_step

#: Methods that integrate along the contour: smooth in every dimension, and done in microseconds.
QUADRATURES: tuple[str, ...] = ("euler-bernoulli", "timoshenko", "wedge")
METHODS: tuple[str, ...] = (*QUADRATURES, "finite-element")

# The thinnest neck, against the length or the depth of the notch.
SMALLEST_NECK = 1e-6

# Energy of a moment on a half plane, the wedge of half angle pi/2.
_FAN = float(densities(np.array([0.5 * np.pi]))[1][0])

# How much wider than the root the part of a body that works with it can be.
ROOT_SPREAD = 3.0


def compliance(
    profile: Profile,
    modulus: float,
    poisson: float,
    width: float,
    *,
    method: str = "wedge",
    plane: PlaneState | Literal["auto"] = "auto",
    root_widths: tuple[float, float] | None = None,
    bodies: tuple[tuple[float, float], tuple[float, float]] | None = None,
    root_reaches: tuple[float, float] = (ROOT_REACH, ROOT_REACH),
) -> HingeCompliance:
    r"""Return the compliance of a notch about its neck.

    ``euler-bernoulli`` integrates :math:`M^2/EI + N^2/EA`; ``timoshenko`` adds
    :math:`6V^2/5GA`; ``wedge`` takes each slice as part of the elastic wedge of its local angle
    (see `flexstage.hinges.wedge`), which corrects for stress that needs length to spread. These
    are quadratures along the contour; ``finite-element`` meshes the notch and condenses it (see
    `flexstage.hinges.finite_element`). With `root_widths` the parts of the two bodies next to the
    notch are added.

    Parameters
    ----------
    profile : Profile
        The notch.
    modulus : float
        Young's modulus E [Pa].
    poisson : float
        Poisson's ratio nu [1].
    width : float
        Width b of the hinge [m].
    method : str
        One of `METHODS`.
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by width against neck.
    root_widths : tuple of float, optional
        Width of body a and of body b behind the root [m]; without it bodies are rigid from there.
    bodies : tuple of tuple, optional
        Young's modulus [Pa], infinite where rigid, and Poisson's ratio of each of them; those of
        the notch where not given.
    root_reaches : tuple of float
        How far the roots reach into the two bodies, in heights of the root [1]; bodies are rigid
        beyond.

    Returns
    -------
    HingeCompliance
        The spring.

    Raises
    ------
    HingeError
        The method is unknown, a value is not positive, the proportions are extreme, or
        ``finite-element`` is to have bodies of another material.

    Notes
    -----
    Validity: small deformation; neck to radius 0.05 to 0.8. Against plane-stress finite elements of
    all profiles, cut from both sides or one, ``wedge`` is within 0.7 % in rotation (1.3 % for a V),
    1.5 % axially and 2 % in shear; ``timoshenko`` is 2 to 20 % too stiff in rotation and 10 to 30 %
    axially, growing with t/R, and more for a leaf, whose sharp steps it does not include.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=1e-3)
    >>> spring = compliance(notch, 71.7e9, 0.33, 10e-3)
    >>> round(float(1.0 / spring.matrix[2, 2]), 2)
    9.2
    """
    if method not in METHODS:
        raise HingeError(f"unknown method '{method}': expected one of {', '.join(METHODS)}")
    if not (modulus > 0.0 and width > 0.0):
        raise HingeError(f"modulus and width must be positive, got {modulus!r} and {width!r}")
    state = plane_state(width, profile.neck_thickness, plane)
    e, nu = plane_moduli(modulus, poisson, state)
    if method == "finite-element":
        from flexstage.hinges.finite_element import condensed_compliance

        if bodies is not None:
            raise HingeError(
                "the method 'finite-element' has bodies of the hinge's own material: choose the "
                "method 'wedge' where bodies are rigid or of another material"
            )
        return condensed_compliance(
            profile, modulus, poisson, width, state, root_widths, reach=root_reaches
        )
    require_sizes(profile)
    of_bodies = bodies or ((modulus, poisson),) * 2
    with np.errstate(all="ignore"):
        soft = [math.isfinite(body_modulus) for body_modulus, _ in of_bodies]
        c = _notch(profile, nu, method, soft) / (e * width)
    require_sizes(profile, sound=bool(np.all(np.isfinite(c)) and np.all(np.diag(c) > 0.0)))
    if root_widths is not None:
        for side, root_width, reach, elastic in zip(
            (-1.0, 1.0), root_widths, root_reaches, of_bodies, strict=True
        ):
            body_modulus, body_poisson = plane_moduli(*elastic, state)
            c += _root(profile, body_poisson, root_width, reach, side) / (body_modulus * width)
    c = 0.5 * (c + c.T)
    return HingeCompliance(matrix=c, method=method, plane=state)


def require_sizes(profile: Profile, of: str = "", *, sound: bool = True) -> None:
    """Refuse a notch with extreme proportions; where not `sound`, any."""
    # the quadrature is exact to 1e-11 down to this neck; absurd sizes overflow, and are refused too
    if profile.neck_thickness < SMALLEST_NECK * max(profile.length, profile.depth) or not sound:
        raise HingeError(
            f"the proportions of this {profile.kind} notch{of} are too extreme to compute: neck "
            f"{profile.neck_thickness!r} m, length {profile.length!r} m, depth {profile.depth!r} m"
        )


def _notch(profile: Profile, nu: float, method: str, soft: Sequence[bool]) -> Array:
    """Compliance of the notch itself, times E b, with bodies a and b `soft` or rigid."""
    x, depth, angle, ds = profile.samples()
    h = profile.neck_thickness + profile.sides * depth
    offset = 0.5 * depth if profile.one_sided else np.zeros_like(depth)
    zero, one = np.zeros_like(h), np.ones_like(h)
    tilt, coupling = zero, zero
    if method != "wedge":
        nn, mm, mv = one, 12.0 * one, zero
        vv = (0.0 if method == "euler-bernoulli" else 2.4 * (1.0 + nu)) * one
        weight = ds * np.cos(angle)
    elif profile.one_sided:
        tilt = 0.5 * angle
        nn, mm, mv, vv = densities(tilt)
        # A slice stands on the straight side further out than on the contour, by h tan(tilt), so
        # its section leans, and it is wider on one side than on the other: a curved bar, whose
        # energy couples moment and axial force.
        lean = h * np.tan(tilt)
        stretch = increments(x + lean) - ds
        weight = ds + 0.5 * stretch
        x, h = x + 0.5 * lean, h / np.cos(tilt)
        coupling = stretch / h**2
    else:
        nn, mm, mv, vv = densities(angle)
        weight = ds
    cos, sin = np.cos(tilt), np.sin(tilt)
    q = np.zeros((3, 3, h.size))
    q[0, 0], q[1, 1], q[2, 2], q[1, 2] = nn / h, vv / h, mm / h**3, mv / (2 * h**2)
    q[2, 1] = q[1, 2]
    q *= weight
    q[0, 2] = q[2, 0] = coupling
    total = np.zeros((3, 3))
    for side, is_soft in zip((-1.0, 1.0), soft, strict=True):
        # forces on the section (N, V towards the thicker end, M) from those at the neck
        t = np.array([[cos, side * sin, zero], [sin, -side * cos, zero], [offset, -side * x, one]])
        # sum over the slices of t^T q t
        total += (t.transpose(2, 1, 0) @ q.transpose(2, 0, 1) @ t.transpose(2, 0, 1)).sum(axis=0)
        if method == "wedge":
            total += end_of_wedge(profile, nu, side)
            if profile.step > 0.0 and is_soft:
                total += sharp_step(profile, side)
    return total


def _root(profile: Profile, nu: float, root_width: float, reach: float, side: float) -> Array:
    """Compliance of the body next to the notch, times E b.

    Stress spreads from the root height to the width of the body (the wedge of half angle pi/2),
    and the body bends as a strip over the reach of the root.
    """
    height = profile.root_height
    width = float(np.clip(root_width, height, ROOT_SPREAD * height))
    x0 = 0.5 * profile.length
    e = 0.5 * profile.depth if profile.one_sided else 0.0
    c = strip_compliance((x0, x0 + reach * height), width, e, nu, side)
    # fan: mm M^2/h^3 over dh/2 and N^2/(pi/2 h) over dh
    fan = _FAN / 4.0 * (1.0 / height**2 - 1.0 / width**2)
    moment = np.array([e, -side * x0, 1.0])
    c += fan * np.outer(moment, moment)
    c[0, 0] += 2.0 / np.pi * np.log(width / height)
    return c


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
    notch). The two halves of a notch are equal, so force and moments at the neck do not couple.

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
    which a beam does not model, and bodies bend and twist: by finite elements in space the platform
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
