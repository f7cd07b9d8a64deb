"""Fit of the Prandtl-Ishlinskii model."""

from collections.abc import Iterator

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.model_fit import FitData, LinearFit
from flexstage.hysteresis.models.play_sum import play_columns
from flexstage.hysteresis.models.prandtl_ishlinskii.law import PrandtlIshlinskii

#: Number of plays.
PLAYS = 20
#: Smallest slope, over the mean slope, of plays that other fits begin with, and of a line behind
#: plays: both must have an inverse.
FLATTEST = 0.05


def _thresholds(data: FitData) -> Array:
    """Thresholds of plays over the range that the input determines.

    Small loops need more of them than large ones, so their distance grows; none is zero.
    """
    # a play of more than half of the range moves once, on the way out of rest
    share = np.arange(1, PLAYS + 1) / (PLAYS + 1)
    return 0.5 * data.input_scale * share**1.5


class PrandtlIshlinskiiFit(LinearFit):
    """Weights of plays that are not negative."""

    law = PrandtlIshlinskii
    size = 1 + PLAYS
    automatic = False

    def columns(self, section: RecordSection, data: FitData) -> Iterator[Array]:
        yield np.column_stack((section.u, play_columns(section.u, _thresholds(data))))

    def build(self, coefficients: Array, data: FitData) -> PrandtlIshlinskii:
        return PrandtlIshlinskii(
            gain=float(coefficients[0]), thresholds=_thresholds(data), weights=coefficients[1:]
        )


def interior_kinks(data: FitData, plays: PrandtlIshlinskii, count: int) -> Array:
    """Return kinks of a line behind plays: uniform over the output, and not at zero."""
    ends = [plays.simulate(s.u).values[s.warm_up :] for s in data.sections]
    low, high = min(e.min() for e in ends), max(e.max() for e in ends)
    kinks = np.linspace(low, high, count + 2)[1:-1]
    distance = (high - low) / (count + 1)
    near = np.abs(kinks) < 0.05 * distance
    return np.where(near, 0.05 * distance, kinks)
