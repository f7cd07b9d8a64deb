"""The request for the figures of a notch, by its dimensions."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from flexstage.base.errors import FlexstageError, HingeError
from flexstage.files.ranges import Range, Written
from flexstage.files.request import Request
from flexstage.quantities.units import Angle, Length

#: Plane state of notches.
Plane = Annotated[
    Literal["auto", "stress", "strain"],
    Written(help="Auto decides by the ratio of width to neck."),
]
#: Range of lengths in stages.
_Size = Annotated[Length, Range(low=1e-12, high=100.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class HingesRequest(Request):
    """Stiffness and range of a notch profile."""

    refused_as: ClassVar[type[FlexstageError]] = HingeError

    profile: Annotated[str, Written("KIND")] = "circular"
    """circular, elliptical, corner-filleted, leaf, parabolic, hyperbolic, v, power."""
    neck: _Size = 0.5e-3
    """Thickness of the neck, such as "0.5 mm"."""
    width: _Size = 10e-3
    """Width of the hinge, such as "10 mm"."""
    material: Annotated[str, Written("NAME")] = "Al 7075-T6"
    """Name of a material in the catalogue."""
    radius: _Size | None = None
    """Radius of a circular notch, or of the fillets."""
    length: _Size | None = None
    """Total length of the notch."""
    depth: _Size | None = None
    """Depth of the notch on one side."""
    half_angle: Angle | None = None
    """Half opening angle of a v notch, such as "30 deg"."""
    exponent: float | None = None
    """Exponent of a power notch."""
    one_sided: bool = False
    """Cut the notch on one side only."""
    plane: Plane = "auto"
    """Plane state of the notches."""
