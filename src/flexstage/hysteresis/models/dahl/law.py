"""The Dahl model of friction, as a model of hysteresis."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from flexstage.base.errors import ModelError
from flexstage.hysteresis.model import Array, ModelProperty
from flexstage.hysteresis.models.bouc_wen_common import BoucWenModel, classical_law
from flexstage.hysteresis.models.bouc_wen_steps import friction_law
from flexstage.hysteresis.models.source_code import HysteresisCode, MatlabCode, code_of, tunable_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Dahl(BoucWenModel):
    """Dahl's friction F as the hysteresis of a drive, y = d u - F (Dahl 1968, 1976).

    ``dF/du = sigma |1 - r|^i sgn(1 - r)`` with ``r = (F/F_c) sgn(u')`` (Dahl 1976, AIAA J. 14:1675,
    Eq. 4). With i = 1 it is Bouc-Wen with n = 1, beta = sigma/F_c and gamma = 0.

    Notes
    -----
    Validity: a loop that is odd about its centre and of the same width all along once F has come
    near F_c; minor loops that do not close; no dependence on rate, no creep. Exact to rounding
    for an input of straight lines. State: last input and F.

    Examples
    --------
    >>> stack = Dahl(gain=0.593e-6, stiffness=0.251e-6, limit=5.3e-6, exponent=1.4)
    >>> up_and_down = [40.0, 120.0, 40.0]
    >>> [f"{1e6 * y:.3f}" for y in stack.simulate(up_and_down).values]
    ['19.714', '66.133', '28.346']
    """

    kind: ClassVar[str] = "dahl"
    title: ClassVar[str] = "Dahl"
    units: ClassVar[Mapping[str, str]] = {
        "gain": "{y}/{u}",
        "stiffness": "{y}/{u}",
        "limit": "{y}",
    }
    hysteretic: ClassVar[tuple[str, str]] = ("F", "stiffness")

    gain: float
    """Gain d of the straight part [unit of y per unit of u]."""
    stiffness: float
    """Slope sigma of F at F = 0 [unit of y per unit of u]; above zero."""
    limit: float
    """Value F_c that F approaches [unit of y]; above zero."""
    exponent: float = 1.0
    """Exponent i, at least zero: 0 is an elastic, perfectly plastic element, 1 an exponential;
    below 1, F_c is reached within a finite distance.
    """

    def __post_init__(self) -> None:
        self._check("stiffness", "limit")
        if self.exponent < 0.0:
            raise ModelError(f"the exponent of Dahl must be at least 0, got {self.exponent}")

    def properties(self) -> tuple[ModelProperty, ...]:
        return (
            ModelProperty(
                name="bounded",
                holds=True,
                detail=f"stiffness, limit above zero; from rest |F| is at most {self.limit:.6g}",
            ),
            ModelProperty(
                name="dissipative",
                holds=True,
                detail="stiffness, limit above zero: F^2/(2 stiffness) never outgrows the work",
            ),
            self._invertible(
                self.gain,
                self.stiffness * 2.0**self.exponent,
                "gain > stiffness 2^exponent, the steepest dF/du, just after a reversal from the "
                "limit",
            ),
        )

    def _law(self) -> Array:
        if self.exponent == 1.0:
            return classical_law(self.stiffness, self.stiffness / self.limit, 0.0, 1.0)
        return friction_law(self.stiffness, self.limit, self.exponent)


def c_code(model: Dahl) -> HysteresisCode:
    """Return the code in C, with pieces where the exponent is 1, which is then fixed."""
    straight = model.exponent == 1.0
    tunable = [
        tunable_of(model, "gain", 0, "gain of the straight part"),
        tunable_of(model, "stiffness", 1, "slope of the friction at zero"),
        tunable_of(model, "limit", 2, "friction of steady sliding"),
        tunable_of(model, "exponent", None if straight else 3, "how sharply the loop saturates"),
    ]
    return code_of(model, [p.value for p in tunable], tunable, 2 if straight else 0)


def matlab_code(model: Dahl) -> MatlabCode:
    """Return the code in MATLAB."""
    numbers = {
        "gain": (model.gain, "gain of the straight part [unit of y per unit of u]"),
        "stiffness": (model.stiffness, "slope of the friction at zero [unit of y per unit of u]"),
        "limit": (model.limit, "friction that is approached [unit of y]"),
        "exponent": (model.exponent, "exponent [1]"),
    }
    return MatlabCode(parts=("dahl",), parameters=numbers)
