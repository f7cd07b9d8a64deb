"""How far figures of condensed bodies may be off: from a coarser mesh, and more modes on it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from flexstage.arrays import Array
from flexstage.cache.cache import Cache
from flexstage.characteristic import Characteristics
from flexstage.fem.condensation import Condensed
from flexstage.fem.condensed_bodies import condense_all
from flexstage.fem.necks import ALONG
from flexstage.fem.superelement import SuperelementModel
from flexstage.system import Analysis, analyse
from flexstage.system.mechanical import StressMap

# what a coarser mesh and more modes change, and what of it can be left: see `with_estimates`
_OF_MESH, _OF_MODES = 2.0, 1.25
_COARSER = 1.5  # elements of the coarser mesh, in those of the model
_BY_NECK = 6  # modes of a body, and twice as many as the model has at least
_OF_STRESS = ("max_stress", "safety_factor", "fatigue_safety")
_LEAST = 1e-5  # of any figure: the scatter of readings that the mechanism alone fixes
_LEAST_STRESS = 0.01  # of a stress, which is read at points
_WORDS = (
    "Uncertainties are estimated from coarser bodies and from bodies with more modes, and exclude "
    "errors of geometry, material and supports."
)
_BETWEEN = 33  # places along an edge at which the stress between its points is looked at


def with_estimates(
    analysis: Analysis,
    model: SuperelementModel,
    cache: Cache | Path | str | bool | None = True,
) -> Analysis:
    r"""Return an analysis of condensed bodies with estimates of its errors as uncertainties.

    The bodies are condensed once more: on a coarser mesh, one order below and with elements 1.5
    times as large at the necks, and with more modes, six for each neck and twice as many at least.
    With all these modes a figure is :math:`g`, with as many as the model has :math:`f'`, and the
    model's own is :math:`f`. The estimate

    .. math:: u = 2\,|f - f'| + \tfrac54\,|f' - g|

    has what the mesh leaves out and what the modes do, and 0.001 % of the figure. A stress has
    besides the scatter of the elements about its point, what the points on an edge miss of the
    stress between them, and 1 % of it.

    Notes
    -----
    At corners without a radius errors of frequencies fall with the order as :math:`p^{-4\lambda}`,
    :math:`\lambda` from 0.5 for a slit to 0.54 for a right angle (I. Babuska, M. Suri, SIAM Review
    36 (1994) 578), by which 1.1 to 1.3 of the change from 3 to 4 are left; elsewhere they fall by
    far more. What a body's modes leave out hardly depends on its mesh. Both factors, and what is
    added to stress, are those with which the estimate held on some stages drawn at random; others
    were then drawn to count how often it does (``tests/system/test_superelement_accuracy.py``).
    """
    coarse, rich = (
        analyse(model.stage, model.of_other_bodies(bodies)) for bodies in _coarser(model, cache)
    )
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
                left += (unseen + _LEAST_STRESS) * abs(row.value) + (row.uncertainty or 0.0)
            elif left:
                left += _LEAST * abs(row.value)
            # what is a figure of the drawing alone has none
            rows.append(replace(row, uncertainty=left or None))
        else:
            rows.append(row)
    found = {}
    for condition, own in analysis.modes.items():
        f = [a.modes[condition].frequency_hz for a in (analysis, coarse, rich)]
        count = min(map(len, f))
        known = _left(*(values[:count] for values in f))
        found[condition] = replace(own.lowest(count), uncertainty_hz=known)
    return replace(
        analysis,
        characteristics=Characteristics(rows),
        modes=found,
        validity=(*analysis.validity, _WORDS),
    )


def _left(fine: Array | float, coarse: Array | float, rich: Array | float) -> Array:
    return _OF_MESH * np.abs(np.subtract(fine, coarse)) + _OF_MODES * np.abs(
        np.subtract(coarse, rich)
    )


def _coarser(
    model: SuperelementModel, cache: Cache | Path | str | bool | None
) -> tuple[list[Condensed], list[Condensed]]:
    """Condense the bodies of a model on a coarser mesh: with as many modes, and with more."""
    fine = model.mesh_settings
    mesh = replace(
        fine, order=max(fine.order - 1, 1), neck_size=min(_COARSER * fine.neck_size, 20.0)
    )
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
    return replace(
        body,
        stiffness=basis.T @ body.stiffness @ basis,
        mass=basis.T @ body.mass @ basis,
        loads=body.loads @ basis,
        stress=body.stress @ basis,
    )


def _unseen(stress: StressMap, q: Array) -> float:
    """Return by which part the stress between points on an edge passes that of all points."""
    values = stress.equivalent(q).reshape(-1, len(ALONG))
    if not values.size or not (seen := values.max()):
        return 0.0
    powers = np.vander(np.array(ALONG))
    between = np.vander(np.linspace(0.0, 1.0, _BETWEEN), len(ALONG)) @ np.linalg.inv(powers)
    return max(float((values @ between.T).max() / seen) - 1.0, 0.0)
