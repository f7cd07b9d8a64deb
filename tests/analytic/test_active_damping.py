"""Inner loops that damp a mode: closed forms, exact poles, Lyapunov's equation, refusals.

Evidence (Instruments, twin, control): damping by force and by position feedback: closed forms by
the poles of the assembled loop and by the package `control`, $10^{-6}$; rms in a loop by Lyapunov's
equation, 0.1 %; loop shaping by H-infinity: largest error of the coprime factors in closed form,
$10^{-4}$
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal
from scipy.linalg import solve_continuous_lyapunov

from flexstage.base.errors import ModelError
from flexstage.control.design import force_feedback, position_filter, robust_filters
from flexstage.control.loop_plant import LoopPlant, margins_of
from flexstage.control.measured_response import ResponseDesign, coprime_margin, tune_response
from flexstage.control.response_set import Member
from flexstage.control.tuning import tune_stage
from flexstage.lumped import lumped_system
from flexstage.measure.requests import TuneRequest
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.stage import PiezoStack
from flexstage.stage.designs import design
from flexstage.system.environment import Environment, PositionLoop, read_loop
from flexstage.system.servo import ForceFeedback, PositionFeedback, ServoSettings
from tests.analytic.test_dynamic_budget import (
    MASS,
    OMEGA,
    PIEZO,
    ZETA,
    budget_of,
    environment,
    one_mass,
    white,
)

MODE, STATIC = 910.0, 5e-7


def damping_of(poles: np.ndarray) -> np.ndarray:
    """Return the damping ratios of the poles, lowest first."""
    return np.sort(-np.real(poles) / np.abs(poles))


@pytest.mark.parametrize("share", [0.45, 0.7, 0.9])
def test_force_feedback_has_the_largest_damping_of_a_single_mode(share: float) -> None:
    w, z, static = 2.0 * math.pi * MODE, 2.0 * math.pi * share * MODE, 4.3
    found, ratio = force_feedback(MODE, share * MODE, static)
    assert ratio == pytest.approx((1.0 - share) / (2.0 * share))

    def poles(gain: float) -> np.ndarray:
        # x'' = -w^2 x + w^2 u, u' = -gain f with f = f0 (w/z)^2 (u - (1 - z^2/w^2) x)
        stiff = gain * static * (w / z) ** 2
        return np.linalg.eigvals(np.array(
            [[0.0, 1.0, 0.0], [-w * w, 0.0, w * w], [stiff * (1.0 - (z / w) ** 2), 0.0, -stiff]]
        ))  # fmt: skip

    at = damping_of(poles(found.gain))[0]
    assert at == pytest.approx(ratio, abs=1e-6)
    assert all(damping_of(poles(k * found.gain))[0] < at for k in (0.9, 0.99, 1.01, 1.1))
    control = pytest.importorskip("control", reason="python-control is an optional dependency")
    force = control.tf([static * (w / z) ** 2, 0.0, static * w * w], [1.0, 0.0, w * w])
    by_other = control.feedback(force * control.tf([found.gain], [1.0, 0.0]), 1).poles()
    assert damping_of(by_other)[0] == pytest.approx(ratio, abs=1e-6)


@pytest.mark.parametrize("static", [0.1, 0.36])
def test_position_feedback_makes_a_double_pair_and_has_its_limit(static: float) -> None:
    w = 2.0 * math.pi * MODE
    found = position_filter(MODE, static, STATIC)
    wf, zf = 2.0 * math.pi * found.frequency_hz, found.damping_ratio

    def poles(loop: float) -> np.ndarray:
        return np.linalg.eigvals(np.array([
            [0.0, 1.0, 0.0, 0.0], [-w * w, 0.0, w * w, 0.0],
            [0.0, 0.0, 0.0, 1.0], [loop * wf * wf, 0.0, -wf * wf, -2.0 * zf * wf],
        ]))  # fmt: skip

    wanted = 0.5 * math.sqrt(static / (1.0 - static))
    # a double pole is as exact as the root of the rounding
    assert damping_of(poles(found.gain * STATIC)) == pytest.approx(np.full(4, wanted), abs=1e-6)
    assert np.real(poles(0.999)).max() < 0.0
    assert np.real(poles(1.001)).max() > 0.0
    control = pytest.importorskip("control", reason="python-control is an optional dependency")
    plant = control.tf([STATIC * w * w], [1.0, 0.0, w * w])
    inner = control.tf([found.gain * wf * wf], [1.0, 2.0 * zf * wf, wf * wf])
    by_other = control.feedback(plant, inner, sign=1).poles()
    assert damping_of(by_other) == pytest.approx(np.full(4, wanted), abs=1e-6)


def test_a_delay_is_made_up_for_at_the_mode() -> None:
    late, w = 1.5e-4, 2.0 * math.pi * MODE

    def response(one: PositionFeedback) -> complex:
        wf = 2.0 * math.pi * one.frequency_hz
        return one.gain * wf**2 / complex(wf**2 - w**2, 2.0 * one.damping_ratio * wf * w)

    ideal, made = position_filter(MODE, 0.3, STATIC), position_filter(MODE, 0.3, STATIC, late)
    turned = response(made) * np.exp(-1j * w * late)
    assert abs(turned / response(ideal) - 1.0) < 1e-9


def rms_by_lyapunov(loop: PositionLoop, spring: float) -> tuple[float, float]:
    """Return the rms of the mass by white force and by white voltage, the loop continuous."""
    described = PIEZO.drive("x")
    assert isinstance(described, PiezoStack)
    assert described.voltage_range is not None
    volt = spring * 38e-6 / (described.voltage_range[1] - described.voltage_range[0])
    i, p, inner = loop.settings.integral, loop.settings.proportional, loop.damping
    # x, v, integral of the error, then voltage, or filter and its speed
    if isinstance(inner, ForceFeedback):
        g = inner.gain
        a = np.zeros((4, 4))
        a[3] = [g * (spring - p), 0.0, g, -g * volt]
        voltage = np.array([0.0, 0.0, 0.0, 1.0])
    else:
        assert isinstance(inner, PositionFeedback)
        wf = 2.0 * math.pi * inner.frequency_hz
        a = np.zeros((5, 5))
        a[3, 4] = 1.0
        a[4] = [inner.gain * wf**2, 0.0, 0.0, -(wf**2), -2.0 * inner.damping_ratio * wf]
        voltage = np.array([-p, 0.0, 1.0, 1.0, 0.0])
    a[0, 1] = 1.0
    a[1, :2] = -(OMEGA**2), -2.0 * ZETA * OMEGA
    a[1] += volt / MASS * voltage
    a[2, 0] = -i
    rms = []
    for by_voltage in (False, True):
        b = np.zeros(len(a))
        b[1] = (volt if by_voltage else 1.0) / MASS
        if by_voltage and isinstance(inner, ForceFeedback):
            b[3] = -inner.gain * volt
        level = 1e-4 if by_voltage else 2e-3
        covariance = solve_continuous_lyapunov(a, -np.outer(b, b) * 0.5 * level**2)
        rms.append(math.sqrt(covariance[0, 0]))
    return rms[0], rms[1]


SPRING = 0.6 * MASS * OMEGA**2


@pytest.mark.parametrize(
    ("integral", "proportional", "inner"),
    [
        (3e7, 2e4, ForceFeedback(gain=300.0)),
        (2e7, 1e4, PositionFeedback(gain=9e5, frequency_hz=330.0, damping_ratio=0.5)),
    ],
)
def test_the_rms_in_a_damped_loop_is_that_of_lyapunov(integral, proportional, inner) -> None:
    settings = ServoSettings(integral=integral, proportional=proportional)
    loop = PositionLoop(name="damped", settings=settings, sample_rate=2e6, delay=0.0, damping=inner)
    made = environment(
        f"kind: force, body: PY, along: x, {white('2 mN/rtHz')}",
        f"kind: voltage, drive: x, {white('0.1 mV/rtHz')}",
    )
    system = one_mass(spring=SPRING)
    by_force, by_voltage = rms_by_lyapunov(loop, SPRING)
    result = budget_of(system, made, loop)
    budget = result.budget()
    assert [budget.rms(s) for s in budget.sources] == pytest.approx(
        [by_force, by_voltage], rel=1e-3
    )
    # the loop does something
    open_stage = result.budget("open")
    assert budget.total < 0.9 * open_stage.total


def test_the_crossover_is_that_of_the_reading_and_not_of_the_force() -> None:
    # far below the mode a fast force loop leaves C P/F of the position loop, crossover I P/F
    integral, position, force, fast = 2e6, 5e-7, 0.3, 1e4
    s = 2.0j * math.pi * (f := np.geomspace(0.01, 1e3, 2001))
    inner = fast / s * force
    margins = margins_of(f, fast / s * integral / s * position + inner, math.pi, inner)
    crossover = integral * position / force / (2.0 * math.pi)
    assert margins.crossover_hz == pytest.approx(crossover, rel=1e-4)
    # an error of the voltage is divided by 1 + L, one of the reading by that over 1 + inner
    for inner, peak in ((1.0, 2.0 / 1.2), (-0.5, 1.0 / 1.2)):
        level = np.full(f.size, 0.2 + 0j)
        margins = margins_of(f, level, inner=np.full(f.size, inner + 0j))
        assert margins.sensitivity_peak == pytest.approx(peak, rel=1e-12)


def tuned(kind: str) -> ResponseDesign:
    request = replace(TuneRequest(goal="noise"), control=kind)
    made = tune_stage(PIEZO, one_mass(spring=SPRING), request)
    assert isinstance(made, ResponseDesign)
    return made


def largest_pole(made: ResponseDesign, gain: float, shift: float) -> float:
    """Return the largest pole of the exact sampled loop around one mass, one sample late."""
    loop, rate = made.loop, made.loop.sample_rate
    described = PIEZO.drive("x")
    assert isinstance(described, PiezoStack)
    assert described.voltage_range is not None
    volt = SPRING * 38e-6 / (described.voltage_range[1] - described.voltage_range[0])
    w = OMEGA * shift
    a, b, c, d, _ = signal.cont2discrete(
        (
            np.array([[0.0, 1.0], [-w * w, -2.0 * ZETA * w]]),
            np.array([[0.0], [gain * volt * shift**2 / MASS]]),
            np.array([[1.0, 0.0], [-SPRING, 0.0]]),
            np.array([[0.0], [gain * volt]]),
        ),
        1.0 / rate,
    )
    numerator, denominator = signal.ss2tf(a, b, np.vstack((c, [[0.0, 0.0]]))[:2], d)
    position, force = numerator
    i, p = loop.settings.integral / rate, loop.settings.proportional
    over, under = np.array([p + i, -p]), np.array([1.0, -1.0])
    inner = loop.damping
    if isinstance(inner, ForceFeedback):
        g = inner.gain / rate
        total = np.polyadd(np.convolve(over, position), np.convolve(under, force)) * g
        under = np.convolve(under, [1.0, -1.0])
        # the integral acts on the newest sample: one power of z more
        closed = np.polyadd(
            np.convolve(np.convolve(under, denominator), [1.0, 0.0, 0.0])[:-1],
            np.convolve(total, [1.0, 0.0]),
        )
    elif inner is None:
        for one in loop.settings.filters:
            over = np.convolve(over, [one.b0, one.b1, one.b2])
            under = np.convolve(under, [1.0, one.a1, one.a2])
        closed = np.polyadd(
            np.convolve(np.convolve(under, denominator), [1.0, 0.0]), np.convolve(over, position)
        )
    else:
        assert isinstance(inner, PositionFeedback)
        t = math.tan(math.pi * inner.frequency_hz / rate)
        a0 = 1.0 + 2.0 * inner.damping_ratio * t + t * t
        top = inner.gain * t * t * np.array([1.0, 2.0, 1.0])
        bottom = np.array([a0, 2.0 * (t * t - 1.0), 1.0 - 2.0 * inner.damping_ratio * t + t * t])
        feedback = np.polysub(np.convolve(over, bottom), np.convolve(under, top))
        under = np.convolve(np.convolve(under, bottom), denominator)
        closed = np.polyadd(np.convolve(under, [1.0, 0.0]), np.convolve(feedback, position))
    return float(np.abs(np.roots(closed)).max())


@pytest.mark.parametrize("kind", ["ppf", "iff", "h-infinity"])
def test_a_tuned_inner_loop_is_stable_and_damps_for_the_whole_set(kind: str) -> None:
    made = tuned(kind)
    assert made.worst.stable
    assert made.worst.sensitivity_peak <= 2.0
    assert made.worst.gain_margin >= 2.0
    for gain in (0.9, 1.0, 1.1):
        for shift in (0.97, 1.0, 1.03):
            assert largest_pole(made, gain, shift) < 1.0
    # lines 2 % apart
    assert largest_pole(made, 0.99 * made.nominal.gain_margin, 1.0) < 1.0
    assert largest_pole(made, 1.01 * made.nominal.gain_margin, 1.0) > 1.0


def laboratory() -> Environment:
    """Return the environment of the manual."""
    return environment(
        "kind: ground, along: x, spectrum: {kind: vc, curve: C, slope_above: -5}",
        "kind: sensor, spectrum: {kind: white, level: 0.02 nm/rtHz, sided: one, corner: 5 Hz}",
        "kind: voltage, drive: x, spectrum: {kind: lowpass, rms: 1 mV, bandwidth: 1 kHz}",
        "kind: voltage, drive: x, spectrum: {kind: quantiser, step: 2.29 mV, rate: 10 kHz}",
        band="[0.1 Hz, 5 kHz]",
    )


def test_active_damping_quietens_the_piezo_stage_and_passes_through_a_file(tmp_path: Path) -> None:
    system = lumped_system(PIEZO)
    made = laboratory()
    path = tmp_path / "loop.yaml"
    found = tune_stage(PIEZO, system, TuneRequest(control="ppf", goal="noise"))
    robust = tune_stage(PIEZO, system, TuneRequest(control="h-infinity", goal="noise"))
    assert isinstance(found, ResponseDesign)
    assert isinstance(robust, ResponseDesign)
    path.write_text(found.loop_file())
    loop = read_loop(path)
    assert loop.damping == found.loop.damping
    assert loop.latency == pytest.approx(1e-4)
    path.write_text(robust.loop_file())
    result = budget_of(system, made, "tune", loop, read_loop(path))
    totals = [result.budget(name).total for name in ("open", "tune", "ppf", "h-infinity")]
    # as printed in the manual
    assert [1e9 * total for total in totals] == pytest.approx([4.63, 2.57, 1.92, 1.71], abs=0.01)
    assert robust.data()["pi_parameters"] is None
    assert robust.data()["pid"] is None
    assert found.data()["damping"]["kind"] == "ppf"
    assert found.data()["pi_parameters"] is None
    assert found.data()["pid"] is None


@pytest.mark.slow
def test_a_force_feedback_is_quiet_if_its_bandwidth_counts() -> None:
    system = lumped_system(PIEZO)
    # as printed in the manual
    for goal, wanted in (("noise", 3.39), ("bandwidth", 2.24)):
        tuning = tune_stage(PIEZO, system, replace(TuneRequest(control="iff"), goal=goal))
        assert isinstance(tuning, ResponseDesign)
        rms = budget_of(system, laboratory(), tuning.loop).budget("iff").total
        assert 1e9 * rms == pytest.approx(wanted, abs=0.01)
        assert any("without noise of the force" in note for note in tuning.notes)


@pytest.mark.parametrize(("crossover", "late"), [(20.0, 0), (20.0, 1), (800.0, 0), (800.0, 1)])
def test_filters_by_h_infinity_allow_what_the_closed_form_says(crossover: float, late: int) -> None:
    """Of an integral, sampled with or without one sample of delay, by its Hankel norm."""
    rate, gain = 1e4, 5e-7
    plant = LoopPlant(gain=gain, gain_range=(gain, gain), delay=late / rate, sample_rate_hz=rate)
    settings = ServoSettings(integral=2.0 * math.pi * crossover / gain)
    filters = robust_filters(plant, settings, 1e-4)
    f = np.linspace(1.0, 0.5 * rate, 4001)
    shaped = PositionLoop(
        name="shaped", settings=replace(settings, filters=filters), sample_rate=rate, delay=0.0
    )
    k = math.pi * crossover / rate
    p = k / math.hypot(1.0, k)
    largest = math.sqrt(0.5 * (1.0 - p if late else 1.0 + p))
    allowed = coprime_margin(shaped, Member(name="", frequency_hz=f, response=plant.response(f)))
    assert allowed == pytest.approx(largest, rel=1e-4)


def test_what_cannot_be_damped_is_refused_in_a_sentence() -> None:
    f = np.geomspace(1.0, 5000.0, 400)
    slow = np.array(STATIC / (1.0 + 1j * f / 300.0), dtype=np.complex128)
    plain = MeasuredResponse(
        frequency_hz=f, response=slow[:, None, None],
        inputs=("u",), outputs=("x",), input_units=("V",), output_units=("m",),
    )  # fmt: skip
    request = TuneRequest(frf=("x.csv",), servo_rate=10e3)
    with pytest.raises(ModelError, match="needs a resonance below half the rate"):
        tune_response([plain], replace(request, control="ppf"))
    with pytest.raises(ModelError, match="iff needs two responses"):
        tune_response([plain], replace(request, control="iff"))
    soft = one_mass(spring=1e-3 * MASS * OMEGA**2)
    with pytest.raises(ModelError, match="the force has no zero below the mode"):
        tune_stage(PIEZO, soft, TuneRequest(control="iff"))
    with pytest.raises(ModelError, match=r"must be below the mode .*collocated"):
        force_feedback(800.0, 900.0, 1.0)
    with pytest.raises(ModelError, match="leaves a position feedback no phase"):
        position_filter(MODE, 0.2, STATIC, 4e-4)
    with pytest.raises(ModelError, match="between 0 and 1"):
        position_filter(MODE, 1.0, STATIC)
    with pytest.raises(ModelError, match="omit one of both"):
        tune_stage(design("vgtu-piezo"), soft, request)
