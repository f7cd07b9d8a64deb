"""Periodic records of several inputs and outputs: their spectra, levels, noise and distortion."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array, Complex, Integers
from flexstage.base.errors import RecordError
from flexstage.records.record import Record

#: Records belong to one level where the rms of their inputs differs by less than this.
_SAME_LEVEL = 0.1
#: A line is excited where the power of the inputs exceeds this part of the mean over all lines.
_EXCITED = 1e-3
#: Two periods of an input are the same where they differ by less than this part of its rms.
_SAME_PERIOD = 1e-3
#: A record whose periods differ more than this times the median of its level was not in steady
#: state: noise of sensors differs by a factor of two at most between realisations.
_UNSTEADY = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeriodicSpectra:
    """Spectra of R records at L excited lines, mean of their periods.

    Each line has the rms of its sine: the sum of ``abs()**2`` over the lines is the mean square.
    """

    inputs: Complex
    """Inputs, shape (R, L, m)."""
    outputs: Complex
    """Outputs, shape (R, L, p)."""
    lines: Integers
    """Number of each line: periods of the sine within a period of the record, shape (L,)."""
    period: int
    """Samples in a period."""
    sample_rate_hz: float
    """Sample rate [Hz]."""
    level: Integers
    """Level of each record, from 0 for the weakest inputs, shape (R,)."""
    noise: Array
    """Noise of the mean of the periods, rms over the outputs; NaN for a single one, shape (R,)."""
    names: tuple[str, ...] = ()
    """Source of each record."""

    @property
    def frequency_hz(self) -> Array:
        """Frequency of each line [Hz]."""
        return np.asarray(self.lines * (self.sample_rate_hz / self.period), dtype=np.float64)

    @property
    def z(self) -> Complex:
        """The variable of the z transform at each line."""
        return np.exp(2j * np.pi * self.lines / self.period)

    @property
    def levels(self) -> int:
        """Number of levels."""
        return int(self.level.max()) + 1

    def of(self, records: NDArray[Any]) -> "PeriodicSpectra":
        """Return the spectra of some of the records, by number or mask."""
        numbers = np.arange(len(self.level))[records]
        parts = {n: getattr(self, n)[numbers] for n in ("inputs", "outputs", "level", "noise")}
        return replace(self, names=tuple(self.names[k] for k in numbers), **parts)

    def unsteady(self) -> NDArray[np.bool_]:
        """Return which records were not in steady state, shape (R,).

        Their periods differ by more than three times the median of their level.
        """
        typical = np.full(len(self.noise), np.inf)  # a single period tells nothing
        for k in range(self.levels):
            known = self.noise[(self.level == k) & np.isfinite(self.noise)]
            if known.size:
                typical[self.level == k] = np.median(known)
        return self.noise > _UNSTEADY * typical


def period_of(inputs: Array) -> int:
    """Return the period of inputs of shape (n, m) in samples; n where they do not repeat."""
    n = len(inputs)
    limit = _SAME_PERIOD * float(np.sqrt(np.mean(inputs**2)))
    spectrum = np.fft.rfft(inputs - inputs.mean(0), 2 * n, axis=0)
    correlation = np.fft.irfft(np.sum(np.abs(spectrum) ** 2, axis=1))[:n]
    likely = np.flatnonzero(correlation > 0.9 * correlation[0] * (1.0 - np.arange(n) / n))
    for shift in likely[(likely > 0) & (likely <= n // 2)]:
        difference = inputs[shift:] - inputs[:-shift]
        if np.sqrt(np.mean(difference**2)) < limit:
            return int(shift)
    return n


def periodic_spectra(
    records: Sequence[Record],
    inputs: Sequence[str | int],
    outputs: Sequence[str | int],
    period: int | None = None,
) -> PeriodicSpectra:
    """Return the spectra of records that consist of whole periods in steady state.

    Parameters
    ----------
    records : sequence of Record
        Records of one sample rate.
    inputs, outputs : sequence of str or int
        Columns of the m inputs and the p outputs.
    period : int, optional
        Samples in a period; found from the repetition of the inputs where not given.

    Raises
    ------
    RecordError
        Sample rates or periods differ, a record is shorter than a period, or a column is constant.
    """
    mean_inputs, mean_outputs, noise = [], [], []
    rate = records[0].sample_rate_hz
    for record in records:
        name = record.source or "a record"
        if abs(record.sample_rate_hz / rate - 1.0) > 1e-6 or not record.uniform:
            raise RecordError(
                f"{name}: records of several drives need one sample rate, got "
                f"{record.sample_rate_hz:g} and {rate:g} Hz: resample them"
            )
        u = np.column_stack([record.channel(c).values for c in inputs])
        y = np.column_stack([record.channel(c).values for c in outputs])
        own_period = period_of(u)
        period = own_period if period is None else period
        if own_period != period and len(u) % period:
            raise RecordError(
                f"{name} has {len(u)} samples, which are not whole periods of {period}: records "
                "must have one period, and begin and end with it"
            )
        folded = y[: len(y) // period * period].reshape(-1, period, y.shape[1])
        mean_inputs.append(u[: len(folded) * period].reshape(-1, period, u.shape[1]).mean(0))
        mean_outputs.append(folded.mean(0))
        deviations = folded - folded.mean(0)
        n = len(folded)
        square = np.sum(deviations**2) / (n * (n - 1) * period * y.shape[1]) if n > 1 else np.nan
        noise.append(float(np.sqrt(square)))
    assert period is not None
    scale = np.sqrt(2.0) / period
    spectra = [np.fft.rfft(np.array(x), axis=1) * scale for x in (mean_inputs, mean_outputs)]
    _require_motion(records[0], (*inputs, *outputs), np.concatenate(spectra, axis=2))
    power = np.sum(np.abs(spectra[0]) ** 2, axis=(0, 2))
    power[0] = 0.0
    lines = np.flatnonzero(power > _EXCITED * power[1:].mean())
    rms = np.sqrt(np.sum(np.abs(spectra[0][:, lines]) ** 2, axis=(1, 2)))
    return PeriodicSpectra(
        inputs=spectra[0][:, lines],
        outputs=spectra[1][:, lines],
        lines=lines,
        period=period,
        sample_rate_hz=rate,
        level=_levels(rms),
        noise=np.array(noise),
        names=tuple(record.source or f"record {k + 1}" for k, record in enumerate(records)),
    )


def _require_motion(record: Record, columns: Sequence[str | int], spectra: Complex) -> None:
    """Refuse a column that is constant in all records."""
    for column, still in zip(columns, ~np.any(spectra[:, 1:] != 0.0, axis=(0, 1)), strict=True):
        if still:
            raise RecordError(
                f"column '{record.channel(column).name}' is constant in all records: select inputs "
                "and outputs that vary"
            )


def _levels(rms: Array) -> Integers:
    """Return the level of each record: those whose inputs are nearly equally large are one."""
    order = np.argsort(rms)
    steps = np.diff(rms[order]) > _SAME_LEVEL * rms[order][:-1]
    level = np.empty(len(rms), dtype=np.intp)
    level[order] = np.concatenate(([0], np.cumsum(steps)))
    return level


def best_linear(
    inputs: Complex, outputs: Complex, weights: Array | None = None
) -> tuple[Complex, Complex]:
    """Return the best linear approximation at each line, and the residuals.

    Parameters
    ----------
    inputs, outputs : array
        Spectra, shapes (R, L, m) and (R, L, p), of at least m records.
    weights : array, optional
        Weight of the residuals of each record, shape (R,).

    Returns
    -------
    tuple of array
        Response, shape (L, p, m), and outputs less those of the response, shape (R, L, p).

    Notes
    -----
    Least squares over the records of each line (R. Pintelon and J. Schoukens, *System
    Identification*, 2nd ed. 2012, chapter 3).
    """
    w = np.ones(len(inputs)) if weights is None else weights
    x = np.moveaxis(inputs, 0, -1) * w
    x_h = np.conj(np.swapaxes(x, 1, 2))
    cross = (np.moveaxis(outputs, 0, -1) * w) @ x_h
    transposed = np.linalg.solve(np.swapaxes(x @ x_h, 1, 2), np.swapaxes(cross, 1, 2))
    response = np.asarray(np.swapaxes(transposed, 1, 2), dtype=np.complex128)
    residuals: Complex = outputs - np.einsum("lpm,rlm->rlp", response, inputs)
    return response, residuals


def require_records(spectra: PeriodicSpectra) -> None:
    """Refuse fewer records of a level than inputs, or inputs that are not independent."""
    m = spectra.inputs.shape[2]
    for k in range(spectra.levels):
        x = np.moveaxis(spectra.inputs[spectra.level == k], 0, -1)
        if x.shape[2] < m:
            raise RecordError(
                f"level {k + 1} has {x.shape[2]} records, and {m} inputs need at least {m} of "
                "each level, with independent inputs: record more realisations"
            )
        singular = np.linalg.svd(x, compute_uv=False)
        if np.median(singular[:, -1] / singular[:, 0]) < 1e-3:
            raise RecordError(
                f"the inputs of level {k + 1} are not independent: use another realisation of "
                "the excitation for each input, such as orthogonal multisines"
            )
