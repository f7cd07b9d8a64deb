"""`flexstage frf`: frequency responses and modes from measured records."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.frf_result import mode_result, print_modes, response_record, response_result
from flexstage.cli.options import (
    InputUnitOption,
    JsonOption,
    OutputUnitOption,
    QuietOption,
    from_docstring,
    one_of,
    positive_frequency,
    refuse,
)
from flexstage.cli.output import (
    FigureFile,
    OutputFile,
    console,
    print_json,
    progress_bar,
    write_file,
    write_picture,
)
from flexstage.cli.reading import (
    AS_EVEN,
    WHOLE_FILE,
    EvenTimeOptions,
    FileOptions,
    read_records,
    record_format,
)
from flexstage.errors import ModelError
from flexstage.records.reading_options import column_list

if TYPE_CHECKING:
    from flexstage.measure.modal.result import ModalFit
    from flexstage.measure.spectra.estimate import ResponseEstimate
    from flexstage.measure.spectra.response import MeasuredResponse
    from flexstage.records import Record

#: What the fit calls a weight.
_WEIGHTS = {"noise": "variance", "relative": "relative", "uniform": "uniform"}
_NEEDED = "records over time need --input and --output: name the columns"


@from_docstring
def frf(
    records: Annotated[list[Path], typer.Argument()],
    input: str | None = None,
    output: str | None = None,
    response: str | None = None,
    estimator: str = "H1",
    excitation: str = "auto",
    resolution: str | None = None,
    segment: Annotated[int | None, typer.Option(min=8)] = None,
    window: str = "hann",
    exponential: float | None = None,
    band: str | None = None,
    fit_modes: str = "auto",
    near: str | None = None,
    weight: Annotated[str, one_of(_WEIGHTS)] = "noise",
    delay: bool = False,
    lag: bool = False,
    complex_modes: bool = False,
    ring_down: bool = False,
    input_unit: InputUnitOption = None,
    output_unit: OutputUnitOption = None,
    timing: EvenTimeOptions = AS_EVEN,
    how: FileOptions = WHOLE_FILE,
    out: OutputFile = None,
    figure: FigureFile = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Estimate frequency responses and fit modes.

    Parameters
    ----------
    records
        FILE...: Measured records, averaged together, or measured frequency responses.
    input
        COLUMN: Number or name of the input column (default: of a record over time the one in N,
        else in V, or called so).
    output
        COLUMNS: Numbers or names of the output columns, separated by commas (default: those in
        units of motion, or called so).
    response
        COLUMNS: Columns of a measured response, if the headings do not name them: frequency, real
        and imaginary part, "0,1,2", or magnitude and phase, "0,1 dB,2 deg".
    estimator
        NAME: H1 for noise in the outputs, H2 for noise in the input, Hv for both.
    excitation
        KIND: random, periodic, hammer, step or sweep; auto recognises it from the input.
    resolution
        FREQUENCY: Frequency resolution, such as "0.5 Hz".
    segment
        NUMBER: Samples of a segment, instead of --resolution.
    window
        NAME: Window of random segments: hann, hamming...
    exponential
        SHARE: For hammer tests: value of the exponential window at the end of a hit; the damping
        that it adds is subtracted.
    band
        LOW:HIGH: Band in which modes are fitted, such as "200:800" in Hz or "0.2 kHz:0.8 kHz".
    fit_modes
        NUMBER|auto: Number of modes to fit; 0 for none.
    near
        FREQUENCIES: Fit modes near these frequencies alone, such as "365,660" in Hz.
    weight
        Weight of the frequency lines: noise, by their variance or the residual of the fit;
        relative, by the inverse of their magnitude, for responses over decades; uniform.
    delay
        --fit-delay: Also fit a delay of the outputs; --fit-modes auto tries it where the phase
        falls as of one.
    lag
        --fit-lag: Also fit a first-order lag of the outputs.
    complex_modes
        --complex: With --fit-delay or --fit-lag: fit complex modes, for damping that is not
        proportional; needs a wide band.
    ring_down
        The record is a free decay: outputs only, no input.
    out
        Write the response (.csv, .npz, .h5 or .mat).
    figure
        Draw response and fit, and the stabilisation diagram in a second file, NAME-stabilisation.
        (.svg, .png or .pdf)
    """
    record_format(out)
    if ring_down:
        _no_driven_options(input=input, resolution=resolution, segment=segment, band=band,
                           exponential=exponential, **{"fit-delay": delay, "fit-lag": lag}, out=out,
                           response=response, near=near, complex=complex_modes,
                           weight=None if weight == "noise" else weight)  # fmt: skip
    refuse(
        complex_modes and not (delay or lag),
        "--complex applies to fits with --fit-delay or --fit-lag, which assume real modes "
        "otherwise; without them all modes are complex: leave it out",
    )
    count, guesses = _count(fit_modes), _frequencies(near)
    if guesses is not None and count not in (None, len(guesses)):
        raise ModelError(
            f"--fit-modes {fit_modes} and --near with {len(guesses)} frequencies differ: leave "
            "--fit-modes out"
        )
    fitted_band = _band(band)
    lines = None if resolution is None else positive_frequency(resolution, "--resolution")
    taken = ""
    if not (ring_down or response or (input and output)):
        from flexstage.records.likely_columns import taken_drive
        from flexstage.records.reading_options import understood

        given = understood(len(records), **vars(timing), **vars(how))
        input, output, taken = taken_drive(records[0], (input, output), vibration=True, **given)
    inputs, outputs = column_list(input), column_list(output)
    units = [input_unit] * len(inputs) + [output_unit] * len(outputs)
    existing = not (inputs or outputs or ring_down)
    refuse(existing and any(vars(timing).values()), _NEEDED)
    refuse(
        response is not None and not existing,
        "--response names columns of a response that exists, --input and --output those of "
        "a record over time: give one or the other",
    )
    with progress_bar("frf", quiet=quiet):
        read = read_records(
            records,
            [*inputs, *outputs],
            units=units,
            over="table" if existing else "any",
            **vars(timing),
            **vars(how),
        )
        if existing:
            chosen = None if response is None else response.split(",")
            read = [_tabled(record, chosen, output_unit, input_unit) for record in read]
        if ring_down:
            result, draw = _decayed(read, outputs, count)
            found = None
        else:
            result, draw, found = _responded(
                read,
                inputs,
                outputs,
                how={
                    "estimator": estimator,
                    "excitation": excitation,
                    "window": window,
                    "segment": segment,
                    "resolution_hz": lines,
                },
                exponential=exponential,
                fit={
                    "band": fitted_band,
                    "count": count,
                    "frequency_guess": guesses,
                    "weighting": _WEIGHTS[weight],
                    "delay": delay or None,
                    "lag": lag,
                    # a delay turns the phase as complex modes do: only modes in phase tell the two
                    # apart
                    "real_modes": (delay or lag) and not complex_modes,
                },
            )
    said = (note for record in read for note in record.notes)
    result["notes"] = list(filter(None, dict.fromkeys((taken, *result["notes"], *said))))
    result["files"] = _written(out, figure, found, read, draw)
    if json:
        print_json(result)
        return
    print_modes(console(), result)


def _written(
    out: Path | None,
    figure: Path | None,
    response: "MeasuredResponse | None",
    read: "list[Record]",
    draw: Any,
) -> list[str]:
    """Write what was asked for, when all of it is computed and drawn."""
    from flexstage.records.write import record_bytes

    files: list[Path] = []
    content = None
    if out is not None and response is not None:
        content = record_bytes(response_record(response, read), record_format(out))
    # a picture that cannot be made leaves no response beside an error
    for name, each in ({} if figure is None else draw()).items():
        path = figure and figure.with_name(f"{figure.stem}{name}{figure.suffix}")
        files += write_picture(path, lambda each=each: each)
    if out is not None and content is not None:
        write_file(out, content)
        files.insert(0, out)
    return [str(path) for path in files]


def _tabled(
    record: "Record", columns: list[str] | None, output_unit: str | None, input_unit: str | None
) -> "Record":
    """Return a record over frequency, as it is or from columns of a table."""
    from flexstage.records import responses_in_columns

    if record.over != "frequency":
        return responses_in_columns(record, columns, output_unit=output_unit, input_unit=input_unit)
    refuse(
        columns is not None,
        f"'{record.source}' says itself which responses it holds: leave --response out, and "
        "choose some by --dataset",
    )
    return record


def _no_driven_options(**given: Any) -> None:
    """Refuse options that a free decay has no use for."""
    idle = [f"--{name}" for name, value in given.items() if value not in (None, False)]
    refuse(
        idle,
        f"{', '.join(idle)} has no meaning with --ring-down, which fits outputs alone: leave it "
        "out",
    )


def _count(text: str) -> int | None:
    """How many modes; None for as many as there are."""
    if text.strip().lower() == "auto":
        return None
    refuse(not text.strip().isdecimal(), f"--fit-modes must be a number or auto, got '{text}'")
    return int(text)


def _frequencies(text: str | None) -> list[float] | None:
    """Frequencies with commas between."""
    if text is None:
        return None
    return [positive_frequency(word, "--near") for word in text.split(",")]


def _band(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    words = text.split(":")
    refuse(len(words) != 2, f"--band must be two frequencies such as 200:800, got '{text}'")
    low, high = (positive_frequency(word, "--band") for word in words)
    refuse(not low < high, f"--band must rise, got '{text}'")
    return low, high


def _responded(
    read: "list[Record]",
    inputs: list[str | int],
    outputs: list[str | int],
    *,
    how: dict[str, Any],
    exponential: float | None,
    fit: dict[str, Any],
) -> "tuple[dict[str, Any], Any, MeasuredResponse]":
    from flexstage.measure.modal.fit import fit_modes
    from flexstage.measure.spectra.checks import HitOptions
    from flexstage.measure.spectra.estimate import estimate_response
    from flexstage.measure.spectra.response import response_from_record

    estimate: ResponseEstimate | None = None
    added = 0.0
    if read[0].over == "frequency":
        responses = [response_from_record(record) for record in read]
    else:
        refuse(not inputs or not outputs, _NEEDED)
        hits = None if exponential is None else HitOptions(exponential=exponential)
        estimate = estimate_response(read, inputs, outputs, hits=hits, **how)
        responses, added = [estimate.response], estimate.added_damping_rate
    found: ModalFit | None = None
    if fit["count"] != 0:
        wanted = {**fit, "count": "auto" if fit["count"] is None else fit["count"]}
        found = fit_modes(responses, added_damping_rate=added, **wanted)

    def draw() -> Any:
        from flexstage.report.figures.modal_fit import draw_modal_fit, draw_stabilisation
        from flexstage.report.figures.responses import draw_response

        if found is None:
            return {"": draw_response(responses[0])}
        drawn = {"": draw_modal_fit(found)}
        if found.stabilisation is not None:
            drawn["-stabilisation"] = draw_stabilisation(found)
        return drawn

    return response_result(read, responses[0], estimate, found), draw, responses[0]


def _decayed(
    read: "list[Record]", outputs: list[str | int], count: int | None
) -> tuple[dict[str, Any], Any]:
    from flexstage.measure.modal.ring_down import ring_down

    one = "--ring-down needs one file and --output: name the columns that decay"
    refuse(len(read) != 1 or not outputs, one)
    refuse(
        read[0].over != "time",
        f"--ring-down needs samples over time, and '{read[0].source}' is over {read[0].over}: "
        "leave the option out, or give a record of the decay",
    )
    refuse(count == 0, "--ring-down fits modes and nothing else: leave --fit-modes 0 out")
    found = ring_down(read[0], outputs, count=count)

    def draw() -> Any:
        from flexstage.report.figures.modal_fit import draw_ring_down

        return {"": draw_ring_down(found, read[0])}

    return {
        "records": [r.source for r in read],
        "modes": [mode_result(mode, list(found.channels)) for mode in found.modes],
        "notes": list(found.notes),
    }, draw
