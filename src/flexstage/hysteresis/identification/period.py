"""One period of a steady motion, in a record that closes."""

from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.hysteresis.identification.cycles import cycles, input_noise, turning_points
from flexstage.records.quality import difference_noise

#: Smallest swing of the one major cycle, as a share of the range, as elsewhere.
_MAJOR = 0.9
#: Most complete cycles of a record that is taken for a period by itself: with more of them the
#: record shows by its own cycles how far they repeat.
_CYCLES = 2
#: Largest gap between the ends of a period, over the steps there (without a closing row it is one
#: step), and over the standard deviation of the noise.
_STEPS, _NOISE = 1.5, 5.0
#: Largest gap beyond these of a record that is said to be a period, as a share of the range.
_LARGEST_GAP = 0.1


@dataclass(frozen=True, slots=True)
class RecordEnds:
    """How a record closes if it is repeated."""

    samples: int
    """Samples of the period, without a closing row."""
    major_cycles: float
    """Major cycles of a period."""
    cycles: int
    """All cycles of a period."""
    gaps: tuple[float, float]
    """Gaps of input and output between its ends beyond steps and noise, as shares of the ranges."""

    @classmethod
    def of(cls, u: Array, y: Array) -> "RecordEnds":
        """Find the gaps of a complete record."""
        repeated, steps = np.tile(u, 3), (abs(u[1] - u[0]), abs(u[-1] - u[-2]))
        major = turning_points(repeated, _MAJOR * float(np.ptp(u)))
        return cls(
            samples=u.size - int(abs(u[-1] - u[0]) <= 0.5 * min(steps)),
            major_cycles=0.5 * np.count_nonzero(major // u.size == 1),
            cycles=int(np.count_nonzero(cycles(repeated, 1.0).bounds // u.size == 1)),
            gaps=(_gap(u, input_noise(u)), _gap(y, difference_noise(y, 3))),
        )

    @property
    def show_period(self) -> bool:
        """True for one major cycle that closes.

        A cycle that ends by chance at the reading of its begin is taken for a period, too.
        """
        return self.major_cycles == 1.0 and self.cycles <= _CYCLES and max(self.gaps) <= 0.0


def _gap(x: Array, noise: float) -> float:
    allowed = _STEPS * max(abs(x[1] - x[0]), abs(x[-1] - x[-2])) + _NOISE * noise
    return max(float(abs(x[-1] - x[0]) - allowed), 0.0) / float(np.ptp(x))


def closed_loop(
    u: Array, y: Array, source: str, *, stated: bool
) -> tuple[Array, Array, int, str] | None:
    """Return one period from its low end back to it, its first sample, and a warning of its ends.

    None if a record is not stated to be a period and does not show one.
    """
    first = int(np.argmax(np.isfinite(y)))  # rows before it only set the memory of a table
    u, y = u[first:], y[first:]
    if not np.isfinite(y).all():
        if stated:
            raise RecordError(f"{source} has unmeasured rows inside: omit --periodic")
        return None
    ends = RecordEnds.of(u, y)
    if stated and (ends.major_cycles != 1.0 or max(ends.gaps) > _LARGEST_GAP):
        raise RecordError(
            f"{source} has {ends.major_cycles:g} major cycles, and its ends differ by "
            f"{100 * ends.gaps[0]:.2g} % of the input range and {100 * ends.gaps[1]:.2g} % of the "
            "output range beyond noise: --periodic needs one major cycle and ends that differ by "
            f"at most {100 * _LARGEST_GAP:g} %; select one period by --rows, or omit --periodic"
        )
    if not stated and not ends.show_period:
        return None
    n = ends.samples
    order = (int(np.argmin(u[:n])) + np.arange(n + 1)) % n
    warning = (
        f"the ends of {source} differ by {100 * ends.gaps[1]:.2g} % of the output range beyond "
        "noise: the motion was not steady, or the sensor drifts or jumps within the period"
    )
    return u[order], y[order], first, warning if ends.gaps[1] > 0.0 else ""
