"""How a Bouc-Wen model is fitted."""

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flexstage.hysteresis.identification.families.family import Data
from flexstage.hysteresis.identification.families.search import SearchFamily
from flexstage.hysteresis.identification.measurement import Section
from flexstage.hysteresis.models.bouc_wen import BoucWen

__all__ = ["BoucWenFamily", "shape_at"]

Array = NDArray[np.float64]

#: Range of (beta + gamma) times the range of the input, in powers of ten, ...
_STIFFNESS = (-1.0, 2.5)
#: ... and of (beta - gamma) / (beta + gamma).
_RATIO = (-0.95, 5.0)


def shape_at(place: Array, scale: float) -> tuple[float, float]:
    """Return beta and gamma of a point of the search, for a hysteretic part of unit gain.

    Parameters
    ----------
    place : numpy.ndarray
        Two numbers from 0 to 1.
    scale : float
        Range of the input.

    Returns
    -------
    tuple of float
        Beta and gamma [per unit of the input].
    """
    total = 10.0 ** (_STIFFNESS[0] + place[0] * (_STIFFNESS[1] - _STIFFNESS[0])) / scale
    ratio = _RATIO[0] + place[1] * (_RATIO[1] - _RATIO[0])
    return float(0.5 * total * (1.0 + ratio)), float(0.5 * total * (1.0 - ratio))


class BoucWenFamily(SearchFamily):
    """Two parameters are searched for: a Bouc-Wen model is linear in its two gains.

    Put h = A g; then g' = u' - b |u'| |g|^(n-1) g - c u' |g|^n with b = beta A^(n-1) and
    c = gamma A^(n-1). With b and c given, the output d u - A g is linear in d and A.

    Parameters
    ----------
    exponent : float
        Exponent n. It is not searched for: records of piezo drives do not determine it.
    """

    kind: ClassVar[str] = "bouc-wen"
    title: ClassVar[str] = "Bouc-Wen"
    grid = (8, 6)

    def __init__(self, exponent: float = 1.0) -> None:
        self._exponent = exponent

    @property
    def size(self) -> int:
        """Number of parameters."""
        return 4

    def columns(self, section: Section, place: Array, data: Data) -> Array:
        """Return the input, and the hysteretic part of unit gain with its sign turned.

        Parameters
        ----------
        section : Section
            The section.
        place : numpy.ndarray
            The searched parameters, each from 0 to 1, shape (2,).
        data : Data
            The data, for what belongs to all sections.

        Returns
        -------
        numpy.ndarray
            Quasi-static columns at every sample, shape (n, 2).
        """
        beta, gamma = shape_at(place, data.input_scale)
        unit = BoucWen(
            gain=0.0, hysteresis_gain=1.0, beta=beta, gamma=gamma, exponent=self._exponent
        )
        return np.column_stack((section.u, unit.simulate(section.u).values))

    def build(self, place: Array, coefficients: Array, data: Data) -> BoucWen:
        """Return the model that some parameters make.

        Parameters
        ----------
        place : numpy.ndarray
            The searched parameters, each from 0 to 1, shape (2,).
        coefficients : numpy.ndarray
            The two gains, shape (2,).
        data : Data
            The data.

        Returns
        -------
        BoucWen
            The model.
        """
        beta, gamma = shape_at(place, data.input_scale)
        gain = max(float(coefficients[1]), 1e-12 * data.measurement.stroke / data.input_scale)
        scale = gain ** (1.0 - self._exponent)
        return BoucWen(
            gain=float(coefficients[0]),
            hysteresis_gain=gain,
            beta=beta * scale,
            gamma=gamma * scale,
            exponent=self._exponent,
        )
