"""A drive as it was identified: hysteresis, then the linear chain up to the reading."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.errors import ModelError
from flexstage.hysteresis.chain import Creep, Lag, StageModes
from flexstage.hysteresis.model import Array, HysteresisModel, samples

__all__ = ["DriveModel", "ValidityRange"]

#: Cycles after which the memory of what was before is gone, also where it fades only.
_CONDITIONING = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidityRange:
    """What a model was identified on, beyond which it extrapolates.

    Parameters
    ----------
    input_range : tuple of float
        Lowest and highest input [`input_unit`].
    output_range : tuple of float
        Lowest and highest output [`output_unit`].
    rate_range_hz : tuple of float
        Slowest and fastest cycles [Hz].
    temperature : tuple of float or None
        Lowest and highest temperature [K]; None where nobody has said.
    """

    input_range: tuple[float, float]
    output_range: tuple[float, float]
    rate_range_hz: tuple[float, float]
    temperature: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveModel:
    """Hysteresis, creep, modes and delay in a row, from the command to the reading.

    ``reading(t) = offset + sign x modes(creep(hysteresis(command)))(t - delay)``

    Parameters
    ----------
    hysteresis : HysteresisModel
        The hysteresis.
    creep : Creep or None
        Creep of what the hysteresis gives; None for none.
    modes : StageModes or None
        Modes of the stage in the reading, at unit static gain; None for none.
    lag : Lag or None
        Delay and lag of the acquisition; None for none.
    offset : float
        Reading at no command, with no history [`output_unit`].
    sign : float
        1 where the reading rises with the command, -1 where it falls.
    input_unit : str
        Unit of the command; empty where nobody has said.
    output_unit : str
        Unit of the reading; empty where nobody has said.
    validity : ValidityRange or None
        What it was identified on.
    """

    hysteresis: HysteresisModel
    creep: Creep | None = None
    modes: StageModes | None = None
    lag: Lag | None = None
    offset: float = 0.0
    sign: float = 1.0
    input_unit: str = "V"
    output_unit: str = "m"
    validity: ValidityRange | None = None

    def conditioned(self) -> Array:
        """Return the state of the hysteresis after cycles over all of the range, at its low end.

        What was before them is then forgotten. A drive is brought there by three slow cycles.

        Returns
        -------
        numpy.ndarray
            The state.

        Raises
        ------
        ModelError
            The model does not say on which range it was identified.
        """
        if self.validity is None:
            raise ModelError(
                "the model has no range to be conditioned over: give it a validity range"
            )
        low, high = self.validity.input_range
        return self.hysteresis.simulate([high, low] * _CONDITIONING).state

    def simulate(self, u: ArrayLike, dt: float, state: ArrayLike | None = None) -> Array:
        """Return the readings for a sequence of commands.

        Parameters
        ----------
        u : array_like
            Commands [`input_unit`], shape (n,).
        dt : float
            Time from one sample to the next [s].
        state : array_like, optional
            State of the hysteresis before the first of them; no history where not given.

        Returns
        -------
        numpy.ndarray
            Readings [`output_unit`], shape (n,). Creep, modes and lag have settled at the first
            command.
        """
        y = self.hysteresis.simulate(samples(u, "command"), state).values
        for element in (self.creep, self.modes, self.lag):
            if element is not None:
                y = element.simulate(y, dt).values
        return self.offset + self.sign * y

    def outside(self, u: ArrayLike) -> str:
        """Say where commands leave what the model was identified on.

        Parameters
        ----------
        u : array_like
            Commands [`input_unit`], shape (n,).

        Returns
        -------
        str
            One sentence, or an empty text where they stay inside.
        """
        if self.validity is None:
            return ""
        given = np.asarray(u, dtype=np.float64)
        low, high = self.validity.input_range
        margin = 1e-6 * (high - low)
        if given.min() >= low - margin and given.max() <= high + margin:
            return ""
        unit = f" {self.input_unit}" if self.input_unit else ""
        return (
            f"the commands reach {given.min():g} to {given.max():g}{unit}, the model was "
            f"identified on {low:g} to {high:g}{unit}: what it says beyond is extrapolated"
        )
