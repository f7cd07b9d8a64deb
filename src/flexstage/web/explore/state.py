"""State of the view Explore in one browser: the stage, the forms, the last run of each kind."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, get_args

from flexstage.base.errors import FlexstageError, ModelError
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.family import batched_figures, known_figures
from flexstage.studies.explore.figures import Figure, Requirement, bounded, default_figures
from flexstage.studies.explore.optimise.default_requirements import (
    CHECK,
    default_requirements,
    default_variables,
)
from flexstage.studies.explore.prepare import nothing_varied
from flexstage.studies.explore.requests import (
    ExploreRequest,
    OptimiseRequest,
    SensitivityRequest,
    SweepRequest,
    ToleranceRequest,
)
from flexstage.studies.explore.variables import Variable, every_variable
from flexstage.web.design.state import SHARE, Cached, Variant
from flexstage.web.explore.work import StudyDefinition
from flexstage.web.jobs import BackgroundJob


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


#: Kinds of runs, by the name of their command, with the label of the button.
KINDS = {kind.job(): kind.job().capitalize() for kind in get_args(ExploreRequest)}


@dataclass
class RangeInput:
    """A parameter and its bounds in a form; a bound that is None has the default."""

    name: str
    """Name of the parameter."""
    low: float | None = None
    """Lower bound [SI]; by default 30 % below the value of the stage."""
    high: float | None = None
    """Upper bound [SI]; by default 30 % above the value of the stage."""
    count: int | None = None
    """Number of values on a grid."""
    is_varied: bool = True
    """The parameter is varied."""

    def bounds(self, variable: Variable) -> tuple[float, float]:
        """Return both bounds [SI]."""
        low = variable.low if self.low is None else self.low
        return low, variable.high if self.high is None else self.high

    def variable(self, summary: StageSummary) -> Variable:
        """Return the parameter with these bounds."""
        variable = summary.variables[self.name]
        low, high = self.bounds(variable)
        return replace(variable, low=low, high=high, count=self.count)


@dataclass
class RequirementInput:
    """A requirement on a figure, or a goal, in a form."""

    figure: str
    """Name of the figure."""
    relation: str
    """Relation to the value: >=, <= or =; of a goal maximise, minimise or match."""
    value: float | None = None
    """The value, in the unit of the quantity."""

    @classmethod
    def of(cls, requirement: Requirement) -> "RequirementInput":
        """Return the input for a requirement."""
        relation = ">=" if requirement.low is not None else "<="
        value = requirement.high if requirement.low is None else requirement.low
        return cls(requirement.figure.name, relation, value)

    def requirement(self, summary: StageSummary) -> Requirement:
        """Return the requirement."""
        if self.value is None:
            raise ModelError(f"{self.figure} needs a value: enter one, or remove the row")
        return bounded(summary.figures[self.figure], self.relation, self.value)


@dataclass
class ExploreForm:
    """Contents of a form: a request, and the rows that it is completed with."""

    request: ExploreRequest
    """The request without figures, ranges, goals and requirements."""
    figures: list[str] = field(default_factory=list)
    """Names of the figures in the result."""
    ranges: list[RangeInput] = field(default_factory=list)
    """Parameters that are varied, or can be."""
    goals: list[RequirementInput] = field(default_factory=list)
    """Goals of an optimisation."""
    requirements: list[RequirementInput] = field(default_factory=list)
    """Requirements on the figures."""
    errors: dict[str, FlexstageError] = field(default_factory=dict)
    """Errors of the fields whose text in the form is invalid."""

    @property
    def varied(self) -> list[RangeInput]:
        """Parameters that are varied."""
        return [row for row in self.ranges if row.is_varied]

    def assign(self, name: str, value: Any) -> None:
        """Assign a value to a field of the request."""
        self.errors.pop(name, None)
        try:
            self.request = replace(self.request, **{name: value})
        except FlexstageError as error:
            self.errors[name] = error

    def complete_request(self, summary: StageSummary) -> ExploreRequest:
        """Return the request with the rows of the form.

        Raises
        ------
        FlexstageError
            A field is invalid, or an input is missing.
        """
        for error in self.errors.values():
            raise error
        if isinstance(self.request, OptimiseRequest):
            return self._optimisation(self.request, summary)
        request = self.request
        ranges = tuple(row.variable(summary) for row in self.varied)
        requirements = self._requirements(summary)
        if isinstance(request, SweepRequest):
            if not ranges:
                raise ModelError(nothing_varied(summary.template))
            request = replace(request, over=ranges)
        elif isinstance(request, ToleranceRequest):
            request = replace(request, require=requirements)
        if not self.figures:
            raise ModelError("choose at least one figure")
        is_default = tuple(self.figures) == summary.default_figures
        return replace(request, of=() if is_default else tuple(self.figures))

    def _optimisation(self, request: OptimiseRequest, summary: StageSummary) -> OptimiseRequest:
        rows = self.varied
        ranges = tuple(row.variable(summary) for row in rows)
        requirements = self._requirements(summary)
        if not rows:
            raise ModelError("choose at least one parameter to vary")
        is_default = {row.name for row in rows} == summary.flexure and all(
            row.low is None and row.high is None for row in rows
        )
        return replace(
            request,
            maximise=tuple(g.figure for g in self.goals if g.relation == "maximise"),
            minimise=tuple(g.figure for g in self.goals if g.relation == "minimise"),
            match=tuple(g.requirement(summary) for g in self.goals if g.relation == "match"),
            keep=requirements,
            over=() if is_default else ranges,
        )

    def _requirements(self, summary: StageSummary) -> tuple[Requirement, ...]:
        return tuple(row.requirement(summary) for row in self.requirements)


def default_forms(summary: StageSummary) -> dict[str, ExploreForm]:
    """Return the forms with defaults for a stage, so that one press starts a run."""
    figures = summary.default_figures
    required = [r for r in summary.requirements if r.figure.name in summary.tolerance_figures]
    return {
        "sweep": ExploreForm(
            SweepRequest(),
            figures=[*figures],
            ranges=[RangeInput(summary.neck)] if summary.neck else [],
        ),
        "optimise": ExploreForm(
            OptimiseRequest(model="lumped"),
            goals=[RequirementInput(summary.frequency, "maximise")],
            ranges=[RangeInput(n, is_varied=n in summary.flexure) for n in summary.variables],
        ),
        "tolerance": ExploreForm(
            ToleranceRequest(model="lumped"),
            figures=[*figures],
            requirements=[RequirementInput.of(r) for r in required],
        ),
        "sensitivity": ExploreForm(SensitivityRequest(), figures=[*figures]),
    }


@dataclass
class ExploreRun:
    """A run, and the display of its results."""

    variant: Variant
    """The stage."""
    summary: StageSummary
    """Parameters and figures of the stage."""
    request: ExploreRequest
    """The request."""
    folder: Path
    """Folder of its files."""
    job: BackgroundJob
    """The job that computes it."""
    definition: StudyDefinition = None
    """Family, figures and points of a sweep, or the problem of an optimisation."""
    chart: str = ""
    """Kind of the chart; empty for the default."""
    x_column: str = ""
    """Column of the x axis."""
    y_column: str = ""
    """Column of the y axis."""
    sort_column: str = ""
    """Column by which the table is ordered."""
    descending: bool = False
    """The largest value comes first."""
    page: int = 0
    """Page of the table."""
    selected_row: int | None = None
    """The selected row."""

    def variant_at(self, parameters: dict[str, float]) -> Variant:
        """Return the stage with the parameters of a point [SI]."""
        variant = self.variant
        nominal = {p.name: p.value for p in variant.template.parameters}
        for name, value in parameters.items():
            variant = variant.changed(name, value, nominal[name])
        return variant


@dataclass
class ExploreState:
    """State of the view Explore in one browser."""

    kind: str = "sweep"
    """One of `KINDS`."""
    summaries: Cached[StageSummary] = field(default_factory=Cached)
    """Parameters and figures of the last stages."""
    forms: dict[str, ExploreForm] = field(default_factory=dict)
    """Forms of the open stage, by kind."""
    form_variant: Variant | None = None
    """The stage of the forms."""
    runs: dict[str, ExploreRun] = field(default_factory=dict)
    """The last run of each kind."""

    @property
    def form(self) -> ExploreForm:
        """The form of the selected kind."""
        return self.forms[self.kind]

    def open_stage(self, variant: Variant, summary: StageSummary) -> None:
        """Fill the forms with defaults for another stage; a changed variant keeps its forms."""
        if self.form_variant is None or self.form_variant.template != variant.template:
            self.forms = default_forms(summary)
        self.form_variant = variant
