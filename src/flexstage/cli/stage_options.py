"""STAGE, the stage that a command is about, and the options that say how it is taken."""

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
    """Return the built-in designs that a word begins, for the completion of the shell.

    Where there are none the shell offers files.

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
#: STAGE of commands that vary its parameters, of which a drawing has none.
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
        """Return the stage that STAGE names, with what is set, as one to vary."""
        from flexstage.stage.designs import StageTemplate

        return StageTemplate.of(source, self.settings())

    def settings(self) -> dict[str, str]:
        """Return the values of parameters by their names."""
        found: dict[str, str] = {}
        for text in self.set:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class StageOptions(ParameterOptions):
    """How STAGE is taken."""

    def stage(self, source: str) -> "Stage":
        """Return the stage that STAGE names, with what the options say of it."""
        from flexstage.stage.designs import find_stage

        return find_stage(source, set=self.settings())

    def require_stage(self, source: str | None, name: str) -> None:
        """Refuse options where no stage is named; `name` is what names one."""
        refuse(source is None and self.set, f"--set needs {name}: it sets a parameter of that")


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnStageOptions(StageOptions):
    """How STAGE is taken, where it may be a drawing that does not say all."""

    drawing: DrawingOptions = DrawingOptions()
    """What is to be known of a drawing."""

    def stage(self, source: str) -> "Stage":
        """Return the stage that STAGE names, with what the options say of it."""
        from flexstage.stage.designs import find_stage

        drawing = None if self.drawing == DrawingOptions() else self.drawing
        return find_stage(source, set=self.settings(), drawing=drawing)


#: None of them given.
AS_DESCRIBED, AS_DRAWN = StageOptions(), DrawnStageOptions()
NOTHING_SET = ParameterOptions()
