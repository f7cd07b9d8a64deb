"""How a Prandtl-Ishlinskii model is fitted."""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from flexstage.arrays import Array
from flexstage.hysteresis.identification.families.family import Data, LinearFamily
from flexstage.hysteresis.identification.measurement import Section
from flexstage.hysteresis.models.play import play_columns
from flexstage.hysteresis.models.prandtl_ishlinskii import PrandtlIshlinskii

#: Number of plays.
PLAYS = 20


def _thresholds(data: Data) -> Array:
    """Thresholds of plays that are spread over all that the input can tell apart.

    Small loops need more of them than large ones, so their distance grows; none is zero.
    """
    # a play of more than half of the range moves once, on the way out of rest
    share = np.arange(1, PLAYS + 1) / (PLAYS + 1)
    return 0.5 * data.input_scale * share**1.5


class PrandtlIshlinskiiFamily(LinearFamily):
    """Weights of plays that are not negative."""

    kind: ClassVar[str] = "prandtl-ishlinskii"
    title: ClassVar[str] = "Prandtl-Ishlinskii"
    size = 1 + PLAYS

    def columns(self, section: Section, data: Data) -> Iterator[Array]:
        yield np.column_stack((section.u, play_columns(section.u, _thresholds(data))))

    def build(self, coefficients: Array, data: Data) -> PrandtlIshlinskii:
        return PrandtlIshlinskii(
            gain=float(coefficients[0]), thresholds=_thresholds(data), weights=coefficients[1:]
        )

    def names(self) -> tuple[str, ...]:
        return ("gain", *(f"weights[{i}]" for i in range(PLAYS)))
