"""What is to be known of a drawing beyond its file, as options."""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, ClassVar

from flexstage.cli.options import positive_length

if TYPE_CHECKING:
    from flexstage.stage.drawing.drawn_stage import DrawingOptions


@dataclass(frozen=True, kw_only=True)
class DrawingSettings:
    """How a drawing is read.

    Parameters
    ----------
    thickness
        LENGTH: Thickness of the plate in a drawing, such as "10 mm"; a STEP file says its own.
    material
        NAME: Material of the plate in a drawing, from the catalogue.
    drawing_unit
        UNIT: Unit of the drawing, um, mm, cm, m, inch or mil, where the file does not say it.
    layers
        NAMES: Layers of the contours of the drawing, separated by commas (default: by their names).
    gap
        LENGTH: Largest gap in a contour of the drawing that is closed (default: 2 um).
    neck_limit
        LENGTH: Thickest neck that counts in the drawing (default: below the widest gap in the
        thicknesses of its thin places).
    fixed
        X,Y: A point on a body of the drawing that is held, in its unit; may be repeated (default:
        the body outside with the most mounting holes, or else the largest).
    drive
        TEXT: A drive of the drawing, from the body that it stands on to the one that it pushes, in
        the unit of the drawing: "x: 12,4 -> 30,4; piezo, free_stroke=38 um, stiffness=50 N/um";
        may be repeated.
    probe
        TEXT: A probe of the drawing, from the point that is read in its direction: "x: 30,4 ->
        40,4", or "x: 30,4 at 0 deg"; may be repeated.
    """

    panel: ClassVar[str] = "Drawing"
    thickness: str | None = None
    material: str | None = None
    drawing_unit: str | None = None
    layers: str | None = None
    gap: str | None = None
    neck_limit: str | None = None
    fixed: list[str] | None = None
    drive: list[str] | None = None
    probe: list[str] | None = None

    def drawing(self) -> "DrawingOptions | None":
        """Return them as the reader of drawings takes them; None where none is given."""
        given = {f.name: getattr(self, f.name) for f in fields(DrawingSettings)}
        if not any(value is not None for value in given.values()):
            return None
        from flexstage.stage.drawing.drawn_stage import DrawingOptions

        lengths = {
            name: positive_length(text, f"--{name.replace('_', '-')}")
            for name in ("thickness", "gap", "neck_limit")
            if (text := given[name]) is not None
        }
        return DrawingOptions(
            **lengths,
            material=self.material,
            unit=self.drawing_unit,
            layers=None if self.layers is None else tuple(self.layers.split(",")),
            fixed=tuple(self.fixed or ()),
            drives=tuple(self.drive or ()),
            probes=tuple(self.probe or ()),
        )
