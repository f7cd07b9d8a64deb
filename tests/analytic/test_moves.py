r"""Moves from rest to rest: shapers, jerk-limited and minimum-time commands, and their settling.

Evidence (Instruments, twin, control): ZV, ZVD and EI shapers (closed curves of Singer and Seering):
$10^{-12}$; insensitivity 0.064, 0.287, 0.400 at 5 %; settling against the matrix exponential of the
mode $10^{-9}$ of the step
"""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import cont2discrete, dlsim

from flexstage.base.errors import LimitError, ModelError
from flexstage.control import jerk_limited, minimum_time, shaped, shaper
from flexstage.control.loop_plant import LoopPlant, loop_margins
from flexstage.control.moves import (
    MovePlant,
    MoveResponse,
    VoltageLimits,
    _programme,
    convolved,
    fastest_ramp,
    residual_vibration,
    scattered_plants,
)
from flexstage.hysteresis import StageModes
from flexstage.hysteresis.requests import ModeTolerance
from flexstage.system.servo import Notch, ServoSettings

F, RATE = 320.0, 10e3
KINDS = ("zv", "zvd", "ei")


def plant(damping: float = 0.01, **changes) -> LoopPlant:
    """One mode behind an amplifier of 2 kHz, and its delay."""
    values = {
        "gain": 5e-7, "gain_range": (4e-7, 6e-7), "delay": 2e-4, "time_constant": 8e-5,
        "modes": StageModes(frequency_hz=[F], damping_ratio=[damping]), "sample_rate_hz": RATE,
    }  # fmt: skip
    return LoopPlant(**(values | changes))


def free_vibration(times, amplitudes, frequency_hz, zeta):
    """Amplitude left by impulses of a mode, stepped by its matrix exponential."""
    w = 2.0 * np.pi * frequency_hz
    A = np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]])
    x = np.zeros(2)
    for (t, a), (after, _) in pairwise([*zip(times, amplitudes, strict=True), (times[-1], 0.0)]):
        x = expm(A * (after - t)) @ (x + np.array([0.0, a]))
    # of a decaying sine A sin(wd t + phi): its amplitude now
    wd = w * math.sqrt(1.0 - zeta * zeta)
    return math.hypot(x[0] * wd, x[1] + zeta * w * x[0])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("zeta", [0.0, 0.01, 0.05, 0.2])
def test_a_shaper_leaves_what_the_matrix_exponential_of_the_mode_says(kind, zeta) -> None:
    made = shaper(kind, F, zeta)
    assert made.amplitudes.sum() == pytest.approx(1.0, rel=1e-12)
    assert np.all(made.amplitudes > 0.0)
    for ratio in (0.8, 0.95, 1.0, 1.07, 1.3):
        left = free_vibration(made.times, made.amplitudes, ratio * F, zeta)
        assert float(made.residual(ratio * F)) == pytest.approx(left, abs=1e-12)
    at = {"zv": 0.0, "zvd": 0.0, "ei": 0.05}[kind]
    assert float(made.residual(F)) == pytest.approx(at, abs=1e-9)
    # ZVD and EI are flat at the mode, ZV has a corner
    sides = made.residual(F * np.array([0.999, 1.001])) - at
    assert np.max(np.abs(sides)) < {"zv": 2e-3, "zvd": 1e-5, "ei": 1e-5}[kind]
    assert kind != "zv" or np.min(sides) > 1e-3


def test_without_damping_the_curves_are_the_closed_ones() -> None:
    ratio = np.linspace(0.3, 1.7, 141)
    cosine = np.cos(0.5 * np.pi * ratio)
    np.testing.assert_allclose(shaper("zv", F, 0.0).residual(ratio * F), np.abs(cosine), atol=1e-12)
    np.testing.assert_allclose(shaper("zvd", F, 0.0).residual(ratio * F), cosine**2, atol=1e-12)
    # (1 + V)/4, (1 - V)/2, (1 + V)/4 at 0, T/2, T
    ei = np.abs(0.475 + 0.525 * np.cos(np.pi * ratio))
    np.testing.assert_allclose(shaper("ei", F, 0.0).residual(ratio * F), ei, atol=1e-9)


@pytest.mark.parametrize(
    ("kind", "width", "published"),
    [
        ("zv", 4.0 / math.pi * math.asin(0.05), 0.06),
        ("zvd", 4.0 / math.pi * math.asin(math.sqrt(0.05)), 0.29),
        ("ei", 2.0 - 2.0 / math.pi * math.acos((0.05 - 0.475) / 0.525), 0.40),
    ],
)
def test_the_insensitivity_at_5_percent_is_the_published_one(kind, width, published) -> None:
    ratio = np.linspace(0.7, 1.3, 60_001)
    inside = ratio[shaper(kind, F, 0.0).residual(ratio * F) <= 0.05 + 1e-9]
    assert np.ptp(inside) == pytest.approx(width, abs=3e-5)
    # W. E. Singhose, W. P. Seering, N. C. Singer 1994
    assert round(width, 2) == published


def test_the_extra_insensitive_shaper_is_flat_and_stays_below_5_percent_with_damping() -> None:
    made = shaper("ei", F, 0.05)
    np.testing.assert_allclose(made.amplitudes, [0.30676, 0.46765, 0.22559], atol=1e-5)
    damped = made.times * F * math.sqrt(1.0 - 0.05**2)
    np.testing.assert_allclose(damped, [0.0, 0.50107, 0.99824], atol=1e-5)
    assert made.residual(F * np.linspace(0.85, 1.15, 301)).max() < 0.0501


def test_two_shapers_in_series_leave_both_modes_at_rest() -> None:
    times, amplitudes = convolved([shaper("zv", 320.0, 0.01), shaper("zv", 533.0, 0.01)])
    np.testing.assert_allclose(1e3 * times, [0.0, 0.938, 1.5626, 2.5006], atol=1e-3)
    np.testing.assert_allclose(amplitudes, [0.2579, 0.2499, 0.2499, 0.2422], atol=1e-4)
    assert residual_vibration(times, amplitudes, [320.0, 533.0], 0.01).max() < 1e-12
    # impulses of one time are one: four halves become 1, 2, 1
    times, amplitudes = convolved([shaper("zv", F, 0.0)] * 2)
    np.testing.assert_allclose(amplitudes, [0.25, 0.5, 0.25], atol=1e-12)
    assert times.size == 3


@pytest.mark.parametrize("kind", KINDS)
def test_samples_between_impulses_leave_the_mode_as_the_impulses_do(kind) -> None:
    made = shaper(kind, 533.0, 0.01)
    taps = made.taps(RATE)
    left = float(residual_vibration(np.arange(taps.size) / RATE, taps, 533.0, 0.01))
    assert left == pytest.approx(0.05 if kind == "ei" else 0.0, abs=2e-3 if kind == "ei" else 1e-12)
    # rounded to the nearest sample it leaves 6.3 % (ZV) and 8.1 % (ZVD)
    rounded = np.round(made.times * RATE) / RATE
    worse = float(residual_vibration(rounded, made.amplitudes, 533.0, 0.01))
    assert kind == "ei" or worse == pytest.approx({"zv": 0.063, "zvd": 0.081}[kind], abs=1e-3)
    with pytest.raises(ModelError, match="faster than twice that"):
        made.taps(1000.0)


@pytest.mark.parametrize(
    ("limits", "duration", "peaks"),
    [
        ({"speed": 5e-3, "acceleration": 50.0, "jerk": 1e6}, 2.150e-3, (5e-3, 50.0)),
        ({"speed": 1.0, "acceleration": 1e4, "jerk": 1e5}, 1.4736e-3, (1.357e-2, 36.84)),
        ({"speed": 1.0, "acceleration": 20.0, "jerk": 1e6}, 1.43435e-3, (1.39435e-2, 20.0)),
        ({"speed": 2e-3, "acceleration": 1e4, "jerk": 1e6}, 5.08944e-3, (2e-3, 44.72)),
    ],
)
def test_a_jerk_limited_move_takes_its_closed_duration_and_keeps_its_limits(
    limits, duration, peaks
) -> None:
    rate = 2e7
    x = jerk_limited(1e-5, sample_rate_hz=rate, **limits)
    assert (x.size - 1) / rate == pytest.approx(duration, rel=1e-4)
    assert (x[0], x[-1]) == (0.0, 1e-5)
    speed, bend = np.diff(x) * rate, np.diff(x, 2) * rate**2
    assert speed.max() == pytest.approx(peaks[0], rel=1e-3)
    assert np.abs(bend).max() == pytest.approx(peaks[1], rel=2e-3)
    assert speed.min() > -1e-12 * speed.max()
    # the jerk over 100 samples
    thin = x[::100]
    jerk = np.abs(np.diff(thin, 3)) * (rate / 100) ** 3
    assert jerk.max() == pytest.approx(limits["jerk"], rel=1e-3)


def continuous(own: LoopPlant, gain: float = 1.0):
    """Amplifier and mode of a plant as matrices, without the delay."""
    w, zeta = own.modes.omega[0], own.modes.damping_ratio[0]
    tau = own.time_constant
    A = np.array([[-1.0 / tau, 0.0, 0.0], [0.0, 0.0, 1.0], [w * w, -w * w, -2.0 * zeta * w]])
    B = np.array([[1.0 / tau], [0.0], [0.0]])
    return A, B, np.array([[0.0, gain * own.gain, 0.0]]), np.zeros((1, 1))


def simulated(own: LoopPlant, voltage, samples: int, delay_samples: int):
    """Positions after held voltages, by SciPy's discretisation of the matrices."""
    system = cont2discrete(continuous(own), 1.0 / own.sample_rate_hz, method="zoh")
    u = np.concatenate((np.zeros(delay_samples), voltage, np.full(samples, voltage[-1])))[:samples]
    return dlsim(system, u)[1][:, 0]


def moved(own: LoopPlant, settings: ServoSettings | None = None) -> MovePlant:
    return MovePlant(own, settings, reading_delay=1.0 / RATE, seconds=0.8)


@pytest.mark.parametrize("kind", KINDS)
def test_the_predicted_motion_is_that_of_the_discretised_matrices(kind) -> None:
    own = plant()
    voltage = shaped(np.linspace(0.0, 20.0, 9)[1:], [shaper(kind, F, 0.01)], RATE)
    motion = moved(own).motion(voltage)
    # of the two samples of the loop one is the age of the reading
    exact = simulated(own, voltage, 8000, 1)
    np.testing.assert_allclose(motion.position[::4][:8000], exact, atol=1e-9 * 1e-5)
    assert motion.end == pytest.approx(1e-5, rel=1e-12)


NOTCH = Notch(frequency_hz=F, zero_damping=0.02, pole_damping=0.5)


@pytest.mark.parametrize(
    "settings",
    [
        ServoSettings(integral=4e7),
        ServoSettings(integral=3e8, proportional=2e4, notches=(NOTCH,), lowpass_hz=900.0),
    ],
    ids=("integral", "notch and low-pass"),
)
def test_the_motion_under_control_is_that_of_the_loop_sample_by_sample(settings) -> None:
    own = plant()
    assert loop_margins(own, settings).stable
    voltage = shaped(np.linspace(0.0, 20.0, 9)[1:], [shaper("zvd", 330.0, 0.01)], RATE)
    target = np.linspace(0.0, 1e-5, 21)[1:]
    drift = 2e-8 * np.log1p(np.arange(8192) / 50.0)
    motion = moved(own, settings).motion(voltage, target, drift)
    A, B, C, _, _ = cont2discrete(continuous(own), 1.0 / RATE, method="zoh")
    filters = [(row, np.zeros(2)) for row in settings.sections(RATE)]
    x, integral, last, applied = np.zeros(3), 0.0, 0.0, [0.0]
    positions = []
    for k in range(4000):
        # as a controller computes it: last reading, filters, integral, one sample to put out
        y = float((C @ x)[0]) + drift[k]
        positions.append(y)
        e = target[min(k, target.size - 1)] - last
        for (b0, b1, b2, a1, a2), state in filters:
            out = b0 * e + state[0]
            state[:] = b1 * e - a1 * out + state[1], b2 * e - a2 * out
            e = out
        integral += settings.integral / RATE * e
        u = voltage[min(k, voltage.size - 1)] + settings.proportional * e + integral
        last = y
        x = A @ x + B[:, 0] * applied[-1]
        applied.append(u)
    np.testing.assert_allclose(motion.position[::4][:4000], positions, atol=2e-7 * 1e-5)


def test_a_step_settles_by_the_envelope_of_its_mode_and_a_shaped_one_at_its_end() -> None:
    band, step = 1e-8, 1e-5
    own = plant(time_constant=0.0)
    # of the last crossing of the band: within half a period of the envelope
    plain = moved(own).motion(np.array([20.0])).settling(band)
    envelope = math.log(step / band) / (0.01 * 2.0 * math.pi * F)
    assert envelope - 0.5 / F < plain - 1e-4 < envelope
    zv = shaper("zv", F, 0.01)
    ended = moved(own).motion(shaped(np.array([20.0]), [zv], RATE)).settling(band)
    assert ended == pytest.approx(zv.times[-1] + 1e-4, abs=1.5e-4)
    # 5 % off, the decay begins at what Singer and Seering say is left
    off = StageModes(frequency_hz=[1.05 * F], damping_ratio=[0.01])
    other = plant(time_constant=0.0, modes=off)
    late = moved(other).motion(shaped(np.array([20.0]), [zv], RATE)).settling(band)
    left = float(zv.residual(1.05 * F)) * step
    expected = zv.times[-1] + math.log(left / band) / (0.01 * off.omega[0])
    assert late == pytest.approx(expected, abs=0.6 / F)


def test_a_minimum_time_command_keeps_its_limits_and_leaves_every_mode_at_rest() -> None:
    own = plant()
    limits = VoltageLimits(low=-5.0, high=30.0, slew=40e3)
    plain = minimum_time(own, 1e-5, limits, band=1e-8)
    robust = minimum_time(own, 1e-5, limits, band=1e-8, robust=True)
    for u in (plain, robust):
        assert u[-1] == pytest.approx(20.0, rel=1e-9)
        assert -5.0 - 1e-9 < u.min() <= u.max() < 30.0 + 1e-9
        # the amplifier, by its own equation: its rate is its lead over its time constant
        behind, rates = 0.0, []
        for v in u:
            rates.append(abs(v - behind) / own.time_constant)
            behind += (v - behind) * -math.expm1(-1.0 / (RATE * own.time_constant))
        assert max(rates) <= 40e3 * (1.0 + 1e-6)
        rest = simulated(own, u, u.size + 400, 0)[u.size :]
        assert np.max(np.abs(rest - 1e-5)) < 1e-9
    # shorter than half a period, which the ZV shaper takes; robust takes longer
    assert plain.size / RATE < 0.5 / F + 8 / RATE < robust.size / RATE + 8 / RATE
    ramp = fastest_ramp(own, 1e-5, limits)
    assert plain.size < shaped(ramp, [shaper("zv", F, 0.01)], RATE).size
    # one sample less cannot be
    assert _programme(own, 1e-5, limits, 1e-8, plain.size - 1, robust=False) is None
    detuned = plant(modes=StageModes(frequency_hz=[1.02 * F], damping_ratio=[0.01]))
    times = [moved(detuned).motion(u).settling(1e-8) for u in (plain, robust)]
    assert times[1] < 0.6 * times[0]


def test_the_fastest_ramp_takes_the_amplifier_to_its_slew_and_no_further() -> None:
    own, slew = plant(), 30e3
    ramp = fastest_ramp(own, 1e-5, VoltageLimits(slew=slew))
    t = np.arange(ramp.size * 1000) / (1000.0 * RATE)
    # a first-order output, integrated over fine steps of the held voltage
    behind, rate = 0.0, np.empty(t.size)
    for k, v in enumerate(np.repeat(ramp, 1000).tolist()):
        rate[k] = (v - behind) / own.time_constant
        behind += rate[k] / (1000.0 * RATE)
    assert ramp[-1] == pytest.approx(20.0, rel=1e-12)
    assert 0.9 * slew < rate.max() < slew
    # without an amplifier, the rise of a sample
    plain = fastest_ramp(plant(time_constant=0.0), 1e-5, VoltageLimits(slew=slew))
    assert plain.size == math.ceil(20.0 / 3.0)


def test_settling_is_the_last_crossing_of_the_band_between_samples() -> None:
    time = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    positions = np.array([0.0, 1.05, 0.7, 0.95, 1.01])
    response = MoveResponse(time=time, position=positions, end=1.0)
    # 0.3 to 0.05 from the end: 0.1 at four fifths
    assert response.settling(0.1) == pytest.approx(2.8)
    assert response.settling(2.0) == 0.0
    assert response.settling(0.005) == math.inf


def test_an_undamped_mode_moves_in_the_bang_bang_time_of_its_closed_form() -> None:
    # voltages between 0 and twice the end, on two circles of the phase plane: about 2 end from
    # -end, then about 0; they meet where the first angle has the cosine 7/8, the second 1/4
    own = plant(damping=0.0, time_constant=0.0, sample_rate_hz=F * 600.0, delay=0.0)
    u = minimum_time(own, 1e-5, VoltageLimits(low=0.0, high=40.0), band=1e-9)
    turns = np.array([math.acos(0.875), math.acos(0.25)]) / (2.0 * math.pi)
    assert (u.size - 1) / 600.0 == pytest.approx(turns.sum(), abs=1.0 / 600.0)
    assert (u.max(), u.min()) == (pytest.approx(40.0), pytest.approx(0.0, abs=1e-6))


def test_an_acceleration_limit_is_kept_and_takes_time() -> None:
    own = plant()
    free = minimum_time(own, 1e-5, VoltageLimits(high=60.0), band=1e-8)
    limits = VoltageLimits(high=60.0, acceleration=12.0)
    held = minimum_time(own, 1e-5, limits, band=1e-8)
    assert held.size > free.size
    fine = replace(own, sample_rate_hz=16 * RATE)
    x = simulated(fine, np.repeat(held, 16), 16 * held.size + 800, 0)
    bend = np.abs(np.diff(x, 2)) * fine.sample_rate_hz**2
    assert 11.5 < bend.max() < 12.0 * 1.05
    with pytest.raises(LimitError, match="from its start"):
        minimum_time(own, 1e-5, VoltageLimits(high=10.0), band=1e-8)


def test_the_scattered_plants_fill_their_tolerance() -> None:
    own = plant()
    tolerance = ModeTolerance(frequency=0.04, damping=0.5, inverse=0.02)
    plants = list(scattered_plants(own, tolerance))
    columns = np.array([
        (p.modes.frequency_hz[0] / F, p.modes.damping_ratio[0] / 0.01, p.gain, factor * p.gain)
        for p, factor in plants
    ])  # fmt: skip
    ends = np.array([(0.96, 1.04), (0.5, 1.5), own.gain_range, (0.98 * own.gain, 1.02 * own.gain)])
    share = (columns - ends[:, 0]) / np.ptp(ends, axis=1)
    # one value in every 37th part of each tolerance, and no two of them go together
    parts = (np.arange(37) + 0.5) / 37.0
    np.testing.assert_allclose(np.sort(share, axis=0), np.tile(parts[:, None], 4), atol=1e-9)
    assert np.max(np.abs(np.corrcoef(share.T) - np.eye(4))) < 0.2


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: shaper("zvdd", F, 0.0), "'zvdd'"),
        (lambda: shaper("zv", F, 0.9), "0 to 0.3"),
        (lambda: shaper("zv", -F, 0.0), "positive frequency"),
        (lambda: jerk_limited(1e-5, jerk=math.inf, sample_rate_hz=1e4), "finite"),
        (lambda: jerk_limited(0.0, jerk=1.0, sample_rate_hz=1e4), "must be positive"),
    ],
)
def test_impossible_moves_are_refused_in_words(make, words) -> None:
    with pytest.raises(ModelError, match=words):
        make()


def test_a_small_acceleration_has_a_command_and_an_end() -> None:
    """Rows of accelerations are of 1e9, those of voltages of 1: both are met in one scale."""
    own = plant(modes=StageModes(frequency_hz=[915.0], damping_ratio=[0.01]))
    limits = VoltageLimits(low=-20.0, high=120.0, slew=40e3, acceleration=1.0)
    u = minimum_time(own, 1e-5, limits, band=1e-8)
    # bang-bang under the acceleration alone takes 2 sqrt(d/a), 63 samples
    assert 63 <= u.size <= 200
    assert u[-1] == pytest.approx(20.0, rel=1e-6)
