"""The stages that some parameters span, and their figures by any model."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from flexstage.arrays import Array
from flexstage.designs.template import StageTemplate
from flexstage.errors import FlexstageError, ModelError
from flexstage.explore.figures import Figure
from flexstage.explore.stage_figures import STAGE_FIGURES, need_a_model, stage_figures
from flexstage.explore.variables import Variable
from flexstage.lumped import (
    StageTangents,
    assemble_batch,
    lumped_characteristics,
    lumped_system,
    parameter_tangents,
    stage_arrays,
    system_tangents,
)
from flexstage.progress import subtask
from flexstage.stage import Stage
from flexstage.studies.models import analyse_model
from flexstage.system import MechanicalSystem, characteristic_derivatives
from flexstage.system.batch_analysis import quoted

# Steps of difference quotients in parts of the range of a variable: a meshed model jitters with its
# mesh, and needs wider ones.
_STEP = {
    "lumped": 1e-5,
    "superelement": 2e-3,
    "plane": 1e-2,
    "superelement-3d": 2e-3,
    "solid": 1e-2,
}


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

    def text(self, point: Array, name: str | None = None, title: str | None = None) -> str:
        """Return a stage file of the stage of a point, under another name and title."""
        return self.template.text(self.values(point), name, title)


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
    return found | stage_figures(stage, analysis.system)


@lru_cache(maxsize=32)
def batched_figures(stage: Stage) -> tuple[tuple[str, str], ...]:
    """Return which figures of a stage the batched engine knows, by quantity and axis."""
    return quoted(assemble_batch(stage_arrays([stage])))


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
        ``lumped``, ``superelement``, ``plane``, ``superelement-3d`` or ``solid``.

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
    nominal = family.template.stage()
    if model == "lumped":
        _together(nominal, stages, figures, values)
    for done, (i, stage) in enumerate(stages.items()):
        missing = np.flatnonzero(np.isnan(values[i])).tolist()
        if not missing:
            continue
        try:
            with subtask(done / len(stages), (done + 1) / len(stages)):
                values[i, missing] = _figures(stage, [figures[k] for k in missing], model, nominal)
        except FlexstageError as error:
            values[i], faults[i] = np.nan, str(error)
    return Evaluated(figures=tuple(figures), values=values, faults=tuple(faults))


def _together(
    nominal: Stage, stages: Mapping[int, Stage], figures: Sequence[Figure], values: Array
) -> None:
    """Put in what the batched engine knows of all stages; the rest stays NaN."""
    batched = batched_figures(nominal)
    known = [k for k, figure in enumerate(figures) if figure.key in batched]
    if not stages or not known:
        return
    try:
        arrays = stage_arrays(list(stages.values()), nominal=nominal)
    except FlexstageError:
        return  # one is of another topology, or has a hinge beside its body: each by itself
    found = lumped_characteristics(arrays, [figures[k].key for k in known])
    for k in known:
        values[list(stages), k] = found[figures[k].key]


def _figures(stage: Stage, figures: Collection[Figure], model: str, nominal: Stage) -> list[float]:
    """Figures of one stage, by the single analysis; what needs none of it, by the model alone.

    All points of a family lie about the stage that it is described by, whoever computes them.
    """
    rows: dict[tuple[str, str], float] = {}
    system: MechanicalSystem | None = None
    beyond = {figure.key for figure in figures if figure.quantity in STAGE_FIGURES}
    if model == "lumped" and len(beyond) == len(figures):
        if need_a_model({quantity for quantity, _ in beyond}):
            system = lumped_system(stage)
    else:
        analysis = analyse_model(stage, model, near=nominal)
        system = analysis.system
        rows = {(row.quantity, row.axis): row.value for row in analysis.characteristics}
    rows |= stage_figures(stage, system, beyond)
    return [rows.get(figure.key, np.nan) for figure in figures]


def jacobian(
    family: Family, point: Array, figures: Sequence[Figure], model: str = "lumped"
) -> tuple[Array, Array]:
    """Return figures of a point and their slopes by the variables.

    By the lumped model the derivatives of `flexstage.system.characteristic_derivatives`, which
    need no step; what that does not know, and other models, by central difference quotients, to
    one side where the other is no stage.

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
    found = evaluate(family, point[None], figures, model)
    if found.faults[0]:
        raise ModelError(f"there is no stage to start from: {found.faults[0]}")
    slopes = np.full((len(figures), len(steps)), np.nan)
    if model == "lumped":
        slopes = _derivatives(family, point, figures, steps)
    left = np.flatnonzero(np.isnan(slopes).any(axis=1))
    if left.size:
        open_ = [figures[k] for k in left.tolist()]
        by_steps = _quotients(family, point, open_, model, steps, found.values[0, left])
        slopes[left] = np.where(np.isnan(slopes[left]), by_steps, slopes[left])
    return found.values[0], slopes


def _derivatives(family: Family, point: Array, figures: Sequence[Figure], steps: Array) -> Array:
    """Analytic derivatives by the lumped model, shape (f, d); NaN where they are not known."""
    slopes = np.full((len(figures), len(steps)), np.nan)
    arrays = stage_arrays([family.stage(point)])
    batched = quoted(assemble_batch(arrays))
    known = [k for k, figure in enumerate(figures) if figure.key in batched]
    if not known:
        return slopes
    tangents: dict[int, StageTangents] = {}
    for j, step in enumerate(steps):

        def build(value: float, j: int = j) -> Stage:
            return family.stage(np.concatenate((point[:j], [value], point[j + 1 :])))

        try:
            tangents[j] = parameter_tangents(
                build, float(point[j]), step=float(step), order=2, arrays=arrays
            )
        except FlexstageError:
            continue  # no stage to either side, or a hinge that becomes another
    if tangents:
        first, *others = tangents.values()
        joined = first.joined(*others)
        keys = [figures[k].key for k in known]
        found = characteristic_derivatives(*system_tangents(joined), keys)
        for k, key in zip(known, keys, strict=True):
            slopes[k, list(tangents)] = found[key]
    return slopes


def _quotients(
    family: Family,
    point: Array,
    figures: Sequence[Figure],
    model: str,
    steps: Array,
    here: Array,
) -> Array:
    """Difference quotients, shape (f, d)."""
    d = len(steps)
    around = np.concatenate((point + np.diag(steps), point - np.diag(steps)))
    found = evaluate(family, around, figures, model).values
    up, down = (found[:d] - here) / steps[:, None], (here - found[d:]) / steps[:, None]
    slopes = np.where(np.isnan(up), down, np.where(np.isnan(down), up, 0.5 * (up + down)))
    return slopes.T
