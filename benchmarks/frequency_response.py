"""Records to frequency responses and modes, against bare transforms and SciPy's csd and welch.

`python -m benchmarks.frequency_response [long] [lengths] [growth]` runs it alone. Everything runs
in one thread, by turns, and times are those of the processor. The bare transforms are those of the
same overlapping segments, in blocks into one array, with neither mean nor window taken care of,
nothing summed and nothing looked at; NumPy's and SciPy's are both timed, as either can be the
faster, and the faster comes first.
"""

import argparse
import math
from collections.abc import Callable, Iterator
from itertools import groupby

import numpy as np
import scipy.fft
import scipy.signal

from benchmarks.cases import Row
from benchmarks.timing import Timed, in_turns
from flexstage.base.arrays import Array
from flexstage.measure.modal.fit import fit_modes
from flexstage.measure.modal.result import ModalFit
from flexstage.measure.spectra.estimate import ResponseEstimate, estimate_response
from flexstage.records import Channel, Record

__all__ = ["growth", "lengths", "long_record", "response"]


SAMPLES = 10_000_000
RATE_HZ = 20_000.0
#: Frequency [Hz], damping ratio and size of the modes, and the band that is fitted [Hz].
MODES = ((339.0, 0.013, 3e-9), (612.0, 0.011, 2e-9))
BAND = (170.0, 900.0)
#: Segments that have 14 and 22 lines to the half-power width of the modes.
RESOLVING = 32_768
#: Samples that the bare transforms take at a time; best of several on a cache of 1 MB.
BLOCK = 131_072


def record(count: int = SAMPLES, seed: int = 5) -> Record:
    """Return a random drive and the motion of two modes, with noise."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(count)
    y = 2e-9 * rng.standard_normal(count)
    for frequency, zeta, size in MODES:
        turn = 2.0 * math.pi * frequency / RATE_HZ
        pole = np.exp(complex(-zeta, math.sqrt(1.0 - zeta**2)) * turn)
        y += scipy.signal.lfilter([0.0, size], [1.0, -2.0 * pole.real, abs(pole) ** 2], u)
    return Record(
        channels=(
            Channel(name="voltage", values=u, unit="V"),
            Channel(name="displacement", values=y, unit="m"),
        ),
        time=np.arange(count) / RATE_HZ,
    )


def numpy_transforms(channels: list[Array], length: int) -> None:
    """Transform the segments and throw the transforms away."""
    rows = max(2, BLOCK // length)
    out = np.empty((rows, length // 2 + 1), dtype=np.complex128)
    for values in channels:
        view = np.lib.stride_tricks.sliding_window_view(values, length)[:: length // 2]
        for first in range(0, len(view), rows):
            part = view[first : first + rows]
            np.fft.rfft(part, axis=-1, out=out[: len(part)])


def scipy_transforms(channels: list[Array], length: int) -> None:
    """Transform the segments with SciPy."""
    rows = max(2, BLOCK // length)
    for values in channels:
        view = np.lib.stride_tricks.sliding_window_view(values, length)[:: length // 2]
        for first in range(0, len(view), rows):
            scipy.fft.rfft(view[first : first + rows])


def scipy_response(channels: list[Array], length: int) -> Array:
    """Return H1 by SciPy's csd and welch, and the coherence."""
    u, y = channels
    _, xx = scipy.signal.welch(u, RATE_HZ, nperseg=length)
    _, yy = scipy.signal.welch(y, RATE_HZ, nperseg=length)
    _, xy = scipy.signal.csd(u, y, RATE_HZ, nperseg=length)
    return np.stack([xy / xx, np.abs(xy) ** 2 / (xx * yy)])


def estimated(given: Record, segment: int | None) -> ResponseEstimate:
    """Return our response, with variance and coherence."""
    return estimate_response(given, "voltage", "displacement", excitation="random", segment=segment)


def fitted(found: ResponseEstimate) -> ModalFit:
    """Return the modes in the band."""
    return fit_modes(found.response, band=BAND)


def _rows(case: str, given: Record, segment: int | None, runs: int, fit: bool) -> Iterator[Row]:
    channels = [c.values for c in given.channels]
    start = estimated(given, segment)
    size = start.segment
    routes: list[tuple[str, Callable[[], object], str]] = [
        ("bare transforms, NumPy", lambda: numpy_transforms(channels, size), "transforms"),
        ("bare transforms, SciPy", lambda: scipy_transforms(channels, size), "transforms"),
        (
            "flexstage, response, variance, coherence; samples looked at",
            lambda: estimated(given, segment),
            "transforms; then window, sums, looking at the samples",
        ),
        (
            "scipy.signal, welch, welch, csd",
            lambda: scipy_response(channels, size),
            "twice the transforms, and copies of all segments",
        ),
    ]
    if fit:
        f = start.response.frequency_hz
        lines = int(np.count_nonzero((f >= BAND[0]) & (f <= BAND[1])))
        routes += [
            (
                "flexstage, record to modes",
                lambda: fitted(estimated(given, segment)),
                f"transforms; {_words(fitted(start))}",
            ),
            (
                f"flexstage, of that the modes, {lines} lines",
                lambda: fitted(start),
                "eigenvalues of the stabilisation diagram, of orders up to 40",
            ),
        ]
    times = in_turns([work for _, work, _ in routes], runs=runs)
    timed: list[tuple[str, Timed, str]] = [
        (name, took, words) for (name, _, words), took in zip(routes, times, strict=True)
    ]
    timed[:2] = sorted(timed[:2], key=lambda row: row[1].seconds)
    for route, took, limit in timed:
        ratio = took.seconds / timed[0][1].seconds
        yield Row(case=case, route=route, time=took, ratio=ratio, limit=limit)


def _words(fit: ModalFit) -> str:
    """Say how many modes were found, and how near the true ones are."""
    found = np.array([mode.frequency_hz.value for mode in fit.modes])
    off = max(100.0 * float(np.abs(found / mode[0] - 1.0).min()) for mode in MODES)
    return f"{found.size} modes found, frequencies within {off:.1g} % of the truth"


def long_record(samples: int = SAMPLES, runs: int = 5) -> Iterator[Row]:
    """Time a long record, to its modes, in the segments that are chosen for it."""
    given = record(samples)
    size = estimated(given, None).segment
    case = f"record of {samples:.0e} samples to modes, segments of {size}"
    yield from _rows(case, given, None, runs, fit=True)


def lengths(
    samples: int = SAMPLES, sizes: tuple[int, ...] = (1024, 4096, 65_536), runs: int = 3
) -> Iterator[Row]:
    """Time a long record in segments of other lengths, to its response."""
    given = record(samples)
    for size in sizes:
        case = f"response of {samples:.0e} samples, segments of {size}"
        yield from _rows(case, given, size, runs, fit=False)


def growth(
    sizes: tuple[int, ...] = (100_000, 300_000, 1_000_000, 3_000_000), runs: int = 4
) -> Iterator[Row]:
    """Time how every route grows with the number of samples, the lines being the same."""
    for size in sizes:
        case = f"record of {size:.0e} samples to modes, segments of {RESOLVING}"
        yield from _rows(case, record(size), RESOLVING, runs, fit=True)


CASES = {"long": long_record, "lengths": lengths, "growth": growth}


def response() -> Iterator[Row]:
    """Time a long record, lengths of segments, and growth."""
    for case in CASES.values():
        yield from case()


def main() -> None:
    """Print the table of the cases that are named, or of all."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.frequency_response", description=__doc__
    )
    parser.add_argument("names", nargs="*", metavar="CASE", help=", ".join(CASES))
    names = parser.parse_args().names or list(CASES)
    for case, group in groupby((row for name in names for row in CASES[name]()), lambda r: r.case):
        print(f"\n{case}")
        for row in group:
            print(f"  {row.route:<60} {row.time!s:>9} {row.ratio:>7.2f}   {row.limit}")


if __name__ == "__main__":
    main()
