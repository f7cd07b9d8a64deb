"""Motion of a rigid body from sensors that each look at it along a line."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import ModelError, RecordError
from flexstage.estimate import Component, Estimate
from flexstage.measure.motion.rigid_body import PARAMETERS

#: Share of the largest singular value below which a motion counts as not seen.
_UNSEEN = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorMotion:
    """Small motions of a body, as a set of sensors sees them."""

    parameters: tuple[str, ...]
    """Which of along, across, vertical, roll, pitch and yaw were fitted."""
    values: Array
    """Their values [m or rad], shape (..., p)."""
    covariance: Array
    """Their covariance, the same for all poses, shape (p, p)."""
    residuals: Array
    """Measured less fitted readings [m], shape (..., s)."""
    rank: int
    """How many motions the sensors tell apart."""
    degrees_of_freedom: float
    """Of the uncertainty: infinite where the variance of the readings was given."""

    def estimate(self, parameter: str, pose: int | tuple[int, ...] = ()) -> Estimate:
        """Return one parameter of one pose with its uncertainty."""
        if parameter not in self.parameters:
            raise ModelError(f"the sensors gave {', '.join(self.parameters)}, not {parameter!r}")
        i = self.parameters.index(parameter)
        noise = Component(
            name="noise of the sensors",
            uncertainty=float(np.sqrt(self.covariance[i, i])),
            degrees_of_freedom=self.degrees_of_freedom,
        )
        unit = "m" if PARAMETERS.index(parameter) < 3 else "rad"
        return Estimate(value=float(self.values[pose][i]), unit=unit, components=(noise,))


def from_sensors(
    positions: ArrayLike,
    directions: ArrayLike,
    readings: ArrayLike,
    *,
    variance: ArrayLike | None = None,
    about: ArrayLike = (0.0, 0.0, 0.0),
    parameters: Sequence[str] = PARAMETERS,
) -> SensorMotion:
    """Return the small motion of a body from the readings of sensors at known places.

    A sensor at p that looks along d sees ``d . (t + theta x (p - about))``, with t the displacement
    of the point `about` and theta the turns about the three axes (roll, pitch, yaw). Positions [m]
    and directions, shape (s, 3), are of the line that each sensor looks along, in a frame whose
    first axis is along travel and whose third is vertical; a reading grows with motion along its
    direction. Readings [m], shape (..., s), are less what was read in the reference pose; their
    variance [m^2], shape () or (s,), is found from the residuals of all poses together where not
    given. Motions that are no `parameters` count as 0.

    Validity
    --------
    Small motions: what a sensor sees of the square of an angle times its distance from `about`, and
    of motion of a face square to its normal, is left out.

    Examples
    --------
    >>> at = [[0.0, 20e-3, 0.0], [0.0, -20e-3, 0.0], [0.0, 0.0, 15e-3]]
    >>> read = [1.3e-6, 0.9e-6, 1.4e-6]
    >>> seen = from_sensors(at, [[1.0, 0.0, 0.0]] * 3, read, variance=1e-18,
    ...                     parameters=("along", "pitch", "yaw"))
    >>> print(f"yaw {1e6 * seen.estimate('yaw').value:.1f} urad")
    yaw -10.0 urad
    """
    p, d = np.asarray(positions, dtype=np.float64), np.asarray(directions, dtype=np.float64)
    y = np.asarray(readings, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3 or d.shape != p.shape or y.shape[-1:] != p.shape[:1]:
        raise RecordError(
            "each sensor needs a place, a direction and a reading, got shapes "
            f"{p.shape}, {d.shape} and {y.shape}"
        )
    if not all(np.isfinite(v).all() for v in (p, d, y)):
        raise RecordError("places, directions and readings of sensors must be finite")
    length = np.linalg.norm(d, axis=1, keepdims=True)
    if not np.all(length > 0.0):
        raise RecordError("a direction of a sensor is nothing: give a vector that is not 0")
    names = tuple(parameters)
    if not names or not set(names) <= set(PARAMETERS) or len(set(names)) < len(names):
        raise ModelError(f"what is sought is of {', '.join(PARAMETERS)}, each once, got {names}")
    unit, arm = d / length, p - np.asarray(about, dtype=np.float64)
    # angles times the size of the set-up, so that a small set-up is not taken for a poor one
    size = float(np.sqrt(np.mean(np.sum((p - p.mean(0)) ** 2, axis=1)))) or 1.0
    every = np.concatenate([unit, np.cross(arm, unit) / size], axis=1)
    columns = [PARAMETERS.index(name) for name in names]
    units = np.where(np.array(columns) < 3, 1.0, size)
    noise = _noise(variance, len(p))
    A = every[:, columns] / noise[:, None]
    U, S, Vt = np.linalg.svd(A, full_matrices=False)
    rank = int(np.sum(_UNSEEN * S[0] < S))
    if rank < len(names):
        unseen = names[int(np.argmax(np.abs(Vt[-1])))] if len(Vt) == len(names) else names[-1]
        raise ModelError(
            f"{len(p)} sensors determine {rank} of the {len(names)} motions, and not {unseen}: add "
            "a sensor, or leave out motions that cannot occur"
        )
    inverse = (Vt.T / S) @ U.T
    found = y / noise @ inverse.T
    rest = y / noise - found @ A.T
    spread, freedom = (Vt.T / S**2) @ Vt, np.inf
    if variance is None:
        redundancy = (len(p) - rank) * (y.size // len(p))
        if not redundancy:
            raise ModelError(
                f"{len(p)} sensors for {rank} motions leave no residual: give the variance of a "
                "reading"
            )
        spread, freedom = spread * float(np.sum(rest**2)) / redundancy, float(redundancy)
    return SensorMotion(
        parameters=names,
        values=found / units,
        covariance=spread / np.outer(units, units),
        residuals=np.asarray(rest * noise, dtype=np.float64),
        rank=rank,
        degrees_of_freedom=freedom,
    )


def _noise(variance: ArrayLike | None, s: int) -> Array:
    if variance is None:
        return np.ones(s)
    v = np.asarray(variance, dtype=np.float64)
    if v.shape not in {(), (s,)} or not np.all((v > 0.0) & np.isfinite(v)):
        raise ModelError(f"the variance of {s} sensors is one positive number or {s}, got {v}")
    return np.broadcast_to(np.sqrt(v), (s,))
