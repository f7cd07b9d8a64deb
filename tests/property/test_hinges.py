"""What must hold for every notch: scaling, symmetry, definiteness, converged quadrature."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from flexstage.base.errors import HingeError
from flexstage.hinges import (
    CornerFilleted,
    Elliptical,
    Hyperbolic,
    Leaf,
    Parabolic,
    PowerFunction,
    Profile,
    RightCircular,
    VFillet,
    compliance,
    profile,
    stress_rows,
)
from flexstage.hinges.compliance import QUADRATURES
from flexstage.hinges.registry import profile_class
from flexstage.stage.curve import Curve, point_distance

E, NU, B = 68.9e9, 0.33, 7.3e-3
LENGTHS = (
    "neck_thickness",
    "radius",
    "half_length",
    "notch_depth",
    "notch_length",
    "fillet_radius",
    "leaf_length",
)
# a contour that turns at its end only
ALMOST_STRAIGHT = PowerFunction(
    neck_thickness=0.5e-3, half_length=2e-3, notch_depth=1e-3, exponent=32.0
)


@st.composite
def notches(draw: st.DrawFn, one_sided: bool | None = None) -> Profile:
    """Draw a notch of any profile: neck 0.03 to 0.8 of its depth, of any steepness."""
    size = draw(st.floats(0.2e-3, 5e-3))
    t = size * draw(st.floats(0.03, 0.8))
    length = size * draw(st.floats(0.7, 4.0))
    cut = draw(st.booleans()) if one_sided is None else one_sided
    base = {"neck_thickness": t, "one_sided": cut}
    smooth = {**base, "half_length": length, "notch_depth": size}
    kind = draw(st.integers(0, 7))
    if kind == 0:
        return RightCircular(**base, radius=size)
    if kind == 1:
        return CornerFilleted(**base, fillet_radius=size, notch_length=2 * size + length)
    if kind == 2:
        return Leaf(**base, leaf_length=length, notch_depth=size)
    if kind == 3:
        angle = draw(st.floats(0.1, 1.3))
        return VFillet(
            **base, half_opening_angle=angle, fillet_radius=0.6 * size, notch_depth=1.1 * size
        )
    if kind == 4:
        return PowerFunction(**smooth, exponent=draw(st.floats(2.0, 9.0)))
    return (Elliptical, Parabolic, Hyperbolic)[kind - 5](**smooth)


# finite elements have rounding and take their time; they are compared elsewhere
methods = st.sampled_from(QUADRATURES)
planes = st.sampled_from(["stress", "strain"])


def scaled(notch: Profile, factor: float) -> Profile:
    """Return a notch with all its lengths scaled."""
    names = [f.name for f in dataclasses.fields(notch) if f.name in LENGTHS]
    return dataclasses.replace(notch, **{n: factor * getattr(notch, n) for n in names})


@given(notches(), methods, planes, st.floats(0.1, 10.0), st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_compliance_scales(notch, method, plane, size, width, modulus):
    c = compliance(notch, E, NU, B, method=method, plane=plane).matrix
    other = compliance(
        scaled(notch, size), E * modulus, NU, B * width, method=method, plane=plane
    ).matrix
    # plane problem: u ~ N/(E b), theta ~ N/(E b L), theta ~ M/(E b L^2)
    powers = size ** -np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 1.0, 2.0]])
    scale = np.sqrt(np.outer(np.diag(c), np.diag(c)))
    # rounding of the rotated sections only
    np.testing.assert_array_less(
        np.abs(other * modulus * width / powers - c), 1e-10 * scale + 1e-300
    )


@given(notches(), methods, planes)
def test_compliance_is_symmetric_and_positive_definite(notch, method, plane):
    spring = compliance(notch, E, NU, B, method=method, plane=plane)
    c = spring.matrix
    np.testing.assert_array_equal(c, c.T)
    scale = np.sqrt(np.diag(c))
    assert np.linalg.eigvalsh(c / np.outer(scale, scale))[0] > 0.0
    np.testing.assert_allclose(spring.stiffness @ c, np.eye(3), atol=1e-8)


@given(notches(), methods, planes)
def test_shear_is_uncoupled_about_the_neck_and_so_is_tension_of_a_notch_cut_from_both_sides(
    notch, method, plane
):
    c = compliance(notch, E, NU, B, method=method, plane=plane).matrix
    scale = np.sqrt(np.outer(np.diag(c), np.diag(c)))
    relative = np.abs(c) / scale
    # the notch is symmetric about its neck: contributions of the two halves cancel to rounding
    assert relative[0, 1] < 1e-12
    assert relative[1, 2] < 1e-12
    if not notch.one_sided:
        assert relative[0, 2] < 1e-12


@given(notches(), methods)
def test_the_quadrature_is_converged(notch, method):
    coarse = compliance(notch, E, NU, B, method=method).matrix
    kept = profile._PANELS
    try:
        profile._PANELS = np.sort(np.concatenate([kept, 0.5 * (kept[:-1] + kept[1:])]))
        fine = compliance(notch, E, NU, B, method=method).matrix
    finally:
        profile._PANELS = kept
    scale = np.sqrt(np.outer(np.diag(fine), np.diag(fine)))
    assert np.max(np.abs(coarse - fine) / scale) < 1e-11


@given(notches(one_sided=False), planes)
def test_correcting_for_spreading_stress_makes_a_notch_softer_in_rotation(notch, plane):
    wedge, beam = (
        compliance(notch, E, NU, B, method=m, plane=plane).matrix for m in ("wedge", "timoshenko")
    )
    assert wedge[2, 2] > beam[2, 2]


@given(st.floats(0.1e-3, 3e-3), st.floats(0.01, 1.0), st.booleans())
def test_area_of_a_circular_notch_is_that_of_its_arcs(radius, ratio, one_sided):
    t = ratio * radius
    notch = RightCircular(neck_thickness=t, radius=radius, one_sided=one_sided)
    area, first_x, first_y, _ = notch.half_area_integrals()
    sides = 1 if one_sided else 2
    # rectangle under a quarter circle of radius R: R^2 (1 - pi/4), first moment R^3/2 - R^3/3
    corner = radius**2 * (1.0 - math.pi / 4.0)
    assert area == pytest.approx(t * radius + sides * corner, rel=1e-12)
    assert first_x == pytest.approx(t * radius**2 / 2 + sides * radius**3 / 6, rel=1e-12)
    # about the middle of the neck: the corner's own first moment is R^3 (5/6 - pi/4)
    above = radius**3 * (5.0 / 6.0 - math.pi / 4.0) + 0.5 * t * corner
    assert first_y == pytest.approx(above if one_sided else 0.0, rel=1e-12, abs=1e-24)


@given(notches())
@example(ALMOST_STRAIGHT)
def test_contour_runs_from_the_neck_to_the_root(notch):
    contour = notch.contour()
    assert (contour[0].x, contour[0].depth) == (0.0, 0.0)
    assert contour[-1].x == pytest.approx(notch.length / 2, rel=1e-12)
    assert contour[-1].depth == pytest.approx(notch.depth, rel=1e-9)
    depths = [v.depth for v in contour]
    assert depths == sorted(depths)
    assert all(v.bulge >= 0.0 for v in contour)


@given(notches())
@example(ALMOST_STRAIGHT)
def test_contour_is_within_ten_nanometres_of_the_curve(notch):
    curves = [Curve(a[:2], b[:2], a.bulge) for a, b in pairwise(notch.contour())]
    x, depth, _, _ = notch.samples()
    for point in zip(x[::13].tolist(), depth[::13].tolist(), strict=True):
        assert min(point_distance(point, c) for c in curves) < 10e-9


@given(notches())
def test_pieces_follow_each_other_and_know_their_slope(notch):
    u = np.linspace(0.0, 1.0, 7)
    step = 1e-6
    end = (0.0, 0.0)
    for piece in notch.pieces():
        x, depth, angle, speed = piece(u)
        assert (x[0], depth[0]) == pytest.approx(end, abs=1e-12 * notch.length)
        end = (x[-1], depth[-1])
        low, high = piece(u[1:-1] - step), piece(u[1:-1] + step)
        # central differences: error step^2 plus rounding 1e-16/step
        dx, dy = ((high[i] - low[i]) / (2 * step) for i in (0, 1))
        size = np.max(speed)
        np.testing.assert_allclose(dx, (speed * np.cos(angle))[1:-1], atol=1e-7 * size)
        np.testing.assert_allclose(dy, (speed * np.sin(angle))[1:-1], atol=1e-7 * size)


@given(notches(), planes)
def test_stress_rows_balance_the_forces_in_the_neck(notch, plane):
    rows = stress_rows(notch, B, NU, plane)
    assert rows.shape == (4 if notch.flat_length > 0.0 else 2, 3)
    t = notch.neck_thickness
    equivalent = 1.0 if plane == "stress" else math.sqrt(1 - NU + NU**2)
    # never below the beam's stress, but for the straight side of a notch cut from one side
    assume(not notch.one_sided)
    assert np.all(rows[:, 0] * B * t / equivalent >= 1.0 - 1e-12)
    assert np.all(np.abs(rows[:, 2]) * B * t**2 / 6 / equivalent >= 1.0 - 1e-12)
    left, right = rows[0::2], rows[1::2]
    np.testing.assert_allclose(left[:, 0], right[:, 0])
    np.testing.assert_allclose(left[:, 2], -right[:, 2])
    if notch.flat_length > 0.0:
        # M(x) = M - V x at the two ends of the flat part
        lever = 0.5 * notch.flat_length
        np.testing.assert_allclose(rows[:2, 1], lever * rows[:2, 2])
        np.testing.assert_allclose(rows[2:, 1], -lever * rows[2:, 2])


def test_impossible_notches_are_refused():
    with pytest.raises(HingeError, match="neck_thickness must be positive"):
        RightCircular(neck_thickness=-1e-3, radius=1e-3)
    with pytest.raises(HingeError, match="at least two fillet radii"):
        CornerFilleted(neck_thickness=1e-3, notch_length=1e-3, fillet_radius=0.6e-3)
    with pytest.raises(HingeError, match="below pi/2"):
        VFillet(neck_thickness=1e-3, half_opening_angle=1.6, fillet_radius=1e-3, notch_depth=1e-3)
    with pytest.raises(HingeError, match="reach the end of the fillet"):
        VFillet(neck_thickness=1e-3, half_opening_angle=0.4, fillet_radius=1e-3, notch_depth=0.1e-3)
    with pytest.raises(HingeError, match="between 2 and 32"):
        PowerFunction(neck_thickness=1e-3, half_length=1e-3, notch_depth=1e-3, exponent=1.5)
    with pytest.raises(HingeError, match="did you mean 'circular'"):
        profile_class("circle")
    with pytest.raises(HingeError, match="too extreme"):
        compliance(RightCircular(neck_thickness=1e-10, radius=1e-3), E, NU, B)


@given(notches())
def test_the_neck_radius_is_that_of_the_contour(notch):
    """By the slope of what is cut out next to the neck: dx/d(angle) = R of a round contour."""
    radius = notch.neck_radius
    if notch.flat_length > 0.0 or not 0.0 < radius < math.inf:
        return
    x, _, angle, _ = next(iter(notch.pieces()))(np.array([1e-4]))
    # the next term is of the order of the square of the angle
    assert angle[0] < 0.03
    assert x[0] / angle[0] == pytest.approx(radius, rel=1e-3)
