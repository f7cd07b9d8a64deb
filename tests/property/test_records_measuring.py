"""Functions and coordinates come back as they were written, in any layout of their formats."""

import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.records import Record, read_record
from tests.measuring_files import function_58, report

FINITE = st.floats(-1e30, 1e30, allow_nan=False, allow_subnormal=False)
PRINTED = st.integers(-9_999_999, 9_999_999)


def read(content: bytes, name: str) -> Record:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        return read_record(path)


@settings(deadline=None, max_examples=40)
@given(
    st.lists(st.tuples(FINITE, FINITE), min_size=2, max_size=11),
    st.booleans(),
    st.sampled_from(["", "<", ">"]),
    st.booleans(),
    st.integers(0, 2**32 - 1),
)
def test_a_function_comes_back(
    pairs: list[tuple[float, float]], of_complex: bool, binary: str, uneven: bool, seed: int
) -> None:
    h = np.array([complex(*pair) if of_complex else pair[0] for pair in pairs])
    x = np.cumsum(np.random.default_rng(seed).integers(1, 900, h.size)) / 4.0
    record = read(
        function_58(
            h,
            x=x.tolist() if uneven else None,
            start=float(x[0]),
            step=0.75,
            binary=binary,
            ordinate=(12, "m/s^2"),
        ),
        "a.uff",
    )
    wanted = x if uneven else x[0] + 0.75 * np.arange(h.size)
    # an abscissa is printed with six digits
    np.testing.assert_allclose(record.time, wanted, rtol=0.0 if binary and uneven else 6e-6)
    parts = [h.real, h.imag] if of_complex else [h]
    for channel, part in zip(record.channels, parts, strict=True):
        if binary:
            assert channel.values.tobytes() == part.tobytes()
        else:
            np.testing.assert_allclose(channel.values, part, rtol=6e-13)


@settings(deadline=None, max_examples=40)
@given(
    st.lists(st.tuples(*(st.tuples(PRINTED, PRINTED) for _ in range(3))), min_size=2, max_size=4),
    st.permutations(["NOMINAL", "+TOL", "-TOL", "MEAS", "DEV", "OUTTOL"]),
    st.sampled_from([(".", 4), (",", 4), (".", 3), (",", 2)]),
    st.integers(14, 18),
)
def test_coordinates_come_back_as_printed(
    points: list, order: list[str], style: tuple[str, int], width: int
) -> None:
    decimal, digits = style
    scale = 10.0**digits
    blocks = [
        [("S-1.b", [(a, p[0] / scale, p[1] / scale) for a, p in zip("XYZ", point, strict=True)])]
        for point in points
    ]
    content = report(blocks, order=order, decimal=decimal, digits=digits, width=width)
    record = read(content.encode(), "a.txt")
    for j, axis in enumerate("XYZ"):
        for k, name in enumerate((f"S-1.b.{axis} nominal", f"S-1.b.{axis}")):
            wanted = [float(f"{point[j][k] / scale:.{digits}f}") / 1000.0 for point in points]
            assert record.channel(name).values.tolist() == wanted
