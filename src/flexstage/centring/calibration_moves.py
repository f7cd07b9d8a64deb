"""Calibration moves of the stage (trial moves), and the response of the harmonics to them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.centring.harmonic_fit import Harmonic
from flexstage.centring.requests import MAGNET
from flexstage.centring.setup import Setup
from flexstage.files.plain import picked
from flexstage.quantities.estimate import Estimate

#: The shortest calibration move, in uncertainties of eccentricity and position.
_SHORTEST = 30.0


def calibration_length(eccentricity: float, uncertainty: float) -> float:
    r"""Return the length of a trial move of one axis [m].

    It is about that of the later moves, :math:`e / \sqrt 2`, and at least 30 standard uncertainties
    u of eccentricity and position [m].

    Examples
    --------
    >>> f"{calibration_length(50e-6, 0.1e-6):.3g}", f"{calibration_length(0.2e-6, 0.1e-6):.3g}"
    ('3.54e-05', '3e-06')
    """
    return max(eccentricity / math.sqrt(2.0), _SHORTEST * uncertainty)


def calibration_position(now: float, limits: tuple[float, float], length: float) -> float:
    """Return the end of a trial move of an axis [m], on the side with more travel.

    Raises
    ------
    ModelError
        There is no travel left.
    """
    # the longest trial move, as a share of the stroke: the gain beyond it is known less well.
    longest_trial = 0.6
    low, high = limits
    room = max(high - now, now - low)
    length = min(length, longest_trial * (high - low), room)
    if not length > 0.0:
        raise ModelError("there is no room for a trial move")
    return now + (length if high - now >= now - low else -length)


Relation = Literal["linear", "quadratic"]

#: Least ratio of the smallest to the largest gain at which both directions are known.
_ROUND = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderResponse:
    """Response of the harmonic of one order to moves of the stage."""

    order: int
    """The order."""
    change: float
    """Root mean square of its changes by the moves, in the unit of the harmonic."""
    relation: Relation | None
    """Relation between moves and harmonic; None if there is none."""
    gain: float
    """Change per metre in the direction of largest change, or per square metre if quadratic."""
    residual: float
    """Root mean square of the residual of the relation, in the unit of the harmonic."""
    x: Estimate | None
    """Stage position in x at which the harmonic vanishes, or, if quadratic, has its least change by
    moves [m]; None if it is not known in both directions.
    """
    y: Estimate | None
    """The same in y [m]."""
    positions: int
    """Number of positions."""


def response_to_moves(positions: ArrayLike, harmonics: Sequence[Harmonic]) -> OrderResponse:
    r"""Return the response of a harmonic to moves, without a model of the scale.

    With z the harmonic as a complex number and p the position of the stage,

    .. math:: z = z_0 + J p \quad\text{or}\quad z = z_0 + \kappa (w - c)^2,\; w = x \pm i y

    of which the one with the smaller residual is used. Order 1 of a scale of lines or many poles is
    linear. The field of a magnet on the axis has no fixed order: with a dipole and probes at a
    radius, the offset of the magnet shows in order 1 or 4, that of the probes in order 2, and the
    combination of the probes makes it linear or quadratic.

    Parameters
    ----------
    positions : array_like
        Positions of the stage [m], shape (n, 2); three or more, not on a line.
    harmonics : sequence of Harmonic
        The harmonic of one order at each.

    Returns
    -------
    OrderResponse
        The relation, its gain, and the position of the centre.

    Raises
    ------
    RecordError
        There are fewer than three positions, they lie on a line, or the harmonics are not of one
        order.

    Validity
    --------
    Three positions determine either relation without redundancy: they do not prove that it is
    linear. At the position of a linear relation the total harmonic vanishes, including the scale's
    own error of that order. The positions are taken as exact: their errors show in the residual.
    """
    # least significant change by the moves, over its uncertainty
    significant = 4.0
    # residual of a linear relation, as a share of the change, up to which no square is tried
    nearly_linear = 0.05
    # residual of a relation, as a share of the change, that is allowed if the noise is less
    allowed_residual = 0.15
    p = np.asarray(positions, dtype=np.float64)
    if p.ndim != 2 or p.shape[1:] != (2,) or p.shape[0] != len(harmonics):
        raise RecordError(
            f"trial moves need a position x, y for each record, got shape {p.shape} for "
            f"{len(harmonics)} records"
        )
    if len({h.order for h in harmonics}) != 1:
        raise RecordError("the harmonics at the positions must be of one order")
    size = _spread(p)
    middle = p.mean(axis=0)
    u = (p - middle) / size
    z = np.array([[h.cosine.value, h.sine.value] for h in harmonics])
    weights = np.asarray([np.linalg.inv(_sound(h.covariance)) for h in harmonics], dtype=np.float64)
    constant = _least_squares(np.tile(np.eye(2), (len(u), 1, 1)), z, weights)
    change = constant.residual
    noise = math.sqrt(sum(float(np.trace(h.covariance)) for h in harmonics) / len(u))
    relation, sign, best = _best_relation(u, z, weights, max(nearly_linear * change, 2.0 * noise))
    fits_well = best.residual <= max(allowed_residual * change, 2.0 * noise)
    responds = change > significant * noise and fits_well
    gain, centre, covariance = _zero(best) if sign is None else _extremum(best, sign)
    x = y = None
    if responds and centre is not None:
        at, sigma = middle + size * centre, size * np.sqrt(np.diag(covariance))
        x, y = (_estimate(at[k], sigma[k], len(u)) for k in (0, 1))
    return OrderResponse(
        order=harmonics[0].order,
        change=change,
        relation=relation if responds else None,
        gain=gain / (size if sign is None else size**2),
        residual=best.residual,
        x=x,
        y=y,
        positions=len(u),
    )


def _best_relation(
    u: Array, z: Array, weights: Array, linear_residual: float
) -> "tuple[Relation, float | None, _Fit]":
    """Return the relation with the smaller residual, and the sign of its square."""
    linear = _linear(u, z, weights)
    # either relation passes through three positions, and a square that is small against the slope
    # puts the centre far outside the measured positions
    if len(u) == 3 or linear.residual <= linear_residual:
        return "linear", None, linear
    sign, quadratic = min(
        ((s, _quadratic(u, z, weights, s)) for s in (1.0, -1.0)), key=lambda fit: fit[1].chi_squared
    )
    if linear.chi_squared <= quadratic.chi_squared:
        return "linear", None, linear
    return "quadratic", sign, quadratic


def _spread(p: Array) -> float:
    if len(p) < 3:
        raise RecordError(f"trial moves need three positions of the stage, got {len(p)}")
    if not np.isfinite(p).all():
        raise RecordError("the positions of the stage must be finite")
    size = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
    if size[1] <= _ROUND * size[0]:
        raise RecordError(
            "the positions of the stage lie on a line: make trial moves along x and along y"
        )
    return float(np.abs(p - p.mean(axis=0)).max())


def _sound(covariance: Array) -> Array:
    """Return a covariance that has an inverse: exact values have the uncertainty of rounding."""
    floor = max(float(np.trace(covariance)) * 1e-9, 1e-36)
    return covariance + floor * np.eye(2)


@dataclass(frozen=True, slots=True)
class _Fit:
    parameters: Array
    covariance: Array
    chi_squared: float
    residual: float


def _least_squares(rows: Array, z: Array, weights: Array) -> _Fit:
    """Weighted least squares of pairs: rows (n, 2, m), z (n, 2), weights (n, 2, 2)."""
    root = np.linalg.cholesky(weights).transpose(0, 2, 1)
    columns = (root @ rows).reshape(-1, rows.shape[2])
    right = (root @ z[:, :, None]).reshape(-1)
    parameters, *_ = np.linalg.lstsq(columns, right)
    residuals = z - rows @ parameters
    chi_squared = float(np.sum((right - columns @ parameters) ** 2))
    freedom = right.size - parameters.size
    covariance = np.linalg.pinv(columns.T @ columns)
    # residuals beyond the noise may be as large at other positions
    covariance = covariance * (max(1.0, chi_squared / freedom) if freedom else 1.0)
    return _Fit(
        parameters=np.asarray(parameters, dtype=np.float64),
        covariance=np.asarray(covariance, dtype=np.float64),
        chi_squared=chi_squared,
        residual=math.sqrt(float(np.mean(np.sum(residuals**2, axis=1)))),
    )


def _linear(u: Array, z: Array, weights: Array) -> _Fit:
    rows = np.zeros((len(u), 2, 6))
    rows[:, 0, 0] = rows[:, 1, 1] = 1.0
    rows[:, 0, 2:4] = rows[:, 1, 4:6] = u
    return _least_squares(rows, z, weights)


def _quadratic(u: Array, z: Array, weights: Array, sign: float) -> _Fit:
    w = u[:, 0] + 1j * sign * u[:, 1]
    rows = np.zeros((len(u), 2, 6))
    for k, power in enumerate((np.ones_like(w), w, w**2)):
        rows[:, 0, 2 * k], rows[:, 0, 2 * k + 1] = power.real, -power.imag
        rows[:, 1, 2 * k], rows[:, 1, 2 * k + 1] = power.imag, power.real
    return _least_squares(rows, z, weights)


def _zero(fit: _Fit) -> tuple[float, Array | None, Array]:
    """Return the gain, the zero of z0 + J u, and its covariance."""
    J = fit.parameters[2:].reshape(2, 2)
    size = np.linalg.svd(J, compute_uv=False)
    if size[1] <= _ROUND * size[0]:
        return float(size[0]), None, np.zeros((2, 2))
    centre = np.asarray(np.linalg.solve(J, -fit.parameters[:2]), dtype=np.float64)
    slope = -np.linalg.solve(J, np.hstack((np.eye(2), np.kron(np.eye(2), centre[None]))))
    return float(size[0]), centre, slope @ fit.covariance @ slope.T


def _extremum(fit: _Fit, sign: float) -> tuple[float, Array | None, Array]:
    """Return the gain, the extremum of z0 + b w + k w^2, and its covariance."""
    b, k = complex(*fit.parameters[2:4]), complex(*fit.parameters[4:6])
    if abs(k) <= 2.0 * math.sqrt(float(np.trace(fit.covariance[4:, 4:]))):
        return abs(k), None, np.zeros((2, 2))
    c = -b / (2.0 * k)
    slope = np.zeros((2, 6))
    for at, change in ((2, -0.5 / k), (4, -c / k)):
        slope[:, at : at + 2] = [[change.real, -change.imag], [change.imag, change.real]]
    slope[1] *= sign
    return abs(k), np.array([c.real, sign * c.imag]), slope @ fit.covariance @ slope.T


def _estimate(value: float, uncertainty: float, positions: int) -> Estimate:
    freedom = 2.0 * positions - 6.0
    return Estimate.of(
        float(value),
        float(uncertainty),
        "m",
        source="records at the positions",
        degrees_of_freedom=freedom if freedom > 0.0 else math.inf,
    )


def calibrate_moves(
    setups: Sequence[Setup], positions: Sequence[tuple[float, float]], kind: str | None
) -> dict[str, Any]:
    """Return the response of the harmonics of setups to the stage positions, as plain data."""
    if kind == MAGNET and len(setups) < 4:
        raise RecordError(
            "for a magnet, four positions, better five, are needed to find the order that responds "
            "to the stage: measure at one more position, such as '20,20'"
        )
    by_order = [{h.order: h for h in s.harmonics} for s in setups]
    shared = sorted(set.intersection(*(set(orders) for orders in by_order)))
    responses = [response_to_moves(positions, [orders[n] for orders in by_order]) for n in shared]
    best = _best(responses, kind)
    last = positions[-1]
    out: dict[str, Any] = {
        "positions": [list(p) for p in positions],
        "unit": "m",
        "harmonic_unit": "m" if setups[0].radial else "rad",
        "orders": [_as_data(r) for r in responses],
        "order": None if best is None else best.order,
        "notes": _notes(best, kind, len(setups), last),
    }
    if best is not None and best.x is not None and best.y is not None:
        out["centre"] = {
            "x": best.x.value, "y": best.y.value, "unit": "m",
            "uncertainty_x": best.x.uncertainty, "uncertainty_y": best.y.uncertainty,
            "move_from_last": [best.x.value - last[0], best.y.value - last[1]],
        }  # fmt: skip
    return out


def _best(responses: list[OrderResponse], kind: str | None) -> OrderResponse | None:
    """Return the order that shows eccentricity: 1, but for a magnet the least uncertain one."""
    centred = [r for r in responses if r.x is not None and r.y is not None]
    if kind != MAGNET:
        return next((r for r in centred if r.order == 1 and r.relation == "linear"), None)
    return min(centred, key=_uncertainty, default=None)


def _uncertainty(r: OrderResponse) -> float:
    return math.inf if r.x is None or r.y is None else math.hypot(r.x.uncertainty, r.y.uncertainty)


def _as_data(r: OrderResponse) -> dict[str, Any]:
    return picked(r, "order", "change", "residual", "relation", "gain") | {
        "x": None if r.x is None else r.x.value,
        "y": None if r.y is None else r.y.value,
        "uncertainty_x": None if r.x is None else r.x.uncertainty,
        "uncertainty_y": None if r.y is None else r.y.uncertainty,
    }


def _notes(
    best: OrderResponse | None, kind: str | None, count: int, last: tuple[float, float]
) -> list[str]:
    if best is None:
        which = "no order responds" if kind == MAGNET else "order 1 does not respond"
        return [
            f"{which} to the positions in both directions: no centre is given; check --stage-at, "
            "make the moves larger, or measure at more positions"
        ]
    notes = []
    if count == 3:
        notes.append(
            "three positions cannot verify the linear relation: measure at a fourth to check it"
        )
    if _is_centred(best, last):
        notes.append(
            "the move from the last position is within its uncertainty: the scale is centred to "
            "the accuracy of these records"
        )
    if best.relation == "linear":
        notes.append(
            f"at the centre all of order {best.order} vanishes, including the error of the scale "
            "and its signals: measure again there"
        )
    return notes


def _is_centred(best: OrderResponse, last: tuple[float, float]) -> bool:
    """Return whether a position agrees with the centre at 95 % confidence."""
    return (
        best.x is not None
        and best.y is not None
        and best.x.covers(last[0])
        and best.y.covers(last[1])
    )
