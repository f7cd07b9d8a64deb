"""Which harmonics follow known moves of the stage, and where each of them would be centred."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.centring.harmonic_fit import Harmonic
from flexstage.centring.requests import MAGNET
from flexstage.centring.setting import Setting
from flexstage.quantities.estimate import Estimate

Follows = Literal["in proportion", "as the square"]

#: The least gain over the greatest, from which both directions are known.
_ROUND = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderResponse:
    """How the harmonic of one order follows moves of the stage."""

    order: int
    """The order."""
    change: float
    """Root mean square of what the moves changed of it, in the unit of the harmonic."""
    follows: Follows | None
    """How it follows them; None where it does not, or three positions cannot tell."""
    gain: float
    """Its change for a metre in the direction that changes it most, or for a square metre where it
    follows as the square.
    """
    left: float
    """Root mean square of what that leaves, in the unit of the harmonic."""
    x: Estimate | None
    """Where in x the stage must stand for it to vanish, or, as the square, to be least changed by
    moves [m]; None where that is not known in both directions.
    """
    y: Estimate | None
    """The same in y [m]."""
    positions: int
    """Number of positions it was seen at."""


def response_to_moves(positions: ArrayLike, harmonics: Sequence[Harmonic]) -> OrderResponse:
    r"""Find how a harmonic follows moves, without a model of the scale.

    With z the harmonic as a complex number and p the position of the stage,

    .. math:: z = z_0 + J p \quad\text{or}\quad z = z_0 + \kappa (w - c)^2,\; w = x \pm i y

    of which the one that leaves less is taken. A scale of lines or many poles follows in proportion
    in order 1. The field of a magnet on the axis has no order of its own for that: with a dipole
    and probes at a radius, the magnet's way off the axis shows in order 1 or 4, that of the probes
    in order 2, in proportion or as the square as the probes are joined.

    Parameters
    ----------
    positions : array_like
        Where the stage stood [m], shape (n, 2); three or more, not on a line.
    harmonics : sequence of Harmonic
        The harmonic of one order at each.

    Returns
    -------
    OrderResponse
        The relation, its gain, and the position that it asks for.

    Raises
    ------
    RecordError
        There are fewer than three positions, they lie on a line, or the harmonics are not of one
        order.

    Validity
    --------
    Three positions are as many as either relation has numbers: they show proportion only where
    that is known beforehand. In proportion, the position makes the whole harmonic vanish, with what
    of it is the scale's own. The positions count as exact: an error of theirs shows in what is
    left.
    """
    # the change that moves made, over its uncertainty, from which it is one
    significant = 4.0
    # the same, up to which proportion is taken without asking for a square
    nearly = 0.05
    # what a relation may leave of the change that the moves made, where the noise is less
    left = 0.15
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
    change = constant.left
    noise = math.sqrt(sum(float(np.trace(h.covariance)) for h in harmonics) / len(u))
    name, sign, best = _chosen(u, z, weights, max(nearly * change, 2.0 * noise))
    seen = change > significant * noise
    fits_well = best.left <= max(left * change, 2.0 * noise)
    known = seen and fits_well
    gain, centre, covariance = _vanishes(best) if sign is None else _stands_still(best, sign)
    x = y = None
    if known and centre is not None:
        at, sigma = middle + size * centre, size * np.sqrt(np.diag(covariance))
        x, y = (_estimate(at[k], sigma[k], len(u)) for k in (0, 1))
    return OrderResponse(
        order=harmonics[0].order,
        change=change,
        follows=name if known else None,
        gain=gain / (size if sign is None else size**2),
        left=best.left,
        x=x,
        y=y,
        positions=len(u),
    )


def _chosen(
    u: Array, z: Array, weights: Array, nearly: float
) -> "tuple[Follows, float | None, _Fit]":
    """The relation that leaves less, with the sign of its square."""
    straight = _proportional(u, z, weights)
    # either relation goes through three positions, and a square that is small against the slope
    # puts the place where nothing was measured
    if len(u) == 3 or straight.left <= nearly:
        return "in proportion", None, straight
    sign, square = min(
        ((s, _square(u, z, weights, s)) for s in (1.0, -1.0)), key=lambda one: one[1].misfit
    )
    if straight.misfit <= square.misfit:
        return "in proportion", None, straight
    return "as the square", sign, square


def _spread(p: Array) -> float:
    if len(p) < 3:
        raise RecordError(f"trial moves need three positions of the stage, got {len(p)}")
    if not np.isfinite(p).all():
        raise RecordError("the positions of the stage must be finite")
    size = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
    if size[1] <= _ROUND * size[0]:
        raise RecordError(
            "the positions of the stage lie on a line: move it on trial along x and along y"
        )
    return float(np.abs(p - p.mean(axis=0)).max())


def _sound(covariance: Array) -> Array:
    """A covariance that has an inverse: what is known exactly is known to rounding."""
    floor = max(float(np.trace(covariance)) * 1e-9, 1e-36)
    return covariance + floor * np.eye(2)


@dataclass(frozen=True, slots=True)
class _Fit:
    parameters: Array
    covariance: Array
    misfit: float
    left: float


def _least_squares(rows: Array, z: Array, weights: Array) -> _Fit:
    """Weighted least squares of pairs: rows (n, 2, m), z (n, 2), weights (n, 2, 2)."""
    root = np.linalg.cholesky(weights).transpose(0, 2, 1)
    columns = (root @ rows).reshape(-1, rows.shape[2])
    right = (root @ z[:, :, None]).reshape(-1)
    found, *_ = np.linalg.lstsq(columns, right)
    rest = z - rows @ found
    misfit = float(np.sum((right - columns @ found) ** 2))
    freedom = right.size - found.size
    covariance = np.linalg.pinv(columns.T @ columns)
    # what a relation leaves beyond the noise is not known to be elsewhere less
    covariance = covariance * (max(1.0, misfit / freedom) if freedom else 1.0)
    left = math.sqrt(float(np.mean(np.sum(rest**2, axis=1))))
    return _Fit(
        np.asarray(found, dtype=np.float64), np.asarray(covariance, dtype=np.float64), misfit, left
    )


def _proportional(u: Array, z: Array, weights: Array) -> _Fit:
    rows = np.zeros((len(u), 2, 6))
    rows[:, 0, 0] = rows[:, 1, 1] = 1.0
    rows[:, 0, 2:4] = rows[:, 1, 4:6] = u
    return _least_squares(rows, z, weights)


def _square(u: Array, z: Array, weights: Array, sign: float) -> _Fit:
    w = u[:, 0] + 1j * sign * u[:, 1]
    rows = np.zeros((len(u), 2, 6))
    for k, power in enumerate((np.ones_like(w), w, w**2)):
        rows[:, 0, 2 * k], rows[:, 0, 2 * k + 1] = power.real, -power.imag
        rows[:, 1, 2 * k], rows[:, 1, 2 * k + 1] = power.imag, power.real
    return _least_squares(rows, z, weights)


def _vanishes(fit: _Fit) -> tuple[float, Array | None, Array]:
    """Gain, where z0 + J u is nothing, and the covariance of that."""
    J = fit.parameters[2:].reshape(2, 2)
    size = np.linalg.svd(J, compute_uv=False)
    if size[1] <= _ROUND * size[0]:
        return float(size[0]), None, np.zeros((2, 2))
    centre = np.asarray(np.linalg.solve(J, -fit.parameters[:2]), dtype=np.float64)
    slope = -np.linalg.solve(J, np.hstack((np.eye(2), np.kron(np.eye(2), centre[None]))))
    return float(size[0]), centre, slope @ fit.covariance @ slope.T


def _stands_still(fit: _Fit, sign: float) -> tuple[float, Array | None, Array]:
    """Gain, where z0 + b w + k w^2 has no slope, and the covariance of that."""
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


def trial(
    settings: Sequence[Setting], positions: Sequence[tuple[float, float]], kind: str | None
) -> dict[str, Any]:
    """Return how the harmonics of settings follow the positions, as plain data."""
    if kind == MAGNET and len(settings) < 4:
        raise RecordError(
            "which order of a magnet follows the stage, in proportion or as the square, takes four "
            "positions, better five: measure at one more, such as '20,20'"
        )
    at = [{h.order: h for h in s.harmonics} for s in settings]
    shared = sorted(set.intersection(*(set(one) for one in at)))
    found = [response_to_moves(positions, [one[n] for one in at]) for n in shared]
    best = _best(found, kind)
    last = positions[-1]
    out: dict[str, Any] = {
        "positions": [list(p) for p in positions],
        "unit": "m",
        "harmonic_unit": "m" if settings[0].radial else "rad",
        "orders": [_as_data(r) for r in found],
        "order": None if best is None else best.order,
        "notes": _notes(best, kind, len(settings), last),
    }
    if best is not None and best.x is not None and best.y is not None:
        out["centre"] = {
            "x": best.x.value, "y": best.y.value, "unit": "m",
            "uncertainty_x": best.x.uncertainty, "uncertainty_y": best.y.uncertainty,
            "move_from_last": [best.x.value - last[0], best.y.value - last[1]],
        }  # fmt: skip
    return out


def _best(found: list[OrderResponse], kind: str | None) -> OrderResponse | None:
    """The order that eccentricity shows in: 1, but of a magnet the one that says most of it."""
    known = [r for r in found if r.x is not None and r.y is not None]
    if kind != MAGNET:
        return next((r for r in known if r.order == 1 and r.follows == "in proportion"), None)
    return min(known, key=_unsure, default=None)


def _unsure(r: OrderResponse) -> float:
    return math.inf if r.x is None or r.y is None else math.hypot(r.x.uncertainty, r.y.uncertainty)


def _as_data(r: OrderResponse) -> dict[str, Any]:
    return {
        "order": r.order,
        "change": r.change,
        "left": r.left,
        "follows": r.follows,
        "gain": r.gain,
        "x": None if r.x is None else r.x.value,
        "y": None if r.y is None else r.y.value,
        "uncertainty_x": None if r.x is None else r.x.uncertainty,
        "uncertainty_y": None if r.y is None else r.y.uncertainty,
    }


def _notes(
    best: OrderResponse | None, kind: str | None, count: int, last: tuple[float, float]
) -> list[str]:
    if best is None:
        which = "no order follows" if kind == MAGNET else "order 1 does not follow"
        return [
            f"{which} the positions in both directions: no centre is given; check --stage-at, make "
            "the moves larger, or measure at more positions"
        ]
    notes = []
    if count == 3:
        notes.append(
            "three positions are as many as proportion has numbers: a fourth would show whether it "
            "holds"
        )
    if _is_there(best, last):
        notes.append(
            "the move from the last position is within its uncertainty: the scale is centred as "
            "well as these records tell"
        )
    if best.follows == "in proportion":
        notes.append(
            f"there the whole of order {best.order} vanishes, with what of it is the scale's or "
            "its signals' own: measure again there"
        )
    return notes


def _is_there(best: OrderResponse, last: tuple[float, float]) -> bool:
    """Say whether a position is the centre, as far as that is known with 95 % confidence."""
    return (
        best.x is not None
        and best.y is not None
        and best.x.covers(last[0])
        and best.y.covers(last[1])
    )
