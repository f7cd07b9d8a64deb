"""The Bouc-Wen model."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from flexstage.hysteresis.model import Array, ModelProperty
from flexstage.hysteresis.models.bouc_wen_common import (
    BoucWenModel,
    bouc_wen_c_code,
    bouc_wen_matlab_code,
    classical_law,
    classical_properties,
)
from flexstage.hysteresis.models.source_code import HysteresisCode


@dataclass(frozen=True, slots=True, kw_only=True)
class BoucWen(BoucWenModel):
    """Bouc-Wen hysteresis y = d u - h (Bouc 1967; Wen 1976).

    The hysteretic displacement h obeys ``h' = A u' - beta |u'| |h|^(n-1) h - gamma u' |h|^n``
    (Wen 1976, J. Eng. Mech. Div. ASCE 102:249); y = d u - h is the form used for piezo drives
    (Low, Guo 1995, J. Microelectromech. Syst. 4:230).

    Notes
    -----
    Validity: a loop that is odd about its centre (no asymmetry between up and down), minor loops
    that need not close, no dependence on rate, no creep. Exact to rounding for an input of straight
    lines: 1e-18 m in a stroke of 60 um. State: last input and h.

    Examples
    --------
    >>> stack = BoucWen(gain=0.593e-6, hysteresis_gain=0.441e-6, beta=0.05, gamma=0.03)
    >>> up_and_down = [40.0, 120.0, 40.0]
    >>> [f"{1e6 * y:.3f}" for y in stack.simulate(up_and_down).values]
    ['18.432', '65.648', '29.210']
    """

    kind: ClassVar[str] = "bouc-wen"
    title: ClassVar[str] = "Bouc-Wen"
    units: ClassVar[Mapping[str, str]] = {
        "gain": "{y}/{u}",
        "hysteresis_gain": "{y}/{u}",
        "beta": "1/{u}",
        "gamma": "1/{u}",
    }

    gain: float
    """Gain d of the straight part [unit of y per unit of u]."""
    hysteresis_gain: float
    """Gain A of the hysteretic part, the slope dh/du at h = 0 [unit of y per unit of u]; above
    zero.
    """
    beta: float
    """Parameter beta of the dissipation [per unit of u, times unit of y to the power 1 - n]."""
    gamma: float
    """Parameter gamma of the shape of the loop, unit as beta."""
    exponent: float = 1.0
    """Exponent n, at least 1: how sharply h turns into saturation."""

    def __post_init__(self) -> None:
        self._check("hysteresis_gain")
        self._check_exponent()

    def properties(self) -> tuple[ModelProperty, ...]:
        bounded, dissipative, steepest = classical_properties(
            self.hysteresis_gain, self.beta, self.gamma, self.exponent
        )
        condition = (
            "gain > hysteresis_gain max(1, 2 beta/(beta + gamma)), the steepest dh/du, just "
            "after a reversal from saturation"
        )
        return bounded, dissipative, self._invertible(self.gain, steepest, condition)

    def _law(self) -> Array:
        return classical_law(self.hysteresis_gain, self.beta, self.gamma, self.exponent)


def c_code(model: BoucWen) -> HysteresisCode:
    """Return the code in C, with pieces where the exponent is 1."""
    names = ("gain", "hysteresis_gain", "beta", "gamma")
    return bouc_wen_c_code(model, names, 2 if model.exponent == 1.0 else 0)


matlab_code = bouc_wen_matlab_code
