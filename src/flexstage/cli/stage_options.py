"""STAGE, the stage that a command is about, and the options that say how it is taken."""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from flexstage.cli.drawing_options import DrawingSettings
from flexstage.errors import ModelError

if TYPE_CHECKING:
    from flexstage.designs import StageTemplate
    from flexstage.stage import Stage


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
            if not name or not equals:
                raise ModelError(
                    f'--set is the name of a parameter and its value, such as t="0.45 mm", got '
                    f"'{text[:60]}'"
                )
            if name in found:
                raise ModelError(f"--set gives '{name[:60]}' twice: leave one out")
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
        if self.setting:
            raise ModelError(f"--set needs {name}: it sets a parameter of that")
        given = next(f.name for f in fields(DrawingSettings) if getattr(self, f.name) is not None)
        raise ModelError(f"--{given.replace('_', '-')} needs {name}: it is about a drawing")


#: None of them given.
AS_DESCRIBED = StageOptions()
NOTHING_SET = ParameterOptions()
