"""Data of a drawing beyond its file."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from flexstage.base.errors import FlexstageError, StageError
from flexstage.files.ranges import Size, Written
from flexstage.files.request import Request


@dataclass(frozen=True, slots=True, kw_only=True)
class ContourOptions(Request):
    """Options by which contours of a drawing, and the necks between them, are found."""

    one_value: ClassVar[bool] = True
    refused_as: ClassVar[type[FlexstageError]] = StageError

    unit: Annotated[str, Written("UNIT")] | None = None
    """Unit of the drawing: um, mm, cm, m, inch or mil, where the file does not give it."""
    layers: Annotated[tuple[str, ...], Written("NAMES", commas=True)] = ()
    """Layers of the contours, separated by commas (default: by their names)."""
    gap: Size | None = None
    """Largest gap in a contour that is closed (default: 2 um)."""
    neck_limit: Size | None = None
    """Thickest neck that counts (default: below the widest gap in the thicknesses of thin places).
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawingOptions(Request):
    """Options of a drawing."""

    heading: ClassVar[str] = "Drawing"
    refused_as: ClassVar[type[FlexstageError]] = StageError

    thickness: Size | None = None
    """Thickness of the plate in a drawing, such as "10 mm"; a STEP file has its own."""
    material: Annotated[str, Written("NAME")] | None = None
    """Material of the plate in a drawing, from the catalogue."""
    contours: ContourOptions = ContourOptions()
    """Options of the contours of a drawing, such as "unit=mm,layers=CUT,0"."""
    fixed: Annotated[tuple[str, ...], Written("X,Y")] = ()
    """A point on a fixed body of the drawing, in its unit (default: the outer body with the most
    mounting holes, or else the largest).
    """
    body: Annotated[tuple[str, ...], Written("X,Y:MATERIAL")] = ()
    """A body of another material, or a rigid one, by a point on it in the unit of the drawing:
    "12,4: Invar 36", "12,4: rigid", or "12,4: Invar 36, rigid".
    """
    drive: tuple[str, ...] = ()
    """A drive of the drawing, from the body it reacts on to the body it pushes, in the unit of the
    drawing: "x: 12,4 -> 30,4; piezo, free_stroke=38 um, stiffness=50 N/um".
    """
    probe: tuple[str, ...] = ()
    """A probe of the drawing, from the measured point in the direction of measurement: "x: 30,4 ->
    40,4", or "x: 30,4 at 0 deg".
    """
