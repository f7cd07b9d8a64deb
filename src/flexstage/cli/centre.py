"""`flexstage centre`: eccentricity of a scale on a turning table, and the move that removes it."""

from pathlib import Path
from typing import Annotated, Any

import typer

from flexstage.centring.requests import CentreRequest
from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    console,
    display_table,
    print_notes,
    print_result,
    print_table,
    write_picture,
)
from flexstage.records.read_options import ReadOptions

#: Angles of outliers that are printed.
_MOST_ANGLES = 6
#: Unit of the displacement by which a harmonic's gain is divided.
_UNITS = {"linear": "µm", "quadratic": "µm²"}


@from_docstring
def centre(
    records: Annotated[list[Path], typer.Argument()],
    *,
    request: CentreRequest,
    read_options: ReadOptions,
    stage: Annotated[str | None, typer.Option(metavar="NAME")] = None,
    figure: FigureFile = None,
    json: JsonOption = False,
) -> None:
    """Find a scale's eccentricity and the move that removes it.

    The harmonics of the error over the turn are fitted; that of order 1 gives the eccentricity.

    Parameters
    ----------
    records
        FILE...: Records of the error over the angle of the table. Several files are the heads of
        one setup if --heads has an angle for each, otherwise successive setups.
    stage
        Print the move as turns of the screws, or volts of the stacks, of this stage: a stage file
        or a built-in design.
    figure
        Draw the error over the turn and its harmonics (.svg, .png or .pdf).
    """
    from flexstage.centring.from_records import centre_files

    result = centre_files(records, request, read_options)
    settings = None
    if stage is not None:
        from flexstage.studies.settings import settings_of

        settings = settings_of(result, stage)
    files = write_picture(figure, result.plot)
    if json:
        further = {} if settings is None else {"settings": settings.to_dict()}
        print_result(result.to_dict() | further, files)
        return
    for setup in result.reports:
        print_setup(setup)
    if result.trial is not None:
        print_trial(result.trial)
    if settings is not None:
        from flexstage.report.scale import settings_table

        display_table(console(), settings_table(settings))
        print_notes(console(), settings.notes)
    print_notes(console(), result.notes, files)


def print_setup(result: dict[str, Any]) -> None:
    """Print the result of one setup of the scale."""
    screen = console()
    complete = result.get("harmonics_with_all")
    _print_harmonics(f"harmonics: {', '.join(result['records'])}", result["harmonics"], complete)
    screen.print(result["convention"], markup=False)
    unit, _, per = _unit_of(result["harmonics"])
    screen.print(
        f"{result['samples']} samples over {result['turns']:.2f} turns; residual "
        f"{per * result['residual_rms']:.4g} {unit} rms"
    )
    if "eccentricity" in result:
        _print_centre(result["eccentricity"], result["move"])
    if "eccentricity_with_all" in result:
        e = result["eccentricity_with_all"]
        screen.print(
            f"with all samples: eccentricity {1e6 * e['value']:.4f} µm, direction "
            f"{e['phase_deg']:.2f} deg"
        )
    if "change" in result:
        _print_change(result["change"])
    if result["outliers"]:
        screen.print(_outliers(result), style="yellow", markup=False)
    print_notes(screen, result["notes"])


def _print_harmonics(
    title: str, harmonics: list[dict[str, Any]], complete: list[dict[str, Any]] | None
) -> None:
    unit, key, per = _unit_of(harmonics)
    heads = ["order", f"amplitude, {unit}", "95 % interval", "phase, deg"]
    rows = []
    for i, h in enumerate(harmonics):
        low, high = (per * end for end in h["amplitude_interval"])
        row = [h["order"], f"{h[key]:.5g}", f"{low:.4g} to {high:.4g}", f"{h['phase_deg']:.2f}"]
        rows.append(row if complete is None else [*row, f"{complete[i][key]:.5g}"])
    print_table(console(), title, heads if complete is None else [*heads, "with all samples"], rows)


def _unit_of(harmonics: list[dict[str, Any]]) -> tuple[str, str, float]:
    """Return the unit of harmonics, the key of an amplitude in it, and its size."""
    radial = any(h["amplitude_um"] is not None for h in harmonics)
    unit, key = ("µm", "amplitude_um") if radial else ("arcsec", "amplitude_arcsec")
    return unit, key, next((h[key] / h["amplitude"] for h in harmonics if h["amplitude"]), 0.0)


def _outliers(result: dict[str, Any]) -> str:
    """Return a sentence on the rejected samples: number, angles and the largest one."""
    outliers = result["outliers"]
    angles = sorted({round(o["angle_deg"], 2) for o in outliers})
    largest = max(outliers, key=lambda o: abs(o["residual"]))
    omitted = len(angles) - _MOST_ANGLES
    unit, _, per = _unit_of(result["harmonics"])
    return (
        f"outliers: {len(outliers)} rejected, at "
        + ", ".join(f"{p:.2f}" for p in angles[:_MOST_ANGLES])
        + (f" deg and {omitted} more angles" if omitted > 0 else " deg")
        + f"; the largest, sample {largest['index']} of '{largest['head']}' at "
        f"{largest['angle_deg']:.2f} deg, has a residual of {per * largest['residual']:.4g} {unit}"
    )


def _print_change(change: dict[str, Any]) -> None:
    _print_harmonics("change from the previous record", change["harmonics"], None)
    if "eccentricity" in change:
        e = change["eccentricity"]
        console().print(
            f"displacement of the scale's centre: x {1e6 * e['x']:+.4f} ± "
            f"{1e6 * e['uncertainty_x']:.4f} µm, y {1e6 * e['y']:+.4f} ± "
            f"{1e6 * e['uncertainty_y']:.4f} µm (standard uncertainty)"
        )


def _print_centre(eccentricity: dict[str, Any], move: dict[str, Any]) -> None:
    low, high = (1e6 * end for end in eccentricity["interval"])
    screen = console()
    screen.print(
        f"eccentricity {1e6 * eccentricity['value']:.4f} µm ({low:.4f} to {high:.4f}), direction "
        f"{eccentricity['phase_deg']:.2f} deg"
    )
    screen.print(
        f"move of the stage: x {1e6 * move['x']:+.4f} ± {1e6 * move['uncertainty_x']:.4f} µm, "
        f"y {1e6 * move['y']:+.4f} ± {1e6 * move['uncertainty_y']:.4f} µm (standard uncertainty)"
    )


def _place(row: dict[str, Any], axis: str) -> str:
    if row[axis] is None:
        return ""
    return f"{1e6 * row[axis]:.3f} ± {1e6 * row[f'uncertainty_{axis}']:.2g}"


def print_trial(result: dict[str, Any]) -> None:
    """Print how the harmonics depend on the positions of the stage."""
    from flexstage.centring.geometry import ARCSEC

    screen = console()
    unit, size = ("arcsec", ARCSEC) if result["harmonic_unit"] == "rad" else ("µm", 1e-6)
    rows = []
    for row in result["orders"]:
        gain = ""
        if row["relation"] is not None:
            power = 2 if row["relation"] == "quadratic" else 1
            gain = f"{row['gain'] / size * 1e-6**power:.4g} {unit}/{_UNITS[row['relation']]}"
        sizes = (f"{row[key] / size:.4g}" for key in ("change", "residual"))
        places = (_place(row, axis) for axis in ("x", "y"))
        rows.append((row["order"], *sizes, row["relation"] or "none", gain, *places))
    heads = (
        "order",
        f"change, {unit}",
        f"~residual, {unit}",
        "<relation",
        "<gain",
        "centre x, µm",
        "y, µm",
    )
    title = f"response to {len(result['positions'])} positions of the stage"
    print_table(screen, title, heads, rows)
    if "centre" in result:
        c = result["centre"]
        dx, dy = (1e6 * v for v in c["move_from_last"])
        screen.print(
            f"centre by order {result['order']}: x {1e6 * c['x']:+.4f} ± "
            f"{1e6 * c['uncertainty_x']:.2g} µm, y {1e6 * c['y']:+.4f} ± "
            f"{1e6 * c['uncertainty_y']:.2g} µm of the stage (standard uncertainty); move from the "
            f"last position: {dx:+.4f}, {dy:+.4f} µm",
            markup=False,
        )
    print_notes(screen, result["notes"])
