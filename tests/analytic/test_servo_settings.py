"""The filters of a position control, against bilinear transforms by SciPy and simulation."""

import numpy as np
import pytest
from scipy import signal

from flexstage.base.errors import ModelError
from flexstage.system.servo import Notch, ServoSettings

RATE = 9.7e3


def _prewarped(numerator, denominator, frequency_hz):
    """The bilinear transform that is exact at one frequency, as SciPy makes it."""
    omega = 2.0 * np.pi * frequency_hz
    fs = omega / (2.0 * np.tan(omega / (2.0 * RATE)))
    b, a = signal.bilinear(numerator, denominator, fs)
    return np.concatenate((b / a[0], a[1:] / a[0]))


@pytest.mark.parametrize(("f", "zeros", "poles"), [(808.0, 0.013, 0.41), (50.0, 0.0, 0.07)])
def test_a_notch_is_the_prewarped_bilinear_transform(f, zeros, poles) -> None:
    w = 2.0 * np.pi * f
    expected = _prewarped([1.0, 2.0 * zeros * w, w * w], [1.0, 2.0 * poles * w, w * w], f)
    found = Notch(frequency_hz=f, zero_damping=zeros, pole_damping=poles).section(RATE)
    # coefficients of order one, formed by two different orders of operations
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-13)


def test_the_low_pass_is_a_butterworth_filter() -> None:
    b, a = signal.butter(2, 1370.0, fs=RATE)
    section = ServoSettings(lowpass_hz=1370.0).sections(RATE)
    np.testing.assert_allclose(section, [[*b, *a[1:]]], rtol=1e-12)


def test_the_response_is_that_of_the_difference_equations() -> None:
    settings = ServoSettings(
        proportional=1.7e4,
        integral=2.3e8,
        notches=(Notch(frequency_hz=431.0), Notch(frequency_hz=1210.0, pole_damping=0.3)),
        lowpass_hz=2900.0,
    )
    f = 97.0
    n = np.arange(int(RATE / f * 60))
    e = np.cos(2.0 * np.pi * f / RATE * n)
    filtered = e
    for b0, b1, b2, a1, a2 in settings.sections(RATE):
        filtered = signal.lfilter([b0, b1, b2], [1.0, a1, a2], filtered)
    u = settings.proportional * filtered + settings.integral / RATE * np.cumsum(filtered)
    late = slice(n.size // 2, None)
    basis = np.column_stack(
        [np.cos(2 * np.pi * f / RATE * n), -np.sin(2 * np.pi * f / RATE * n), np.ones(n.size)]
    )
    re, im, _ = np.linalg.lstsq(basis[late], u[late], rcond=None)[0]
    expected = settings.response([f], RATE)[0]
    # what is left of the start after 30 cycles through the narrower notch, exp(-pi zeta 30 f_n/f)
    assert abs(re + 1j * im - expected) < 1e-9 * abs(expected)


def test_a_notch_without_damped_zeros_blocks_its_frequency() -> None:
    settings = ServoSettings(proportional=3.0, notches=(Notch(frequency_hz=50.0, zero_damping=0),))
    assert abs(settings.response([50.0], RATE)[0]) < 1e-10
    assert abs(settings.response([3.0], RATE)[0]) == pytest.approx(3.0, rel=0.01)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Notch(frequency_hz=0.0), "positive frequency"),
        (lambda: Notch(frequency_hz=10.0, pole_damping=0.0), "damping of its poles"),
        (lambda: Notch(frequency_hz=10.0, zero_damping=-0.1), "0 or more"),
        (lambda: ServoSettings(integral=-1.0), "integral gain"),
        (lambda: ServoSettings(proportional=float("nan")), "proportional gain"),
        (lambda: ServoSettings(lowpass_hz=0.0), "low-pass"),
        (lambda: ServoSettings(lowpass_hz=0.5 * RATE).sections(RATE), "faster than twice"),
        (lambda: Notch(frequency_hz=0.51 * RATE).section(RATE), "faster than twice"),
    ],
)
def test_impossible_settings_are_refused(make, said) -> None:
    with pytest.raises(ModelError, match=said):
        make()
