"""Identities of eccentricity and its fits: turning the frame, scaling, order of samples.

Evidence (Measuring and centring): eccentricity to 0.3 of the radius, exact readings: $10^{-9}$ of
radius, *consistency*
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.centring import (
    HeadReadings,
    eccentricity,
    exact_error,
    first_order_error,
    fit_harmonics,
)
from flexstage.centring.turns import find_turns, unwrap_error

angles = st.floats(-7.0, 7.0)
radii = st.floats(5e-3, 0.4)
shares = st.floats(1e-7, 0.5)
kinds = st.sampled_from(("disc", "drum"))
few = settings(max_examples=25, deadline=None)


def vector(length, direction):
    return np.array([length * np.cos(direction), length * np.sin(direction)])


@few
@given(angles, angles, angles, shares, radii, kinds)
def test_turning_frame_and_head_together_changes_nothing(theta, alpha, phi, share, radius, kind):
    plain = exact_error(theta, vector(share * radius, phi), radius, head_angle=alpha, kind=kind)
    moved = exact_error(
        theta, vector(share * radius, phi + 0.83), radius, head_angle=alpha + 0.83, kind=kind
    )
    assert moved == pytest.approx(plain, abs=1e-13)


@few
@given(angles, angles, shares, radii, st.floats(0.01, 90.0), kinds)
def test_only_the_ratio_to_the_radius_counts(theta, phi, share, radius, factor, kind):
    e = vector(share * radius, phi)
    small = exact_error(theta, e, radius, kind=kind)
    large = exact_error(theta, factor * e, factor * radius, kind=kind)
    assert large == pytest.approx(small, abs=1e-13)


@few
@given(angles, angles, shares, kinds)
def test_the_mirror_image_errs_the_other_way(theta, phi, share, kind):
    plain = exact_error(theta, vector(share, phi), 1.0, kind=kind)
    assert exact_error(-theta, vector(share, -phi), 1.0, kind=kind) == pytest.approx(
        -plain, abs=1e-13
    )


@few
@given(angles, angles, shares, kinds)
def test_first_order_is_close(theta, phi, share, kind):
    e = vector(0.2 * share, phi)
    gap = exact_error(theta, e, 1.0, kind=kind) - first_order_error(theta, e, 1.0)
    assert abs(gap) <= 0.6 * (0.2 * share) ** 2 + 1e-15


@few
@given(
    st.floats(1e-7, 0.3),
    angles,
    st.lists(st.floats(0.0, 6.2), min_size=1, max_size=4, unique_by=lambda a: round(a, 1)),
    angles,
    kinds,
    st.booleans(),
)
def test_eccentricity_comes_back_from_exact_readings(share, phi, heads, start, kind, backwards):
    radius = 37e-3
    e = vector(share * radius, phi)
    theta = start + (-1.0 if backwards else 1.0) * np.arange(64) * 2.0 * np.pi / 64
    readings = [
        HeadReadings(
            angle=theta % (2.0 * np.pi),
            error=exact_error(theta, e, radius, head_angle=a, kind=kind) + 3e-3 * i,
            head_angle=a,
        )
        for i, a in enumerate(heads)
    ]
    found = eccentricity(readings, radius=radius, kind=kind, orders=3)
    assert found.vector == pytest.approx(e, abs=1e-9 * radius)


@few
@given(st.integers(0, 2**32 - 1), st.floats(1e-9, 1e6), st.floats(-3.0, 3.0))
def test_a_fit_scales_and_turns(seed, factor, start):
    rng = np.random.default_rng(seed)
    theta = np.arange(70) * 2.0 * np.pi / 70
    y = rng.normal(size=70)
    plain = fit_harmonics(theta, y, orders=4, robust=False)
    other = fit_harmonics(theta + start, factor * y, orders=4, robust=False)
    for a, b in zip(plain.harmonics, other.harmonics, strict=True):
        assert b.amplitude.value == pytest.approx(factor * a.amplitude.value, rel=1e-7)
        assert b.amplitude.uncertainty == pytest.approx(factor * a.amplitude.uncertainty, rel=1e-3)
        turned = np.exp(1j * (b.phase.value - a.phase.value - a.order * start))
        if a.amplitude.value > 1e-3:
            assert abs(turned - 1.0) < 1e-6


@few
@given(
    st.integers(20, 400), st.floats(0.9, 6.0), st.floats(0.0, 360.0), st.sampled_from((1.0, -1.0))
)
def test_wraps_come_off(size, turns, start, sign):
    if size < 4.5 * turns:
        return
    true = start + sign * 360.0 * turns * np.arange(size) / size
    found = find_turns(np.radians(true % 360.0))
    steps = np.degrees(np.diff(found.angle))
    assert steps == pytest.approx(np.diff(true), abs=1e-9)
    assert found.bounds[0] == 0
    assert found.bounds[-1] == size
    assert all(b > a for a, b in zip(found.bounds[:-1], found.bounds[1:], strict=True))


@few
@given(
    st.lists(st.floats(-80.0, 80.0), min_size=1, max_size=30),
    st.floats(-900.0, 900.0),
    st.integers(0, 2**32 - 1),
)
def test_whole_turns_come_off_errors(errors, middle, seed):
    true = np.array(errors) + middle
    wrapped = true + 360.0 * np.random.default_rng(seed).integers(-2, 3, true.size)
    found = np.degrees(unwrap_error(np.radians(wrapped)))
    assert np.diff(found) == pytest.approx(np.diff(true), abs=1e-9)
