"""Geometry of an eccentric scale against constructions that share nothing with its closed forms.

Evidence (Measuring and centring): head error, disc and drum (search in space): $10^{-13}$ rad
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from flexstage.base.errors import ModelError, RecordError
from flexstage.centring import ARCSEC, exact_error, first_order_error
from flexstage.centring.from_records import head_of
from flexstage.centring.geometry import exact_run_out, in_turning_frame
from flexstage.centring.requests import CentreRequest
from flexstage.records import Channel, Record, read_record

R = 47e-3
THETA = np.linspace(0.13, 0.13 + 2.0 * np.pi, 361)[:-1]
E = np.array([3.1e-3, -2.2e-3])


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def amplitude(values, order, theta=THETA):
    return abs(2.0 * np.mean(values * np.exp(-1j * order * theta)))


def line_under_head(theta, head, e, kind):
    """Scale angle read, with the table turned in the room and the line searched for there.

    In the room the table turns backwards, so that the head travels forwards round the scale.
    """
    turn = rotation(-theta)
    radius_line = np.array([np.cos(head), np.sin(head)])

    def beside(psi):
        own = np.array([np.cos(psi), np.sin(psi)])
        line = turn @ own
        centre = turn @ e
        if kind == "disc":
            gap = R * radius_line - centre
            return line[0] * gap[1] - line[1] * gap[0]
        mark = centre + R * line
        return -(radius_line[1] * mark[0] - radius_line[0] * mark[1])

    near = theta + head
    return brentq(beside, near - 0.5, near + 0.5, xtol=1e-15)


@pytest.mark.parametrize("kind", ["disc", "drum"])
@pytest.mark.parametrize("head", [0.0, 1.23, -2.4])
def test_line_found_in_the_room(kind, head):
    for theta in (0.2, 1.9, 3.3, 5.8):
        read = line_under_head(theta, head, E, kind) - head
        found = exact_error(theta, E, R, head_angle=head, kind=kind)
        assert found == pytest.approx(read - theta, abs=1e-13)


def test_first_order_amplitude_and_phase():
    e, phi, alpha = 50e-6, 0.7, 1.1
    d = first_order_error(THETA, e * np.array([np.cos(phi), np.sin(phi)]), R, head_angle=alpha)
    assert d == pytest.approx(e / R * np.sin(THETA + alpha - phi), abs=1e-18)
    # 412.53 arcsec for each um of eccentricity on each mm of diameter
    assert amplitude(d, 1) / ARCSEC == pytest.approx(206264.806 * e / R, rel=1e-8)
    assert amplitude(d, 1) / ARCSEC == pytest.approx(412.5296 * 50.0 / 94.0, rel=1e-6)


def test_exact_series_on_a_disc():
    z = np.hypot(*E) / R
    d = exact_error(THETA, E, R)
    for n in (1, 2, 3, 4):
        assert amplitude(d, n) == pytest.approx(z**n / n, rel=1e-12)


def test_first_order_leaves_out_second_order():
    for scale in (1.0, 0.1, 0.01):
        e = scale * E
        z = np.hypot(*e) / R
        gap = exact_error(THETA, e, R) - first_order_error(THETA, e, R)
        assert np.abs(gap).max() == pytest.approx(0.5 * z**2, rel=1.5 * z)
        drum = exact_error(THETA, e, R, kind="drum") - first_order_error(THETA, e, R)
        assert np.abs(drum).max() == pytest.approx(z**3 / 6.0, rel=2.0 * z)


@pytest.mark.parametrize("kind", ["disc", "drum"])
@pytest.mark.parametrize("heads", [2, 3, 5])
def test_evenly_spaced_heads_leave_multiples_of_their_number(kind, heads):
    alphas = 0.4 + 2.0 * np.pi * np.arange(heads) / heads
    mean = np.mean([exact_error(THETA, E, R, head_angle=a, kind=kind) for a in alphas], axis=0)
    for n in range(1, 8):
        if n % heads:
            assert amplitude(mean, n) < 1e-15
    one = exact_error(THETA, E, R, kind=kind)
    if kind == "disc" or heads % 2:
        assert amplitude(mean, heads) == pytest.approx(amplitude(one, heads), rel=1e-9)
        assert amplitude(mean, heads) > 1e-9


def test_axis_motion_moves_the_scale_in_the_room():
    motion = np.column_stack((1e-6 * np.cos(3.0 * THETA), -2e-6 * np.sin(0.7 * THETA)))
    alpha = 0.9
    d = first_order_error(THETA, (0.0, 0.0), R, head_angle=alpha, axis_motion=motion)
    wanted = (motion[:, 0] * np.sin(alpha) - motion[:, 1] * np.cos(alpha)) / R
    assert d == pytest.approx(wanted, abs=1e-18)
    exact = exact_error(THETA, (0.0, 0.0), R, head_angle=alpha, axis_motion=motion)
    assert exact == pytest.approx(wanted, abs=2e-9)
    turned = in_turning_frame((0.0, 2.0), np.pi / 2.0)
    assert (turned.real, turned.imag) == pytest.approx((-2.0, 0.0), abs=1e-15)


def test_ellipticity_and_tilt_give_second_harmonics():
    s, about = 3e-5, 0.8
    oval = exact_error(THETA, (0.0, 0.0), R, ellipticity=(s, about))
    # a line at psi is seen at psi - s sin 2 (psi - about), so more than is seen is read
    assert oval == pytest.approx(s * np.sin(2.0 * (THETA - about)), abs=2.0 * s**2)
    tilt = 4e-3
    tilted = exact_error(THETA, (0.0, 0.0), R, tilt=(tilt, about))
    wanted = 0.25 * tilt**2 * np.sin(2.0 * (THETA - about))
    assert tilted == pytest.approx(wanted, abs=tilt**4)


def test_deformed_drum_holds_the_marks_that_are_seen():
    s, direction = 0.03, 0.5
    theta = np.array([0.4, 2.0, 4.4])
    d = exact_error(theta, E, R, kind="drum", ellipticity=(s, direction))
    for read, true in zip(theta + d, theta, strict=True):
        back = rotation(-direction)
        made = R * np.array([np.cos(read), np.sin(read)])
        seen = rotation(direction) @ (np.array([1.0 + s, 1.0 - s]) * (back @ made)) + E
        # the mark is on the radius of the head, on its side
        assert np.arctan2(seen[1], seen[0]) == pytest.approx(np.angle(np.exp(1j * true)), abs=1e-13)


def test_run_out_reaches_the_rim():
    e = E
    s = exact_run_out(THETA, e, R, indicator_angle=0.6)
    beta = THETA + 0.6
    touched = (R + s)[:, None] * np.column_stack((np.cos(beta), np.sin(beta)))
    assert np.hypot(*(touched - e).T) == pytest.approx(np.full(THETA.size, R), rel=1e-14)
    assert amplitude(s, 1) == pytest.approx(np.hypot(*e), rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"eccentricity": (0.05, 0.0)}, "inside the circle"),
        ({"eccentricity": (1e-6,)}, "must be x and y"),
        ({"eccentricity": (np.nan, 0.0)}, "must be x and y"),
        ({"radius": 0.0}, "radius of a scale"),
        ({"kind": "cone"}, "must be disc or drum"),
        ({"ellipticity": (1.2, 0.0)}, "ellipticity"),
        ({"tilt": (1.6, 0.0)}, "tilt"),
    ],
)
def test_impossible_geometry_is_refused(arguments, said):
    given = {"angle": THETA, "eccentricity": (1e-6, 2e-6), "radius": R, **arguments}
    with pytest.raises(ModelError, match=said):
        exact_error(**given)


@pytest.mark.parametrize(
    ("unit", "counts", "turn"),
    [("turn", None, 1.0), ("rev", None, 1.0), ("deg", None, 360.0), ("count", 8192.0, 8192.0)],
)
def test_a_turn_is_two_pi_in_every_unit_of_a_record(unit, counts, turn):
    columns = [Channel(name="t", values=turn * THETA / (2.0 * np.pi)),
               Channel(name="e", values=turn * 0.013 * np.sin(THETA))]  # fmt: skip
    record = Record(channels=tuple(columns), time=np.arange(THETA.size) * 1e-3)
    error = 2.0 * np.pi * 0.013 * np.sin(THETA)
    request = CentreRequest(error=("e",), angle="t", counts=counts, unit=unit)
    found, radial = head_of(record, "e", request, 0.0)
    assert not radial
    assert found.angle == pytest.approx(THETA, rel=1e-14)
    assert found.error == pytest.approx(error, abs=1e-15)
    request = CentreRequest(error=("e",), turns=3.0, counts=counts, unit=unit)
    even, _ = head_of(record, "e", request, 0.0)
    assert even.angle[-1] == pytest.approx(6.0 * np.pi * (1.0 - 1.0 / THETA.size), rel=1e-14)


def test_a_turn_behind_a_column_is_a_unit(tmp_path):
    (tmp_path / "t.csv").write_text("t,e\n0,0.25\n1,0.5\n")
    record = read_record(tmp_path / "t.csv", columns=["t turn", "e rev"], over="point")
    assert [c.unit for c in record.channels] == ["rad", "rad"]
    assert record.channel("e rev").values == pytest.approx([np.pi / 2.0, np.pi], rel=1e-15)
    with pytest.raises(RecordError, match="column 't' has two units: give one"):
        read_record(tmp_path / "t.csv", columns=["t turn", "t deg"], over="point")
