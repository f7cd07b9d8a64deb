"""Common parts of the Bouc-Wen family: checks, conditions, code, runs of exponent 1."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.errors import ModelError
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import (
    Array,
    HysteresisModel,
    ModelProperty,
    Response,
    Segments,
    checked,
    sampled,
    samples,
)
from flexstage.hysteresis.models.bouc_wen_steps import (
    advance,
    inverse_samples,
    law_of,
    law_segments,
    simulate_samples,
)
from flexstage.hysteresis.models.power_law import decayed, distance_to_zero, saturating
from flexstage.hysteresis.models.source_code import HysteresisCode, MatlabCode, code_of, tunable_of

#: Descriptions of the parameters in C.
_DESCRIPTIONS = {
    "gain": "gain of the straight part",
    "quadratic": "factor of the square of the voltage",
    "cubic": "factor of the cube of the voltage",
    "hysteresis_gain": "slope of the hysteretic displacement at zero",
    "beta": "dissipation of the loop",
    "gamma": "shape of the loop",
    "centre": "voltage about which the shape function tells below from above",
}


class BoucWenModel(HysteresisModel):
    """A polynomial of the input less a hysteretic displacement h by a law of the Bouc-Wen kind.

    A state is the last input and h.
    """

    __slots__ = ()

    exponent: float

    @abstractmethod
    def _compiled(self) -> tuple[Array, Array]:
        """Return the polynomial and the law of the compiled loops."""

    def _outputs(self, u: Array, state: Array, values: Array) -> float:
        """Write the outputs, and return the last h."""
        return simulate_samples(u, state[0], state[1], *self._compiled(), values)

    def initial_state(self) -> Array:
        return np.zeros(2)

    def simulate(self, u: ArrayLike, state: ArrayLike | None = None) -> Response:
        inputs = samples(u, "input")
        start = self._state(state)
        values = np.empty_like(inputs)
        h = self._outputs(inputs, start, values)
        return Response(values=values, state=self._state_after(inputs[-1], h))

    def segments(self, u: ArrayLike, state: ArrayLike | None = None) -> Segments | None:
        if self.exponent != 1.0:
            return None
        cubic, law = self._compiled()
        start = self._state(state)
        inputs = sampled(u)
        h = advance(start[1], start[0], inputs[0] - start[0], law)
        table = np.empty((5, 4 * inputs.size))
        count, h = law_segments(inputs, h, cubic[0], law, table)
        begin, constant, slope, amplitude, rate = table[:, :count].copy()
        return Segments(
            start=begin,
            constant=constant,
            slope=slope,
            amplitude=amplitude,
            rate=rate,
            samples=inputs.size,
            state=self._state_after(inputs[-1], h),
        )

    def _inputs(
        self, y: Array, state: Array, limits: tuple[float, float, float], steepest: str
    ) -> Response:
        """Return the nearest inputs.

        Limits are the lowest and the highest input, and the least slope of the polynomial, which
        `steepest` names.
        """
        values = np.empty_like(y)
        done, h, missed = inverse_samples(
            y, state[0], state[1], np.array(limits), *self._compiled(), values
        )
        if done < y.size:
            raise ModelError(
                f"{self.title} cannot be inverted at sample {done}: with h = {h:.6g}, dh/du can "
                f"reach the {steepest}, so that more than one input gives an output; stay within a "
                f"smaller range, or give a smaller hysteresis_gain"
            )
        return Response(values=values, state=self._state_after(values[-1], h), missed=missed)

    def _state_after(self, u: float, h: float) -> Array:
        """Return the state after the last sample; a ModelError if h is not finite."""
        if not math.isfinite(h):
            raise ModelError(
                f"the hysteretic displacement of {self.title} grew without limit for this input: "
                "see the condition 'bounded' of the model, and correct its parameters or its state"
            )
        return np.array([u, h])

    def _check(self, numbers: Mapping[str, Any], *above_zero: str) -> None:
        """Refuse parameters that are not finite, or not positive where they must be."""
        for name, value in numbers.items():
            kind = "positive and finite" if name in above_zero else "finite"
            checked(value, f"{name} of {self.title}", kind)

    def _check_exponent(self) -> None:
        """Refuse an exponent below one."""
        if self.exponent < 1.0:
            raise ModelError(
                f"the exponent of {self.title} must be at least 1, got {self.exponent}: "
                "below it the slope of the loop has a kink of infinite curvature at h = 0"
            )


def classical_law(A: float, beta: float, gamma: float, n: float) -> Array:
    """Return the law of the classical shape function, psi = gamma + beta sign(u' h)."""
    unloaded, loaded = gamma - beta, gamma + beta
    return law_of(A, n, -math.inf, np.array([[[unloaded] * 2, [loaded] * 2]] * 2))


def classical_properties(
    A: float, beta: float, gamma: float, n: float
) -> tuple[ModelProperty, ModelProperty, float]:
    """Return whether h is bounded and whether it is dissipative, and its steepest slope dh/du.

    Bounded: Ikhouane, Mañosa, Rodellar 2007, Syst. Control Lett. 56:197, classes I and II;
    dissipative: Erlicher, Point 2004, C. R. Mécanique 332:51. The slope is that just after a
    reversal from saturation, ``A 2 beta/(beta + gamma)``, or A; infinity where h is not bounded.
    """
    total = beta + gamma
    holds = total > 0.0 and beta >= 0.0
    limit = (A / total) ** (1.0 / n) if holds else math.inf
    consequence = f"from rest |h| stays below {limit:.6g}" if holds else "h can grow without limit"
    bounded = ModelProperty(
        name="bounded",
        holds=holds,
        detail=f"beta + gamma > 0 and beta >= 0: {total:.6g} and {beta:.6g}; {consequence}",
    )
    passive = abs(gamma) <= beta
    dissipative = ModelProperty(
        name="dissipative",
        holds=passive,
        detail=(
            f"|gamma| <= beta: {abs(gamma):.6g} and {beta:.6g}; "
            f"{'no' if passive else 'some'} motion generates energy"
        ),
    )
    steepest = A * max(1.0, 2.0 * beta / total) if holds else math.inf
    return bounded, dissipative, steepest


def bouc_wen_c_code(model: BoucWenModel, names: tuple[str, ...], pieces: int) -> HysteresisCode:
    """Return the code of a model of the Bouc-Wen family: its numbers, then the exponent.

    `names` are the parameters in the order of the header, `pieces` as in `code_of`.
    """
    n = model.exponent
    # h to the power n - 1 is in the unit of what multiplies it.
    unit = "1/V" if n == 1.0 else f"1/(V m^{n - 1.0:g})".replace("m^1)", "m)")
    tunable = []
    for k, name in enumerate(names):
        shape = name.startswith("shape")
        what = f"parameter b{name[6:-1]} of the shape function" if shape else _DESCRIPTIONS[name]
        symbol_unit = unit if shape or name in {"beta", "gamma"} else ""
        tunable.append(tunable_of(model, name, k, what, symbol_unit))
    numbers = [parameter.value for parameter in tunable]
    tunable.append(tunable_of(model, "exponent", None, "how sharply the loop saturates"))
    return code_of(model, [*numbers, n], tunable, pieces)


def bouc_wen_matlab_code(model: BoucWenModel) -> MatlabCode:
    """Return the code in MATLAB: a polynomial less the hysteretic displacement of a law."""
    cubic, law = model._compiled()
    exponent = model.exponent
    numbers = {
        "cubic": (cubic.tolist(), "factors of u, u^2 and u^3 [unit of y per unit of u, u^2, u^3]"),
        "A": (law[0], "slope dh/du at h = 0 [unit of y per unit of u]"),
        "centre": (law[2], "input at which the shape function changes [unit of u]"),
        "unloaded": (
            law[[4, 5, 8, 9]],
            "shape function where h unloads: u falls below, above the centre; rises below, above",
        ),
        "loaded": (law[[6, 7, 10, 11]], "shape function where h is loaded, in the same order"),
    }
    if exponent in (1.0, 2.0):
        return MatlabCode(
            parts=("bouc_wen_common", "power_closed", f"power_{exponent:g}"), parameters=numbers
        )
    numbers["n"] = (exponent, "exponent [1]")
    return MatlabCode(parts=("bouc_wen_common", "power_n"), parameters=numbers)


@compiled
def _fill(
    u: Array,
    first: int,
    last: int,
    origin: float,
    s: float,
    gain: float,
    g: float,
    A: float,
    rate: float,
    out: Array,
) -> None:
    """Write y = d u - h for the samples of one piece; g is the value at its origin."""
    start = s * g
    if rate > 0.0:
        span = s * ((A - rate * g) / rate)
        for k in range(first, last):
            # Rounding may put a sample before the origin by one unit in the last place.
            v = max(s * (u[k] - origin), 0.0)
            out[k] = gain * u[k] - (start + span * decayed(rate * v))
    else:
        for k in range(first, last):
            v = max(s * (u[k] - origin), 0.0)
            out[k] = gain * u[k] - s * saturating(g, A, rate, v)


@compiled
def _first_beyond(u: Array, first: int, last: int, s: float, origin: float, v: float) -> int:
    """Return the first sample of a run that lies at least a distance v from its origin."""
    while first < last:
        middle = (first + last) // 2
        if s * (u[middle] - origin) < v:
            first = middle + 1
        else:
            last = middle
    return first


@compiled
def simulate_runs(
    u: Array, u_last: float, h: float, gain: float, A: float, beta: float, gamma: float, out: Array
) -> float:
    """Write the output of exponent 1 run by run, and return the last hysteretic displacement.

    In a run of direction s, with v = |u - u_start| and g = s h,

        dg/dv = A - (beta + gamma) g      for g >= 0,
        dg/dv = A - (beta - gamma) g      for g < 0,

    so g is an exponential of the distance from where the run began, or from where h passed zero. No
    sample needs the one before, and a loop over the samples of a run becomes vector code. A is the
    slope dh/du at h = 0; `u_last` and h are before the first input.
    """
    count = u.size
    i = 0
    while i < count:
        if u[i] == u_last:
            out[i] = gain * u[i] - h
            i += 1
            continue
        s = 1.0 if u[i] > u_last else -1.0
        end = i + 1
        while end < count and s * (u[end] - u[end - 1]) >= 0.0:
            end += 1
        g = s * h
        zero = 0.0
        middle = i
        length = s * (u[end - 1] - u_last)
        if g < 0.0:
            zero = distance_to_zero(-g, A, gamma - beta)
            middle = _first_beyond(u, i, end, s, u_last, zero)
            _fill(u, i, middle, u_last, s, gain, g, A, beta - gamma, out)
        if middle < end:
            g = max(g, 0.0)
            _fill(u, middle, end, u_last + s * zero, s, gain, g, A, beta + gamma, out)
            h = s * saturating(g, A, beta + gamma, length - zero)
        else:
            h = s * saturating(g, A, beta - gamma, length)
        u_last = u[end - 1]
        i = end
    return h
