"""Monte Carlo tolerance analysis: scatter of figures, yield, and contributions to the variance."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.progress import hand_over, subtask
from flexstage.base.provenance import Provenance, provenance
from flexstage.base.short_repr import short_repr
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.hinges.registry import with_neck_thickness
from flexstage.stage import Stage
from flexstage.studies.explore.batches import Job, batch_size
from flexstage.studies.explore.deviations import KINDS, active_kinds, draw, flat, parts
from flexstage.studies.explore.family import batched_figures, stage_figures
from flexstage.studies.explore.figures import NOISE_FIGURES, Figure, Requirement
from flexstage.studies.explore.manufactured_samples import (
    THINNEST,
    TOLERANCE,
    Process,
    process_of,
    sample_figures,
)
from flexstage.studies.explore.spread import (
    Shares,
    Spread,
    Yield,
    shares_of,
    spread_of,
    yield_of,
)
from flexstage.studies.explore.sweep import typical_seconds
from flexstage.studies.explore.workers import Workers
from flexstage.studies.models import analyse_model
from flexstage.system.environment import Environment
from flexstage.virtual.imperfections import Scatter

#: Samples of a batch, for a computing time of a few tenths of a second.
BATCH = 2500
#: Largest number of samples for the shares of the variance: enough for two digits.
FITTED = 20_000

# step of the neck thickness for the derivative by another model, in standard deviations: small
# steps are affected by mesh and iteration
_STEP = 2.0
# quantities that depend on the stress peak of a mesh
_OF_STRESS = ("max_stress", "safety_factor", "fatigue_safety")

#: Assumptions of the analysis.
VALIDITY: tuple[str, ...] = (
    "The lumped model gives the changes of figures between samples. Compared with superelement "
    "analyses of other necks, its changes of frequencies are within a few per cent of their "
    "scatter. It gives a third to a half of the effect of necks on ratio and stroke, which is a "
    "few tenths of a per cent, and none of that on the coupling, which is bending of bodies "
    "(--follow-necks corrects it).",
    "Deviations are normal and independent, except for the common part of all necks.",
    "Outlines of bodies, positions of notch ends, and Poisson's ratio are nominal. A wire offset "
    "changes the necks alone: the removed mass of the outlines would compensate for 2 to 5 % of "
    "its effect on frequencies.",
    "Temperature expands the plate; Young's modulus and drives do not depend on it.",
    "The plane model includes neither tilt of notches nor out-of-plane offsets of drives.",
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MonteCarloSamples:
    """Manufactured samples of a stage, and the figures to compute."""

    process: Process
    """The nominal stage with its scatter."""
    seed: int
    """Seed of the random numbers."""
    figures: tuple[Figure, ...]
    """The figures."""
    factor: Array
    """Factor on each figure of the lumped model [1], shape (figures,)."""
    added: Array
    """Offset of each figure, in its unit, shape (figures,)."""
    per_neck: Array
    """Correction per metre of common neck offset, in the unit of the figure, shape (figures,)."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """The active kinds of deviations."""
        return active_kinds(self.process.stage, self.process.scatter)

    def numbers(self, start: int, stop: int) -> dict[str, Array]:
        """Return the standard normal deviations of samples."""
        return draw(self.process.stage, self.kinds, start, stop, seed=self.seed)

    def nominal(self) -> Array:
        """Return the figures of the nominal stage, shape (figures,)."""
        return self.corrected(sample_figures(self.process, {}, 1, self.figures)[0])[0]

    def values(
        self, samples: int, workers: Workers, keep: Path | None = None
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return the figures of samples, shape (samples, figures), and which are impossible.

        Figures of impossible samples are NaN.
        """
        # stored batches are uncorrected, as a correction may differ in its last bit
        payload = (self.process, self.kinds, self.seed, self.figures)
        # an rms takes as long as a stage of a sweep
        noise = any(figure.quantity in NOISE_FIGURES for figure in self.figures)
        batch = batch_size(samples, typical_seconds("lumped")) if noise else BATCH
        job = Job(name="tolerance", work=_batch, payload=payload, count=samples, batch=batch)
        columns = workers.run(job, keep)
        values = self.corrected(columns["values"])
        if self.per_neck.any():
            stage, scatter = self.process.stage, self.process.scatter
            numbers = draw(stage, ("neck_common",), 0, samples, seed=self.seed)["neck_common"]
            values += scatter.neck_common * numbers[:, :, 0] * self.per_neck
        return np.maximum(values, self._least), columns["impossible"]

    def corrected(self, values: Array) -> Array:
        """Return corrected figures of the lumped model, without the correction for necks."""
        return np.maximum(values * self.factor + self.added, self._least)

    @property
    def _least(self) -> list[float]:
        """Least value of each figure: an rms that an offset corrects is not negative."""
        return [0.0 if f.quantity in NOISE_FIGURES else -math.inf for f in self.figures]


def _batch(
    payload: tuple[Process, tuple[str, ...], int, tuple[Figure, ...]], start: int, stop: int
) -> dict[str, NDArray[Any]]:
    process, kinds, seed, figures = payload
    numbers = draw(process.stage, kinds, start, stop, seed=seed)
    values, impossible = sample_figures(process, numbers, stop - start, figures)
    return {"values": values, "impossible": impossible}


@dataclass(frozen=True, slots=True, kw_only=True)
class ToleranceChoice:
    """The cheapest tolerances with a required yield."""

    target: float
    """Required yield [1]."""
    reached: bool
    """True if the lower end of the interval of the yield reaches the target."""
    initial: Scatter
    """Scatter at the start of the search."""
    selected: Scatter
    """The selected scatter; the finest considered one if none reaches the target."""
    kinds: tuple[str, ...]
    """The varied fields of `Scatter`."""
    cost: float
    """Cost of the selected scatter relative to that of the initial one [1]."""
    before: tuple[Yield, ...]
    """Yields with the initial scatter: of each requirement, then of all together."""
    after: tuple[Yield, ...]
    """Yields with the selected scatter."""
    conclusion: str
    """The result in words."""

    def data(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return {
            **picked(self, "target", "reached", "conclusion", "cost"),
            "scatter": picked(self.selected, *self.kinds),
            "yields": [y.data() for y in self.after],
        }

    @property
    def available(self) -> bool:
        """True if a scatter was selected; False if the nominal stage is not good."""
        return self.reached or self.selected != self.initial

    def factor(self, kind: str) -> float:
        """Return the ratio of selected and initial scatter of a kind [1]."""
        return getattr(self.selected, kind) / getattr(self.initial, kind)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToleranceStudy(Result):
    """Result of a Monte Carlo tolerance analysis."""

    table_key: ClassVar[str] = "figures"

    monte_carlo: MonteCarloSamples
    """The samples."""
    samples: int
    """Number of samples."""
    values: Array
    """Figures of the samples, NaN for impossible ones, shape (samples, figures)."""
    spreads: tuple[Spread, ...]
    """Scatter of each figure."""
    shares: tuple[Shares, ...]
    """Contributions to the variance of each varying figure; empty with too few samples."""
    yields: tuple[Yield, ...]
    """Yield of each requirement, then of all together; empty without requirements."""
    model: str
    """Models of the figures, in words."""
    notes: tuple[str, ...]
    """Remarks on the result."""
    provenance: Provenance
    """Origin of the result."""
    choice: ToleranceChoice | None = None
    """Tolerances with a required yield, if requested."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        data = {
            **picked(self, "stage=stage.name", "samples", "seed=monte_carlo.seed", "model"),
            "scatter": picked(self.scatter, *(kind.name for kind in KINDS)),
            "figures": [spread.data() for spread in self.spreads],
            "variance": [shares.data() for shares in self.shares],
            "yields": [y.data() for y in self.yields],
            **picked(self, "notes", "provenance"),
        }
        return data if self.choice is None else data | {"tighten": self.choice.data()}

    @property
    def stage(self) -> Stage:
        """The nominal stage."""
        return self.monte_carlo.process.stage

    @property
    def scatter(self) -> Scatter:
        """Scatter of the process."""
        return self.monte_carlo.process.scatter

    @property
    def requirements(self) -> tuple[Requirement, ...]:
        """The requirements."""
        return tuple(y.requirement for y in self.yields if y.requirement is not None)


def monte_carlo_of(
    stage: Stage,
    scatter: Scatter,
    figures: Sequence[Figure],
    *,
    seed: int,
    model: str,
    follow_necks: bool = False,
    environment: Environment | None = None,
) -> tuple[MonteCarloSamples, str]:
    """Return the samples of a stage, and the models of their figures in words.

    The model is ``lumped``, or another one corrects its nominal figures: by a factor, or by an
    offset for figures that may be zero: the coupling, or an rms on which the models differ more
    than twofold, as in a direction that the symmetry of the stage keeps at rest. With
    `follow_necks` the other model also gives the effect of a common neck offset, except on stress,
    whose peak on a mesh scatters.

    Raises
    ------
    ModelError
        The scatter is so large that a notch is impossible, or the stage lacks a figure.
    """
    process = process_of(stage, scatter, environment)
    factor, added = np.ones(len(figures)), np.zeros(len(figures))
    per_neck = np.zeros(len(figures))
    samples = MonteCarloSamples(
        process=process,
        seed=seed,
        figures=tuple(figures),
        factor=factor,
        added=added,
        per_neck=per_neck,
    )
    lumped = sample_figures(process, {}, 1, samples.figures)[0][0]
    if model == "lumped":
        return samples, "lumped model"

    noise = [figure.key for figure in figures if figure.quantity in NOISE_FIGURES]

    def corrective(offset: float) -> Array:
        changed = with_necks(stage, offset) if offset else stage
        analysis = analyse_model(changed, model, near=stage)
        rows = {(c.quantity, c.axis): c.value for c in analysis.characteristics}
        rows |= stage_figures(changed, analysis.system, noise, environment)
        # figures of the lumped model alone are not corrected
        return np.array([rows.get(f.key, lumped[i]) for i, f in enumerate(figures)])

    nominal = corrective(0.0)
    for i, figure in enumerate(figures):
        value = float(nominal[i])
        low, high = sorted((value, float(lumped[i])))
        # a factor of two roundings would multiply what the scatter of the necks adds
        apart = figure.quantity in NOISE_FIGURES and high > 2.0 * low
        if figure.display.zero > 0.0 or lumped[i] == 0.0 or apart:
            added[i] = value - lumped[i]
        else:
            factor[i] = value / lumped[i]
    words = f"lumped model, each corrected by the nominal one of the {model} model"
    if not (follow_necks and scatter.neck_common):
        return samples, words
    step = _STEP * scatter.neck_common
    change = (corrective(step) - corrective(-step)) / (2.0 * step)
    sides = np.array([[[-_STEP]], [[_STEP]]])
    values = sample_figures(process, {"neck_common": sides}, 2, samples.figures)[0]
    at_sides = samples.corrected(values)
    smooth = [figure.quantity not in _OF_STRESS for figure in figures]
    per_neck[:] = np.where(smooth, change - (at_sides[1] - at_sides[0]) / (2.0 * step), 0.0)
    return samples, f"{words}, with its effect of a common neck offset"


def with_necks(stage: Stage, change: float) -> Stage:
    """Return a stage with a change of the thickness of all necks [m]."""
    return replace(
        stage,
        hinges=tuple(
            replace(
                hinge,
                profile=with_neck_thickness(hinge.profile, hinge.profile.neck_thickness + change),
            )
            for hinge in stage.hinges
        ),
    )


def tolerance(
    stage: Stage,
    scatter: Scatter | None = None,
    *,
    figures: Sequence[Figure],
    requirements: Sequence[Requirement] = (),
    samples: int = 10_000,
    seed: int = 0,
    model: str = "superelement",
    follow_necks: bool = False,
    environment: Environment | None = None,
    workers: Workers | None = None,
    keep: Path | None = None,
) -> ToleranceStudy:
    """Run a Monte Carlo tolerance analysis: scatter of figures and yield of manufactured stages.

    A sample has random necks, radii, positions of notches, plate, material, temperature and drives
    (`flexstage.studies.explore.manufactured_samples`). The lumped model analyses samples in
    batches.

    Parameters
    ----------
    stage : Stage
        The nominal stage.
    scatter : Scatter, optional
        Scatter of the process; by default typical wire erosion.
    figures : sequence of Figure
        Figures to compute, in addition to those of the requirements.
    requirements : sequence of Requirement
        Requirements on a good stage.
    samples : int
        Number of samples.
    seed : int
        Random seed; a sample does not depend on the number of samples.
    model : str
        ``lumped``, or the model that corrects its nominal figures.
    follow_necks : bool
        True to correct the effect of a common neck offset as well, by two more analyses.
    environment : Environment, optional
        Disturbances of the figures ``rms_displacement`` and ``rms_rotation``.
    workers : Workers, optional
        Workers; by default this process.
    keep : Path, optional
        Folder for finished batches, so that an interrupted run can be resumed.

    Returns
    -------
    ToleranceStudy
        Scatter, yields and shares of the variance.

    Raises
    ------
    ModelError
        There are no figures, too few samples, or the scatter is too large.

    Notes
    -----
    Validity: changes of figures are those of the lumped model, which are more accurate than its
    figures. Deviations are normal and independent; their scatter is that of the user's machine.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.studies.explore.figures import Figure
    >>> frequency = Figure(quantity="natural_frequency_hz", axis="x")
    >>> study = tolerance(design("parallelogram"), figures=[frequency], samples=500, model="lumped")
    >>> spread = study.spreads[0]
    >>> print(f"{spread.nominal:.1f} Hz, standard deviation {spread.standard_deviation:.1f} Hz")
    193.7 Hz, standard deviation 2.3 Hz
    """
    process = scatter or Scatter()
    every = tuple(dict.fromkeys((*figures, *(r.figure for r in requirements))))
    if not every:
        raise ModelError("there is no figure to compute: name a figure or a requirement")
    if samples < 2:
        raise ModelError(f"there must be at least 2 samples, got {samples}")
    with subtask(0.0, 0.0):  # the progress is that of the batches
        monte_carlo, words = monte_carlo_of(
            stage,
            process,
            every,
            seed=seed,
            model=model,
            follow_necks=follow_necks,
            environment=environment,
        )
    hand_over(monte_carlo)
    values, impossible = monte_carlo.values(samples, workers or Workers(1), keep)
    nominal = monte_carlo.nominal()
    spreads = tuple(
        spread_of(figure, float(nominal[i]), values[:, i]) for i, figure in enumerate(every)
    )
    shares, share_notes = _shares(monte_carlo, spreads, values)
    return ToleranceStudy(
        monte_carlo=monte_carlo,
        samples=samples,
        values=values,
        spreads=spreads,
        shares=shares,
        yields=yields_of(every, requirements, values),
        model=words,
        notes=(*_notes(monte_carlo, spreads, values, impossible), *share_notes),
        provenance=provenance(stage),
    )


def yields_of(
    figures: Sequence[Figure], requirements: Sequence[Requirement], values: Array
) -> tuple[Yield, ...]:
    """Return the yield of each requirement, then that of all together."""
    if not requirements:
        return ()
    met = [r.met(values[:, figures.index(r.figure)]) for r in requirements]
    each = [yield_of(good, r) for good, r in zip(met, requirements, strict=True)]
    return (*each, yield_of(np.all(met, axis=0)))


def _shares(
    samples: MonteCarloSamples, spreads: Sequence[Spread], values: Array
) -> tuple[tuple[Shares, ...], tuple[str, ...]]:
    varying = [i for i, spread in enumerate(spreads) if not spread.constant]
    if not samples.kinds or not varying:
        return (), ()
    sources = parts(samples.process.stage, samples.kinds)
    count = min(len(values), FITTED)
    figures = [samples.figures[i] for i in varying]
    numbers = flat(samples.numbers(0, count))
    try:
        return shares_of(figures, sources, numbers, values[:count, varying]), ()
    except ModelError as error:
        return (), (f"contributions to the variance are unknown: {error}",)


def _notes(
    samples: MonteCarloSamples,
    spreads: Sequence[Spread],
    values: Array,
    impossible: NDArray[np.bool_],
) -> list[str]:
    notes = []
    if impossible.any():
        notes.append(
            f"{impossible.sum()} of {len(values)} samples are impossible, as a neck has less than "
            f"{100 * THINNEST:.0f} % of its thickness or cannot be made; they count as not good"
        )
    if other := int((np.isnan(values).any(axis=1) & ~impossible).sum()):
        notes.append(
            f"{other} of {len(values)} samples lack a figure, as one of their drives moves another "
            "axis by more than half of its own motion; they count as not good"
        )
    for spread in spreads:
        if spread.outliers:
            notes.append(
                f"{spread.figure.name}: {spread.outliers} of {spread.count} samples are more than "
                "8 robust standard deviations from the median, for example after a change of the "
                "mode; check the distribution before you trust the standard deviation"
            )
    process, stage = samples.process, samples.process.stage
    axes = {axis.name for axis in stage.axes}
    if axes.isdisjoint(axis for _, axis in batched_figures(stage)):
        notes.append(
            "this stage has more drives than axes: the strokes of its axes, and figures that "
            "depend on them, need an optimisation for each sample and are not computed"
        )
    if process.error > TOLERANCE:
        notes.append(
            f"the interpolation error of notch stiffness is {process.error:.0e}, relative to its "
            "largest value"
        )
    if process.scatter.temperature and stage.material.thermal_expansion is None:
        notes.append("the material has no thermal_expansion: temperature has no effect")
    return notes
