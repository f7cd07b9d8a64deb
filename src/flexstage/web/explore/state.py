"""What one person has open in the view Explore: the forms, and what was found by each."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from flexstage.errors import ModelError
from flexstage.explore.figures import Requirement, bounded
from flexstage.explore.prepare import nothing_varied
from flexstage.explore.requests import (
    OptimiseRequest,
    SensitivityRequest,
    SweepRequest,
    ToleranceRequest,
)
from flexstage.explore.variables import Variable
from flexstage.files.request import Request
from flexstage.studies.requests import ModelName
from flexstage.web.design.state import Remembered, Variant
from flexstage.web.explore.facts import StageFacts
from flexstage.web.explore.work import Question
from flexstage.web.jobs import BackgroundJob

#: What can be done, and what the button says.
KINDS = {
    "sweep": "Sweep",
    "optimise": "Optimise",
    "tolerance": "Tolerance",
    "sensitivity": "Sensitivity",
}


@dataclass
class RangeWords:
    """A parameter and its bounds, which are 30 % to either side where none are given."""

    name: str
    """The parameter."""
    low: float | None = None
    """Least value [SI]."""
    high: float | None = None
    """Greatest value [SI]."""
    count: int | None = None
    """Number of values on a grid."""

    def bounds(self, variable: Variable) -> tuple[float, float]:
        """Return both bounds [SI]."""
        low = variable.low if self.low is None else self.low
        return low, variable.high if self.high is None else self.high

    def variable(self, variable: Variable) -> Variable:
        """Return the parameter with these bounds."""
        low, high = self.bounds(variable)
        return replace(variable, low=low, high=high, count=self.count)


@dataclass
class LimitWords:
    """What is required of a figure, or sought of it."""

    figure: str
    """Name of the figure."""
    sign: str
    """How it is to its value: >=, <= or =; or maximise, minimise, reach."""
    value: float | None = None
    """The value, in the unit of the quantity."""

    @classmethod
    def of(cls, requirement: Requirement) -> "LimitWords":
        """Return a requirement in words."""
        sign = ">=" if requirement.low is not None else "<="
        value = requirement.high if requirement.low is None else requirement.low
        return cls(requirement.figure.name, sign, value)

    def requirement(self, facts: StageFacts) -> Requirement:
        """Return it as a requirement."""
        if self.value is None:
            raise ModelError(f"say which value {self.figure} shall have")
        return bounded(facts.figures[self.figure], self.sign, self.value)


@dataclass
class SweepForm:
    """What the form of a sweep holds."""

    over: list[RangeWords]
    """What is varied."""
    of: list[str]
    """Figures."""
    samples: int | None = None
    """Number of points; of a grid those of each parameter count."""
    model: ModelName = "lumped"
    """The model."""

    def request(self, facts: StageFacts) -> SweepRequest:
        """Return what is asked for."""
        if not self.over:
            raise ModelError(nothing_varied(facts.template))
        return SweepRequest(
            over=tuple(row.variable(facts.variables[row.name]) for row in self.over),
            of=_unusual(self.of, facts),
            samples=self.samples if len(self.over) > 2 else None,
            model=self.model,
        )


@dataclass
class OptimiseForm:
    """What the form of an optimisation holds."""

    goals: list[LimitWords]
    """What is sought."""
    required: list[str]
    """Names of what is required unasked."""
    keep: list[LimitWords]
    """What is required besides."""
    over: list[str]
    """Names of what is varied."""
    bounds: dict[str, RangeWords] = field(default_factory=dict)
    """Bounds that were changed."""
    start: Literal["described", "middle"] = "described"
    """Where the search starts."""
    evaluations: int | None = None
    """Evaluations of the lumped model at most."""
    model: Literal["superelement", "lumped"] = "lumped"
    """The model whose figures count."""

    def request(self, facts: StageFacts) -> OptimiseRequest:
        """Return what is asked for."""
        words = [self.bounds.get(name, RangeWords(name)) for name in self.over]
        if not words:
            raise ModelError("choose at least one parameter that may change")
        usual = set(self.over) == facts.flexure and all(
            w.low is None and w.high is None for w in words
        )
        sought: dict[str, list[LimitWords]] = {}
        for goal in self.goals:
            sought.setdefault(goal.sign, []).append(goal)
        return OptimiseRequest(
            maximise=tuple(goal.figure for goal in sought.get("maximise", ())),
            minimise=tuple(goal.figure for goal in sought.get("minimise", ())),
            match=tuple(goal.requirement(facts) for goal in sought.get("reach", ())),
            keep=tuple(row.requirement(facts) for row in self.keep),
            over=() if usual else tuple(w.variable(facts.variables[w.name]) for w in words),
            without=tuple(name for name in facts.unasked if name not in self.required),
            start=self.start,
            evaluations=self.evaluations,
            model=self.model,
        )


@dataclass
class ToleranceForm:
    """What the form of a tolerance holds."""

    require: list[LimitWords]
    """What a good stage has."""
    of: list[str]
    """Figures."""
    scatter: dict[str, str] = field(default_factory=dict)
    """Standard deviations that were changed, in words."""
    samples: int = 10_000
    """Stages that are drawn."""
    target: float | None = None
    """Yield that is sought [%]."""
    model: Literal["superelement", "lumped"] = "lumped"
    """Model that corrects the lumped one."""

    def request(self, facts: StageFacts) -> ToleranceRequest:
        """Return what is asked for."""
        return ToleranceRequest(
            samples=self.samples,
            scatter=tuple(f"{name}={text}" for name, text in self.scatter.items()),
            require=tuple(row.requirement(facts) for row in self.require),
            of=_unusual(self.of, facts),
            target_yield=self.target / 100.0 if self.target else None,
            model=self.model,
        )


@dataclass
class SensitivityForm:
    """What the form of a sensitivity holds."""

    of: list[str]
    """Figures."""
    hinges: bool = False
    """Whether neck and place of each hinge are taken by themselves."""
    step: float | None = None
    """What lengths change by [m]; 1 % of each where none is given."""
    model: ModelName = "lumped"
    """The model."""

    def request(self, facts: StageFacts) -> SensitivityRequest:
        """Return what is asked for."""
        return SensitivityRequest(
            of=_unusual(self.of, facts), hinges=self.hinges, per=self.step, model=self.model
        )


def _unusual(names: list[str], facts: StageFacts) -> tuple[str, ...]:
    """Return the figures that are named, nothing where they are those that are looked at first."""
    if not names:
        raise ModelError("choose at least one figure to look at")
    return () if tuple(names) == facts.usual else tuple(names)


Form = SweepForm | OptimiseForm | ToleranceForm | SensitivityForm


@dataclass
class Forms:
    """The forms of a stage, by what they are for."""

    sweep: SweepForm
    """That of a sweep."""
    optimise: OptimiseForm
    """That of an optimisation."""
    tolerance: ToleranceForm
    """That of a lot."""
    sensitivity: SensitivityForm
    """That of sensitivities."""

    @classmethod
    def usual(cls, facts: StageFacts) -> "Forms":
        """Return the forms as they are filled at first: a first run is one press."""
        usual = list(facts.usual)
        required = [r for r in facts.required if r.figure.name in facts.of_lots]
        return cls(
            sweep=SweepForm(over=[RangeWords(facts.neck)] if facts.neck else [], of=usual),
            optimise=OptimiseForm(
                goals=[LimitWords(facts.frequency, "maximise")],
                required=list(facts.unasked),
                keep=[],
                over=[name for name in facts.variables if name in facts.flexure],
            ),
            tolerance=ToleranceForm(require=[*map(LimitWords.of, required)], of=usual.copy()),
            sensitivity=SensitivityForm(of=usual.copy()),
        )

    def of(self, kind: str) -> Form:
        """Return the form of a kind."""
        return getattr(self, kind)


@dataclass
class Run:
    """Something that was started, and how it is looked at."""

    variant: Variant
    """The stage."""
    facts: StageFacts
    """What is known of it."""
    request: Request
    """What was asked for."""
    folder: Path
    """Where its files lie."""
    job: BackgroundJob
    """The work."""
    question: Question = None
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
    facts: Remembered[StageFacts] = field(default_factory=Remembered)
    """What is known of each stage."""
    forms: Forms | None = None
    """The forms, of the stage at hand."""
    forms_of: Variant | None = None
    """The stage that the forms were filled for."""
    runs: dict[str, Run] = field(default_factory=dict)
    """What was started last, of each kind."""

    @property
    def form(self) -> Form:
        """The form that is shown."""
        assert self.forms is not None
        return self.forms.of(self.kind)

    def fit(self, variant: Variant, facts: StageFacts) -> None:
        """Fill the forms anew where another stage is at hand; one that was changed keeps them."""
        if (
            self.forms is None
            or self.forms_of is None
            or self.forms_of.template != variant.template
        ):
            self.forms = Forms.usual(facts)
        self.forms_of = variant
