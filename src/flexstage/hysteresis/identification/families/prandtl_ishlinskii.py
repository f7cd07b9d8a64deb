"""How a Prandtl-Ishlinskii model is fitted."""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from flexstage.arrays import Array
from flexstage.hysteresis.identification.families.family import Data
from flexstage.hysteresis.identification.families.linear import LinearFamily
from flexstage.hysteresis.identification.measurement import Section
from flexstage.hysteresis.models.play import play_columns
from flexstage.hysteresis.models.prandtl_ishlinskii import PrandtlIshlinskii


def play_thresholds(data: Data, count: int) -> Array:
    """Return thresholds of plays that are spread over all that the input can tell apart.

    Small loops need more of them than large ones, so their distance grows; none is zero.
    """
    # a play of more than half of the range moves once, on the way out of rest
    share = np.arange(1, count + 1) / (count + 1)
    return 0.5 * data.input_scale * share**1.5


class PrandtlIshlinskiiFamily(LinearFamily):
    """Weights of plays that are not negative."""

    kind: ClassVar[str] = "prandtl-ishlinskii"
    title: ClassVar[str] = "Prandtl-Ishlinskii"

    def __init__(self, plays: int = 20) -> None:
        self._plays = plays

    @property
    def size(self) -> int:
        return self._plays + 1

    def columns(self, section: Section, data: Data) -> Iterator[Array]:
        plays = play_columns(section.u, play_thresholds(data, self._plays))
        yield np.column_stack((section.u, plays))

    def build(self, coefficients: Array, data: Data) -> PrandtlIshlinskii:
        return PrandtlIshlinskii(
            gain=float(coefficients[0]),
            thresholds=play_thresholds(data, self._plays),
            weights=coefficients[1:],
        )

    def names(self, data: Data) -> tuple[str, ...]:
        del data
        return ("gain", *(f"weights[{i}]" for i in range(self._plays)))
