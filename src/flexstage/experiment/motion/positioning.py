"""Accuracy and repeatability of positioning at targets, in the manner of ISO 230-2."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import RecordError
from flexstage.estimate import Estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Positioning:
    r"""Figures of positioning along an axis, named and defined as in ISO 230-2:2014, clause 3.

    With the positional deviations :math:`x_{ij}` of target i in run j, approached upward or
    downward, their mean :math:`\bar x_i` over the n runs and their standard deviation
    :math:`s_i` with n - 1.
    """

    target: Array
    """Target positions, rising [m], shape (m,)."""
    mean_upward: Array
    """Mean unidirectional positional deviations from below [m], shape (m,)."""
    mean_downward: Array
    """Mean unidirectional positional deviations from above [m], shape (m,)."""
    spread_upward: Array
    """Estimators s of the unidirectional repeatability at each target from below [m], shape (m,).
    """
    spread_downward: Array
    """Estimators s of the unidirectional repeatability at each target from above [m], shape (m,).
    """
    runs: int
    """Number n of runs upward and downward."""
    reversal: Estimate
    """Reversal value B of the axis: the largest magnitude of the mean upward less the mean downward
    deviation [m].
    """
    mean_reversal: Estimate
    """Mean over the targets of upward less downward [m]."""
    repeatability_upward: Estimate
    """Unidirectional repeatability from below: the largest of R_i = 4 s_i [m]."""
    repeatability_downward: Estimate
    """Unidirectional repeatability from above: the largest of R_i = 4 s_i [m]."""
    repeatability: Estimate
    """Bidirectional repeatability R: the largest of ``max(2 s_i up + 2 s_i down + |B_i|, R_i up,
    R_i down)`` [m].
    """
    systematic_upward: Estimate
    """Unidirectional systematic positional deviation E from below: largest less smallest mean [m].
    """
    systematic_downward: Estimate
    """Unidirectional systematic positional deviation E from above: largest less smallest mean [m].
    """
    systematic: Estimate
    """Bidirectional systematic positional deviation E: the same over both directions [m]."""
    mean_deviation: Estimate
    """Mean bidirectional positional deviation M: largest less smallest of the means of both [m]."""
    accuracy_upward: Estimate
    """Unidirectional accuracy A from below: largest of mean + 2 s less smallest of mean - 2 s [m].
    """
    accuracy_downward: Estimate
    """Unidirectional accuracy A from above: largest of mean + 2 s less smallest of mean - 2 s [m].
    """
    accuracy: Estimate
    """Bidirectional accuracy A: the same over both directions [m]."""

    @property
    def reversal_at_targets(self) -> Array:
        """Reversal values B_i: mean upward less mean downward deviation [m], shape (m,)."""
        return self.mean_upward - self.mean_downward

    @property
    def repeatability_at_targets(self) -> Array:
        """Bidirectional repeatability R_i of each target [m], shape (m,)."""
        up, down = self.spread_upward, self.spread_downward
        both = 2.0 * (up + down) + np.abs(self.reversal_at_targets)
        return np.maximum(both, 4.0 * np.maximum(up, down))

    @property
    def mean_bidirectional(self) -> Array:
        """Mean bidirectional positional deviations [m], shape (m,)."""
        return 0.5 * (self.mean_upward + self.mean_downward)


def positioning(
    target: ArrayLike,
    upward: ArrayLike,
    downward: ArrayLike,
    *,
    trials: int = 2000,
    seed: int = 0,
) -> Positioning:
    """Evaluate repeated approaches to targets from both sides, in the manner of ISO 230-2:2014.

    The values are those of the standard, from the data as they are. Their intervals are found by
    simulating the whole measurement, means, spreads and the run-to-run part that all targets share,
    from the values less the share of noise in them (`positioning_simulation`): a
    largest value of noisy means lies too far out, and the interval about it is not symmetric.

    Parameters
    ----------
    target : array_like
        Target positions [m], shape (m,).
    upward, downward : array_like
        Positions reached from below and from above [m], shape (m, n): one column for each run.
    trials : int
        How many measurements are simulated.
    seed : int
        Seed of the simulation.

    Returns
    -------
    Positioning
        All figures.

    Validity
    --------
    Runs that differ by chance only: a drift from run to run counts as lack of repeatability, as the
    standard has it. The standard asks for n = 5 runs and, of axes up to 2 m, at least five targets
    in a metre; two of each are enough here, with an uncertainty that says so. The measurement
    uncertainty of the instrument is not in it.

    Raises
    ------
    RecordError
        There are fewer than two targets or two runs, the shapes do not belong together, or a value
        is not finite.

    Examples
    --------
    >>> target = np.array([0.0, 20e-6, 40e-6])
    >>> up = target[:, None] + 1e-9 * np.array([[2, 4, 3], [7, 8, 12], [-3, 1, -1]])
    >>> down = target[:, None] + 1e-9 * np.array([[9, 8, 13], [15, 17, 16], [4, 9, 8]])
    >>> found = positioning(target, up, down)
    >>> print(f"B {1e9 * found.reversal.value:.1f} nm, A {1e9 * found.accuracy.value:.1f} nm")
    B 8.0 nm, A 23.0 nm
    """
    x, deviation = _deviations(target, upward, downward)
    from flexstage.experiment.motion import positioning_simulation

    mean, spread = deviation.mean(axis=-1), deviation.std(axis=-1, ddof=1)
    return Positioning(
        target=x, mean_upward=mean[0], mean_downward=mean[1], spread_upward=spread[0],
        spread_downward=spread[1], runs=deviation.shape[-1],
        **positioning_simulation.estimates(deviation, trials=trials, seed=seed),
    )  # fmt: skip


def _deviations(target: ArrayLike, upward: ArrayLike, downward: ArrayLike) -> tuple[Array, Array]:
    """Return sorted targets and deviations from them, shape (2, m, n)."""
    x = np.asarray(target, dtype=np.float64)
    both = [np.asarray(v, dtype=np.float64) for v in (upward, downward)]
    if x.ndim != 1 or any(v.ndim != 2 or v.shape[0] != x.size for v in both):
        raise RecordError(
            "positions must be given for each target (row) and run (column), got shapes "
            f"{both[0].shape} and {both[1].shape} for {x.size} targets"
        )
    runs = {v.shape[1] for v in both}
    if len(runs) != 1:
        raise RecordError(
            "there must be as many runs upward as downward, got "
            f"{both[0].shape[1]} and {both[1].shape[1]}"
        )
    if x.size < 2 or min(runs) < 2:
        raise RecordError(
            f"positioning needs two targets and two runs at least, got {x.size} targets and "
            f"{min(runs)} runs: record more of them"
        )
    if not all(np.isfinite(v).all() for v in (x, *both)):
        raise RecordError("targets and positions must be finite: leave out the targets that failed")
    order = np.argsort(x)
    if np.any(np.diff(x[order]) == 0.0):
        raise RecordError("two targets are the same: put their runs side by side as one")
    return x[order], np.array([v[order] - x[order, None] for v in both])
