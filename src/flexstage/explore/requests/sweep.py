"""What a sweep is asked for."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import cast

from flexstage.choose import unknown
from flexstage.designs.template import StageTemplate
from flexstage.errors import ModelError
from flexstage.explore.family import Family, known_figures
from flexstage.explore.figures import Figure, chosen_figures
from flexstage.explore.sampling import SAMPLINGS, Sampling, SweepPlan, usual_plan
from flexstage.explore.sweep import Sweep, sweep
from flexstage.explore.variables import every_variable, listed, variables_of
from flexstage.studies.models import known_model


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepRequest:
    """A sweep in words, as the options of `flexstage sweep`, which say what each is."""

    over: tuple[str, ...] = ()
    """Parameters and their ranges."""
    of: tuple[str, ...] = ()
    """Figures that are looked at; the usual ones where none is named."""
    plan: str | None = None
    """How points are spread."""
    samples: int | None = None
    """Number of points."""
    seed: int = 0
    """Seed of what is drawn at random."""
    indices: bool = False
    """Whether Sobol' indices are estimated."""
    model: str = "lumped"
    """The model."""

    def ready(self, template: StageTemplate) -> Callable[..., Sweep]:
        """Read the words; return `flexstage.explore.sweep`, which then needs workers and folder."""
        return partial(sweep, *self.question(template), model=self.model)

    def question(self, template: StageTemplate) -> tuple[Family, tuple[Figure, ...], SweepPlan]:
        """Return what is varied, which figures are computed, and at which points."""
        known_model(self.model)
        if self.plan is not None and self.plan not in SAMPLINGS:
            raise ModelError(unknown("plan", self.plan, SAMPLINGS))
        if not self.over:
            raise ModelError(nothing_varied(template))
        family = Family(template=template, variables=variables_of(template, self.over))
        plan = usual_plan(
            family.variables,
            self.model,
            sampling=cast("Sampling | None", self.plan),
            samples=self.samples,
            seed=self.seed,
            indices=self.indices,
        )
        figures = chosen_figures(self.of, known_figures(family.stage(family.usual)))
        return family, figures, plan


def nothing_varied(template: StageTemplate) -> str:
    """Say how a parameter of this stage is varied."""
    variables = every_variable(template)
    if not variables:
        return (
            f"{template.source} has no parameter that can be varied: give its dimensions names "
            "under 'parameters' in the stage file"
        )
    neck = next((v for v in variables if "neck" in v.name), variables[0])
    return (
        f'name what is varied, such as --over "{neck.name}={neck.range_text}": the '
        f"parameters of {template.source} are {listed([v.name for v in variables])}"
    )
