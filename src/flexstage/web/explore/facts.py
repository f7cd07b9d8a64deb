"""What the forms of the view Explore need to know of a stage."""

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
class StageFacts:
    """The parameters and figures of a stage."""

    template: StageTemplate
    """The stage, with what was changed of it set throughout."""
    variables: Mapping[str, Variable]
    """What can be varied, by name, 30 % to either side."""
    flexure: frozenset[str]
    """Names of those that an optimisation varies where none is named."""
    figures: Mapping[str, Figure]
    """All figures, by name."""
    values: Mapping[str, float] = field(repr=False)
    """Their values by the lumped model, by name."""
    usual: tuple[str, ...]
    """Names of the figures that are looked at first."""
    of_lots: frozenset[str]
    """Names of the figures that a lot has."""
    required: tuple[Requirement, ...]
    """What an optimisation requires unasked."""

    @property
    def unasked(self) -> dict[str, str]:
        """What is required unasked, in words, by the name by which it is left out."""
        made = {CHECK: "can be made: no error of flexstage check"}
        return made | {r.figure.name: _words(r) for r in self.required}

    @property
    def frequency(self) -> str:
        """The name of the figure that is optimised first."""
        return next((n for n in self.usual if n.startswith("natural_frequency")), self.usual[0])

    @property
    def neck(self) -> str:
        """The name of the parameter that is swept first: a neck, which moves most; empty: none."""
        first = next(iter(self.variables), "")
        necks = [name for name in self.variables if "neck" in name]
        return next((name for name in necks if name in self.flexure), first)


def _words(requirement: Requirement) -> str:
    """Return a requirement as people write it."""
    figure, low, high = requirement.figure, requirement.low, requirement.high
    if low is not None:
        return f"{figure.label} ≥ {figure.text(low)}"
    assert high is not None
    return f"{figure.label} ≤ {figure.text(high)}"


def facts_of(variant: Variant) -> StageFacts:
    """Return what is to be known of a variant.

    Raises
    ------
    FlexstageError
        It is no stage, or has no axes.
    """
    template = variant.template.with_values(dict(variant.values))
    stage = template.stage()
    known = known_figures(stage)
    figures = {f.name: f for f in (Figure(quantity=q, axis=a) for q, a in known)}
    batched = set(batched_figures(stage))
    return StageFacts(
        template=template,
        variables={v.name: v for v in every_variable(template, SHARE)},
        flexure=frozenset(v.name for v in default_variables(template)),
        figures=figures,
        values={name: known[figure.key] for name, figure in figures.items()},
        usual=tuple(f.name for f in default_figures(known)),
        of_lots=frozenset(name for name, figure in figures.items() if figure.key in batched),
        required=default_requirements(stage, known, ()),
    )
