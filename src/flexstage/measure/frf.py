"""From records of vibration to responses and modes: one way for all who ask."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from flexstage.base.errors import ModelError
from flexstage.measure.frf_result import DecayResult, FrfResult
from flexstage.measure.modal.fit import fit_modes
from flexstage.measure.modal.ring_down import RingDown, ring_down
from flexstage.measure.requests import RING_DOWN, FrfRequest
from flexstage.measure.spectra.checks import HitOptions
from flexstage.measure.spectra.estimate import estimate_response
from flexstage.measure.spectra.response import response_from_record
from flexstage.records import Record, responses_in_columns
from flexstage.records.likely_columns import taken_drive
from flexstage.records.read import read_files
from flexstage.records.read_options import ReadOptions

_NEEDED = "records over time need an input and an output: name the columns (--input, --output)"


def frf_of_files(
    files: Sequence[Path], request: FrfRequest, how: ReadOptions = ReadOptions()
) -> FrfResult | DecayResult:
    """Return what `frf` finds in files; columns that units and names tell are taken of them."""
    taken = ""
    decays = request.excitation == RING_DOWN
    if not (decays or request.response or (request.input and request.output)):
        columns = (request.input, request.output)
        driven, follows, taken = taken_drive(files[0], columns, how, vibration=True)
        request = replace(request, input=driven, output=follows)
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
        read = [_tabled(record, request) for record in read]
    read[0] = replace(read[0], notes=tuple(filter(None, (taken, *read[0].notes))))
    return frf(read, request)


def frf(records: Sequence[Record], request: FrfRequest) -> FrfResult | DecayResult:
    """Return responses and modes of records, or those of a free decay.

    With a delay or a lag modes are in phase unless complex ones are asked for: a delay turns the
    phase as complex modes do.
    """
    if request.excitation == "ring-down":
        return DecayResult(request=request, record=records[0], fit=_decayed(records, request))
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
    found = None
    if request.fit_modes != 0:
        found = fit_modes(
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
        request=request, records=records, response=responses[0], estimate=estimate, fit=found
    )


def _tabled(record: Record, request: FrfRequest) -> Record:
    """Return a record over frequency, as it is or from columns of a table."""
    if record.over != "frequency":
        return responses_in_columns(record, list(request.response) or None)
    if request.response:
        raise ModelError(
            f"'{record.source}' says itself which responses it holds: leave --response out, and "
            "choose some by --dataset"
        )
    return record


def _decayed(records: Sequence[Record], request: FrfRequest) -> RingDown:
    if len(records) != 1 or not request.output:
        raise ModelError(
            "--excitation ring-down needs one file and --output: name the columns that decay"
        )
    if records[0].over != "time":
        raise ModelError(
            f"--excitation ring-down needs samples over time, and '{records[0].source}' is over "
            f"{records[0].over}: leave the option out, or give a record of the decay"
        )
    count = request.fit_modes
    return ring_down(records[0], request.output, count=None if count == "auto" else count)
