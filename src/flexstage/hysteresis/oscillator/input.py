"""An input between its samples: one polynomial on each interval."""

from typing import Literal

import numpy as np

from flexstage.errors import ModelError
from flexstage.hysteresis.model import Array

#: How an input moves between its samples.
Interpolation = Literal["band-limited", "periodic", "linear"]

#: Coefficients of a piece. Full bandwidth turns by pi in an interval; its Chebyshev interpolant of
#: degree 13 is off by 2 (pi/4)**14 / 14! = 8e-13 of the amplitude.
COEFFICIENTS = 14
#: Samples on either side of an interval that determine its piece.
REACH = 32
#: Shape of the Kaiser window. With 64 samples, -150 dB for all that is below 0.42 of the rate.
KAISER = 16.0


def input_pieces(u: Array, interpolation: Interpolation) -> Array:
    """Return the polynomials that an input follows between its samples.

    On interval i, with s counted from its middle in samples, -1/2 to 1/2, the input is
    ``sum_j pieces[i, j] s**j``. Three ways:

    - ``band-limited``: a sum of sinc functions (Shannon, Proc. IRE 37, 1949) under a Kaiser window
      of 64 samples. Past its ends the input is mirrored in its first and its last point, which
      continues a value and a slope smoothly.
    - ``periodic``: the trigonometric polynomial through the samples, which are whole periods.
    - ``linear``: straight lines.

    Returned: shape (n - 1, 14), or (n - 1, 2) for straight lines.

    Notes
    -----
    Validity: content up to 0.42 of the sampling rate, to 3e-8 of its amplitude (``band-limited``);
    up to half of the sampling rate (``periodic``). Within 32 samples of an end ``band-limited``
    depends on how the input was mirrored.

    Examples
    --------
    >>> phase = 2.0 * np.pi * 0.2 * np.arange(101)
    >>> pieces = input_pieces(np.sin(phase), "band-limited")
    >>> print(f"{pieces[50, 0]:.6f} {np.sin(2.0 * np.pi * 0.2 * 50.5):.6f}")  # between two samples
    0.587785 0.587785
    """
    if interpolation == "linear":
        return np.stack([0.5 * (u[1:] + u[:-1]), np.diff(u)], axis=1)
    if interpolation == "periodic":
        return _periodic(u)
    if interpolation == "band-limited":
        return _band_limited(u)
    raise ModelError(
        f"there is no interpolation {interpolation!r}: take 'band-limited', 'periodic' or 'linear'"
    )


def _nodes() -> tuple[Array, Array]:
    """Return Chebyshev nodes from -1/2 to 1/2, and what turns values there into coefficients."""
    nodes = 0.5 * np.cos(np.pi * (np.arange(COEFFICIENTS) + 0.5) / COEFFICIENTS)
    # In units of half an interval the powers are as well conditioned as they can be.
    to_coefficients = np.linalg.inv(np.vander(2.0 * nodes, increasing=True))
    return nodes, 2.0 ** np.arange(COEFFICIENTS)[:, None] * to_coefficients


def _periodic(u: Array) -> Array:
    nodes, to_coefficients = _nodes()
    n = u.size
    spectrum = np.fft.rfft(u)
    turns = 2.0j * np.pi * np.arange(spectrum.size) / n
    values = np.empty((n - 1, COEFFICIENTS))
    for column, node in enumerate(nodes):
        # Of the last line of an even record, whose phase samples do not show, irfft takes the
        # real part: the cosine, which is the smallest wave through the samples.
        values[:, column] = np.fft.irfft(spectrum * np.exp(turns * (node + 0.5)), n)[:-1]
    return values @ to_coefficients.T


def _band_limited(u: Array) -> Array:
    nodes, to_coefficients = _nodes()
    offsets = np.arange(1 - REACH, REACH + 1) - 0.5  # of the samples, from the middle
    distance = nodes[:, None] - offsets[None, :]
    window = np.i0(KAISER * np.sqrt(np.maximum(1.0 - (distance / REACH) ** 2, 0.0)))
    weights = np.where(np.abs(distance) < REACH, np.sinc(distance) * window, 0.0)
    # A constant must stay what it is.
    weights /= np.sum(weights, axis=1, keepdims=True)
    kernel = (to_coefficients @ weights).T
    extended = _mirrored(u, REACH - 1)
    windows = np.lib.stride_tricks.sliding_window_view(extended, 2 * REACH)
    pieces = np.empty((u.size - 1, COEFFICIENTS))
    for start in range(0, u.size - 1, 4096):
        pieces[start : start + 4096] = windows[start : start + 4096] @ kernel
    return pieces


def _mirrored(u: Array, reach: int) -> Array:
    """Continue an input past its ends by turning it half round about its first and last point."""
    return np.pad(u, reach, mode="reflect", reflect_type="odd")
