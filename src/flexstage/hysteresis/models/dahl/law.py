"""The Dahl model of friction, as a model of hysteresis."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.errors import ModelError
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, ModelProperty, Response, samples
from flexstage.hysteresis.models.bouc_wen_common import BoucWenModel, classical_law, simulate_runs
from flexstage.hysteresis.models.bouc_wen_steps import ITERATIONS, ROUNDING
from flexstage.hysteresis.models.power_law import decayed
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
        self._check(self.parameters(), "stiffness", "limit")
        if self.exponent < 0.0:
            raise ModelError(f"the exponent of Dahl must be at least 0, got {self.exponent}")

    def inverse(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        outputs = samples(y, "output")
        start = self._state(state)
        values = np.empty_like(outputs)
        done, F = _inverse(outputs, start[0], start[1], *self._numbers(), values)
        if done < outputs.size:
            raise ModelError(
                f"Dahl cannot be inverted at sample {done}: with F = {F:.6g}, dF/du can reach the "
                f"gain {self.gain:.6g}, so that more than one input gives an output; stay within a "
                f"smaller range, or give a smaller stiffness"
            )
        return Response(values=values, state=self._state_after(values[-1], F))

    def properties(self) -> tuple[ModelProperty, ...]:
        steepest = self.stiffness * 2.0**self.exponent
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
            ModelProperty(
                name="invertible",
                holds=self.gain > steepest,
                detail=(
                    f"gain > stiffness 2^exponent, the steepest dF/du, just after a reversal from "
                    f"the limit: {self.gain:.6g} and {steepest:.6g}; where it does not hold, the "
                    f"inverse stops where |F| grows too large"
                ),
            ),
        )

    def _outputs(self, u: Array, state: Array, values: Array) -> float:
        if self.exponent != 1.0:
            return _simulate(u, state[0], state[1], *self._numbers(), values)
        rate = self.stiffness / self.limit
        return simulate_runs(u, state[0], state[1], self.gain, self.stiffness, rate, 0.0, values)

    def _compiled(self) -> tuple[Array, Array]:
        # of exponent 1, where it is Bouc-Wen
        law = classical_law(self.stiffness, self.stiffness / self.limit, 0.0, 1.0)
        return np.array([self.gain, 0.0, 0.0]), law

    def _numbers(self) -> tuple[float, float, float, float]:
        """Return the parameters in the order of the compiled loops."""
        return self.gain, self.stiffness, self.limit, self.exponent


@compiled
def _advance(F: float, du: float, sigma: float, limit: float, i: float) -> float:
    """Return F after one straight line of the input.

    The gap e = 1 - s F/F_c closes as ``|e|' = -(sigma/F_c) |e|^i``, whose solution is
    ``|e| (1 + (i - 1) (sigma/F_c) v |e|^(i-1))^(-1/(i-1))``.
    """
    if du == 0.0:
        return F
    s = 1.0 if du > 0.0 else -1.0
    e = 1.0 - s * F / limit
    x = sigma / limit * abs(du)
    if e == 0.0:
        return F
    if i == 1.0:
        share = decayed(x)
    else:
        m = i - 1.0
        q = m * x * abs(e) ** m
        share = -math.expm1(-math.log1p(q) / m) if q > -1.0 else 1.0
    return F + s * limit * e * share


@compiled
def _slope(F: float, s: float, sigma: float, limit: float, i: float) -> float:
    """Return dF/du for a motion of direction s."""
    e = 1.0 - s * F / limit
    if e == 0.0:
        return 0.0
    return sigma * abs(e) ** i * (1.0 if e > 0.0 else -1.0)


@compiled
def _simulate(
    u: Array, u_last: float, F: float, gain: float, sigma: float, limit: float, i: float, out: Array
) -> float:
    """Write the output sample by sample, and return the last F."""
    for k in range(u.size):
        F = _advance(F, u[k] - u_last, sigma, limit, i)
        u_last = u[k]
        out[k] = gain * u_last - F
    return F


@compiled
def _inverse(
    y: Array, u: float, F: float, gain: float, sigma: float, limit: float, i: float, out: Array
) -> tuple[int, float]:
    """Write the input for each output; return how many were done, and the last F."""
    for k in range(y.size):
        change = y[k] - (gain * u - F)
        if change != 0.0:
            # Along any motion the slope only falls: the steepest is the one at the start.
            least = gain - max(_slope(F, 1.0, sigma, limit, i), _slope(F, -1.0, sigma, limit, i))
            if not least > 0.0:
                return k, F
            u, F = _inverse_step(change, u, F, least, gain, sigma, limit, i)
        out[k] = u
    return y.size, F


@compiled
def _inverse_step(
    change: float,
    u: float,
    F: float,
    least: float,
    gain: float,
    sigma: float,
    limit: float,
    i: float,
) -> tuple[float, float]:
    """Return input and F after a change of output: Newton's method inside a bracket."""
    s = 1.0 if change > 0.0 else -1.0
    target = s * change
    low = 0.0
    # The least slope bounds the way from above, with a margin for rounding.
    high = target / least
    high += 4.0 * ROUNDING * (high + abs(F) / least)
    v = min(high, target / (gain - _slope(F, s, sigma, limit, i)))
    converged = False
    count = 0
    while True:
        end = u + s * v
        # The hysteresis sees the rounded input; so does the last evaluation.
        after = _advance(F, end - u, sigma, limit, i)
        count += 1
        if converged or count > ITERATIONS:
            return end, after
        excess = s * (gain * (end - u) - (after - F)) - target
        if excess > 0.0:
            high = v
        else:
            low = v
        correction = excess / (gain - _slope(after, s, sigma, limit, i))
        if not low <= v - correction <= high:
            correction = v - 0.5 * (low + high)
        v -= correction
        converged = abs(correction) <= ROUNDING * (abs(u) + v)


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
