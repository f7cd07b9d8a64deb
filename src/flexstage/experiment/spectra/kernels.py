"""Compiled loops over samples and lines: each goes once through what it reads."""

from typing import Any

import numpy as np

from flexstage.hysteresis.compiled import compiled

# Four running values each, as processors take four at a time; the order of sums is that of the
# code, so that results do not depend on the machine.


@compiled
def windowed(
    values: Any, start: int, hop: int, window: Any, out: Any, means: Any, ends: Any
) -> None:
    """Multiply segments by a window, and note their means and extremes.

    Into `out`, shape (segments, length), `means` and `ends`, the least and greatest sample of all;
    NaN counts as neither.
    """
    n = window.size
    whole = n - n % 4
    low0 = low1 = low2 = low3 = np.inf
    high0 = high1 = high2 = high3 = -np.inf
    for i in range(means.size):
        x = values[start + i * hop : start + i * hop + n]
        y = out[i]
        sum0 = sum1 = sum2 = sum3 = 0.0
        for k in range(0, whole, 4):
            a, b, c, d = x[k], x[k + 1], x[k + 2], x[k + 3]
            y[k] = a * window[k]
            y[k + 1] = b * window[k + 1]
            y[k + 2] = c * window[k + 2]
            y[k + 3] = d * window[k + 3]
            sum0 += a
            sum1 += b
            sum2 += c
            sum3 += d
            low0 = a if a < low0 else low0
            low1 = b if b < low1 else low1
            low2 = c if c < low2 else low2
            low3 = d if d < low3 else low3
            high0 = a if a > high0 else high0
            high1 = b if b > high1 else high1
            high2 = c if c > high2 else high2
            high3 = d if d > high3 else high3
        for k in range(whole, n):
            a = x[k]
            y[k] = a * window[k]
            sum0 += a
            low0 = a if a < low0 else low0
            high0 = a if a > high0 else high0
        means[i] = ((sum0 + sum1) + (sum2 + sum3)) / n
    ends[0] = min(low0, low1, low2, low3)
    ends[1] = max(high0, high1, high2, high3)


@compiled
def extreme_steps(time: Any) -> tuple[float, float]:
    """Return the least and the greatest step of times."""
    whole = time.size - 1 - (time.size - 1) % 4
    low0 = low1 = low2 = low3 = np.inf
    high0 = high1 = high2 = high3 = -np.inf
    for k in range(0, whole, 4):
        a = time[k + 1] - time[k]
        b = time[k + 2] - time[k + 1]
        c = time[k + 3] - time[k + 2]
        d = time[k + 4] - time[k + 3]
        low0 = a if a < low0 else low0
        low1 = b if b < low1 else low1
        low2 = c if c < low2 else low2
        low3 = d if d < low3 else low3
        high0 = a if a > high0 else high0
        high1 = b if b > high1 else high1
        high2 = c if c > high2 else high2
        high3 = d if d > high3 else high3
    for k in range(whole, time.size - 1):
        a = time[k + 1] - time[k]
        low0 = a if a < low0 else low0
        high0 = a if a > high0 else high0
    return min(low0, low1, low2, low3), max(high0, high1, high2, high3)


@compiled
def add_products(transforms: Any, pairs: Any, power: Any, real: Any, imaginary: Any) -> None:
    """Add squares and products of the transforms of some segments to running sums.

    Transforms of c channels and s segments have real and imaginary parts by turns, shape (c, s, 2
    k); pairs (y, x) name the products Y conj(X), shape (p, 2).
    """
    channels, segments, lines = transforms.shape[0], transforms.shape[1], power.shape[1]
    for s in range(segments):
        for c in range(channels):
            z, total = transforms[c, s], power[c]
            for k in range(lines):
                a, b = z[2 * k], z[2 * k + 1]
                total[k] += a * a + b * b
        for p in range(pairs.shape[0]):
            y, x = transforms[pairs[p, 0], s], transforms[pairs[p, 1], s]
            re, im = real[p], imaginary[p]
            for k in range(lines):
                a, b, c_, d = y[2 * k], y[2 * k + 1], x[2 * k], x[2 * k + 1]
                re[k] += a * c_ + b * d
                im[k] += b * c_ - a * d
