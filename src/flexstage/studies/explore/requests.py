"""Requests of parameter studies: sweep, optimisation, tolerance, sensitivity, reconstruction."""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from flexstage.files.ranges import POSITIVE, Count, Range, Seed, Size, Stated, Written
from flexstage.files.request import Request
from flexstage.quantities.units import Time
from flexstage.system.requests import ModelName

if TYPE_CHECKING:
    from flexstage.studies.explore.figures import Requirement
    from flexstage.studies.explore.variables import Variable
    from flexstage.studies.explore.workers import Workers
else:  # their classes need NumPy, which the help of a command does not import
    Requirement = Variable = Stated

#: Names of figures.
_Figures = Annotated[tuple[str, ...], Written("FIGURE")]
#: Parameters with ranges, as texts or objects.
_Ranges = Annotated[tuple[str | Variable, ...], Written("NAME=RANGE")]
#: Requirements on figures, as texts or objects.
_Requirements = Annotated[tuple[str | Requirement, ...], Written("REQUIREMENT")]
_YIELD = Range(low=0.0, high=1.0, above=True)
#: Kinds of sampling plans.
Sampling = Literal["grid", "latin-hypercube", "sobol"]
_Corrected = Literal["superelement", "lumped"]
#: Largest number of points or samples.
LARGEST = 10_000_000
#: Default change of a length for sensitivities of single hinges [m].
LENGTH = 10e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerRequest(Request):
    """Worker processes of a parameter study."""

    heading: ClassVar[str] = "Workers"

    workers: Count | None = None
    """Number of processes for long computations (default: one for each core); 1 is this process
    alone. The results do not depend on it.
    """
    scheduler: Annotated[str, Written("ADDRESS")] | None = None
    """Compute on a Dask cluster; address of its scheduler, such as tls://HOST:8786."""

    def open(self) -> "AbstractContextManager[Workers]":
        """Return the workers as a context manager."""
        from flexstage.studies.explore.workers import open_workers

        return open_workers(self.workers, self.scheduler)


#: Default worker processes.
USUAL_WORKERS = WorkerRequest()


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepRequest(Request):
    """Parameter sweep: figures of a stage over its parameters."""

    over: _Ranges = ()
    """A parameter and its range, such as leg_neck="0.3..0.8 mm", followed by /6 for six values; or
    "x.*=20 %", all parameters whose names match, by 20 % to either side.
    """
    of: _Figures = ()
    """Figure, such as natural_frequency.x, stroke (of every axis) or mass (default: ratio, stroke,
    frequency, stress and coupling of each axis).
    """
    plan: Sampling | None = None
    """Sampling plan: grid, Latin hypercube or Sobol' sequence (default: a grid for one or two
    parameters, a Sobol' sequence for more).
    """
    samples: Annotated[int, Range(low=1, high=LARGEST)] | None = None
    """Number of points: the upper limit for a grid, rounded up to a power of 2 for a Sobol'
    sequence. With --indices the number of base samples, each with two points more than parameters.
    """
    seed: Seed = 0
    """Random seed of Latin hypercube and Sobol' sequence."""
    indices: bool = False
    """Estimate Sobol' indices: the share of each parameter in the variance of each figure."""
    environment: Path | None = None
    """Description of disturbances in YAML, as of budget: the figure rms of each axis, without
    position control.
    """
    model: ModelName = "lumped"
    """Model of the figures."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimiseRequest(Request):
    """Optimisation: dimensions that optimise a figure subject to constraints, or match values."""

    maximise: _Figures = ()
    """Figure to maximise, such as natural_frequency.x; several goals, also with --minimise, give a
    Pareto front.
    """
    minimise: _Figures = ()
    """Figure to minimise, such as mass."""
    keep: _Requirements = ()
    """Constraint, such as "stroke.x >= 60 um", "stress.x <= 200 MPa" or "ratio.x = 1.7 +- 1 %".
    Each of smallest_slot, stroke_left, drive_force and buckling_factor adds up to half of the
    computing time.
    """
    for_: Annotated[str, Written("TABLE")] | None = None
    """Description of a rotary table (YAML), whose needs of stroke, step, size and mass are further
    constraints; flexstage scale judges the result.
    """
    match: Annotated[tuple[str | Requirement, ...], Written("VALUE")] = ()
    """Value to match, such as "natural_frequency.x = 320 Hz", by the smallest change of dimensions;
    or published, for the published finite-element values of STAGE.
    """
    over: _Ranges = ()
    """A parameter and its bounds, such as leg_neck="0.3..0.8 mm"; or "x.*=20 %", all parameters
    whose names match, by 20 % to either side (default: all dimensions by 30 %, except those of
    bought parts and bolts, and the plate thickness).
    """
    without: Annotated[tuple[str, ...], Written("NAME")] = ()
    """Disable a default constraint: check (manufacturability), stroke (90 % of the described one),
    safety_factor (1.5 against yield), input_stiffness (at most that of the actuator, full stroke
    within its blocking force), smallest_wall (1 mm in every body) or output_wall (3.3 mm in the
    body that moves the load; if the described stage has less, that is the limit).
    """
    environment: Path | None = None
    """Description of disturbances in YAML, as of budget: the figure rms of each axis, without
    position control.
    """
    start: Literal["described", "middle"] = "described"
    """Start from the described stage, or from the middle of the bounds (the same for bounds in per
    cent).
    """
    model: _Corrected = "superelement"
    """Model of the figures: superelement, or lumped (fast, within a few per cent)."""
    confirm: Literal["plane", "superelement-3d", "solid"] | None = None
    """Confirm the optimum by a finer model, which corrects it up to three times."""
    evaluations: Count | None = None
    """Largest number of evaluations of the lumped model (default: 250 per parameter, plus 500)."""
    seed: Seed = 0
    """Random seed of starts and Pareto front."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReconstructRequest(Request):
    """Reconstruction: what given figures tell of the dimensions and other figures of a stage."""

    match: Annotated[tuple[str | Requirement, ...], Written("VALUE")] = ()
    """Given figure with its standard uncertainty, such as "natural_frequency.x = 320 Hz +- 2 Hz";
    or published, the published finite-element values of STAGE (default: published). The error of
    the model is added: 1 % of a stress, nothing of mass and geometry, 0.5 % of other figures.
    """
    free: _Ranges = ()
    """A free dimension and one standard deviation to either side before, such as
    leg_neck="0.4..0.6 mm", about its geometric mean; or "x.*=20 %", all parameters whose names
    match, about their values (default: all dimensions by 20 %, except those of bought parts and
    bolts).
    """
    members: Annotated[int, Range(low=0, high=10_000)] = 60
    """Number of stages of the ensemble; 0 for the linear estimate alone."""
    time_limit: Annotated[Time, POSITIVE] = 120.0
    """Time after which no more members are computed, so that their number depends on the speed of
    the computer; the linear estimate before them is not in it.
    """
    model: _Corrected = "superelement"
    """Model of the figures: superelement, or lumped (fast, without motion across and drift; its
    ranges leave out what rigid bodies leave out, tens of per cent of output stiffness and sag).
    """
    seed: Seed = 0
    """Random seed of the members."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensitivityRequest(Request):
    """Sensitivity analysis: influence of the parameters of a stage on its figures."""

    of: _Figures = ()
    """Figure, such as natural_frequency.x, stroke (of every axis) or mass (default: ratio, stroke,
    frequency, stress and coupling of each axis).
    """
    by: Annotated[tuple[str, ...], Written("NAME")] = ()
    """Parameter, or pattern of names such as "x.*" (default: all continuous parameters)."""
    hinges: bool = False
    """Vary neck thickness and position of each hinge instead of the parameters; equivalent hinges
    share a row.
    """
    per: Size | None = None
    """Change of each length, such as "10 um", instead of 1 % (default with --hinges: 10 um)."""
    model: ModelName = "lumped"
    """Model of the figures."""

    @property
    def length(self) -> float | None:
        """Change of lengths [m]; None for a share of each."""
        return LENGTH if self.per is None and self.hinges else self.per


@dataclass(frozen=True, slots=True, kw_only=True)
class ToleranceRequest(Request):
    """Monte Carlo tolerance analysis: scatter and yield of manufactured stages."""

    samples: Annotated[int, Range(low=2, high=LARGEST)] = 10_000
    """Number of simulated stages."""
    seed: Seed = 0
    """Random seed; a sample does not depend on the number of samples."""
    scatter: Annotated[tuple[str, ...], Written("NAME=SIZE")] = ()
    """Standard deviation of a deviation, such as neck_own="1 um" or modulus="0.5 %"; a pattern sets
    several ("*=0"). Names: neck_common, neck_own, radius, position, thickness, modulus, density,
    temperature, stroke, drive (default: typical scatter of wire erosion).
    """
    widths: Annotated[str, Written("FILE")] | None = None
    """Measured necks (columns hinge or drawn, measured, and part): their bias and scatter."""
    require: _Requirements = ()
    """Requirement on a good stage, such as "stroke.x >= 60 um" or "ratio.x = 1.7 +- 1 %"."""
    of: _Figures = ()
    """Figure, such as natural_frequency.x, stress (of every axis) or mass (default: ratio, stroke,
    frequency, stress and coupling of each axis).
    """
    environment: Path | None = None
    """Description of disturbances in YAML, as of budget: the figure rms of each axis, without
    position control.
    """
    target_yield: Annotated[float, _YIELD, Written("SHARE")] | None = None
    """Find the cheapest scatter with this yield, such as "99 %"."""
    cost: Annotated[tuple[str, ...], Written("NAME=WEIGHT")] = ()
    """Weight of the cost of a tolerance for --target-yield (default: 1 for each)."""
    model: _Corrected = "superelement"
    """Model whose nominal figures correct those of the lumped model of the samples; lumped for no
    correction.
    """
    follow_necks: bool = False
    """Correct the effect of a common offset of all necks as well, by two more analyses with that
    model, each with new notches.
    """


#: Requests of parameter studies.
ExploreRequest = SweepRequest | OptimiseRequest | ToleranceRequest | SensitivityRequest
