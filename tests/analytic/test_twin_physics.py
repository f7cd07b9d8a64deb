r"""The simulated piezo stage against the models that it steps, and against its own equations.

Evidence (Instruments, twin, control): twin, stacks, sample by sample (`VirtualStack.simulate`):
$10^{-12}$

Evidence (Instruments, twin, control): twin, stage with linear stacks (`DynamicModel.simulate`,
exact): $10^{-11}$ of the stroke

Evidence (Instruments, twin, control): twin, full strokes with hysteresis and creep (the same):
$5\cdot10^{-7}$ at 1 Hz, $4\cdot10^{-5}$ at 50 Hz

Evidence (Instruments, twin, control): twin, closed loop, 31 to 700 Hz (theory): $10^{-6}$

Evidence (Instruments, twin, control): twin, small signals, to 640 Hz (modes in continuous time, 1.5
samples of delay): 0.4 %

Evidence (Instruments, twin, control): twin, amplifier (`solve_ivp`): $10^{-6}$ V

Evidence (Instruments, twin, control): twin, control (`scipy.signal.lfilter`): $10^{-9}$ V
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.chain.creep import LogCreep
from flexstage.hysteresis.loops import loop_width
from flexstage.system import modes, static_forces
from flexstage.system.servo import Notch, ServoSettings
from flexstage.virtual.piezo_stage import PiezoStage
from flexstage.virtual.stack import (
    ChargeDrive,
    stack_arrays,
    virtual_stack,
)
from tests.twin_parts import (
    SLOPES,
    damped_system,
    free_displacements,
    small_signal_response,
    small_stage,
)

OPEN = (False, False)


def wander(count: int, seed: int, largest_step: float = 9.0) -> Array:
    """Voltages between 0 and 120 V with many turns, large and small, and some that rest."""
    steps = np.random.default_rng(seed).uniform(-largest_step, largest_step, count)
    steps[::7] = 0.0
    u = np.cumsum(steps)
    return 120.0 - np.abs(np.mod(u, 240.0) - 120.0)


@pytest.mark.parametrize(("plays", "width"), [(37, 0.131), (192, 0.087)])
def test_stepped_stacks_are_the_virtual_stacks(plays: int, width: float) -> None:
    stacks = [
        virtual_stack((0.0, 120.0), 38e-6, width, plays=plays),
        virtual_stack((-30.0, 110.0), 21e-6, 0.19, plays=11),
    ]
    u = np.array([wander(3000, 3), 0.9 * wander(3000, 4) - 20.0])
    arrays = stack_arrays(stacks, 10e3)
    found = free_displacements(arrays, u)
    for stack, given, got in zip(stacks, u, found, strict=True):
        wanted = stack.simulate(given).values
        # sums of up to 192 terms in another order
        assert np.max(np.abs(got - wanted)) < 1e-12 * np.ptp(wanted)


def test_stepped_creep_is_the_creep_of_the_chain() -> None:
    creep = LogCreep(rate_per_decade=0.017, shortest=0.003, longest=200.0, per_decade=3)
    stack = virtual_stack((0.0, 120.0), 38e-6, 0.131, plays=23)
    u = wander(2000, 9)
    arrays = stack_arrays([stack], 700.0, creep=[creep])
    found = free_displacements(arrays, u[None])[0]
    wanted = creep.simulate(stack.simulate(u).values, 1 / 700.0, creep.settled(0.0, 1.0)).values
    assert np.max(np.abs(found - wanted)) < 1e-12 * np.ptp(wanted)


def test_creep_of_a_step_rises_by_its_rate_in_each_decade() -> None:
    stage = small_stage(straight=True, creep=LogCreep(rate_per_decade=0.012), sample_rate_hz=1e3)
    block = stage.run(np.tile([[90.0], [0.0]], 20_100), OPEN)
    at = np.interp([0.2, 2.0, 20.0], block.time, block.position[0])
    first = at_rest({"x": SLOPES["x"] * 90.0})["x"]
    # two lags a decade ripple by 0.02 % of the rate; 0.2 s is 20 times the shortest time, where
    # the logarithm is met to some percent of the rate
    assert np.diff(at) / first == pytest.approx([0.012, 0.012], rel=0.03)


def at_rest(free: dict[str, float]) -> dict[str, float]:
    """Readings at rest for free displacements of the stacks."""
    system = damped_system()
    forces = {name: 5e7 * w for name, w in free.items()}
    return static_forces(system, forces, drives="in place").readings


def exact_readings(stage: PiezoStage, voltage: Array) -> Array:
    """What the exact model does under the voltages that the stage had."""
    drives = tuple(replace(d, amplifier=None, input_range=None) for d in stage.model.drives)
    model = replace(stage.model, drives=drives)
    response = model.simulate(dict(zip(stage.axes, voltage, strict=True)), model.settled())
    return np.array([response.readings[name] for name in stage.axes])


@pytest.mark.parametrize(
    ("rate_hz", "allowed"),
    [
        # Between samples the displacement of a stack is taken as straight, which it is not at a
        # turn and where a play starts inside a step: the larger the steps of voltage, the more.
        (1.0, 5e-7),
        (50.0, 4e-5),
    ],
)
def test_full_strokes_are_the_exact_ones(rate_hz: float, allowed: float) -> None:
    creep = LogCreep(rate_per_decade=0.012)
    stage = small_stage(straight=False, creep=creep, plays=192)
    t = np.arange(int(2.3 / rate_hz * 10e3)) / 10e3
    u = 60.0 - 60.0 * np.cos(2.0 * np.pi * rate_hz * t)
    slower = 41.0 - 41.0 * np.cos(1.4 * np.pi * rate_hz * t)
    block = stage.run(np.array([u, slower]), OPEN)
    wanted = exact_readings(stage, block.voltage)
    off = np.max(np.abs(block.position - wanted), axis=1) / np.ptp(wanted, axis=1)
    assert np.all(off < allowed)
    assert np.any(off > 1e-13)  # it is a comparison of two ways


def test_a_straight_stage_is_exact_to_rounding() -> None:
    stage = small_stage(straight=True)
    u = np.array([wander(900, 1, 30.0), wander(900, 2, 30.0)])
    block = stage.run(u, OPEN)
    wanted = exact_readings(stage, block.voltage)
    assert np.max(np.abs(block.position - wanted)) < 1e-11 * np.ptp(wanted)


def test_both_stacks_move_both_sensors_as_the_model_says() -> None:
    stage = small_stage(straight=True)
    stage.run(np.tile([[80.0], [35.0]], 4000), OPEN)
    at = stage.run(np.tile([[80.0], [35.0]], 400), OPEN).position.mean(axis=1)
    free = {"x": SLOPES["x"] * 80.0, "y": SLOPES["y"] * 35.0}
    wanted = at_rest(free)
    # what is left of the ringing after 0.4 s
    assert at == pytest.approx([wanted["x"], wanted["y"]], rel=1e-9)


def test_a_command_is_at_the_amplifier_one_sample_later_and_follows_its_pole() -> None:
    stage = small_stage(straight=True)
    u = np.zeros((2, 60))
    u[0, 10:] = 73.0
    block = stage.run(u, OPEN)
    assert np.array_equal(block.command, u)
    since = np.maximum(np.arange(60) - 11, 0) / 10e3
    wanted = 73.0 * -np.expm1(-2.0 * math.pi * 2000.0 * since)
    assert block.voltage[0] == pytest.approx(wanted, abs=1e-12)
    assert np.all(block.voltage[1] == 0.0)


def test_the_current_limits_the_rate_of_the_voltage() -> None:
    rate = 0.3 / 6.4e-6
    stage = small_stage(straight=True, largest_rate=rate)
    u = np.zeros((2, 80))
    u[0, 5:] = 117.0
    voltage = stage.run(u, OPEN).voltage[0]
    steps = np.diff(voltage) * 10e3
    assert steps.max() == pytest.approx(rate, rel=1e-12)
    # an amplifier whose command is a steep line in place of a step
    fine = Amplifier(bandwidth_hz=2000.0, capacitance=6.4e-6, current_limit=0.3)
    dense = fine.simulate(np.full(7300, 117.0), 1e-6, np.array([117.0, 0.0])).values
    assert voltage[7:80] == pytest.approx(dense[99::100], abs=1e-9)


def test_the_amplifier_follows_its_equation_through_both_its_ways() -> None:
    rate, tau = 31e3, 1.0 / (2.0 * math.pi * 2000.0)
    stage = small_stage(straight=True, largest_rate=rate)
    u = np.zeros((2, 40))
    u[1] = np.repeat([0.0, 17.0, 3.0, 40.0, 38.0], 8)
    voltage = stage.run(u, OPEN).voltage[1]
    held = np.concatenate(([0.0, 0.0], u[1]))

    def sample(start: float, target: float) -> float:
        found = solve_ivp(
            lambda _, y: np.clip((target - y) / tau, -rate, rate),
            (0.0, 1e-4), [start], rtol=1e-10, atol=1e-10,
        )  # fmt: skip
        return float(found.y[0, -1])

    got = [0.0]
    for target in held[1:40]:
        got.append(sample(got[-1], float(target)))
    assert voltage == pytest.approx(got, abs=1e-6)


def test_commands_outside_the_range_are_led_into_it_and_have_20_bit() -> None:
    stage = small_stage(straight=True, quiet=False)
    u = np.array([[-7.0, 133.0, 61.234567, 61.2346], [0.0, 0.0, 0.0, 0.0]])
    asked = stage.run(u, OPEN).command[0]
    step = 120.0 / (2**20 - 1)
    assert asked[0] == 0.0
    assert asked[1] == pytest.approx(120.0, abs=1e-12)
    assert np.abs(asked[2:] - u[0, 2:]).max() <= 0.5 * step * (1 + 1e-9)
    assert np.abs(asked / step - np.round(asked / step)).max() < 1e-6


def closed_loop_sine(stage: PiezoStage, frequency_hz: float, servo: tuple[bool, bool]) -> complex:
    """Position over target of axis x, of a small sine about a working point."""
    rate = stage.sample_rate_hz
    n = round(rate / frequency_hz * math.ceil(0.4 * frequency_hz))
    start = stage.run(np.full((2, 2000), 50.0), OPEN).reading[:2, -1:]
    t = np.arange(2 * n) / rate
    target = np.repeat(start, 2 * n, axis=1)
    target[0] += 20e-9 * np.sin(2.0 * np.pi * frequency_hz * t)
    block = stage.run(target, servo)
    angle = 2.0 * np.pi * frequency_hz * t[n:]
    columns = np.column_stack((np.sin(angle), np.cos(angle), np.ones(n)))
    found = np.linalg.lstsq(columns, block.position[0, n:] - start[0, 0])[0] / 20e-9
    return complex(found[0], found[1])


@pytest.mark.parametrize("frequency_hz", [31.0, 170.0, 700.0])
def test_the_closed_loop_answers_as_settings_times_plant_say(frequency_hz: float) -> None:
    settings = ServoSettings(
        proportional=2.1e4,
        integral=9e8,
        notches=(Notch(frequency_hz=910.0, zero_damping=0.03, pole_damping=0.6),),
        lowpass_hz=2100.0,
    )
    stage = small_stage(straight=True, settings=settings)
    got = closed_loop_sine(stage, frequency_hz, (True, False))
    f = np.array([frequency_hz])
    z = np.exp(-2j * np.pi * f / 10e3)
    plant = small_signal_response(stage, "x", f, slope=SLOPES["x"])
    control = settings.response(f, 10e3)
    wanted = (control * plant / (1.0 + control * z * plant))[0]
    # rounding of a position of 2e-5 m in a sine of 2e-8 m, and the rest of the transient
    assert abs(got - wanted) < 1e-6 * abs(wanted)


def test_the_plant_of_small_signals_is_that_of_the_continuous_modes() -> None:
    """Far below half the rate, sampling is the delays that are named and nothing else."""
    stage = small_stage(straight=True, sample_rate_hz=40e3)
    f = np.array([11.0, 160.0, 640.0])
    system = damped_system()
    found = modes(system, drives="in place", count=None)
    port, s = system.drive("x"), 2j * np.pi * f[:, None]
    weight = (system.probe("x").vector @ found.shapes) * (port.vector @ found.shapes)
    by_mode = weight / (found.omega**2 + 2.0 * found.damping_ratio * found.omega * s + s**2)
    mechanical = 5e7 * by_mode.sum(axis=1)
    # one sample to the amplifier, half of one that a voltage is held
    delay = np.exp(-s[:, 0] * 1.5 / 40e3)
    wanted = SLOPES["x"] * mechanical * delay / (1.0 + s[:, 0] / (2.0 * np.pi * 2000.0))
    got = small_signal_response(stage, "x", f, slope=SLOPES["x"])
    # held and straight voltages lose (pi 640 / 40e3)^2 (1/6 + 1/3) = 0.13 % of their size
    # images of the held voltage, which the pole lets through, are of the same size
    assert got == pytest.approx(wanted, rel=4e-3)


def test_the_control_computes_the_equations_of_its_settings() -> None:
    settings = ServoSettings(
        proportional=3.7e4, integral=1.3e8, notches=(Notch(frequency_hz=905.0),), lowpass_hz=1900.0
    )
    stage = small_stage(straight=True, settings=settings)
    # control that was on before, and off since, leaves nothing behind
    start = stage.run(np.full((2, 1000), 30.0), OPEN).reading[:2, -1:]
    stage.run(start + 1e-6 * np.sin(0.4 * np.arange(99)), (True, True))
    held = stage.run(np.full((2, 3000), 41.0), OPEN).reading[:2, -1]
    target = held[:, None] + 60e-9 * np.random.default_rng(5).standard_normal((2, 400))
    before = stage.run(np.full((2, 1), 41.0), OPEN).reading[:2, -1:]
    block = stage.run(target, (True, True))
    e = target - np.concatenate((before, block.reading[:2, :-1]), axis=1)
    for a in range(2):
        filtered = e[a]
        for b0, b1, b2, a1, a2 in settings.sections(10e3):
            filtered = np.asarray(lfilter([b0, b1, b2], [1.0, a1, a2], filtered))
        u = settings.proportional * filtered
        u += settings.integral / 10e3 * np.cumsum(filtered)
        # it begins with the voltage that is there
        u += 41.0 - u[0]
        assert block.command[a] == pytest.approx(u, abs=1e-9)


def test_a_reading_is_in_the_voltage_two_samples_later() -> None:
    stage = small_stage(straight=True, settings=ServoSettings(proportional=5e4))
    held = stage.run(np.full((2, 6000), 30.0), OPEN).reading[:2, -1:]
    stage.run(np.repeat(held, 50, axis=1), (True, True))
    before = stage.run(np.repeat(held, 50, axis=1), (True, True))
    # a jump of the platform by the other axis is seen; take a jump of the target for reference
    jump = np.repeat(held, 8, axis=1)
    jump[0, 3:] += 1e-6
    block = stage.run(jump, (True, True))
    change = np.abs(block.command[0] - before.command[0, -1]) > 1e-3
    assert np.flatnonzero(change)[0] == 3
    moved = np.abs(block.voltage[0] - before.voltage[0, -1]) > 1e-3
    assert np.flatnonzero(moved)[0] == 5  # asked at 3, held from 4 on, seen at 5
    seen = np.abs(block.reading[0] - before.reading[0, -1]) > 1e-9
    reacts = np.abs(np.diff(block.command[0, 3:])) > 1e-4
    # the first reading that differs, one sample of conversion, then it is in the command
    assert np.flatnonzero(reacts)[0] + 4 == np.flatnonzero(seen)[0] + 1


def test_the_integral_stands_still_at_the_end_of_the_range_and_comes_back_at_once() -> None:
    settings = ServoSettings(integral=6e8)
    stage = small_stage(straight=True, settings=settings)
    top = stage.run(np.full((2, 6000), 120.0), OPEN).position[:, -1:]
    stage.run(np.repeat(top - 2e-6, 3000, axis=1), (True, True))
    # for half a second more is asked than there is
    held = stage.run(np.repeat(top + 5e-6, 5000, axis=1), (True, True))
    assert np.all(held.command <= 120.0)
    assert np.all(held.command[:, -4000:] == 120.0)
    back = stage.run(np.repeat(top - 2e-6, 10, axis=1), (True, True))
    # the integral stood still less than one of its steps before the end; then it falls
    down = 6e8 / 10e3 * (held.reading[:2, -1] - top[:, 0] + 2e-6)
    up = 6e8 / 10e3 * (top[:, 0] + 5e-6 - held.reading[:2, -1])
    assert np.all(back.command[:, 0] < 120.0 - down + 1e-9)
    assert np.all(back.command[:, 0] > 120.0 - down - up)


def test_switching_control_on_leaves_the_voltage_where_it_is() -> None:
    settings = ServoSettings(
        proportional=2e4, integral=6e8, notches=(Notch(frequency_hz=910.0),), lowpass_hz=2000.0
    )
    stage = small_stage(straight=False, settings=settings, creep=LogCreep(rate_per_decade=0.012))
    for volts in (37.0, 81.0):
        held = stage.run(np.full((2, 4000), volts), OPEN)
        block = stage.run(np.repeat(held.reading[:2, -1:], 2000, axis=1), (True, True))
        assert np.all(np.abs(block.command[:, 0] - volts) < 1e-12)
        assert np.max(np.abs(np.diff(block.command, axis=1))) < 1e-3
        # creep is followed with a delay
        assert np.abs(block.position[:, -1] - held.reading[:2, -1]).max() < 3e-9


def test_a_feedforward_is_added_and_taken_over_where_it_begins_and_ends() -> None:
    stage = small_stage(straight=True, settings=ServoSettings(integral=1e6))
    held = stage.run(np.full((2, 6000), 45.0), OPEN).reading[:2, -1:]
    targets = np.repeat(held, 30, axis=1)
    stage.run(targets, (True, True))
    forward = np.full((2, 30), np.nan)
    forward[0, 10:20] = 70.0 + np.arange(10)
    command = stage.run(targets, (True, True), forward).command
    # a slow integral adds nothing in three milliseconds
    wanted = 45.0 + np.concatenate((np.zeros(10), np.arange(10), np.full(10, 9.0)))
    assert command[0] == pytest.approx(wanted, abs=0.05)
    assert command[1] == pytest.approx(np.full(30, 45.0), abs=0.05)


@pytest.mark.parametrize("lowpass_hz", [None, 3000.0])
def test_filters_keep_their_state_where_their_number_stays(lowpass_hz: float | None) -> None:
    before = ServoSettings(integral=4e8, notches=(Notch(frequency_hz=700.0),))
    after = ServoSettings(integral=3e8, notches=(Notch(frequency_hz=900.0),), lowpass_hz=lowpass_hz)
    stage = small_stage(straight=True, settings=before)
    held = stage.run(np.full((2, 3000), 45.0), OPEN).reading[:2, -1:]
    moving = held + 1e-6 * np.sin(np.arange(200) * 0.3)
    first = stage.run(moving, (True, True))
    stage.set_servo_settings("x", after)
    second = stage.run(moving, (True, True))
    readings = np.concatenate((held[0], first.reading[0], second.reading[0]))
    e = np.tile(moving[0], 2) - readings[:-1]
    (b0, b1, b2, a1, a2), *_ = before.sections(10e3)
    _, kept = lfilter([b0, b1, b2], [1.0, a1, a2], e[:200], zi=np.zeros(2))
    filtered = e[200:]
    for row in after.sections(10e3):
        # all of them begin anew where one more has come
        start = kept if lowpass_hz is None else np.zeros(2)
        filtered, _ = lfilter(row[:3], [1.0, *row[3:]], filtered, zi=start)
    wanted = first.command[0, -1] + 3e8 / 10e3 * np.cumsum(filtered)
    assert second.command[0] == pytest.approx(wanted, abs=1e-9)


def test_a_charge_drive_has_little_hysteresis_above_its_corner_and_all_of_it_below() -> None:
    widths = {}
    for name, charge in (("voltage", None), ("charge", ChargeDrive())):
        for rate, cycles in ((0.001, 8), (50.0, 600)):
            stack = virtual_stack((0.0, 120.0), 38e-6, 0.131, plays=37)
            n = 400
            arrays = stack_arrays([stack], rate * n, charge=charge)
            u = 60.0 - 60.0 * np.cos(2.0 * np.pi * np.arange(cycles * n) / n)
            w = free_displacements(arrays, u[None])[0]
            widths[name, rate] = loop_width(u[-2 * n :], w[-2 * n :], np.array([0, n]))
    # far above the corner the remainder is left, 0.08; below it, all
    assert widths["charge", 50.0] / widths["voltage", 50.0] == pytest.approx(0.08, abs=0.005)
    assert widths["charge", 0.001] / widths["voltage", 0.001] == pytest.approx(1.0, abs=0.01)


def test_a_charge_drive_in_between_is_the_lag_of_its_deviation() -> None:
    stack = virtual_stack((0.0, 120.0), 38e-6, 0.131, plays=37)
    drive = ChargeDrive(corner_hz=0.7, remainder=0.21)
    u = wander(4000, 11, 2.0)
    u[0] = 0.0
    arrays = stack_arrays([stack], 50.0, charge=drive)
    got = free_displacements(arrays, u[None])[0]
    free = stack.simulate(u).values
    ends = stack.simulate([0.0, 120.0] * 6).values[-2:]
    e = free - (ends[0] + (ends[1] - ends[0]) / 120.0 * u)
    # a first-order lag, integrated on the straight lines between the samples
    t = np.arange(u.size) / 50.0
    tau = 1.0 / (2.0 * math.pi * 0.7)
    found = solve_ivp(
        lambda s, y: (np.interp(s, t, e) - y) / tau,
        (0.0, t[-1]), [e[0]], t_eval=t, max_step=0.02, rtol=1e-8, atol=1e-13,
    )  # fmt: skip
    wanted = free - (1.0 - 0.21) * (e - found.y[0])
    assert np.max(np.abs(got - wanted)) < 1e-5 * np.ptp(wanted)


def test_bad_commands_and_settings_are_refused() -> None:
    stage = small_stage(straight=True)
    with pytest.raises(ModelError, match="shape"):
        stage.run(np.zeros((3, 5)), OPEN)
    with pytest.raises(ModelError, match="not finite"):
        stage.run(np.array([[0.0, 1.0], [0.0, np.nan]]), OPEN)
    with pytest.raises(ModelError, match="feedforward"):
        stage.run(np.zeros((2, 5)), OPEN, np.zeros((2, 4)))
    with pytest.raises(ModelError, match="no axis 'z'"):
        stage.servo_settings("z")
    with pytest.raises(ModelError, match="faster than twice"):
        stage.set_servo_settings("x", ServoSettings(notches=(Notch(frequency_hz=6000.0),)))
    many = tuple(Notch(frequency_hz=100.0 * (k + 1)) for k in range(9))
    with pytest.raises(ModelError, match="8 filters"):
        stage.set_servo_settings("x", ServoSettings(notches=many))
    with pytest.raises(ModelError, match="no hammer"):
        stage.strike("x")
