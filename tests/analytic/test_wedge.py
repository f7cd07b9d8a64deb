"""The energy densities of tapered strips, and the exact solutions that they must reproduce.

Evidence (Hinges): energy density of `wedge` (exact wedge and strip): rounding
"""

import numpy as np
import pytest
from scipy.integrate import quad

from flexstage.hinges import Leaf, VFillet, compliance
from flexstage.hinges.wedge import densities

NU = 0.31
SWITCH = 0.2  # half angle where series and closed forms meet


def test_densities_are_continuous_where_series_and_closed_forms_meet():
    values = np.array(densities(np.array([np.nextafter(SWITCH, 0.0), SWITCH])))
    # the closed forms cancel like angle**-4, 1e-16/0.2**4 = 6e-14; the series are cut off at
    # angle**12, 0.2**12 = 4e-9 times a coefficient of 1e-3
    np.testing.assert_allclose(values[:, 0], values[:, 1], rtol=1e-10)


@pytest.mark.parametrize("angle", [1e-3, 0.05, 0.15])
def test_densities_follow_the_asymptotic_expansion(angle):
    # In h' = 2 tan(angle) and per length along the axis: the two-term expansion of a tapered strip.
    # mv carries M about the middle of the slice's arc, as the expansion does to this order.
    nn, mm, mv, vv = (float(f[0]) for f in densities(np.array([angle])))
    fourth = 3.0 * angle**4
    assert nn == pytest.approx((1 + (2 * angle) ** 2 / 6) * (1 - angle**2 / 2), abs=fourth)
    assert vv == pytest.approx(12 / 5, abs=2 * angle**2)
    assert mv == pytest.approx(-24 / 5 * angle, abs=7 * angle**3)
    assert mm == pytest.approx(12 + 42 / 5 * angle**2, abs=2 * fourth)


def wedge_compliance(alpha, h0, h1):
    """Compliance under (N, M about the apex) of the wedge between two arcs, by its exact stress.

    E b times; Poisson's ratio left out, as in the densities. Arcs pass through the surface points
    of sections of heights h0 and h1. The third number belongs to the ends under M: the densities
    carry it along the strip, as Poisson's part could be, so that it is absent where slices join.
    """
    r0, r1 = h0 / (2 * np.sin(alpha)), h1 / (2 * np.sin(alpha))
    axial = alpha + np.sin(2 * alpha) / 2
    d = np.sin(2 * alpha) - 2 * alpha * np.cos(2 * alpha)

    def sigma(theta):
        return 2 * np.sin(2 * theta) / d

    def tau(theta):
        return (np.cos(2 * theta) - np.cos(2 * alpha)) / d

    nn = quad(lambda th: (np.cos(th) / axial) ** 2, -alpha, alpha)[0] * np.log(r1 / r0)
    # without Poisson's part the energy of shear stress is 2 tau^2/(2 E)
    mm = quad(lambda th: sigma(th) ** 2 + 2 * tau(th) ** 2, -alpha, alpha)[0]
    ends = quad(lambda th: tau(th) ** 2, -alpha, alpha)[0]
    return nn, mm * (r0**-2 - r1**-2) / 2, ends * (r0**-2 - r1**-2) / 2


@pytest.mark.parametrize("alpha", [0.03, 0.4, 1.2])
def test_a_wedge_shaped_strip_has_the_exact_energy(alpha):
    h0, h1 = 0.37, 1.9
    nn, mm, mv, vv = (float(f[0]) for f in densities(np.array([alpha])))
    x, w = np.polynomial.legendre.leggauss(40)
    h = 0.5 * (h0 + h1) + 0.5 * (h1 - h0) * x
    ds = 0.5 * (h1 - h0) * w / (2 * np.sin(alpha))  # along the surface h grows by 2 sin(alpha)
    # a pure moment about the apex is the same about the middle of every section
    exact_axial, exact_moment, ends = wedge_compliance(alpha, h0, h1)
    assert np.sum(nn / h * ds) == pytest.approx(exact_axial, rel=1e-9)
    moment = np.sum(mm / h**3 * ds)
    assert moment == pytest.approx(exact_moment + ends, rel=1e-9)
    # a shear force through the apex has M = V r cos(alpha) in every section, and its radial stress
    # V sin(theta)/(r (alpha - sin(2 alpha)/2)) has the energy of the logarithm
    lever = h / (2 * np.tan(alpha))
    energy = np.sum((mm * lever**2 / h**3 + mv * lever / h**2 + vv / h) * ds)
    exact = np.log(h1 / h0) / (alpha - np.sin(2 * alpha) / 2)
    assert energy == pytest.approx(exact, rel=1e-8)


def test_a_uniform_strip_is_timoshenko_s_beam():
    # a step of one part in 1e9 has no root to speak of
    leaf = Leaf(neck_thickness=0.4e-3, leaf_length=5.3e-3, notch_depth=0.4e-12)
    wedge = compliance(leaf, 71e9, NU, 8e-3, plane="stress").matrix
    beam = compliance(leaf, 71e9, NU, 8e-3, method="timoshenko", plane="stress").matrix
    t, length = leaf.neck_thickness, leaf.leaf_length
    eb = 71e9 * 8e-3
    exact = [
        length / t,
        length**3 / t**3 + 2.4 * (1 + NU) * length / t,
        12 * length / t**3,
    ]
    np.testing.assert_allclose(eb * np.diag(beam), exact, rtol=1e-12)
    np.testing.assert_allclose(np.diag(wedge), np.diag(beam), rtol=1e-8)


def test_the_root_of_a_leaf_does_not_depend_on_its_length():
    short, long = (
        Leaf(neck_thickness=0.4e-3, leaf_length=length, notch_depth=0.9e-3)
        for length in (3.1e-3, 7.7e-3)
    )
    roots = []
    for leaf in (short, long):
        wedge, beam = (
            compliance(leaf, 71e9, NU, 8e-3, method=m).matrix for m in ("wedge", "timoshenko")
        )
        roots.append([wedge[i, i] - beam[i, i] for i in (0, 2)])
    np.testing.assert_allclose(roots[0], roots[1], rtol=1e-9)


def test_a_v_without_a_fillet_is_two_wedges():
    # a V whose arc nearly vanishes is a wedge: its flank alone gives the moment compliance
    alpha = np.pi / 2 - 1.0
    notch = VFillet(neck_thickness=0.3, half_opening_angle=1.0, fillet_radius=1e-7, notch_depth=0.8)
    _, exact, ends = wedge_compliance(alpha, 0.3, 1.9)
    c = compliance(notch, 1.0, NU, 1.0, plane="stress").matrix
    assert c[2, 2] == pytest.approx(2 * (exact + ends), rel=1e-5)
