"""What is asked of many stages: a sweep, an optimisation, tolerances, sensitivities."""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from flexstage.files.ranges import Count, Range, Seed, Size, Stated, Written
from flexstage.files.request import Request
from flexstage.system.requests import ModelName

if TYPE_CHECKING:
    from flexstage.studies.explore.figures import Requirement
    from flexstage.studies.explore.variables import Variable
    from flexstage.studies.explore.workers import Workers
else:  # their classes need NumPy, which the help of a command does without
    Requirement = Variable = Stated

#: Names of figures.
_Figures = Annotated[tuple[str, ...], Written("FIGURE")]
#: Parameters with ranges, in words or as they are.
_Ranges = Annotated[tuple[str | Variable, ...], Written("NAME=RANGE")]
#: What is required of figures, in words or as it is.
_Requirements = Annotated[tuple[str | Requirement, ...], Written("REQUIREMENT")]
_YIELD = Range(low=0.0, high=1.0, above=True)
#: How points are spread.
Sampling = Literal["grid", "latin-hypercube", "sobol"]
_Corrected = Literal["superelement", "lumped"]
#: More points or stages than this are more than anybody waits for.
LARGEST = 10_000_000
#: What a length changes by where the hinges are taken by themselves [m].
LENGTH = 10e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerRequest(Request):
    """Who does the work."""

    heading: ClassVar[str] = "Workers"

    workers: Count | None = None
    """Number of processes that share long work (default: one for each core); 1 is this process
    alone. The numbers are the same whatever it is.
    """
    scheduler: Annotated[str, Written("ADDRESS")] | None = None
    """Have a Dask cluster do the work, by the address of its scheduler, such as tls://HOST:8786."""

    def open(self) -> "AbstractContextManager[Workers]":
        """Return the workers, for a `with` block."""
        from flexstage.studies.explore.workers import open_workers

        return open_workers(self.workers, self.scheduler)


#: None of them given.
USUAL_WORKERS = WorkerRequest()


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepRequest(Request):
    """A sweep: figures of a stage over its parameters."""

    over: _Ranges = ()
    """A parameter and its range, such as leg_neck="0.3..0.8 mm", with /6 behind it for six values;
    or "x.*=20 %", every parameter of such a name by 20 % to either side.
    """
    of: _Figures = ()
    """A figure, such as natural_frequency.x, stroke (of every axis) or mass (default: ratio,
    stroke, frequency, stress and coupling of each axis).
    """
    plan: Sampling | None = None
    """How points are spread: on a grid, as a Latin hypercube, or as a Sobol' sequence (default: a
    grid of one or two parameters, a sequence of more).
    """
    samples: Annotated[int, Range(low=1, high=LARGEST)] | None = None
    """Number of points; a grid has at most so many, a Sobol' sequence the next power of 2. With
    --indices the number of base samples, each of which takes as many points as there are parameters
    and two more.
    """
    seed: Seed = 0
    """Seed of Latin hypercube and Sobol' sequence."""
    indices: bool = False
    """Estimate Sobol' indices: which parameter has which share in the variation of each figure."""
    model: ModelName = "lumped"
    """The model."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimiseRequest(Request):
    """An optimisation: the best dimensions, or those of stated figures."""

    maximise: _Figures = ()
    """A figure to make as large as possible, such as natural_frequency.x; several goals, with
    --minimise, give a Pareto front.
    """
    minimise: _Figures = ()
    """A figure to make as small as possible, such as mass."""
    keep: _Requirements = ()
    """What is required, such as "stroke.x >= 60 um", "stress.x <= 200 MPa" or "ratio.x = 1.7 +-
    1 %"; smallest_slot, stroke_left, drive_force and buckling_factor take up to half of the time
    again, each.
    """
    match: Annotated[tuple[str | Requirement, ...], Written("VALUE")] = ()
    """A figure to reach, such as "natural_frequency.x = 320 Hz", by the dimensions nearest to the
    start; or published, for the finite-element figures published of STAGE.
    """
    over: _Ranges = ()
    """A parameter and its bounds, such as leg_neck="0.3..0.8 mm"; or "x.*=20 %", every parameter of
    such a name by 20 % to either side (default: every dimension by 30 %, but nothing of bought
    parts and bolts, and not the thickness of the plate).
    """
    without: Annotated[tuple[str, ...], Written("NAME")] = ()
    """What is required without being asked, and shall not be here: check (what can be made), stroke
    (90 % of that as described), safety_factor (1.5 against yield), input_stiffness (no stiffer than
    the actuator, and full stroke within its blocking force), smallest_wall (1 mm of any body) or
    output_wall (3.3 mm of the body that moves the load; both no more than the stage has).
    """
    start: Literal["described", "middle"] = "described"
    """Start from the stage as it is described, or from the middle of the bounds, which is the same
    for bounds in per cent.
    """
    model: _Corrected = "superelement"
    """The model whose figures count; the lumped one alone is quick, and some per cent off."""
    confirm: Literal["plane", "superelement-3d", "solid"] | None = None
    """Have a finer model confirm the best stage, and correct it up to three times."""
    evaluations: Count | None = None
    """Evaluations of the lumped model at most (default: 250 for each parameter and two more)."""
    seed: Seed = 0
    """Random seed of the starts, and of the front."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensitivityRequest(Request):
    """Sensitivities: which parameter of a stage moves which figure."""

    of: _Figures = ()
    """A figure, such as natural_frequency.x, stroke (of every axis) or mass (default: ratio,
    stroke, frequency, stress and coupling of each axis).
    """
    by: Annotated[tuple[str, ...], Written("NAME")] = ()
    """A parameter, or a pattern of names such as "x.*" (default: all that change continuously)."""
    hinges: bool = False
    """Take neck and place of each hinge by itself in place of the parameters; those that do the
    same share a row.
    """
    per: Size | None = None
    """Have lengths change by so much, such as "10 um", in place of 1 % of each (default with
    --hinges: 10 um).
    """
    model: ModelName = "lumped"
    """The model."""

    @property
    def length(self) -> float | None:
        """What lengths change by [m]; None for a share of each."""
        return LENGTH if self.per is None and self.hinges else self.per


@dataclass(frozen=True, slots=True, kw_only=True)
class ToleranceRequest(Request):
    """Tolerances: what the workshop makes of a stage."""

    samples: Annotated[int, Range(low=2, high=LARGEST)] = 10_000
    """Number of stages that are drawn."""
    seed: Seed = 0
    """Random seed; a stage of the lot is the same whatever their number."""
    scatter: Annotated[tuple[str, ...], Written("NAME=SIZE")] = ()
    """Standard deviation of a deviation, such as neck_own="1 um" or modulus="0.5 %"; a pattern is
    for several ("*=0"). Names: neck_common, neck_own, radius, position, thickness, modulus,
    density, temperature, stroke, drive (default: the usual scatter of wire erosion).
    """
    require: _Requirements = ()
    """What a good stage has, such as "natural_frequency.x >= 300 Hz" or "ratio.x = 1.7 +- 1 %"."""
    of: _Figures = ()
    """A figure, such as natural_frequency.x, stress (of every axis) or mass (default: ratio,
    stroke, frequency, stress and coupling of each axis).
    """
    target_yield: Annotated[float, _YIELD, Written("SHARE")] | None = None
    """Find the cheapest scatter by which so many stages are good, such as "99 %"."""
    cost: Annotated[tuple[str, ...], Written("NAME=WEIGHT")] = ()
    """Weight of the cost of a tolerance for --target-yield (default: 1 of each)."""
    model: _Corrected = "superelement"
    """Model whose figures of the drawing correct those of the lumped one, which follows the
    samples; lumped for none.
    """
    follow_necks: bool = False
    """Have that model say as well how figures follow an offset of all necks: two more analyses,
    each of notches that it has not met.
    """


#: What can be asked of many stages.
ExploreRequest = SweepRequest | OptimiseRequest | ToleranceRequest | SensitivityRequest
