"""The Duhem model in the form of Coleman and Hodgdon."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

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
    fixed,
    sampled,
    samples,
)
from flexstage.hysteresis.models.play_sum import STATE_ROUNDING
from flexstage.hysteresis.models.source_code import HysteresisCode, MatlabCode, code_of, tunable_of

#: Inputs at which the conditions are looked at.
GRID = 513
#: Highest number of coefficients of f and g: constant to cubic.
TERMS = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Duhem(HysteresisModel):
    """Duhem model of Coleman and Hodgdon with polynomial f and g.

    ``y' = alpha |u'| (f(u) - y) + u' g(u)`` (Coleman and Hodgdon 1986, Int. J. Eng. Sci. 24:897;
    1987, Arch. Ration. Mech. Anal. 99:375). On a straight line from u by s v, s = +1 or -1, the
    output is ``y exp(-alpha v) + sum_k q_k v^(k+1) phi_(k+1)(-alpha v)``, where
    ``q_k = s^k (alpha f^(k)(u) + s g^(k)(u))`` and ``phi_k`` are the functions
    ``phi_0 = exp, phi_(k+1)(x) = (phi_k(x) - 1/k!)/x``: exact, since f and g are polynomials.

    Notes
    -----
    Validity: rate-independent hysteresis whose branches are exponential. It forgets by degrees,
    not by wiping-out: a minor loop does not close at once, but moves towards its limit cycle as
    it is repeated (accommodation), which stacks do not show. Minor loops of one height are not
    congruent where f is curved. The record of one major loop leaves minor loops undetermined.
    Creep is beyond it. Outside the range, a polynomial extrapolates badly. The output rests at
    zero, though f(0) need not be zero. State: last input and output.

    Raises
    ------
    ModelError
        The rate is not positive, coefficients are none, more than four or not finite, or zero is
        not within the range.

    Examples
    --------
    >>> model = Duhem(
    ...     rate=0.04,
    ...     anhysteretic=np.array([2e-6, 0.45e-6, 0.4e-9]),
    ...     tangent=np.array([0.3e-6]),
    ...     input_range=(0.0, 120.0),
    ... )
    >>> model.simulate([80.0, 30.0]).values * 1e6
    array([35.76095275, 19.26880817])
    """

    kind: ClassVar[str] = "duhem"
    title: ClassVar[str] = "Duhem"
    units: ClassVar[Mapping[str, str]] = {
        "rate": "1/{u}",
        "anhysteretic": "{y}, {y}/{u}, {y}/{u}^2, {y}/{u}^3",
        "tangent": "{y}/{u}, {y}/{u}^2",
        "input_range": "{u}",
    }

    rate: float
    """Alpha, how fast the output comes to its curve as the input moves [1/V]; positive."""
    anhysteretic: Array
    """Coefficients of f, the curve to which the output tends, from the constant up [m, m/V, m/V^2,
    m/V^3], one to four.
    """
    tangent: Array
    """Coefficients of g, the slope of the output on that curve [m/V, m/V^2, ...], one to four."""
    input_range: tuple[float, float]
    """Lowest and highest input [V] for which the model stands, with zero between or at an end.
    Conditions are looked at there, and the inverse keeps to it.
    """

    def __post_init__(self) -> None:
        for name in ("anhysteretic", "tangent"):
            coefficients = fixed(getattr(self, name), f"coefficients of the {name}", (-1,))
            if not 1 <= coefficients.size <= TERMS:
                raise ModelError(
                    f"the coefficients of the {name} must be one to four, got {coefficients.size}: "
                    f"give them from the constant up"
                )
            self._set(**{name: coefficients})
        low, high = (float(end) for end in fixed(self.input_range, "input range", (2,)))
        if not (low <= 0.0 <= high and low < high):
            raise ModelError(
                f"the input range must rise and hold zero, where the model rests, "
                f"got {low:g} to {high:g}"
            )
        rate = checked(self.rate, "rate", "positive and finite")
        self._set(rate=rate, input_range=(low, high))

    @property
    def input_limits(self) -> tuple[float, float]:
        return self.input_range

    def initial_state(self) -> Array:
        return np.zeros(2)

    def simulate(self, u: ArrayLike, state: ArrayLike | None = None) -> Response:
        inputs, before = samples(u, "input"), self._state(state)
        y = _simulate(inputs, self.rate, *self.padded(), before)
        return Response(values=y, state=np.array([inputs[-1], y[-1]]))

    def inverse(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        low, high = self.input_range
        hint = "stay within the range, or widen it"
        return self._reaching(y, state, f"from {low:g} to {high:g}", hint)

    def nearest(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        outputs, before = samples(y, "output"), self._state(state)
        least = self._extremes()[0]
        if least <= 0.0:
            raise ModelError(
                f"this duhem model has no inverse, since its slope can be {least:g}: raise "
                f"the tangent, lower the rate, or narrow the input range"
            )
        low, high = self.input_range
        # An end of the range is reached even where the output for it is rounded.
        edge = STATE_ROUNDING * (high - low)
        ends = (low - edge, high + edge)
        u, missed = _invert(outputs, self.rate, *self.padded(), *ends, before)
        return Response(values=u, state=before, missed=missed)

    def segments(self, u: ArrayLike, state: ArrayLike | None = None) -> Segments | None:
        f, g = self.padded()
        if np.any(f[2:] != 0.0) or np.any(g[1:] != 0.0):
            return None
        inputs = sampled(u)
        response = self.simulate(inputs, state)
        step = np.diff(inputs)
        start = np.arange(step.size, dtype=np.float64)
        # The output that would follow the curve without an exponential part.
        steady = f[0] + f[1] * inputs[:-1] + np.sign(step) * (g[0] - f[1]) / self.rate
        before = response.values[:-1]
        constant = np.where(step == 0.0, before, steady)
        return Segments(
            start=start,
            constant=constant,
            slope=f[1] * step,
            amplitude=before - constant,
            rate=self.rate * np.abs(step),
            samples=inputs.size,
            state=response.state,
        )

    def properties(self) -> tuple[ModelProperty, ...]:
        # With w = y - f(u) and d = f' - g, w' = -alpha |u'| w - u' d. If d is positive and |d'| <=
        # 2 alpha d, then w^2 / (2 d) is a stored energy, and a closed cycle takes in the integral
        # of w^2 (alpha |du| / d + d' du / (2 d^2)), which is not negative. The slope is least on
        # the outermost branches: those that start at an end of the range, after any number of
        # cycles, and those that start at rest (Coleman and Hodgdon 1986 require the same of the
        # branches from infinity).
        low, high = self.input_range
        least, largest = self._extremes()
        u = np.linspace(low, high, GRID)
        curve, tangent = map(np.polynomial.Polynomial, self.padded())
        excess = curve.deriv() - tangent
        d, change = excess(u), excess.deriv()(u)
        margin = float(np.min(2.0 * self.rate * d - np.abs(change)))
        where = f"from {low:g} to {high:g} V"
        return (
            ModelProperty(
                name="bounded",
                holds=True,
                detail=f"the rate is {self.rate:g}/V, more than 0, so the output tends to its "
                f"curve: {where} it is never more than {largest:g} m",
            ),
            ModelProperty(
                name="dissipative",
                holds=float(np.min(d)) >= 0.0 and margin >= 0.0,
                detail=f"the slope of the curve is at least the tangent {where}, the least "
                f"difference d is {np.min(d):g} m/V; and 2 rate d - |d'| is at least {margin:g}, "
                f"and should not be negative; else a cycle may give out energy",
            ),
            ModelProperty(
                name="invertible",
                holds=least > 0.0,
                detail=f"the slope is more than 0 on every outermost branch {where}, it is at "
                f"least {least:g} m/V; else an output can belong to several inputs",
            ),
        )

    def padded(self) -> tuple[Array, Array]:
        """Return the coefficients of f and g, four each.

        Returns
        -------
        tuple of numpy.ndarray
            Those that are not given are zero, shape (4,) each.
        """
        f, g = (
            np.pad(coefficients, (0, TERMS - coefficients.size))
            for coefficients in (self.anhysteretic, self.tangent)
        )
        return f, g

    def _extremes(self) -> tuple[float, float]:
        """Return the least slope and the largest output, either way, on the outermost branches."""
        u = np.linspace(*self.input_range, GRID)
        f, g = (np.polynomial.Polynomial(coefficients)(u) for coefficients in self.padded())
        branches = self._outermost(u)
        # Order is kept: an output between two others stays between them, on every path.
        rising = self.rate * (f - np.max(branches, axis=0)) + g
        falling = g - self.rate * (f - np.min(branches, axis=0))
        least = min(np.min(rising), np.min(falling))
        return float(least), float(np.max(np.abs(branches)))

    def _outermost(self, u: Array) -> Array:
        """Return the outermost branches at rising inputs u, shape (8, n)."""
        low, high = self.input_range
        # A cycle over the range maps the output at its top to c + exp(-2 alpha range) output.
        c = self.simulate([low, high], [high, 0.0]).values[-1]
        limit = c / -math.expm1(-2.0 * self.rate * (high - low))
        at_high = self.simulate([high]).values[-1]
        at_low = self.simulate([low]).values[-1]
        rising = self.simulate(u[u >= 0.0]).values
        falling = self.simulate(u[u <= 0.0][::-1]).values[::-1]
        rest = np.concatenate((falling[: u.size - rising.size], rising))
        out = [rest, self.simulate(u, [low, at_low]).values]
        for top in (limit, at_high, out[-1][-1]):
            back = self.simulate(u[::-1], [high, top]).values[::-1]
            out += [back, self.simulate(u, [low, back[0]]).values]
        return np.array(out)


def duhem_columns(u: ArrayLike, rate: float, curve: int, tangent: int) -> Array:
    """Return the output of a Duhem model per unit of each of its coefficients.

    `curve` and `tangent` are numbers of coefficients; the columns, shape (n, curve + tangent), are
    those of the curve first. The rate is alpha [1/V].

    Notes
    -----
    Validity: as `Duhem`, from rest.

    Examples
    --------
    >>> duhem_columns([80.0, 30.0], 0.04, 3, 1) @ [2.0, 0.45, 0.4e-3, 0.3]
    array([35.76095275, 19.26880817])
    """
    inputs, units = np.ascontiguousarray(u, dtype=np.float64), np.eye(2 * TERMS)
    coefficients = [*units[:curve], *units[TERMS : TERMS + tangent]]
    columns = [_simulate(inputs, rate, c[:TERMS], c[TERMS:], np.zeros(2)) for c in coefficients]
    return np.column_stack(columns)


@compiled
def _phis(x: float) -> tuple[float, float, float, float]:
    """Return phi_1 to phi_4."""
    if x > -1.0:
        # Upwards, the differences would lose digits; the series is short, and downwards is safe.
        term = 1.0 / 24.0
        phi4 = term
        k = 5.0
        while abs(term) > 1e-18:
            term *= x / k
            phi4 += term
            k += 1.0
        phi3 = x * phi4 + 1.0 / 6.0
        phi2 = x * phi3 + 0.5
        phi1 = x * phi2 + 1.0
    else:
        phi1 = math.expm1(x) / x
        phi2 = (phi1 - 1.0) / x
        phi3 = (phi2 - 0.5) / x
        phi4 = (phi3 - 1.0 / 6.0) / x
    return phi1, phi2, phi3, phi4


@compiled
def _derivatives(u: float, c: Array) -> tuple[float, float, float]:
    """Return a cubic and its first two derivatives."""
    return (
        c[0] + u * (c[1] + u * (c[2] + u * c[3])),
        c[1] + u * (2.0 * c[2] + 3.0 * u * c[3]),
        2.0 * c[2] + 6.0 * u * c[3],
    )


@compiled
def _step(u: float, y: float, v: float, sign: float, alpha: float, f: Array, g: Array) -> float:
    """Return the output after the input has gone from u by sign v."""
    f0, f1, f2 = _derivatives(u, f)
    g0, g1, g2 = _derivatives(u, g)
    q0, q1, q2 = alpha * f0 + sign * g0, alpha * f1 + sign * g1, alpha * f2 + sign * g2
    q3 = alpha * 6.0 * f[3] + sign * 6.0 * g[3]
    x = -alpha * v
    phi1, phi2, phi3, phi4 = _phis(x)
    change = v * (q0 * phi1 + v * (sign * q1 * phi2 + v * (q2 * phi3 + v * sign * q3 * phi4)))
    return y * math.exp(x) + change


@compiled
def _simulate(u: Array, alpha: float, f: Array, g: Array, state: Array) -> Array:
    """Return the outputs for a sequence of inputs."""
    last, here = state[0], state[1]
    y = np.empty(u.size)
    for n in range(u.size):
        if u[n] != last:
            sign = 1.0 if u[n] > last else -1.0
            here = _step(last, here, sign * (u[n] - last), sign, alpha, f, g)
            last = u[n]
        y[n] = here
    return y


@compiled
def _distance(
    u: float, y: float, target: float, far: float, sign: float, alpha: float, f: Array, g: Array
) -> float:
    """Return how far the input must go for a wanted output, at most `far`: Newton in a bracket."""
    low, high = 0.0, far
    v = 0.0
    here = y
    last = math.inf
    for _ in range(100):
        x = u + sign * v
        slope = _derivatives(x, g)[0] + sign * alpha * (_derivatives(x, f)[0] - here)
        guess = v + sign * (target - here) / slope if slope > 0.0 else math.inf
        step = abs(guess - v)
        # Near the root steps get smaller each time, until rounding of the output is all of them.
        if step <= 1e-16 * (abs(u) + v) or (step >= last and last <= 1e-11 * (abs(u) + far)):
            break
        last = step
        if not low <= guess <= high:
            guess = 0.5 * (low + high)
        v = guess
        here = _step(u, y, v, sign, alpha, f, g)
        if sign * (target - here) > 0.0:
            low = v
        else:
            high = v
    return v


@compiled
def _invert(
    y: Array, alpha: float, f: Array, g: Array, low: float, high: float, state: Array
) -> tuple[Array, int]:
    """Return the inputs for a sequence of outputs, and the first one that none reaches, or -1.

    Where none does, the input stops at the end of the range.
    """
    u = np.empty(y.size)
    x, here, missed = state[0], state[1], -1
    for n in range(y.size):
        if y[n] != here:
            sign = 1.0 if y[n] > here else -1.0
            far = (high - x) if sign > 0.0 else (x - low)
            v = max(far, 0.0)
            if not far > 0.0 or sign * (_step(x, here, far, sign, alpha, f, g) - y[n]) < 0.0:
                missed = n if missed < 0 else missed
            else:
                v = _distance(x, here, y[n], far, sign, alpha, f, g)
            if v > 0.0:
                here = _step(x, here, v, sign, alpha, f, g)
                x += sign * v
        u[n] = x
    state[0], state[1] = x, here
    return u, missed


def c_code(model: Duhem) -> HysteresisCode:
    """Return the code in C, without the range of the input.

    It has one piece where the curve is straight and the tangent constant; then only the
    coefficients of these can be changed.
    """
    curve, tangent = model.padded()
    closed = not (np.any(curve[2:] != 0.0) or np.any(tangent[1:] != 0.0))
    tunable = [tunable_of(model, "rate", 0, "how fast the output comes to its curve")]
    for name, what, first, last in (
        ("anhysteretic", "curve to which the output tends", 1, 2),
        ("tangent", "slope of the output on its curve", 1 + TERMS, 1),
    ):
        for k in range(getattr(model, name).size):
            slope = f"/V^{k + (name == 'tangent')}".removesuffix("^1")
            tunable.append(
                tunable_of(
                    model,
                    f"{name}[{k}]",
                    first + k if k < last or not closed else None,
                    f"coefficient {k} of the {what}",
                    "m" if slope == "/V^0" else f"m{slope}",
                )
            )
    return code_of(model, [model.rate, *curve, *tangent], tunable, 1 if closed else 0)


def matlab_code(model: Duhem) -> MatlabCode:
    """Return the code in MATLAB."""
    curve, tangent = model.padded()
    numbers = {
        "rate": (model.rate, "how fast the output comes to its curve [per unit of u]"),
        "f": (curve, "coefficients of the curve, from the constant up"),
        "g": (tangent, "coefficients of the slope on the curve, from the constant up"),
    }
    return MatlabCode(parts=("duhem",), parameters=numbers)
