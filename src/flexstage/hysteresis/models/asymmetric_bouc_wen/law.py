"""The Bouc-Wen model with a polynomial for what is asymmetric but has no memory."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.errors import ModelError
from flexstage.hysteresis.model import Array, HysteresisModel, ModelProperty, Response, samples
from flexstage.hysteresis.models.bouc_wen_common import (
    BoucWenModel,
    bouc_wen_c_code,
    bouc_wen_matlab_code,
    classical_law,
    classical_properties,
)
from flexstage.hysteresis.models.source_code import HysteresisCode


@dataclass(frozen=True, slots=True, kw_only=True)
class AsymmetricBoucWen(BoucWenModel):
    """Bouc-Wen hysteresis on a cubic, y = d u + d2 u^2 + d3 u^3 - h.

    The hysteretic displacement h is that of Bouc-Wen, ``h' = A u' - beta |u'| |h|^(n-1) h - gamma
    u' |h|^n`` (Wen 1976); a polynomial of the input carries the asymmetry of a piezo drive (as in
    Wang, Chen, Bai 2015, Sens. Actuators A 235:105).

    Notes
    -----
    Validity: inputs between the lowest and the highest; the asymmetry is that of the middle line,
    not of the width; minor loops that need not close; no dependence on rate, no creep. Exact to
    rounding for an input of straight lines. State: last input and h.

    Examples
    --------
    >>> stack = AsymmetricBoucWen(gain=0.593e-6, quadratic=4e-10, cubic=-1e-12, beta=0.05,
    ...     hysteresis_gain=0.441e-6, gamma=0.03, lowest_input=0.0, highest_input=150.0)
    >>> up_and_down = [40.0, 120.0, 40.0]
    >>> [f"{1e6 * y:.3f}" for y in stack.simulate(up_and_down).values]
    ['19.008', '69.680', '29.786']
    """

    kind: ClassVar[str] = "asymmetric-bouc-wen"
    title: ClassVar[str] = "asymmetric Bouc-Wen"
    units: ClassVar[Mapping[str, str]] = {
        "gain": "{y}/{u}",
        "quadratic": "{y}/{u}^2",
        "cubic": "{y}/{u}^3",
        "hysteresis_gain": "{y}/{u}",
        "beta": "1/{u}",
        "gamma": "1/{u}",
        "lowest_input": "{u}",
        "highest_input": "{u}",
    }

    gain: float
    """Gain d of the straight part [unit of y per unit of u]."""
    quadratic: float
    """Factor d2 of u^2 [unit of y per unit of u squared]."""
    cubic: float
    """Factor d3 of u^3 [unit of y per unit of u cubed]."""
    hysteresis_gain: float
    """Gain A of the hysteretic part, the slope dh/du at h = 0 [unit of y per unit of u]; above
    zero.
    """
    beta: float
    """Parameter beta of the dissipation [per unit of u, times unit of y to the power 1 - n]."""
    gamma: float
    """Parameter gamma of the shape of the loop, unit as beta."""
    lowest_input: float
    """Lowest input at which the polynomial is meant [unit of u]; the inverse stays above."""
    highest_input: float
    """Highest input at which the polynomial is meant [unit of u]; the inverse stays below."""
    exponent: float = 1.0
    """Exponent n, at least 1: how sharply h turns into saturation."""

    def __post_init__(self) -> None:
        self._check("hysteresis_gain")
        self._check_exponent()
        if not self.lowest_input < self.highest_input:
            raise ModelError(
                f"the lowest_input of {self.title} must be below its highest_input, got "
                f"{self.lowest_input:.6g} and {self.highest_input:.6g}"
            )

    @property
    def input_limits(self) -> tuple[float, float]:
        return self.lowest_input, self.highest_input

    #: Between samples the cubic is neither a line nor an exponential.
    segments = HysteresisModel.segments

    def inverse(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        where = (
            f"from the lowest_input {self.lowest_input:.6g} to the highest_input "
            f"{self.highest_input:.6g}"
        )
        return self._reaching(y, state, where, "stay within")

    def nearest(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        outputs = samples(y, "output")
        start = self._state(state)
        low, high = self.lowest_input, self.highest_input
        if not low <= start[0] <= high or self.beta + self.gamma < 0.0:
            raise ModelError(
                f"{self.title} is inverted only from an input between {low:.6g} and {high:.6g} "
                f"and with beta + gamma at least zero, got {start[0]:.6g} and "
                f"{self.beta + self.gamma:.6g}"
            )
        least = self._least_slope()
        bound = f"least slope {least:.6g} of the cubic"
        return self._inputs(outputs, start, (low, high, least), bound)

    def properties(self) -> tuple[ModelProperty, ...]:
        bounded, dissipative, steepest = classical_properties(
            self.hysteresis_gain, self.beta, self.gamma, self.exponent
        )
        least = self._least_slope()
        condition = (
            f"least slope of the cubic from {self.lowest_input:.6g} to {self.highest_input:.6g} "
            "above the steepest dh/du"
        )
        return bounded, dissipative, self._invertible(least, steepest, condition)

    def _least_slope(self) -> float:
        """Return the least slope of the cubic within its range of inputs."""
        places = [self.lowest_input, self.highest_input]
        if self.cubic != 0.0:
            turn = -self.quadratic / (3.0 * self.cubic)
            if self.lowest_input < turn < self.highest_input:
                places.append(turn)
        return min(self.gain + u * (2.0 * self.quadratic + u * 3.0 * self.cubic) for u in places)

    def _law(self) -> Array:
        return classical_law(self.hysteresis_gain, self.beta, self.gamma, self.exponent)

    def _cubic(self) -> Array:
        return np.array([self.gain, self.quadratic, self.cubic])


def c_code(model: AsymmetricBoucWen) -> HysteresisCode:
    """Return the code in C, without pieces and without limits of the input."""
    names = ("gain", "quadratic", "cubic", "hysteresis_gain", "beta", "gamma")
    return bouc_wen_c_code(model, names, 0)


matlab_code = bouc_wen_matlab_code
