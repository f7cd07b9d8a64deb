"""What the workshop makes of a stage: figures of a whole lot, its yield, and what spreads them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.explore.batches import Job
from flexstage.explore.deviations import KINDS, draw, drawn_kinds, flat, parts
from flexstage.explore.figures import Figure, Requirement
from flexstage.explore.made_stages import Process, lot_figures, process_of
from flexstage.explore.notch_table import THINNEST, TOLERANCE
from flexstage.explore.spread import (
    Shares,
    Spread,
    Yield,
    shares_of,
    spread_of,
    yield_of,
)
from flexstage.progress import subtask
from flexstage.provenance import Provenance, provenance
from flexstage.short_repr import short_repr
from flexstage.stage import Stage
from flexstage.studies.models import analyse_model
from flexstage.virtual.imperfections import Scatter

if TYPE_CHECKING:
    from flexstage.explore.workers import Workers

#: Samples of a batch: some tenths of a second of work.
BATCH = 2500
#: Samples that the shares of the variance are found from, at most: enough for two digits.
FITTED = 20_000

#: What the figures of a lot rest on.
VALIDITY: tuple[str, ...] = (
    "The lumped model says how figures change from stage to stage; a correction by another model "
    "holds for the drawing and is taken to hold for all of them.",
    "Deviations are normal and independent of each other, but for what all necks share.",
    "Outlines of bodies, and the places where notches begin, stay as drawn, and so does Poisson's "
    "ratio; a wire offset changes the necks alone, not the mass of the bodies.",
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

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of deviations that there are."""
        return drawn_kinds(self.process.scatter)

    def numbers(self, start: int, stop: int) -> dict[str, Array]:
        """Return the deviations of samples, standard normal."""
        return draw(self.process.stage, self.kinds, start, stop, seed=self.seed)

    def nominal(self) -> Array:
        """Return the figures of the stage as drawn, shape (figures,)."""
        return self.corrected(lot_figures(self.process, {}, 1, self.figures)[0])[0]

    def values(
        self, samples: int, workers: "Workers", keep: Path | None = None
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return the figures of samples, shape (samples, figures), and which are no stage.

        A figure is NaN of what is no stage.
        """
        # what is kept is the work alone: a correction may differ in its last bit
        payload = (self.process, self.kinds, self.seed, self.figures)
        job = Job(name="tolerance", work=_batch, payload=payload, count=samples, batch=BATCH)
        found = workers.run(job, keep)
        return self.corrected(found["values"]), found["gone"]

    def corrected(self, values: Array) -> Array:
        """Return figures of the lumped model as they are shown."""
        return values * self.factor + self.added


def _batch(
    payload: tuple[Process, tuple[str, ...], int, tuple[Figure, ...]], start: int, stop: int
) -> dict[str, NDArray[Any]]:
    process, kinds, seed, figures = payload
    numbers = draw(process.stage, kinds, start, stop, seed=seed)
    values, gone = lot_figures(process, numbers, stop - start, figures)
    return {"values": values, "gone": gone}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToleranceStudy:
    """What the workshop makes of a stage."""

    lot: Lot
    """The stages that were drawn."""
    samples: int
    """Number of them."""
    values: Array
    """Their figures, NaN where one is no stage, shape (samples, figures)."""
    spreads: tuple[Spread, ...]
    """How each figure is spread."""
    shares: tuple[Shares, ...]
    """Where the variance of each comes from; empty where there are too few samples."""
    yields: tuple[Yield, ...]
    """Of every requirement, and of all together; empty where there is none."""
    model: str
    """What the figures were computed with, in a sentence."""
    notes: tuple[str, ...]
    """What to know of the result."""
    provenance: Provenance
    """Where it comes from."""

    __repr__ = short_repr

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

    def shares_of(self, figure: Figure) -> Shares | None:
        """Return where the variance of a figure comes from; None where that is not known."""
        return next((s for s in self.shares if s.figure == figure), None)


def lot_of(
    stage: Stage, scatter: Scatter, figures: Sequence[Figure], *, seed: int, model: str
) -> tuple[Lot, str]:
    """Return the lot of a stage, and in a sentence how its figures are computed.

    By the ``lumped`` model alone, or with that of the stage as drawn corrected by another model:
    by a factor, or by a sum for figures that may be zero, as the coupling.

    Raises
    ------
    ModelError
        The process is so coarse that a notch cannot be made, or the stage lacks a figure.
    """
    process = process_of(stage, scatter)
    factor, added = np.ones(len(figures)), np.zeros(len(figures))
    plain = Lot(process=process, seed=seed, figures=tuple(figures), factor=factor, added=added)
    own = lot_figures(process, {}, 1, plain.figures)[0][0]
    if model == "lumped":
        return plain, "lumped model"
    rows = {(c.quantity, c.axis): c.value for c in analyse_model(stage, model).characteristics}
    for i, figure in enumerate(figures):
        other = rows.get(figure.key, float(own[i]))
        if figure.shown.zero > 0.0 or own[i] == 0.0:
            added[i] = other - own[i]
        else:
            factor[i] = other / own[i]
    return plain, f"lumped model, each figure corrected by that of the {model} model of the drawing"


def tolerance(
    stage: Stage,
    scatter: Scatter | None = None,
    *,
    figures: Sequence[Figure],
    requirements: Sequence[Requirement] = (),
    samples: int = 10_000,
    seed: int = 0,
    model: str = "superelement",
    workers: "Workers | None" = None,
    keep: Path | None = None,
) -> ToleranceStudy:
    """Return what a process makes of a stage: the spread of its figures, its yield.

    Every sample is the stage with its own necks, radii, positions of notches, plate, material,
    temperature and drives (`flexstage.explore.made_stages`), analysed by the lumped model in
    batches.

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
    >>> from flexstage.designs import design
    >>> from flexstage.explore.figures import Figure
    >>> frequency = Figure(quantity="natural_frequency_hz", axis="x")
    >>> found = tolerance(design("parallelogram"), figures=[frequency], samples=500, model="lumped")
    >>> spread = found.spreads[0]
    >>> print(f"{spread.nominal:.1f} Hz, standard deviation {spread.standard_deviation:.1f} Hz")
    193.7 Hz, standard deviation 2.3 Hz
    """
    from flexstage.explore.workers import Workers

    process = scatter or Scatter()
    every = tuple(dict.fromkeys((*figures, *(r.figure for r in requirements))))
    if not every:
        raise ModelError("there is nothing to look at: name a figure or a requirement")
    if samples < 2:
        raise ModelError(f"there must be at least 2 samples, got {samples}")
    with subtask(0.0, 0.1):
        lot, how = lot_of(stage, process, every, seed=seed, model=model)
    with subtask(0.1, 1.0):
        values, gone = lot.values(samples, workers or Workers(1), keep)
    nominal = lot.nominal()
    spreads = tuple(
        spread_of(figure, float(nominal[i]), values[:, i]) for i, figure in enumerate(every)
    )
    shares, lacking = _shares(lot, values)
    return ToleranceStudy(
        lot=lot,
        samples=samples,
        values=values,
        spreads=spreads,
        shares=shares,
        yields=yields_of(every, requirements, values),
        model=how,
        notes=(*_notes(lot, spreads, values, gone), *lacking),
        provenance=provenance(stage, {"samples": str(samples), "seed": str(seed), "model": model}),
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


def _shares(lot: Lot, values: Array) -> tuple[tuple[Shares, ...], tuple[str, ...]]:
    if not lot.kinds:
        return (), ()
    named = parts(lot.process.stage, lot.kinds)
    count = min(len(values), FITTED)
    try:
        found = shares_of(lot.figures, named, flat(lot.numbers(0, count)), values[:count])
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
    if lot.process.error > TOLERANCE:
        notes.append(
            f"springs of notches are interpolated to {lot.process.error:.0e} of their largest value"
        )
    if lot.process.scatter.temperature and lot.process.stage.material.thermal_expansion is None:
        notes.append("the material gives no thermal_expansion: the temperature changes nothing")
    return notes


def labels() -> Mapping[str, str]:
    """Return what each kind of deviation is called in tables."""
    return {kind.name: kind.label for kind in KINDS}
