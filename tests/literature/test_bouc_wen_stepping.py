"""Bouc-Wen stepping against 30-digit arithmetic, and against an integrator split at its events.

Evidence (Hysteresis and records): Bouc–Wen, exponents 1 to 6, generalised, Dahl (30 digits or
integrator with events): $10^{-12}$ µm of 60 µm
"""

import math
from collections.abc import Callable
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar

from flexstage.hysteresis import AsymmetricBoucWen, BoucWen, Dahl, GeneralisedBoucWen
from flexstage.hysteresis.model import HysteresisModel

UM = 1e-6
# Rounding of a displacement of 60 um alone is 7e-15 um; sums of some terms stay below this.
TOLERANCE = 1e-12 * UM


def bouc_wen(n: float, beta: float, gamma: float) -> BoucWen:
    """Make a stack of about 60 um; beta and gamma as for n = 1, where h saturates about 5 um."""
    scale = (4.7 * UM) ** (1.0 - n)
    return BoucWen(
        gain=0.593 * UM,
        hysteresis_gain=0.397 * UM,
        beta=beta * scale,
        gamma=gamma * scale,
        exponent=n,
    )


def inputs(seed: int, count: int, low: float, high: float) -> np.ndarray:
    """Random levels, some of them next to each other and some repeated: small and huge steps."""
    rng = np.random.default_rng(seed)
    levels = rng.uniform(low, high, count)
    near = rng.random(count) < 0.4
    for k in np.flatnonzero(near):
        if k:
            levels[k] = levels[k - 1] + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-9, 0)
    levels[rng.integers(1, count)] = levels[0]
    return levels


# ------------------------------------------------------------------------- 30-digit reference


class Reference:
    """The Bouc-Wen equation for one exponent, solved by root finding on hypergeometric functions.

    The distance from 0 to g is ``(g/A) 2F1(1, 1/n; 1 + 1/n; lam g^n/A)``: no series of the package.
    """

    def __init__(self, model: BoucWen) -> None:
        self.A, self.n = mp.mpf(model.hysteresis_gain), mp.mpf(model.exponent)
        self.beta, self.gamma = mp.mpf(model.beta), mp.mpf(model.gamma)

    def distance(self, g: Any, lam: Any) -> Any:
        z = lam * g**self.n / self.A
        return g / self.A * mp.hyp2f1(1, 1 / self.n, 1 + 1 / self.n, z)

    def loaded(self, g: Any, v: Any, lam: Any) -> Any:
        """Return g after a distance, g >= 0 and lam >= 0."""
        if lam == 0:
            return g + self.A * v
        G = (self.A / lam) ** (1 / self.n)
        goal = self.distance(g, lam) + v
        # g = G (1 - exp(-L)); the distance is concave in L, at most G L/A: Newton from below.
        L = goal * self.A / G
        for _ in range(60):
            x = -mp.expm1(-L)
            # 1 - x^n at least halves with every ln 2 of L: nothing is left at 30 digits.
            if L > 90:
                return G
            slope = G / self.A * (1 - x) / (1 - x**self.n)
            correction = (goal - self.distance(G * x, lam)) / slope
            L += correction
            if abs(correction) * (1 - x) < mp.mpf(10) ** -31:
                return -G * mp.expm1(-L)
        raise AssertionError("Newton's method did not end")

    def unloaded(self, w: Any, v: Any, lam: Any) -> Any:
        """Return w after a distance shorter than that to zero."""
        goal = self.distance(w, lam) - v
        # Convex or concave, it has no turning point between here and the root.
        w = self.A * goal
        for _ in range(60):
            correction = (goal - self.distance(w, lam)) * (self.A - lam * w**self.n)
            w += correction
            if abs(correction) < mp.mpf(10) ** -31 * w:
                return w
        raise AssertionError("Newton's method did not end")

    def step(self, h: Any, du: Any) -> Any:
        if du == 0:
            return h
        s = mp.sign(du)
        v, g = abs(du), s * h
        if g < 0:
            lam = self.gamma - self.beta
            zero = self.distance(-g, lam)
            if v < zero:
                return -s * self.unloaded(-g, v, lam)
            v, g = v - zero, mp.mpf(0)
        return s * self.loaded(g, v, self.beta + self.gamma)


@pytest.mark.parametrize("n", [1.0, pytest.param(1.3, marks=pytest.mark.slow), 1.7, 2.0, 3.0, 6.0])
@pytest.mark.parametrize(
    ("beta", "gamma"), [(0.05, 0.03), (0.05, -0.041), (0.03, 0.05), (0.05, -0.05)]
)
def test_thirty_digits(n: float, beta: float, gamma: float) -> None:
    model = bouc_wen(n, beta, gamma)
    u = inputs(int(100 * n) + 7, 16, -11.0, 120.0)
    response = model.simulate(u)
    with mp.workdps(36):
        reference = Reference(model)
        h, last = mp.mpf(0), mp.mpf(0)
        for sample, value in zip(u, response.values, strict=True):
            h = reference.step(h, mp.mpf(sample) - last)
            last = mp.mpf(sample)
            assert abs(mp.mpf(value) - (mp.mpf(model.gain) * last - h)) < TOLERANCE
        # The state itself holds h closer than the output can.
        assert abs(mp.mpf(response.state[1]) - h) < 5e-14 * UM


def test_thirty_digits_know_their_equation() -> None:
    """The reference is the solution of the equation: quadrature of du = dh/(dh/du)."""
    model = bouc_wen(1.7, 0.05, 0.03)
    with mp.workdps(36):
        reference = Reference(model)
        before, after = mp.mpf("-3.1e-6"), reference.step(mp.mpf("-3.1e-6"), mp.mpf("41.3"))

        def inverse_slope(h: Any) -> Any:
            size = abs(h) ** reference.n
            return 1 / (reference.A - reference.beta * size * mp.sign(h) - reference.gamma * size)

        assert after > 0
        distance = mp.quad(inverse_slope, [before, 0, after / 2, after])
        assert abs(distance - mp.mpf("41.3")) < mp.mpf(10) ** -20


# ---------------------------------------------------------------------- event-split integrator


def integrate(
    u: np.ndarray, slope: Callable[[float, float, float], float], breaks: tuple[float, ...] = ()
) -> np.ndarray:
    """Integrate dh/du = slope(u, h, s) in um, split at reversals, at breaks and where h is zero."""
    h, last, out = 0.0, 0.0, []
    for value in u:
        s = math.copysign(1.0, value - last)
        stops = sorted(
            (b for b in breaks if min(last, value) < b < max(last, value)), key=s.__mul__
        )
        for stop in [*stops, value]:
            h = piece(last, stop, h, s, slope)
            last = stop
        out.append(h)
    return np.array(out)


def piece(
    u: float, stop: float, h: float, s: float, slope: Callable[[float, float, float], float]
) -> float:
    def run(begin: float, start: float, sign: float, events: Any) -> Any:
        # Of h the sign is that of the piece, also where the stages of a step reach across.
        return solve_ivp(
            lambda v, x: [s * slope(u + s * v, math.copysign(abs(x[0]), sign), s)],
            (begin, abs(stop - u)),
            [start],
            method="DOP853",
            rtol=1e-13,
            atol=1e-15,
            events=events,
        )

    if stop == u:
        return h
    begin = 0.0
    if s * h < 0.0:

        def zero(_v: float, x: np.ndarray) -> float:
            return x[0]

        zero.terminal = True  # type: ignore[attr-defined]
        found = run(0.0, h, h, zero)
        if not found.t_events[0].size:
            return float(found.y[0, -1])
        # The event is sharpened by Newton's method: at h = 0 the slope is smooth on each side.
        begin = found.t[-1] - found.y[0, -1] / (s * slope(u + s * found.t[-1], 0.0, s))
        h = 0.0
        if begin >= abs(stop - u):
            return 0.0
    return float(run(begin, h, s, None).y[0, -1])


def check(model: HysteresisModel, u: np.ndarray, y: np.ndarray, tolerance_um: float) -> None:
    assert np.max(np.abs(model.simulate(u).values / UM - y)) < tolerance_um


@pytest.mark.parametrize("n", [1.0, 1.3, 1.7, 2.0, 3.0])
def test_integrator(n: float) -> None:
    model = bouc_wen(n, 0.05, 0.021)
    A, beta, gamma = (
        model.hysteresis_gain / UM,
        model.beta * UM ** (n - 1),
        model.gamma * UM ** (n - 1),
    )

    def slope(_u: float, h: float, s: float) -> float:
        return A - (beta * s * math.copysign(1.0, h) + gamma) * abs(h) ** n

    u = np.random.default_rng(31).uniform(-7.0, 120.0, 23)
    check(model, u, 0.593 * u - integrate(u, slope), 1e-12)


@pytest.mark.parametrize("n", [1.0, 1.6, 2.0])
def test_generalised_against_the_integrator(n: float) -> None:
    scale = 4.3 ** (1.0 - n)
    shape = np.array([0.05, 0.006, 0.002, 0.003, -0.001, 0.004]) * scale
    centre = 53.0
    model = GeneralisedBoucWen(
        gain=0.593 * UM,
        hysteresis_gain=0.361 * UM,
        shape=tuple(shape * UM ** (1.0 - n)),
        centre=centre,
        exponent=n,
    )

    def slope(u: float, h: float, s: float) -> float:
        # A stage of a step may touch a break: the side is that of the motion's middle.
        x = math.copysign(1.0, side[0])
        sign = math.copysign(1.0, h)
        signs = np.array([s * sign, x * s, x * sign, s, sign, x])
        return 0.361 - float(shape @ signs) * abs(h) ** n

    side = [0.0]
    u = np.random.default_rng(5).uniform(-7.0, 120.0, 19)
    h, last, out = 0.0, 0.0, []
    for value in u:
        s = math.copysign(1.0, value - last)
        between = [centre] if min(last, value) < centre < max(last, value) else []
        for stop in [*between, value]:
            side[0] = (last + stop) / 2.0 - centre
            h = piece(last, stop, h, s, slope)
            last = stop
        out.append(h)
    check(model, u, 0.593 * u - np.array(out), 1e-12)


@pytest.mark.parametrize("i", [0.6, 1.0, 1.4, 2.3])
def test_dahl_against_the_integrator(i: float) -> None:
    # At 0.6 the limit would be reached, where the slope is not Lipschitz: shorter motions.
    reach = 27.0 if i < 1.0 else 120.0
    model = Dahl(gain=0.593 * UM, stiffness=0.151 * UM, limit=5.3 * UM, exponent=i)

    def slope(_u: float, F: float, s: float) -> float:
        gap = 1.0 - s * F / 5.3
        return 0.151 * abs(gap) ** i * math.copysign(1.0, gap)

    u = np.random.default_rng(8).uniform(-7.0, reach, 19)
    check(model, u, 0.593 * u - integrate(u, slope), 1e-12)


def test_dahl_reaches_its_limit_and_stays() -> None:
    # The gap closes as e^0.4 = 1 - 0.4 sigma v/F_c: at v = F_c/(0.4 sigma) = 87.7.
    model = Dahl(gain=0.593 * UM, stiffness=0.151 * UM, limit=5.3 * UM, exponent=0.6)
    end = 5.3 / (0.4 * 0.151)
    before, at, beyond = model.simulate([0.9 * end, end * (1 + 1e-12), 160.0]).values
    assert before == pytest.approx((0.593 * 0.9 * end - 5.3 * (1 - 0.1**2.5)) * UM, rel=1e-13)
    assert at == pytest.approx((0.593 * end - 5.3) * UM, rel=1e-11)
    assert beyond == pytest.approx((0.593 * 160.0 - 5.3) * UM, rel=1e-14)


def test_asymmetric_is_bouc_wen_on_a_cubic() -> None:
    for n in (1.0, 1.7):
        plain = bouc_wen(n, 0.05, 0.021)
        model = AsymmetricBoucWen(
            gain=0.593 * UM,
            quadratic=3.1e-4 * UM,
            cubic=-1.3e-6 * UM,
            hysteresis_gain=plain.hysteresis_gain,
            beta=plain.beta,
            gamma=plain.gamma,
            exponent=n,
            lowest_input=-20.0,
            highest_input=130.0,
        )
        u = inputs(3, 40, -11.0, 120.0)
        expected = plain.simulate(u).values / UM + 3.1e-4 * u**2 - 1.3e-6 * u**3
        check(model, u, expected, 1e-12)


# --------------------------------------------------------------------------- published figures


@pytest.mark.parametrize(
    ("gain", "share", "stroke", "width"),
    [(0.593256926491, 0.544261037785, 63.12, 7.91), (0.571695928572, 0.539082745722, 60.90, 7.55)],
    ids=["x", "y"],
)
def test_published_loop(gain: float, share: float, stroke: float, width: float) -> None:
    """The stroke and loop width that the study measured at 120 V [um], by one valid set.

    The set has h in volts, y = d (u - h): A is a share of the gain.
    """
    model = BoucWen(gain=gain, hysteresis_gain=gain * share, beta=0.05, gamma=0.03)
    bottom = model.simulate([120.0, 0.0] * 12).state
    top, highest = model.step(bottom, 120.0)
    lowest = model.gain * bottom[0] - bottom[1]
    assert highest - lowest == pytest.approx(stroke, abs=5e-10)

    def negative_width(u: float) -> float:
        return model.step(bottom, u)[1] - model.step(top, u)[1]

    found = minimize_scalar(negative_width, bounds=(20.0, 110.0), options={"xatol": 1e-8})
    assert -found.fun == pytest.approx(width, abs=5e-10)
