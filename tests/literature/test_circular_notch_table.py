"""The table of circular notches by finite elements, and the errors that are printed in it.

Columns ``*_fe`` are compliances by plane-stress finite elements, the others errors in per cent of a
formula against them.

Evidence (Hinges): circular notches, $t/R$ 0.05 to 0.8 (published plane-stress finite elements):
error of the classical integral 0.3 percentage points, rotation by `wedge` 0.4 %
"""

import csv
from pathlib import Path

import pytest

from flexstage.hinges import RightCircular, closed_form_compliance, closed_forms, compliance

TABLE = Path(__file__).parents[1] / "reference" / "circular-notch.csv"
NU = 0.33

# errors are printed with one decimal, compliances with five digits; the demand is 0.3 points
POINTS = 0.3


def rows() -> list[dict[str, float]]:
    lines = [line for line in TABLE.read_text().splitlines() if not line.startswith("#")]
    return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(lines)]


def _by_ratio(row):
    return f"t/R={row['t_over_R']}"


@pytest.fixture(params=rows(), ids=_by_ratio)
def row(request):
    return request.param


def error(value, reference):
    return 100.0 * (value / reference - 1.0)


def notch(row):
    return RightCircular(neck_thickness=row["t_over_R"], radius=1.0)


def test_quadrature_has_the_printed_errors(row):
    c = compliance(notch(row), 1.0, NU, 1.0, method="timoshenko", plane="stress").matrix
    for place, column, printed in (
        (2, "C_theta_fe", "C_theta_integral_err"),
        (0, "C_x_fe", "C_x_integral_err"),
        (1, "C_y_fe", "C_y_integral_with_shear_err"),
    ):
        assert error(c[place, place], row[column]) == pytest.approx(row[printed], abs=POINTS)


@pytest.mark.parametrize(
    ("name", "quantity", "column", "printed"),
    [
        ("Paros and Weisbord 1965", "rotation", "C_theta_fe", "C_theta_integral_err"),
        ("Paros and Weisbord 1965", "axial", "C_x_fe", "C_x_integral_err"),
        (
            "Paros and Weisbord 1965, simplified",
            "rotation",
            "C_theta_fe",
            "C_theta_paros_weisbord_simplified_err",
        ),
        (
            "Paros and Weisbord 1965, simplified",
            "axial",
            "C_x_fe",
            "C_x_paros_weisbord_simplified_err",
        ),
        ("Schotborgh et al. 2005", "rotation", "C_theta_fe", "C_theta_schotborgh_err"),
    ],
)
def test_closed_forms_have_the_printed_errors(row, name, quantity, column, printed):
    profile = notch(row)
    (form,) = [f for f in closed_forms(profile) if (f.name, f.quantity) == (name, quantity)]
    value = closed_form_compliance(form, profile, 1.0, NU, 1.0, plane="stress")
    assert error(value, row[column]) == pytest.approx(row[printed], abs=POINTS)


def test_wedge_agrees_with_the_table(row):
    c = compliance(notch(row), 1.0, NU, 1.0, plane="stress").matrix
    # the demand for t/R up to 0.4 is 2 % in rotation and 4 % axially; found 0.5 % over the table
    assert abs(error(c[2, 2], row["C_theta_fe"])) < 0.6
    # The end blocks of the table are one radius long, and its axial column is 1 to 4 % lower than
    # with longer ones (at t/R = 0.2: 5.884 there, 5.995 with blocks of one or two root heights),
    # so the error grows with t/R; notch-fe.csv holds the converged value.
    assert abs(error(c[0, 0], row["C_x_fe"])) < (4.0 if row["t_over_R"] <= 0.4 else 5.0)
    assert abs(error(c[1, 1], row["C_y_fe"])) < 2.2
