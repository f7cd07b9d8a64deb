"""What the workshop makes of a stage: figures of a whole lot, its yield, and what spreads them."""

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
from flexstage.studies.explore.batches import Job
from flexstage.studies.explore.deviations import KINDS, draw, drawn_kinds, flat, parts
from flexstage.studies.explore.family import batched_figures
from flexstage.studies.explore.figures import Figure, Requirement
from flexstage.studies.explore.manufactured_samples import (
    THINNEST,
    TOLERANCE,
    Process,
    lot_figures,
    process_of,
)
from flexstage.studies.explore.spread import (
    Shares,
    Spread,
    Yield,
    shares_of,
    spread_of,
    yield_of,
)
from flexstage.studies.explore.workers import Workers
from flexstage.studies.models import analyse_model
from flexstage.virtual.imperfections import Scatter

#: Samples of a batch: some tenths of a second of work.
BATCH = 2500
#: Samples that the shares of the variance are found from, at most: enough for two digits.
FITTED = 20_000

# standard deviations of the step by which another model says what necks do: mesh and iteration
# leave less of it
_STEP = 2.0
# quantities that a peak of stress on a mesh is in
_OF_STRESS = ("max_stress", "safety_factor", "fatigue_safety")

#: What the figures of a lot rest on.
VALIDITY: tuple[str, ...] = (
    "The lumped model says how figures change from stage to stage. Against superelement analyses "
    "of stages with other necks it follows frequencies to a few per cent of their spread; of what "
    "necks do to ratio and stroke, some tenths of a per cent, it sees a third to a half, and of "
    "what they do to the coupling nothing, as that is bending of bodies (--follow-necks mends it).",
    "Deviations are normal and independent of each other, but for what all necks share.",
    "Outlines of bodies, and the places where notches begin, stay as drawn, and so does Poisson's "
    "ratio. A wire offset changes the necks alone: the mass that it takes from outlines would make "
    "up for 2 to 5 % of what it does to frequencies.",
    "Temperature expands the plate; Young's modulus and drives do not follow it.",
    "The plane model knows no lean of notches, nor where along its normal a drive pushes.",
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lot:
    """The stages that a process makes, and what is computed of each."""

    process: Process
    """The stage and its scatter."""
    seed: int
    """Seed of its random numbers."""
    figures: tuple[Figure, ...]
    """What is computed."""
    factor: Array
    """What each figure of the lumped model is multiplied by [1], shape (figures,)."""
    added: Array
    """What is added to it then, in the unit of the figure, shape (figures,)."""
    per_neck: Array
    """What is added for each metre by which all necks are off alike, shape (figures,)."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of deviations that there are."""
        return drawn_kinds(self.process.stage, self.process.scatter)

    def numbers(self, start: int, stop: int) -> dict[str, Array]:
        """Return the deviations of samples, standard normal."""
        return draw(self.process.stage, self.kinds, start, stop, seed=self.seed)

    def nominal(self) -> Array:
        """Return the figures of the stage as drawn, shape (figures,)."""
        return self.corrected(lot_figures(self.process, {}, 1, self.figures)[0])[0]

    def values(
        self, samples: int, workers: Workers, keep: Path | None = None
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return the figures of samples, shape (samples, figures), and which are no stage.

        A figure is NaN of what is no stage.
        """
        # what is kept is the work alone: a correction may differ in its last bit
        payload = (self.process, self.kinds, self.seed, self.figures)
        job = Job(name="tolerance", work=_batch, payload=payload, count=samples, batch=BATCH)
        found = workers.run(job, keep)
        values = self.corrected(found["values"])
        if self.per_neck.any():
            stage, scatter = self.process.stage, self.process.scatter
            alike = draw(stage, ("neck_common",), 0, samples, seed=self.seed)["neck_common"]
            values += scatter.neck_common * alike[:, :, 0] * self.per_neck
        return values, found["gone"]

    def corrected(self, values: Array) -> Array:
        """Return figures of the lumped model as they are shown, but for what necks alike add."""
        return values * self.factor + self.added


def _batch(
    payload: tuple[Process, tuple[str, ...], int, tuple[Figure, ...]], start: int, stop: int
) -> dict[str, NDArray[Any]]:
    process, kinds, seed, figures = payload
    numbers = draw(process.stage, kinds, start, stop, seed=seed)
    values, gone = lot_figures(process, numbers, stop - start, figures)
    return {"values": values, "gone": gone}


@dataclass(frozen=True, slots=True, kw_only=True)
class ToleranceChoice:
    """Tolerances by which a share of all stages meets what is required, at the least cost."""

    target: float
    """The share of good stages that was asked for [1]."""
    reached: bool
    """Whether the lower end of the interval of the yield is at the target or above it."""
    usual: Scatter
    """The scatter that the choice began with."""
    chosen: Scatter
    """The scatter that was found; the finest one that is thought of where none reaches the target.
    """
    kinds: tuple[str, ...]
    """The fields of `Scatter` that were chosen."""
    cost: float
    """Cost of the chosen scatter in parts of that of the usual one [1]."""
    before: tuple[Yield, ...]
    """Yields with the usual scatter: of every requirement, and of all together."""
    after: tuple[Yield, ...]
    """Yields with the chosen scatter."""
    verdict: str
    """What came out, in a sentence."""

    def data(self) -> dict[str, Any]:
        """Return what was chosen as plain data."""
        return {
            **picked(self, "target", "reached", "verdict", "cost"),
            "scatter": picked(self.chosen, *self.kinds),
            "yields": [one.data() for one in self.after],
        }

    @property
    def found(self) -> bool:
        """Whether there is a scatter to show: not where the stage as drawn is not good."""
        return self.reached or self.chosen != self.usual

    def factor(self, kind: str) -> float:
        """Return the chosen scatter of a kind in parts of the usual one [1]."""
        return getattr(self.chosen, kind) / getattr(self.usual, kind)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToleranceStudy(Result):
    """What the workshop makes of a stage."""

    table_key: ClassVar[str] = "figures"

    lot: Lot
    """The stages that were drawn."""
    samples: int
    """Number of them."""
    values: Array
    """Their figures, NaN where one is no stage, shape (samples, figures)."""
    spreads: tuple[Spread, ...]
    """How each figure is spread."""
    shares: tuple[Shares, ...]
    """Where the variance of each comes from that varies; empty where there are too few samples."""
    yields: tuple[Yield, ...]
    """Of every requirement, and of all together; empty where there is none."""
    model: str
    """What the figures were computed with, in a sentence."""
    notes: tuple[str, ...]
    """What to know of the result."""
    provenance: Provenance
    """Where it comes from."""
    choice: ToleranceChoice | None = None
    """The tolerances that reach a yield, where they were asked for."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        found = {
            **picked(self, "stage=stage.name", "samples", "seed=lot.seed", "model"),
            "scatter": picked(self.scatter, *(kind.name for kind in KINDS)),
            "figures": [spread.data() for spread in self.spreads],
            "variance": [of.data() for of in self.shares],
            "yields": [one.data() for one in self.yields],
            **picked(self, "notes", "provenance"),
        }
        return found if self.choice is None else found | {"tighten": self.choice.data()}

    @property
    def stage(self) -> Stage:
        """The stage as it was drawn."""
        return self.lot.process.stage

    @property
    def scatter(self) -> Scatter:
        """How the process misses it."""
        return self.lot.process.scatter

    @property
    def requirements(self) -> tuple[Requirement, ...]:
        """What is required."""
        return tuple(y.requirement for y in self.yields if y.requirement is not None)


def lot_of(
    stage: Stage,
    scatter: Scatter,
    figures: Sequence[Figure],
    *,
    seed: int,
    model: str,
    follow_necks: bool = False,
) -> tuple[Lot, str]:
    """Return the lot of a stage, and in a sentence how its figures are computed.

    By the ``lumped`` model alone, or with that of the stage as drawn corrected by another model:
    by a factor, or by a sum for figures that may be zero, as the coupling. To `follow_necks` the
    other model also says how figures change where all necks are off alike; but for stress, whose
    peak on a mesh jitters by as much.

    Raises
    ------
    ModelError
        The process is so coarse that a notch cannot be made, or the stage lacks a figure.
    """
    process = process_of(stage, scatter)
    factor, added = np.ones(len(figures)), np.zeros(len(figures))
    per_neck = np.zeros(len(figures))
    plain = Lot(
        process=process,
        seed=seed,
        figures=tuple(figures),
        factor=factor,
        added=added,
        per_neck=per_neck,
    )
    own = lot_figures(process, {}, 1, plain.figures)[0][0]
    if model == "lumped":
        return plain, "lumped model"

    def others(dt: float) -> Array:
        made = stage
        if dt:
            made = with_necks(stage, dt)
        analysis = analyse_model(made, model, near=stage)
        rows = {(c.quantity, c.axis): c.value for c in analysis.characteristics}
        # what only the lumped model knows stays as it is
        return np.array([rows.get(f.key, own[i]) for i, f in enumerate(figures)])

    here = others(0.0)
    for i, figure in enumerate(figures):
        other = float(here[i])
        if figure.shown.zero > 0.0 or own[i] == 0.0:
            added[i] = other - own[i]
        else:
            factor[i] = other / own[i]
    how = f"lumped model, each corrected by that of the {model} model of the drawing"
    if not (follow_necks and scatter.neck_common):
        return plain, how
    step = _STEP * scatter.neck_common
    change = (others(step) - others(-step)) / (2.0 * step)
    sides = np.array([[[-_STEP]], [[_STEP]]])
    lumped = plain.corrected(lot_figures(process, {"neck_common": sides}, 2, plain.figures)[0])
    smooth = [figure.quantity not in _OF_STRESS for figure in figures]
    per_neck[:] = np.where(smooth, change - (lumped[1] - lumped[0]) / (2.0 * step), 0.0)
    return plain, f"{how}, and its change where all necks are off alike"


def with_necks(stage: Stage, change: float) -> Stage:
    """Return a stage whose necks are all thicker by so much [m]."""
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
    workers: Workers | None = None,
    keep: Path | None = None,
) -> ToleranceStudy:
    """Return what a process makes of a stage: the spread of its figures, its yield.

    Every sample is the stage with its own necks, radii, positions of notches, plate, material,
    temperature and drives (`flexstage.studies.explore.manufactured_samples`), analysed by the lumped model
    in batches.

    Parameters
    ----------
    stage : Stage
        The stage as drawn.
    scatter : Scatter, optional
        How the process misses it; the usual scatter of wire erosion where not given.
    figures : sequence of Figure
        What is looked at, beside what is required.
    requirements : sequence of Requirement
        What makes a stage good.
    samples : int
        Number of stages that are drawn.
    seed : int
        Seed; the sample of an index is the same whatever their number.
    model : str
        ``lumped``, or the model by which its figures of the drawing are corrected.
    follow_necks : bool
        Whether that model says as well how figures follow an offset of all necks, by two more
        analyses.
    workers : Workers, optional
        Who computes; this process where not given.
    keep : Path, optional
        Folder in which finished batches are kept, so that an interrupted run goes on.

    Returns
    -------
    ToleranceStudy
        Spreads, yields, shares of the variance.

    Raises
    ------
    ModelError
        There is nothing to look at, no sample, or the process is too coarse.

    Notes
    -----
    Validity: that of the lumped model for what changes, which is more exact than its figures; the
    deviations are normal and independent, and the scatter is that of the user's machine.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.studies.explore.figures import Figure
    >>> frequency = Figure(quantity="natural_frequency_hz", axis="x")
    >>> found = tolerance(design("parallelogram"), figures=[frequency], samples=500, model="lumped")
    >>> spread = found.spreads[0]
    >>> print(f"{spread.nominal:.1f} Hz, standard deviation {spread.standard_deviation:.1f} Hz")
    193.7 Hz, standard deviation 2.3 Hz
    """
    process = scatter or Scatter()
    every = tuple(dict.fromkeys((*figures, *(r.figure for r in requirements))))
    if not every:
        raise ModelError("there is nothing to look at: name a figure or a requirement")
    if samples < 2:
        raise ModelError(f"there must be at least 2 samples, got {samples}")
    with subtask(0.0, 0.0):  # so that the share that is done is that of the batches
        lot, how = lot_of(stage, process, every, seed=seed, model=model, follow_necks=follow_necks)
    hand_over(lot)
    values, gone = lot.values(samples, workers or Workers(1), keep)
    nominal = lot.nominal()
    spreads = tuple(
        spread_of(figure, float(nominal[i]), values[:, i]) for i, figure in enumerate(every)
    )
    shares, lacking = _shares(lot, spreads, values)
    return ToleranceStudy(
        lot=lot,
        samples=samples,
        values=values,
        spreads=spreads,
        shares=shares,
        yields=yields_of(every, requirements, values),
        model=how,
        notes=(*_notes(lot, spreads, values, gone), *lacking),
        provenance=provenance(stage),
    )


def yields_of(
    figures: Sequence[Figure], requirements: Sequence[Requirement], values: Array
) -> tuple[Yield, ...]:
    """Return the yield of every requirement, and that of all together at the end."""
    if not requirements:
        return ()
    met = [r.met(values[:, figures.index(r.figure)]) for r in requirements]
    each = [yield_of(good, r) for good, r in zip(met, requirements, strict=True)]
    return (*each, yield_of(np.all(met, axis=0)))


def _shares(
    lot: Lot, spreads: Sequence[Spread], values: Array
) -> tuple[tuple[Shares, ...], tuple[str, ...]]:
    moved = [i for i, spread in enumerate(spreads) if not spread.still]
    if not lot.kinds or not moved:
        return (), ()
    named = parts(lot.process.stage, lot.kinds)
    count = min(len(values), FITTED)
    figures = [lot.figures[i] for i in moved]
    try:
        found = shares_of(figures, named, flat(lot.numbers(0, count)), values[:count, moved])
    except ModelError as error:
        return (), (f"what spreads the figures is not told: {error}",)
    return found, ()


def _notes(
    lot: Lot, spreads: Sequence[Spread], values: Array, gone: NDArray[np.bool_]
) -> list[str]:
    notes = []
    if gone.any():
        notes.append(
            f"{gone.sum()} of {len(values)} samples are no stage, as a neck has less than "
            f"{100 * THINNEST:.0f} % of its thickness or cannot be made; they count as not good"
        )
    if other := int((np.isnan(values).any(axis=1) & ~gone).sum()):
        notes.append(
            f"{other} of {len(values)} samples lack a figure, as one of their drives moves another "
            "axis by more than half of what it moves its own; they count as not good"
        )
    for spread in spreads:
        if spread.apart:
            notes.append(
                f"{spread.figure.name}: {spread.apart} of {spread.count} samples lie more than 8 "
                "robust standard deviations from the median, as where another mode takes over; "
                "look at its distribution before you trust its standard deviation"
            )
    stage = lot.process.stage
    axes = {axis.name for axis in stage.axes}
    if axes.isdisjoint(axis for _, axis in batched_figures(stage)):
        notes.append(
            "more drives than axes move this stage: the strokes of its axes, and what hangs on "
            "them, are a search in each sample, and no figures of a lot"
        )
    if lot.process.error > TOLERANCE:
        notes.append(
            f"springs of notches are interpolated to {lot.process.error:.0e} of their largest value"
        )
    if lot.process.scatter.temperature and stage.material.thermal_expansion is None:
        notes.append("the material gives no thermal_expansion: the temperature changes nothing")
    return notes
