"""A model on another record: as it stands, and after what the drive did before."""

import math

import numpy as np
import pytest

from flexstage.errors import RecordError
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
def test_what_the_drive_did_before_is_found_from_what_is_not_counted(start):
    u = np.concatenate((drive(1.1)[60:], drive()))
    found = predict(MODEL, record(u, MODEL.simulate(u, DT, start=start)), "u", "y")
    assert found.warm_up > 20
    # starts that are close differ by less than this: a grid of six a decade
    assert found.as_predicted_rms_percent < 0.03
    assert found.constant_percent == pytest.approx(0.0, abs=0.03)


def test_a_constant_is_in_the_error_as_predicted_and_not_beside_it():
    u = drive()
    y = MODEL.simulate(u, DT, start=math.inf)
    noise = np.random.default_rng(4).normal(0.0, 2e-8, u.size)
    found = predict(MODEL, record(u, y + noise + 3e-7), "u", "y", start=math.inf)
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


def test_a_record_without_a_cycle_is_counted_whole_and_said():
    u = np.linspace(LOW, HIGH, 400)
    found = predict(MODEL, record(u, MODEL.simulate(u, DT, start="rested")), "u", "y")
    assert found.cycles == ()
    assert found.warm_up == 0
    assert any("makes no whole cycle" in note for note in found.notes)


def test_commands_beyond_the_range_are_said_once():
    u = 1.05 * drive()
    found = predict(MODEL, record(u, MODEL.simulate(u, DT)), "u", "y")
    assert sum("extrapolated" in note for note in found.notes) == 1


def test_uneven_records_are_refused():
    u = drive()
    time = np.arange(u.size) * DT
    time[700:] += 0.4 * DT
    channels = (Channel(name="u", values=u, unit="V"), Channel(name="y", values=u, unit="m"))
    with pytest.raises(RecordError, match="not evenly sampled"):
        predict(MODEL, Record(channels=channels, time=time), "u", "y")
