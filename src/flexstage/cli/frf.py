"""`flexstage frf`: frequency responses and modes from measured records."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import JsonOption, QuietOption, from_docstring, refuse
from flexstage.cli.output import (
    FigureFile,
    OutputFile,
    console,
    print_notes,
    print_result,
    print_table,
    progress_bar,
    record_format,
    write_file,
    write_picture,
)
from flexstage.measure.requests import RING_DOWN, FrfRequest
from flexstage.records.read_options import ReadOptions

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.measure.frf import DecayResult, FrfResult


@from_docstring
def frf(
    records: Annotated[list[Path], typer.Argument()],
    *,
    request: FrfRequest,
    read_options: ReadOptions,
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
        Draw response and fit, and the stabilisation diagram to a second file, NAME-stabilisation
        (.svg, .png or .pdf).
    """
    from flexstage.measure.frf import frf_of_files

    record_format(out)
    refuse(
        request.excitation == RING_DOWN and out,
        "--out cannot be used with --excitation ring-down, which fits outputs alone: omit it",
    )
    with progress_bar("frf", quiet=quiet):
        result = frf_of_files(records, request, read_options)
    files = _write_files(out, figure, result)
    if json:
        print_result(result.to_dict(), files)
        return
    print_modes(console(), result.to_dict(), files)


def _write_files(
    out: Path | None, figure: Path | None, result: "FrfResult | DecayResult"
) -> list[Path]:
    """Write the requested files, after all of them are computed and drawn."""
    from flexstage.measure.frf import FrfResult
    from flexstage.records.write import record_bytes

    content, figures = None, {}
    if out is not None and isinstance(result, FrfResult):
        content = record_bytes(result.record(), record_format(out))
    if figure is not None:
        # drawn first: if a figure fails, no response is written
        figures[figure] = result.plot()
        if isinstance(result, FrfResult) and result.fit is not None and result.fit.stabilisation:
            diagram = figure.with_stem(f"{figure.stem}-stabilisation")
            figures[diagram] = result.plot("stabilisation")
    files: list[Path] = []
    for path, drawing in figures.items():
        files += write_picture(path, lambda drawing=drawing: drawing)
    if out is not None and content is not None:
        write_file(out, content)
        files.insert(0, out)
    return files


def print_modes(screen: "Console", result: dict[str, Any], files: list[Path]) -> None:
    """Print the modes, the estimator of the response, notes and files."""
    for warning in result.get("warnings", ()):
        screen.print(f"warning: {warning}", style="bold", markup=False)
    rows = []
    for i, mode in enumerate(result["modes"], start=1):
        f, zeta = mode["frequency_hz"], mode["damping_ratio"]
        shape = ", ".join(
            f"{s['output']} {s['real']:+.3f}" for s in mode["shape"] if s["real"] is not None
        )
        (low, high), (least, most) = f["interval"], zeta["interval"]
        frequency = (f"{f['value']:.4f}", f"{0.5 * (high - low):.2g}")
        damping = (f"{100.0 * zeta['value']:.4f}", f"{50.0 * (most - least):.2g}")
        rows.append((i, *frequency, *damping, shape.replace("-", "−")))
    heads = "mode", "frequency [Hz]", "± (95 %)", "damping ratio [%]", "± (95 %)", "<shape"
    print_table(screen, f"modes: {', '.join(result['records'])}", heads, rows)
    if "averages" in result:
        averages = f"{result['averages']:g} averages, " if result["averages"] else ""
        kind = f"{result['excitation']}, " if result["excitation"] else ""
        screen.print(f"{kind}{result['estimator']} {averages}{result['lines']} lines".strip())
    for name in ("delay", "lag"):
        if name in result:
            value, u = result[name]["value"], result[name]["uncertainty"]
            screen.print(f"{name} {value:.4g} s, standard uncertainty {u:.2g} s")
    print_notes(screen, result["notes"], files)
