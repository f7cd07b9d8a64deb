"""Feedforward over periods and runs, and the evaluation of runs, against closed forms."""

import numpy as np
import pytest

from flexstage.base.errors import LimitError, ModelError, RecordError
from flexstage.control import (
    ControlMode,
    carry_out,
    compensate,
    control_run,
    evaluate_record,
    sine,
    triangle,
    with_feedforward,
)
from flexstage.control.feedforward import conditioning_waveform, shifted_model
from flexstage.control.trajectory import delayed, evaluate_run
from flexstage.hysteresis import (
    DriveModel,
    DriveState,
    Duhem,
    Lag,
    LogCreep,
    PrandtlIshlinskii,
    StageModes,
    ValidityRange,
)
from flexstage.hysteresis.limited_inverse import steady_displacement, steady_input, steady_output
from flexstage.instruments.protocol import Capability, Signal, Waveform
from flexstage.records import Channel, Record
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import ServoSettings
from tests.simple_instrument import SimpleInstrument

PLAYS = PrandtlIshlinskii(
    gain=3.1e-7, thresholds=np.array([3.0, 11.0, 29.0]), weights=np.array([9e-8, 7e-8, 5e-8])
)
FADING = Duhem(
    rate=0.031, anhysteretic=np.array([0.0, 5.1e-7, -2e-10]), tangent=np.array([4.1e-7]),
    input_range=(0.0, 120.0),
)  # fmt: skip
RATE = 2e3


def drive(**changes) -> DriveModel:
    values = {
        "hysteresis": PLAYS,
        "creep": LogCreep(rate_per_decade=0.013),
        "modes": StageModes(frequency_hz=[211.0], damping_ratio=[0.021]),
        "lag": Lag(time_constant=3e-4, delay=1.3e-3),
        "offset": 2.7e-6,
        "validity": ValidityRange(
            input_range=(0.0, 120.0), output_range=(0.0, 6e-5), rate_range_hz=(1.0, 50.0)
        ),
    }
    return DriveModel(**(values | changes))


@pytest.mark.parametrize("model", [PLAYS, FADING], ids=["plays", "fading"])
def test_the_steady_input_gives_the_output_in_every_later_period(model) -> None:
    own = drive(hysteresis=model)
    t = np.arange(300) / 300.0
    x = 2.4e-5 - 1.7e-5 * np.cos(2 * np.pi * t) + 2e-6 * np.sin(6 * np.pi * t)
    found = steady_input(own, x)
    u = found.command
    assert not found.missed.any()
    y = model.simulate(np.tile(u, 25)).values[-300:]
    # the search ends at 1e-9 of 120 V, of a slope of 5e-7 m/V, and what fades takes 25 periods
    np.testing.assert_allclose(y, x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(steady_output(own, u), x, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("rate_hz", "skip"), [(1.3, 0), (20.0, 5)])
def test_several_periods_follow_in_spite_of_creep(rate_hz, skip) -> None:
    own = drive()
    wanted = triangle("x", 9e-6, 47e-6, rate_hz, sample_rate_hz=20e3, turn_time=0.2 / rate_hz)
    made = compensate({"x": own}, wanted, periods=8)
    u = np.concatenate((made.lead_in.values["x"], made.voltage.values["x"]))
    y = own.hysteresis.simulate(u).values
    dt = 1.0 / 20e3
    creep, modes, lag = own.creep, own.modes, own.lag
    assert creep is not None
    assert modes is not None
    assert lag is not None
    y = creep.simulate(y, dt, creep.settled(0.0, dt)).values
    y = own.offset + lag.simulate(modes.simulate(y, dt).values, dt).values
    got = y[made.lead_in.size :]
    found = evaluate_run(wanted, "x", got, skip=skip)
    # the stage starts from rest, and swings for 0.04 s by what the start lacks of the acceleration
    assert found.total.rms < 2e-4 * 38e-6
    assert made.predicted["x"] == pytest.approx(y[made.lead_in.size - 1], abs=2e-8)
    still = evaluate_run(wanted, "x", u[made.lead_in.size :] * 4.2e-7, skip=skip, free_offset=True)
    assert found.reduction_percent(still) > 99.5


def test_one_period_that_repeats_follows_but_for_the_slowest_creep() -> None:
    own = drive()
    wanted = sine("x", 9e-6, 47e-6, 20.0, sample_rate_hz=20e3)
    made = compensate({"x": own}, wanted)
    assert (made.periods, made.voltage.size) == (0, 1000)
    u = np.concatenate((made.lead_in.values["x"], np.tile(made.voltage.values["x"], 200)))
    dt = 1.0 / 20e3
    creep, modes, lag = own.creep, own.modes, own.lag
    assert creep is not None
    assert modes is not None
    assert lag is not None
    y = own.hysteresis.simulate(u).values
    y = creep.simulate(y, dt, creep.settled(0.0, dt)).values
    y = own.offset + lag.simulate(modes.simulate(y, dt).values, dt).values
    late = evaluate_run(wanted, "x", y[made.lead_in.size :], skip=180, free_offset=True)
    assert late.total.rms < 1e-4 * 38e-6
    # the mean is that of ten seconds after a start from rest: of 28 um it is 1.3 % a decade off
    assert abs(late.offset) < 0.013 * 28e-6


def test_two_axes_are_compensated_in_step() -> None:
    models = {"x": drive(), "y": drive(hysteresis=FADING, creep=None, offset=0.0)}
    first = sine("x", 9e-6, 47e-6, 4.0, sample_rate_hz=RATE)
    second = sine("y", 11e-6, 41e-6, 4.0, sample_rate_hz=RATE)
    from flexstage.control import Trajectory

    both = Trajectory(
        positions={**first.positions, **second.positions}, sample_rate_hz=RATE,
        linear=first.linear, kind="sine",
    )  # fmt: skip
    made = compensate(models, both)
    for axis, alone in (("x", first), ("y", second)):
        one = compensate({axis: models[axis]}, alone)
        np.testing.assert_array_equal(made.voltage.values[axis], one.voltage.values[axis])
        assert made.lead_in.values[axis][-1] == made.voltage.values[axis][0]


def test_limits_of_voltage_and_slew_hold() -> None:
    own = {"x": drive(creep=None, modes=None, lag=None, offset=0.0)}
    narrow = {"x": AxisLimits(voltage=(10.0, 95.0))}
    wide = sine("x", 5e-6, 47e-6, 4.0, sample_rate_hz=RATE)
    made = compensate(own, wide, limits=narrow)
    assert made.limited > 0
    assert f"axis 'x': limits changed {made.limited} of 500 samples" in made.notes[-1]
    for wave in (made.lead_in, made.voltage):
        assert wave.values["x"].min() >= 10.0
        assert wave.values["x"].max() <= 95.0
    with pytest.raises(LimitError, match="V/s: lower the rate"):
        compensate(own, wide, limits={"x": AxisLimits(voltage=(0.0, 120.0), slew=900.0)})
    with pytest.raises(ModelError, match="shift the reference into that range"):
        compensate(own, sine("x", 1e-4, 2e-4, 4.0, sample_rate_hz=RATE))
    with pytest.raises(ModelError, match="but there is no model of it"):
        compensate(own, sine("y", 5e-6, 4e-5, 4.0, sample_rate_hz=RATE))
    with pytest.raises(ModelError, match="do not overlap"):
        compensate(own, wide, limits={"x": AxisLimits(voltage=(130.0, 150.0))})


def test_conditioning_forgets_what_was_before() -> None:
    made = conditioning_waveform({"x": (0.0, 120.0)}, sample_rate_hz=500.0, end={"x": 17.0})
    for before in ([0.0], [71.0, 13.0, 90.0], [120.0, 40.0]):
        state = PLAYS.simulate(before).state
        end = PLAYS.simulate(made.values["x"], state).state
        np.testing.assert_allclose(end, PLAYS.simulate(made.values["x"]).state, atol=1e-12)
    with pytest.raises(ModelError, match="16 samples per second"):
        conditioning_waveform({"x": (0.0, 120.0)}, sample_rate_hz=9.0)


def test_a_zero_that_was_read_moves_the_voltages_by_its_share() -> None:
    own = drive()
    wanted = sine("x", 9e-6, 47e-6, 4.0, sample_rate_hz=RATE)
    plain = control_run("feedforward", wanted, periods=2, models={"x": own})
    moved = shifted_model(own, 1e-7)
    higher = control_run("feedforward", wanted, periods=2, models={"x": moved})
    assert np.all(higher.waveform.values["x"] < plain.waveform.values["x"])


def test_a_delay_of_any_part_of_a_sample_is_exact_for_tones() -> None:
    made = sine("x", 9e-6, 47e-6, 13.0, sample_rate_hz=1300.0)
    late = delayed(made, 0.37e-3)
    expected = 28e-6 - 19e-6 * np.cos(2 * np.pi * 13.0 * (made.time - 0.37e-3))
    np.testing.assert_allclose(late.positions["x"], expected, atol=1e-18)


def test_errors_are_told_apart_into_what_repeats_and_what_does_not() -> None:
    wanted = sine("x", 0.0, 40e-6, 5.0, sample_rate_hz=1e3)
    rng = np.random.default_rng(5)
    tone = 3e-8 * np.sin(2 * np.pi * np.arange(200) / 200 * 3)
    noise = 7e-9 * rng.standard_normal(60 * 200)
    came = np.tile(wanted.positions["x"] + tone, 60) + noise + 4e-8
    found = evaluate_run(wanted, "x", came)
    # 200 values of the noise of a mean over 60 periods; 12000 values of the noise
    expected = np.hypot(np.hypot(3e-8 / np.sqrt(2), 4e-8), 7e-9 / np.sqrt(60))
    assert found.repeatable_rms == pytest.approx(expected, rel=5e-3)
    assert found.random_rms == pytest.approx(7e-9, rel=0.03)
    assert len(found.per_period_rms) == 60
    free = evaluate_run(wanted, "x", came, free_offset=True)
    assert free.offset == pytest.approx(4e-8, abs=1e-9)
    assert free.total.rms == pytest.approx(np.hypot(3e-8 / np.sqrt(2), 7e-9), rel=0.02)


def test_the_loop_width_of_a_late_output_has_a_closed_form() -> None:
    # an ellipse: 40 um x sin(phase)
    wanted = sine("x", 0.0, 40e-6, 5.0, sample_rate_hz=4e3)
    late = delayed(wanted, 1.1e-3).positions["x"]
    found = evaluate_run(wanted, "x", np.tile(late, 3))
    phase = 2 * np.pi * 5.0 * 1.1e-3
    assert found.total.loop_width == pytest.approx(40e-6 * np.sin(phase), rel=1e-4)
    assert found.total.rms == pytest.approx(40e-6 * np.sin(phase / 2) / np.sqrt(2), rel=1e-9)
    # begun anywhere else, the loop is the same
    turned = evaluate_run(
        delayed(wanted, -0.061), "x", np.tile(delayed(wanted, 1.1e-3 - 0.061).positions["x"], 3)
    )
    assert turned.total.loop_width == pytest.approx(found.total.loop_width, rel=1e-3)


def test_a_record_at_another_rate_is_compared_at_its_own_samples() -> None:
    wanted = sine("x", 0.0, 40e-6, 5.0, sample_rate_hz=4e3)
    t = np.arange(900) / 1500.0
    y = 20e-6 - 20e-6 * np.cos(2 * np.pi * 5.0 * t) + 1e-8
    record = Record(channels=(Channel(name="c", values=y, unit="m"),), time=t)
    assert evaluate_record(record, "c", wanted, "x").total.rms == pytest.approx(1e-8, rel=1e-4)
    odd = Record(channels=(Channel(name="c", values=y, unit="m"),), time=t * 1500.0 / 1501.0)
    with pytest.raises(RecordError, match="integer number of samples"):
        evaluate_record(odd, "c", wanted, "x")
    with pytest.raises(RecordError, match="no complete period"):
        evaluate_run(wanted, "x", y[:700], skip=1)


def linear_drive() -> DriveModel:
    """The axis of the simple instrument: 4.8e-7 m/V."""
    from flexstage.hysteresis import PrandtlIshlinskii as Plays

    return DriveModel(
        hysteresis=Plays(gain=4.8e-7, thresholds=np.array([5.0]), weights=np.array([0.0])),
        validity=ValidityRange(
            input_range=(0.0, 120.0), output_range=(0.0, 57.6e-6), rate_range_hz=(1.0, 50.0)
        ),
    )


SIGNALS = (
    Signal(kind="position", source="x", name="x"),
    Signal(kind="voltage", source="x", name="u", unit="V"),
)


@pytest.mark.parametrize("mode", list(ControlMode))
def test_every_mode_is_carried_out_on_an_instrument(mode) -> None:
    instrument = SimpleInstrument()
    wanted = sine("x", 5e-6, 45e-6, 10.0, sample_rate_hz=1e4)
    servo = {"x": ServoSettings(integral=7.1e8)}
    run = control_run(
        mode, wanted, periods=3, models={"x": linear_drive()}, servo=servo,
        limits={"x": instrument.axes["x"].limits},
    )  # fmt: skip
    record = carry_out(instrument, run, SIGNALS, rate_hz=5e3)
    found = evaluate_record(record, "x", wanted, "x", skip=run.settling)
    assert len(found.per_period_rms) == 3
    # positions are on straight lines between the samples of the wave
    assert found.total.rms < 1e-10
    assert instrument.axes["x"].closed_loop is False
    assert (instrument.axes["x"].servo() == servo["x"]) == (mode is not ControlMode.FEEDFORWARD)
    assert (instrument.waves.feedforward is not None) == (mode is ControlMode.BOTH)


def test_an_axis_without_a_feedforward_table_says_so() -> None:
    instrument = SimpleInstrument()
    wanted = sine("x", 5e-6, 45e-6, 10.0, sample_rate_hz=1e4)
    run = control_run("feedforward and feedback", wanted, periods=1, models={"x": linear_drive()})
    able = type(instrument.axes["x"]).capabilities
    try:
        type(instrument.axes["x"]).capabilities = property(  # type: ignore[assignment]
            lambda _: frozenset({Capability.CLOSED_LOOP, Capability.OPEN_LOOP})
        )
        with pytest.raises(ModelError, match="cannot combine feedforward and feedback"):
            carry_out(instrument, run, SIGNALS, rate_hz=5e3)
    finally:
        type(instrument.axes["x"]).capabilities = able  # type: ignore[assignment]
    other = control_run("feedback", sine("z", 5e-6, 45e-6, 10.0, sample_rate_hz=1e4), periods=1)
    with pytest.raises(ModelError, match="no axis 'z'"):
        carry_out(instrument, other, SIGNALS, rate_hz=5e3)


def test_impossible_runs_are_refused_in_words() -> None:
    wanted = sine("x", 5e-6, 45e-6, 10.0, sample_rate_hz=1e4)
    with pytest.raises(ModelError, match="at least one period"):
        control_run("feedback", wanted, periods=0)
    with pytest.raises(ModelError, match="needs the model"):
        control_run("feedforward", wanted, periods=1)
    with pytest.raises(LimitError):
        control_run("feedback", wanted, periods=1, limits={"x": AxisLimits(position=(0, 4e-5))})
    back = control_run("feedback", wanted, periods=1)
    short = Waveform(values={"x": np.zeros(10)}, sample_rate_hz=1e4, quantity="voltage")
    with pytest.raises(ModelError, match="one for each target"):
        with_feedforward(back, short)
    volts = Waveform(values={"x": np.zeros(1000)}, sample_rate_hz=1e4, quantity="voltage")
    assert with_feedforward(back, volts).mode is ControlMode.BOTH


def test_the_target_of_a_control_is_as_late_as_its_reading() -> None:
    wanted = sine("x", 5e-6, 45e-6, 10.0, sample_rate_hz=1e4)
    run = control_run("feedback", wanted, periods=2, reading_delay=1e-4)
    np.testing.assert_allclose(
        run.waveform.values["x"], np.roll(wanted.positions["x"], 1), atol=1e-18
    )
    assert run.cycles == run.periods == 4


def test_what_is_undone_ends_at_the_band() -> None:
    own = drive(creep=None, modes=None, lag=Lag(time_constant=4e-3), offset=0.0)
    t = np.arange(400) / RATE
    y = 1e-5 * np.cos(2 * np.pi * 55.0 * t) + 3e-6 * np.cos(2 * np.pi * 60.0 * t)
    found = steady_displacement(own, y, RATE, band_hz=57.0)
    size = np.hypot(1.0, 2 * np.pi * 55.0 * 4e-3)
    spectrum = np.abs(np.fft.rfft(found)) / 200.0
    assert spectrum[11] == pytest.approx(1e-5 * size, rel=1e-12)
    assert spectrum[12] < 1e-18
    # without a band it is 0.4 of the rate of samples, 800 Hz
    tones = 1e-5 * np.cos(2 * np.pi * 795.0 * t) + 1e-5 * np.cos(2 * np.pi * 805.0 * t)
    whole = np.abs(np.fft.rfft(steady_displacement(own, tones, RATE))) / 200.0
    assert whole[159] == pytest.approx(1e-5 * np.hypot(1.0, 2 * np.pi * 795.0 * 4e-3), rel=1e-9)
    assert whole[161] < 1e-18


def test_creep_of_a_known_history_goes_on() -> None:
    own = drive(modes=None, lag=None)
    before = 80.0 - 30.0 * np.cos(2 * np.pi * np.arange(9000) / 3000.0)
    wanted = sine("x", 9e-6, 47e-6, 2.0, sample_rate_hz=RATE)
    creep = own.creep
    assert creep is not None
    rest = DriveState(hysteresis=own.hysteresis.initial_state(), creep=creep.settled(0.0, 1.0))
    _, state = own.response(before, 1.0 / 300.0, rest)
    rms = {}
    for known in ({"x": state}, None):
        made = compensate({"x": own}, wanted, periods=3, after=known)
        u = np.concatenate((made.lead_in.values["x"], made.voltage.values["x"]))
        x = own.hysteresis.simulate(u, state.hysteresis).values
        y = own.offset + creep.simulate(x, 1.0 / RATE, state.creep).values
        rms[known is None] = evaluate_run(wanted, "x", y[made.lead_in.size :]).total.rms
        if known is not None:
            assert made.predicted["x"] == pytest.approx(y[made.lead_in.size - 1], abs=1e-15)
            # and the next motion continues with what this one left
            again = compensate({"x": own}, wanted, periods=3, after=made.after)
            then = np.concatenate((again.lead_in.values["x"], again.voltage.values["x"]))
            y_then = own.response(np.append(u, then), 1.0 / RATE, state)[0][-3 * wanted.size :]
            assert evaluate_run(wanted, "x", y_then).total.rms < 1e-9
    # known: the way to the first voltage is found in three rounds; else 1.3 % a decade of 40 um
    assert rms[False] < 1e-9
    assert rms[True] > 3e-8


def test_what_differs_between_two_periods_counts_for_one() -> None:
    wanted = sine("x", 0.0, 40e-6, 5.0, sample_rate_hz=1e3)
    came = np.concatenate((wanted.positions["x"] + 3e-9, wanted.positions["x"] - 3e-9))
    # two values 6 nm apart: a standard deviation of 3 sqrt(2)
    assert evaluate_run(wanted, "x", came).random_rms == pytest.approx(3e-9 * np.sqrt(2.0))
