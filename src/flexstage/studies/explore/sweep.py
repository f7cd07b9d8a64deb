"""A sweep: parameters of a stage varied, and figures of every stage that this makes."""

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.provenance import Provenance, provenance
from flexstage.base.short_repr import short_repr
from flexstage.files.plain import picked, plain
from flexstage.files.result import Result
from flexstage.quantities.quantity import Quantity
from flexstage.studies.explore.batches import Job, batch_size
from flexstage.studies.explore.family import Family, evaluate
from flexstage.studies.explore.figures import ROUNDING, Figure
from flexstage.studies.explore.sampling import (
    SobolIndices,
    SweepPlan,
    sobol_indices,
)
from flexstage.studies.explore.variables import Variable
from flexstage.studies.explore.workers import Workers

if TYPE_CHECKING:
    from pathlib import Path

# what differs between two sentences that say the same of two stages
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?", re.IGNORECASE)
#: What the column is called that says why a point is no stage.
FAULT = "fault"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Why points are no stage."""

    count: int
    """Of how many points it is said."""
    text: str
    """The sentence, as it is said of the first of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NarrowerBound:
    """A narrower bound of one variable, which leaves impossible points out."""

    variable: int
    """Place of the variable among those of the sweep."""
    bound: str
    """``low`` or ``high``."""
    value: float
    """The bound [SI]."""
    impossible: float
    """Share of the impossible points that it leaves out [1]."""
    possible: float
    """Share of the others that it leaves out [1]."""


def reasons(faults: Sequence[str]) -> tuple[Reason, ...]:
    """Return why points are no stage, the commonest reason first.

    Sentences that differ in their numbers alone are one reason.

    Examples
    --------
    >>> [found.count for found in reasons(["neck 0.1 mm too thin", "", "neck 0.2 mm too thin"])]
    [2]
    """
    said = [fault for fault in faults if fault]
    kinds = Counter(_NUMBER.sub("#", fault) for fault in said)
    first = {_NUMBER.sub("#", fault): fault for fault in reversed(said)}
    return tuple(Reason(count=n, text=first[kind]) for kind, n in kinds.most_common())


def best_cut(points: Array, faults: Sequence[str]) -> NarrowerBound | None:
    """Return the one bound that best tells impossible points from the others.

    That for which the share of impossible points that it leaves out, less that of the others, is
    largest (Youden 1950); None where no bound reaches a half.

    Examples
    --------
    >>> cut = best_cut(np.linspace(0.0, 1.0, 11)[:, None], ["no"] * 4 + [""] * 7)
    >>> cut.bound, cut.value, cut.impossible, cut.possible
    ('low', 0.4, 1.0, 0.0)
    """
    bad = np.array([bool(fault) for fault in faults])
    n, m = int(bad.sum()), int((~bad).sum())
    if n < 3 or m == 0:  # too few for a bound to be worth naming
        return None
    best: tuple[float, NarrowerBound] | None = None
    for i, column in enumerate(points.T):
        values, at = np.unique(column, return_inverse=True)
        # shares below each value but the first, which a bound at that value leaves out
        gone = np.cumsum(np.bincount(at[bad], minlength=len(values)))[:-1] / n
        lost = np.cumsum(np.bincount(at[~bad], minlength=len(values)))[:-1] / m
        for bound, a, b, ends in (
            ("low", gone, lost, values[1:]),
            ("high", 1.0 - gone, 1.0 - lost, values[:-1]),
        ):
            if not len(ends):
                continue
            k = int(np.argmax(a - b))
            worth = float(a[k] - b[k])
            if worth >= 0.5 and (best is None or worth > best[0]):
                cut = NarrowerBound(
                    variable=i,
                    bound=bound,
                    value=float(ends[k]),
                    impossible=float(a[k]),
                    possible=float(b[k]),
                )
                best = worth, cut
    return None if best is None else best[1]


# what a stage usually takes by a model [s]
_COST = {
    "lumped": 5e-3,
    "superelement": 0.5,
    "plane": 5.0,
    "superelement-3d": 10.0,
    "solid": 30.0,
}


def usual_cost(model: str) -> float:
    """Return what a stage usually takes by a model [s]."""
    return _COST.get(model, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sweep(Result):
    """Figures of the stages that a sweep looked at."""

    table_key: ClassVar[str] = "columns"

    stage: str
    """Name of the stage as it is described."""
    model: str
    """The model that the figures are of."""
    plan: SweepPlan
    """Which stages were looked at."""
    variables: tuple[Variable, ...]
    """What was varied."""
    figures: tuple[Figure, ...]
    """What was looked at."""
    points: Array
    """Values of the variables (S, d) [SI]."""
    values: Array
    """Values of the figures (S, F), in the units of their quantities; NaN where no stage is."""
    faults: tuple[str, ...]
    """Why a point is no stage, in a sentence; empty where it is one."""
    described: Array
    """Figures of the stage as it is described (F,)."""
    indices: SobolIndices | None = None
    """Sobol' indices, where they were asked for and could be estimated."""
    notes: tuple[str, ...] = ()
    """What is to be known of the result."""
    provenance: Provenance
    """Where it comes from."""

    __repr__ = short_repr

    def summary(self) -> dict[str, Any]:
        """Return what `to_dict` does without the points."""
        made = self.to_dict()
        del made["columns"]
        return made

    def data(self) -> dict[str, Any]:
        names = [variable.name for variable in self.variables]
        correlations = self.correlations
        numbers = zip(self.column_units, np.hstack((self.points, self.values)).T, strict=True)
        return {
            **picked(self, "stage", "model"),
            "plan": picked(self.plan, "sampling", "samples", "seed", "indices")
            | picked(self, "counts"),
            "variables": [
                picked(v, "name", "low", "high", "described=usual", "unit=si_unit", "description")
                for v in self.variables
            ],
            "points": {"all": len(self.points), "possible": int(self.possible.sum())},
            "impossible": [picked(reason, "count", "text") for reason in self.reasons],
            "figures": [
                {
                    **picked(figure, "name", "quantity", "axis", "unit=shown.unit"),
                    "described": plain(float(self.described[k])),
                    "varies": not bool(self.still[k]),
                    "least": self._at(k, self.least[k]),
                    "greatest": self._at(k, self.greatest[k]),
                    "rank_correlation": dict(zip(names, plain(correlations[k]), strict=True)),
                }
                for k, figure in enumerate(self.figures)
            ],
            "indices": None if self.indices is None else self._shares(self.indices),
            **picked(self, "notes", "provenance"),
            "columns": {name: plain(column) for (name, _), column in numbers}
            | {FAULT: list(self.faults)},
        }

    @property
    def column_units(self) -> list[tuple[str, str]]:
        """Name and SI unit of each column of numbers: variables, then figures."""
        return [
            *((variable.name, variable.si_unit) for variable in self.variables),
            *((figure.name, figure.shown.unit) for figure in self.figures),
        ]

    def _at(self, figure: int, row: int) -> dict[str, Any]:
        """Value of a figure, and at which point it is found."""
        point = zip((v.name for v in self.variables), plain(self.points[row]), strict=True)
        return {"value": plain(float(self.values[row, figure])), "row": row, "at": dict(point)}

    def _shares(self, found: SobolIndices) -> dict[str, Any]:
        """Sobol' indices by figure and variable."""
        orders = (
            ("first", found.first, found.first_low, found.first_high),
            ("total", found.total, found.total_low, found.total_high),
        )
        shares = {
            figure.name: {
                variable.name: {
                    order: plain({"value": value[k, i], "low": low[k, i], "high": high[k, i]})
                    for order, value, low, high in orders
                }
                for i, variable in enumerate(self.variables)
            }
            for k, figure in enumerate(self.figures)
        }
        return picked(found, "samples", "left_out", "confidence") | {"shares": shares}

    @property
    def possible(self) -> np.ndarray:
        """Which points are a stage (S,)."""
        return np.array([not fault for fault in self.faults])

    @property
    def counts(self) -> tuple[int, ...]:
        """How many values of each variable a grid has; empty for other points."""
        return self.plan.counts(self.variables)

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """Why points are no stage, the commonest reason first."""
        return reasons(self.faults)

    @property
    def cut(self) -> NarrowerBound | None:
        """The one bound that best leaves out what is no stage, if one does."""
        return best_cut(self.points, self.faults)

    @property
    def advice(self) -> str:
        """How to leave out what is no stage, in a sentence; empty where one bound does not."""
        cut = self.cut
        if cut is None:
            return ""
        variable = self.variables[cut.variable]
        shown = f"{float(f'{cut.value * variable.factor:.3g}'):.10g} {variable.unit}".rstrip()
        also = f", and {100.0 * cut.possible:.0f} % of the others" if cut.possible > 0.005 else ""
        return (
            f"{variable.name} from {shown} on"
            if cut.bound == "low"
            else f"{variable.name} up to {shown}"
        ) + f" leaves out {100.0 * cut.impossible:.0f} % of the impossible ones{also}"

    @property
    def still(self) -> np.ndarray:
        """Which figures do not vary, but for rounding (F,)."""
        found = self.values[self.possible]
        if not len(found):
            return np.ones(len(self.figures), dtype=bool)
        size = np.abs(found).max(axis=0)
        zero = np.array([figure.shown.zero for figure in self.figures])
        return (size < zero) | (np.ptp(found, axis=0) <= ROUNDING * size)

    @property
    def moving(self) -> tuple[int, ...]:
        """The figures worth looking at: those that vary by more than 0.1 %, else all that vary."""
        found = self.values[self.possible]
        with np.errstate(invalid="ignore"):
            much = np.ptp(found, axis=0) > 1e-3 * np.abs(found).max(axis=0)
        much &= ~self.still
        return tuple(int(k) for k in np.flatnonzero(much if much.any() else ~self.still))

    @property
    def least(self) -> tuple[int, ...]:
        """The point at which each figure is least."""
        return tuple(int(column.argmin()) for column in self._filled(math.inf).T)

    @property
    def greatest(self) -> tuple[int, ...]:
        """The point at which each figure is greatest."""
        return tuple(int(column.argmax()) for column in self._filled(-math.inf).T)

    def _filled(self, value: float) -> Array:
        return np.where(np.isnan(self.values), value, self.values)

    @property
    def correlations(self) -> Array:
        """Rank correlation of each figure with each variable (F, d), after Spearman 1904.

        1 where a figure rises with a variable all the way, -1 where it falls; NaN of what does not
        vary.
        """
        from scipy.stats import rankdata

        figures, variables = len(self.figures), len(self.variables)
        out = np.full((figures, variables), math.nan)
        if self.possible.sum() < 3:
            return out
        x = rankdata(self.points[self.possible], axis=0)
        found = self.values[self.possible]
        # what differs by rounding has the same rank
        spread = np.where(self.still, 1.0, np.ptp(found, axis=0))
        y = rankdata(np.round((found - found.min(axis=0)) / spread, 6), axis=0)
        x, y = x - x.mean(axis=0), y - y.mean(axis=0)
        sizes = np.linalg.norm(y, axis=0)[:, None] * np.linalg.norm(x, axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            out = y.T @ x / sizes
        out[self.still] = math.nan
        return out

    def shown(self, figure: int) -> Quantity:
        """Return the quantity of a figure in a unit that suits what was found."""
        largest = float(np.nanmax(np.abs(self.values[:, figure])))
        return self.figures[figure].shown.fitting(largest)

    def strongest(self, count: int) -> tuple[int, ...]:
        """Return the variables that move a figure most, as many as asked for, in their order."""
        found = np.abs(self.correlations) if self.indices is None else self.indices.total
        strength = np.nan_to_num(found).max(axis=0)
        return tuple(sorted(int(i) for i in np.argsort(-strength, kind="stable")[:count]))

    def on_grid(self, figure: int) -> Array:
        """Return the values of a figure on the grid, an axis for each variable."""
        return self.values[:, figure].reshape(self.counts)


def sweep(
    family: Family,
    figures: Sequence[Figure],
    plan: SweepPlan,
    *,
    model: str = "lumped",
    workers: Workers | None = None,
    keep: "Path | None" = None,
) -> Sweep:
    """Vary the parameters of a stage, and compute its figures at every point.

    Points that are no stage stay in the result, with the sentence that says why.

    Parameters
    ----------
    family : Family
        The stage and what is varied of it.
    figures : sequence of Figure
        What is computed.
    plan : SweepPlan
        Which points are looked at.
    model : str
        ``lumped``, ``superelement``, ``plane``, ``superelement-3d`` or ``solid``.
    workers : Workers, optional
        Who shares the work, as `flexstage.studies.explore.open_workers` gives it; this process
        alone where not given. The numbers do not depend on it.
    keep : Path, optional
        Folder of finished batches, from which an interrupted sweep goes on.

    Returns
    -------
    Sweep
        The figures of all points.

    Raises
    ------
    ModelError
        No point is a stage, or there is no such model.

    Examples
    --------
    >>> from flexstage.stage.designs import StageTemplate
    >>> from flexstage.studies.explore import Family, Figure, SweepPlan, variables_of
    >>> guide = StageTemplate.of("parallelogram")
    >>> necks = variables_of(guide, ["leg.notch.neck_thickness=0.3..0.5 mm"])
    >>> found = sweep(
    ...     Family(template=guide, variables=necks),
    ...     [Figure(quantity="natural_frequency_hz", axis="x")],
    ...     SweepPlan(sampling="grid", samples=3),
    ... )
    >>> found.values[:, 0].round(1).tolist()
    [104.0, 147.8, 193.7]
    """
    points = plan.points(family.variables)
    figures = tuple(figures)
    job = Job(
        name="sweep",
        work=_evaluated,
        payload=(family, points, figures, model),
        count=len(points),
        batch=batch_size(len(points), usual_cost(model)),
    )
    # first, so that a wrong model or figure is refused at once
    usual = evaluate(family, family.usual[None], figures, model)
    lacking = [figures[k].name for k in np.flatnonzero(np.isnan(usual.values[0]))]
    if lacking and not usual.faults[0]:
        raise ModelError(f"the {model} model gives no {', '.join(lacking)}: leave it out")
    found = (workers or Workers(1)).run(job, keep)
    faults = tuple(str(fault) for fault in found["fault"])
    if all(faults):
        why = reasons(faults)[0]
        raise ModelError(
            f"none of the {len(points)} points is a possible stage; {why.count} of them: "
            f"{why.text}; choose other bounds"
        )
    indices, notes = None, plan.notes
    if plan.indices:
        try:
            indices = sobol_indices(_by_base_sample(found["values"], figures, family), plan.seed)
        except ModelError as error:
            notes = (*notes, f"no Sobol' indices: {error}")
    return Sweep(
        stage=family.stage(family.usual).name,
        model=model,
        plan=plan,
        variables=family.variables,
        figures=figures,
        points=points,
        values=found["values"],
        faults=faults,
        described=usual.values[0],
        indices=indices,
        notes=notes,
        provenance=provenance(family.template),
    )


def _evaluated(
    payload: tuple[Family, Array, tuple[Figure, ...], str], start: int, stop: int
) -> dict[str, np.ndarray]:
    """Evaluate some of the points: the work of a batch."""
    family, points, figures, model = payload
    found = evaluate(family, points[start:stop], figures, model)
    return {"values": found.values, "fault": np.array(found.faults, dtype=np.str_)}


def _by_base_sample(values: Array, figures: Sequence[Figure], family: Family) -> Array:
    """Return values of points that belong together (N, d + 2, F); what is rounding as zero."""
    zero = np.array([figure.shown.zero for figure in figures])
    values = np.where(np.abs(values) < zero, 0.0, values)
    return values.reshape(-1, len(family.variables) + 2, len(figures))
