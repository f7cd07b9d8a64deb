"""A notch with another neck, between bodies that stay as they are."""

from dataclasses import replace
from typing import Any

from flexstage.errors import HingeError
from flexstage.hinges import (
    CornerFilleted,
    Elliptical,
    Leaf,
    Profile,
    RightCircular,
    VFillet,
)


def with_neck_thickness(profile: Profile, thickness: float) -> Profile:
    """Return a notch of the same length and the same roots with another neck.

    The bottom of the cut moves and its mouth stays, so that the notch still meets its bodies where
    they end. The depth changes by what the neck does, and a circle becomes an ellipse of the same
    length. The same notch where nothing changes.

    Notes
    -----
    Validity: meant for what manufacture does to a neck, some per cent of the depth of the notch.

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
        return _of_same_length(profile, thickness, depth)
    if isinstance(profile, Leaf) or hasattr(profile, "notch_depth"):
        changed: dict[str, Any] = {"neck_thickness": thickness, "notch_depth": depth}
        return replace(profile, **changed)
    raise HingeError(f"the neck of a {profile.kind} notch cannot be changed")


def _of_same_length(profile: VFillet, thickness: float, depth: float) -> VFillet:
    """A V that is deeper or shallower, its flanks turned so that they end at the same place."""
    from scipy.optimize import brentq

    def made(angle: float) -> VFillet:
        return replace(
            profile, neck_thickness=thickness, notch_depth=depth, half_opening_angle=angle
        )

    start = profile.half_opening_angle
    try:
        found: Any = brentq(
            lambda a: made(a).length - profile.length,
            0.8 * start,
            min(1.2 * start, 1.57),
            xtol=1e-14,
        )
    except ValueError as error:
        raise HingeError(
            f"the neck of a v notch cannot become {thickness!r} m between the same roots"
        ) from error
    return made(float(found))
