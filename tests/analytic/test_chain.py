"""Each element of the linear chain against closed forms, 40 digits, and scipy's integrators.

Evidence (Hysteresis and records): lag, creep, modes (integration, 40 digits): $10^{-9}$
"""

import itertools
import math

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import exp1, gamma

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.chain.creep import CreepSpectrum, LogCreep
from flexstage.hysteresis.chain.element import ChainElement
from flexstage.hysteresis.chain.lag import Lag, lag_moments, ramp_share
from flexstage.hysteresis.chain.modal import unit_step
from flexstage.hysteresis.chain.sensor import Sensor
from flexstage.hysteresis.chain.stage_modes import StageModes, _polynomials


def polyline(count: int = 40, seed: int = 5) -> Array:
    """A sequence that turns, stands still and jumps about, and does not start at zero."""
    x = 31.0 + 9.0 * np.random.default_rng(seed).normal(size=count).cumsum()
    x[7:10] = x[7]
    return x


def integrated(rate: object, start: list[float], x: Array, dt: float) -> Array:
    """States at the samples by DOP853, one line of the input after the other."""
    states = [np.array(start)]
    for a, b in itertools.pairwise(x):
        found = solve_ivp(
            lambda t, s, a=a, b=b: rate(s, a + (b - a) * t / dt),  # type: ignore[operator]
            (0.0, dt),
            states[-1],
            method="DOP853",
            rtol=1e-13,
            atol=1e-13,
        )
        states.append(found.y[:, -1])
    return np.array(states)


# ------------------------------------------------------------------------------------------- lag


@pytest.mark.parametrize("delay_in_halves", [0, 1, 4, 5])
def test_lag_with_fractional_delay_against_integration(delay_in_halves: int) -> None:
    dt, T = 7e-4, 1.9e-3
    x = polyline()
    halves = np.interp(np.arange(2 * x.size - 1) / 2.0, np.arange(x.size), x)
    lagged = integrated(lambda s, u: (u - s) / T, [x[0]], halves, dt / 2.0)[:, 0]
    late = np.concatenate((np.full(delay_in_halves, x[0]), lagged))[: lagged.size][::2]
    mine = Lag(time_constant=T, delay=delay_in_halves * dt / 2.0).simulate(x, dt).values
    assert np.abs(mine - late).max() < 1e-11


def test_delay_alone_is_the_line_between_the_samples() -> None:
    x, dt = polyline(), 3e-4
    mine = Lag(delay=2.3 * dt).simulate(x, dt).values
    assert mine == pytest.approx(
        np.interp(np.arange(x.size) - 2.3, np.arange(x.size), x), rel=1e-13
    )


def test_lead_undoes_lag_and_delay_of_a_smooth_signal() -> None:
    dt, lag = 1e-4, Lag(time_constant=1.7e-3, delay=6.35e-4)
    # at rest for a while at both ends
    t = np.clip(np.arange(600) * dt - 0.005, 0.0, 1.0 / 23.0)
    wanted = 4.0 * (1.0 - np.cos(2.0 * np.pi * 23.0 * t)) ** 2
    command = lag.lead(wanted, dt)
    assert np.abs(lag.simulate(wanted, dt).values - wanted).max() > 1.0
    # the command is a line between samples, off by its curvature
    assert np.abs(lag.simulate(command, dt).values - wanted).max() < 3e-4


@pytest.mark.parametrize("ratio", [1e-12, 3e-5, 0.7, 0.999999, 1.000001, 13.0, math.inf])
def test_share_of_a_ramp_keeps_its_digits(ratio: float) -> None:
    exact = 1.0
    if math.isfinite(ratio):
        with mp.workdps(40):
            r = mp.mpf(ratio)
            exact = float(1 - (1 - mp.exp(-r)) / r)
    assert float(ramp_share(ratio)) == pytest.approx(exact, rel=5e-16)


def test_moments_of_lags_against_40_digits() -> None:
    ratio = np.array([1e-9, 0.013, 1.99, 2.01, 47.0])
    found = lag_moments(ratio)
    with mp.workdps(40):
        for i, r in enumerate(ratio.tolist()):
            for j in (0, 1, 5, 11):
                exact = r * mp.hyp1f1(1, j + 2, -mp.mpf(r)) / mp.factorial(j + 1)
                assert found[j, i] == pytest.approx(float(exact), rel=2e-14)


# ----------------------------------------------------------------------------------------- creep


def test_creep_against_integration() -> None:
    x, dt = polyline(), 0.37
    creep = LogCreep(rate_per_decade=0.031, shortest=0.2, longest=90.0, per_decade=2)
    tau, a = creep.time_constants, creep.lag_gain
    lags = integrated(lambda s, u: (u - s) / tau, [x[0]] * tau.size, x, dt)
    exact = x + a * lags.sum(axis=1)
    assert np.abs(creep.simulate(x, dt).values - exact).max() < 1e-11


def test_creep_rises_with_the_logarithm_of_time() -> None:
    s, e, rate = 0.01, 1e6, 0.027
    t = np.geomspace(1.0, 10.0, 57)
    t0 = s * math.exp(-np.euler_gamma)
    for per_decade in (1, 2, 3):
        creep = LogCreep(rate_per_decade=rate, shortest=s, longest=e, per_decade=per_decade)
        miss = np.abs(creep.step_response(t) - 1.0 - rate * np.log10(t / t0)).max()
        # Poisson's sum: the first harmonic of the lags in the logarithm of time
        turn = 2.0 * math.pi * per_decade / math.log(10.0)
        ripple = 2.0 * rate / math.log(10.0) * abs(gamma(1j * turn))
        end = rate / math.log(10.0) * t[-1] / e
        assert miss == pytest.approx(ripple, rel=0.02, abs=1.2 * end)


def test_creep_is_that_of_its_continuous_distribution() -> None:
    s, e, rate = 0.013, 770.0, 0.041
    creep = LogCreep(rate_per_decade=rate, shortest=s, longest=e, per_decade=4)
    t = np.geomspace(1e-3, 1e5, 90)
    spread = math.log(e / s) + exp1(t / s) - exp1(t / e)
    # where the distribution ends the lags are its midpoint rule, whose error is h^2/24 f'
    end = rate / math.log(10.0) * (math.log(10.0) / 4.0) ** 2 / 24.0 / math.e
    assert creep.step_response(t) == pytest.approx(
        1.0 + rate / math.log(10.0) * spread, abs=1.05 * end
    )
    assert creep.static_gain == pytest.approx(1.0 + rate * math.log10(e / s))
    assert creep.step_response(1e9) == pytest.approx(creep.static_gain, rel=1e-13)


def test_a_jump_creeps_as_the_step_response_says() -> None:
    creep, dt = LogCreep(rate_per_decade=0.02, longest=300.0), 0.013
    state = creep.settled(0.0, dt)
    state[0] = 7.3
    t = dt * np.arange(1, 400)
    y = creep.simulate(np.full(t.size, 7.3), dt, state).values
    assert y == pytest.approx(7.3 * creep.step_response(t), rel=1e-13)


def test_creep_is_undone_exactly() -> None:
    x, dt = polyline(400), 1e-3
    creep = LogCreep(rate_per_decade=0.05, per_decade=3)
    y = creep.simulate(x, dt)
    back = creep.inverse(y.values, dt)
    assert np.abs(back.values - x).max() < 1e-12 * np.abs(x).max()
    assert back.state == pytest.approx(y.state, rel=1e-12)


_SPECTRUM = CreepSpectrum(times=(0.0007, 0.021, 0.37, 52.0), weights=(0.9, 0.04, 0.0, 0.07))


def test_a_spectrum_against_integration() -> None:
    x, dt = polyline(), 0.0017
    tau = _SPECTRUM.time_constants
    lags = integrated(lambda s, u: (u - s) / tau, [x[0]] * tau.size, x, dt)
    exact = x + lags @ np.array([0.9, 0.04, 0.0, 0.07])
    assert np.abs(_SPECTRUM.simulate(x, dt).values - exact).max() < 1e-11


def test_a_jump_relaxes_as_the_weights_say() -> None:
    dt = 0.0031
    state = _SPECTRUM.settled(0.0, dt)
    state[0] = 7.3
    t = dt * np.arange(1, 900)
    y = _SPECTRUM.simulate(np.full(t.size, 7.3), dt, state).values
    exact = 7.3 * (
        2.01 - 0.9 * np.exp(-t / 0.0007) - 0.04 * np.exp(-t / 0.021) - 0.07 * np.exp(-t / 52.0)
    )
    assert y == pytest.approx(exact, rel=1e-12)
    assert _SPECTRUM.step_response(t) * 7.3 == pytest.approx(exact, rel=1e-13)


def test_a_spectrum_is_undone_exactly_where_its_lags_are_faster_than_the_samples() -> None:
    x, dt = polyline(400), 0.01
    y = _SPECTRUM.simulate(x, dt)
    back = _SPECTRUM.inverse(y.values, dt)
    assert np.abs(back.values - x).max() < 1e-12 * np.abs(x).max()
    assert back.state == pytest.approx(y.state, rel=1e-12)


def test_a_logarithm_is_the_spectrum_of_its_lags() -> None:
    log = LogCreep(rate_per_decade=0.031, shortest=0.2, longest=90.0, per_decade=2)
    same = CreepSpectrum(times=tuple(log.time_constants), weights=tuple(log.lag_gains))
    x, dt = polyline(60), 0.37
    assert same.simulate(x, dt).values == pytest.approx(log.simulate(x, dt).values, rel=1e-14)
    assert same.static_gain == pytest.approx(log.static_gain, rel=1e-14)
    assert same.lag_gains == pytest.approx(log.lag_gains, rel=1e-14)


# ----------------------------------------------------------------------------------------- stage

TWO = StageModes(frequency_hz=(339.0, 527.0), damping_ratio=(0.012, 0.045), share=(0.81, 0.13))


def test_stage_against_integration() -> None:
    x, dt = polyline(), 4.1e-4
    w, zeta = TWO.omega, np.array(TWO.damping_ratio)

    def rate(s: Array, u: float) -> Array:
        z, v = s[:2], s[2:]
        return np.concatenate((v, w**2 * (u - z) - 2.0 * zeta * w * v))

    z = integrated(rate, [x[0], x[0], 0.0, 0.0], x, dt)[:, :2]
    exact = TWO.static_share * x + z @ np.array(TWO.share)
    assert np.abs(TWO.simulate(x, dt).values - exact).max() < 1e-9


@pytest.mark.parametrize("w", [3e-4, 0.21, 2.99, 3.01, 63.0])
@pytest.mark.parametrize("zeta", [0.0, 0.013, 0.9995, 1.0, 1.7])
def test_step_of_a_mode_against_40_digits(w: float, zeta: float) -> None:
    found = unit_step(np.array([w]), np.array([zeta]))
    orders = found.moments.shape[0] - 1
    with mp.workdps(60):
        A = mp.zeros(2 + orders)
        A[0, 1], A[1, 0], A[1, 1], A[1, 2] = 1, -(mp.mpf(w) ** 2), -2 * mp.mpf(zeta) * w, 1
        for j in range(2, 1 + orders):
            A[j, j + 1] = 1
        e = mp.expm(A)
        # rates are of the size of w, forces of the size of w^2
        own = 2e-15 * max(1.0, w)
        assert found.transition[0, 0] == pytest.approx(float(e[0, 0]), abs=own)
        assert found.transition[1, 0] == pytest.approx(float(e[0, 1]), abs=own / max(1.0, w))
        assert found.transition[2, 0] == pytest.approx(float(e[1, 0]), abs=own * w)
        assert found.transition[3, 0] == pytest.approx(float(e[1, 1]), abs=own)
        for j in range(orders):
            by_z, by_v = float(w**2 * e[0, 2 + j]), float(w**2 * e[1, 2 + j])
            assert found.moments[j + 1, 0] == pytest.approx(by_z, rel=1e-14, abs=own * min(1, w))
            assert found.moments[j, 0] == pytest.approx(by_v, rel=1e-14, abs=own * w)


@pytest.mark.parametrize(
    "element",
    [
        Lag(time_constant=2.1e-3, delay=0.7e-3),
        LogCreep(rate_per_decade=0.04, shortest=2e-4, longest=0.02),
        StageModes(frequency_hz=(93.0, 160.0), damping_ratio=(0.2, 0.3), share=(0.7, 0.2)),
        Amplifier(bandwidth_hz=130.0, gain=1.4),
        Sensor(gain=0.83, bandwidth_hz=210.0),
    ],
    ids=lambda element: type(element).__name__,
)
def test_a_long_sine_is_what_the_frequency_response_says(element: ChainElement) -> None:
    f, dt = 61.0, 1e-5
    t = dt * np.arange(40000)
    y = element.simulate(np.sin(2.0 * np.pi * f * t), dt).values
    h = element.frequency_response([f])[0]
    late = t > 0.25
    # lines between 1640 samples of a period
    exact = np.abs(h) * np.sin(2.0 * np.pi * f * t + np.angle(h))
    assert y[late] == pytest.approx(exact[late], abs=3e-6)


def test_inverse_of_one_mode_is_its_equation() -> None:
    stage = StageModes(frequency_hz=[339.0], damping_ratio=[0.012])
    dt, w0 = 2e-5, 2.0 * np.pi * 40.0
    t = dt * np.arange(3000)
    y, rate, curvature = (
        11.0 * (1.0 - np.cos(w0 * t)),
        11.0 * w0 * np.sin(w0 * t),
        11.0 * w0**2 * np.cos(w0 * t),
    )
    w = 2.0 * np.pi * 339.0
    exact = y + 2.0 * 0.012 / w * rate + curvature / w**2
    assert np.abs(stage.inverse(y, dt).values - exact).max() < 1e-6


def test_inverse_of_several_modes_makes_the_stage_follow() -> None:
    dt = 2e-5
    t = dt * np.arange(5000)
    # a smooth rise that starts and ends at rest
    s = np.clip((t - 0.01) / 0.03, 0.0, 1.0)
    y = 23.0 * s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)
    for stage in (
        TWO,
        StageModes(frequency_hz=(339.0, 527.0), damping_ratio=(0.012, 0.045), share=(0.77, 0.23)),
    ):
        assert np.abs(stage.simulate(y, dt).values - y).max() > 0.03
        x = stage.inverse(y, dt).values
        # what is left is the curvature of the input between its samples
        assert np.abs(stage.simulate(x, dt).values - y).max() < 2e-4
        half = stage.inverse(np.interp(np.arange(9999) / 2.0, np.arange(5000), y), dt / 2.0)
        assert half.values[::2] == pytest.approx(x, abs=0.2)


def test_zeros_of_a_stage_are_where_it_does_not_answer() -> None:
    above, _, unit = _polynomials(TWO)
    for zero in unit * np.roots(above):
        w, zeta = TWO.omega, np.array(TWO.damping_ratio)
        mode = w**2 / (zero**2 + 2.0 * zeta * w * zero + w**2)
        assert abs(TWO.static_share + np.sum(np.array(TWO.share) * mode)) < 1e-10


def test_a_stage_that_is_not_minimum_phase_is_refused() -> None:
    with pytest.raises(ModelError, match="left half-plane"):
        StageModes(
            frequency_hz=(339.0, 527.0), damping_ratio=(0.01, 0.02), share=(1.9, -0.9)
        ).inverse(polyline(), 1e-4)


# ------------------------------------------------------------------------------------- amplifier


def amplified(amplifier: Amplifier, command: Array, dt: float) -> Array:
    """The same amplifier by many small midpoint steps, which know nothing of events."""
    T, most = amplifier.time_constant, amplifier.largest_rate
    low, high = amplifier.voltage_range or (-math.inf, math.inf)
    parts = 4000
    u = min(max(amplifier.gain * command[0], low), high)
    out = [u]
    h = dt / parts
    for a, b in itertools.pairwise(command):
        for i in range(parts):
            c = amplifier.gain * (a + (b - a) * (i + 0.5) / parts)
            middle = u + 0.5 * h * min(max((c - u) / T, -most), most)
            u += h * min(max((c - middle) / T, -most), most)
            u = min(max(u, low), high)
        out.append(u)
    return np.array(out)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_amplifier_with_all_limits_against_small_steps(seed: int) -> None:
    amplifier = Amplifier(
        bandwidth_hz=310.0,
        capacitance=6.4e-6,
        current_limit=0.21,
        slew_limit=6e4,
        voltage_range=(-17.0, 118.0),
        gain=1.3,
    )
    rng = np.random.default_rng(seed)
    command = rng.uniform(-40.0, 120.0, 25)
    command[9:14] = command[9]
    dt = 2.3e-3
    mine = amplifier.simulate(command, dt).values
    exact = amplified(amplifier, command, dt)
    assert np.abs(mine - exact).max() < 2e-3
    assert np.any(mine == 118.0)
    assert np.any(mine == -17.0)


@pytest.mark.parametrize("parts", [2, 7])
def test_amplifier_does_not_depend_on_how_a_line_is_cut(parts: int) -> None:
    amplifier = Amplifier(
        bandwidth_hz=310.0, slew_limit=3.1e4, voltage_range=(-17.0, 118.0), gain=-0.9
    )
    command, dt = np.random.default_rng(8).uniform(-150.0, 60.0, 200), 1.7e-3
    fine = np.interp(np.arange((command.size - 1) * parts + 1) / parts, np.arange(200), command)
    whole = amplifier.simulate(command, dt).values
    assert amplifier.simulate(fine, dt / parts).values[::parts] == pytest.approx(whole, abs=1e-10)


@pytest.mark.parametrize("kind", [Amplifier, Sensor])
def test_amplifier_without_limits_and_sensor_without_noise_are_a_lag(
    kind: type[Amplifier] | type[Sensor],
) -> None:
    x, dt = polyline(), 3e-4
    lag = Lag(time_constant=1.0 / (2.0 * math.pi * 700.0))
    found = kind(bandwidth_hz=700.0, gain=1.2).simulate(x, dt).values
    assert found == pytest.approx(1.2 * lag.simulate(x, dt).values, rel=1e-13)


def test_current_and_capacitance_limit_the_rate() -> None:
    amplifier = Amplifier(
        bandwidth_hz=5e3, capacitance=6.4e-6, current_limit=0.064, slew_limit=2.5e4
    )
    assert amplifier.largest_rate == pytest.approx(1e4)
    f = amplifier.largest_rate / (2.0 * np.pi * 60.0)
    assert f == pytest.approx(26.526, abs=1e-3)
    t = 1e-5 * np.arange(20000)
    below, above = (
        amplifier.simulate(60.0 * np.sin(2.0 * np.pi * g * t), 1e-5).values
        for g in (0.97 * f, 2 * f)
    )
    assert below[10000:].max() == pytest.approx(60.0, rel=1e-3)
    # a triangle of the largest rate is left
    assert above[10000:].max() == pytest.approx(1e4 / (8.0 * f), rel=1e-2)


# ---------------------------------------------------------------------------------------- sensor


def test_sensor_adds_what_it_says() -> None:
    dt, x = 1e-4, np.full(60000, 3.1e-6)
    noisy = Sensor(gain=1.02, offset=-4e-8, noise_rms=6e-9, seed=11).simulate(x, dt).values
    assert noisy.mean() == pytest.approx(1.02 * 3.1e-6 - 4e-8, abs=1e-10)
    assert noisy.std() == pytest.approx(6e-9, rel=0.02)
    other = Sensor(gain=1.02, offset=-4e-8, noise_rms=6e-9, seed=12).simulate(x, dt).values
    assert abs(np.corrcoef(noisy, other)[0, 1]) < 0.02
    humming = Sensor(mains_amplitude=1e-8, mains_phase=0.4).simulate(x, dt).values - x
    assert humming == pytest.approx(1e-8 * np.sin(2 * np.pi * 50 * dt * np.arange(x.size) + 0.4))
    coarse = Sensor(quantisation=7e-9).simulate(polyline() * 1e-9, dt).values
    assert coarse / 7e-9 == pytest.approx(np.round(coarse / 7e-9), abs=1e-9)
    assert np.abs(coarse - polyline() * 1e-9).max() <= 3.5e-9 * (1 + 1e-9)


def test_sensor_does_not_depend_on_how_a_record_is_cut() -> None:
    sensor = Sensor(noise_rms=5e-9, mains_amplitude=1e-8, bandwidth_hz=400.0, offset=2e-8, seed=3)
    x, dt = polyline(9000) * 1e-6, 1e-4
    whole = sensor.simulate(x, dt).values
    first = sensor.simulate(x[:4099], dt)
    second = sensor.simulate(x[4099:], dt, first.state)
    assert np.concatenate((first.values, second.values)) == pytest.approx(whole, abs=1e-19)


# -------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Lag(time_constant=-1e-3), "time_constant of a lag"),
        (lambda: LogCreep(rate_per_decade=-0.01), "not negative"),
        (lambda: LogCreep(rate_per_decade=0.01, shortest=2.0, longest=1.0), "creep must rise"),
        (lambda: LogCreep(rate_per_decade=0.01, per_decade=0), "1 to 100"),
        (lambda: CreepSpectrum(times=(0.1, 0.1), weights=(0.1, 0.2)), "creep must rise"),
        (lambda: CreepSpectrum(times=(), weights=()), "creep must rise"),
        (lambda: CreepSpectrum(times=(0.1, 0.2), weights=(0.1, -0.2)), "none negative"),
        (lambda: CreepSpectrum(times=(0.1, 0.2), weights=(0.1,)), "one weight for each"),
        (lambda: CreepSpectrum(times=(0.1,), weights=(0.0,)), "not all zero"),
        (lambda: StageModes(frequency_hz=[1.0, 2.0], damping_ratio=[0.1]), "as many of"),
        (lambda: StageModes(frequency_hz=[-1.0], damping_ratio=[0.1]), "must be positive"),
        (lambda: StageModes(frequency_hz=[1.0], damping_ratio=[-0.1]), "not be negative"),
        (lambda: Amplifier(bandwidth_hz=0.0), "bandwidth_hz of an amplifier"),
        (lambda: Amplifier(bandwidth_hz=1.0, voltage_range=(2.0, 1.0)), "must rise"),
        (lambda: Amplifier(bandwidth_hz=1.0, capacitance=-1.0), "capacitance"),
        (lambda: Sensor(gain=0.0), "gain of a sensor"),
        (lambda: Sensor(noise_rms=-1.0), "noise_rms"),
        (lambda: Sensor(bandwidth_hz=0.0), "omit it for none"),
        (lambda: Lag().simulate([1.0], 0.0), "step between samples"),
        (lambda: Lag().simulate([1.0, math.nan], 0.1), "sample 1"),
        (lambda: Lag(delay=0.3).simulate([1.0], 0.1, [1.0, 2.0]), "state of a lag is"),
        (lambda: LogCreep(rate_per_decade=0.1).simulate([1.0], 0.1, [1.0]), "state of creep"),
        (lambda: TWO.inverse([1.0] * 5, 0.1), "6 samples"),
        (lambda: Lag().lead([1.0] * 5, 0.1), "6 samples"),
    ],
)
def test_what_cannot_be_is_refused(make: object, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        make()  # type: ignore[operator]
