"""Certificate of a calibration: one page for print, from the result and what the user states."""

import datetime
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from flexstage.base.provenance import file_hash
from flexstage.base.version import __version__
from flexstage.centring.calibrate import Calibration
from flexstage.centring.calibration_table import Division, listed
from flexstage.centring.geometry import ARCSEC
from flexstage.centring.requests import CertificateRequest
from flexstage.quantities.quantity import number
from flexstage.quantities.table import Bullets, Content, Definitions, Picture, Section, Table, table
from flexstage.report.page import page_html

#: Rows of a table of errors on the page; finer tables give every so many points.
_ROWS = 36
#: Methods in words.
_METHODS = {
    "self": "self-calibration: differences of heads, in which the angle of the table cancels",
    "reference": "comparison with a reference of angle",
    "equal-division": "mean of evenly spaced heads",
    "cross": "comparison of two scales in several positions",
    "closure": "closure of the circle with one unknown angle",
    "rosette": "closure of the circle in several settings of the polygon on its table",
}


def certificate_page(
    calibration: Calibration, stated: CertificateRequest, records: Sequence[Path]
) -> str:
    """Return the page: what was calibrated and with what, table, curve, uncertainty and records."""
    # in the zone of the laboratory
    day = datetime.datetime.now().astimezone().date().isoformat()
    return page_html(
        heading="Calibration certificate",
        lead=f"{stated.item}; {day}",
        title=f"Calibration certificate, {stated.item}",
        version=__version__,
        sections=(
            Section(title="Object and standards", key="object", content=(_facts(stated, day),)),
            Section(title="Method", key="method", content=tuple(_method(calibration))),
            Section(title="Result", key="result", content=tuple(_result(calibration))),
            Section(title="Uncertainty", key="uncertainty", content=tuple(_budgets(calibration))),
            Section(
                title="Records",
                key="records",
                content=(
                    Bullets([f"{file.name}, SHA-256 {file_hash(file)}" for file in records]),
                    f"Evaluated by flexstage {__version__}.",
                ),
            ),
        ),
    )


def _facts(stated: CertificateRequest, day: str) -> Definitions:
    facts = {
        "Object": stated.item,
        "Standards": stated.standard or "none stated",
        "Traceability, as stated by the laboratory": stated.traceability or "none stated",
        "Conditions": stated.conditions or "none stated",
        "Laboratory": stated.laboratory or "none stated",
        "Date": day,
    }
    return Definitions(facts)


def _method(calibration: Calibration) -> Iterator[Content]:
    yield f"By {_METHODS[calibration.method]}."
    for division in calibration.divisions:
        if division.blind:
            yield (
                f"{division.name.capitalize()}: the method cannot see the orders "
                f"{listed(tuple(division.blind))}, which are missing in the table."
            )
    if calibration.notes:
        yield Bullets(calibration.notes)


def _result(calibration: Calibration) -> Iterator[Content]:
    yield (
        "Errors are reading minus angle. The expanded uncertainty is the standard uncertainty "
        "times the factor of 95 % for its degrees of freedom."
    )
    for division in calibration.divisions:
        yield _errors(division)
    yield Picture(
        result=calibration,
        title="Errors over the turn with their 95 % band, and harmonics",
        caption="Errors with their 95 % band, and amplitudes of the harmonics.",
    )


def _errors(division: Division) -> Table:
    size = division.error.size
    every = -(-size // _ROWS)
    numbers = range(0, size, every)
    estimates = [(division.angle[i], division.estimate(i)) for i in numbers]
    note = f"one in {every} of the {size} points" if every > 1 else ""
    return table(
        f"{division.name.capitalize()}: errors",
        ("angle, deg", "error, arcsec", "standard uncertainty, arcsec", "expanded (95 %), arcsec"),
        [
            (
                f"{math.degrees(angle):.6g}",
                f"{e.value / ARCSEC:.4f}",
                number(e.uncertainty / ARCSEC, 2),
                number(e.expanded / ARCSEC, 2),
            )
            for angle, e in estimates
        ],
        notes=(note,) if note else (),
    )


def _budgets(calibration: Calibration) -> Iterator[Content]:
    for division in calibration.divisions:
        yield table(
            f"{division.name.capitalize()}: contributions to the standard uncertainty (GUM)",
            ("<source", "<kind", "mean over the points, arcsec", "degrees of freedom"),
            [
                (
                    c.source,
                    c.kind,
                    number((c.covariance.trace() / division.error.size) ** 0.5 / ARCSEC, 2),
                    "∞" if c.degrees_of_freedom == math.inf else f"{c.degrees_of_freedom:.0f}",
                )
                for c in division.contributions
            ],
        )
    yield (
        "Errors of different points are correlated; differences of points use the covariance, "
        "which flexstage calibrate --folder writes."
    )
