"""Order and accuracy of the Bouc–Wen oscillator, against an integrator split at the events.

The right side has a corner where the velocity or the hysteretic force passes zero. The reference
stops there (DOP853 of scipy, relative tolerance 3e-14) and goes on with the other branch.
"""

import functools
import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexstage.hysteresis.oscillator.model import (
    BoucWenOscillator,
    input_pieces,
    parameter_row,
)
from flexstage.hysteresis.oscillator.steps import _first_zero, advance

RATE = 800.0
N = 260
START = (1.1e-4, -0.023, 7.3)


def oscillator(exponent: float) -> BoucWenOscillator:
    unit = 61.0 ** (1.0 - exponent)
    return BoucWenOscillator(
        mass=1.7,
        damping=8.3,
        stiffness=4.1e4,
        alpha=5.3e4,
        beta_gamma=870.0 * unit,
        beta_delta=-420.0 * unit,
        exponent=exponent,
    )


def drive() -> np.ndarray:
    return 90.0 * np.convolve(np.random.default_rng(5).standard_normal(N), np.hanning(7), "same")


def branch(
    model: BoucWenOscillator, line: tuple[float, float], signs: tuple[float, float]
) -> Callable[[float, np.ndarray], list[float]]:
    """Return the right side for given signs of the velocity and of the force."""
    v_sign, z_sign = signs
    rate = model.beta_gamma * v_sign * z_sign + model.beta_delta

    def right_side(t: float, x: np.ndarray) -> list[float]:
        y, v, z = x
        # A trial step may pass zero: nu = 1 is continued as it is, a power stops there.
        g = z_sign * z if model.exponent == 1.0 else max(z_sign * z, 0.0) ** model.exponent
        u = line[0] + line[1] * t
        acceleration = (u - model.damping * v - model.stiffness * y - z) / model.mass
        return [v, acceleration, v * (model.alpha - rate * g)]

    return right_side


def event_split(
    model: BoucWenOscillator, force: np.ndarray, start: tuple[float, ...]
) -> np.ndarray:
    state, motion = np.array(start), [np.array(start)]
    for first, second in itertools.pairwise(force):
        t, end, line = 0.0, 1.0 / RATE, (first, (second - first) * RATE)
        while t < end:
            y, v, z = state
            push = line[0] + line[1] * t - model.damping * v - model.stiffness * y - z
            v_sign = math.copysign(1.0, v if v != 0.0 else push)
            z_sign = math.copysign(1.0, z) if z != 0.0 else v_sign
            events = [lambda _, x, s=v_sign: s * x[1], lambda _, x, s=z_sign: s * x[2]]
            for event in events:
                event.terminal, event.direction = True, -1
            run = solve_ivp(
                branch(model, line, (v_sign, z_sign)),
                (t, end),
                state,
                method="DOP853",
                rtol=3e-14,
                atol=[1e-19, 1e-17, 1e-14],
                events=events,
            )
            t, state = run.t[-1], run.y[:, -1].copy()
            if run.status == 1:
                state[1 if run.t_events[0].size else 2] = 0.0
        motion.append(state)
    return np.array(motion)


@functools.cache
def reference(exponent: float) -> np.ndarray:
    return event_split(oscillator(exponent), drive(), START)


# Some 40 events; the reference itself is good to some 1e-13.
@pytest.mark.parametrize("exponent", [0.7, 1.0, 1.3, 1.7, 2.0, 3.0])
def test_motion_equals_event_split_integrator(exponent: float) -> None:
    response = oscillator(exponent).simulate(drive(), RATE, START, interpolation="linear")
    motion = np.stack([response.displacement, response.velocity, response.force], axis=1)
    expected = reference(exponent)
    assert np.sum(np.diff(np.sign(expected[:, 1])) != 0) > 15
    assert np.sum(np.diff(np.sign(expected[:, 2])) != 0) > 15
    error = np.max(np.abs(motion - expected), axis=0) / np.max(np.abs(expected), axis=0)
    assert np.all(error < 1e-12), error
    np.testing.assert_array_equal(response.state, motion[-1])


# Samples between the samples leave straight lines as they are.
@pytest.mark.parametrize("exponent", [0.8, 1.0, 2.4])
@pytest.mark.parametrize("parts", [2, 7])
def test_cut_steps_give_the_same_motion(exponent: float, parts: int) -> None:
    model, force = oscillator(exponent), drive()
    fine = np.interp(np.arange(parts * (N - 1) + 1) / parts, np.arange(N), force)
    whole = model.simulate(force, RATE, START, interpolation="linear")
    cut = model.simulate(fine, parts * RATE, START, interpolation="linear")
    size = np.max(np.abs(whole.displacement))
    assert np.max(np.abs(cut.displacement[::parts] - whole.displacement)) < 1e-13 * size


# With steps as long as the intervals, a series of degree p leaves an error of order h**p in all,
# corners or not.
@pytest.mark.parametrize("order", [3, 4, 6])
def test_observed_order_is_the_degree_of_the_series(order: int) -> None:
    model, force = oscillator(1.0), drive()
    errors = []
    for parts in (4, 8, 16):
        fine = np.interp(np.arange(parts * (N - 1) + 1) / parts, np.arange(N), force)
        motion = np.empty((fine.size, 3))
        pieces = input_pieces(fine, "linear")
        start = np.array(START)
        advance(pieces, 1.0 / RATE / parts, parameter_row(model), start, order, np.inf, motion)
        errors.append(np.sqrt(np.mean((motion[::parts, 0] - reference(1.0)[:, 0]) ** 2)))
    observed = np.log2(np.array(errors[:-1]) / errors[1:])
    # Not a single smooth error: some fraction of an order is left to its statistics.
    assert observed[-1] == pytest.approx(order, abs=0.35), errors


# What the tolerance promises is kept within a factor: a search may loosen it.
@pytest.mark.parametrize("exponent", [1.0, 1.3])
def test_error_follows_the_tolerance(exponent: float) -> None:
    model, pieces = oscillator(exponent), input_pieces(drive(), "linear")
    size = np.max(np.abs(reference(exponent)[:, 0]))
    for tolerance in (1e-6, 1e-8, 1e-10):
        motion = np.empty((N, 3))
        advance(pieces, 1.0 / RATE, parameter_row(model), np.array(START), 13, tolerance, motion)
        error = np.max(np.abs(motion[:, 0] - reference(exponent)[:, 0])) / size
        assert 1e-4 * tolerance < error < 30.0 * tolerance


# A velocity may pass zero and come back within one step: the ends alone do not show it.
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("start", [0, 1])
def test_two_zeros_in_a_step_are_seen(sign: float, start: int) -> None:
    series = np.zeros(7)
    series[start : start + 3] = [0.41 * 0.47 * sign, -0.88 * sign, sign]
    t, found = _first_zero(series, 1.0, 6, True)
    assert found
    assert t == pytest.approx(0.41, rel=1e-14)
    series[start] += 0.01 * sign  # it comes near zero and leaves
    assert _first_zero(series, 1.0, 6, True) == (1.0, False)
    series[start : start + 3] = [0.41 * 1.3 * sign, -1.71 * sign, sign]
    t, found = _first_zero(series, 1.0, 6, False)
    assert found
    assert t == pytest.approx(0.41, rel=1e-14)
