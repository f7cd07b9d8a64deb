"""Published closed forms: those of other notches than circular ones, and which there are.

They take the neck thickness t, the sizes of the notch and the width b [m], and Young's modulus E
or, in plane strain, E/(1 - nu^2) [Pa]. Sizes are the half length l and the depth c on a side; the
length l, fillets included, and the radius r of fillets; the length l of a leaf. Rotation by a
moment is in rad/(N m), extension by an axial force in m/N.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.errors import HingeError
from flexstage.hinges import circular_forms as circular
from flexstage.hinges.circular_forms import (
    lobontiu_axial,
    lobontiu_rotation,
    paros_weisbord_axial,
)
from flexstage.hinges.hinge_spring import PlaneState, plane_moduli, plane_state
from flexstage.hinges.profile import Profile


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
    """What it is called in tables."""
    kind: str
    """The profile that it belongs to."""
    quantity: str
    """``axial``, ``shear`` or ``rotation``."""
    function: Callable[..., float]
    """Takes the `arguments`, then modulus, Poisson's ratio if the form has one, and width."""
    arguments: tuple[str, ...]
    """Fields of the profile that it takes, in order."""
    equals: str | None = None
    """The method whose quadrature it is the exact integral of; None for a fit or a limit."""
    takes_poisson: bool = False
    """Whether Poisson's ratio is one of its arguments."""
    validity: str = _BEAM
    """Where it holds."""


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
            equals="timoshenko" if function is circular.lobontiu_shear else "euler-bernoulli",
            takes_poisson=function is circular.lobontiu_shear,
        )
        for name, (kind, arguments), quantity, function in (
            (_PAROS, _CIRCLE, "rotation", circular.paros_weisbord_rotation),
            (_PAROS, _CIRCLE, "axial", circular.paros_weisbord_axial),
            (_PAROS, _CIRCLE, "shear", circular.paros_weisbord_shear),
            (_WU, _CIRCLE, "rotation", circular.wu_zhou_rotation),
            (_WU, _CIRCLE, "axial", circular.wu_zhou_axial),
            (_LOBONTIU, _CIRCLE, "rotation", circular.lobontiu_rotation),
            (_LOBONTIU, _CIRCLE, "axial", circular.lobontiu_axial),
            (_LOBONTIU, _CIRCLE, "shear", circular.lobontiu_shear),
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
                *(_THIN, _CIRCLE, "rotation", circular.paros_weisbord_simplified_rotation),
                "thin neck: -1.3 % at t/R = 0.05, -11 % at 0.8",
            ),
            (
                *(_THIN, _CIRCLE, "axial", circular.paros_weisbord_simplified_axial),
                "thin neck: -12 % at t/R = 0.05, -58 % at 0.8",
            ),
            (
                *(_SCHOTBORGH, _CIRCLE, "rotation", circular.schotborgh_rotation),
                "fit, t/R from 0.05 to 0.8: -2.6 to +5.7 %",
            ),
            (
                *(_SCHOTBORGH, _CIRCLE, "axial", circular.schotborgh_axial),
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
