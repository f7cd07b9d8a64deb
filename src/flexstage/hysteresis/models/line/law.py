"""A straight line: a drive without hysteresis."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexstage.hysteresis.model import checked
from flexstage.hysteresis.models.play_model import (
    PlayModel,
    Sum,
    plays_c_code,
    plays_matlab_code,
    terms,
)
from flexstage.hysteresis.models.source_code import HysteresisCode, tunable_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Line(PlayModel):
    """A drive without hysteresis, ``y = gain u``.

    Notes
    -----
    Validity: loops narrower than the noise, and a curve without bend. It is a sum of plays with one
    play, of threshold and weight zero, so that its state is the input twice.

    Examples
    --------
    >>> Line(gain=0.25).simulate([4.0, 12.0]).values
    array([1., 3.])
    """

    kind: ClassVar[str] = "line"
    title: ClassVar[str] = "Straight line"
    units: ClassVar[Mapping[str, str]] = {"gain": "{y}/{u}"}

    gain: float
    """Slope [unit of y per unit of u]; positive for an inverse."""

    def __post_init__(self) -> None:
        self._set(gain=checked(self.gain, "gain"))

    def play_terms(self) -> Sum:
        return terms(self.gain, np.zeros(1), np.empty(0), np.zeros((1, 1)))


def c_code(model: Line) -> HysteresisCode:
    """Return the code in C, whose gain can be changed."""
    return plays_c_code(model, [tunable_of(model, "gain", 2, "slope")])


matlab_code = plays_matlab_code
