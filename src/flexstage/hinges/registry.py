"""Profiles by their names in files and on the command line, and variants with another neck."""

import math
from dataclasses import replace
from typing import Any

from flexstage.base.choose import unknown
from flexstage.base.errors import HingeError
from flexstage.hinges.as_drawn import AsDrawn
from flexstage.hinges.conic import Elliptical, Hyperbolic, Parabolic, PowerFunction, RightCircular
from flexstage.hinges.profile import Profile
from flexstage.hinges.straight import CornerFilleted, Leaf, VFillet

#: Every profile by its `kind`.
PROFILES: dict[str, type[Profile]] = {
    cls.kind: cls
    for cls in (
        RightCircular,
        Elliptical,
        CornerFilleted,
        Leaf,
        Parabolic,
        Hyperbolic,
        VFillet,
        PowerFunction,
        AsDrawn,
    )
}


def profile_class(kind: str) -> type[Profile]:
    """Look a profile up by its kind.

    Examples
    --------
    >>> profile_class("leaf").__name__
    'Leaf'
    """
    if kind not in PROFILES:
        raise HingeError(unknown("profile", kind, PROFILES))
    return PROFILES[kind]


def with_neck_thickness(profile: Profile, thickness: float) -> Profile:
    """Return a notch of the same length and the same roots with another neck.

    The bottom of the cut moves and its mouth stays, so that the notch still meets the edges of its
    bodies. The depth changes with the neck, and a circle becomes an ellipse of the same length. It
    is the same notch if nothing changes.

    Notes
    -----
    Validity: meant for manufacturing deviations of a neck, a few per cent of the depth of the
    notch.

    Examples
    --------
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=2e-3)
    >>> thicker = with_neck_thickness(notch, 0.52e-3)
    >>> thicker.kind, round(thicker.root_height * 1e3, 9), thicker.length * 1e3
    ('elliptical', 4.5, 4.0)
    """
    if thickness == profile.neck_thickness:
        return profile
    depth = profile.depth - (thickness - profile.neck_thickness) / profile.sides
    if isinstance(profile, RightCircular):
        return Elliptical(
            neck_thickness=thickness,
            one_sided=profile.one_sided,
            half_length=profile.radius,
            notch_depth=depth,
        )
    if isinstance(profile, CornerFilleted):
        return replace(profile, neck_thickness=thickness, fillet_radius=depth)
    if isinstance(profile, VFillet):
        other = replace(profile, neck_thickness=thickness, notch_depth=depth)
        return _of_length(other, profile.length)
    if isinstance(profile, AsDrawn):
        return profile.stretched(thickness, depth)
    if isinstance(profile, Leaf) and not profile.notch_depth:
        return replace(profile, neck_thickness=thickness)  # its bodies grow with it
    if isinstance(profile, Leaf) or hasattr(profile, "notch_depth"):
        changed: dict[str, Any] = {"neck_thickness": thickness, "notch_depth": depth}
        return replace(profile, **changed)
    raise HingeError(f"the neck of a {profile.kind} notch cannot be changed")


def with_neck_radius(profile: Profile, change: float) -> Profile:
    """Return a notch of the same neck and the same mouth, more or less curved at its neck.

    The notch is drawn out along the hinge, and so its radius at the neck grows as the square of its
    length: `change` is that of the radius [m]; of a notch that has none at its neck, as a leaf or
    one with fillets at its ends, it is that of half the length. A circle becomes an ellipse.

    Notes
    -----
    Validity: meant for manufacturing deviations of a radius, a few per cent. A true circle of
    another radius is longer by twice as much, and changes the rotation compliance by a tenth more.

    Examples
    --------
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=2e-3)
    >>> wider = with_neck_radius(notch, 20e-6)
    >>> wider.kind, round(wider.neck_radius * 1e3, 9), round(wider.length * 1e3, 4)
    ('elliptical', 2.02, 4.02)
    """
    if change == 0.0:
        return profile
    half, radius = 0.5 * profile.length, profile.neck_radius
    curved = profile.flat_length == 0.0 and 0.0 < radius < math.inf
    share = change / radius if curved else change / half
    if not share > -1.0:
        raise HingeError(f"a change of {change!r} m leaves nothing of a {profile.kind} notch")
    if isinstance(profile, VFillet):
        return _of_length(replace(profile, fillet_radius=radius + change), profile.length)
    half *= math.sqrt(1.0 + share) if curved else 1.0 + share
    if isinstance(profile, AsDrawn):
        return profile.stretched(profile.neck_thickness, profile.depth, 2.0 * half)
    if isinstance(profile, RightCircular):
        return Elliptical(
            neck_thickness=profile.neck_thickness,
            one_sided=profile.one_sided,
            half_length=half,
            notch_depth=profile.depth,
        )
    changed: dict[str, Any] = {
        "leaf": {"leaf_length": 2.0 * half},
        "corner-filleted": {"notch_length": 2.0 * half},
    }.get(profile.kind, {"half_length": half})
    return replace(profile, **changed)


def _of_length(profile: VFillet, length: float) -> VFillet:
    """Return a V whose flanks are turned to give it a length."""
    from scipy.optimize import brentq

    def notch_with(angle: float) -> VFillet:
        return replace(profile, half_opening_angle=angle)

    start = profile.half_opening_angle
    try:
        solved_angle: Any = brentq(
            lambda a: notch_with(a).length - length, 0.8 * start, min(1.2 * start, 1.57), xtol=1e-14
        )
    except ValueError as error:
        raise HingeError(
            f"a v notch with a neck of {profile.neck_thickness!r} m and a fillet of "
            f"{profile.fillet_radius!r} m does not fit between the same roots"
        ) from error
    return notch_with(float(solved_angle))
