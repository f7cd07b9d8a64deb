"""Stress in a notch, and the rotation that it allows."""

import math

import numpy as np
import pytest

from flexstage.hinges import (
    CornerFilleted,
    Hyperbolic,
    Leaf,
    RightCircular,
    compliance,
    concentration,
    largest_rotation,
    stress_rows,
)
from flexstage.hinges.hinge_figures import hinge_figures
from flexstage.hinges.stress import _SMALL, _neuber
from flexstage.quantities.material import material

B = 8.3e-3


def test_neuber_factors_are_those_of_the_reference_figures():
    # t/R = 0.4; computed once by hand from the closed forms, x = 0.2
    factors = concentration(RightCircular(neck_thickness=0.4, radius=1.0))
    assert factors.axial == pytest.approx((1.127601, 1.127601), abs=1e-6)
    assert factors.bending == pytest.approx((1.076461, 1.076461), abs=1e-6)


def test_neuber_factors_are_continuous_where_series_and_closed_forms_meet():
    # the series end at x^5: 0.02^6 = 6e-11 times a coefficient of 0.014
    series, closed = _neuber(math.nextafter(_SMALL, 0.0)), _neuber(_SMALL)
    assert series == pytest.approx(closed, abs=2e-12)


def test_sharp_notches_approach_the_crack():
    # x -> infinity: 4/pi sqrt(x) in tension and 8/(3 pi) sqrt(x) in bending (Neuber)
    x = 1e8
    axial, bending = _neuber(x)
    assert axial == pytest.approx(4 / math.pi * math.sqrt(x), rel=2e-4)
    assert bending == pytest.approx(8 / (3 * math.pi) * math.sqrt(x), rel=2e-4)


def test_plane_strain_lowers_the_equivalent_stress():
    notch = Hyperbolic(neck_thickness=0.3e-3, half_length=1.2e-3, notch_depth=0.9e-3)
    stress, strain = (stress_rows(notch, B, 0.29, plane) for plane in ("stress", "strain"))
    np.testing.assert_allclose(strain, math.sqrt(1 - 0.29 + 0.29**2) * stress)


def test_a_positive_moment_compresses_the_left_side():
    # the moment turns body b to the left
    notch = RightCircular(neck_thickness=0.3e-3, radius=1.1e-3)
    left, right = stress_rows(notch, B, 0.29, "stress") @ [0.0, 0.0, 0.02]
    nominal = 6 * 0.02 / (B * 0.3e-3**2)
    assert left < -nominal
    assert right == pytest.approx(-left)


def test_the_cut_side_of_a_one_sided_notch_is_stressed_most():
    notch = RightCircular(neck_thickness=0.3e-3, radius=1.1e-3, one_sided=True)
    factors = concentration(notch)
    assert factors.axial[0] > factors.axial[1] > 1.0
    assert factors.bending[0] > 1.0 > factors.bending[1]


def test_shear_bends_the_ends_of_a_fillet_hinge():
    notch = CornerFilleted(neck_thickness=0.3e-3, notch_length=4.1e-3, fillet_radius=0.4e-3)
    rows = stress_rows(notch, B, 0.29, "stress") @ [0.0, 3.0, 0.0]
    factor = concentration(notch).bending[0]
    nominal = 6 * 3.0 * (4.1e-3 / 2 - 0.4e-3) / (B * 0.3e-3**2)
    # M(x) = -V x: positive in the half of body a, where the left side is compressed
    np.testing.assert_allclose(rows, factor * nominal * np.array([-1, 1, 1, -1]))


def test_a_leaf_says_that_its_corner_is_not_rated():
    leaf = Leaf(neck_thickness=0.3e-3, leaf_length=4.1e-3, notch_depth=0.9e-3)
    factors = concentration(leaf)
    assert factors.axial == factors.bending == (1.0, 1.0)
    assert "none for the corner" in factors.validity


def test_largest_rotation_is_where_the_stress_reaches_the_limit():
    what = material("Al 6061-T6")
    notch = RightCircular(neck_thickness=0.4e-3, radius=1.3e-3)
    limit = largest_rotation(notch, what, B)
    spring = compliance(notch, what.youngs_modulus, what.poissons_ratio, B)
    rows = stress_rows(notch, B, what.poissons_ratio)
    for rotation, strength in (
        (limit.before_yield, what.yield_strength),
        (limit.before_fatigue, what.fatigue_limit),
    ):
        moment = rotation / spring.matrix[2, 2]
        assert np.max(rows @ [0.0, 0.0, moment]) == pytest.approx(strength)


def test_a_brittle_material_has_no_rotation_at_yield():
    notch = RightCircular(neck_thickness=0.4e-3, radius=1.3e-3)
    limit = largest_rotation(notch, material("Silicon <110>"), B)
    assert limit.before_yield is None
    assert limit.before_fatigue is None


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_the_table_of_a_notch_says_what_each_method_gives(plane):
    """Stiffness is one over compliance, and differences are to the wedge, in per cent of it."""
    notch = RightCircular(neck_thickness=0.43e-3, radius=1.7e-3)
    metal = material("Al 7075-T6")
    found = hinge_figures(notch, metal, B, plane)
    rows = {(r["quantity"], r["method"]): r for r in found["stiffness"]}
    e, nu = metal.youngs_modulus, metal.poissons_ratio
    for method in ("wedge", "timoshenko", "euler-bernoulli"):
        c = compliance(notch, e, nu, B, method=method, plane=plane).matrix
        for place, quantity in enumerate(("axial", "shear", "rotation")):
            assert rows[quantity, method]["stiffness"] == pytest.approx(1.0 / c[place, place])
    # J. M. Paros and L. Weisbord (1965), with E / (1 - nu^2) in plane strain
    e = e if plane == "stress" else e / (1.0 - nu**2)
    thin = 2.0 * e * B * 0.43e-3**2.5 / (9.0 * math.pi * math.sqrt(1.7e-3))
    short = rows["rotation", "Paros and Weisbord 1965, simplified"]
    assert short["stiffness"] == pytest.approx(thin, rel=1e-9)
    for (quantity, _), row in rows.items():
        wedge = rows[quantity, "wedge"]["stiffness"]
        expected = 100.0 * (row["stiffness"] - wedge) / wedge
        assert row["difference_percent"] == pytest.approx(expected, abs=1e-9)
    turn = largest_rotation(notch, metal, B, plane=plane)
    assert found["largest_rotation"]["before_yield"] == turn.before_yield
    assert found["largest_rotation"]["before_fatigue"] == turn.before_fatigue
    assert found["concentration"]["axial"] == list(concentration(notch).axial)
    assert found["concentration"]["bending"] == list(concentration(notch).bending)
