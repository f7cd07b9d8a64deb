"""What one person has open in the view Explore: the forms, and what was found by each."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, get_args

from flexstage.base.errors import FlexstageError, ModelError
from flexstage.studies.explore.figures import Requirement, bounded
from flexstage.studies.explore.prepare import nothing_varied
from flexstage.studies.explore.requests import (
    ExploreRequest,
    OptimiseRequest,
    SensitivityRequest,
    SweepRequest,
    ToleranceRequest,
)
from flexstage.studies.explore.variables import Variable
from flexstage.web.design.state import Cached, Variant
from flexstage.web.explore.stage_summary import StageSummary
from flexstage.web.explore.work import StudyDefinition
from flexstage.web.jobs import BackgroundJob

#: What can be done, by the command that does it, and what the button says.
KINDS = {kind.job(): kind.job().capitalize() for kind in get_args(ExploreRequest)}


@dataclass
class RangeInput:
    """A parameter and its bounds, which are 30 % to either side where none are given."""

    name: str
    """The parameter."""
    low: float | None = None
    """Least value [SI]."""
    high: float | None = None
    """Greatest value [SI]."""
    count: int | None = None
    """Number of values on a grid."""
    is_chosen: bool = True
    """Whether it is varied."""

    def bounds(self, variable: Variable) -> tuple[float, float]:
        """Return both bounds [SI]."""
        low = variable.low if self.low is None else self.low
        return low, variable.high if self.high is None else self.high

    def variable(self, facts: StageSummary) -> Variable:
        """Return the parameter with these bounds."""
        variable = facts.variables[self.name]
        low, high = self.bounds(variable)
        return replace(variable, low=low, high=high, count=self.count)


@dataclass
class RequirementInput:
    """What is required of a figure, or sought of it."""

    figure: str
    """Name of the figure."""
    sign: str
    """How it is to its value: >=, <= or =; or maximise, minimise, match."""
    value: float | None = None
    """The value, in the unit of the quantity."""

    @classmethod
    def of(cls, requirement: Requirement) -> "RequirementInput":
        """Return a requirement in words."""
        sign = ">=" if requirement.low is not None else "<="
        value = requirement.high if requirement.low is None else requirement.low
        return cls(requirement.figure.name, sign, value)

    def requirement(self, facts: StageSummary) -> Requirement:
        """Return it as a requirement."""
        if self.value is None:
            raise ModelError(f"say which value {self.figure} shall have")
        return bounded(facts.figures[self.figure], self.sign, self.value)


@dataclass
class ExploreForm:
    """What a form holds: what is asked for, and beside it what may not be whole yet."""

    request: ExploreRequest
    """What is asked for, without the rows."""
    of: list[str] = field(default_factory=list)
    """Names of the figures that are looked at."""
    over: list[RangeInput] = field(default_factory=list)
    """What is varied, or may be."""
    goals: list[RequirementInput] = field(default_factory=list)
    """What is sought."""
    limits: list[RequirementInput] = field(default_factory=list)
    """What is required."""
    wrong: dict[str, FlexstageError] = field(default_factory=dict)
    """Why fields of the request do not have the value that stands in the form."""

    @property
    def chosen(self) -> list[RangeInput]:
        """What is varied."""
        return [row for row in self.over if row.is_chosen]

    def take(self, name: str, value: Any) -> None:
        """Take another value of a field of the request."""
        self.wrong.pop(name, None)
        try:
            self.request = replace(self.request, **{name: value})
        except FlexstageError as error:
            self.wrong[name] = error

    def whole(self, facts: StageSummary) -> ExploreRequest:
        """Return what is asked for, with the rows; what is missing is refused."""
        for error in self.wrong.values():
            raise error
        request, rows = self.request, self.chosen
        over = tuple(row.variable(facts) for row in rows)
        limits = tuple(row.requirement(facts) for row in self.limits)
        match request:
            case OptimiseRequest():
                if not rows:
                    raise ModelError("choose at least one parameter that may change")
                usual = {row.name for row in rows} == facts.flexure and all(
                    row.low is None and row.high is None for row in rows
                )
                return replace(
                    request,
                    maximise=tuple(g.figure for g in self.goals if g.sign == "maximise"),
                    minimise=tuple(g.figure for g in self.goals if g.sign == "minimise"),
                    match=tuple(g.requirement(facts) for g in self.goals if g.sign == "match"),
                    keep=limits,
                    over=() if usual else over,
                )
            case SweepRequest():
                if not rows:
                    raise ModelError(nothing_varied(facts.template))
                request = replace(request, over=over)
            case ToleranceRequest():
                request = replace(request, require=limits)
            case SensitivityRequest():
                pass
        if not self.of:
            raise ModelError("choose at least one figure to look at")
        # those that are looked at first need not be said
        return replace(request, of=() if tuple(self.of) == facts.usual else tuple(self.of))


def default_forms(facts: StageSummary) -> dict[str, ExploreForm]:
    """Return the forms as they are filled at first: a first run is one press."""
    usual = facts.usual
    required = [r for r in facts.required if r.figure.name in facts.of_lots]
    return {
        "sweep": ExploreForm(
            SweepRequest(), of=[*usual], over=[RangeInput(facts.neck)] if facts.neck else []
        ),
        "optimise": ExploreForm(
            OptimiseRequest(model="lumped"),
            goals=[RequirementInput(facts.frequency, "maximise")],
            over=[RangeInput(n, is_chosen=n in facts.flexure) for n in facts.variables],
        ),
        "tolerance": ExploreForm(
            ToleranceRequest(model="lumped"),
            of=[*usual],
            limits=[RequirementInput.of(r) for r in required],
        ),
        "sensitivity": ExploreForm(SensitivityRequest(), of=[*usual]),
    }


@dataclass
class Run:
    """Something that was started, and how it is looked at."""

    variant: Variant
    """The stage."""
    facts: StageSummary
    """What is known of it."""
    request: ExploreRequest
    """What was asked for."""
    folder: Path
    """Where its files lie."""
    job: BackgroundJob
    """The work."""
    question: StudyDefinition = None
    """What a sweep or an optimisation is about."""
    chart: str = ""
    """Kind of the chart; the usual one where it is empty."""
    across: str = ""
    """Column across."""
    up: str = ""
    """Column upwards."""
    sort: str = ""
    """Column by which the table is ordered."""
    descending: bool = False
    """Whether the largest stands first."""
    page: int = 0
    """Which part of the table is shown."""
    picked: int | None = None
    """The row that was picked."""

    def values(self, picked: dict[str, float]) -> Variant:
        """Return the stage with the parameters of a point."""
        variant = self.variant
        usual = {p.name: p.value for p in variant.template.parameters}
        for name, value in picked.items():
            variant = variant.changed(name, value, usual[name])
        return variant


@dataclass
class ExploreState:
    """What one person has open in the view Explore."""

    kind: str = "sweep"
    """One of `KINDS`."""
    facts: Cached[StageSummary] = field(default_factory=Cached)
    """What is known of each stage."""
    forms: dict[str, ExploreForm] = field(default_factory=dict)
    """The forms of the stage at hand, by what they are for."""
    forms_of: Variant | None = None
    """The stage that the forms were filled for."""
    runs: dict[str, Run] = field(default_factory=dict)
    """What was started last, of each kind."""

    @property
    def form(self) -> ExploreForm:
        """The form that is shown."""
        return self.forms[self.kind]

    def fit(self, variant: Variant, facts: StageSummary) -> None:
        """Fill the forms anew where another stage is at hand; one that was changed keeps them."""
        if self.forms_of is None or self.forms_of.template != variant.template:
            self.forms = default_forms(facts)
        self.forms_of = variant
