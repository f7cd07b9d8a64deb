"""How a Dahl model is fitted."""

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flexstage.hysteresis.identification.families.family import Data
from flexstage.hysteresis.identification.families.search import SearchFamily
from flexstage.hysteresis.identification.measurement import Section
from flexstage.hysteresis.models.dahl import Dahl

__all__ = ["DahlFamily"]

Array = NDArray[np.float64]

#: Range of the slope of friction over its limit, times the range of the input, in powers of ten.
_STIFFNESS = (-0.5, 2.5)


class DahlFamily(SearchFamily):
    """One parameter is searched for: the model is linear in its gain and in friction."""

    kind: ClassVar[str] = "dahl"
    title: ClassVar[str] = "Dahl"
    grid = (16,)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return 3

    def columns(self, section: Section, place: Array, data: Data) -> Array:
        """Return the input, and friction of unit slope with its sign turned.

        Parameters
        ----------
        section : Section
            The section.
        place : numpy.ndarray
            The searched parameters, each from 0 to 1, shape (1,).
        data : Data
            The data, for what belongs to all sections.

        Returns
        -------
        numpy.ndarray
            Quasi-static columns at every sample, shape (n, 2).
        """
        unit = Dahl(gain=0.0, stiffness=1.0, limit=_limit(place, data.input_scale))
        return np.column_stack((section.u, unit.simulate(section.u).values))

    def build(self, place: Array, coefficients: Array, data: Data) -> Dahl:
        """Return the model that some parameters make.

        Parameters
        ----------
        place : numpy.ndarray
            The searched parameters, each from 0 to 1, shape (1,).
        coefficients : numpy.ndarray
            The linear parameters, shape (2,).
        data : Data
            The data.

        Returns
        -------
        Dahl
            The model.
        """
        least = 1e-12 * data.measurement.stroke / data.input_scale
        stiffness = max(float(coefficients[1]), least)
        limit = stiffness * _limit(place, data.input_scale)
        return Dahl(gain=float(coefficients[0]), stiffness=stiffness, limit=limit)


def _limit(place: Array, scale: float) -> float:
    """Limit of friction of unit slope, in the unit of the input."""
    return float(scale / 10.0 ** (_STIFFNESS[0] + place[0] * (_STIFFNESS[1] - _STIFFNESS[0])))
