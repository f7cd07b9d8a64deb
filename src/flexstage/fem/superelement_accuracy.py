"""How far figures of condensed bodies may be off: from a lower order, and more modes with it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from flexstage.arrays import Array
from flexstage.cache.cache import Cache
from flexstage.characteristic import Characteristics
from flexstage.errors import ModelError
from flexstage.fem.condensation import Condensed
from flexstage.fem.condensed_bodies import condense_all
from flexstage.fem.necks import ALONG
from flexstage.fem.superelement import SuperelementModel
from flexstage.system import Analysis, analyse
from flexstage.system.characteristics import scatter_at_points
from flexstage.system.stress_map import StressMap

# of what a lower order and more modes change, how much can be left: see `with_estimates`
_OF_ORDER, _OF_MODES = 1.5, 1.25
_BY_NECK = 6  # modes of a body, and twice as many as the model has at least
# Of any figure, what meshes scatter in those that the mechanism alone fixes; in space, what the
# functions through the thickness leave out. Of a stress, which is read at points.
_LEAST, _LEAST_IN_SPACE, _LEAST_OF_STRESS = 2e-5, 2e-4, 2e-2
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

    has what the order leaves out and what the modes do, with :math:`\varepsilon` 0.002 % for what
    scatters from mesh to mesh, or in space 0.02 % for what the functions through the thickness
    leave out. A stress has besides 2 % of it, as it is read at points, the scatter of the elements
    about its point, and what the points on an edge miss of the stress between them.

    Raises
    ------
    ModelError
        The model is of order 1, below which there is none.

    Notes
    -----
    The space of the lower order is a part of the other one, so that energies, and with them
    frequencies, change one way. At corners without a radius their errors fall with the order p as
    :math:`p^{-4\lambda}`, :math:`\lambda` from 0.5 for a slit to 0.54 for a right angle (I.
    Babuska, M. Suri, SIAM Review 36 (1994) 578), by which 1.1 to 1.3 of the change from 3 to 4 are
    left; elsewhere they fall by far more. What a body's modes leave out hardly depends on its mesh.
    Factors and what is added are those with which the estimate held on some 50 stages drawn at
    random; others were then drawn to count how often it does (``tests/estimates_held.py``).
    """
    coarse, rich = (
        analyse(model.stage, model.of_other_bodies(bodies)) for bodies in _coarser(model, cache)
    )
    in_space = any(p.part.through.in_space for p in model.placed)
    least = _LEAST_IN_SPACE if in_space else _LEAST
    stress = model.system.stress
    unseen = 0.0
    if stress is not None:
        unseen = max((_unseen(stress, a.static.q) for a in analysis.axes), default=0.0)
    tables = [{(r.quantity, r.axis): r.value for r in a.characteristics} for a in (coarse, rich)]
    rows = []
    for row in analysis.characteristics:
        key = (row.quantity, row.axis)
        if all(key in table for table in tables):
            left = float(_left(row.value, *(table[key] for table in tables)))
            if row.quantity in _OF_STRESS:
                left += (unseen + _LEAST_OF_STRESS) * abs(row.value) + scatter_at_points(row)
            if left:
                left += least * abs(row.value)
            # what is a figure of the drawing alone has none
            rows.append(replace(row, uncertainty=left or None))
        else:
            rows.append(row)
    found = {}
    for condition, own in analysis.modes.items():
        f = [a.modes[condition].frequency_hz for a in (analysis, coarse, rich)]
        count = min(map(len, f))
        known = _left(*(values[:count] for values in f)) + least * f[0][:count]
        found[condition] = replace(own.lowest(count), uncertainty_hz=known)
    return replace(
        analysis,
        characteristics=Characteristics(rows),
        modes=found,
        validity=(*analysis.validity, _WORDS),
    )


def _left(fine: Array | float, coarse: Array | float, rich: Array | float) -> Array:
    return _OF_ORDER * np.abs(np.subtract(fine, coarse)) + _OF_MODES * np.abs(
        np.subtract(coarse, rich)
    )


def _coarser(
    model: SuperelementModel, cache: Cache | Path | str | bool | None
) -> tuple[list[Condensed], list[Condensed]]:
    """Condense the bodies of a model in a lower order: with as many modes, and with more."""
    fine = model.mesh_settings
    if fine.order == 1:
        raise ModelError("elements of order 1 have none below to estimate by: take order 2 or more")
    mesh = replace(fine, order=fine.order - 1)
    parts = [
        replace(p.part, mesh=mesh, modes=max(_BY_NECK * len(p.part.necks), 2 * p.part.modes))
        for p in model.placed
    ]
    # body by body, as both motions of one in space share its mesh
    each = len(model.stage.bodies)
    order = [i for k in range(each) for i in range(k, len(parts), each)]
    found, _ = condense_all([parts[i] for i in order], cache)
    rich = [c for _, c in sorted(zip(order, found, strict=True), key=lambda pair: pair[0])]
    return [fewer_modes(c, p.part.modes) for c, p in zip(rich, model.placed, strict=True)], rich


def fewer_modes(body: Condensed, count: int) -> Condensed:
    """Return a body as if it had been condensed with a smaller number of modes."""
    size = body.stiffness.shape[0]
    left_out = np.arange(body.modes.start + count, body.modes.stop)
    if not left_out.size:
        return body
    basis = np.eye(size)
    # what they do under loads is a part of the responses to these again
    squares = np.diag(body.stiffness)[left_out]
    basis[left_out, body.inner] = (body.loads[:, left_out] / squares).T
    basis = np.delete(basis, left_out, axis=1)
    m = body.interfaces
    return replace(
        body,
        stiffness=basis.T @ body.stiffness @ basis,
        mass=basis.T @ body.mass @ basis,
        loads=body.loads @ basis,
        reactions=body.reactions @ basis[m:, m:],
    )


def _unseen(stress: StressMap, q: Array) -> float:
    """Return by which part the stress between points on an edge passes that of all points."""
    values = stress.equivalent(q).reshape(-1, len(ALONG))
    if not values.size or not (seen := values.max()):
        return 0.0
    powers = np.vander(np.array(ALONG))
    between = np.vander(np.linspace(0.0, 1.0, _BETWEEN), len(ALONG)) @ np.linalg.inv(powers)
    return max(float((values @ between.T).max() / seen) - 1.0, 0.0)
