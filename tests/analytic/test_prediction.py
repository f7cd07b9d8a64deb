"""A model on another record: as it stands, and after what the drive did before."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import RecordError
from flexstage.hysteresis import DriveModel, LogCreep, Preisach, ValidityRange, predict
from flexstage.records import Channel, Record

DT = 0.01
LOW, HIGH = 2.0, 113.0
MODEL = DriveModel(
    hysteresis=Preisach(
        thresholds=np.array([0.0, 8.0, 22.0]),
        knots=np.linspace(0.0, 120.0, 5),
        slopes=np.array([[2.1, 2.2, 2.0, 1.9], [0.6, 0.5, 0.5, 0.4], [0.3, 0.2, 0.2, 0.1]]) * 1e-7,
    ),
    creep=LogCreep(rate_per_decade=0.017, per_decade=1),
    offset=-11e-6,
    validity=ValidityRange(
        input_range=(LOW, HIGH), output_range=(-11e-6, 30e-6), rate_range_hz=(0.2, 2.0)
    ),
)


def drive(seconds=30.0, rate_hz=0.7):
    t = np.arange(round(seconds / DT)) * DT
    return LOW + 0.5 * (HIGH - LOW) * (1.0 - np.cos(2.0 * np.pi * rate_hz * t))


def record(u, y):
    channels = (Channel(name="u", values=u, unit="V"), Channel(name="y", values=y, unit="m"))
    return Record(channels=channels, time=np.arange(u.size) * DT, source="other.csv")


@pytest.mark.parametrize("start", ["rested", 0.0, 30.0, math.inf])
@pytest.mark.parametrize(("zero", "moved"), [("one", 0.0), ("each", 21e-6)])
def test_what_the_drive_did_before_is_found_from_what_is_not_counted(start, zero, moved):
    u = np.concatenate((drive(1.1)[60:], drive()))
    y = MODEL.simulate(u, DT, start=start) + moved
    found = predict(replace(MODEL, zero=zero), record(u, y), "u", "y")
    assert found.warm_up > 20
    # starts that are close differ by less than this: a grid of six a decade
    assert found.as_predicted_rms_percent < 0.03
    assert found.constant_percent == pytest.approx(0.0, abs=0.03)


def test_a_constant_is_in_the_error_as_predicted_and_not_beside_it():
    u = drive()
    y = MODEL.simulate(u, DT, start=math.inf)
    noise = np.random.default_rng(4).normal(0.0, 2e-8, u.size)
    found = predict(MODEL, record(u, y + noise + 3e-7), "u", "y", after=math.inf)
    percent = 100.0 / found.stroke
    assert found.constant_percent == pytest.approx(3e-7 * percent, rel=0.01)
    assert found.free_constant_rms_percent == pytest.approx(2e-8 * percent, rel=0.05)
    both = math.hypot(found.constant_percent, found.free_constant_rms_percent)
    assert found.as_predicted_rms_percent == pytest.approx(both, rel=1e-9)
    assert len(found.cycles) >= 15
    assert {round(c.rate_hz, 1) for c in found.cycles} == {0.7}
    ((rate, many, predicted, free),) = found.rates
    assert (round(rate, 1), many) == (0.7, len(found.cycles))
    assert predicted == pytest.approx(found.as_predicted_rms_percent, rel=0.02)
    assert free == pytest.approx(found.free_constant_rms_percent, rel=0.1)


def test_a_drift_of_the_record_is_not_in_the_error():
    u = drive()
    y = MODEL.simulate(u, DT, start=math.inf) + np.linspace(4e-6, 6e-6, u.size)
    errors = [
        predict(replace(MODEL, zero=zero), record(u, y), "u", "y", after=math.inf)
        for zero in ("each", "drift")
    ]
    assert errors[0].as_predicted_rms_percent > 1.0
    assert errors[1].as_predicted_rms_percent < 1e-9


def test_a_record_without_a_cycle_is_counted_whole_and_said():
    u = np.linspace(LOW, HIGH, 400)
    found = predict(MODEL, record(u, MODEL.simulate(u, DT, start="rested")), "u", "y")
    assert found.cycles == ()
    assert found.warm_up == 0
    assert any("has no complete cycle" in note for note in found.notes)


def test_commands_beyond_the_range_are_said_once():
    u = 1.05 * drive()
    found = predict(MODEL, record(u, MODEL.simulate(u, DT)), "u", "y")
    assert sum("extrapolated" in note for note in found.notes) == 1


def test_uneven_records_are_refused():
    u = drive()
    time = np.arange(u.size) * DT
    time[700:] += 0.4 * DT
    channels = (Channel(name="u", values=u, unit="V"), Channel(name="y", values=u, unit="m"))
    with pytest.raises(RecordError, match="not uniformly sampled"):
        predict(MODEL, Record(channels=channels, time=time), "u", "y")


def growing():
    """Return cycles from the low end, each larger than the one before."""
    t = np.arange(round(40.0 / DT)) * DT
    return LOW + 0.5 * (HIGH - LOW) * np.minimum(t / 30.0, 1.0) * (1.0 - np.cos(1.4 * np.pi * t))


def test_loops_that_grow_are_counted_before_both_ends_were_reached_and_this_is_said():
    u = growing()
    found = predict(MODEL, record(u, MODEL.simulate(u, DT)), "u", "y")
    (said,) = (note for note in found.notes if "both ends of its range" in note)
    reached = int(np.argmax(u >= HIGH - 0.05 * (HIGH - LOW))) * DT
    assert f"only at {reached:.3g} s" in said
    assert f"counted from {found.warm_up * DT:.3g} s on" in said
    plain = predict(MODEL, record(drive(), MODEL.simulate(drive(), DT)), "u", "y")
    assert not any("both ends" in note for note in plain.notes)


def test_samples_of_the_warm_up_are_not_counted():
    u = drive()
    y = MODEL.simulate(u, DT, start=math.inf)
    plain = predict(MODEL, record(u, y), "u", "y", after=math.inf)
    y[: plain.warm_up] += 4e-6
    found = predict(MODEL, record(u, y), "u", "y", after=math.inf)
    assert found.warm_up == plain.warm_up > 0
    for name in ("as_predicted_rms_percent", "constant_percent", "largest_percent"):
        assert getattr(found, name) == pytest.approx(0.0, abs=1e-9)


def test_turns_of_a_transition_are_no_rate_of_their_own():
    t = np.arange(1000) * DT
    small = 40.0 + 8.0 * (1.0 - np.cos(2.0 * np.pi * 1.7 * t[:118]))
    way = np.linspace(LOW, 40.0, 30)
    u = np.concatenate((drive(12.0), way, small, way[::-1], drive(12.0)))
    found = predict(MODEL, record(u, MODEL.simulate(u, DT)), "u", "y")
    assert any(abs(c.rate_hz / 0.7 - 1.0) > 0.5 for c in found.cycles)
    ((rate, many, _, _),) = found.rates
    assert rate == pytest.approx(0.7, rel=0.05)
    assert many < len(found.cycles)


def test_starts_that_predict_alike_are_all_named():
    u = drive()
    y = MODEL.simulate(u, DT, start=math.inf)
    # it begins at the low end: to have rested there, or just left it, is the same
    rested = predict(MODEL, record(u, MODEL.simulate(u, DT, start="rested")), "u", "y")
    assert set(rested.starts) == {0.0, "rested"}
    told = predict(MODEL, record(u, y), "u", "y", after=30.0)
    assert told.starts == (30.0,)
    assert told.data()["start"] == 30.0
    long = predict(MODEL, record(u, y), "u", "y")
    assert long.starts[0] == math.inf
    assert "rested" not in long.starts
