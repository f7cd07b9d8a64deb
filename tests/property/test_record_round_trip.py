"""A record that is written and read back is the same record, to the last bit."""

import string
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from flexstage.records import Channel, Record, read_record, resampled, saturation
from flexstage.records.quality import difference_noise
from flexstage.records.write import record_bytes

UNITS = st.sampled_from(["", "V", "m", "N", "s", "K", "degC", "1", "count", "m/s", "rad", "N/m"])
ALPHABET = string.ascii_letters + string.digits + " _-+./()[],;:'\"#%µΔ°\t="
NAMES = st.text(ALPHABET, min_size=1, max_size=12).map(lambda s: " ".join(s.split()))
SUFFIXES = {"csv": ".csv", "npz": ".npz", "hdf5": ".h5", "mat": ".mat"}


@st.composite
def records(draw: st.DrawFn) -> Record:
    count = draw(st.integers(2, 9))
    names = draw(
        st.lists(
            NAMES.filter(lambda n: n.strip("()[] ") != "" and n.lower() != "time"),
            max_size=4,
            unique_by=str.lower,
        )
    )
    rate = draw(st.floats(0.013, 4.7e5))
    start = draw(st.floats(-31.0, 31.0))
    time = start / rate + np.arange(count) / rate
    finite = st.floats(allow_nan=False, allow_infinity=False)
    channels = [
        Channel(name=n, values=draw(arrays.arrays(np.float64, count, elements=finite)), unit=u)
        for n, u in ((n, draw(UNITS)) for n in names)
    ]
    if draw(st.booleans()):
        channels.insert(
            draw(st.integers(0, len(channels))), Channel(name="time", values=time, unit="s")
        )
    return Record(channels=tuple(channels), time=time)


@settings(deadline=None, max_examples=30)
@given(record=records())
def test_a_record_comes_back_bit_for_bit(record: Record) -> None:
    held = record.channels
    if all(c.name != "time" for c in held):
        held = (Channel(name="time", values=record.time, unit="s"), *held)
    for format, suffix in SUFFIXES.items():
        content = record_bytes(record, format)
        assert content == record_bytes(record, format)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"record{suffix}"
            path.write_bytes(content)
            back = read_record(path)
        assert [c.name for c in back.channels] == [c.name for c in held], format
        assert [c.unit for c in back.channels] == [c.unit for c in held], format
        assert np.array_equal(back.time, record.time), format
        for read, written in zip(back.channels, held, strict=True):
            assert read.values.tobytes() == written.values.tobytes(), (format, written.name)
        # what was read is written to the same bytes again
        assert record_bytes(back, format) == content, format


@settings(deadline=None, max_examples=30)
@given(
    st.sampled_from(["\t", ";", ",", " "]),
    st.sampled_from([".", ","]),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"]),
    st.booleans(),
    arrays.arrays(
        np.float64,
        st.tuples(st.integers(2, 6), st.integers(2, 4)),
        elements=st.floats(-1e9, 1e9, allow_subnormal=False),
    ),
)
def test_text_of_any_country(
    delimiter: str, decimal: str, newline: str, encoding: str, trailing: bool, values: np.ndarray
) -> None:
    if delimiter == decimal:
        decimal = "."
    heading = delimiter.join(f"signal{j}(µm)" for j in range(values.shape[1]))
    end = delimiter if trailing and delimiter != " " else ""
    rows = [
        delimiter.join(repr(v).replace(".", decimal) for v in row) + end for row in values.tolist()
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "export.dat"
        path.write_bytes((newline.join([heading + end, *rows]) + newline).encode(encoding))
        record = read_record(path, sample_rate=70.0)
    assert [c.name for c in record.channels] == [f"signal{j}" for j in range(values.shape[1])]
    read = np.column_stack([c.values for c in record.channels])
    np.testing.assert_array_equal(read, values / 1e6)
    assert {c.unit for c in record.channels} == {"m"}


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 3.0), st.floats(-7.0, 7.0))
def test_resampling_a_line_and_a_cubic_is_exact(seed: int, ratio: float, slope: float) -> None:
    random = np.random.default_rng(seed)
    time = 3.1 + np.cumsum(random.uniform(0.8, 1.2, 37)) * 0.011
    x = time - 3.2
    line, cubic = 0.7 + slope * x, 1.3 - slope * x + 21.0 * x**2 - 43.0 * x**3
    record = Record(
        channels=(Channel(name="line", values=line), Channel(name="cubic", values=cubic)), time=time
    )
    rate = record.sample_rate_hz * ratio
    even = resampled(record, rate)
    assert even.uniform
    assert even.time[0] == time[0]
    assert time[-1] - 1.0 / rate <= even.time[-1] + 1e-9 <= time[-1] + 2e-9
    x = even.time - 3.2
    np.testing.assert_allclose(
        even.channel("cubic").values, 1.3 - slope * x + 21.0 * x**2 - 43.0 * x**3, atol=1e-11
    )
    straight = resampled(record, rate, kind="linear")
    np.testing.assert_allclose(straight.channel("line").values, 0.7 + slope * x, atol=1e-12)
    # an even record at its own rate stays what it is
    again = resampled(even)
    assert again.size == even.size
    np.testing.assert_allclose(
        again.channel("cubic").values, even.channel("cubic").values, atol=1e-10
    )


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.floats(1e-9, 1e6), st.floats(-1e3, 1e3))
def test_noise_scales_and_ignores_motion(seed: int, scale: float, offset: float) -> None:
    random = np.random.default_rng(seed)
    white = random.standard_normal(4000)
    motion = 40.0 * np.sin(np.arange(4000) / 60.0) + offset
    plain = difference_noise(white, 4)
    assert plain == pytest.approx(1.0, rel=0.12)
    assert difference_noise(scale * white, 4) == pytest.approx(scale * plain, rel=1e-9)
    assert difference_noise(white + motion, 4) == pytest.approx(plain, rel=0.02)
    white[random.choice(4000, 40, replace=False)] += 300.0
    assert difference_noise(white, 4) == pytest.approx(plain, rel=0.12)


# a few samples in the highest step, and fewer in the next
@example(694, 0.5, 0.002)
@example(1811161, 0.5, 0.002)
@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.3, 0.95), st.sampled_from([0.0, 0.01, 0.002]))
def test_clipping_is_found_and_nothing_else(seed: int, level: float, step: float) -> None:
    random = np.random.default_rng(seed)
    phase, rate = random.uniform(0.0, 6.0), random.uniform(0.011, 0.05)
    sine = 1.37 * np.sin(phase + rate * np.arange(3000))
    read = np.round(sine / step) * step if step else sine
    assert not saturation(read).clipped
    clipped = saturation(np.minimum(read, level * 1.37))
    assert clipped.clipped_high
    assert not clipped.clipped_low
