"""Estimates of errors: by meshes refined until convergence, and of condensed bodies."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.base.short_repr import short_repr
from flexstage.fem.condensation import Condensed
from flexstage.fem.condensed_bodies import condense_all
from flexstage.fem.mesh import MeshSettings
from flexstage.fem.model import StageModel
from flexstage.fem.necks import ALONG
from flexstage.fem.superelement import SuperelementModel
from flexstage.files.cache.cache import Cache
from flexstage.quantities.characteristic import Characteristics
from flexstage.quantities.quantity import QUANTITIES
from flexstage.system import Analysis, analyse
from flexstage.system.characteristics import scatter_at_points
from flexstage.system.stress_map import StressMap

#: Meshes of rising accuracy, by model: order, then element size at the necks.
REFINEMENT_MESHES: Mapping[str, tuple[MeshSettings, ...]] = {
    "plane": tuple(
        MeshSettings(order=p, neck_size=h)
        for p, h in ((3, 1.2), (4, 0.8), (5, 0.8), (6, 0.6), (7, 0.5), (8, 0.4))
    ),
    "solid": tuple(
        MeshSettings(order=p, neck_size=h) for p, h in ((2, 1.5), (3, 1.2), (4, 0.8), (5, 0.8))
    ),
}

# How much smaller the change at the next step can be taken to be than at the last one.
_BEST_RATE, _WORST_RATE = 0.15, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class RefinementStep:
    """One mesh of a refinement."""

    settings: MeshSettings
    """Settings."""
    unknowns: int
    """Unknowns."""
    seconds: float
    """Computing time [s]."""
    values: Mapping[tuple[str, str], float]
    """Value of each quantity and axis."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refinement:
    """A refined model, with the meshes of the refinement."""

    model: StageModel
    """The last model."""
    analysis: Analysis
    """Analysis; each characteristic has the estimate of its error as its uncertainty."""
    steps: tuple[RefinementStep, ...]
    """The meshes, coarsest first."""
    quantity: str
    """The requested quantity."""
    accuracy: float
    """The requested relative accuracy [1]."""

    __repr__ = short_repr

    @property
    def estimate(self) -> float:
        """Estimate of the relative error of the requested quantity [1]."""
        return estimate(self.steps, self.quantity)


def estimate(steps: Sequence[RefinementStep], quantity: str) -> float:
    r"""Estimate the relative error of a quantity on the last mesh, the largest over the axes.

    Every mesh of a refinement raises the order, so that changes decrease as in a geometric series
    with the rate r of the last two: the remaining change is :math:`|d_k|\,r/(1-r)`. r counts as
    0.15 at least, because an accidentally small change must not make the estimate small, and as 0.5
    where only one change is known or the changes do not decrease; the estimate is the last change
    itself then.

    It is infinite from one mesh alone.
    """
    if len(steps) < 2:
        return math.inf
    return max(
        (
            _left(steps, key) / abs(value) if value else 0.0
            for key, value in steps[-1].values.items()
            if key[0] == quantity and key in steps[-2].values
        ),
        default=math.inf,
    )


def _left(steps: Sequence[RefinementStep], key: tuple[str, str]) -> float:
    """Estimate the distance of the last value of a quantity from its limit."""
    values = [step.values[key] for step in steps[-3:]]
    last = abs(values[-1] - values[-2])
    rate = _WORST_RATE
    if len(values) == 3 and (before := abs(values[-2] - values[-3])) > 0.0:
        rate = min(max(last / before, _BEST_RATE), _WORST_RATE)
    return last * rate / (1.0 - rate)


def refine(
    build: Callable[[MeshSettings], StageModel],
    meshes: Sequence[MeshSettings],
    *,
    accuracy: float,
    quantity: str = "natural_frequency_hz",
) -> Refinement:
    """Refine the mesh and raise the order until a quantity has converged.

    It has converged when `estimate` is within the accuracy. Errors that all meshes share, of
    geometry, material and supports, are not included.

    Parameters
    ----------
    build : callable
        Returns the model for mesh settings.
    meshes : sequence of MeshSettings
        The meshes, coarsest first; see `REFINEMENT_MESHES`.
    accuracy : float
        Required relative accuracy, above 0 [1].
    quantity : str
        One of the quantities of a stage, such as ``natural_frequency_hz`` or ``max_stress``.

    Returns
    -------
    Refinement
        The first model that is accurate enough.

    Raises
    ------
    ModelError
        The accuracy or the quantity is invalid.
    ConvergenceError
        The finest mesh was not accurate enough.
    """
    if not 0.0 < accuracy < 1.0:
        raise ModelError(
            f"the accuracy must lie between 0 and 1 (0.001 is 0.1 %), got {accuracy!r}"
        )
    if quantity not in QUANTITIES:
        raise ModelError(f"unknown quantity '{quantity}': expected one of {', '.join(QUANTITIES)}")
    steps: list[RefinementStep] = []
    for k, settings in enumerate(meshes):
        # each step costs about twice the one before; how many there will be is not known
        with progress.subtask(1.0 - 0.5**k, 1.0 - 0.5 ** (k + 1)):
            begun = time.perf_counter()
            model = build(settings)
            analysis = analyse(model.stage, model.system)
        values = {(r.quantity, r.axis): r.value for r in analysis.characteristics}
        if not any(name == quantity for name, _ in values):
            raise ModelError(
                f"the model gives no {quantity}, so its accuracy cannot be reached: choose one of "
                f"{', '.join(sorted({name for name, _ in values})) or 'none'}"
            )
        seconds = time.perf_counter() - begun
        steps.append(
            RefinementStep(
                settings=settings, unknowns=model.unknowns, seconds=seconds, values=values
            )
        )
        if len(steps) > 1 and estimate(steps, quantity) <= accuracy:
            return Refinement(
                model=model,
                analysis=_with_changes(analysis, steps, quantity, accuracy),
                steps=tuple(steps),
                quantity=quantity,
                accuracy=accuracy,
            )
    left = estimate(steps, quantity)
    raise ConvergenceError(
        f"the finest mesh leaves {quantity} uncertain by {left:.2g}, more than the {accuracy:.2g} "
        "requested: request less, or look for a corner without a radius, where the stress is "
        "singular"
    )


def _with_changes(
    analysis: Analysis, steps: Sequence[RefinementStep], quantity: str, accuracy: float
) -> Analysis:
    rows = []
    for row in analysis.characteristics:
        key = (row.quantity, row.axis)
        estimates = [] if row.uncertainty is None else [row.uncertainty]
        if all(key in step.values for step in steps):
            # several meshes tell how the largest stress moves between their points
            estimates = [
                scatter_at_points(row) if row.quantity == "max_stress" else k for k in estimates
            ]
            estimates.append(_left(steps, key))
        rows.append(replace(row, uncertainty=max(estimates) if estimates else None))
    words = (
        f"Mesh refined until {quantity} converged to {100.0 * estimate(steps, quantity):.2g} % "
        f"(requested: {100.0 * accuracy:.2g} %). Uncertainties are estimated from the changes "
        "between meshes and exclude errors of geometry, material and supports."
    )
    return replace(
        analysis,
        characteristics=Characteristics(rows),
        validity=(*analysis.validity, words),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Margins:
    """Factors and margins of `with_estimates`."""

    of_order: float = 1.5
    """Factor on the change by a lower order."""
    of_modes: float = 1.25
    """Factor on the change by more modes."""
    by_neck: int = 6
    """Modes of a body by neck, and twice as many as the model has at least."""
    least: float = 2e-5
    """Relative scatter by meshes of figures that the mechanism alone determines."""
    least_in_space: float = 2e-4
    """The same in three dimensions, with the error of the functions through the thickness."""
    least_of_stress: float = 2e-2
    """Relative scatter of a stress, which is read at points."""


_MARGINS = _Margins()
_OF_STRESS = ("max_stress", "safety_factor", "fatigue_safety")
_WORDS = (
    "Uncertainties are estimated from bodies of a lower order and from bodies with more modes, and "
    "exclude errors of geometry, material and supports."
)
_BETWEEN = 33  # places along an edge at which the stress between its points is looked at


def with_estimates(
    analysis: Analysis,
    model: SuperelementModel,
    cache: Cache | Path | str | bool | None = True,
) -> Analysis:
    r"""Return an analysis of condensed bodies with estimates of its errors as uncertainties.

    The bodies are condensed once more on their meshes, one order below and with more modes: six for
    each neck, and twice as many at least. With all these modes a figure is :math:`g`, with as many
    as the model has it is :math:`f'`, and the model's own is :math:`f`. The estimate

    .. math:: u = 1.5\,|f - f'| + 1.25\,|f' - g| + \varepsilon |f|

    includes the errors by the order and by the modes, with :math:`\varepsilon` 0.002 % for the
    scatter from mesh to mesh, or in space 0.02 % for the error of the functions through the
    thickness. A stress has in addition 2 % of its value, as it is read at points, the scatter of
    the elements about its point, and the rise of the stress between the points on an edge.

    Raises
    ------
    ModelError
        The model is of order 1, below which there is no order.

    Notes
    -----
    The space of the lower order is a part of the other one, so that energies, and with them
    frequencies, change one way. At corners without a radius their errors fall with the order p as
    :math:`p^{-4\lambda}`, :math:`\lambda` from 0.5 for a slit to 0.54 for a right angle (I.
    Babuska, M. Suri, SIAM Review 36 (1994) 578), so that the remaining error is 1.1 to 1.3 of the
    change from 3 to 4; elsewhere they fall by far more. The error by the modes of a body hardly
    depends on its mesh. Factors and margins are those with which the estimate held on about 50
    random stages; other random stages were then used to count how often it holds
    (``tests/estimates_held.py``).
    """
    coarse, rich = (
        analyse(model.stage, model.of_other_bodies(bodies)) for bodies in _coarser(model, cache)
    )
    in_space = any(p.part.through.in_space for p in model.placed)
    least = _MARGINS.least_in_space if in_space else _MARGINS.least
    stress = model.system.stress
    excess = 0.0
    if stress is not None:
        excess = max(
            (_excess_between_points(stress, a.static.q) for a in analysis.axes), default=0.0
        )
    tables = [{(r.quantity, r.axis): r.value for r in a.characteristics} for a in (coarse, rich)]
    rows = []
    for row in analysis.characteristics:
        key = (row.quantity, row.axis)
        if all(key in table for table in tables):
            left = float(_error_estimate(row.value, *(table[key] for table in tables)))
            if row.quantity in _OF_STRESS:
                left += (excess + _MARGINS.least_of_stress) * abs(row.value)
                left += scatter_at_points(row)
            if left:
                left += least * abs(row.value)
            # what is a figure of the drawing alone has none
            rows.append(replace(row, uncertainty=left or None))
        else:
            rows.append(row)
    estimated_modes = {}
    for condition, modes_here in analysis.modes.items():
        f = [a.modes[condition].frequency_hz for a in (analysis, coarse, rich)]
        count = min(map(len, f))
        errors = _error_estimate(*(values[:count] for values in f)) + least * f[0][:count]
        estimated_modes[condition] = replace(modes_here.lowest(count), uncertainty_hz=errors)
    return replace(
        analysis,
        characteristics=Characteristics(rows),
        modes=estimated_modes,
        validity=(*analysis.validity, _WORDS),
    )


def _error_estimate(fine: Array | float, coarse: Array | float, rich: Array | float) -> Array:
    return _MARGINS.of_order * np.abs(np.subtract(fine, coarse)) + _MARGINS.of_modes * np.abs(
        np.subtract(coarse, rich)
    )


def _coarser(
    model: SuperelementModel, cache: Cache | Path | str | bool | None
) -> tuple[list[Condensed], list[Condensed]]:
    """Condense the bodies of a model in a lower order: with as many modes, and with more."""
    fine = model.mesh_settings
    if fine.order == 1:
        raise ModelError(
            "elements of order 1 have no lower order for an estimate: take order 2 or more"
        )
    mesh = replace(fine, order=fine.order - 1)
    parts_of_model = [p.part for p in model.placed]
    parts = [
        replace(p, mesh=mesh, modes=max(_MARGINS.by_neck * len(p.necks), 2 * p.modes))
        for p in parts_of_model
    ]
    # body by body, as both motions of one in space share its mesh
    each = len(model.stage.bodies)
    order = [i for k in range(each) for i in range(k, len(parts), each)]
    condensed, _ = condense_all([parts[i] for i in order], cache)
    rich = [c for _, c in sorted(zip(order, condensed, strict=True), key=lambda pair: pair[0])]
    return [fewer_modes(c, p.part.modes) for c, p in zip(rich, model.placed, strict=True)], rich


def fewer_modes(body: Condensed, count: int) -> Condensed:
    """Return a body as if it had been condensed with a smaller number of modes."""
    size = body.stiffness.shape[0]
    omitted = np.arange(body.modes.start + count, body.modes.stop)
    if not omitted.size:
        return body
    basis = np.eye(size)
    # what they do under loads is a part of the responses to these again
    squares = np.diag(body.stiffness)[omitted]
    basis[omitted, body.inner] = (body.loads[:, omitted] / squares).T
    basis = np.delete(basis, omitted, axis=1)
    m = body.interfaces
    return replace(
        body,
        stiffness=basis.T @ body.stiffness @ basis,
        mass=basis.T @ body.mass @ basis,
        loads=body.loads @ basis,
        reactions=body.reactions @ basis[m:, m:],
    )


def _excess_between_points(stress: StressMap, q: Array) -> float:
    """Return the relative excess of the stress between points on an edge over that at points."""
    values = stress.equivalent(q).reshape(-1, len(ALONG))
    if not values.size or not (largest := values.max()):
        return 0.0
    powers = np.vander(np.array(ALONG))
    between = np.vander(np.linspace(0.0, 1.0, _BETWEEN), len(ALONG)) @ np.linalg.inv(powers)
    return max(float((values @ between.T).max() / largest) - 1.0, 0.0)
