"""Which published closed form belongs to which profile, and how it is called."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from flexstage.errors import HingeError
from flexstage.hinges import circular_forms as circular
from flexstage.hinges import other_forms as other
from flexstage.hinges.hinge_spring import PlaneState, plane_moduli, plane_state
from flexstage.hinges.profile import Profile

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


_CIRCLE = ("neck_thickness", "radius")
_HALF = ("neck_thickness", "half_length", "notch_depth")
_FILLET = ("neck_thickness", "notch_length", "fillet_radius")

#: Every closed form.
CLOSED_FORMS: tuple[ClosedForm, ...] = (
    *(
        ClosedForm(
            name=name,
            kind="circular",
            quantity=quantity,
            function=function,
            arguments=_CIRCLE,
            equals="euler-bernoulli",
        )
        for name, quantity, function in (
            ("Paros and Weisbord 1965", "rotation", circular.paros_weisbord_rotation),
            ("Paros and Weisbord 1965", "axial", circular.paros_weisbord_axial),
            ("Paros and Weisbord 1965", "shear", circular.paros_weisbord_shear),
            ("Wu and Zhou 2002", "rotation", circular.wu_zhou_rotation),
            ("Wu and Zhou 2002", "axial", circular.wu_zhou_axial),
            ("Lobontiu 2003", "rotation", circular.lobontiu_rotation),
            ("Lobontiu 2003", "axial", circular.lobontiu_axial),
        )
    ),
    ClosedForm(
        name="Lobontiu 2003",
        kind="circular",
        quantity="shear",
        function=circular.lobontiu_shear,
        arguments=_CIRCLE,
        equals="timoshenko",
        takes_poisson=True,
    ),
    ClosedForm(
        name="Paros and Weisbord 1965, simplified",
        kind="circular",
        quantity="rotation",
        function=circular.paros_weisbord_simplified_rotation,
        arguments=_CIRCLE,
        validity="thin neck: -1.3 % at t/R = 0.05, -11 % at 0.8",
    ),
    ClosedForm(
        name="Paros and Weisbord 1965, simplified",
        kind="circular",
        quantity="axial",
        function=circular.paros_weisbord_simplified_axial,
        arguments=_CIRCLE,
        validity="thin neck: -12 % at t/R = 0.05, -58 % at 0.8",
    ),
    ClosedForm(
        name="Schotborgh et al. 2005",
        kind="circular",
        quantity="rotation",
        function=circular.schotborgh_rotation,
        arguments=_CIRCLE,
        validity="fit, t/R from 0.05 to 0.8: -2.6 to +5.7 %",
    ),
    ClosedForm(
        name="Schotborgh et al. 2005",
        kind="circular",
        quantity="axial",
        function=circular.schotborgh_axial,
        arguments=_CIRCLE,
        validity="fit, t/R from 0.05 to 0.8: -1 to +5 %",
    ),
    *(
        ClosedForm(
            name=name,
            kind=kind,
            quantity=quantity,
            function=function,
            arguments=arguments,
            equals="euler-bernoulli",
        )
        for name, kind, arguments, quantity, function in (
            ("Smith et al. 1997", "elliptical", _HALF, "rotation", other.smith_rotation),
            ("Smith et al. 1997", "elliptical", _HALF, "axial", other.smith_axial),
            (
                "Lobontiu et al. 2001",
                "corner-filleted",
                _FILLET,
                "rotation",
                other.lobontiu_corner_filleted_rotation,
            ),
            (
                "Lobontiu et al. 2001",
                "corner-filleted",
                _FILLET,
                "axial",
                other.lobontiu_corner_filleted_axial,
            ),
            ("Lobontiu et al. 2002", "parabolic", _HALF, "rotation", other.parabolic_rotation),
            ("Lobontiu et al. 2002", "parabolic", _HALF, "axial", other.parabolic_axial),
            ("Lobontiu et al. 2002", "hyperbolic", _HALF, "rotation", other.hyperbolic_rotation),
            ("Lobontiu et al. 2002", "hyperbolic", _HALF, "axial", other.hyperbolic_axial),
        )
    ),
    ClosedForm(
        name="O'Donnell 1960",
        kind="leaf",
        quantity="rotation",
        function=other.odonnell_leaf_rotation,
        arguments=("neck_thickness", "leaf_length"),
        validity="step much deeper than the leaf is thick: upper bound",
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
    state = plane_state(width, profile.neck_thickness) if plane == "auto" else plane
    e, nu = plane_moduli(modulus, poisson, state)
    sizes = [getattr(profile, name) for name in form.arguments]
    extra = [nu] if form.takes_poisson else []
    return form.function(*sizes, e, *extra, width)
