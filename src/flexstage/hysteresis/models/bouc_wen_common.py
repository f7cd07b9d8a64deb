"""Common parts of the Bouc-Wen family: checks, conditions, code."""

import math
from abc import abstractmethod
from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.errors import ModelError
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
    LOADED,
    UNLOADED,
    advance,
    inverse_samples,
    law_of,
    law_segments,
    simulate_samples,
)
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

    #: Symbol of the hysteretic displacement, and name of its slope at zero.
    hysteretic: ClassVar[tuple[str, str]] = ("h", "hysteresis_gain")

    #: Condition on the shape function where h is loaded, for an inverse.
    loading: ClassVar[str] = "beta + gamma is at least zero"

    if TYPE_CHECKING:

        @property
        def gain(self) -> float:
            """Gain of the straight part."""

        @property
        def exponent(self) -> float:
            """How sharply h turns into saturation."""

    @abstractmethod
    def _law(self) -> Array:
        """Return the law of the compiled loops."""

    def _cubic(self) -> Array:
        """Return the factors of u, u^2 and u^3 in the output."""
        return np.array([self.gain, 0.0, 0.0])

    def initial_state(self) -> Array:
        return np.zeros(2)

    def simulate(self, u: ArrayLike, state: ArrayLike | None = None) -> Response:
        inputs = samples(u, "input")
        start = self._state(state)
        values = np.empty_like(inputs)
        h = simulate_samples(inputs, start[0], start[1], self._cubic(), self._law(), values)
        return Response(values=values, state=self._state_after(inputs[-1], h))

    def segments(self, u: ArrayLike, state: ArrayLike | None = None) -> Segments | None:
        if self.exponent != 1.0:
            return None
        law, start, inputs = self._law(), self._state(state), sampled(u)
        h = advance(start[1], start[0], inputs[0] - start[0], law)
        table = np.empty((5, 4 * inputs.size))
        count, h = law_segments(inputs, h, float(self.gain), law, table)
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

    def inverse(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        outputs, start = samples(y, "output"), self._state(state)
        loaded = float(np.min(self._law()[LOADED]))
        if loaded < 0.0:
            raise ModelError(
                f"{self.title} is inverted only where {self.loading}, got {loaded:.6g}: its output "
                "falls in the end while the input rises"
            )
        limits = (-math.inf, math.inf, self.gain)
        return self._inputs(outputs, start, limits, f"gain {self.gain:.6g}")

    def _inputs(
        self, y: Array, state: Array, limits: tuple[float, float, float], steepest: str
    ) -> Response:
        """Return the nearest inputs.

        Limits are the lowest and the highest input, and the least slope of the polynomial, which
        `steepest` names.
        """
        values = np.empty_like(y)
        done, h, missed = inverse_samples(
            y, state[0], state[1], np.array(limits), self._cubic(), self._law(), values
        )
        if done < y.size:
            symbol, gain = self.hysteretic
            raise ModelError(
                f"{self.title} cannot be inverted at sample {done}: with {symbol} = {h:.6g}, "
                f"d{symbol}/du can reach the {steepest}, so that more than one input gives an "
                f"output; stay within a smaller range, or give a smaller {gain}"
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

    def _invertible(self, least: float, steepest: float, condition: str) -> ModelProperty:
        """Return whether the polynomial rises faster than the hysteretic displacement."""
        return ModelProperty(
            name="invertible",
            holds=least > steepest,
            detail=(
                f"{condition}: {least:.6g} and {steepest:.6g}; where it does not hold, the inverse "
                f"stops where |{self.hysteretic[0]}| grows too large"
            ),
        )

    def _check(self, *above_zero: str) -> None:
        """Refuse parameters that are not finite, or not positive where they must be."""
        for name, value in self.parameters().items():
            kind = "positive and finite" if name in above_zero else "finite"
            if isinstance(value, tuple):
                for k, number in enumerate(value, start=1):
                    checked(number, f"{name} number {k} of {self.title}", kind)
            else:
                checked(cast("float", value), f"{name} of {self.title}", kind)

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
    law, exponent = model._law(), model.exponent
    numbers = {
        "cubic": (
            model._cubic().tolist(),
            "factors of u, u^2 and u^3 [unit of y per unit of u, u^2, u^3]",
        ),
        "A": (law[0], "slope dh/du at h = 0 [unit of y per unit of u]"),
        "centre": (law[2], "input at which the shape function changes [unit of u]"),
        "unloaded": (
            law[UNLOADED],
            "shape function where h unloads: u falls below, above the centre; rises below, above",
        ),
        "loaded": (law[LOADED], "shape function where h is loaded, in the same order"),
    }
    if exponent == 1.0:
        return MatlabCode(parts=("bouc_wen_common", "power_1"), parameters=numbers)
    numbers["n"] = (exponent, "exponent [1]")
    return MatlabCode(parts=("bouc_wen_common", "power_n"), parameters=numbers)
