"""What is done to a record before a model is fitted, against cases in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from flexstage.hysteresis import Dahl, DriveModel, PrandtlIshlinskii, ValidityRange
from flexstage.hysteresis.identification.cycles import (
    by_rate,
    cycles,
    first_moving,
    unknown_history_warning,
)
from flexstage.hysteresis.identification.fit_rows import ChainValues
from flexstage.hysteresis.identification.identify import identify
from flexstage.hysteresis.identification.measurement import (
    measurement,
    without_history,
)
from flexstage.hysteresis.identification.model_fit import fit_data
from flexstage.hysteresis.identification.residuals import residuals
from flexstage.records import Channel, Record
from flexstage.records.drives import from_branches

DT = 0.01
LOW, HIGH = 3.0, 111.0
STACK = PrandtlIshlinskii(
    gain=2.9e-7, thresholds=np.array([4.0, 13.0, 29.0]), weights=np.array([0.7, 0.5, 0.3]) * 1e-7
)


def drive(seconds=20.0, rate_hz=0.9):
    t = np.arange(round(seconds / DT)) * DT
    return LOW + 0.5 * (HIGH - LOW) * (1.0 - np.cos(2.0 * np.pi * rate_hz * t))


def record(u, y):
    channels = (Channel(name="u", values=u, unit="V"), Channel(name="y", values=y, unit="m"))
    return Record(channels=channels, time=np.arange(u.size) * DT)


def after_cycles(u):
    """Return what the stack does after cycles over the whole range, ended at the low end."""
    return STACK.simulate(u, STACK.simulate([HIGH, LOW] * 3).state).values


def test_the_memory_before_a_record_is_that_of_a_cycle_which_ended_at_the_low_end():
    u = drive()[40:]  # begins in the middle of its range, on the way up
    (section,) = measurement([record(u, after_cycles(u))], "u", "y").sections
    assert section.u[: section.history].tolist() == pytest.approx([HIGH, LOW], abs=0.01)
    moved = STACK.simulate(section.u).values[section.history :]
    assert moved == pytest.approx(after_cycles(u), abs=1e-15)
    limits = ValidityRange(input_range=(LOW, HIGH), output_range=(0.0, 1.0), rate_range_hz=(1, 1))
    conditioned = DriveModel(hysteresis=STACK, validity=limits).conditioned()
    assert moved == pytest.approx(STACK.simulate(u, conditioned).values, abs=1e-15)
    bare = without_history(section)
    np.testing.assert_array_equal(bare.u, u)
    assert bare.warm_up == section.warm_up - 2


def test_the_fitted_rows_of_an_open_table_have_times():
    """Its rows are numbered up and down again, and are in no order of time."""
    u = np.linspace(0.0, 100.0, 150)
    y = STACK.simulate(np.concatenate((u, u[::-1]))).values
    table = zip("uab", (u, y[:150], y[150:][::-1] + 3e-7), ("V", "m", "m"), strict=True)
    channels = tuple(Channel(name=name, values=v, unit=unit) for name, v, unit in table)
    loop = from_branches(Record(channels=channels, time=np.arange(150.0)), "u", "a", "b")
    assert loop.numbers is not None
    assert loop.numbers[0] == loop.numbers[-1]
    found = identify(loop, 0, 1, model="dahl", chain=ChainValues())
    assert found.settings["fitted"].endswith("to 299 s")


@pytest.mark.parametrize(("rest", "first"), [(0, 0), (12, 0), (20, 0), (350, 330), (2000, 1980)])
def test_a_rest_is_left_out_but_for_twenty_samples(rest, first):
    t = np.arange(1500) * DT
    moving = LOW + 20.0 * t  # its first step is larger than what counts as rest
    found = first_moving(np.concatenate((np.full(rest, LOW), moving[1:])))
    # a few samples pass until it has moved by two thousandths of its range
    assert first <= found <= first + 4


def test_waits_make_no_cycle_slower():
    t = np.arange(100) * DT
    cycle = LOW + 0.5 * (HIGH - LOW) * (1.0 - np.cos(2.0 * np.pi * t))
    u = np.tile(np.concatenate((cycle, np.full(250, LOW))), 6)
    found = cycles(u, DT)
    # one second of motion in each 3.5
    assert np.diff(found.bounds) == pytest.approx(350.0, abs=60.0)
    assert found.frequency_hz == pytest.approx(1.0, rel=0.05)


def test_cycles_belong_to_rates():
    frequency = np.array([1.0] * 9 + [1.7, 2.0, 10.0, 10.0, 10.0, 4.0])
    swing = np.array([1.0] * 9 + [0.2, 0.5, 0.95, 1.0, 1.0, 0.25])
    (slow, one), (fast, ten) = sorted(by_rate(frequency, swing), key=lambda pair: pair[0])
    assert (slow, fast) == (1.0, 10.0)
    # smaller loops at the same speed are of the same motion; a turn at another speed is of none
    assert one.tolist() == [*range(9), 10, 14]
    assert ten.tolist() == [11, 12, 13]


def with_offsets(*offsets):
    u = drive()
    made = measurement([record(u, after_cycles(u) + o) for o in offsets], "u", "y")
    return fit_data(made, ChainValues())


def test_the_offset_that_is_kept_is_the_mean_of_those_of_the_records():
    left = residuals(STACK, with_offsets(-4e-6))
    assert left.offset == pytest.approx(-4e-6, rel=1e-9)
    assert np.abs(left.of_prediction[0]).max() < 1e-15
    left = residuals(STACK, with_offsets(-4e-6, 1e-6))
    assert left.offset == pytest.approx(-1.5e-6, rel=1e-6)
    assert left.of_prediction[0] == pytest.approx(-2.5e-6, rel=1e-6)
    assert left.of_prediction[1] == pytest.approx(2.5e-6, rel=1e-6)
    left = residuals(STACK, replace(with_offsets(-4e-6, 1e-6), zero="each"))
    assert [n[0] for n in left.baseline] == pytest.approx([-4e-6, 1e-6], rel=1e-6)


def test_what_is_held_out_does_not_move_the_offset():
    data = with_offsets(-4e-6, 1e-6)
    none = np.zeros_like(data.use[1])
    left = residuals(STACK, replace(data, use=(data.use[0], none)))
    assert left.offset == pytest.approx(-4e-6, rel=1e-9)
    assert left.of_prediction[1] == pytest.approx(5e-6, rel=1e-6)


def test_the_band_holds_the_held_out_samples():
    """Where all that is left is white noise: 97.5 of 100 are within 2.24 standard deviations."""
    plant = Dahl(gain=3.3e-7, stiffness=1.1e-7, limit=2.1e-6)
    u = drive(60.0)
    y = plant.simulate(u).values + np.random.default_rng(3).normal(0.0, 4e-8, u.size)
    found = identify(record(u, y), "u", "y", model="dahl", chain=ChainValues())
    assert found.heldout_rms_percent is not None
    assert found.heldout_band_percent == pytest.approx(2.24 * found.heldout_rms_percent, rel=0.03)
    # a fifth of six thousand samples of white noise scatters by 2 %
    assert found.heldout_worst_percent == pytest.approx(found.heldout_median_percent, rel=0.06)


def test_loops_that_grow_are_said_to_be_counted_early():
    t = np.arange(4000) * DT
    growth = np.minimum(t / 36.0, 1.0)
    u = LOW + 0.5 * (HIGH - LOW) * growth * (1.0 - np.cos(2.0 * np.pi * 0.9 * t))
    said = unknown_history_warning(measurement([record(u, after_cycles(u))], "u", "y").sections)
    reached = int(np.argmax(u >= HIGH - 0.05 * (HIGH - LOW))) * DT
    assert f"only at {reached:.3g} s" in said
    plain = measurement([record(drive(), after_cycles(drive()))], "u", "y")
    assert unknown_history_warning(plain.sections) == ""


def test_times_that_are_drawn_are_those_of_the_file_where_samples_were_averaged():
    from flexstage.report.figures.identification import draw_identification

    t = np.arange(96_000) / 4000.0
    moving = LOW + 0.5 * (HIGH - LOW) * (1.0 - np.cos(2.0 * np.pi * 0.9 * t))
    u = np.concatenate((np.full(8000, LOW), moving))
    plant = Dahl(gain=3.3e-7, stiffness=1.1e-7, limit=2.1e-6)
    y = plant.simulate(u).values + np.random.default_rng(3).normal(0.0, 4e-8, u.size)
    whole = Record(channels=record(u, y).channels, time=np.arange(u.size) / 4000.0)
    found = identify(whole, "u", "y", model="dahl", chain=ChainValues())
    assert found.measurement.sections[0].dt > 1.5 / 4000.0
    loop, error = draw_identification(found).axes
    assert error.get_xlim()[1] == pytest.approx(26.0, abs=0.01)
    last = float(loop.get_title(loc="left").split(" to ")[-1].removesuffix(" s"))
    assert 24.0 < last < 26.0
