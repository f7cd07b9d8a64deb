"""Frequency responses and modes from records of vibration, for the command, panel and Python."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.measure.modal.fit import fit_modes
from flexstage.measure.modal.result import ModalFit, Mode
from flexstage.measure.modal.ring_down import DecayMode, RingDown, ring_down
from flexstage.measure.requests import RING_DOWN, FrfRequest
from flexstage.measure.spectra.checks import HitOptions
from flexstage.measure.spectra.estimate import ResponseEstimate, estimate_response
from flexstage.measure.spectra.response import MeasuredResponse, response_from_record
from flexstage.quantities.estimate import Estimate
from flexstage.records import Channel, Record, responses_in_columns
from flexstage.records.contents import COLUMNS_BY_NAME, default_drive_columns
from flexstage.records.read import read_files
from flexstage.records.read_options import ReadOptions

#: Largest residual of a valid fit, as a share of the response.
_LARGEST_RESIDUAL = 0.5

_NEEDED = "records over time need an input and an output: name the columns (--input, --output)"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrfResult(Result):
    """Frequency responses from records, and their modes."""

    table_key: ClassVar[str] = "modes"

    records: Sequence[Record]
    """The records."""
    response: MeasuredResponse
    """The response; the first of several."""
    estimate: ResponseEstimate | None
    """Estimate of the response; None for a response read from a file."""
    fit: ModalFit | None
    """The modes; None if they were not requested."""

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The modes, rising in frequency."""
        return () if self.fit is None else self.fit.modes

    def data(self) -> dict[str, Any]:
        response, estimate, fit = self.response, self.estimate, self.fit
        notes = [*response.notes, *(() if estimate is None else estimate.notes)]
        out: dict[str, Any] = {
            "records": [r.source for r in self.records],
            **picked(response, "inputs", "outputs", "estimator"),
            "excitation": "" if estimate is None else estimate.excitation,
            "averages": response.averages,
            "lines": int(response.frequency_hz.size),
            "frequency_range_hz": [
                float(response.frequency_hz[0]),
                float(response.frequency_hz[-1]),
            ],
            "modes": [],
        }
        if fit is not None:
            out["band_hz"] = list(fit.band)
            out["modes"] = [_mode(mode, fit.outputs) for mode in fit.modes]
            out["reduced_chi_squared"] = fit.reduced_chi_squared
            for name in ("delay", "lag"):
                estimated = getattr(fit, name)
                if estimated is not None:
                    out[name] = _estimate(estimated)
            residual = max(float(one.residual_rms.max()) for one in fit.fitted)
            first = 1 if fit.modes and residual > _LARGEST_RESIDUAL else 0
            out["warnings"] = list(fit.notes[:first])
            notes += fit.notes[first:]
        return out | {"notes": _notes(self.records, notes)}

    def record(self) -> Record:
        """Return the response as columns, for other programs.

        The columns are frequency, real and imaginary part, variance and coherence if known, and the
        smearing of neighbouring lines by a window.
        """
        response = self.response
        channels = [Channel(name="frequency", values=response.frequency_hz, unit="Hz")]
        for o, name in enumerate(response.outputs):
            for i, other in enumerate(response.inputs):
                h = response.response[:, o, i]
                label = f"{name}/{other}"
                unit = _quotient(response, o, i)
                channels += [
                    Channel(name=f"{label} real", values=h.real.copy(), unit=unit),
                    Channel(name=f"{label} imaginary", values=h.imag.copy(), unit=unit),
                ]
                if response.variance is not None:
                    channels.append(
                        Channel(name=f"{label} variance", values=response.variance[:, o, i].copy())
                    )
            if response.coherence is not None:
                channels.append(
                    Channel(name=f"{name} coherence", values=response.coherence[:, o].copy())
                )
        if response.blur:
            blur = np.full(response.frequency_hz.size, response.blur)
            channels.append(Channel(name="blur", values=blur))
        return Record(
            channels=tuple(channels),
            time=np.arange(response.frequency_hz.size, dtype=np.float64),
            source=", ".join(r.source for r in self.records),
            notes=response.notes,
            over="point",
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DecayResult(Result):
    """Free decay, and its modes."""

    table_key: ClassVar[str] = "modes"

    record: Record
    """The record."""
    fit: RingDown
    """The modes."""

    @property
    def modes(self) -> tuple[DecayMode, ...]:
        """The modes, rising in frequency."""
        return self.fit.modes

    def data(self) -> dict[str, Any]:
        return {
            "records": [self.record.source],
            "modes": [_mode(mode, self.fit.channels) for mode in self.modes],
            "notes": _notes([self.record], self.fit.notes),
        }


def _notes(records: Sequence[Record], remarks: Iterable[str]) -> list[str]:
    """Return the note on the columns, then the remarks, then the notes of the files."""
    of_files = [note for record in records for note in record.notes]
    first = [note for note in of_files[:1] if note.endswith(COLUMNS_BY_NAME)]
    return list(dict.fromkeys((*first, *remarks, *of_files)))


def _quotient(response: MeasuredResponse, o: int, i: int) -> str:
    """Return the unit of a response; empty if that of output or input is unknown."""
    if not response.output_units or not response.input_units:
        return ""
    above, below = response.output_units[o], response.input_units[i]
    if not above or not below:
        return ""
    return f"{above}/({below})" if "/" in below else f"{above}/{below}"


def _mode(mode: Mode | DecayMode, outputs: Sequence[str]) -> dict[str, Any]:
    """Return a mode as plain data."""
    return {
        "frequency_hz": _estimate(mode.frequency_hz),
        "damping_ratio": _estimate(mode.damping_ratio),
        "shape": [
            {
                "output": name,
                "real": float(value.real) if np.isfinite(value) else None,
                "imaginary": float(value.imag) if np.isfinite(value) else None,
            }
            for name, value in zip(outputs, mode.shape, strict=True)
        ],
    }


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return picked(estimate, "value", "uncertainty", "degrees_of_freedom", "interval", "unit")


def frf_of_files(
    files: Sequence[Path], request: FrfRequest, how: ReadOptions = ReadOptions()
) -> FrfResult | DecayResult:
    """Analyse files as `frf` does; the default columns follow from their units and names."""
    column_note = ""
    decays = request.excitation == RING_DOWN
    if not (decays or request.response or (request.input and request.output)):
        columns = (request.input, request.output)
        inputs, outputs, column_note = default_drive_columns(files[0], columns, how, vibration=True)
        request = replace(request, input=inputs, output=outputs)
    existing = not (request.input or request.output or decays)
    if existing and (how.sample_rate or how.time is not None or how.resample):
        raise ModelError(_NEEDED)
    read = read_files(
        files,
        [*request.input, *request.output],
        options=how,
        over="table" if existing else "any",
    )
    if existing:
        read = [_over_frequency(record, request) for record in read]
    read[0] = replace(read[0], notes=tuple(filter(None, (column_note, *read[0].notes))))
    return frf(read, request)


def frf(records: Sequence[Record], request: FrfRequest) -> FrfResult | DecayResult:
    """Return responses and modes of records, or those of a free decay.

    With a delay or a lag, modes are real unless complex ones are requested: a delay and complex
    modes both turn the phase.
    """
    if request.excitation == RING_DOWN:
        return DecayResult(request=request, record=records[0], fit=_decay_fit(records, request))
    estimate, added, at_end = None, 0.0, request.exponential
    if records[0].over == "frequency":
        responses = [response_from_record(record) for record in records]
    else:
        if not request.input or not request.output:
            raise ModelError(_NEEDED)
        estimate = estimate_response(
            records,
            request.input,
            request.output,
            estimator=request.estimator,
            excitation=request.excitation,
            window="hann" if at_end else request.window,
            resolution_hz=request.resolution,
            hits=HitOptions(exponential=at_end or None),
        )
        responses, added = [estimate.response], estimate.added_damping_rate
    fit = None
    if request.fit_modes != 0:
        fit = fit_modes(
            responses,
            band=request.band,
            count=request.fit_modes,
            frequency_guess=request.near or None,
            weighting="variance" if request.weight == "noise" else request.weight,
            delay="delay" in request.fit or None,
            lag="lag" in request.fit,
            real_modes=bool(request.fit) and "complex" not in request.fit,
            added_damping_rate=added,
        )
    return FrfResult(
        request=request, records=records, response=responses[0], estimate=estimate, fit=fit
    )


def _over_frequency(record: Record, request: FrfRequest) -> Record:
    """Return a record over frequency, unchanged or from columns of a table."""
    if record.over != "frequency":
        return responses_in_columns(record, list(request.response) or None)
    if request.response:
        raise ModelError(
            f"'{record.source}' itself names its responses: omit --response, and select responses "
            "by --dataset"
        )
    return record


def _decay_fit(records: Sequence[Record], request: FrfRequest) -> RingDown:
    if len(records) != 1 or not request.output:
        raise ModelError(
            "--excitation ring-down needs one file and --output: name the columns of the decay"
        )
    if records[0].over != "time":
        raise ModelError(
            f"--excitation ring-down needs samples over time, but '{records[0].source}' is over "
            f"{records[0].over}: omit the option, or give a record of the decay"
        )
    count = request.fit_modes
    return ring_down(records[0], request.output, count=None if count == "auto" else count)
