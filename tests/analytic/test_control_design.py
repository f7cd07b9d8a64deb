r"""Plants, margins and tuning: closed forms, SciPy, the control package, and loops in time.

Evidence (Instruments, twin, control): sampled drive (matrix exponentials): $10^{-6}$; margins
(closed form): $5\cdot10^{-5}$, (package `control`): 0.2 %
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from flexstage.base.errors import ModelError
from flexstage.control import Requirements, loop_margins, tune
from flexstage.control.design import _left_of_steps, tune_plant
from flexstage.control.loop_plant import LoopPlant, local_gains, loop_plant
from flexstage.hysteresis import (
    DriveModel,
    Lag,
    PrandtlIshlinskii,
    StageModes,
    ValidityRange,
)
from flexstage.system.servo import Notch, ServoSettings

RATE = 9.7e3
GAIN = 5.3e-7
MODES = StageModes(frequency_hz=[813.0, 1870.0], damping_ratio=[0.0091, 0.013], share=[0.93, 0.04])


def plant(**changes) -> LoopPlant:
    values = {"gain": GAIN, "gain_range": (0.8 * GAIN, 1.15 * GAIN), "sample_rate_hz": RATE,
              "delay": 2.0 / RATE}  # fmt: skip
    return LoopPlant(**(values | changes))


def coefficients(section):
    return section[:3], np.concatenate(([1.0], section[3:]))


@pytest.mark.parametrize("delay", [1.0, 2.0, 3.0])
def test_an_integrator_with_delay_has_the_margins_of_its_closed_form(delay) -> None:
    # L = k g T z^-d / (1 - z^-1) has the phase -90 deg - (d - 1/2) omega T
    # and the size k g T / (2 sin(omega T / 2))
    share = 0.13
    settings = ServoSettings(integral=share * RATE / GAIN)
    made = loop_margins(plant(delay=delay / RATE), settings)
    across = math.pi / (2.0 * delay - 1.0)
    # straight lines between frequencies 0.7 % apart: a quarter of 0.007^2 of curvature
    assert made.gain_margin == pytest.approx(2.0 * math.sin(0.5 * across) / share, rel=5e-5)
    unity = 2.0 * math.asin(0.5 * share)
    assert made.crossover_hz == pytest.approx(unity * RATE / (2.0 * math.pi), rel=5e-5)
    expected = 0.5 * math.pi - (delay - 0.5) * unity
    assert made.phase_margin == pytest.approx(expected, abs=1e-4)
    assert made.stable


@pytest.mark.parametrize("delay", [0.0, 1.0, 1.37, 2.86])
@pytest.mark.parametrize("time_constant", [0.0, 7.9e-5])
def test_the_plant_is_the_sampled_continuous_one(delay, time_constant) -> None:
    own = plant(modes=MODES, delay=delay / RATE, time_constant=time_constant)
    # the step response by SciPy on a fine grid, read at the samples
    parts = [
        signal.TransferFunction([c * w * w], [1.0, 2.0 * z * w, w * w])
        for c, w, z in zip(MODES.share, MODES.omega, MODES.damping_ratio, strict=True)
    ]
    num, den = np.array([MODES.static_share]), np.array([1.0])
    for part in parts:
        num = np.polyadd(np.polymul(num, part.den), np.polymul(part.num, den))
        den = np.polymul(den, part.den)
    if time_constant:
        den = np.polymul(den, [time_constant, 1.0])
    n = 6000
    whole = math.ceil(delay - 1e-12)
    system = signal.StateSpace(signal.TransferFunction(num, den))
    # from the instant inside a sample at which the step comes
    first = (whole - delay) / RATE
    a, b = np.asarray(system.A), np.asarray(system.B)
    from scipy.linalg import expm

    def over(h):
        m = np.zeros((a.shape[0] + 1,) * 2)
        m[:-1, :-1], m[:-1, -1:] = a * h, b * h
        e = expm(m)
        return e[:-1, :-1], e[:-1, -1]

    ad, bd = over(1.0 / RATE)
    af, bf = over(first)
    x = af @ np.zeros(a.shape[0]) + bf
    y = []
    for _ in range(n):
        y.append(float(np.squeeze(system.C @ x + system.D.ravel())))
        x = ad @ x + bd
    impulse = np.diff(np.concatenate((np.zeros(whole), y)), prepend=0.0)
    f = np.array([3.0, 90.0, 700.0, 806.0, 1900.0, 4700.0])
    z1 = np.exp(-2j * np.pi * f / RATE)
    expected = GAIN * np.array([np.sum(impulse * z ** np.arange(impulse.size)) for z in z1])
    # polynomials of fifth degree with coefficients of 1e20 lose eight digits on the way to states
    np.testing.assert_allclose(own.response(f), expected, rtol=1e-6)


def test_margins_are_those_of_the_control_package() -> None:
    control = pytest.importorskip("control")
    settings = ServoSettings(
        proportional=6.1e4, integral=1.31e9, lowpass_hz=1500.0,
        notches=(Notch(frequency_hz=813.0, zero_damping=0.0091, pole_damping=0.8),),
    )  # fmt: skip
    one = StageModes(frequency_hz=[813.0], damping_ratio=[0.0091])
    own = plant(modes=one, gain=GAIN)
    w, z = one.omega[0], 0.0091
    continuous = signal.StateSpace(
        signal.TransferFunction([GAIN * w * w], [1.0, 2.0 * z * w, w * w])
    )
    sampled = continuous.to_discrete(1.0 / RATE, method="zoh")
    num, den = signal.ss2tf(sampled.A, sampled.B, sampled.C, sampled.D)
    dt = 1.0 / RATE
    loop = control.tf(num[0], den, dt) * control.tf([1.0], [1.0, 0.0, 0.0], dt)
    loop *= control.tf(
        [settings.proportional + settings.integral * dt, -settings.proportional], [1.0, -1.0], dt
    )
    for section in settings.sections(RATE):
        loop *= control.tf(*coefficients(section), dt)
    gm, pm, sm, _, wcp, _ = control.stability_margins(loop, returnall=True, method="frd")
    made = loop_margins(own, settings)
    # every crossing counts; read off a grid of some thousand frequencies
    assert made.gain_margin == pytest.approx(min(g for g in gm if g > 1.0), rel=2e-3)
    assert made.phase_margin == pytest.approx(np.deg2rad(min(np.abs(pm))), rel=2e-3)
    assert made.sensitivity_peak == pytest.approx(1.0 / min(sm), rel=2e-3)
    assert made.crossover_hz == pytest.approx(min(wcp) / (2.0 * np.pi), rel=2e-3)
    poles = control.feedback(loop, 1).poles()
    assert made.stable == bool(np.max(np.abs(poles)) < 1.0)


def test_what_a_loop_leaves_of_steps_is_that_of_its_closed_form() -> None:
    """P = g/(1 + T s) under k/s leaves 1/(T s^2 + s + k g) of a step: its square is 1/(2 k g)."""
    corner, lag = 2.0 * math.pi * 7.3, 0.31 / (2.0 * math.pi * 7.3)
    own = plant(time_constant=lag, delay=0.0)
    left = _left_of_steps(own, ServoSettings(integral=corner / GAIN))
    # a voltage that stands still for a sample is half a sample late: 0.2 % of the corner
    assert left == pytest.approx(0.5 / corner, rel=5e-3)


@pytest.mark.parametrize("share", [0.3, 0.97, 1.03, 2.2])
@pytest.mark.parametrize("kind", ["integral", "pi", "damping"])
def test_stability_is_that_of_the_closed_loop_poles(share, kind) -> None:
    """The gain margin, raised or not, against the eigenvalues of the loop."""
    one = StageModes(frequency_hz=[813.0], damping_ratio=[0.0091])
    own = plant(modes=one)
    found = tune_plant(own, kind=kind).settings
    edge = loop_margins(own, found).gain_margin * share
    settings = replace(found, integral=edge * found.integral,
                       proportional=edge * found.proportional)  # fmt: skip
    made = loop_margins(own, settings)
    w, z = one.omega[0], 0.0091
    sampled = signal.StateSpace(
        signal.TransferFunction([GAIN * w * w], [1.0, 2.0 * z * w, w * w])
    ).to_discrete(1.0 / RATE, method="zoh")
    num, den = signal.ss2tf(sampled.A, sampled.B, sampled.C, sampled.D)
    num, den = num[0], np.concatenate((den, [0.0, 0.0]))
    num = np.polymul(num, [settings.proportional + settings.integral / RATE,
                           -settings.proportional])  # fmt: skip
    den = np.polymul(den, [1.0, -1.0])
    for section in settings.sections(RATE):
        b, a = coefficients(section)
        num, den = np.polymul(num, b), np.polymul(den, a)
    poles = np.roots(np.polyadd(den, num))
    assert made.stable == bool(np.max(np.abs(poles)) < 1.0) == (share < 1.0)


@pytest.mark.parametrize("kind", ["integral", "pi", "damping", "auto"])
def test_a_tuning_keeps_what_was_asked_for_at_gains_and_frequencies_between(kind) -> None:
    wanted = Requirements(
        gain_margin=2.3, phase_margin=math.radians(47.0), sensitivity_peak=1.9,
        gain_scatter=0.07, frequency_scatter=0.025,
    )  # fmt: skip
    own = plant(modes=MODES)
    made = tune_plant(own, kind=kind, requirements=wanted)
    rng = np.random.default_rng(11)
    for _ in range(60):
        gain = rng.uniform(0.8 * 0.93, 1.15 * 1.07)
        there = own.scattered(gain, rng.uniform(0.975, 1.025))
        found = loop_margins(there, made.settings)
        assert found.stable
        # corners and three frequencies between were looked at: a little less between those
        assert found.gain_margin >= 2.3 * 0.98
        assert found.phase_margin >= math.radians(47.0) - 0.02
        assert found.sensitivity_peak <= 1.9 * 1.02


def test_a_tuning_goes_as_far_as_one_requirement_allows() -> None:
    made = tune_plant(plant(modes=MODES))
    r, w = made.requirements, made.worst
    at_limit = [
        w.sensitivity_peak / r.sensitivity_peak,
        r.gain_margin / w.gain_margin,
        r.phase_margin / w.phase_margin,
    ]
    assert max(at_limit) == pytest.approx(1.0, rel=1e-2)


def test_without_a_notch_the_gain_is_limited_to_twice_the_damping() -> None:
    """k g < 2 zeta omega for an integrator on one mode, without delay."""
    one = StageModes(frequency_hz=[813.0], damping_ratio=[0.0091])
    limit = 2.0 * 0.0091 * one.omega[0] / GAIN
    own = plant(modes=one, delay=0.0, sample_rate_hz=200e3)
    found = loop_margins(own, ServoSettings(integral=limit))
    # sampling at 200 kHz costs half a sample, 0.013 rad of the mode: some percent of the margin
    assert found.gain_margin == pytest.approx(1.0, rel=1e-3) or found.gain_margin > 0.9
    made = tune_plant(plant(modes=one), kind="integral")
    assert made.settings.integral > 5.0 * limit


def test_a_damping_loop_takes_energy_out_of_the_mode() -> None:
    one = StageModes(frequency_hz=[813.0], damping_ratio=[0.0091])
    own = plant(modes=one)
    size = {}
    for kind in ("integral", "damping"):
        made = tune_plant(own, kind=kind)
        loop = made.settings.response([813.0], RATE) * own.response([813.0])
        size[kind] = float(np.abs(1.0 / (1.0 + loop))[0])
    assert size["damping"] < 0.6 < size["integral"]


def test_a_mains_notch_keeps_the_stage_from_following() -> None:
    own = plant(modes=MODES)
    made = tune_plant(own, mains_hz=50.0)
    loop = made.settings.response([50.0], RATE) * own.response([50.0])
    assert abs(loop[0]) < 1e-9
    assert made.worst.stable
    assert "50 Hz" in made.notes[-1]


def drive(**changes) -> DriveModel:
    r = np.array([3.0, 11.0, 29.0])
    values = {
        "hysteresis": PrandtlIshlinskii(gain=3.1e-7, thresholds=r,
                                        weights=np.array([9e-8, 7e-8, 5e-8])),
        "modes": MODES, "lag": Lag(delay=2.4e-4),
        "validity": ValidityRange(input_range=(0.0, 120.0), output_range=(0.0, 6e-5),
                                  rate_range_hz=(1.0, 50.0)),
    }  # fmt: skip
    return DriveModel(**(values | changes))


def test_the_slopes_of_a_loop_are_those_of_its_plays() -> None:
    mean, least, largest = local_gains(drive())
    # after a turn the plays stand still, at the end all of them move
    assert least == pytest.approx(3.1e-7, rel=1e-9)
    assert largest == pytest.approx(5.2e-7, rel=1e-9)
    # each play loses twice its threshold on a way of 120 V
    lost = np.sum(np.array([9e-8, 7e-8, 5e-8]) * 2.0 * np.array([3.0, 11.0, 29.0])) / 120.0
    assert mean == pytest.approx(5.2e-7 - lost, rel=1e-9)


def test_the_delay_of_the_loop_is_that_of_the_drive_and_of_the_reading() -> None:
    made = loop_plant(drive(), 10e3)
    assert made.delay == pytest.approx(2.4e-4 - 0.5e-4 + 1e-4)
    tuned = tune(drive(), sample_rate_hz=10e3)
    assert tuned.plant.delay == made.delay


@pytest.mark.slow
def test_a_mode_that_the_model_does_not_know_is_given_or_told() -> None:
    blind = tune(drive(modes=None), sample_rate_hz=10e3)
    assert "has no mode" in blind.notes[0]
    one = StageModes(frequency_hz=[813.0], damping_ratio=[0.0091])
    given = tune(drive(modes=None), sample_rate_hz=10e3, resonance=(813.0, 0.0091))
    assert given.settings == tune(drive(modes=one), sample_rate_hz=10e3).settings
    assert "has no mode" not in given.notes[0]
    swinging = loop_margins(given.plant, blind.settings)
    assert not swinging.stable


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: plant(gain=-1.0), "positive and within"),
        (lambda: plant(delay=-1e-4), "0 or more"),
        (lambda: Requirements(gain_margin=0.9), "above 1"),
        (lambda: Requirements(sensitivity_peak=1.0), "exceeds 1"),
        (lambda: Requirements(frequency_scatter=0.7), "0 to 0.5"),
        (lambda: tune_plant(plant(), kind="pid"), "'pid'"),
        (lambda: local_gains(drive(validity=None)), "validity"),
        (lambda: loop_plant(drive(sign=-1.0), 1e4), "reverse the sign"),
    ],
)
def test_impossible_loops_are_refused_in_words(make, words) -> None:
    with pytest.raises(ModelError, match=words):
        make()
