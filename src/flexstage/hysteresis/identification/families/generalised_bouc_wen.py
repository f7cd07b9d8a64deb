"""How a generalised Bouc-Wen model is fitted."""

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flexstage.hysteresis.identification.families.bouc_wen import BoucWenFamily
from flexstage.hysteresis.identification.families.family import Data
from flexstage.hysteresis.identification.families.refined import RefinedFamily
from flexstage.hysteresis.models.bouc_wen import BoucWen
from flexstage.hysteresis.models.generalised_bouc_wen import GeneralisedBoucWen

__all__ = ["GeneralisedBoucWenFamily"]

Array = NDArray[np.float64]


class GeneralisedBoucWenFamily(RefinedFamily):
    """Two gains and six parameters of the shape; begun from the best Bouc-Wen model."""

    kind: ClassVar[str] = "generalised-bouc-wen"
    title: ClassVar[str] = "generalised Bouc-Wen"

    @property
    def size(self) -> int:
        """Number of parameters."""
        return 8

    def begin(self, data: Data) -> Array:
        """Return the parameters that the search begins with.

        Parameters
        ----------
        data : Data
            The data.

        Returns
        -------
        numpy.ndarray
            The two gains, then the shape, shape (8,).
        """
        key = f"{self.kind} start"
        if key not in data.memo:
            found = BoucWenFamily().fit(data).model
            assert isinstance(found, BoucWen)
            first = [found.gain, found.hysteresis_gain, found.beta, 0.0, found.gamma, 0.0, 0.0, 0.0]
            data.memo[key] = [np.array(first)]
        return data.memo[key][0].copy()

    def bounds(self, data: Data) -> tuple[Array, Array]:
        """Return the lower bounds of the parameters, and by how much each may change at once.

        Parameters
        ----------
        data : Data
            The data.

        Returns
        -------
        tuple of numpy.ndarray
            Lowest values, minus infinity for none, and scales; shape (8,) each.
        """
        slope = data.measurement.stroke / data.input_scale
        low = np.full(8, -np.inf)
        low[:2] = 0.0, 1e-6 * slope
        scale = np.full(8, 10.0 / data.input_scale)
        scale[:2] = slope
        return low, scale

    def build(self, parameters: Array, data: Data) -> GeneralisedBoucWen:
        """Return the model that some parameters make.

        Parameters
        ----------
        parameters : numpy.ndarray
            The two gains, then the shape, shape (8,).
        data : Data
            The data.

        Returns
        -------
        GeneralisedBoucWen
            The model.
        """
        low, high = data.measurement.input_range
        return GeneralisedBoucWen(
            gain=float(parameters[0]),
            hysteresis_gain=float(parameters[1]),
            shape=tuple(float(p) for p in parameters[2:]),
            centre=0.5 * (low + high),
        )
