"""The stages that some parameters span, and their figures by any model."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from flexstage.arrays import Array
from flexstage.designs.template import StageTemplate
from flexstage.errors import FlexstageError, ModelError
from flexstage.explore.figures import Figure
from flexstage.explore.stage_figures import STAGE_FIGURES
from flexstage.explore.variables import Variable
from flexstage.lumped import lumped_characteristics, stage_arrays
from flexstage.progress import subtask
from flexstage.stage import Stage
from flexstage.studies.models import analyse_model
from flexstage.system import Analysis

# Steps of difference quotients in parts of the range of a variable: a meshed model jitters with its
# mesh, and needs wider ones.
_STEP = {"lumped": 1e-5, "superelement": 2e-3, "plane": 1e-2, "solid": 1e-2}


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """A stage of which some parameters are varied; a point has their values in SI units."""

    template: StageTemplate
    """The design or stage file."""
    variables: tuple[Variable, ...]
    """What is varied."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables."""
        return tuple(v.name for v in self.variables)

    @property
    def usual(self) -> Array:
        """The point of the stage as it is described, shape (d,)."""
        return np.array([v.usual for v in self.variables])

    @property
    def middle(self) -> Array:
        """The point in the middle of all bounds, shape (d,)."""
        return np.array([v.middle for v in self.variables])

    @property
    def bounds(self) -> Array:
        """Least and greatest value of each variable, shape (d, 2)."""
        return np.array([(v.low, v.high) for v in self.variables]).reshape(-1, 2)

    def values(self, point: Array) -> dict[str, float]:
        """Return the values of a point by name."""
        return dict(zip(self.names, map(float, point), strict=True))

    def stage(self, point: Array) -> Stage:
        """Return the stage of a point.

        Raises
        ------
        FlexstageError
            There is none: dimensions that do not go together.
        """
        return self.template.stage(self.values(point))

    def text(self, point: Array) -> str:
        """Return a stage file of the stage of a point."""
        return self.template.text(self.values(point))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluated:
    """Figures of many points."""

    figures: tuple[Figure, ...]
    """The figures, in the order of the columns."""
    values: Array
    """In the units of their quantities, NaN where a point is no stage, shape (points, figures)."""
    faults: tuple[str, ...]
    """Why a point is no stage, in a sentence; empty where it is one."""


def known_figures(stage: Stage) -> dict[tuple[str, str], float]:
    """Return all figures of a stage by the lumped model, by quantity and axis."""
    analysis = analyse_model(stage, "lumped")
    found = {(row.quantity, row.axis): row.value for row in analysis.characteristics}
    for quantity, compute in STAGE_FIGURES.items():
        found |= {(quantity, a): v for a, v in compute(stage, analysis.system).items()}
    return found


def evaluate(
    family: Family, points: Array, figures: Sequence[Figure], model: str = "lumped"
) -> Evaluated:
    """Return figures of many points of a family.

    Parameters
    ----------
    family : Family
        The stages.
    points : numpy.ndarray
        Values of the variables [SI], shape (points, d).
    figures : sequence of Figure
        What is computed of each.
    model : str
        ``lumped``, ``superelement``, ``plane`` or ``solid``.

    Returns
    -------
    Evaluated
        A point that is no stage has NaN and a sentence; it stops nothing.

    Examples
    --------
    >>> from flexstage.explore.variables import variables_of
    >>> template = StageTemplate.of("parallelogram")
    >>> family = Family(template=template, variables=variables_of(template, ["leg_spacing=20 %"]))
    >>> ratio = Figure(quantity="transmission_ratio", axis="x")
    >>> found = evaluate(family, np.array([[0.038], [0.042]]), [ratio])
    >>> [f"{v:.3f}" for v in found.values[:, 0]]
    ['1.000', '1.000']
    """
    values = np.full((len(points), len(figures)), np.nan)
    faults = [""] * len(points)
    stages: dict[int, Stage] = {}
    for i, point in enumerate(np.asarray(points, dtype=np.float64)):
        try:
            stages[i] = family.stage(point)
        except FlexstageError as error:
            faults[i] = str(error)
    if model == "lumped":
        _together(family.template.stage(), stages, figures, values)
    for done, (i, stage) in enumerate(stages.items()):
        missing = np.flatnonzero(np.isnan(values[i])).tolist()
        if not missing:
            continue
        try:
            with subtask(done / len(stages), (done + 1) / len(stages)):
                values[i, missing] = _figures(stage, [figures[k] for k in missing], model)
        except FlexstageError as error:
            values[i], faults[i] = np.nan, str(error)
    return Evaluated(figures=tuple(figures), values=values, faults=tuple(faults))


def _together(
    nominal: Stage, stages: Mapping[int, Stage], figures: Sequence[Figure], values: Array
) -> None:
    """Put in what the batched engine knows of all stages; the rest stays NaN."""
    known = [k for k, figure in enumerate(figures) if figure.key in _batched(nominal)]
    if not stages or not known:
        return
    try:
        arrays = stage_arrays(list(stages.values()), nominal=nominal)
    except FlexstageError:
        return  # one is of another topology, or has a hinge beside its body: each by itself
    found = lumped_characteristics(arrays, [figures[k].key for k in known])
    for k in known:
        values[list(stages), k] = found[figures[k].key]


@lru_cache(maxsize=32)
def _batched(nominal: Stage) -> frozenset[tuple[str, str]]:
    """Figures that the batched engine knows of a stage."""
    return frozenset(lumped_characteristics(stage_arrays([nominal])))


def _figures(stage: Stage, figures: Collection[Figure], model: str) -> list[float]:
    """Figures of one stage, by the single analysis."""
    analysis = analyse_model(stage, model)
    rows = {(row.quantity, row.axis): row.value for row in analysis.characteristics}
    others: dict[str, Mapping[str, float]] = {}
    return [rows.get(f.key, _other(f, stage, analysis, others)) for f in figures]


def _other(
    figure: Figure, stage: Stage, analysis: Analysis, found: dict[str, Mapping[str, float]]
) -> float:
    """Return a figure beyond those of an analysis; NaN where this stage has none."""
    compute = STAGE_FIGURES.get(figure.quantity)
    if compute is None:
        return np.nan
    if figure.quantity not in found:
        found[figure.quantity] = compute(stage, analysis.system)
    return found[figure.quantity].get(figure.axis, np.nan)


def jacobian(
    family: Family, point: Array, figures: Sequence[Figure], model: str = "lumped"
) -> tuple[Array, Array]:
    """Return figures of a point and their slopes by the variables.

    Central difference quotients; to one side where the other is no stage.

    Parameters
    ----------
    family : Family
        The stages.
    point : numpy.ndarray
        Values of the variables [SI], shape (d,).
    figures : sequence of Figure
        What is computed.
    model : str
        As in `evaluate`.

    Returns
    -------
    tuple of numpy.ndarray
        Values, shape (f,), and slopes in the units of the figures per SI unit of the variables,
        shape (f, d); NaN where a step to neither side is a stage.

    Raises
    ------
    ModelError
        The point itself is no stage.
    """
    steps = _STEP[model] * np.ptp(family.bounds, axis=1)
    d = len(steps)
    around = np.concatenate((point[None], point + np.diag(steps), point - np.diag(steps)))
    found = evaluate(family, around, figures, model)
    if found.faults[0]:
        raise ModelError(f"there is no stage to start from: {found.faults[0]}")
    here, above, below = found.values[0], found.values[1 : d + 1], found.values[d + 1 :]
    up, down = (above - here) / steps[:, None], (here - below) / steps[:, None]
    slopes = np.where(np.isnan(up), down, np.where(np.isnan(down), up, 0.5 * (up + down)))
    return here, slopes.T
