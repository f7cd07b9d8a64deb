"""Control from a measured response: poles of the exact loop, the package `control`, refusals.

Evidence (Instruments, twin, control): stage tuned from its model and from its response: gain within
0.1 %; margins for each of six responses of a measured mirror against the package `control`: Ms
$10^{-9}$, gain margin 1 %, phase margin 1°; control in C and as a transfer function, $10^{-9}$
"""

import ctypes
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from flexstage.base.errors import ModelError
from flexstage.cli import main
from flexstage.control import Requirements
from flexstage.control.design import tune_plant
from flexstage.control.loop_plant import LoopPlant
from flexstage.control.measured_response import ResponseDesign, tune_response
from flexstage.export.source.render import servo_source
from flexstage.hysteresis import StageModes
from flexstage.measure.requests import TuneRequest
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.system.environment import PositionLoop, read_loop
from flexstage.system.servo import Filter, Lead, Notch, ServoSettings
from tests.c_compiler import load_library
from tests.shared_data import DATA, needs

RATE, GAIN, MODE, DAMPING = 10e3, 5e-7, 910.0, 0.01
PLANT = LoopPlant(
    gain=GAIN, gain_range=(GAIN, GAIN), delay=2.0 / RATE, sample_rate_hz=RATE,
    modes=StageModes(frequency_hz=[MODE], damping_ratio=[DAMPING]),
)  # fmt: skip
LINES = np.union1d(np.geomspace(1.0, 5000.0, 300), MODE * (1.0 + np.linspace(-0.12, 0.12, 161)))


def measured(f, response, **changes) -> MeasuredResponse:
    values = {"frequency_hz": f, "response": response[:, None, None], "inputs": ("u",),
              "outputs": ("x",), "input_units": ("V",), "output_units": ("m",)}  # fmt: skip
    return MeasuredResponse(**(values | changes))


def request(**changes) -> TuneRequest:
    return TuneRequest(**({"frf": ("x.csv",), "servo_rate": RATE, "delay": 0.0} | changes))


def test_a_stage_has_the_same_control_by_its_model_and_by_its_response() -> None:
    exact = Requirements(gain_scatter=0.0, frequency_scatter=0.0)
    by_model = tune_plant(PLANT, requirements=exact).settings
    response = measured(LINES, PLANT.response(LINES))
    made = tune_response([response], request(control="damping", uncertainty=0.0, shift=0.0))
    found = made.loop.settings
    # the peak lies between two lines that are 0.15 % apart
    assert found.lowpass_hz == pytest.approx(by_model.lowpass_hz, rel=1e-3)
    assert found.integral == pytest.approx(by_model.integral, rel=1e-3)
    assert found.notches == by_model.notches
    assert found.proportional == by_model.proportional
    # its low-pass is no parameter of a controller by Physik Instrumente
    assert made.data()["pi_parameters"] is None


def largest_pole(settings: ServoSettings, gain: float, mode: float) -> float:
    """Return the largest pole of the exact loop, by SciPy."""
    w = 2.0 * math.pi * mode
    b, a, _ = signal.cont2discrete(([gain * w * w], [1.0, 2.0 * DAMPING * w, w * w]), 1.0 / RATE)
    p, i = settings.proportional, settings.integral
    over, under = ([p + i / RATE, -p], [1.0, -1.0]) if i else ([p], [1.0])
    for row in settings.sections(RATE):
        over, under = np.convolve(over, row[:3]), np.convolve(under, [1.0, *row[3:]])
    over, under = np.convolve(over, b.ravel()), np.convolve(under, [*a, 0.0, 0.0])
    return float(np.abs(np.roots(np.polyadd(over, under))).max())


@pytest.mark.parametrize(
    "kind",
    ["integral", "pi", pytest.param("pid", marks=pytest.mark.slow), "lead", "double-integral"],
)
def test_the_exact_loop_is_stable_for_the_whole_set(kind) -> None:
    response = measured(LINES, PLANT.response(LINES))
    # a set of one lets a second integral cross far above the mode, where loops are unstable
    error, offset = (0.0, 0.0) if kind == "double-integral" else (0.1, 0.03)
    made = tune_response([response], request(control=kind, uncertainty=error, shift=offset))
    assert made.worst.stable
    # what the margins promise, less what straight lines between frequencies 2 % apart leave
    assert made.worst.sensitivity_peak < 2.001
    assert made.worst.gain_margin > 1.99
    assert made.worst.phase_margin > math.radians(39.9)
    for gain in (1.0 - error, 1.0, 1.0 + error):
        for shift in (1.0 - offset, 1.0, 1.0 + offset):
            assert largest_pole(made.loop.settings, gain * GAIN, shift * MODE) < 1.0
    # the exact loop becomes unstable at the gain margin of the measurement itself
    margin = made.nominal.gain_margin
    assert largest_pole(made.loop.settings, 0.99 * margin * GAIN, MODE) < 1.0
    assert largest_pole(made.loop.settings, 1.01 * margin * GAIN, MODE) > 1.0
    if kind == "pid":
        agree(made)


@pytest.mark.parametrize(
    ("name", "value"),
    [("gain_margin", 3.0), ("phase_margin", math.radians(60.0)), ("delay_margin", 1e-3)],
)
def test_an_integrator_with_delay_has_the_gain_of_each_requirement(name, value) -> None:
    # L = k g T z^-d / (1 - z^-1) has the phase -90 deg - (d - 1/2) omega T
    # and the size k g T / (2 sin(omega T / 2))
    late = 1.5 / RATE
    omega, share = {
        "gain_margin": (0.5 * math.pi / late, 1.0 / value),
        "phase_margin": ((0.5 * math.pi - value) / late, 1.0),
        "delay_margin": (0.5 * math.pi / (late + value), 1.0),
    }[name]
    loose = {"gain_margin": 1.01, "phase_margin": math.radians(1.0), "modulus": 50.0}
    f = np.geomspace(1.0, 5000.0, 200)
    made = tune_response(
        [measured(f, replace(PLANT, modes=None).response(f))],
        request(control="integral", uncertainty=0.0, shift=0.0, **(loose | {name: value})),
    )
    expected = share * 2.0 * math.sin(0.5 * omega / RATE) * RATE / GAIN
    # lines 2 % apart, and the next one inside
    assert made.loop.settings.integral == pytest.approx(expected, rel=0.03)


def test_a_second_integral_and_a_lead_are_bilinear_transforms() -> None:
    settings = ServoSettings(
        integral=1.0, leads=(Lead(zero_hz=300.0, pole_hz=2000.0),), second_integral_hz=40.0
    )
    f = np.array([3.0, 170.0, 900.0])
    t = np.tan(np.pi * f / RATE)
    z, p, w = np.tan(np.pi * np.array([300.0, 2000.0, 40.0]) / RATE)
    wanted = (1.0 + 1j * t / z) / (1.0 + 1j * t / p) * (1.0 + w / (1j * t))
    wanted = wanted / RATE / (1.0 - np.exp(-2j * np.pi * f / RATE))
    np.testing.assert_allclose(settings.response(f, RATE), wanted, rtol=1e-12)


def agree(made: ResponseDesign) -> None:
    """Compare the margins of each member with those by python-control."""
    control = pytest.importorskip("control", reason="python-control is an optional dependency")
    for member, margins in zip(made.members, made.margins, strict=True):
        w = 2.0 * np.pi * member.frequency_hz
        loop = control.FrequencyResponseData(made.loop_gain(member), w)
        gains, phases, *_ = control.stability_margins(loop, returnall=True)
        least = np.maximum(gains, 1.0 / np.array(gains)).min()
        assert least == pytest.approx(margins.gain_margin, rel=0.01)
        phase = np.abs((np.array(phases) + 180.0) % 360.0 - 180.0).min()
        assert phase == pytest.approx(math.degrees(margins.phase_margin), abs=1.0)
        one = control.FrequencyResponseData(np.ones(w.size), w)
        sensitivity = np.abs(control.feedback(one, loop).frdata).max()
        assert sensitivity == pytest.approx(margins.sensitivity_peak, rel=1e-9)


@pytest.mark.slow
@needs("fine-steering-mirror")
def test_margins_on_a_measured_mirror_are_those_of_another_package() -> None:
    rows = []
    for level in (100, 200, 300):
        with np.load(DATA / "fine-steering-mirror" / f"train_{level}mV.npz") as arrays:
            u, y = (np.fft.rfft(arrays[name], axis=0).mean(axis=-1) for name in "uy")
        f = np.fft.rfftfreq(8192, 1.0 / 6400.0)
        # every third line: 2.3 Hz, a seventh of the width of the mode
        used = (
            (f > 10.0)
            & (np.arange(f.size) % 3 == 0)
            & (np.abs(u[:, 0, 0]) > 1e-2 * np.abs(u[:, 0, 0]).max())
        )
        for block in (slice(0, 3), slice(3, 6)):
            both = np.linalg.solve(
                np.swapaxes(u[used, :, block], 1, 2), np.swapaxes(y[used, :, block], 1, 2)
            )
            # its second sensor reads towards the mirror
            rows.append(measured(f[used], -both[:, 1, 1]))
    made = tune_response(
        rows, request(servo_rate=6400.0, control="pi", phase_step=math.radians(89.0))
    )
    assert len(made.members) == 6
    assert made.worst.sensitivity_peak < 2.001
    agree(made)


def test_repetitions_with_as_many_lines_keep_their_own_frequencies() -> None:
    # two modes on a geometric grid need as many lines between those measured, but elsewhere
    f = np.geomspace(1.0, 4000.0, 437)
    both = [GAIN / (1.0 - (f / mode) ** 2 + 0.1j * f / mode) for mode in (f[390], f[350])]
    made = tune_response(
        [measured(f, h) for h in both], request(control="integral", uncertainty=0.0)
    )
    high, low = made.members
    assert high.frequency_hz.size == low.frequency_hz.size
    assert made.worst.sensitivity_peak < 2.001


def test_every_error_within_the_radius_keeps_the_margins() -> None:
    rng = np.random.default_rng(3)
    h = PLANT.response(LINES)
    made = tune_response([measured(LINES, h)], request(control="pi", uncertainty=0.1, shift=0.0))
    controller = made.loop.settings.response(LINES, RATE)
    for _ in range(50):
        error = 0.1 * np.exp(2j * np.pi * rng.random(LINES.size))
        distance = np.abs(1.0 + controller * h * (1.0 + error))
        # eight directions leave 1 - cos(22.5 deg) = 7.6 % of the radius
        assert np.all(distance > 0.4999 - 0.076 * 0.1 * np.abs(controller * h))


def test_the_uncertainty_by_coherence_has_its_coverage() -> None:
    # H1 over n averages: |error|^2 has the mean |H|^2 (1 - c)/(c n) (Bendat and Piersol)
    n, c = 16, 0.8
    h = PLANT.response(LINES)
    coherence = np.full((LINES.size, 1), c)
    made = tune_response(
        [measured(LINES, h, coherence=coherence, averages=float(n))],
        request(control="integral", shift=0.0, coverage=0.9),
    )
    first = made.members[0].response
    radius = np.abs(made.members[1].response / first - 1.0).max()
    rng = np.random.default_rng(7)
    u, v = rng.normal(size=(2, n, 40_000)), rng.normal(size=(2, n, 40_000))
    u, v = u[0] + 1j * u[1], math.sqrt((1.0 - c) / c) * (v[0] + 1j * v[1])
    error = np.abs((np.conj(u) * v).sum(axis=0) / (np.abs(u) ** 2).sum(axis=0))
    assert np.mean(error < radius) == pytest.approx(0.9, abs=0.02)


COARSE = np.union1d(np.geomspace(1.0, 5000.0, 60), [])


@pytest.mark.parametrize(
    ("f", "scale", "changes", "words"),
    [
        (COARSE, 1.0, {}, "Hz apart"),
        (LINES[LINES > 920.0], 1.0, {}, "reverse the sign"),
        (LINES[LINES > 300.0], 1.0, {"control": "integral"}, "begins at 30"),
        (LINES[LINES < 700.0], 1.0, {}, "measure beyond it"),
        (LINES, 1.0, {"servo_rate": 1200.0}, "--servo-rate of more than twice its"),
        (LINES, -1.0, {}, "reverse the sign"),
        (LINES, 1.0, {"servo_rate": 1.5}, "raise --servo-rate"),
        (LINES, 1.0, {"uncertainty": 0.9}, "no longer halves errors"),
    ],
)
def test_unfit_responses_are_refused_in_a_sentence(f, scale, changes, words) -> None:
    response = measured(f, scale * PLANT.response(f))
    with pytest.raises(ModelError, match=words):
        tune_response([response], request(**({"control": "pi"} | changes)))


def test_the_command_prints_margins_and_writes_the_loop(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    h = PLANT.response(LINES)
    table = np.column_stack((LINES, h.real, h.imag))
    path = tmp_path / "axis.csv"
    np.savetxt(path, table, delimiter=",", header="f (Hz),x/u real (m/V),x/u imag (m/V)",
               comments="")  # fmt: skip
    loop = tmp_path / "loop.yaml"
    words = f"tune --frf {path} --control integral --out {loop} --figure {tmp_path / 'a.svg'}"
    with pytest.raises(SystemExit) as end:
        main([*words.split(), "--delay", "0 s", "--shift", "0", "--uncertainty", "0", "--json"])
    assert end.value.code in (0, None)
    result = json.loads(capsys.readouterr().out)
    assert result["structure"] == "integral"
    assert result["unit"] == "m/V"
    assert result["worst"]["sensitivity_peak"] < 2.001
    # a budget adds the hold
    assert read_loop(loop).latency == 0.0
    settings = read_loop(loop).settings
    assert settings.integral == result["settings"]["integral"]
    assert result["pi_parameters"]["0x07000301"] == pytest.approx(1e-6 * settings.integral)
    assert result["sections"] == settings.sections(RATE).tolist()


def test_the_control_in_c_and_for_python_control_is_the_same(tmp_path: Path) -> None:
    control = pytest.importorskip("control", reason="python-control is an optional dependency")
    settings = ServoSettings(
        proportional=2e5,
        integral=3e9,
        notches=(Notch(frequency_hz=910.0),),
        lowpass_hz=2000.0,
        filters=(Filter(b0=0.5, b1=0.1, b2=0.0, a1=-0.4, a2=0.1),),
    )
    rate = 1e4
    error = np.random.default_rng(1).normal(scale=1e-6, size=200)
    above, below = settings.transfer_function(rate)
    expected = signal.lfilter(above, below, error)
    function = control.tf(above, below, 1.0 / rate)
    f = np.array([1.0, 910.0, 3000.0])
    given = function(np.exp(2j * np.pi * f / rate))
    assert given == pytest.approx(settings.response(f, rate), rel=1e-9)
    loop = PositionLoop(name="filtered", settings=settings, sample_rate=rate)
    library = load_library(tmp_path, "#include \"control.h\"\n", files={
        "control.h": servo_source(loop).encode()})  # fmt: skip
    library.control.restype = ctypes.c_double
    state = (ctypes.c_double * (2 * len(settings.sections(rate)) + 1))()
    doubles = [ctypes.c_void_p, *3 * [ctypes.c_double]]
    library.control.argtypes = doubles
    voltage = [library.control(ctypes.addressof(state), e, -1e9, 1e9) for e in error.tolist()]
    assert voltage == pytest.approx(expected, rel=1e-9, abs=1e-9)
    # at a limit the integral rests
    before = state[-1]
    assert library.control(ctypes.addressof(state), 1.0, -1.0, 2.0) == 2.0
    assert state[-1] == before


def test_a_control_that_c_cannot_hold_leaves_no_file(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["tune", "vgtu-piezo", "--control", "ppf", "--out", "loop.c", "--figure", "loop.svg"]
    with pytest.raises(SystemExit) as ended:
        main([*words, "--quiet"])
    assert ended.value.code == 2
    assert "has an inner loop, which the code in C lacks" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
