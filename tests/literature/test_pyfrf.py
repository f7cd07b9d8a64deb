"""H1, H2, Hv and coherence against pyFRF on the same records.

Evidence (Measuring and centring): H1, H2, Hv, coherence, two inputs, hits (pyFRF): $10^{-9}$
"""

from typing import Any

import numpy as np
import pytest
import scipy.signal

from flexstage.measure.spectra.checks import HitOptions
from flexstage.measure.spectra.estimate import estimate_response
from flexstage.records import Channel, Record

pyfrf = pytest.importorskip("pyFRF")

RATE = 1500


def records(count: int, size: int, seed: int) -> list[Record]:
    """Records of two outputs of a system with two modes, noise on both sides."""
    made = []
    for number in range(count):
        rng = np.random.default_rng((seed, number))
        u = 2.3 * rng.standard_normal(size)
        x = scipy.signal.lfilter([0.0, 0.4, 0.1], [1.0, -1.2, 0.93], u)
        y = scipy.signal.lfilter([0.0, -0.3, 0.2], [1.0, 0.3, 0.88], u)
        noise = rng.standard_normal((3, size))
        channels = (
            Channel(name="u", values=u + 0.3 * noise[0]),
            Channel(name="x", values=x + 0.4 * noise[1]),
            Channel(name="y", values=y + 0.5 * noise[2]),
        )
        made.append(Record(channels=channels, time=np.arange(size) / RATE))
    return made


def peer(given: list[Record], **options: Any) -> Any:
    """Return pyFRF's estimate, of a response as if of displacement: nothing is converted."""
    u = np.stack([r.channel("u").values for r in given])[:, None]
    outputs = np.stack([[r.channel(n).values for n in ("x", "y")] for r in given])
    return pyfrf.FRF(
        RATE, exc=u, resp=outputs, exc_type="f", resp_type="d", frf_estimator="H1", **options
    )


def kept(values: np.ndarray) -> np.ndarray:
    """Lines from first to last, without those at 0 and at half the sample rate."""
    return np.moveaxis(values, -1, 0)[1:-1]


@pytest.mark.parametrize(("window", "name"), [("hann", np.hanning), ("hamming", np.hamming)])
@pytest.mark.parametrize("overlap", [0.5, 0.75])
def test_random(window: str, name: Any, overlap: float) -> None:
    given = records(3, 9000, 4)
    # pyFRF's windows are symmetric
    other = peer(given, window=window, nperseg=600, noverlap=int(600 * overlap), fft_len=600)
    options: dict[str, Any] = {
        "segment": 600,
        "overlap": overlap,
        "window": name(600),
        "excitation": "random",
        "power_floor": 0.0,
    }
    peers = {"H1": other.get_H1(), "H2": other.get_H2()}
    for estimator, wanted in peers.items():
        h = estimate_response(given, "u", ["x", "y"], estimator=estimator, **options).response
        np.testing.assert_allclose(h.response, kept(wanted), rtol=1e-9)
        np.testing.assert_allclose(h.coherence, kept(other.get_coherence()), rtol=1e-9)
    # its Hv takes the noise of output and input as of equal power, in whatever units they are
    h = estimate_response(
        given, "u", ["x", "y"], estimator="Hv", noise_ratio=1.0, **options
    ).response
    np.testing.assert_allclose(h.response, kept(other.get_Hv()), rtol=1e-9)


def test_two_inputs() -> None:
    size = 30_000
    rng = np.random.default_rng(8)
    inputs = rng.standard_normal((2, size))
    outputs = np.array([[1.3, -0.4], [0.2, 0.7]]) @ inputs
    outputs += 0.2 * rng.standard_normal((2, size))
    other = pyfrf.FRF(
        RATE, exc=inputs[None], resp=outputs[None], exc_type="f", resp_type="d", window="hann",
        nperseg=500, noverlap=250, fft_len=500,
    )  # fmt: skip
    names = ("a", "b", "x", "y")
    channels = tuple(
        Channel(name=n, values=v) for n, v in zip(names, (*inputs, *outputs), strict=True)
    )
    h = estimate_response(
        Record(channels=channels, time=np.arange(size) / RATE), ["a", "b"], ["x", "y"],
        segment=500, window=np.hanning(500), excitation="random", power_floor=0.0,
    ).response  # fmt: skip
    np.testing.assert_allclose(h.response, kept(other.get_H1()), rtol=1e-9)
    np.testing.assert_allclose(h.coherence, kept(other.get_coherence()).real, rtol=1e-9)


def test_hits() -> None:
    """Hits without a window, each a measurement of its own."""
    size, count = 2400, 4
    made = []
    for number in range(count):
        rng = np.random.default_rng((3, number))
        u = np.zeros(size)
        u[0:4] = rng.uniform(20.0, 40.0) * np.array([0.0, 0.6, 1.0, 0.5])
        x = scipy.signal.lfilter([0.0, 0.4, 0.1], [1.0, -1.7, 0.93], u)
        y = scipy.signal.lfilter([0.0, -0.3, 0.2], [1.0, 0.3, 0.88], u)
        noise = 0.05 * rng.standard_normal((2, size))
        channels = tuple(
            Channel(name=n, values=v)
            for n, v in (("u", u), ("x", x + noise[0]), ("y", y + noise[1]))
        )
        made.append(Record(channels=channels, time=np.arange(size) / RATE))
    other = peer(made, window="none")
    h = estimate_response(
        made, "u", ["x", "y"], segment=size, excitation="hammer", hits=HitOptions(pre_trigger=1)
    )
    assert h.spectra.segments == count
    lines = np.round(h.response.frequency_hz * size / RATE).astype(int)
    wanted = np.moveaxis(other.get_H1(), -1, 0)[lines]
    # pyFRF takes the mean off each hit, which without a window is the line at 0 alone
    np.testing.assert_allclose(h.response.response, wanted, rtol=1e-9)
