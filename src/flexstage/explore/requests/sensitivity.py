"""What sensitivities are asked for."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from flexstage.designs.template import StageTemplate
from flexstage.errors import ModelError
from flexstage.explore.family import Family, known_figures
from flexstage.explore.figures import chosen_figures
from flexstage.explore.sensitivity import (
    LENGTH,
    Sensitivities,
    hinge_variables,
    sensitivities,
    variables_by,
)
from flexstage.studies.models import known_model


@dataclass(frozen=True, slots=True, kw_only=True)
class SensitivityRequest:
    """Sensitivities in words, as the options of `flexstage sensitivity`, which say what each is."""

    of: tuple[str, ...] = ()
    """Figures that are looked at; the usual ones where none is named."""
    by: tuple[str, ...] = ()
    """Parameters; all that change continuously where none is named."""
    hinges: bool = False
    """Whether neck and place of each hinge are taken by themselves."""
    step: float | None = None
    """What lengths change by [m]; a share of each where it is not given."""
    model: str = "lumped"
    """The model."""

    @property
    def length(self) -> float | None:
        """What lengths change by [m]; None for a share of each."""
        return LENGTH if self.step is None and self.hinges else self.step

    def ready(self, template: StageTemplate) -> Callable[[], Sensitivities]:
        """Read the words; return what computes them."""
        known_model(self.model)
        if self.hinges and self.model != "lumped":
            raise ModelError(
                "--hinges goes with --model lumped: a notch that is moved by itself leaves the "
                "edges that finite elements cut it from"
            )
        figures = chosen_figures(self.of, known_figures(template.stage()))
        if self.hinges:
            family, left_out = hinge_variables(template, self.by), {}
        else:
            variables, left_out = variables_by(template, self.by)
            family = Family(template=template, variables=variables)
            if not variables:
                raise ModelError(
                    f"{template.source} has no parameter that changes continuously: give its "
                    "dimensions names under 'parameters' in the stage file, or look at its --hinges"
                )
        return partial(sensitivities, family, figures, self.model, left_out)
