"""Parameters, figures and default requirements of a stage for the forms of the view Explore."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.family import batched_figures, known_figures
from flexstage.studies.explore.figures import Figure, Requirement, default_figures
from flexstage.studies.explore.optimise.default_requirements import (
    CHECK,
    default_requirements,
    default_variables,
)
from flexstage.studies.explore.variables import Variable, every_variable
from flexstage.web.design.state import SHARE, Variant


@dataclass(frozen=True, slots=True, kw_only=True)
class StageSummary:
    """The parameters and figures of a stage."""

    template: StageTemplate
    """The stage with the changed parameters as its nominal values."""
    variables: Mapping[str, Variable]
    """Parameters that can be varied, by name, with bounds of ±30 %."""
    flexure: frozenset[str]
    """Names of the parameters that an optimisation varies by default."""
    figures: Mapping[str, Figure]
    """All figures, by name."""
    values: Mapping[str, float] = field(repr=False)
    """Values of the figures by the lumped model, by name."""
    default_figures: tuple[str, ...]
    """Names of the figures in a result by default."""
    tolerance_figures: frozenset[str]
    """Names of the figures of a tolerance analysis."""
    requirements: tuple[Requirement, ...]
    """Default requirements of an optimisation."""

    @property
    def default_requirements(self) -> dict[str, str]:
        """Texts of the default requirements, by the name that disables each."""
        texts = {CHECK: "Manufacturable: no error of flexstage check"}
        return texts | {r.figure.name: _requirement_text(r) for r in self.requirements}

    @property
    def frequency(self) -> str:
        """Name of the figure that is maximised by default: the first natural frequency."""
        names = self.default_figures
        return next((n for n in names if n.startswith("natural_frequency")), names[0])

    @property
    def neck(self) -> str:
        """Name of the parameter that is swept by default: a neck thickness, or empty."""
        first = next(iter(self.variables), "")
        necks = [name for name in self.variables if "neck" in name]
        return next((name for name in necks if name in self.flexure), first)


def _requirement_text(requirement: Requirement) -> str:
    figure, low, high = requirement.figure, requirement.low, requirement.high
    if low is not None:
        return f"{figure.label} ≥ {figure.text(low)}"
    assert high is not None
    return f"{figure.label} ≤ {figure.text(high)}"


def summarise_stage(variant: Variant) -> StageSummary:
    """Return the summary of a variant.

    Raises
    ------
    FlexstageError
        The stage is infeasible, or has no axes.
    """
    template = variant.template.with_values(dict(variant.values))
    stage = template.stage()
    known_values = known_figures(stage)
    figures = {f.name: f for f in (Figure(quantity=q, axis=a) for q, a in known_values)}
    batched = set(batched_figures(stage))
    return StageSummary(
        template=template,
        variables={v.name: v for v in every_variable(template, SHARE)},
        flexure=frozenset(v.name for v in default_variables(template)),
        figures=figures,
        values={name: known_values[figure.key] for name, figure in figures.items()},
        default_figures=tuple(f.name for f in default_figures(known_values)),
        tolerance_figures=frozenset(n for n, figure in figures.items() if figure.key in batched),
        requirements=default_requirements(stage, known_values, ()),
    )
