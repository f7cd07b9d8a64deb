"""The request for an analysis of a part from a STEP file; it needs no finite elements."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from flexstage.base.errors import FlexstageError, StageError
from flexstage.files.ranges import POSITIVE, CountOrZero, Range, Written
from flexstage.files.request import Request
from flexstage.quantities.units import Length, parse

#: Default material of a part.
DEFAULT_MATERIAL = "Al 7075-T6"


def _read_point(text: str) -> tuple[float, ...]:
    words = text.split(",")
    if len(words) != 3:
        raise StageError(
            f"is three lengths X,Y,Z, such as 0,0,7.5 in millimetres, got '{text[:60]}'"
        )
    return tuple(parse(word, "length", bare_unit="mm") for word in words)


def _write_point(point: tuple[float, ...]) -> str:
    return ",".join(f"{c!r} m" for c in point)


def _read_ratio(text: str) -> tuple[tuple[str, ...], ...]:
    groups = tuple(tuple(w.strip() for w in words.split(",")) for words in text.split(":"))
    if len(groups) != 3:
        raise StageError(
            f"is between three faces, END:END:OUTPUT, such as face7:face9:z-max, got '{text[:60]}'"
        )
    return groups


def _write_ratio(groups: tuple[tuple[str, ...], ...]) -> str:
    return ":".join(",".join(names) for names in groups)


#: Faces by name; ``x-min``, ``z-max`` and so on are the plane faces at that end of a part.
Faces = Annotated[tuple[str, ...], Written("FACES", commas=True)]
_Point = Annotated[tuple[float, ...], Written("X,Y,Z", read=_read_point, write=_write_point)]
_Ratio = Annotated[
    tuple[tuple[str, ...], ...],
    Written("FACES:FACES:FACES", read=_read_ratio, write=_write_ratio),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class PartRequest(Request):
    """An analysis of a part: mass, modes, stiffness and ratio."""

    refused_as: ClassVar[type[FlexstageError]] = StageError

    solids: Annotated[tuple[str, ...], Written("NAMES", commas=True)] = ("all",)
    """Solids to use, by name or number from 1, separated by commas; solids whose faces touch are
    joined.
    """
    material: Annotated[tuple[str, ...], Written("[SOLID=]MATERIAL")] = ()
    """Material: a name from the catalogue (default: Al 7075-T6), or "E=193 GPa, nu=0.31, rho=7750
    kg/m^3"; for one solid with its name or number first, such as "2=E=46 GPa, nu=0.3, rho=7600
    kg/m^3".
    """
    hold: Faces = ()
    """Fixed faces: names, or x-min, z-max, ... for the plane faces at an end of the part. A comma
    separates interfaces and a plus sign joins faces in one, such as face3+face4,face7; faces that
    do not touch are interfaces of their own.
    """
    move: Faces = ()
    """Faces to move: their stiffness against the fixed faces is computed."""
    at: _Point | None = None
    """Reference point of the stiffness, such as "0 mm,0 mm,7.5 mm"; bare numbers are in millimetres
    (default: the centroid of the moved faces).
    """
    ratio: _Ratio | None = None
    """Two faces that a drive pushes apart, and the output face: its motion for each micrometre of
    the drive is computed, with one end fixed.
    """
    interfaces: Literal["rigid", "mean", "both"] = "both"
    """Fixed, moved and pushed faces are rigid, or deformable with their mean motion prescribed."""
    order: Annotated[int, Range(low=0, high=8)] = 3
    """Order of the elements; 0 lists the faces only."""
    size: Annotated[Length, POSITIVE, Written("LENGTH", bare="mm")] | None = None
    """Largest element, such as "2 mm"; a bare number is in millimetres."""
    thin: Annotated[float, Range(low=0.0, high=100.0)] = 1.5
    """Largest element in thin places, in local thicknesses."""
    modes: CountOrZero = 6
    """Number of natural frequencies to compute."""
    force: bool = False
    """Continue although the memory may not suffice."""
