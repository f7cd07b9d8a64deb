"""Seats of drives: contacts against closed forms, equilibrium, masses, and stage files.

Evidence (Stages, tolerances, designs): seats of drives, ball and crossed cylinders
(Hertz's integrals, by quadrature): approach and pressure 1e-9
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import quad

from flexstage.base.errors import ModelError, StageError
from flexstage.hysteresis.build_model import dynamic_model
from flexstage.lumped import lumped_system
from flexstage.stage import Force, Stage, read_stage, write_stage
from flexstage.stage.designs import design
from flexstage.stage.seat import (
    BallSeat,
    FlatSeat,
    Preload,
    Seat,
    TipSeat,
    seats_stiffness,
)
from flexstage.studies.explore.family import _stroke_left
from flexstage.system.analysis import analyse
from flexstage.system.modes import modes
from flexstage.system.seated_drives import contact_forces, seat_notes, static_drives
from flexstage.system.statics import drive_stiffness, static_displacements
from flexstage.virtual.as_built import platform_stroke

BALL = BallSeat(radius=10e-3, contact_modulus=115.4e9)


@cache
def stage(*seats: Seat, preload: float = 0.0, spring: float = 0.0, **fields: float) -> Stage:
    """Return the piezo stage with both drives on these seats."""
    held = Preload(force=preload, spring_stiffness=spring) if preload else None
    drives = (replace(d, seats=seats, preload=held, **fields) for d in design("vgtu-piezo").drives)
    return replace(design("vgtu-piezo"), drives=tuple(drives))


@pytest.mark.parametrize("second", [10e-3, 6e-3, 0.5e-3])
def test_contacts_are_those_of_hertz(second: float) -> None:
    seat, force = replace(BALL, second_radius=second), 37.0
    # unknown semi-axes of the ellipse, from the curvatures that the pressure must make
    scale = 3.0 * force / (4.0 * np.pi * seat.contact_modulus)

    def integral(a: float, b: float, power: float, which: int) -> float:
        def f(t: float) -> float:  # w = t^2, which removes the root at zero
            own = (a * a + t * t, b * b + t * t)
            return 2.0 / np.sqrt(own[0] * own[1]) / own[which] ** power

        size = np.sqrt(a * b)
        return (
            quad(f, 0.0, size, epsabs=0, epsrel=1e-12)[0]
            + quad(f, size, np.inf, epsabs=0, epsrel=1e-12)[0]
        )

    from scipy.optimize import fsolve

    mean = np.sqrt(seat.radius * second)
    first = (0.75 * force * mean / seat.contact_modulus) ** (1.0 / 3.0)

    def mismatch(logs: np.ndarray) -> list[float]:
        a, b = first * np.exp(logs)
        return [
            2.0 * scale * integral(a, b, 1.0, k) * r - 1.0
            for k, r in enumerate((seat.radius, second))
        ]

    ratio = (second / seat.radius) ** (1.0 / 3.0)
    logs = (
        fsolve(mismatch, [-np.log(ratio), np.log(ratio)], xtol=1e-10) if ratio < 1.0 else [0.0] * 2
    )
    a, b = first * np.exp(logs)
    assert seat.approach(force, 0.0) == pytest.approx(scale * integral(a, b, 0.0, 0), rel=1e-9)
    assert seat.pressure(force) == pytest.approx(1.5 * force / (np.pi * a * b), rel=1e-9)


def test_a_ball_approaches_by_the_square_of_its_contact_over_its_radius() -> None:
    a = (0.75 * 50.0 * 10e-3 / 115.4e9) ** (1.0 / 3.0)
    assert BALL.approach(50.0, 0.0) == pytest.approx(a**2 / 10e-3, rel=1e-12)
    assert BALL.stiffness(50.0) == pytest.approx(2.0 * 115.4e9 * a, rel=1e-12)


@pytest.mark.parametrize(
    "seat", [BALL, FlatSeat(roughness_length=0.72e-6), TipSeat(axial_stiffness=3e7)]
)
def test_stiffness_is_the_slope_of_the_law(seat: Seat) -> None:
    step = 1e-3
    slope = 2.0 * step / (seat.approach(20.0 + step, 5.0) - seat.approach(20.0 - step, 5.0))
    assert seat.stiffness(20.0) == pytest.approx(slope, rel=1e-6)
    assert seat.approach(5.0, 5.0) == 0.0
    assert seats_stiffness((seat, seat), 20.0) == pytest.approx(0.5 * seat.stiffness(20.0))


def test_without_seats_it_is_the_linear_stage_and_its_load_line() -> None:
    plain = stage()
    system = lumped_system(plain)
    state = static_drives(plain, system, {"x": 38e-6})
    K = system.K + system.drive_springs("in place")[0]
    q = np.linalg.solve(K, 50e6 * 38e-6 * system.drive("x").vector)
    assert state.static.q == pytest.approx(q, rel=1e-9, abs=1e-15)
    # a rigid screw imposes its displacement
    screws = design("vgtu-mechanical")
    system = lumped_system(screws)
    moved = static_drives(screws, system, {"x": 100e-6, "y": 0.0})
    imposed = static_displacements(system, {"x": 100e-6, "y": 0.0})
    assert moved.static.q == pytest.approx(imposed.q, rel=1e-9, abs=1e-15)


def test_the_stroke_is_of_the_secant_and_the_frequency_of_the_tangent() -> None:
    """A rough seat without preload has the measured 337 Hz of the study and most of its stroke."""
    rough = stage(FlatSeat(roughness_length=0.72e-6), preload=0.41)
    system = lumped_system(rough)
    bare, low = (modes(system, drives=c, count=1).frequency_hz[0] for c in ("removed", "in place"))
    k_in = drive_stiffness(system, "x", others="in place")
    soft = rough.drive("x").mounted.stiffness
    assert soft == pytest.approx(1.0 / (1.0 / 50e6 + 0.72e-6 / 0.41))
    # one mode: the square rises by the added stiffness, within what the other modes give way
    assert low**2 / bare**2 == pytest.approx(1.0 + soft / k_in, rel=0.02)
    state = static_drives(rough, system, {"x": 38e-6})
    force = state.drives["x"].force
    # the balance, with the law written out
    given = force / 50e6 + 0.72e-6 * np.log((0.41 + force) / 0.41)
    assert state.drives["x"].elongation + given == pytest.approx(38e-6, rel=1e-9)
    left = state.drives["x"].elongation / 38e-6
    assert 0.75 < left < 0.85
    # the tangent would leave a tenth
    assert soft / (soft + k_in) < 0.12
    length = state.drives["x"].elongation
    share = _stroke_left(rough, {"x": {"x": (length, force)}})
    assert share["x"] == pytest.approx(left, rel=1e-9)


def test_a_drive_lifts_off_where_its_seat_would_pull() -> None:
    held = stage(BALL, preload=0.24)
    system = lumped_system(held)
    state = static_drives(held, system, {"x": -5e-6})
    assert state.drives["x"].is_open
    assert state.drives["x"].contact_force == 0.0
    assert state.drives["x"].force == -0.24
    # all that is left is the preload that it lacks
    lacks = np.linalg.solve(system.K, -0.24 * system.drive("x").vector)
    assert state.static.readings["x"] == pytest.approx(
        float(system.probe("x").vector @ lacks), rel=1e-2
    )
    glued = stage(TipSeat(axial_stiffness=3e7))
    assert not static_drives(glued, lumped_system(glued), {"x": -5e-6}).drives["x"].is_open
    # a load that takes the platform away opens it as well
    away = 2.0 * system.drive("x").vector
    assert static_drives(held, system, {}, load=away).drives["x"].is_open


def test_no_seat_that_presses_holds_a_pull() -> None:
    assert stage(BALL, preload=0.24).drive("x").compression(-0.25) == -np.inf
    assert stage(BALL, preload=0.24).drive("x").compression(-0.23) > -1e-6


def test_a_preload_spring_takes_stroke_and_adds_stiffness() -> None:
    sprung = stage(BALL, preload=50.0, spring=2e6)
    mounted = sprung.drive("x").mounted
    chain = 1.0 / (1.0 / 50e6 + 1.0 / BALL.stiffness(50.0))
    assert mounted.stiffness == pytest.approx(chain + 2e6)
    assert mounted.stroke == pytest.approx(38e-6 * chain / (chain + 2e6))
    # small displacements follow the tangent
    system = lumped_system(sprung)
    small = static_drives(sprung, system, {"x": 38e-10})
    K = system.K + system.drive_springs("in place")[0]
    q = np.linalg.solve(K, mounted.stiffness * mounted.stroke * 1e-4 * system.drive("x").vector)
    assert small.static.readings["x"] == pytest.approx(
        float(system.probe("x").vector @ q), rel=1e-4
    )


def test_a_third_of_the_mass_moves_with_the_pushed_body() -> None:
    heavy = stage(mass=13e-3)
    system = lumped_system(heavy)
    assert np.array_equal(system.mass_matrix("removed"), system.M)
    added = system.mass_matrix("in place") - system.M
    x = system.drive("x")
    assert x.ends is not None
    # the frame does not move: a third of the mass moves along with the pushed end
    assert not x.ends[1].any()
    push = np.linalg.lstsq(x.ends[0], np.array([1.0, 0.0]), rcond=None)[0]
    y = system.drive("y")
    assert y.ends is not None
    only_x = added - 13e-3 / 6.0 * sum(
        e.T @ e for e in (y.ends[0], y.ends[1], y.ends[0] + y.ends[1])
    )
    assert push @ only_x @ push == pytest.approx(13e-3 / 3.0, rel=1e-6)
    f = [
        modes(lumped_system(s), drives="in place", count=1).frequency_hz[0]
        for s in (stage(), heavy)
    ]
    assert 0.97 < f[1] / f[0] < 0.99


def test_analysis_has_the_stroke_on_the_seats_and_the_frequency_of_lift_off() -> None:
    seated = stage(BALL, preload=50.0)
    system = lumped_system(seated)
    table = analyse(seated, system).characteristics
    x = {r.quantity: r.value for r in table if r.axis == "x"}
    state = static_drives(seated, system, {"x": 38e-6})
    assert x["working_displacement"] == state.static.readings["x"]
    half = 0.5 * x["input_displacement"]
    expected = x["natural_frequency_hz"] * np.sqrt(2.0 + 50.0 / (x["input_stiffness"] * half))
    assert x["lift_off_frequency_hz"] == pytest.approx(expected)
    plain = analyse(stage(), lumped_system(stage())).characteristics
    assert not {"working_displacement", "lift_off_frequency_hz"} & {r.quantity for r in plain}


def test_a_linear_model_says_what_stroke_it_has_on_soft_seats() -> None:
    rough = stage(FlatSeat(roughness_length=0.72e-6), preload=0.41)
    notes = dynamic_model(rough, lumped_system(rough), hysteresis="none").notes
    (note,) = [n for n in notes if n.startswith("axis 'x'")]
    assert "moves the probe by 6.2" in note
    assert "of the contacts by 53.9" in note
    for hard in (stage(), stage(TipSeat(axial_stiffness=3e7))):
        assert not seat_notes(hard, lumped_system(hard))


def test_a_dynamic_model_moves_by_what_the_preload_spring_leaves() -> None:
    sprung = stage(TipSeat(axial_stiffness=3e7), preload=50.0, spring=2e6)
    system = lumped_system(sprung)
    model = dynamic_model(sprung, system, hysteresis="none")
    moved = static_drives(sprung, system, {"x": 38e-6}).static.readings["x"]
    response = model.simulate({"x": np.full(3, 120.0)})
    assert response.readings["x"][-1] == pytest.approx(moved, rel=1e-9)


def test_drives_that_move_an_axis_together_push_from_both_ends() -> None:
    """An axis that lengthens one drive shortens another, which begins extended."""
    rough, held = FlatSeat(roughness_length=0.72e-6), Preload(force=10.0)
    plain = design("three-rrr")
    drives = tuple(replace(d, seats=(rough,), preload=held) for d in plain.drives)
    seated = replace(plain, drives=drives)
    system = lumped_system(seated)
    analysis = analyse(seated, system)
    rows = {(r.quantity, r.axis): r for r in analysis.characteristics}
    for axis in analysis.axes:
        # the drive that is pushed with the least force of those that move lifts off last
        pushes = [abs(f) for f in axis.static.drive_force.values()]
        lifts = rows["natural_frequency_hz", axis.axis].value * np.sqrt(2.0 + 20.0 / max(pushes))
        assert rows["lift_off_frequency_hz", axis.axis].value == pytest.approx(lifts)
        if ("working_displacement", axis.axis) in rows:
            row = rows["working_displacement", axis.axis]
            assert 0.5 < row.value / rows["output_displacement", axis.axis].value < 1.0
            assert " 0.0 N" not in row.note
    assert ("working_displacement", "theta") not in rows  # which is an angle
    assert not seat_notes(seated, system)
    # with a pure force among them there is no stroke on seats, and no error
    force = Force(
        largest_force=10.0,
        **{n: getattr(plain.drives[2], n) for n in ("name", "pushes", "reacts", "at", "direction")},
    )
    mixed = replace(seated, drives=(*drives[:2], force))
    quantities = {r.quantity for r in analyse(mixed, lumped_system(mixed)).characteristics}
    assert "working_displacement" not in quantities


def test_a_preload_spring_raises_the_frequency_of_lift_off() -> None:
    sprung = stage(BALL, preload=5.0, spring=20e6)
    system = lumped_system(sprung)
    x = {r.quantity: r.value for r in analyse(sprung, system).characteristics if r.axis == "x"}
    force = x["input_stiffness"] * x["input_displacement"]
    expected = 2.0 * (1.0 + 20e6 / x["input_stiffness"]) + 2.0 * 5.0 / force
    bare = x["natural_frequency_hz"]
    assert x["lift_off_frequency_hz"] == pytest.approx(bare * np.sqrt(expected))
    # the stroke that a model of another program has is the mounted one
    assert platform_stroke(replace(sprung, published=()), "x") == pytest.approx(
        x["output_displacement"]
    )


def test_stage_files_keep_seats_and_refuse_what_cannot_be(tmp_path) -> None:
    both = stage(BALL, FlatSeat(roughness_length=0.1e-6), preload=50.0, mass=13e-3)
    write_stage(both, tmp_path / "stage.yaml")
    text = (tmp_path / "stage.yaml").read_text()
    assert read_stage(tmp_path / "stage.yaml").drives == both.drives
    (tmp_path / "stage.yaml").write_text(text.replace("force: 50 N", "force: -50 N"))
    with pytest.raises(StageError, match="force"):
        read_stage(tmp_path / "stage.yaml")
    with pytest.raises(StageError, match="only press: give its 'preload'"):
        replace(both.drives[0], preload=None)
    with pytest.raises(ModelError, match="there is no drive 'z'"):
        static_drives(both, lumped_system(both), {"z": 1e-6})


def test_forces_of_samples_are_those_of_each() -> None:
    x, y = design("vgtu-piezo").drives
    seats = (
        (BallSeat(radius=9e-3, contact_modulus=1.1e11), FlatSeat(roughness_length=0.3e-6)),
        (BALL,),
        (TipSeat(axial_stiffness=2e7),),
        (),
    )
    drives = [
        replace(drive, seats=seat, preload=Preload(force=40.0) if i < 2 else None)
        for i, (drive, seat) in enumerate(zip((x, y, x, y), seats, strict=True))
    ]
    rng = np.random.default_rng(5)
    square = rng.standard_normal((40, 4, 4))
    compliance = 1e-7 * (square @ square.swapaxes(1, 2) + 2.0 * np.eye(4))
    # some open the first two seats
    free = 4e-5 * rng.standard_normal((40, 4))
    found = contact_forces(drives, compliance, free)
    assert np.all((found[:, :2] <= -40.0 + 1e-9).sum(0) > 3)
    for force, c, w in zip(found, compliance, free, strict=True):
        np.testing.assert_allclose(force, contact_forces(drives, c, w), rtol=1e-9, atol=1e-9)
        # the balance itself, where the seat is closed
        for i, drive in enumerate(drives):
            if force[i] > -39.9 or i > 1:
                assert c[i] @ force + drive.compression(force[i]) == pytest.approx(w[i], abs=1e-13)
