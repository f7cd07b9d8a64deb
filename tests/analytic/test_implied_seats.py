"""What a frequency says of a seat: one mode, all modes, bounds, lift-off in time.

Evidence (Stages, tolerances, designs): lift-off of a drive in time (integration with events):
between 0.98 and 1.01 of the frequency
"""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexstage.base.errors import ModelError
from flexstage.lumped import lumped_system
from flexstage.quantities.estimate import Estimate
from flexstage.report.stacks import seat_sentences
from flexstage.stage import Stage
from flexstage.stage.designs import design
from flexstage.stage.seat import BallSeat, Preload, TipSeat
from flexstage.system.analysis import analyse
from flexstage.system.implied_seat import CONTACTS, ImpliedSeat, implied_seat
from flexstage.system.modes import modes
from flexstage.system.seated_drives import static_drives


def frequency(value: float, uncertainty: float = 0.0) -> Estimate:
    return Estimate.of(value, uncertainty, "Hz")


@cache
def seat(axis: str, measured_hz: float, stroke: float | None = None, u: float = 0.0) -> ImpliedSeat:
    stage = design("vgtu-piezo")
    measured = frequency(measured_hz, u)
    return implied_seat(stage, lumped_system(stage), axis, measured, measured_stroke=stroke)


def seated(axis: str, stiffness: float) -> Stage:
    stage = design("vgtu-piezo")
    tip = (TipSeat(axial_stiffness=stiffness),)
    return replace(
        stage,
        drives=tuple(replace(d, seats=tip) if d.name == axis else d for d in stage.drives),
    )


@pytest.mark.parametrize(("axis", "stiffness"), [("x", 0.57e6), ("x", 8e6), ("y", 0.1e6)])
def test_a_seat_is_found_from_the_frequency_that_it_gives(axis: str, stiffness: float) -> None:
    result = modes(lumped_system(seated(axis, stiffness)), drives="in place", count=None)
    bare = seat(axis, 400.0 if axis == "x" else 600.0).bare_hz
    # the frequency of the axis is the lowest above its bare one
    made = float(result.frequency_hz[result.frequency_hz > bare][0])
    found = seat(axis, made)
    assert found.seat_stiffness == pytest.approx(stiffness, rel=1e-6)
    low, high = found.seat_interval
    assert low < stiffness < high


def test_all_modes_agree_with_one_and_with_its_uncertainty() -> None:
    found = seat("x", 337.0)
    one_mode = 5.520153e6 * ((337.0 / found.bare_hz) ** 2 - 1.0)
    assert found.added_stiffness == pytest.approx(one_mode, rel=0.05)
    by_hand = 2.0 * 5.520153e6 * (337.0 / found.bare_hz) ** 2 * 0.02
    assert found.added_uncertainty == pytest.approx(by_hand, rel=0.08)
    # a measured uncertainty adds to that of the model
    wider = seat("x", 337.0, u=0.02 * 337.0)
    assert wider.added_uncertainty == pytest.approx(math.sqrt(2.0) * found.added_uncertainty)
    assert wider.added_interval[1] > found.added_interval[1] > found.added_stiffness
    assert found.share_left == pytest.approx(1.0 - (found.bare_hz / 337.0) ** 2)


def test_a_frequency_below_the_bare_one_only_bounds() -> None:
    found = seat("y", 526.93)
    assert found.seat_stiffness is None
    one_mode = 2.127924e6 * ((526.93 / found.bare_hz) ** 2 - 1.0)
    assert one_mode < 0.0
    assert found.added_stiffness == pytest.approx(one_mode, rel=0.05)
    assert found.added_interval[0] == 0.0
    assert found.added_interval[1] == pytest.approx(
        found.added_stiffness + 1.96 * found.added_uncertainty, rel=0.1
    )
    assert found.share_left == 0.0


def test_a_frequency_above_that_on_rigid_seats_has_no_upper_bound() -> None:
    found = seat("x", 950.0)
    assert found.seat_stiffness == math.inf
    assert found.seat_interval[1] == math.inf
    assert not found.closed_hz


def test_the_stroke_wants_another_seat() -> None:
    found = seat("x", 337.0, 63.12e-6)
    assert found.contradicted
    assert found.least_stroke_stiffness is not None
    # with that seat, and with a tenth more free stroke, the stage has the measured stroke
    stage = seated("x", found.least_stroke_stiffness)
    system = lumped_system(stage)
    bare = replace(system, drives=tuple(replace(d, stiffness=0.0) for d in system.drives))
    alone = replace(bare, drives=(system.drive("x"),))
    x = alone.drive("x")
    K = alone.K + float(x.stiffness or 0.0) * np.outer(x.vector, x.vector)
    q = np.linalg.solve(K, float(x.stiffness or 0.0) * 1.1 * 38e-6 * x.vector)
    assert float(system.probe("x").vector @ q) == pytest.approx(63.12e-6, rel=1e-9)
    assert not seat("x", 337.0, 5e-6).contradicted


def test_closed_contacts_have_their_frequency_at_half_stroke() -> None:
    found = seat("x", 337.0)
    assert found.seat_stiffness is not None
    assert set(found.closed_hz) == set(CONTACTS)
    law = CONTACTS["rough flat, 0.72 um"]
    # the preload by hand: F = k lambda
    preload = Preload(force=found.seat_stiffness * 0.72e-6)
    stage = design("vgtu-piezo")
    drive = replace(stage.drive("x"), seats=(law,), preload=preload)
    stage = replace(stage, drives=(drive, *stage.drives[1:]))
    state = static_drives(stage, lumped_system(stage), {"x": 19e-6}).drives["x"]
    # the other drive holds nothing of x; the law of the contact by hand again
    system = lumped_system(seated("x", state.contact_force / 0.72e-6))
    made = modes(system, drives="in place", count=None).frequency_hz
    assert np.abs(made / found.closed_hz["rough flat, 0.72 um"] - 1.0).min() < 1e-4
    assert min(found.closed_hz.values()) > 1.8 * found.bare_hz


def test_drives_without_seats_and_axes_that_do_not_exist_are_refused() -> None:
    stage = design("vgtu-piezo")
    with pytest.raises(ModelError, match="no axis 'z'"):
        implied_seat(stage, lumped_system(stage), "z", frequency(300.0))
    with pytest.raises(ModelError, match="positive"):
        implied_seat(stage, lumped_system(stage), "x", frequency(0.0))


def test_a_sentence_for_each_axis_with_a_stack_and_a_measured_frequency() -> None:
    stage = design("vgtu-piezo")
    x, y = seat_sentences(analyse(stage, lumped_system(stage)))
    assert "measured 337 Hz in x, computed 326.0 Hz without its stiffness" in x
    assert "0.40 N/µm" in x
    assert "which takes 83 N/µm or more" in x
    assert "so the stack was out, lifted off or not preloaded" in x
    assert "at most 0.075 N/µm" in y
    screws = design("vgtu-mechanical")
    assert seat_sentences(analyse(screws, lumped_system(screws))) == ()
    silent = replace(stage, published=())
    assert seat_sentences(analyse(silent, lumped_system(silent))) == ()


# ------------------------------------------------------------------------------- lift-off in time


STACK = 400e6


@cache
def bridge() -> tuple[Stage, float]:
    """Return a stage with a stack on a ball, and the frequency at which it lifts off [Hz].

    Both are so stiff that the stage follows the stack, as the closed form takes it to do.
    """
    stage = design("bridge")
    stage = replace(
        stage,
        drives=(
            replace(
                stage.drives[0],
                stiffness=STACK,
                seats=(BallSeat(radius=100.0, contact_modulus=115.4e9),),
                preload=Preload(force=20.0),
            ),
        ),
    )
    table = analyse(stage, lumped_system(stage)).characteristics
    return stage, table.value("lift_off_frequency_hz", "y")


def opens(frequency_hz: float) -> tuple[bool, float, bool]:
    """Drive one mode of it by a sine that slowly grows to the whole stroke, until a seat opens.

    Returned are whether it opens, the largest gap of the free flight after it [m], and whether the
    contact closes again.
    """
    stage, _ = bridge()
    drive = stage.drives[0]
    table = analyse(stage, lumped_system(stage)).characteristics
    k = table.value("input_stiffness", "y")
    mass = k / (2.0 * math.pi * table.value("natural_frequency_hz", "y")) ** 2
    ball = drive.seats[0]
    assert isinstance(ball, BallSeat)
    force_0, omega = 20.0, 2.0 * math.pi * frequency_hz
    whole = 30.0 / frequency_hz
    # of the approach itself, with the law of Hertz written out
    hertz = (9.0 / (16.0 * ball.radius * ball.contact_modulus**2)) ** (1.0 / 3.0)
    rest = hertz * force_0 ** (2.0 / 3.0)

    def free(t: float) -> float:
        grown = min(t / whole, 1.0)
        size = 0.5 * 36e-6 * grown**2 * (3.0 - 2.0 * grown)
        return size * (1.0 - math.cos(omega * t))

    def contact_force(t: float, u: float) -> float:
        """Return the force on the seat; 0 where it is open."""
        shortened = free(t) - u + rest + force_0 / STACK
        if shortened <= 0.0:
            return 0.0
        # shortened = F/k_s + hertz F^(2/3), a convex cubic of the root: Newton falls onto it
        root, last = (STACK * shortened) ** (1.0 / 3.0), math.inf
        while root < last:
            last = root
            value = root**2 * (root / STACK + hertz) - shortened
            root -= value / (root * (3.0 * root / STACK + 2.0 * hertz))
        return last**3

    def motion(t: float, state: np.ndarray) -> list[float]:
        u, v = state
        return [v, (contact_force(t, u) - force_0 - k * u) / mass]

    def flight(_t: float, state: np.ndarray) -> list[float]:
        return [state[1], (-force_0 - k * state[0]) / mass]

    def gap(t: float, state: np.ndarray) -> float:
        return free(t) - state[0] + rest + force_0 / STACK

    gap.terminal = True
    gap.direction = -1.0
    end = whole + 6.0 / frequency_hz
    closed = solve_ivp(motion, (0.0, end), [0.0, 0.0], events=gap, rtol=1e-7, atol=1e-12)
    if not closed.t_events[0].size:
        return False, 0.0, True
    begin = float(closed.t[-1])

    def closes(t: float, state: np.ndarray) -> float:
        return gap(t, state)

    closes.terminal, closes.direction = True, 1.0
    open_ = solve_ivp(
        flight,
        (begin, begin + 1.0 / frequency_hz),
        closed.y[:, -1],
        events=closes,
        rtol=1e-9,
        atol=1e-14,
        max_step=0.01 / frequency_hz,
    )
    gaps = [-gap(t, y) for t, y in zip(open_.t, open_.y.T, strict=True)]
    return True, max(gaps), bool(open_.t_events[0].size)


def test_a_drive_lifts_off_above_its_frequency_and_not_below() -> None:
    _, lift_hz = bridge()
    opened, _, _ = opens(0.98 * lift_hz)
    assert not opened
    opened, gap, closed_again = opens(1.01 * lift_hz)
    assert opened
    assert gap > 0.0
    assert closed_again
