"""Error budget of a rotary table: what each cause does to a reading, and the eccentricity allowed.

A translation of the axis, an error of the lines and a deformation of the scale reach the mean of
several heads in different ways; the budget keeps them apart.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.centring.geometry import ARCSEC
from flexstage.centring.table_file import CodeTracks, RotaryTable

#: Coverage factor of an expanded uncertainty of 95 %.
COVERAGE = 2.0
#: A sine over the turn, a value anywhere between two limits, a normal distribution.
_Distribution = Literal["sine", "limits", "normal"]
#: Variance of an error over the square of its size (GUM, JCGM 100:2008, 4.3).
_VARIANCES = {"sine": 0.5, "limits": 1.0 / 3.0, "normal": 1.0}
#: What rounding leaves of heads that cancel an order.
_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingError:
    """Error of a reading by one cause."""

    cause: str
    """The cause."""
    order: int | None
    """Periods in a turn; None where it has no single order."""
    distribution: _Distribution
    """A sine of this amplitude, a value within these limits, or this standard deviation."""
    each: float
    """Size of the error of one head [rad]."""
    mean: float
    """Size of the error of the mean of all heads [rad]."""
    centred: bool = False
    """True if centring reduces it."""

    def uncertainty(self, reading: Literal["mean", "each"]) -> float:
        """Return the standard uncertainty of a reading by this cause [rad]."""
        size = self.mean if reading == "mean" else self.each
        return math.sqrt(_VARIANCES[self.distribution]) * size


def transmission_to_mean(table: RotaryTable, order: int) -> float:
    r"""Return the share of an error of the scale that stays in the mean of all heads [1].

    .. math:: p_k = \frac1m \left|\sum_j e^{i k \alpha_j}\right|

    Examples
    --------
    >>> from flexstage.centring.table_file import table_from_text
    >>> table = table_from_text('''
    ... table: 1
    ... name: four heads
    ... scale: {radius: 48 mm, eccentricity: 50 um}
    ... heads: {angles: [0 deg, 45 deg, 180 deg, 225 deg]}
    ... tolerance: {error: 0.5 arcsec}
    ... ''')
    >>> print([round(transmission_to_mean(table, k), 4) for k in (1, 2, 4, 8)])
    [0.0, 0.7071, 0.0, 1.0]
    """
    share = abs(np.mean(np.exp(1j * order * np.asarray(table.heads.angles))))
    return float(share) if share > _ROUNDING else 0.0


def contributions(table: RotaryTable, eccentricity: float) -> tuple[ReadingError, ...]:
    r"""Return the errors of one head, and of the mean of all heads, by their causes.

    With the relative eccentricity x = e / R, a disc reads x at order 1 and x^2 / 2 at order 2, a
    drum x and x^3 / 24 at order 3. An oval deformation of amplitude a gives a / R and a tilt of
    the scale by gamma gives gamma^2 / 4, both at order 2. A translation of the axis by m gives
    m / R in a head across it, and in the mean of heads p_1 of that, whatever its order. An
    uncertainty u of the angle of each head leaves x u / sqrt(2 heads) in the mean.

    Parameters
    ----------
    table : RotaryTable
        The table.
    eccentricity : float
        Distance of the centre of the scale from the axis [m].

    Returns
    -------
    tuple of ReadingError
        In the order of the causes: scale, heads, axis.

    Notes
    -----
    Validity: small errors (x below 0.02, tilt below 1 deg); each cause by itself, without products
    of two. An oval deformation is a uniform strain in the plane of the scale; a thin ring that
    bends without stretching has half its error. Errors within a period of the signal and noise are
    independent from head to head.
    Averages over the field that a head sees are not included.

    Examples
    --------
    >>> from flexstage.centring.table_file import table_from_text
    >>> table = table_from_text('''
    ... table: 1
    ... name: one head
    ... scale: {radius: 50 mm, eccentricity: 50 um}
    ... heads: {angles: [0 deg]}
    ... tolerance: {error: 0.5 arcsec}
    ... ''')
    >>> for row in contributions(table, 50e-6):
    ...     print(f"{row.cause}, order {row.order}: {row.each / ARCSEC:.4f} arcsec")
    eccentricity, order 1: 206.2648 arcsec
    eccentricity, order 2: 0.1031 arcsec
    """
    return tuple(c for c in _every(table, eccentricity) if c.each or c.mean)


def _every(table: RotaryTable, eccentricity: float) -> Iterator[ReadingError]:
    scale, heads, axis = table.scale, table.heads, table.axis
    x, number = eccentricity / scale.radius, len(heads.angles)

    def of_scale(cause: str, order: int, size: float, *, centred: bool = False) -> ReadingError:
        return ReadingError(
            cause=cause,
            order=order,
            distribution="sine",
            each=size,
            mean=size * transmission_to_mean(table, order),
            centred=centred,
        )

    def of_heads(cause: str, order: int | None, kind: _Distribution, size: float) -> ReadingError:
        # independent from head to head
        mean = size / math.sqrt(number)
        return ReadingError(cause=cause, order=order, distribution=kind, each=size, mean=mean)

    yield of_scale("eccentricity", 1, x, centred=True)
    next_order = (2, 0.5 * x**2) if scale.kind == "disc" else (3, x**3 / 24.0)
    yield of_scale("eccentricity", *next_order, centred=True)
    yield ReadingError(
        cause="eccentricity at uncertain angles of heads",
        order=1,
        distribution="normal",
        each=0.0,
        mean=x * heads.angle_uncertainty / math.sqrt(2.0 * number),
        centred=True,
    )
    yield of_scale("oval scale", 2, scale.ellipticity / scale.radius)
    yield of_scale("tilted scale", 2, 0.25 * scale.tilt**2)
    for line in scale.graduation:
        yield of_scale("graduation", line.order, line.amplitude)
    yield of_heads("interpolation", scale.lines, "sine", heads.interpolation)
    if scale.tracks is not None:
        half_step = 0.5 * scale.tracks.step
        yield of_heads("step of the code", 2**scale.tracks.bits, "limits", half_step)
    yield of_heads("noise of heads", None, "normal", heads.noise)
    of_translation = transmission_to_mean(table, 1)
    for cause, motion in (
        ("synchronous radial motion", axis.radial_synchronous),
        ("tilt motion at the overhang", axis.tilt * axis.overhang),
        ("asynchronous radial motion", axis.radial_asynchronous),
    ):
        size = 0.5 * motion / scale.radius
        yield ReadingError(
            cause=cause,
            order=None,
            distribution="limits" if "asynchronous" in cause else "sine",
            each=size,
            mean=size * of_translation,
        )


def code_limit(tracks: CodeTracks) -> float:
    r"""Return the largest eccentricity at which the tracks of a code still agree [m].

    An eccentricity e turns a track of radius r by e / r, so that the innermost and the outermost
    one are displaced by :math:`e (1 / r_i - 1 / r_a)` against each other. Codes may be false
    where that exceeds one step of a Gray code, as an edge of one track then passes that of its
    neighbour, or half a step of a natural binary code read by two sensors a track or of a
    pseudo-random code with its clock.

    Parameters
    ----------
    tracks : CodeTracks
        The tracks.

    Returns
    -------
    float
        The eccentricity [m].

    Notes
    -----
    Validity: to first order in the eccentricity; exact edges and sensors on one radial line. A
    displacement of tracks against one another in the scale itself adds to it, and no centring
    removes that.

    Examples
    --------
    >>> from flexstage.centring.table_file import CodeTracks
    >>> tracks = CodeTracks(code="gray", bits=12, inner=20e-3, outer=40e-3)
    >>> print(f"{1e6 * code_limit(tracks):.2f} um")
    61.36 um
    """
    share = 1.0 if tracks.code == "gray" else 0.5
    return share * tracks.step / (1.0 / tracks.inner - 1.0 / tracks.outer)


def expanded_uncertainty(table: RotaryTable, eccentricity: float) -> float:
    """Return the expanded uncertainty of the angle, 95 % [rad], by the table's kind of reading.

    The contributions are combined as independent (GUM, JCGM 100:2008, 5.1.2), with a coverage
    factor of 2 for nearly normal errors. Where one sine dominates this is more than its amplitude,
    by a factor of up to 1.41, and covers all errors.
    """
    rows = contributions(table, eccentricity)
    return COVERAGE * math.hypot(*(c.uncertainty(table.tolerance.reading) for c in rows))


def allowed_eccentricity(table: RotaryTable) -> float:
    """Return the largest eccentricity at which the table meets its tolerance [m].

    Parameters
    ----------
    table : RotaryTable
        The table.

    Returns
    -------
    float
        At most that of the tolerance and that at which the tracks of a code agree; that of the
        scale as mounted where it need not be centred.

    Raises
    ------
    ModelError
        Errors other than eccentricity exceed the tolerance.

    Examples
    --------
    >>> from flexstage.centring.table_file import table_from_text
    >>> table = table_from_text('''
    ... table: 1
    ... name: one head
    ... scale: {radius: 50 mm, eccentricity: 50 um}
    ... heads: {angles: [0 deg]}
    ... tolerance: {error: 1 arcsec}
    ... ''')
    >>> print(f"{1e6 * allowed_eccentricity(table):.4f} um")
    0.1714 um
    """
    limit = table.tolerance.error
    tracks = table.scale.tracks
    high = min(
        table.scale.eccentricity,
        table.tolerance.eccentricity or math.inf,
        math.inf if tracks is None else code_limit(tracks),
    )
    if expanded_uncertainty(table, high) <= limit:
        return high
    least = expanded_uncertainty(table, 0.0)
    if least >= limit:
        reading = table.tolerance.reading
        worst = max(contributions(table, 0.0), key=lambda c: c.uncertainty(reading))
        raise ModelError(
            f"a centred scale of table '{table.name}' has an uncertainty of "
            f"{least / ARCSEC:.3g} arcsec (95 %), more than its tolerance of "
            f"{limit / ARCSEC:.3g} arcsec: no stage can mend it; the largest contribution is "
            f"'{worst.cause}', {COVERAGE * worst.uncertainty(reading) / ARCSEC:.3g} arcsec"
        )
    low = 0.0
    # the uncertainty grows with the eccentricity
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        low, high = (
            (middle, high) if expanded_uncertainty(table, middle) <= limit else (low, middle)
        )
    return low
