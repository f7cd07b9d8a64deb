"""`flexstage frf`: frequency responses and modes from measured records."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.frf_result import decay_result, print_modes, response_record, response_result
from flexstage.cli.options import JsonOption, QuietOption, from_docstring, refuse
from flexstage.cli.output import (
    FigureFile,
    OutputFile,
    console,
    print_json,
    progress_bar,
    write_file,
    write_picture,
)
from flexstage.cli.reading import record_format
from flexstage.measure.requests import RING_DOWN, FrfRequest
from flexstage.records.read_options import ReadOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@from_docstring
def frf(
    records: Annotated[list[Path], typer.Argument()],
    *,
    request: FrfRequest,
    how: ReadOptions,
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
    out
        Write the response (.csv, .npz, .h5 or .mat).
    figure
        Draw response and fit, and the stabilisation diagram in a second file, NAME-stabilisation.
        (.svg, .png or .pdf)
    """
    from flexstage.measure.frf import FrfResult, frf_of_files

    record_format(out)
    refuse(
        request.excitation == RING_DOWN and out,
        "--out has no meaning with --excitation ring-down, of which outputs alone are fitted: "
        "leave it out",
    )
    with progress_bar("frf", quiet=quiet):
        found = frf_of_files(records, request, how)
    responded = isinstance(found, FrfResult)
    result = response_result(found) if responded else decay_result(*found)
    read = found.records if responded else found[0]
    # which columns were taken comes first, then what was found, then what the files said
    said = [note for record in read for note in record.notes]
    first = [note for note in said[:1] if note.endswith("taken by units and names")]
    result["notes"] = list(dict.fromkeys((*first, *result["notes"], *said)))
    result["files"] = _written(out, figure, found)
    if json:
        print_json(result)
        return
    print_modes(console(), result)


def _written(out: Path | None, figure: Path | None, found: Any) -> list[str]:
    """Write what was asked for, when all of it is computed and drawn."""
    from flexstage.records.write import record_bytes

    files: list[Path] = []
    content = None
    if out is not None:
        content = record_bytes(response_record(found.response, found.records), record_format(out))
    # a picture that cannot be made leaves no response beside an error
    for name, each in ({} if figure is None else _drawn(found)).items():
        path = figure and figure.with_name(f"{figure.stem}{name}{figure.suffix}")
        files += write_picture(path, lambda each=each: each)
    if out is not None and content is not None:
        write_file(out, content)
        files.insert(0, out)
    return [str(path) for path in files]


def _drawn(found: Any) -> dict[str, "Figure"]:
    """Return the pictures, by what the name of their file ends with."""
    from flexstage.report.figures.modal_fit import (
        draw_modal_fit,
        draw_ring_down,
        draw_stabilisation,
    )
    from flexstage.report.figures.responses import draw_response

    if isinstance(found, tuple):
        (record,), decay = found
        return {"": draw_ring_down(decay, record)}
    if found.fit is None:
        return {"": draw_response(found.response)}
    drawn = {"": draw_modal_fit(found.fit)}
    if found.fit.stabilisation is not None:
        drawn["-stabilisation"] = draw_stabilisation(found.fit)
    return drawn
