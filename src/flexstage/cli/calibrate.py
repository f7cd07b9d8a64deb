"""`flexstage calibrate`: errors of a scale, of two scales, or of a polygon and its table."""

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from flexstage.centring.requests import NO_CERTIFICATE, CalibrateRequest, CertificateRequest
from flexstage.cli.options import JsonOption, from_docstring, refuse
from flexstage.cli.output import (
    FigureFile,
    OutputFolder,
    console,
    print_notes,
    print_result,
    print_table,
    print_text,
    writable,
    write_folder,
    write_picture,
)
from flexstage.records.read_options import ReadOptions

#: Most points of a circle that are printed.
_MOST_POINTS = 24


@from_docstring
def calibrate(
    records: Annotated[list[Path] | None, typer.Argument()] = None,
    *,
    request: CalibrateRequest,
    read_options: ReadOptions,
    folder: OutputFolder = None,
    figure: FigureFile = None,
    certificate: CertificateRequest = NO_CERTIFICATE,
    json: JsonOption = False,
) -> None:
    """Calibrate a scale, or a polygon and its table.

    Prints errors, harmonics, standard and expanded uncertainty, and the orders that the method
    cannot see.

    Parameters
    ----------
    records
        FILE...: Records of heads over the angle of the table, as for `centre`; or readings of a
        polygon, with a row for each face and a column for each setting, or columns face, setting
        and reading.
    folder
        Write tables and covariances (.csv), and the whole result (.json).
    figure
        Draw the errors with their 95 % band, and the harmonics (.svg, .png or .pdf).
    """
    from flexstage.centring.calibrate import calibrate_files, calibration_files
    from flexstage.centring.calibration import best_heads
    from flexstage.files.write import write_whole
    from flexstage.report.certificate import certificate_page

    page = _certificate_path(certificate)
    if request.best_heads is not None and not records:
        refuse(folder, "--best-heads has no tables to write: omit --folder")
        refuse(page, "--best-heads calibrates nothing: omit --certificate")
        result = best_heads(
            request.best_heads,
            request.orders or range(1, 13),
            step=math.radians(10.0) if request.step is None else request.step,
            axis_motion=request.axis_motion,
        )
        result = replace(result, request=request)
        files = []
    else:
        result = calibrate_files(records or [], request, read_options)
        files = write_folder(folder, partial(calibration_files, result))
        if page is not None:
            write_whole(page, certificate_page(result, certificate, records or []))
            files.append(page)
    files += write_picture(figure, result.plot)
    data = result.to_dict()
    if json:
        print_result(data, files)
        return
    print_calibration(data) if "points" in data else print_arrangement(data)
    print_notes(console(), data.get("notes", ()), files)


def _certificate_path(request: CertificateRequest) -> Path | None:
    """Return the path of the certificate, if one is requested; refuse one that is not writable."""
    if request.certificate is None:
        return None
    path = Path(request.certificate)
    refuse(
        path.suffix.lower() != ".html",
        f"--certificate writes a page: its name must end in .html, got '{path.name}'",
    )
    return writable(path)


def print_calibration(result: dict[str, Any]) -> None:
    """Print method, errors, harmonics and uncertainty of a calibration."""
    from flexstage.centring.calibration_table import listed
    from flexstage.centring.geometry import ARCSEC

    screen = console()
    print_text(screen, f"method: {result['method']} ({result['why']})")
    for name, blind in result["blind"].items():
        points, harmonics, contributions = (
            [row for row in result[key] if row["of"] == name]
            for key in ("points", "harmonics", "contributions")
        )
        heads = "order", "amplitude, arcsec", "uncertainty", "phase, deg"
        rows = [
            (
                h["order"],
                *_arcsec(h, "amplitude", "uncertainty"),
                f"{round(h['phase_deg'], 2) + 0.0:.2f}",
            )
            for h in harmonics
        ]
        print_table(screen, f"harmonics: {name}", heads, rows)
        if len(points) <= _MOST_POINTS:
            heads = (
                *("angle, deg", "error, arcsec", "uncertainty", "expanded, 95 %"),
                *("~step to the next", "~uncertainty"),
            )
            values = "error", "uncertainty", "expanded"
            steps = "step_error", "step_uncertainty"
            rows = [
                (f"{p['angle_deg']:.6g}", *_arcsec(p, *values), *_arcsec(p, *steps)) for p in points
            ]
            print_table(screen, f"errors: {name}", heads, rows)
        u, expanded = (max(p[key] for p in points) / ARCSEC for key in ("uncertainty", "expanded"))
        sources = ", ".join(f"{c['source']} {c['uncertainty'] / ARCSEC:.2g}" for c in contributions)
        print_text(
            screen,
            f"{name}: standard uncertainty up to {u:.3g} arcsec ({sources}), expanded (95 %) "
            f"{expanded:.3g} arcsec",
        )
        if blind:
            orders = listed(tuple(blind))
            print_text(screen, f"{name}: orders that cannot be seen, and are missing: {orders}")
    freedom = result["degrees_of_freedom"]
    origin = "given" if freedom is None else f"{freedom:.0f} degrees of freedom"
    screen.print(f"noise of a reading: {result['noise'] / ARCSEC:.4g} arcsec ({origin})")


def _arcsec(row: dict[str, Any], *keys: str) -> list[str]:
    """Return a value and its uncertainties in arcsec, with two figures of the first of these."""
    from flexstage.centring.geometry import ARCSEC

    values = [row[key] / ARCSEC for key in keys]
    decimals = max(0, min(9, 1 - math.floor(math.log10(max(values[1], 1e-9)))))
    return [f"{value:.{decimals}f}" for value in values]


def print_arrangement(result: dict[str, Any]) -> None:
    """Print the angles of heads and the gain of each order."""
    screen = console()
    rows = [(row["order"], f"{row['gain']:.3f}") for row in result["orders"]]
    print_table(screen, "uncertainty of an order, over that of a reading", ("order", "gain"), rows)
    angles = ", ".join(f"{a:g}" for a in result["heads_deg"])
    screen.print(
        f"heads at {angles} deg: largest gain {result['largest_gain']:.3f} "
        f"(bound {result['bound']:.3f}); {result['examined']} arrangements compared"
    )
