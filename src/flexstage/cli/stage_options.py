"""The argument STAGE of commands, and the options of a stage."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from flexstage.cli.options import refuse
from flexstage.files.ranges import Written
from flexstage.files.request import Request
from flexstage.stage.drawing.requests import DrawingOptions

if TYPE_CHECKING:
    from flexstage.stage import Stage
    from flexstage.stage.designs import StageTemplate


def designs_like(incomplete: str) -> list[str]:
    """Return the built-in designs that begin with a word, for the completion of the shell.

    If there are none, the shell offers files.

    Examples
    --------
    >>> designs_like("vgtu-p")
    ['vgtu-piezo']
    """
    from flexstage.stage.designs import DESIGNS

    return [name for name in sorted(DESIGNS) if incomplete and name.startswith(incomplete)]


StageArgument = Annotated[
    str,
    typer.Argument(
        metavar="STAGE",
        autocompletion=designs_like,
        help="A stage file, a drawing (DXF, STEP), or the name of a built-in design.",
    ),
]
#: STAGE of commands that vary parameters, which a drawing does not have.
TemplateArgument = Annotated[
    str,
    typer.Argument(
        metavar="STAGE",
        autocompletion=designs_like,
        help="A stage file, or the name of a built-in design.",
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterOptions(Request):
    """Parameters of STAGE."""

    heading: ClassVar[str] = "Stage"

    set: Annotated[tuple[str, ...], Written("NAME=VALUE")] = ()
    """Value of a parameter of STAGE, such as leg_spacing="35 mm"."""

    def template(self, source: str) -> "StageTemplate":
        """Return STAGE with its parameters set, as a template to vary."""
        from flexstage.stage.designs import StageTemplate

        return StageTemplate.of(source, self.settings())

    def settings(self) -> dict[str, str]:
        """Return the values of parameters by their names."""
        values: dict[str, str] = {}
        for text in self.set:
            name, equals, value = text.partition("=")
            name = name.strip()
            refuse(
                not name or not equals,
                '--set is the name of a parameter and its value, such as t="0.45 mm", got '
                f"'{text[:60]}'",
            )
            refuse(name in values, f"--set gives '{name[:60]}' twice: remove one")
            values[name] = value.strip()
        return values


@dataclass(frozen=True, slots=True, kw_only=True)
class StageOptions(ParameterOptions):
    """Options of STAGE."""

    def stage(self, source: str) -> "Stage":
        """Return STAGE with these options."""
        from flexstage.stage.designs import find_stage

        return find_stage(source, set=self.settings())

    def require_stage(self, source: str | None, name: str) -> None:
        """Refuse options without a stage; `name` is the argument or option that names it."""
        refuse(source is None and self.set, f"--set needs {name}, whose parameter it sets")


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnStageOptions(StageOptions):
    """Options of STAGE, which may be a drawing."""

    drawing: DrawingOptions = DrawingOptions()
    """Options of a drawing."""

    def stage(self, source: str) -> "Stage":
        """Return STAGE with these options."""
        from flexstage.stage.designs import find_stage

        drawing = None if self.drawing == DrawingOptions() else self.drawing
        return find_stage(source, set=self.settings(), drawing=drawing)


#: Options with their defaults.
AS_DESCRIBED, AS_DRAWN = StageOptions(), DrawnStageOptions()
NOTHING_SET = ParameterOptions()
