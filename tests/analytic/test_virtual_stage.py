"""What a virtual stage is told to do, it does; and what it does, its records show."""

import math

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.experiments.virtual_campaign import virtual_campaign
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from flexstage.system import frequency_response, modes
from flexstage.virtual.as_built import as_built
from flexstage.virtual.imperfections import (
    GuideErrors,
    Scatter,
    displaced_system,
    displacements,
    manufactured,
    random_guide,
)
from flexstage.virtual.laboratory import (
    HammerBench,
    Laboratory,
    motion_record,
    sphere_record,
    staircase_record,
    workspace_record,
)
from tests.true_figures import true_figures


@pytest.fixture(scope="module")
def piezo():
    return as_built(design("vgtu-piezo"), seed=5)


@pytest.fixture(scope="module")
def screw():
    return as_built(design("vgtu-mechanical"), seed=5)


def quiet(**changes: float) -> Laboratory:
    """A laboratory whose sensors are right."""
    from flexstage.virtual.sensors import SimulatedSensor

    perfect = SimulatedSensor(noise_rms=0.0)
    turn = SimulatedSensor(noise_rms=0.0, unit="rad")
    return Laboratory(
        position=perfect, transverse=perfect, angle=turn, signal_to_noise=1e12, **changes
    )


def test_necks_scatter_as_the_process_says() -> None:
    stage = design("vgtu-piezo")
    process = Scatter(neck_common=3e-6, neck_own=1.5e-6, modulus=0.02)
    off = np.array(
        [
            [
                made.profile.neck_thickness - drawn.profile.neck_thickness
                for made, drawn in zip(
                    manufactured(stage, process, seed=i).hinges, stage.hinges, strict=True
                )
            ]
            for i in range(200)
        ]
    )
    # 200 draws: a standard deviation is known to 5 %
    assert off.mean(axis=1).std() == pytest.approx(math.hypot(3e-6, 1.5e-6 / 32**0.5), rel=0.15)
    assert (off - off.mean(axis=1, keepdims=True)).std() == pytest.approx(1.5e-6, rel=0.04)


def test_a_process_that_leaves_no_neck_is_refused() -> None:
    with pytest.raises(ModelError, match="finer process"):
        manufactured(design("vgtu-piezo"), Scatter(neck_own=400e-6), seed=1)
    with pytest.raises(ModelError, match="0 or more"):
        Scatter(position=-1e-6)


def test_a_notch_out_of_place_couples_the_axes() -> None:
    stage = design("vgtu-piezo")
    nowhere = displaced_system(stage, {})
    assert np.allclose(nowhere.K, lumped_system(stage).K, rtol=1e-12, atol=0.0)
    off = displaced_system(stage, displacements(stage, Scatter(position=20e-6), seed=2))
    # still a stage: stiff in every direction but the two axes, and stiffness symmetric
    assert np.array_equal(off.K, off.K.T)
    assert modes(off).frequency_hz[2] > 5.0 * modes(off).frequency_hz[1]
    cross = abs(frequency_response(off, [10.0], "x", "y").value[0])
    straight = abs(frequency_response(nowhere, [10.0], "x", "y").value[0])
    assert cross > 1e4 * straight


def test_guides_are_as_straight_as_they_are_told() -> None:
    rng = np.random.default_rng(8)
    guide = random_guide(71e-6, {"across": 1.3e-7, "roll": 4e-6}, {"across": 3.1e-4}, rng)
    assert guide.straightness("across") == pytest.approx(1.3e-7, rel=1e-9)
    assert guide.slope("across") == pytest.approx(3.1e-4, rel=1e-3)
    assert guide.straightness("roll") == pytest.approx(4e-6, rel=1e-9)
    assert guide.at(0.0, "across") == 0.0
    assert np.all(guide.at([0.0, 5e-6], "yaw") == 0.0)


def test_figures_of_a_parabola_are_those_of_closed_form() -> None:
    # P2 has its ends at 1 and its middle at -1/2
    guide = GuideErrors(stroke=40e-6, coefficients={"pitch": np.array([0.0, 6e-6, 2e-6])})
    assert guide.straightness("pitch") == pytest.approx(3e-6, rel=1e-6)
    assert guide.slope("pitch") == pytest.approx(2 * 6e-6 / 40e-6, rel=1e-9)
    assert guide.at(40e-6, "pitch") == pytest.approx(12e-6, rel=1e-12)
    with pytest.raises(ModelError, match="positive"):
        random_guide(0.0, {}, {}, rng)


rng = np.random.default_rng(0)


@pytest.mark.parametrize("kind", ["piezo", "screw"])
def test_measured_figures_that_are_published_are_the_truth(
    kind: str, request: pytest.FixtureRequest
) -> None:
    built = request.getfixturevalue(kind)
    truth = true_figures(built)
    rows = [r for r in built.stage.published if r.origin == "published-measured"]
    checked = 0
    for row in rows:
        if (row.quantity, row.axis) in truth:
            got = truth[row.quantity, row.axis]
            assert got == pytest.approx(row.value, rel=2e-3), (row.quantity, row.axis)
            checked += 1
    assert checked >= 8
    other = as_built(built.stage, seed=5, as_published=False)
    assert abs(true_figures(other)["natural_frequency_hz", "x"] / rows[2].value - 1.0) > 0.01


def test_a_cycle_runs_from_the_low_end_to_the_stroke(piezo, screw) -> None:
    for built in (piezo, screw):
        axis = built.axis("x")
        record = motion_record(built, quiet(cycles=2), "x", seed=3)
        along = record.channel("along").values
        # what differs from approach to approach is all that is left
        assert abs(along.min()) < 4.0 * axis.repeatability
        slack = 4.0 * axis.repeatability + axis.reversal * (axis.hysteresis is None)
        slack += abs(float(axis.guide.at(axis.stroke, "along"))) * (axis.hysteresis is None)
        assert np.ptp(along) == pytest.approx(axis.stroke, abs=slack + 1e-3 * axis.stroke)
        across = record.channel("across").values
        assert np.allclose(across, axis.guide.at(along, "across"), rtol=0.0, atol=1e-18)
        assert "virtual record" in record.notes[0]
        assert record.attributes["origin"] == "virtual"


def test_spheres_move_as_a_rigid_body(screw) -> None:
    record = sphere_record(screw, quiet(cycles=1), "y", noise=0.0, seed=2)
    axis = screw.axis("y")
    centres = np.stack([[record.channel(f"SPH{i}.{k}").values for k in "XYZ"] for i in range(1, 6)])
    distances = np.linalg.norm(centres[0] - centres[3], axis=0)
    assert np.ptp(distances) < 1e-15
    # the centre of the plate lies above the reading point, and goes with its rotations
    centre = centres.mean(axis=0)
    moved = centre[1] - centre[1, 0]
    position = axis.position(record.channel("command").values)
    lever = centre[:, 0]
    turned = lever[0] * axis.guide.at(position, "yaw") - lever[2] * axis.guide.at(position, "pitch")
    expected = position + turned - (position + turned)[0]
    approach = 4.0 * axis.repeatability
    assert np.abs(moved - expected).max() < 2.0 * approach
    assert np.abs(moved - position).max() > 2.5 * approach


def test_steps_of_a_staircase(piezo, screw) -> None:
    lab = quiet(levels=5, per_level=6)
    steps = np.diff(staircase_record(screw, lab, "x").channel("along").values[::6])
    axis = screw.axis("x")
    assert axis.smallest_step is not None
    assert steps == pytest.approx(axis.smallest_step, rel=0.05)
    held = staircase_record(piezo, Laboratory(levels=5, per_level=200), "y").channel("along").values
    means = held.reshape(5, 200).mean(axis=1)
    # a small step in the middle of a stack's range is smaller than in proportion: minor loops
    assert np.all(np.diff(means) > 0.5 * 6.0 * 5e-9)


def test_blows_show_the_response_of_the_stage(piezo) -> None:
    record = HammerBench(piezo, quiet(hits=1)).record("x", seed=1)
    n = record.size
    force = np.fft.rfft(record.channel("force").values)
    reading = np.fft.rfft(record.channel("acceleration x").values)
    f = np.fft.rfftfreq(n, 1.0 / record.sample_rate_hz)
    band = (f > 250.0) & (f < 450.0)
    measured = reading[band] / force[band]
    found = modes(piezo.system, drives="removed", count=None)
    p = piezo.system.probe("x").vector @ found.shapes
    w = 2.0 * np.pi * f[band][:, None]
    sum_of_modes = (
        p**2 / (found.omega**2 - w**2 + 2j * found.damping_ratio * found.omega * w)
    ).sum(axis=1)
    # the force has noise of its own, 1e-4 of the blow
    assert np.abs(measured / (-(w[:, 0] ** 2) * sum_of_modes) - 1.0).max() < 0.02


def test_corners_make_the_area(piezo) -> None:
    record = workspace_record(piezo, quiet(repeats=50), seed=4)
    corner = record.channel("corner").values
    x = np.array([record.channel("x").values[corner == k].mean() for k in range(4)])
    y = np.array([record.channel("y").values[corner == k].mean() for k in range(4)])
    area = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    figures = true_figures(piezo)
    assert area == pytest.approx(figures["workspace_area", "xy"], rel=1e-4)
    # what the angle between the sides that meet at the origin is beyond 90 degrees
    origin, right, up = np.argmin(x + y), np.argmax(x - y), np.argmax(y - x)
    sides = (np.arctan2(y[k] - y[origin], x[k] - x[origin]) for k in (up, right))
    angle = float(np.subtract(*sides)) - 0.5 * np.pi
    assert abs(angle) > 1e-4
    assert figures["squareness", "xy"] == pytest.approx(angle, abs=0.03 * abs(angle))
    assert record.over == "point"


def test_the_same_seed_gives_the_same_records(piezo) -> None:
    once, again = (virtual_campaign(piezo, seed=9).records for _ in range(2))
    other = virtual_campaign(piezo, seed=10).records
    for name, record in once.items():
        values = [c.values for c in record.channels]
        assert all(
            np.array_equal(a, c.values) for a, c in zip(values, again[name].channels, strict=True)
        )
        assert any(
            not np.array_equal(a, c.values)
            for a, c in zip(values, other[name].channels, strict=True)
        )


def test_an_axis_that_is_not_there(piezo) -> None:
    with pytest.raises(ModelError, match="no axis 'z'"):
        piezo.axis("z")


def test_a_random_guide_is_as_straight_and_as_inclined_as_is_said() -> None:
    """Curves of the orders 2 to 5, and the slope of their line."""
    drawn = random_guide(
        73e-6, {"across": 31e-9, "yaw": 4e-6}, {"yaw": 0.21}, np.random.default_rng(17)
    )
    for motion, wanted, slope in (("across", 31e-9, 0.0), ("yaw", 4e-6, 0.21)):
        c = drawn.coefficients[motion]
        assert c.size == 6
        assert np.all(c[2:] != 0.0)
        assert (c[0], c[1]) == (0.0, pytest.approx(0.5 * slope * 73e-6))
        # the line of least squares takes nothing of even orders, and little of odd ones
        x = np.linspace(0.0, 73e-6, 4001)
        y = drawn.at(x, motion)
        weight = np.ones(x.size)
        weight[[0, -1]] = 0.5**0.5
        line = np.polynomial.Polynomial.fit(x, y, 1, w=weight)
        assert np.ptp(y - line(x)) == pytest.approx(wanted, rel=1e-3)
