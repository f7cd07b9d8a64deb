"""Families of stages with varied parameters, and their figures by any model.

Figures beyond those of an analysis, for constraints of an optimisation, are computed here as well.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import FlexstageError, ModelError
from flexstage.base.progress import subtask
from flexstage.lumped import (
    StageTangents,
    assemble_batch,
    lumped_characteristics,
    lumped_system,
    parameter_tangents,
    stage_arrays,
    system_tangents,
)
from flexstage.lumped.large_displacement import lumped_buckling
from flexstage.quantities.characteristic import WHOLE_STAGE
from flexstage.stage import Stage
from flexstage.stage.designs import StageTemplate
from flexstage.stage.drive import Force, PiezoStack
from flexstage.stage.narrowest import narrowest_slot, thinnest_wall
from flexstage.studies.explore.figures import NOISE_FIGURES, Figure
from flexstage.studies.explore.variables import Variable
from flexstage.studies.models import analyse_model, analyse_moved
from flexstage.system import MechanicalSystem, characteristic_derivatives
from flexstage.system.batch_analysis import quoted
from flexstage.system.characteristics import axis_states

if TYPE_CHECKING:
    from flexstage.system.environment import Environment

# elongation [m] and force [N] of every drive of each axis at full stroke
Forces = Mapping[str, Mapping[str, tuple[float, float]]]


def _smallest_wall(stage: Stage) -> Mapping[str, float]:
    """Thinnest wall of a body, without necks; empty without thin walls."""
    wall = thinnest_wall(stage)
    return {WHOLE_STAGE: wall} if math.isfinite(wall) else {}


def _output_wall(stage: Stage) -> Mapping[str, float]:
    """Thinnest wall of the output body of each axis; empty without thin walls."""
    bodies = {axis.name: stage.probe(axis.probe).body for axis in stage.axes}
    walls = {body: thinnest_wall(stage, body) for body in dict.fromkeys(bodies.values())}
    return {axis: walls[body] for axis, body in bodies.items() if math.isfinite(walls[body])}


def _smallest_neck(stage: Stage) -> Mapping[str, float]:
    """Thinnest neck."""
    necks = [hinge.profile.neck_thickness for hinge in stage.hinges]
    return {WHOLE_STAGE: min(necks)} if necks else {}


def _drive_force(stage: Stage, forces: Forces) -> Mapping[str, float]:
    """Largest force of a drive at full stroke, with imposed elongation."""
    return {
        axis: max((abs(force) for _, force in drives.values()), default=0.0)
        for axis, drives in forces.items()
    }


def _drive_force_share(stage: Stage, forces: Forces) -> Mapping[str, float]:
    """Force of a stack at full stroke over its blocking force; the largest of an axis."""
    shares: dict[str, float] = {}
    for axis, drives in forces.items():
        for name, (_, force) in drives.items():
            drive = stage.drive(name)
            if isinstance(drive, PiezoStack):
                shares[axis] = max(shares.get(axis, 0.0), abs(force) / drive.blocked_force)
    return shares


def _stroke_left(stage: Stage, forces: Forces) -> Mapping[str, float]:
    r"""Share of the free stroke of a drive that remains on the stage: :math:`k_d/(k_d + k_s)`.

    :math:`k_d` is the stiffness of the drive with its seats over the stroke, and :math:`k_s` its
    force over its elongation; the least of the drives of an axis.
    """
    shares: dict[str, float] = {}
    for axis, drives in forces.items():
        largest = max((abs(length) for length, _ in drives.values()), default=0.0)
        for name, (length, force) in drives.items():
            drive = stage.drive(name)
            # a smaller share of the largest elongation is rounding error
            if isinstance(drive, Force) or abs(length) <= 1e-9 * largest:
                continue
            # the preload spring is bent by the elongation, as the stage is
            spring = drive.preload.spring_stiffness if drive.preload else 0.0
            # where other drives move the axis too, one that shortens begins extended
            size = abs(length)
            lost = drive.compression(abs(force) + spring * size)
            share = size / (size + lost)
            shares[axis] = min(shares.get(axis, math.inf), share)
    return shares


def _buckling_factor(stage: Stage, forces: Forces) -> Mapping[str, float]:
    """Load factor on the forces at full stroke at which the stage buckles, with rigid bodies."""
    return {
        axis: lumped_buckling(stage, {name: force for name, (_, force) in drives.items()})
        for axis, drives in forces.items()
    }


#: Functions of the geometry, by quantity; their results are by axis, ``stage`` for the whole.
_OF_GEOMETRY: Mapping[str, Callable[[Stage], Mapping[str, float]]] = {
    "smallest_neck": _smallest_neck,
    # negative where bodies overlap
    "smallest_slot": lambda stage: {WHOLE_STAGE: narrowest_slot(stage)},
    "smallest_wall": _smallest_wall,
    "output_wall": _output_wall,
}
# functions of the forces of drives, by quantity; their results are by axis
_OF_FORCES: Mapping[str, Callable[[Stage, Forces], Mapping[str, float]]] = {
    "drive_force": _drive_force,
    "drive_force_share": _drive_force_share,
    "stroke_left": _stroke_left,
    "buckling_factor": _buckling_factor,
}
#: Quantities that are computed for one stage at a time.
STAGE_FIGURES = (*_OF_FORCES, *_OF_GEOMETRY, *NOISE_FIGURES)


def need_a_model(quantities: Collection[str]) -> bool:
    """Return whether any of the quantities of `STAGE_FIGURES` needs a model."""
    return not _OF_GEOMETRY.keys() >= set(quantities)


def stage_figures(
    stage: Stage,
    system: MechanicalSystem | None,
    keys: Collection[tuple[str, str]] | None = None,
    environment: "Environment | None" = None,
) -> dict[tuple[str, str], float]:
    """Return figures of a stage by quantity and axis: those of `keys`, or all.

    `system` is a model of the stage; it may be None if `need_a_model` returns False. The rms is
    that of an environment, if there is one.
    """
    quantities = {quantity for quantity, _ in keys} if keys is not None else set(STAGE_FIGURES)
    figures: dict[tuple[str, str], float] = {}
    for quantity, measure in _OF_GEOMETRY.items():
        if quantity in quantities:
            figures |= {(quantity, axis): value for axis, value in measure(stage).items()}
    if system is None or not need_a_model(quantities):
        return figures
    if environment is not None and not quantities.isdisjoint(NOISE_FIGURES):
        from flexstage.control.dynamic_budget import open_rms

        figures |= open_rms(stage, system, environment, keys)
    if quantities.isdisjoint(_OF_FORCES):
        return figures
    forces = {
        state.axis: {
            name: (length, state.static.drive_force.get(name, 0.0))
            for name, length in state.drives.items()
        }
        for state in axis_states(stage, system).axes
    }
    for quantity, compute in _OF_FORCES.items():
        if quantity in quantities:
            of = {a: f for a, f in forces.items() if keys is None or (quantity, a) in keys}
            figures |= {(quantity, axis): value for axis, value in compute(stage, of).items()}
    return figures


# Steps of difference quotients as shares of the range of a variable. They are larger for meshed
# models, whose figures scatter with the mesh.
_STEP = {
    "lumped": 1e-5,
    "superelement": 2e-3,
    "plane": 1e-2,
    "superelement-3d": 2e-3,
    "solid": 1e-2,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """A stage with varied parameters; a point has their values in SI units."""

    template: StageTemplate
    """The design or stage file."""
    variables: tuple[Variable, ...]
    """The varied parameters."""
    environment: "Environment | None" = None
    """Where the stage stands, for its rms."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables."""
        return tuple(v.name for v in self.variables)

    @property
    def usual(self) -> Array:
        """The point of the described stage, shape (d,)."""
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
            The stage is impossible.
        """
        return self.template.stage(self.values(point))

    def text(self, point: Array, name: str | None = None, title: str | None = None) -> str:
        """Return a stage file of the stage of a point, with another name and title."""
        return self.template.text(self.values(point), name, title)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluated:
    """Figures of many points."""

    figures: tuple[Figure, ...]
    """The figures, in the order of the columns."""
    values: Array
    """Values in the units of the quantities, NaN for impossible stages, shape (points, figures)."""
    faults: tuple[str, ...]
    """Reason why a stage is impossible; empty for possible ones."""


def known_figures(
    stage: Stage, environment: "Environment | None" = None
) -> dict[tuple[str, str], float]:
    """Return all figures of a stage by the lumped model, by quantity and axis.

    Those of an environment are among them, if there is one.
    """
    analysis = analyse_model(stage, "lumped")
    figures = {(row.quantity, row.axis): row.value for row in analysis.characteristics}
    return figures | stage_figures(stage, analysis.system, environment=environment)


@lru_cache(maxsize=32)
def batched_figures(stage: Stage) -> tuple[tuple[str, str], ...]:
    """Return the figures of a stage that the batched engine computes, by quantity and axis."""
    return quoted(assemble_batch(stage_arrays([stage])))


def evaluate(
    family: Family,
    points: Array,
    figures: Sequence[Figure],
    model: str = "lumped",
    *,
    moved: bool = False,
) -> Evaluated:
    """Return figures of many points of a family.

    Parameters
    ----------
    family : Family
        The stages.
    points : numpy.ndarray
        Values of the variables [SI], shape (points, d).
    figures : sequence of Figure
        Figures to compute.
    model : str
        ``lumped``, ``superelement``, ``plane``, ``superelement-3d`` or ``solid``.
    moved : bool
        Whether the meshes of superelements are those of the described stage, moved, as of
        `flexstage.studies.models.analyse_moved`.

    Returns
    -------
    Evaluated
        The figures. An impossible stage has NaN and a reason; the other points are computed.

    Examples
    --------
    >>> from flexstage.studies.explore.variables import variables_of
    >>> template = StageTemplate.of("parallelogram")
    >>> family = Family(template=template, variables=variables_of(template, ["leg_spacing=20 %"]))
    >>> ratio = Figure(quantity="transmission_ratio", axis="x")
    >>> evaluation = evaluate(family, np.array([[0.038], [0.042]]), [ratio])
    >>> [f"{v:.3f}" for v in evaluation.values[:, 0]]
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
        _evaluate_batch(family.template.stage(), stages, figures, values)
    for done, (i, stage) in enumerate(stages.items()):
        missing = np.flatnonzero(np.isnan(values[i])).tolist()
        if not missing:
            continue
        try:
            with subtask(done / len(stages), (done + 1) / len(stages)):
                rest = [figures[k] for k in missing]
                values[i, missing] = _figures(stage, rest, model, family, moved=moved)
        except FlexstageError as error:
            values[i], faults[i] = np.nan, str(error)
    return Evaluated(figures=tuple(figures), values=values, faults=tuple(faults))


def _evaluate_batch(
    nominal: Stage, stages: Mapping[int, Stage], figures: Sequence[Figure], values: Array
) -> None:
    """Fill in the figures of the batched engine for all stages; others stay NaN."""
    batched = batched_figures(nominal)
    known = [k for k, figure in enumerate(figures) if figure.key in batched]
    if not stages or not known:
        return
    try:
        arrays = stage_arrays(list(stages.values()), nominal=nominal)
    except FlexstageError:
        return  # one has another topology, or a detached hinge: each is computed alone
    characteristics = lumped_characteristics(arrays, [figures[k].key for k in known])
    for k in known:
        values[list(stages), k] = characteristics[figures[k].key]


def _figures(
    stage: Stage, figures: Collection[Figure], model: str, family: Family, *, moved: bool
) -> list[float]:
    """Return figures of one stage by an analysis, or by the lumped model alone if that suffices.

    The described stage is the reference of superelements, on every worker.
    """
    rows: dict[tuple[str, str], float] = {}
    system: MechanicalSystem | None = None
    keys = {figure.key for figure in figures if figure.quantity in STAGE_FIGURES}
    if model == "lumped" and len(keys) == len(figures):
        if need_a_model({quantity for quantity, _ in keys}):
            system = lumped_system(stage)
    else:
        nominal = family.template.stage()
        analysis = (
            analyse_moved(stage, model, nominal)
            if moved
            else analyse_model(stage, model, near=nominal)
        )
        system = analysis.system
        rows = {(row.quantity, row.axis): row.value for row in analysis.characteristics}
    rows |= stage_figures(stage, system, keys, family.environment)
    return [rows.get(figure.key, np.nan) for figure in figures]


def jacobian(
    family: Family, point: Array, figures: Sequence[Figure], model: str = "lumped"
) -> tuple[Array, Array]:
    """Return figures of a point and their derivatives by the variables.

    Derivatives of the lumped model are analytic (`flexstage.system.characteristic_derivatives`).
    Those of other figures and models are central difference quotients, one-sided if the stage on
    the other side is impossible.

    Parameters
    ----------
    family : Family
        The stages.
    point : numpy.ndarray
        Values of the variables [SI], shape (d,).
    figures : sequence of Figure
        Figures to compute.
    model : str
        As in `evaluate`.

    Returns
    -------
    tuple of numpy.ndarray
        Values, shape (f,), and derivatives in the units of the figures per SI unit of the
        variables, shape (f, d); NaN if the stages on both sides are impossible.

    Raises
    ------
    ModelError
        The stage of the point is impossible.
    """
    steps = _STEP[model] * np.ptp(family.bounds, axis=1)
    evaluation = evaluate(family, point[None], figures, model)
    if evaluation.faults[0]:
        raise ModelError(f"the stage of the point is impossible: {evaluation.faults[0]}")
    slopes = np.full((len(figures), len(steps)), np.nan)
    if model == "lumped":
        slopes = _derivatives(family, point, figures, steps)
    rows = np.flatnonzero(np.isnan(slopes).any(axis=1))
    if rows.size:
        others = [figures[k] for k in rows.tolist()]
        quotients = _quotients(family, point, others, model, steps, evaluation.values[0, rows])
        slopes[rows] = np.where(np.isnan(slopes[rows]), quotients, slopes[rows])
    return evaluation.values[0], slopes


def _derivatives(family: Family, point: Array, figures: Sequence[Figure], steps: Array) -> Array:
    """Return analytic derivatives by the lumped model, shape (f, d); NaN for others."""
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
            continue  # impossible stages on both sides, or a hinge with another profile
    if tangents:
        first, *others = tangents.values()
        all_tangents = first.joined(*others)
        keys = [figures[k].key for k in known]
        derivatives = characteristic_derivatives(*system_tangents(all_tangents), keys)
        for k, key in zip(known, keys, strict=True):
            slopes[k, list(tangents)] = derivatives[key]
    return slopes


def _quotients(
    family: Family,
    point: Array,
    figures: Sequence[Figure],
    model: str,
    steps: Array,
    here: Array,
) -> Array:
    """Return difference quotients, shape (f, d)."""
    d = len(steps)
    around = np.concatenate((point + np.diag(steps), point - np.diag(steps)))
    values = evaluate(family, around, figures, model).values
    up, down = (values[:d] - here) / steps[:, None], (here - values[d:]) / steps[:, None]
    slopes = np.where(np.isnan(up), down, np.where(np.isnan(down), up, 0.5 * (up + down)))
    return slopes.T
