"""What a live chart is given equals what the least and greatest of all samples are."""

import threading

import numpy as np
import pytest
from numpy.typing import NDArray

from flexstage.base.errors import ModelError
from flexstage.web.live_chart import encode_window, spectrum
from flexstage.web.live_history import POSITION, VOLTAGE, HistoryWindow, LiveChannel, LiveHistory

TEN_SECONDS = {"mode": "time", "length": "10"}
CHANNELS = (LiveChannel("u", VOLTAGE), LiveChannel("x", POSITION))
Floats = NDArray[np.float64]


def samples(
    count: int, rate_hz: float, begin: float = 17.3, seed: int = 3
) -> tuple[Floats, Floats]:
    """Times that are nearly even, and values of two channels."""
    random = np.random.default_rng(seed)
    times = begin + (np.arange(count) + random.uniform(-0.3, 0.3, count)) / rate_hz
    return times, random.standard_normal((count, 2)).cumsum(axis=0) * [1.0, 1e-6]


def filled(times: Floats, values: Floats, rate_hz: float, hours: float, parts: int) -> LiveHistory:
    """A history that got its samples in parts of different lengths."""
    history = LiveHistory(CHANNELS, rate_hz, hours)
    cuts = np.sort(np.random.default_rng(parts).integers(0, times.size, parts))
    for some, read in zip(np.split(times, cuts), np.split(values, cuts), strict=True):
        history.append(some, read)
    return history


def require_envelope(found: HistoryWindow, times: Floats, values: Floats) -> None:
    """Compare bins with the samples that lie in each, one by one."""
    assert found.tier > 0
    assert found.times.size > 0
    for middle, low, high in zip(found.times, found.low, found.high, strict=True):
        inside = np.abs(times - middle) < 0.5 * found.step
        np.testing.assert_array_equal(low, values[inside].min(axis=0))
        np.testing.assert_array_equal(high, values[inside].max(axis=0))


@pytest.mark.parametrize("length", [40.0, 157.0, 900.0, 3000.0])
def test_an_envelope_is_the_least_and_greatest_of_all_samples(length: float) -> None:
    times, values = samples(60_000, 20.0)
    history = filled(times, values, 20.0, hours=1.0, parts=300)
    end = float(times[-1])
    found = history.window(end - length, end, 500)
    require_envelope(found, times, values)
    # no bin is missing, and none is longer than the number of points asks for
    inside = times[(times >= found.times[0] - 0.5 * found.step)]
    assert found.times.size == np.unique(np.floor((inside - times[0]) / found.step)).size
    assert length / 500 <= found.step < 4.0 * length / 500
    assert found.times.size <= 501


def test_old_samples_make_room_for_new_ones() -> None:
    # more than three times round, the last time with a gap and in one piece
    times, values = samples(47_000, 10.0)
    times[40_000:] += 200.0
    history = LiveHistory(CHANNELS, 10.0, hours=0.3)
    for k in range(0, 40_000, 777):
        part = slice(k, min(k + 777, 40_000))
        history.append(times[part], values[part])
    history.append(times[40_000:], values[40_000:])
    end = float(times[-1])
    whole = history.window(end - 1080.0, end)
    require_envelope(whole, times, values)
    # what begins before all that is kept gives what is kept, down to its begin
    early = history.window(0.0, end, 500)
    require_envelope(early, times, values)
    assert end - early.times[0] >= 1080.0 - early.step
    assert early.times[-1] == pytest.approx(end, abs=early.step)
    gone = history.window(20.0, 300.0, 100)
    assert gone.times.size == 0


def test_a_window_across_a_gap_has_no_points_there() -> None:
    times, values = samples(20_000, 50.0)
    times[10_000:] += 60.0
    history = filled(times, values, 50.0, hours=0.5, parts=40)
    found = history.window(float(times[8000]), float(times[12_000]), 400)
    require_envelope(found, times, values)
    assert np.diff(found.times).max() > 60.0 - 2 * found.step
    assert np.sort(np.diff(found.times))[-2] == pytest.approx(found.step)


def test_few_samples_come_as_they_are_and_many_do_not() -> None:
    times, values = samples(150_000, 100.0)
    history = filled(times, values, 100.0, hours=2.0, parts=70)
    end = float(times[-1])
    found = history.window(end - 10.0, end)
    inside = times >= end - 10.0
    assert found.tier == 0
    np.testing.assert_array_equal(found.times, times[inside])
    np.testing.assert_array_equal(found.low, values[inside])
    # as short a window of long ago is no longer held sample by sample
    old = history.window(100.0, 110.0)
    require_envelope(old, times, values)
    assert old.step == pytest.approx(0.04)
    some = history.samples(end - 60.0, end, 1000)
    np.testing.assert_array_equal(
        some.times, times[-6000:][np.isin(np.arange(144_000, 150_000) % 7, 0)]
    )


@pytest.mark.parametrize(
    ("length", "loop"), [(10.0, False), (10.0, True), (60.0, True), (600.0, False)]
)
def test_what_a_page_lacks_completes_what_it_has(length: float, loop: bool) -> None:
    """Follow as the script of the page does; what it ends with is what one question gets."""
    times, values = samples(90_000, 100.0)
    history = LiveHistory(CHANNELS, 100.0)
    history.append(times[:80_000], values[:80_000])
    asked = {"mode": "loop" if loop else "time", "length": str(length)}
    page = _Page()
    page.take(encode_window(history, asked))
    for k in range(80_000, 90_000, 1237):
        history.append(times[k : k + 1237], values[k : k + 1237])
        page.take(encode_window(history, asked | page.known()))
    fresh = _Page()
    fresh.take(encode_window(history, asked))
    kept = page.times >= fresh.times[0]
    np.testing.assert_array_equal(page.times[kept], fresh.times)
    np.testing.assert_array_equal(page.low[kept], fresh.low)
    np.testing.assert_array_equal(page.high[kept], fresh.high)
    # and it was asked for little
    assert page.got[-1] < 0.5 * page.got[0]


class _Page:
    """What the script of a page keeps."""

    def __init__(self) -> None:
        self.times = np.empty(0)
        self.low = self.high = np.empty((0, 2), dtype=np.float32)
        self.head = np.empty(0)
        self.got: list[int] = []

    def known(self) -> dict[str, str]:
        last = self.times[-2 if self.head[2] > 0 else -1]
        return {
            "generation": str(int(self.head[0])),
            "tier": str(int(self.head[1])),
            "after": str(last),
        }

    def take(self, body: bytes) -> None:
        self.head = np.frombuffer(body, "<f8", 9)
        count, both = int(self.head[6]), self.head[7] > 0
        times = np.frombuffer(body, "<f8", count, 88)
        parts = np.frombuffer(body, "<f4", -1, 88 + 8 * count).reshape(1 + both, count, 2)
        kept = self.times < times[0] if count else np.ones(self.times.size, dtype=bool)
        self.times = np.concatenate([self.times[kept], times])
        self.low = np.concatenate([self.low[kept], parts[0]])
        self.high = np.concatenate([self.high[kept], parts[-1]])
        self.got.append(count)


def test_a_channel_without_a_value_leaves_a_gap() -> None:
    times, values = samples(8000, 100.0)
    values[2000:4000, 1] = np.nan
    history = filled(times, values, 100.0, hours=0.1, parts=20)
    found = history.window(float(times[0]), float(times[-1]), 200)
    without = np.isnan(found.high[:, 1])
    assert 0.2 < without.mean() < 0.3
    assert np.isfinite(found.high[:, 0]).all()
    np.testing.assert_array_equal(without, np.isnan(found.low[:, 1]))


def test_what_is_no_sample_and_no_question_is_refused() -> None:
    history = LiveHistory(CHANNELS, 100.0)
    history.append([], np.empty((0, 2)))
    assert history.span is None
    with pytest.raises(ModelError, match=r"have shape \(2, 2\), got \(2, 3\)"):
        history.append([0.0, 1.0], np.zeros((2, 3)))
    with pytest.raises(
        ModelError, match="times of samples must increase: 0 s to 0 s came after -inf s"
    ):
        history.append([0.0, 0.0], np.zeros((2, 2)))
    with pytest.raises(ModelError, match="times of samples must increase"):
        history.append([np.nan], np.zeros((1, 2)))
    wrong = (
        {"length": "nan"},
        {"length": "-1"},
        {"end": "inf"},
        {"mode": "radar"},
        {"end": "-1e308"},
    )
    for asked in ({}, {"mode": "time"}, *(TEN_SECONDS | more for more in wrong)):
        with pytest.raises((KeyError, ValueError)):
            encode_window(history, asked)
    assert np.frombuffer(encode_window(history, TEN_SECONDS), "<f8")[6] == 0


@pytest.mark.parametrize("straying", [0.0, 0.1])
def test_a_spectrum_has_the_power_of_what_was_measured(straying: float) -> None:
    rate_hz, count = 100.0, 6000
    random = np.random.default_rng(5)
    times = 5.0 + (np.arange(count) + straying * random.standard_normal(count)) / rate_hz
    random = np.random.default_rng(5)
    values = random.standard_normal((count, 2)) * [0.3, 2e-9]
    values[:, 1] += 50e-9 * np.sin(2.0 * np.pi * 12.5 * times)
    history = filled(times, values, rate_hz, hours=0.1, parts=9)
    found = spectrum(history, 0.0, 100.0)
    lines = found.times
    assert lines[-1] == pytest.approx(50.0, rel=1e-4)
    # white noise has its variance over the band at every line, a sine half its amplitude squared
    assert np.sqrt(np.mean(found.low[:, 0] ** 2)) == pytest.approx(0.3 / np.sqrt(50.0), rel=0.03)
    near = np.abs(lines - 12.5) < 2.0
    power = np.sum(found.low[near, 1] ** 2) * (lines[1] - lines[0])
    # and loses what the straying of its times takes: 0.6 % at an eighth of the rate
    assert power == pytest.approx(0.5 * 50e-9**2, rel=0.02)
    with pytest.raises(ModelError, match=r"a spectrum needs 64 samples, got (49|5\d)"):
        spectrum(history, 5.0, 5.5)
    history.append([70.0], values[:1])
    with pytest.raises(ModelError, match=r"the last 100 s have a gap of 5\.\d+ s"):
        spectrum(history, 0.0, 100.0)


def test_hours_are_small() -> None:
    history = LiveHistory([LiveChannel(n, POSITION) for n in "abcd"], 100.0, hours=2.0)
    held = [
        history._times,
        history._values,
        *(a for t in history._tiers for a in (t.low, t.high, t.numbers)),
    ]
    assert sum(a.nbytes for a in held) < 25e6


def test_threads_may_append_and_look_at_once() -> None:
    times, values = samples(20_000, 100.0)
    history = LiveHistory(CHANNELS, 100.0, hours=0.1)
    history.append(times[:1], values[:1])
    wrong: list[str] = []

    def look() -> None:
        while not over.is_set():
            _, end = history.span or (0.0, 0.0)
            for found in (history.window(end - 100.0, end, 200), history.samples(end - 5.0, end)):
                if (np.diff(found.times) <= 0.0).any() or (found.low > found.high).any():
                    wrong.append("torn")

    over = threading.Event()
    looker = threading.Thread(target=look)
    looker.start()
    for k in range(1, 20_000, 50):
        history.append(times[k : k + 50], values[k : k + 50])
    over.set()
    looker.join()
    assert not wrong
