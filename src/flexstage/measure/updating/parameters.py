"""What of a stage is to be found from measurements, and the stage that has it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any, Literal

from flexstage.errors import HingeError, ModelError
from flexstage.hinges import (
    AsDrawn,
    CornerFilleted,
    Elliptical,
    Leaf,
    Profile,
    RightCircular,
    VFillet,
)
from flexstage.stage import Hinge, Stage

Kind = Literal["neck_factor", "neck_offset", "modulus_factor", "density_factor", "damping_ratio"]
#: Kinds of parameters: the unit, and the expectation where none is given.
PARAMETER_KINDS: dict[str, tuple[str, float | None]] = {
    "neck_factor": ("1", 1.0),
    "neck_offset": ("m", 0.0),
    "modulus_factor": ("1", 1.0),
    "density_factor": ("1", 1.0),
    "damping_ratio": ("1", None),
}


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
        other = replace(profile, neck_thickness=thickness, notch_depth=depth)
        return _of_length(other, profile.length)
    if isinstance(profile, AsDrawn):
        return profile.stretched(thickness, depth)
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
    Validity: meant for what manufacture does to a radius, some per cent of it. A true circle of
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
    """A V whose flanks are turned so that they end where it is so long."""
    from scipy.optimize import brentq

    def made(angle: float) -> VFillet:
        return replace(profile, half_opening_angle=angle)

    start = profile.half_opening_angle
    try:
        found: Any = brentq(
            lambda a: made(a).length - length, 0.8 * start, min(1.2 * start, 1.57), xtol=1e-14
        )
    except ValueError as error:
        raise HingeError(
            f"a v notch with a neck of {profile.neck_thickness!r} m and a fillet of "
            f"{profile.fillet_radius!r} m does not fit between the same roots"
        ) from error
    return made(float(found))


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateParameter:
    """A parameter of a stage that measurements are to tell, and what is known of it before.

    Raises
    ------
    ModelError
        The kind is unknown, or a figure is impossible.

    Examples
    --------
    >>> legs = UpdateParameter(name="legs", kind="neck_offset", spread=8e-6, hinges=("xg*",))
    >>> legs.unit, legs.mean
    ('m', 0.0)
    """

    name: str
    """Its name."""
    kind: Kind
    """One of `PARAMETER_KINDS`: a factor of neck thicknesses or what is added to them, a factor of
    Young's modulus or of the density, or the damping ratio of all modes.
    """
    spread: float
    """Standard deviation of what is known before [1], of an offset [m]: the scatter of the machine,
    of the alloy.
    """
    hinges: tuple[str, ...] = ("*",)
    """Patterns of the names of the hinges that it is for, as ``xgp*``; all where not given."""
    expected: float | None = None
    """What is expected before; 1 of a factor, 0 of an offset. A damping ratio needs it."""

    def __post_init__(self) -> None:
        if self.kind not in PARAMETER_KINDS:
            raise ModelError(
                f"parameter '{self.name}': unknown kind {self.kind!r}: expected one of "
                f"{', '.join(PARAMETER_KINDS)}"
            )
        if not 0.0 < self.spread < math.inf:
            raise ModelError(
                f"parameter '{self.name}': the spread must be positive and finite, got "
                f"{self.spread!r}"
            )
        if self.expected is None and self.kind == "damping_ratio":
            raise ModelError(f"parameter '{self.name}': say which damping ratio is expected")
        if self.expected is not None and not math.isfinite(self.expected):
            raise ModelError(
                f"parameter '{self.name}': what is expected must be finite, got {self.expected!r}"
            )

    @property
    def unit(self) -> str:
        """Unit of its value."""
        return PARAMETER_KINDS[self.kind][0]

    @property
    def mean(self) -> float:
        """What is expected of it before."""
        usual = PARAMETER_KINDS[self.kind][1]
        return self.expected if self.expected is not None else float(usual or 0.0)

    def holds(self, hinge: str) -> bool:
        """Say whether it is for a hinge of this name: whether one of its patterns fits."""
        return any(fnmatchcase(hinge, pattern) for pattern in self.hinges)


def stage_with(
    stage: Stage, parameters: Sequence[UpdateParameter], values: Mapping[str, float]
) -> Stage:
    """Return a stage with other values of parameters.

    Parameters
    ----------
    stage : Stage
        The stage as it was described.
    parameters : sequence of UpdateParameter
        The parameters; where several are for one hinge, factors come before offsets.
    values : Mapping
        Value of each parameter by its name.

    Returns
    -------
    Stage
        The same bodies with these necks and this material; a damping ratio is no part of a stage.

    Raises
    ------
    HingeError
        A neck is impossible.
    StageError
        The material is.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> thin = UpdateParameter(name="necks", kind="neck_factor", spread=0.02)
    >>> other = stage_with(design("parallelogram"), [thin], {"necks": 0.96})
    >>> round(other.hinges[0].profile.neck_thickness * 1e3, 6)
    0.48
    """
    modulus, density = stage.material.youngs_modulus, stage.material.density
    for p in parameters:
        if p.kind == "modulus_factor":
            modulus *= values[p.name]
        elif p.kind == "density_factor":
            density *= values[p.name]
    return replace(
        stage,
        material=replace(stage.material, youngs_modulus=modulus, density=density),
        hinges=tuple(_hinge(h, parameters, values) for h in stage.hinges),
    )


def _hinge(
    hinge: Hinge, parameters: Sequence[UpdateParameter], values: Mapping[str, float]
) -> Hinge:
    thickness = hinge.profile.neck_thickness
    for p in parameters:
        if p.kind == "neck_factor" and p.holds(hinge.name):
            thickness *= values[p.name]
    for p in parameters:
        if p.kind == "neck_offset" and p.holds(hinge.name):
            thickness += values[p.name]
    return replace(hinge, profile=with_neck_thickness(hinge.profile, thickness))
