"""Harmonic and eccentricity fits of heads, against plain least squares and the FFT; their growth.

`python -m benchmarks.centring [fit] [heads] [turns]` runs it alone, in one thread, by turns, with
times of the processor. The heads share their angles, so that the whole matrix of `lstsq` is that of
one head, and serves all. The FFT needs even samples of whole turns, and it and `lstsq` give neither
uncertainty nor outliers nor exact geometry.
"""

import argparse
from collections.abc import Callable, Iterator
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from benchmarks.cases import Row
from benchmarks.timing import Timed, in_turns
from flexstage.base.arrays import Array
from flexstage.centring import HeadReadings, eccentricity, fit_harmonics, fit_many

__all__ = ["centring", "fit", "heads", "turns"]

Route = tuple[str, Callable[[], object], str]

HEADS, TURNS, ORDERS = 24, 100, 12
PER_TURN = (360, 3600)
RADIUS = 50e-3


def record(
    turns: int, count: int, per_turn: int, seed: int = 5
) -> tuple[Array, Array, list[HeadReadings]]:
    """Return angles and errors: eccentricity of 50 um, two harmonics, drift, 1 arcsec of noise."""
    rng = np.random.default_rng(seed)
    theta: Array = np.arange(turns * per_turn, dtype=np.float64) * (2.0 * np.pi / per_turn)
    errors = np.empty((theta.size, count))
    alphas = 0.2 + 2.0 * np.pi * np.arange(count) / count
    for j, alpha in enumerate(alphas):
        beta = theta + alpha
        errors[:, j] = 1e-3 * np.sin(beta - 0.7) + 2e-5 * np.cos(2.0 * theta)
        errors[:, j] += 1e-6 * np.sin(11.0 * theta) + 1e-8 * theta
        errors[:, j] += rng.normal(0.0, 5e-6, theta.size)
    heads = [
        HeadReadings(angle=theta, error=column, head_angle=alpha)
        for column, alpha in zip(errors.T, alphas.tolist(), strict=True)
    ]
    return theta, errors, heads


def plain(theta: Array, errors: Array) -> Array:
    """Fit by NumPy's least squares of the whole matrix."""
    columns = [np.ones(theta.size), theta]
    for n in range(1, ORDERS + 1):
        columns += [np.cos(n * theta), np.sin(n * theta)]
    return np.asarray(np.linalg.lstsq(np.column_stack(columns), errors)[0], dtype=np.float64)


def fourier(turns: int, errors: Array) -> NDArray[np.complex128]:
    """Take the harmonics out of NumPy's FFT of the even samples, head by head."""
    found = [np.fft.rfft(y)[turns : turns * ORDERS + 1 : turns] for y in errors.T]
    return np.column_stack(found)


def fit(
    count: int = HEADS, turns: int = TURNS, per_turn: tuple[int, ...] = PER_TURN, runs: int = 3
) -> Iterator[Row]:
    """Time the fits of 24 heads over 100 turns."""
    for samples in per_turn:
        theta, errors, readings = record(turns, count, samples)
        # in the memory each head follows on the one before, as where each has a file of its own
        errors = np.asfortranarray(errors)
        routes: list[Route] = [
            (
                "flexstage, harmonics of all heads",
                lambda t=theta, y=errors: fit_many(t, y, orders=ORDERS),
                "cosines and sines by recurrence; residuals of all samples",
            ),
            (
                "flexstage, harmonics without outliers",
                lambda t=theta, y=errors: fit_many(t, y, orders=ORDERS, robust=False),
                "the same",
            ),
            (
                "flexstage, head by head",
                lambda t=theta, y=errors: [fit_harmonics(t, one, orders=ORDERS) for one in y.T],
                "cosines and sines of each head",
            ),
            (
                "flexstage, eccentricity of all heads, exact geometry",
                lambda r=readings: eccentricity(r, radius=RADIUS, orders=ORDERS),
                "two fits, the exact errors of all samples, likeness of heads",
            ),
            (
                "NumPy, FFT head by head",
                lambda y=errors: fourier(turns, y),
                "transforms of lengths that are no powers of two",
            ),
            (
                "NumPy, lstsq of the whole matrix",
                lambda t=theta, y=errors: plain(t, y),
                "the matrix, decomposed",
            ),
        ]
        case = f"{count} heads, {turns} turns of {samples} samples, {ORDERS} harmonics and drift"
        yield from _rows(case, routes, runs)


def heads(
    counts: tuple[int, ...] = (1, 2, 4, 8, 24), samples: int = 360, runs: int = 3
) -> Iterator[Row]:
    """Time how the eccentricity of more and more heads grows."""
    routes: list[Route] = []
    for count in counts:
        readings = record(TURNS, count, samples)[2]
        routes.append(
            (
                f"{count} heads" if count > 1 else "one head",
                lambda r=readings: eccentricity(r, radius=RADIUS, orders=ORDERS),
                "products with each head; before that, cosines and sines",
            )
        )
    yield from _rows(f"eccentricity of heads, {TURNS} turns of {samples} samples", routes, runs)


def turns(
    counts: tuple[int, ...] = (1, 10, 100, 1000), samples: int = 360, runs: int = 3
) -> Iterator[Row]:
    """Time how the eccentricity from four heads over more and more turns grows."""
    routes: list[Route] = []
    for count in counts:
        readings = record(count, 4, samples)[2]
        routes.append(
            (
                f"{count} turns" if count > 1 else "one turn",
                lambda r=readings: eccentricity(r, radius=RADIUS, orders=ORDERS),
                "proportion to the samples; before that, Python",
            )
        )
    yield from _rows(f"eccentricity of four heads, turns of {samples} samples", routes, runs)


def _rows(case: str, routes: list[Route], runs: int) -> Iterator[Row]:
    times: list[Timed] = in_turns([work for _, work, _ in routes], runs=runs)
    for (route, _, limit), took in zip(routes, times, strict=True):
        ratio = took.seconds / times[0].seconds
        yield Row(case=case, route=route, time=took, ratio=ratio, limit=limit)


CASES = {"fit": fit, "heads": heads, "turns": turns}


def centring() -> Iterator[Row]:
    """Time fits of harmonics and of the eccentricity, and how they grow with heads and turns."""
    for case in CASES.values():
        yield from case()


def main() -> None:
    """Print the table of the cases that are named, or of all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.centring", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="CASE", help=", ".join(CASES))
    names = parser.parse_args().names or list(CASES)
    for case, group in groupby((row for name in names for row in CASES[name]()), lambda r: r.case):
        print(f"\n{case}")
        for row in group:
            print(f"  {row.route:<55}  {row.time!s:>9}  {row.ratio:>7.3g}   {row.limit}")


if __name__ == "__main__":
    main()
