"""Fit of a straight line."""

from collections.abc import Iterator

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.model_fit import FitData, LinearFit
from flexstage.hysteresis.models.line.law import Line


class LineFit(LinearFit):
    """A slope; the offset is fitted with every model."""

    law = Line
    size = 1

    def columns(self, section: RecordSection, data: FitData) -> Iterator[Array]:
        yield section.u[:, None]

    def build(self, coefficients: Array, data: FitData) -> Line:
        return Line(gain=float(coefficients[0]))
