"""Frequency responses of a known discrete system from records of every kind of excitation.

Evidence (Measuring and centring): spectral densities, H1, H2, Hv (SciPy): $10^{-11}$
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.modal.fit import fit_modes
from flexstage.measure.spectra.averaging import (
    WINDOWS,
    effective_averages,
    integral_averages,
    spectral_density,
    window_values,
)
from flexstage.measure.spectra.checks import HitOptions, PeriodOptions
from flexstage.measure.spectra.estimate import (
    ResponseOptions,
    estimate_response,
    recognise_excitation,
)
from flexstage.measure.spectra.repeated import find_period
from flexstage.measure.spectra.response import response_from_record
from flexstage.records import Channel, Record
from flexstage.records.sampling import extreme_steps
from flexstage.report.figures.responses import draw_response
from flexstage.report.figures.style import encode

RATE = 2000.0


def modes(*table: tuple[float, float, float]) -> tuple[Array, Array]:
    """Polynomials in 1/z of a sum of modes, each of frequency [Hz], damping and gain."""
    above, below = np.zeros(1), np.ones(1)
    add, times = np.polynomial.polynomial.polyadd, np.polynomial.polynomial.polymul
    for frequency, damping, gain in table:
        w = 2.0 * np.pi * frequency / RATE
        pole = np.exp(w * (-damping + 1j * np.sqrt(1.0 - damping**2)))
        a = np.array([1.0, -2.0 * pole.real, abs(pole) ** 2])
        b = gain * w**2 * np.array([0.0, 0.8, 0.2])
        above, below = add(times(above, a), times(b, below)), times(below, a)
    return above, below


B, A = modes((137.0, 0.021, 1.1e-6), (309.0, 0.017, -0.6e-6))


def exact(frequency_hz: Array, rate_added: float = 0.0, b: Array = B, a: Array = A) -> Array:
    w = np.exp(-(2j * np.pi * frequency_hz + rate_added) / RATE)
    value = np.polynomial.polynomial.polyval
    return value(w, b) / value(w, a)


def answer(u: Array) -> Array:
    return scipy.signal.lfilter(B, A, u)


def record(u: Array, y: Array, **more: Any) -> Record:
    channels = (Channel(name="u", values=u, unit="V"), Channel(name="y", values=y, unit="m"))
    given = {"time": 0.3 + np.arange(u.size) / RATE, "source": "trial", **more}
    return Record(channels=channels, **given)


def noisy(values: Array, share: float, rng: np.random.Generator) -> Array:
    return values + share * values.std() * rng.standard_normal(values.size)


def random_pair(seed: int, count: int = 40_000, noise: float = 0.3) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    u = 1.7 * rng.standard_normal(count)
    return u, noisy(answer(u), noise, rng)


def multisine(period: int, lines: Array, seed: int) -> Array:
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, lines.size)
    t = np.arange(period)
    return np.cos(2.0 * np.pi * np.outer(t, lines) / period + phase).sum(axis=1)


def hits(seed: int = 1, count: int = 7, size: int = 40_000) -> tuple[Array, Array]:
    """Force of half sines some 5300 samples apart, and the start of each."""
    rng = np.random.default_rng(seed)
    force = np.zeros(size)
    starts = 900 + 5300 * np.arange(count) + rng.integers(0, 200, count)
    for start in starts:
        width = int(rng.integers(5, 7))
        shape = np.sin(np.pi * (np.arange(width) + 0.37) / width)
        force[start : start + width] = rng.uniform(21.0, 38.0) * shape
    return force, starts


# ------------------------------------------------------------------------- equal to SciPy's spectra


@pytest.mark.parametrize(
    ("length", "overlap", "window"),
    [(1000, 0.5, "hann"), (777, 0.63, "hann"), (512, 0.25, "hamming"), (1025, 0.5, "blackman"),
     (640, 0.0, "boxcar")],
)  # fmt: skip
def test_density_equals_scipy(length: int, overlap: float, window: str) -> None:
    u, y = random_pair(3, 20_011)
    x = y / y.std() + 0.37 + 1e-4 * np.arange(u.size)
    found = spectral_density(x, RATE, segment=length, overlap=overlap, window=window)
    f, peer = scipy.signal.welch(
        x, RATE, window=window, nperseg=length, noverlap=int(overlap * length)
    )
    np.testing.assert_allclose(found.frequency_hz, f, rtol=1e-14)
    np.testing.assert_allclose(found.density, peer, rtol=1e-12, atol=1e-13 * peer.max())
    plain = spectral_density(x, RATE, segment=length, overlap=overlap, window=window, detrend=False)
    _, peer = scipy.signal.welch(
        x, RATE, window=window, nperseg=length, noverlap=int(overlap * length), detrend=False
    )
    np.testing.assert_allclose(plain.density, peer, rtol=1e-12, atol=1e-13 * peer.max())


def test_estimators_equal_scipy() -> None:
    u, y = random_pair(5, 30_007)
    y = y / y.std() + 0.2
    options: dict[str, Any] = {"fs": RATE, "nperseg": 1024, "noverlap": 512}
    xx, yy = scipy.signal.welch(u, **options)[1], scipy.signal.welch(y, **options)[1]
    xy, c = scipy.signal.csd(u, y, **options)[1], scipy.signal.coherence(u, y, **options)[1]
    peers = {"H1": xy / xx, "H2": yy / np.conj(xy), "Hv": xy / np.abs(xy) * np.sqrt(yy / xx)}
    for name, peer in peers.items():
        found = estimate_response(
            record(u, y), "u", "y", segment=1024, estimator=name, excitation="random",
            power_floor=0.0,
        )  # fmt: skip
        h = found.response
        np.testing.assert_allclose(h.response[:, 0, 0], peer[1:-1], rtol=1e-11)
        np.testing.assert_allclose(h.coherence[:, 0], c[1:-1], rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(found.spectra.input_power[:, 0, 0], xx[1:-1], rtol=1e-12)
        np.testing.assert_allclose(found.spectra.cross[:, 0, 0], xy[1:-1], rtol=1e-11)
        np.testing.assert_allclose(found.spectra.output_power[:, 0], yy[1:-1], rtol=1e-12)
    assert found.response.input_units == ("V",)
    assert found.response.output_units == ("m",)


def test_records_are_averaged_like_one_long_sum() -> None:
    u, y = random_pair(8, 24_000)
    parts = [record(u[:9000], y[:9000]), record(u[9000:], y[9000:])]
    both = estimate_response(parts, "u", "y", segment=1000, overlap=0.0, excitation="random")
    one = estimate_response(record(u, y), "u", "y", segment=1000, overlap=0.0, excitation="random")
    np.testing.assert_allclose(both.response.response, one.response.response, rtol=1e-12)
    assert both.spectra.segments == 24


# --------------------------------------------------------------------- variance tells the errors


def ratio(found: Any) -> float:
    """Mean square of the error over its stated variance."""
    h = found.response
    error = np.abs(h.response[:, 0, 0] - exact(h.frequency_hz)) ** 2
    return float(np.mean(error / h.variance[:, 0, 0]))


@pytest.mark.parametrize(
    ("segment", "overlap", "window"),
    [(1024, 0.5, "hann"), (1024, 0.75, "hann"), (4096, 0.5, "hann"), (1024, 0.5, "blackman")],
)
def test_variance_of_random_excitation(segment: int, overlap: float, window: str) -> None:
    # well damped modes, so that a line is narrower than a resonance and leakage is no error
    b, a = modes((137.0, 0.21, 1.1e-6), (309.0, 0.17, -0.6e-6))
    values, n = [], 0.0
    for seed in range(20):
        rng = np.random.default_rng((seed, 2))
        u = 1.7 * rng.standard_normal(40_000)
        y = noisy(scipy.signal.lfilter(b, a, u), 0.4, rng)
        found = estimate_response(
            record(u, y), "u", "y", segment=segment, overlap=overlap, window=window,
            excitation="random",
        )  # fmt: skip
        h = found.response
        n = h.averages
        error = np.abs(h.response[:, 0, 0] - exact(h.frequency_hz, b=b, a=a)) ** 2
        values.append(np.mean(error / h.variance[:, 0, 0]))
    # an estimated variance of 2 (n - 1) degrees of freedom is in the denominator
    assert np.mean(values) == pytest.approx((n - 1.0) / (n - 2.0), rel=0.04)


@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
def test_variance_of_estimators(estimator: str) -> None:
    """Noise on the side that each estimator is meant for."""
    b, a = np.array([0.0, 0.7, 0.4]), np.array([1.0, -0.5, 0.11])
    squares, stated = [], []
    for seed in range(30):
        rng = np.random.default_rng((seed, 3))
        u = 1.3 * rng.standard_normal(24_000)
        y = scipy.signal.lfilter(b, a, u)
        if estimator != "H2":
            # Hv takes noise as the same share of the power at every line on both sides
            y = y + scipy.signal.lfilter(b, a, 0.5 * rng.standard_normal(u.size))
        if estimator != "H1":
            u = u + 0.5 * rng.standard_normal(u.size)
        h = estimate_response(
            record(u, y), "u", "y", segment=512, estimator=estimator, excitation="random"
        ).response
        squares.append(np.abs(h.response[:, 0, 0] - exact(h.frequency_hz, b=b, a=a)) ** 2)
        stated.append(h.variance[:, 0, 0])
    assert np.mean(np.mean(squares, axis=0) / np.mean(stated, axis=0)) == pytest.approx(
        1.0, abs=0.07
    )


def test_noise_biases_the_other_estimator() -> None:
    rng = np.random.default_rng(4)
    u = rng.standard_normal(400_000)
    y = 3e-6 * u
    found = {}
    for side in ("input", "output"):
        x, z = (noisy(u, 0.5, rng), y) if side == "input" else (u, noisy(y, 0.5, rng))
        for name in ("H1", "Hv", "H2"):
            h = estimate_response(
                record(x, z), "u", "y", segment=256, estimator=name, excitation="random"
            ).response
            found[side, name] = abs(h.response.mean()) / 3e-6
    # the power of the noise is a quarter of that of the signal
    assert found["output", "H1"] == pytest.approx(1.0, abs=0.003)
    assert found["input", "H2"] == pytest.approx(1.0, abs=0.003)
    assert found["output", "H2"] == pytest.approx(1.25, abs=0.01)
    assert found["input", "H1"] == pytest.approx(0.8, abs=0.01)
    assert found["output", "Hv"] == pytest.approx(1.25**0.5, abs=0.006)
    assert found["input", "Hv"] == pytest.approx(1.25**-0.5, abs=0.006)


def test_hv_with_the_ratio_of_the_noises_is_free_of_bias() -> None:
    rng = np.random.default_rng(9)
    u = rng.standard_normal(400_000)
    x, z = u + 0.4 * rng.standard_normal(u.size), 3e-6 * u + 0.9e-6 * rng.standard_normal(u.size)
    h = estimate_response(
        record(x, z), "u", "y", segment=256, estimator="Hv", excitation="random",
        noise_ratio=(0.9e-6 / 0.4) ** 2,
    ).response  # fmt: skip
    assert abs(h.response.mean()) == pytest.approx(3e-6, rel=0.004)
    plain = estimate_response(
        record(x, z), "u", "y", segment=256, estimator="Hv", excitation="random"
    ).response
    assert abs(plain.response.mean()) < 0.985 * 3e-6


# --------------------------------------------------------------------------- periodic excitation


def test_periodic_without_noise_is_exact() -> None:
    lines = np.arange(5, 391)
    period = multisine(1000, lines, 6)
    u = np.tile(period, 12)
    y = answer(u)
    found = estimate_response(record(u, y), "u", "y", periods=PeriodOptions(drop=9))
    h = found.response
    assert (found.excitation, found.segment, found.spectra.segments) == ("periodic", 1000, 3)
    np.testing.assert_allclose(h.frequency_hz, lines * RATE / 1000.0, rtol=1e-13)
    np.testing.assert_allclose(h.response[:, 0, 0], exact(h.frequency_hz), rtol=1e-9)
    assert np.sqrt(h.variance).max() < 1e-9 * np.abs(h.response).max()
    # the periods in which the motion settles are found
    dropped = estimate_response(record(u, noisy(y, 1e-3, np.random.default_rng(1))), "u", "y")
    assert dropped.spectra.segments in range(9, 12)


def test_variance_of_periodic_excitation_with_noise_on_both_sides() -> None:
    period = multisine(800, np.arange(3, 371), 7)
    u = np.tile(period, 11)
    y = answer(u)
    values = []
    for seed in range(60):
        rng = np.random.default_rng((seed, 5))
        found = estimate_response(
            record(noisy(u, 0.05, rng), noisy(y, 0.07, rng)), "u", "y",
            periods=PeriodOptions(samples=800, drop=3), excitation="periodic",
        )  # fmt: skip
        values.append(ratio(found))
    assert found.spectra.segments == 8
    # 14 degrees of freedom of the variance in the denominator
    assert np.mean(values) == pytest.approx(14.0 / 12.0, rel=0.03)


def test_noise_that_input_and_output_share_is_no_error() -> None:
    u = noisy(np.tile(multisine(500, np.arange(3, 240), 3), 8), 0.1, np.random.default_rng(1))
    h = estimate_response(
        record(u, 3e-6 * u), "u", "y", excitation="periodic", periods=PeriodOptions(samples=500)
    ).response
    np.testing.assert_allclose(h.response, 3e-6, rtol=1e-12)
    assert np.sqrt(h.variance.max()) < 1e-7 * 3e-6


def test_two_inputs_by_two_periodic_records() -> None:
    lines = np.arange(4, 300)
    first, second = (np.tile(multisine(700, lines, s), 9) for s in (1, 2))
    records = []
    for sign in (1.0, -1.0):
        y = answer(first) + sign * 0.3 * answer(np.roll(second, 1))
        channels = (
            Channel(name="a", values=first),
            Channel(name="b", values=sign * second),
            Channel(name="y", values=y),
        )
        records.append(Record(channels=channels, time=np.arange(y.size) / RATE))
    h = estimate_response(
        records, ["a", "b"], "y", excitation="periodic", periods=PeriodOptions(drop=7)
    ).response
    truth = exact(h.frequency_hz)
    np.testing.assert_allclose(h.response[:, 0, 0], truth, rtol=1e-7)
    delayed = 0.3 * truth * np.exp(-2j * np.pi * h.frequency_hz / RATE)
    np.testing.assert_allclose(h.response[:, 0, 1], delayed, rtol=1e-7)
    with pytest.raises(RecordError, match="2 periodic inputs need at least 2 records"):
        estimate_response(records[0], ["a", "b"], "y", excitation="periodic")
    with pytest.raises(RecordError, match="are not separable"):
        estimate_response([records[0]] * 2, ["a", "b"], "y", excitation="periodic")


@settings(deadline=None, max_examples=40)
@given(
    period=st.integers(40, 700), copies=st.integers(2, 6), rest=st.floats(0.05, 0.95),
    seed=st.integers(0, 2**20),
)  # fmt: skip
def test_period_is_found(period: int, copies: int, rest: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.tile(rng.standard_normal(period), copies + 1)[: int((copies + rest) * period)]
    assert find_period(x + 0.02 * rng.standard_normal(x.size)) == period


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_period_that_is_no_whole_number_is_refused(noise: float) -> None:
    t = np.arange(4000)
    x = sum(np.cos(2.0 * np.pi * k * t / 700.4 + k**2) for k in range(1, 60))
    x = x + noise * x.std() * np.random.default_rng(2).standard_normal(t.size)
    with pytest.raises(RecordError, match=r"is 1400\.8\d* samples, not an integer number"):
        find_period(x)


def test_a_force_with_coarse_steps_is_not_cut_off() -> None:
    """A soft hammer: the peak lasts, and a converter sees some equal values there."""
    force, starts = np.zeros(30_000), (800, 8000, 15_500)
    for start in starts:
        force[start : start + 120] = 31.3 * np.sin(np.pi * (np.arange(120) + 0.37) / 120)
    coarse = 0.05 * np.round(force / 0.05)
    same = [int(np.sum(coarse[s : s + 120] == coarse[s : s + 120].max())) for s in starts]
    assert min(same) >= 3
    found = estimate_response(record(coarse, answer(force)), "u", "y", excitation="hammer")
    assert (found.spectra.segments, found.rejected) == (3, ())


# ------------------------------------------------------------------------------ hits, steps, sweep


def test_hits_without_noise_are_exact() -> None:
    force, starts = hits()
    found = estimate_response(record(force, answer(force) + 3e-5), "u", "y", power_floor=1e-9)
    h = found.response
    assert found.excitation == "hammer"
    assert found.spectra.segments == starts.size
    assert found.rejected == ()
    assert found.added_damping_rate == 0.0
    scale = np.abs(h.response).max()
    np.testing.assert_allclose(
        h.response[:, 0, 0], exact(h.frequency_hz), rtol=0.0, atol=1e-8 * scale
    )


def test_variance_of_hits() -> None:
    values = []
    for seed in range(40):
        force, starts = hits(seed)
        y = answer(force)
        y = y + 0.01 * y.max() * np.random.default_rng((seed, 1)).standard_normal(y.size)
        values.append(ratio(estimate_response(record(force, y), "u", "y")))
    degrees = 2 * (starts.size - 1)
    assert np.mean(values) == pytest.approx(degrees / (degrees - 2), rel=0.03)


def test_exponential_window_shifts_the_poles() -> None:
    force, _ = hits(2)
    options = HitOptions(exponential=1e-4, pre_trigger=25)
    found = estimate_response(
        record(force, answer(force) + 3e-5), "u", "y", segment=3000, hits=options
    )
    h = found.response
    assert found.added_damping_rate == pytest.approx(np.log(1e4) * RATE / 3000.0)
    shifted = exact(h.frequency_hz, found.added_damping_rate)
    top = np.abs(shifted).max()
    np.testing.assert_allclose(h.response[:, 0, 0], shifted, rtol=0.0, atol=1e-6 * top)
    # and differs from the response itself by far more
    assert np.abs(shifted - exact(h.frequency_hz)).max() > 1e-2 * top
    assert "exponential window adds" in " ".join(h.notes)


def test_double_and_clipped_hits_are_named_and_left_out() -> None:
    force, starts = hits(3)
    force[starts[1] + 40 : starts[1] + 44] = 4.1
    top = force[starts[4] : starts[4] + 8].max()
    y = answer(force)
    force[starts[4] : starts[4] + 8] = np.minimum(force[starts[4] : starts[4] + 8], 0.6 * top)
    peak = np.abs(y[starts[5] : starts[5] + 3000]).max()
    part = slice(starts[5], starts[5] + 3000)
    y[part] = np.clip(y[part], -0.1 * peak, 0.1 * peak)
    found = estimate_response(record(force, y), "u", "y")
    assert found.spectra.segments == starts.size - 3
    words = "\n".join(found.rejected)
    assert found.rejected[0] in found.response.notes[-1]
    assert f"{0.3 + starts[1] / RATE:.6g} s: a double hit" in words
    assert f"{0.3 + starts[4] / RATE:.6g} s: the force is clipped" in words
    assert f"{0.3 + starts[5] / RATE:.6g} s: 'y' is clipped" in words
    h = found.response
    scale = np.abs(h.response).max()
    np.testing.assert_allclose(
        h.response[:, 0, 0], exact(h.frequency_hz), rtol=0.0, atol=1e-7 * scale
    )
    # a force that points down is found as well
    down = estimate_response(record(-force, -y), "u", "y")
    np.testing.assert_allclose(down.response.response, h.response, rtol=1e-12)


def test_one_hit_has_no_variance() -> None:
    force, _ = hits(4, count=1, size=6000)
    h = estimate_response(record(force, answer(force)), "u", "y").response
    assert h.variance is None
    assert h.coherence is None
    assert h.averages == 1.0
    assert "too few averages" in h.notes[-1]


def test_steps_without_noise_are_exact() -> None:
    u = np.full(31_000, 0.4)
    for start, level in ((700, 3.0), (9300, 1.2), (17_900, 2.2), (26_500, -1.0)):
        u[start:] = level
        u[start : start + 3] = np.linspace(u[start - 1], level, 5)[1:-1]
    y = answer(u - 0.4) + 0.4 * exact(np.zeros(1)).real
    found = estimate_response(record(u, y), "u", "y", power_floor=0.0)
    h = found.response
    assert (found.excitation, found.spectra.segments) == ("step", 3)
    assert len(found.rejected) == 1
    scale = np.abs(h.response).max()
    np.testing.assert_allclose(
        h.response[:, 0, 0], exact(h.frequency_hz), rtol=0.0, atol=1e-8 * scale
    )


def test_sweep_is_taken_as_a_whole() -> None:
    t = np.arange(20_000) / RATE
    u = scipy.signal.chirp(t, 5.0, 9.0, 700.0)
    u[:400] = 0.0
    u[-5000:] = 0.0
    found = estimate_response(record(u, answer(u)), "u", "y", power_floor=1e-3)
    h = found.response
    assert (found.excitation, found.segment) == ("sweep", 20_000)
    scale = np.abs(h.response).max()
    np.testing.assert_allclose(
        h.response[:, 0, 0], exact(h.frequency_hz), rtol=0.0, atol=1e-8 * scale
    )
    assert 580.0 < h.frequency_hz[-1] < 650.0


def test_kinds_of_excitation_are_told_apart() -> None:
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(20_000)
    step = np.where(np.arange(20_000) < 150, 0.1, 2.0)
    band = scipy.signal.lfilter([1.0], [1.0, -1.98, 0.9802], noise)
    t = np.arange(20_000) / RATE
    assert recognise_excitation(noise) == "random"
    assert recognise_excitation(band) == "random"
    assert recognise_excitation(step + 1e-3 * noise) == "step"
    assert recognise_excitation(hits()[0] + 0.01 * rng.standard_normal(40_000)) == "hammer"
    assert recognise_excitation(np.tile(noise[:1700], 9)) == "periodic"
    assert recognise_excitation(scipy.signal.chirp(t, 5.0, 10.0, 700.0) + 0.01 * noise) == "sweep"


# ------------------------------------------------------------------------------- several channels


def mixed(seed: int, share: float = 0.0) -> tuple[Record, Array]:
    """Two inputs, the second with a share of the first, and two outputs."""
    rng = np.random.default_rng(seed)
    a, b = rng.standard_normal((2, 120_000))
    b = (1.0 - share) * 0.7 * b + share * a
    gains = np.array([[2.0, -0.6], [0.3, 1.4]])
    x, y = gains @ np.stack([a, b]) + 0.3 * rng.standard_normal((2, a.size))
    names = ("a", "b", "x", "y")
    channels = tuple(Channel(name=n, values=v) for n, v in zip(names, (a, b, x, y), strict=True))
    return Record(channels=channels, time=np.arange(a.size) / RATE), gains


@pytest.mark.parametrize("estimator", ["H1", "Hv"])
def test_two_inputs_two_outputs(estimator: str) -> None:
    given, gains = mixed(3, share=0.3)
    h = estimate_response(
        given, ["a", "b"], ["x", "y"], estimator=estimator, segment=256, excitation="random"
    ).response
    assert h.response.shape[1:] == (2, 2)
    wanted = gains[None]
    error = h.response - wanted
    if estimator == "H1":
        assert np.mean(np.abs(error) ** 2 / h.variance) == pytest.approx(1.0, abs=0.12)
        # noise of power 0.09 is what the inputs do not explain
        power = np.array([[1.0, 0.3], [0.3, 0.49 * 0.49 + 0.09]])
        for o in range(2):
            explained = gains[o] @ power @ gains[o]
            assert h.coherence[:, o].mean() == pytest.approx(explained / (explained + 0.09), 3e-3)
    else:
        assert np.abs(error.mean(axis=0)).max() < 0.1


def test_hv_of_many_inputs_is_that_of_one() -> None:
    """The eigenvalue form, with an input beside that nothing follows, is the closed one."""
    from flexstage.measure.spectra.sums import _smallest, transfer

    u, y = random_pair(2, 20_000)
    spectra = estimate_response(record(u, y / y.std()), "u", "y", excitation="random").spectra
    for noise_ratio in (None, 0.4):
        one, _, _ = transfer(spectra, "Hv", noise_ratio)
        general = _smallest(spectra.input_power, spectra.cross, spectra.output_power, noise_ratio)
        np.testing.assert_allclose(one, general, rtol=1e-8, atol=1e-10)


def test_correlated_inputs_are_refused() -> None:
    given, _ = mixed(4, share=0.85)
    with pytest.raises(RecordError, match="inputs cannot be separated: the others explain 98"):
        estimate_response(given, ["a", "b"], "x", segment=256, excitation="random")
    with pytest.raises(ModelError, match="H2 is defined for one input"):
        estimate_response(given, ["a", "b"], "x", estimator="H2")
    with pytest.raises(ModelError, match="a hammer has one input, got 2"):
        estimate_response(given, ["a", "b"], "x", excitation="hammer")


# ------------------------------------------------------------------------------ density and windows


def test_rms_in_a_band_covers_the_truth() -> None:
    """White noise through a filter: the power in a band is that of its transfer function."""
    b, a = np.array([0.5, 0.2]), np.array([1.0, -0.8, 0.3])
    f = np.linspace(200.0, 600.0, 4001)
    gain = np.abs(exact(f, b=b, a=a)) ** 2
    truth = np.sqrt(np.trapezoid(gain, f) * 2.0 / RATE)
    covered, values, stated = [], [], []
    for seed in range(300):
        x = np.random.default_rng((seed, 9)).standard_normal(4000)
        found = spectral_density(scipy.signal.lfilter(b, a, x), RATE, segment=400, unit="m")
        rms = found.rms(202.0, 598.0)
        covered.append(rms.covers(truth))
        values.append(rms.value)
        stated.append(rms.uncertainty)
    assert 0.93 < np.mean(covered) < 0.97
    assert np.mean(stated) == pytest.approx(np.std(values), rel=0.08)


def test_bounds_of_a_density_cover_it() -> None:
    inside, spread = [], []
    for seed in range(50):
        x = np.random.default_rng((seed, 10)).standard_normal(6000)
        found = spectral_density(x, RATE, segment=500, overlap=0.6)
        low, high = found.bounds()
        inside.append((low[2:-2] < 1e-3) & (high[2:-2] > 1e-3))
        spread.append(found.density[2:-2])
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)
    assert np.std(spread) / 1e-3 == pytest.approx(found.averages**-0.5, rel=0.04)
    with pytest.raises(ModelError, match="confidence must be between"):
        found.bounds(1.0)


def test_power_of_a_density_is_that_of_the_signal() -> None:
    u, _ = random_pair(1, 8192)
    whole = spectral_density(u, RATE, segment=8192, window="boxcar", detrend=False)
    assert whole.rms().value == pytest.approx(np.sqrt(np.mean(u**2)), rel=1e-12)


@given(
    name=st.sampled_from(sorted(WINDOWS)), length=st.integers(16, 300), part=st.floats(0.05, 1.0),
    segments=st.integers(1, 40),
)  # fmt: skip
def test_averages_are_between_one_and_the_segments(
    name: str, length: int, part: float, segments: int
) -> None:
    w, hop = window_values(name, length), max(1, int(part * length))
    n = effective_averages(w, hop, segments)
    assert 1.0 - 1e-9 <= n <= segments + 1e-9
    assert integral_averages(w, hop, segments) <= segments + 1e-9
    assert effective_averages(w, length, segments) == segments
    np.testing.assert_allclose(w, scipy.signal.get_window(name, length), atol=1e-15)


# --------------------------------------------------------------------------------- what is refused


def spoilt(name: str, at: int, value: float) -> Record:
    u, y = random_pair(1, 8000)
    (u if name == "u" else y)[at] = value
    return record(u, y)


@pytest.mark.parametrize("excitation", ["random", "auto"])
@pytest.mark.parametrize("at", [11, 4000, 7990])
def test_what_is_not_finite_is_named(excitation: str, at: int) -> None:
    for value in (np.nan, np.inf):
        with pytest.raises(RecordError, match=f"column 'y' is .* at sample {at}"):
            estimate_response(spoilt("y", at, value), "u", "y", excitation=excitation, segment=400)


def test_dead_and_clipped_channels_are_refused() -> None:
    u, y = random_pair(1, 8000)
    with pytest.raises(RecordError, match=r"'y' of 'trial' is constant, 0\.7"):
        estimate_response(record(u, np.full(8000, 0.7)), "u", "y", excitation="random")
    with pytest.raises(RecordError, match="'u' of 'trial' is constant"):
        estimate_response(record(np.full(8000, 0.7), y), "u", "y")
    cut = np.minimum(y, 0.6 * y.max())
    with pytest.raises(RecordError, match="'y' of 'trial' is clipped at"):
        estimate_response(record(u, cut), "u", "y", excitation="random")
    with pytest.raises(RecordError, match="'y' of 'trial' is clipped at"):
        estimate_response(record(np.tile(u[:800], 10), cut), "u", "y", excitation="periodic")
    allowed = estimate_response(record(u, cut), "u", "y", excitation="random", allow_clipped=True)
    assert allowed.response.coherence.min() < 0.99
    # a signal of two levels rests at both without being cut off
    binary = np.where(u > 0.0, 1.0, -0.7)
    estimate_response(record(binary, answer(binary)), "u", "y", excitation="random")


def test_clipping_at_the_least_value_is_seen() -> None:
    u, y = random_pair(1, 8000)
    with pytest.raises(RecordError, match="is clipped at"):
        estimate_response(record(u, np.maximum(y, 0.6 * y.min())), "u", "y", excitation="random")


# a record longer than the pieces in which its times are looked through, the step at their ends too
@pytest.mark.parametrize("at", [0, 77, 65_535, 65_536, 70_001])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_uneven_step_is_seen(at: int, sign: float) -> None:
    u, y = random_pair(1, 70_003)
    time = np.arange(70_003) / RATE
    time[at + 1 :] += sign * 0.2 / RATE
    steps = np.diff(time)
    assert extreme_steps(time) == (steps.min(), steps.max())
    with pytest.raises(RecordError, match="not evenly spaced"):
        estimate_response(record(u, y, time=time), "u", "y", excitation="random")


def refused(match: str, given: Any = None, **options: Any) -> None:
    u, y = random_pair(1, 8000)
    with pytest.raises((RecordError, ModelError), match=match) as caught:
        estimate_response(
            record(u, y) if given is None else given,
            options.pop("inputs", "u"), options.pop("outputs", "y"), **options,
        )  # fmt: skip
    assert "\n" not in str(caught.value)


def test_options_are_one_value_with_others_by_name() -> None:
    given = record(*random_pair(7, 8000))
    named = estimate_response(given, "u", "y", excitation="random", segment=400, window="hamming")
    options = ResponseOptions(excitation="random", segment=500, window="hamming")
    whole = estimate_response(given, "u", "y", options, segment=400)
    assert whole.segment == named.segment == 400
    assert np.array_equal(whole.response.response, named.response.response)
    with pytest.raises(TypeError, match="shape"):
        estimate_response(given, "u", "y", shape="hann")


def test_refusals_are_one_sentence() -> None:
    u, y = random_pair(1, 8000)
    uneven = np.arange(8000.0) / RATE
    uneven[4000:] += 0.3 / RATE
    refused("not evenly spaced", record(u, y, time=uneven))
    refused("a record over frequency, not over time", record(u, y, over="frequency"))
    refused("there is no column 'z'", outputs="z")
    refused("'u' is given twice", outputs=["y", "u"])
    refused("needs at least a record, an input and an output", [], excitation="random")
    refused("segment of 9000 samples is longer than the record of 8000", segment=9000,
            excitation="random")  # fmt: skip
    refused("at least 8 samples, got 4", segment=4, excitation="random")
    refused("not both", segment=100, resolution_hz=1.0, excitation="random")
    refused("resolution must be positive", resolution_hz=-1.0, excitation="random")
    refused("too short for a frequency response", record(u[:60], y[:60]), excitation="random")
    refused("overlap must be from 0", overlap=1.0, excitation="random")
    refused("window must be one of .*'kaiser'", window="kaiser", excitation="random")
    refused("a window for segments of 400 samples", window=np.ones(40), segment=400,
            excitation="random")  # fmt: skip
    refused("estimator must be H1, H2 or Hv", estimator="H3")
    refused("excitation must be one of", excitation="noise")
    refused("ratio of noise powers", noise_ratio=1.0)
    refused("power floor must be from 0", power_floor=1.0)
    refused("is not periodic", excitation="periodic")
    refused("'trial' has 1.6 periods of 5000 samples, but 2 are needed", excitation="periodic",
            periods=PeriodOptions(samples=5000))  # fmt: skip
    short = record(u[:6000], y[:6000])
    refused("records of equal length", [record(u, y), short], excitation="sweep")
    faster = record(u, y, time=np.arange(8000.0) / 3000.0)
    refused("need equal sample rates", [record(u, y), faster])
    other = replace(record(u, y), channels=(Channel(name="u", values=u, unit="N"),
                                            Channel(name="y", values=y, unit="m")))  # fmt: skip
    refused("need equal units", [record(u, y), other])


def test_no_hit_is_left() -> None:
    force, starts = hits(3, count=2, size=12_000)
    for start in starts:
        force[start + 40 : start + 44] = 4.1
    refused("no hit is usable: .*a double hit", record(force, answer(force)), excitation="hammer")
    for wrong in ({"trigger": 0.0}, {"bounce": 1.0}, {"exponential": 2.0}, {"pre_trigger": -1}):
        with pytest.raises(ModelError):
            HitOptions(**wrong)  # type: ignore[arg-type]
    for wrong in ({"samples": 7}, {"drop": -1}):
        with pytest.raises(ModelError):
            PeriodOptions(**wrong)


# --------------------------------------------------- responses that a record over frequency holds


def over_frequency(**attributes: str) -> tuple[Record, Array, Array]:
    f = np.linspace(4.0, 400.0, 61)
    h = exact(f)
    share = 0.9 + 0.05 * np.cos(f)
    columns = []
    for name, factor in (("7:+z/3:+x", 1.0), ("8:+z/3:+x", -0.3)):
        columns += [
            Channel(name=f"{name} real", values=factor * h.real, unit="m/N"),
            Channel(name=f"{name} imaginary", values=factor * h.imag, unit="m/N"),
            Channel(name=f"coherence {name}", values=share),
        ]
    given = Record(channels=tuple(columns), time=f, over="frequency", attributes=attributes)
    return given, h, share


def test_responses_are_taken_from_a_record() -> None:
    units = {"output unit of 7:+z/3:+x": "m", "input unit of 7:+z/3:+x": "N"}
    given, h, share = over_frequency(**units)
    found = response_from_record(given)
    assert (found.outputs, found.inputs) == (("7:+z", "8:+z"), ("3:+x",))
    assert (found.output_units, found.input_units) == (("m", ""), ("N",))
    np.testing.assert_array_equal(found.response[:, 0, 0], h)
    np.testing.assert_array_equal(found.response[:, 1, 0], -0.3 * h)
    np.testing.assert_array_equal(found.coherence[:, 1], share)
    assert found.variance is None


def test_records_without_a_response_are_refused() -> None:
    u, y = random_pair(1, 100)
    with pytest.raises(RecordError, match="a record over frequency, got one over time"):
        response_from_record(record(u, y))
    with pytest.raises(RecordError, match="contains no frequency response"):
        response_from_record(record(u, y, over="frequency"))
    spectrum = over_frequency(**{"kind of 7:+z/3:+x": "cross spectrum"})[0]
    assert response_from_record(spectrum).outputs == ("8:+z",)
    renamed = over_frequency(**{"input of 7:+z/3:+x": "4:+x"})[0]
    with pytest.raises(RecordError, match=r"response of '7:\+z' to '3:\+x' is missing"):
        response_from_record(renamed)
    same = over_frequency(**{"output of 8:+z/3:+x": "7:+z"})[0]
    with pytest.raises(RecordError, match="are the same response"):
        response_from_record(same)


# --------------------------------------------------------------------------------------- the figure


def test_a_response_is_drawn() -> None:
    found = estimate_response(record(*random_pair(1)), "u", "y", excitation="random").response
    fit = replace(found, response=exact(found.frequency_hz)[:, None, None], variance=None)
    figure = draw_response(found, fit=fit)
    assert len(figure.axes) == 3
    magnitude, phase, coherence = figure.axes
    assert magnitude.get_ylabel() == "magnitude [m/V]"
    np.testing.assert_array_equal(magnitude.lines[0].get_ydata(), np.abs(found.response[:, 0, 0]))
    assert len(magnitude.collections) == len(phase.collections) == 1
    np.testing.assert_array_equal(coherence.lines[0].get_ydata(), found.coherence[:, 0])
    assert encode(figure, "png").startswith(b"\x89PNG")
    bare = draw_response(replace(found, variance=None, coherence=None))
    assert len(bare.axes) == 2
    assert not bare.axes[0].collections


def test_a_long_response_is_drawn_with_its_peaks() -> None:
    f = np.linspace(0.1, 900.0, 60_001)
    h = exact(f)
    found = response_from_record(
        Record(
            channels=(Channel(name="y/u real", values=h.real),
                      Channel(name="y/u imaginary", values=h.imag)),
            time=f, over="frequency",
        )
    )  # fmt: skip
    line = draw_response(found).axes[0].lines[0]
    assert line.get_xdata().size < 4000
    assert line.get_ydata().max() == np.abs(h).max()
    assert line.get_ydata().min() == np.abs(h).min()


def test_a_short_record_resolves_its_peak():
    # 1 024 samples: the peak of 16 Hz is two lines of 256 samples wide, half of one of 64
    rng, damping = np.random.default_rng(5), 0.05
    b, a = modes((160.0, damping, 1.0))
    found = []
    for _ in range(8):
        force = rng.standard_normal(1024)
        motion = scipy.signal.lfilter(b, a, force)
        motion += 1e-3 * np.std(motion) * rng.standard_normal(1024)
        channels = (Channel(name="f", unit="N", values=force),
                    Channel(name="x", unit="m", values=motion))  # fmt: skip
        record = Record(channels=channels, time=np.arange(1024) / RATE)
        made = estimate_response([record], ["f"], ["x"], excitation="random")
        fit = fit_modes([made.response], count=1, band=(60.0, 300.0))
        found.append(fit.modes[0].damping_ratio.value)
    assert np.mean(found) == pytest.approx(damping, rel=0.1)
    assert np.ptp(found) < 0.02
