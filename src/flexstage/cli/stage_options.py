"""STAGE, the stage that a command is about, and the options that say how it is taken."""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from flexstage.cli.options import positive_length, refuse
from flexstage.errors import ModelError

if TYPE_CHECKING:
    from flexstage.designs import StageTemplate
    from flexstage.stage import Stage
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


def designs_like(incomplete: str) -> list[str]:
    """Return the built-in designs that a word begins, for the completion of the shell.

    Where there are none the shell offers files.

    Examples
    --------
    >>> designs_like("vgtu-p")
    ['vgtu-piezo']
    """
    from flexstage.designs import DESIGNS

    return [name for name in sorted(DESIGNS) if incomplete and name.startswith(incomplete)]


StageArgument = Annotated[
    str,
    typer.Argument(
        metavar="STAGE",
        autocompletion=designs_like,
        help="A stage file, a drawing (DXF, STEP), or the name of a built-in design.",
    ),
]
#: STAGE of commands that vary its parameters, of which a drawing has none.
TemplateArgument = Annotated[
    str,
    typer.Argument(
        metavar="STAGE",
        autocompletion=designs_like,
        help="A stage file, or the name of a built-in design.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class ParameterOptions:
    """Parameters of STAGE.

    Parameters
    ----------
    setting
        --set NAME=VALUE: Value of a parameter of STAGE, such as leg_spacing="35 mm"; may be
        repeated.
    """

    panel: ClassVar[str] = "Stage"
    setting: list[str] | None = None

    def template(self, source: str) -> "StageTemplate":
        """Return the stage that STAGE names, with what is set, as one to vary."""
        from flexstage.designs import StageTemplate

        return StageTemplate.of(source, self._settings())

    def _settings(self) -> dict[str, str]:
        found: dict[str, str] = {}
        for text in self.setting or ():
            name, equals, value = text.partition("=")
            name = name.strip()
            refuse(
                not name or not equals,
                '--set is the name of a parameter and its value, such as t="0.45 mm", got '
                f"'{text[:60]}'",
            )
            refuse(name in found, f"--set gives '{name[:60]}' twice: leave one out")
            found[name] = value.strip()
        return found


@dataclass(frozen=True, kw_only=True)
class StageOptions(DrawingSettings, ParameterOptions):
    """How STAGE is taken."""

    panel: ClassVar[str] = "Stage"

    def stage(self, source: str) -> "Stage":
        """Return the stage that STAGE names, with what the options say of it."""
        from flexstage.designs import find_stage

        return find_stage(source, set=self._settings(), drawing=self.drawing())

    def require_stage(self, source: str | None, name: str) -> None:
        """Refuse options where no stage is named; `name` is what names one."""
        if source is not None or self == AS_DESCRIBED:
            return
        refuse(self.setting, f"--set needs {name}: it sets a parameter of that")
        given = next(f.name for f in fields(DrawingSettings) if getattr(self, f.name) is not None)
        raise ModelError(f"--{given.replace('_', '-')} needs {name}: it is about a drawing")


#: None of them given.
AS_DESCRIBED = StageOptions()
NOTHING_SET = ParameterOptions()
