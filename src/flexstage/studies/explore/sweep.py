"""Parameter sweep: figures of a stage over its parameters."""

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

# numbers, by which messages on the same fault of two stages differ
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?", re.IGNORECASE)
#: Name of the column with the reasons for impossible stages.
FAULT = "fault"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A reason for impossible stages."""

    count: int
    """Number of points."""
    text: str
    """Message for the first of these points."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NarrowerBound:
    """A narrower bound of one variable that excludes impossible points."""

    variable: int
    """Index of the variable."""
    bound: str
    """``low`` or ``high``."""
    value: float
    """The bound [SI]."""
    impossible: float
    """Share of impossible points that it excludes [1]."""
    possible: float
    """Share of possible points that it excludes [1]."""


def common_faults(faults: Sequence[str]) -> tuple[Fault, ...]:
    """Return the reasons for impossible stages, the most frequent first.

    Messages that differ in numbers alone are one reason.

    Examples
    --------
    >>> faults = ["neck 0.1 mm too thin", "", "neck 0.2 mm too thin"]
    >>> [fault.count for fault in common_faults(faults)]
    [2]
    """
    messages = [fault for fault in faults if fault]
    kinds = Counter(_NUMBER.sub("#", message) for message in messages)
    first = {_NUMBER.sub("#", message): message for message in reversed(messages)}
    return tuple(Fault(count=n, text=first[kind]) for kind, n in kinds.most_common())


def best_cut(points: Array, faults: Sequence[str]) -> NarrowerBound | None:
    """Return the single bound that best separates impossible points from the others.

    The difference of the excluded shares of impossible and possible points is largest (Youden
    1950); None if it is below a half for every bound.

    Examples
    --------
    >>> cut = best_cut(np.linspace(0.0, 1.0, 11)[:, None], ["no"] * 4 + [""] * 7)
    >>> cut.bound, cut.value, cut.impossible, cut.possible
    ('low', 0.4, 1.0, 0.0)
    """
    impossible = np.array([bool(fault) for fault in faults])
    n, m = int(impossible.sum()), int((~impossible).sum())
    if n < 3 or m == 0:  # too few points for a bound
        return None
    best: tuple[float, NarrowerBound] | None = None
    for i, column in enumerate(points.T):
        values, at = np.unique(column, return_inverse=True)
        # shares below each value except the first, which a lower bound at that value excludes
        below = np.cumsum(np.bincount(at[impossible], minlength=len(values)))[:-1] / n
        loss = np.cumsum(np.bincount(at[~impossible], minlength=len(values)))[:-1] / m
        for bound, a, b, ends in (
            ("low", below, loss, values[1:]),
            ("high", 1.0 - below, 1.0 - loss, values[:-1]),
        ):
            if not len(ends):
                continue
            k = int(np.argmax(a - b))
            gain = float(a[k] - b[k])
            if gain >= 0.5 and (best is None or gain > best[0]):
                cut = NarrowerBound(
                    variable=i,
                    bound=bound,
                    value=float(ends[k]),
                    impossible=float(a[k]),
                    possible=float(b[k]),
                )
                best = gain, cut
    return None if best is None else best[1]


# typical computing time of a stage by model [s]
_SECONDS = {
    "lumped": 5e-3,
    "superelement": 0.5,
    "plane": 5.0,
    "superelement-3d": 10.0,
    "solid": 30.0,
}


def typical_seconds(model: str) -> float:
    """Return the typical computing time of a stage by a model [s]."""
    return _SECONDS.get(model, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sweep(Result):
    """Result of a parameter sweep."""

    table_key: ClassVar[str] = "columns"

    stage: str
    """Name of the stage."""
    model: str
    """Model of the figures."""
    plan: SweepPlan
    """Sampling plan."""
    variables: tuple[Variable, ...]
    """The varied parameters."""
    figures: tuple[Figure, ...]
    """The figures."""
    points: Array
    """Values of the variables (S, d) [SI]."""
    values: Array
    """Values of the figures (S, F), in the units of the quantities; NaN for impossible stages."""
    faults: tuple[str, ...]
    """Reason why a stage is impossible; empty for possible ones."""
    described: Array
    """Figures of the described stage (F,)."""
    indices: SobolIndices | None = None
    """Sobol' indices, if requested and possible."""
    notes: tuple[str, ...] = ()
    """Remarks on the result."""
    provenance: Provenance
    """Origin of the result."""

    __repr__ = short_repr

    def summary(self) -> dict[str, Any]:
        """Return the data of `to_dict` without the points."""
        data = self.to_dict()
        del data["columns"]
        return data

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
            "impossible": [picked(fault, "count", "text") for fault in self.common_faults],
            "figures": [
                {
                    **picked(figure, "name", "quantity", "axis", "unit=display.unit"),
                    "described": plain(float(self.described[k])),
                    "varies": not bool(self.constant[k]),
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
        """Name and SI unit of each numeric column: variables, then figures."""
        return [
            *((variable.name, variable.si_unit) for variable in self.variables),
            *((figure.name, figure.display.unit) for figure in self.figures),
        ]

    def _at(self, figure: int, row: int) -> dict[str, Any]:
        """Return the value of a figure at a point, and the point."""
        point = zip((v.name for v in self.variables), plain(self.points[row]), strict=True)
        return {"value": plain(float(self.values[row, figure])), "row": row, "at": dict(point)}

    def _shares(self, indices: SobolIndices) -> dict[str, Any]:
        """Return Sobol' indices by figure and variable."""
        orders = (
            ("first", indices.first, indices.first_low, indices.first_high),
            ("total", indices.total, indices.total_low, indices.total_high),
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
        return picked(indices, "samples", "excluded", "confidence") | {"shares": shares}

    @property
    def possible(self) -> np.ndarray:
        """True for possible stages (S,)."""
        return np.array([not fault for fault in self.faults])

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of values of each variable on a grid; empty for other plans."""
        return self.plan.counts(self.variables)

    @property
    def common_faults(self) -> tuple[Fault, ...]:
        """Reasons for impossible stages, the most frequent first."""
        return common_faults(self.faults)

    @property
    def cut(self) -> NarrowerBound | None:
        """Single bound that best excludes impossible stages, if there is one."""
        return best_cut(self.points, self.faults)

    @property
    def advice(self) -> str:
        """Advice on a bound that excludes impossible stages; empty if there is none."""
        cut = self.cut
        if cut is None:
            return ""
        variable = self.variables[cut.variable]
        value = f"{float(f'{cut.value * variable.factor:.3g}'):.10g} {variable.unit}".rstrip()
        limit = f"{variable.name} {'>=' if cut.bound == 'low' else '<='} {value}"
        loss = f", and {100.0 * cut.possible:.0f} % of the others" if cut.possible > 0.005 else ""
        return f"{limit} excludes {100.0 * cut.impossible:.0f} % of the impossible stages{loss}"

    @property
    def constant(self) -> np.ndarray:
        """True for figures that do not vary, except for rounding errors (F,)."""
        values = self.values[self.possible]
        if not len(values):
            return np.ones(len(self.figures), dtype=bool)
        size = np.abs(values).max(axis=0)
        zero = np.array([figure.display.zero for figure in self.figures])
        return (size < zero) | (np.ptp(values, axis=0) <= ROUNDING * size)

    @property
    def varying(self) -> tuple[int, ...]:
        """Figures that vary by more than 0.1 %, or all varying ones if there are none."""
        values = self.values[self.possible]
        with np.errstate(invalid="ignore"):
            large = np.ptp(values, axis=0) > 1e-3 * np.abs(values).max(axis=0)
        large &= ~self.constant
        return tuple(int(k) for k in np.flatnonzero(large if large.any() else ~self.constant))

    @property
    def least(self) -> tuple[int, ...]:
        """Point with the least value of each figure."""
        return tuple(int(column.argmin()) for column in self._filled(math.inf).T)

    @property
    def greatest(self) -> tuple[int, ...]:
        """Point with the greatest value of each figure."""
        return tuple(int(column.argmax()) for column in self._filled(-math.inf).T)

    def _filled(self, value: float) -> Array:
        return np.where(np.isnan(self.values), value, self.values)

    @property
    def correlations(self) -> Array:
        """Rank correlation of each figure with each variable (F, d), after Spearman 1904.

        1 for a monotonically increasing figure, -1 for a decreasing one; NaN for a constant one.
        """
        from scipy.stats import rankdata

        figures, variables = len(self.figures), len(self.variables)
        out = np.full((figures, variables), math.nan)
        if self.possible.sum() < 3:
            return out
        x = rankdata(self.points[self.possible], axis=0)
        values = self.values[self.possible]
        # values that differ by rounding errors have the same rank
        spread = np.where(self.constant, 1.0, np.ptp(values, axis=0))
        y = rankdata(np.round((values - values.min(axis=0)) / spread, 6), axis=0)
        x, y = x - x.mean(axis=0), y - y.mean(axis=0)
        sizes = np.linalg.norm(y, axis=0)[:, None] * np.linalg.norm(x, axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            out = y.T @ x / sizes
        out[self.constant] = math.nan
        return out

    def display(self, figure: int) -> Quantity:
        """Return the quantity of a figure with a unit that suits its values."""
        largest = float(np.nanmax(np.abs(self.values[:, figure])))
        return self.figures[figure].display.fitting(largest)

    def strongest(self, count: int) -> tuple[int, ...]:
        """Return a number of variables with the largest effect on a figure, in their order."""
        effect = np.abs(self.correlations) if self.indices is None else self.indices.total
        strength = np.nan_to_num(effect).max(axis=0)
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
    """Compute the figures of a stage over its parameters.

    The result includes impossible stages with the reason.

    Parameters
    ----------
    family : Family
        The stage and its variables.
    figures : sequence of Figure
        Figures to compute.
    plan : SweepPlan
        Sampling plan.
    model : str
        ``lumped``, ``superelement``, ``plane``, ``superelement-3d`` or ``solid``.
    workers : Workers, optional
        Workers of `flexstage.studies.explore.open_workers`; by default this process. The results do
        not depend on them.
    keep : Path, optional
        Folder for finished batches, so that an interrupted sweep can be resumed.

    Returns
    -------
    Sweep
        The figures of all points.

    Raises
    ------
    ModelError
        All stages are impossible, or the model is unknown.

    Examples
    --------
    >>> from flexstage.stage.designs import StageTemplate
    >>> from flexstage.studies.explore import Family, Figure, SweepPlan, variables_of
    >>> guide = StageTemplate.of("parallelogram")
    >>> necks = variables_of(guide, ["leg.notch.neck_thickness=0.3..0.5 mm"])
    >>> result = sweep(
    ...     Family(template=guide, variables=necks),
    ...     [Figure(quantity="natural_frequency_hz", axis="x")],
    ...     SweepPlan(sampling="grid", samples=3),
    ... )
    >>> result.values[:, 0].round(1).tolist()
    [104.0, 147.8, 193.7]
    """
    points = plan.points(family.variables)
    figures = tuple(figures)
    job = Job(
        name="sweep",
        work=evaluate_batch,
        payload=(family, points, figures, model),
        count=len(points),
        batch=batch_size(len(points), typical_seconds(model)),
    )
    # first, so that a wrong model or figure is rejected at once
    described = evaluate(family, family.usual[None], figures, model)
    missing = [figures[k].name for k in np.flatnonzero(np.isnan(described.values[0]))]
    if missing and not described.faults[0]:
        raise ModelError(f"the {model} model does not compute {', '.join(missing)}: omit it")
    columns = (workers or Workers(1)).run(job, keep)
    faults = tuple(str(fault) for fault in columns["fault"])
    if all(faults):
        fault = common_faults(faults)[0]
        raise ModelError(
            f"all {len(points)} stages are impossible; {fault.count} of them: {fault.text}; choose "
            "other bounds"
        )
    indices, notes = None, plan.notes
    if plan.indices:
        try:
            indices = sobol_indices(_by_base_sample(columns["values"], figures, family), plan.seed)
        except ModelError as error:
            notes = (*notes, f"no Sobol' indices: {error}")
    return Sweep(
        stage=family.stage(family.usual).name,
        model=model,
        plan=plan,
        variables=family.variables,
        figures=figures,
        points=points,
        values=columns["values"],
        faults=faults,
        described=described.values[0],
        indices=indices,
        notes=notes,
        provenance=provenance(family.template),
    )


def evaluate_batch(
    payload: tuple[Family, Array, tuple[Figure, ...], str], start: int, stop: int
) -> dict[str, np.ndarray]:
    """Evaluate a batch of points."""
    family, points, figures, model = payload
    evaluation = evaluate(family, points[start:stop], figures, model)
    faults = np.array(evaluation.faults, dtype=np.str_)
    return {"values": evaluation.values, "fault": faults}


def _by_base_sample(values: Array, figures: Sequence[Figure], family: Family) -> Array:
    """Return values by base sample (N, d + 2, F), with rounding errors as zero."""
    zero = np.array([figure.display.zero for figure in figures])
    values = np.where(np.abs(values) < zero, 0.0, values)
    return values.reshape(-1, len(family.variables) + 2, len(figures))
