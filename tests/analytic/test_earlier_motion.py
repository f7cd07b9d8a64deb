"""A motion in two pieces, with the state of the drive between them, against the motion at once."""

from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import ModelError, RecordError
from flexstage.hysteresis import (
    DriveModel,
    Lag,
    LogCreep,
    Preisach,
    StageModes,
    ValidityRange,
    feedforward,
    predict,
)
from flexstage.hysteresis.inversion import after_commands
from flexstage.hysteresis.prediction import predict_each
from flexstage.records import Channel, Record

DT, CUT = 1e-3, 3001
CREEP, LAG = LogCreep(rate_per_decade=0.021), Lag(delay=3.37e-3, time_constant=1.9e-3)
MODE = StageModes(frequency_hz=[70.0], damping_ratio=[0.02])
CHAINS = {
    "hysteresis": {},
    "creep": {"creep": CREEP},
    "delay": {"lag": LAG},
    "mode": {"modes": MODE},
    "all": {"creep": CREEP, "modes": MODE, "lag": LAG},
}


def drive(**chain) -> DriveModel:
    return DriveModel(
        hysteresis=Preisach(
            thresholds=np.array([0.0, 11.0, 39.0]),
            knots=np.linspace(0.0, 120.0, 5),
            slopes=1e-7
            * np.array([[2.1, 2.2, 2.0, 1.9], [0.6, 0.5, 0.5, 0.4], [0.3, 0.2, 0.2, 0.1]]),
        ),
        offset=-11e-6,
        sign=-1.0,
        validity=ValidityRange(
            input_range=(0.0, 120.0), output_range=(-6e-5, 0.0), rate_range_hz=(0.2, 20.0)
        ),
        **chain,
    )


def walk(size: int = 8000) -> np.ndarray:
    corners = np.random.default_rng(3).uniform(5.0, 115.0, size // 80 + 2)
    corners[:3] = 47.0, 118.0, 5.0
    return np.interp(np.arange(size), 80.0 * np.arange(corners.size), corners)


def record(u, y=None, *, begin=0.0, name="walk.csv", dt=DT) -> Record:
    channels = (Channel(name="u", values=u, unit="V"),)
    if y is not None:
        channels += (Channel(name="y", values=y, unit="m"),)
    return Record(channels=channels, time=begin + dt * np.arange(u.size), source=name)


def pieces(u, y, cut, at=None):
    """Return both parts of a record; the second begins at a time of its own if it is given."""
    begin = cut * DT if at is None else at
    return record(u[:cut], y[:cut], name="a.csv"), record(u[cut:], y[cut:], begin=begin)


@pytest.mark.parametrize("begin", [None, 0.0])
@pytest.mark.parametrize("chain", CHAINS)
def test_a_walk_in_two_pieces_is_predicted_as_at_once(chain, begin) -> None:
    model, u = drive(**CHAINS[chain]), walk()
    y = model.simulate(u, DT, start="rested")
    first, second = pieces(u, y, CUT, begin)
    told = predict(model, second, "u", "y", after=first)
    assert np.abs(told.predicted - y[CUT:]).max() < 1e-12 * np.ptp(y)
    assert (told.warm_up, told.starts, told.data()["start"]) == (0, (), None)
    (note,) = (n for n in told.notes if "a.csv" in n)
    assert ("zero" in note) == (begin == 0.0)
    assert "no pause" in note
    # the state at the end of a prediction says the same, and of three records in a row
    state = predict(model, first, "u", "y", after="rest").state
    again = predict(model, second, "u", "y", after=state)
    assert np.abs(again.predicted - y[CUT:]).max() < 1e-12 * np.ptp(y)
    a, b = pieces(u[:CUT], y[:CUT], 1000)
    for _, last in (
        predict_each(model, [b, second], "u", "y", a),
        (None, predict(model, second, "u", "y", after=[a, b])),
    ):
        assert np.abs(last.predicted - y[CUT:]).max() < 1e-12 * np.ptp(y)
    # without it the first samples are far off, and the estimate cannot mend the memory
    blind = predict(model, second, "u", "y")
    assert np.abs(blind.predicted - y[CUT:]).max() > 0.01 * np.ptp(y)


@pytest.mark.parametrize("chain", ["creep", "all"])
@pytest.mark.parametrize("samples", [1, 2500, 30000])
def test_the_pause_between_two_records_is_held_at_the_last_command(chain, samples) -> None:
    model, u = drive(**CHAINS[chain]), walk()
    held = np.insert(u, CUT, np.full(samples, u[CUT - 1]))
    y = model.simulate(held, DT, start="rested")
    first, second = record(held[:CUT], y[:CUT]), slice(CUT + samples, None)
    after = record(held[second], y[second], begin=(CUT + samples) * DT)
    told = predict(model, after, "u", "y", after=first)
    # a long pause has fewer steps: creep is exact, what is behind it nearly
    close = 1e-12 if samples < CUT else 1e-6
    assert np.abs(told.predicted - y[second]).max() < close * np.ptp(y)


def test_the_record_before_may_have_another_rate() -> None:
    model, u = drive(creep=CREEP, lag=Lag(delay=3.37e-3)), walk()
    y = model.simulate(u, DT, start="rested")
    rate = np.arange(4.0 * (CUT - 1) + 1.0) / 4.0
    fine = np.interp(rate, np.arange(CUT), u[:CUT])
    before = record(fine, model.simulate(fine, DT / 4.0, start="rested"), dt=DT / 4.0)
    told = predict(model, pieces(u, y, CUT)[1], "u", "y", after=before)
    # creep is a straight line between samples, the hysteresis behind a straight line is not
    assert np.abs(told.predicted - y[CUT:]).max() < 1e-5 * np.ptp(y)


@pytest.mark.parametrize("chain", CHAINS)
def test_a_reference_in_two_pieces_needs_the_command_of_one(chain) -> None:
    model = drive(**CHAINS[chain])
    wanted = np.interp(walk(), [0.0, 120.0], [-40e-6, -20e-6])
    kernel = np.hanning(61) / np.hanning(61).sum()
    wanted = np.convolve(np.pad(wanted, 30, mode="edge"), kernel, mode="valid")
    options = {"band_hz": 400.0, "limits": (-40.0, 160.0)}
    one = feedforward(model, wanted, DT, **options)
    first = feedforward(model, wanted[:CUT], DT, **options)
    told = feedforward(model, wanted[CUT:], DT, after=first.state, **options)
    error = np.abs(told.command - one.command[CUT:])
    # A lead ends with the piece, and smoothing has two more ends: what they change is forgotten,
    # creep last. Filters reach 5 samples, the mode is undone from the reference alone.
    assert error[100:].max() < (1e-9 if chain in ("hysteresis", "creep", "mode") else 2e-3)
    sent = record(first.command, name="sent.csv")
    state, notes = after_commands(model, [sent], record(wanted[CUT:]))
    assert "sent.csv" in notes[0]
    assert state is not None
    again = feedforward(model, wanted[CUT:], DT, after=state, **options)
    np.testing.assert_allclose(again.command, told.command, atol=1e-9)
    blind = feedforward(model, wanted[CUT:], DT, **options)
    assert np.abs(blind.command - one.command[CUT:]).max() > 0.1


def test_a_part_of_the_same_file_follows_the_rows_before_it() -> None:
    model, u = drive(creep=CREEP), walk()
    y = model.simulate(u, DT, start="rested")
    whole = replace(record(u, y), source_hash="5e1f")
    first, second = pieces(u, y, CUT, 0.0)
    numbers = np.arange(CUT, u.size, dtype=np.float64)
    part = replace(second, source_hash="5e1f", numbers=numbers)
    told = predict(model, part, "u", "y", after=whole)
    np.testing.assert_array_equal(
        told.predicted, predict(model, second, "u", "y", after=first).predicted
    )
    with pytest.raises(RecordError, match="select later rows"):
        predict(model, whole, "u", "y", after=whole)


def test_the_record_before_may_be_a_drive_at_rest() -> None:
    model, u = drive(creep=CREEP), walk()
    u[:CUT] = 63.0
    y = model.simulate(u, DT, start="rested")
    first, second = pieces(u, y, CUT)
    told = predict(model, second, "u", "y", after=first)
    assert np.abs(told.predicted - y[CUT:]).max() < 1e-12 * np.ptp(y)


def test_records_that_cannot_be_before_are_refused() -> None:
    model, u = drive(), walk()
    y = model.simulate(u, DT)
    first, second = pieces(u, y, CUT, 2.0)
    with pytest.raises(RecordError, match=r"begins at 2 s and 'a.csv' before it ends at 3 s"):
        predict(model, second, "u", "y", after=first)
    with pytest.raises(RecordError, match="no column 'y'"):
        predict(model, second, "u", "y", after=record(u[:CUT]))
    with pytest.raises(RecordError, match="another drive or unit: the commands, 10 to 236 V"):
        predict(model, second, "u", "y", after=record(2.0 * u[:CUT], y[:CUT], begin=-9.0))
    two = replace(first, channels=(first.channels[0], replace(first.channels[0], name="monitor")))
    with pytest.raises(RecordError, match=r"2 columns in V.*call the column .*'command \(V\)'"):
        after_commands(model, [two], second)
    with pytest.raises(RecordError, match="not evenly spaced"):
        predict(model, second, "u", "y", after=replace(first, time=first.time**1.1 - 9.0))
    with pytest.raises(ModelError, match="rested is called rest"):
        predict(model, second, "u", "y", after="rested")
    with pytest.raises(ModelError, match="--after must be auto, rest, a time"):
        predict(model, second, "u", "y", after="conditioned")
    with pytest.raises(ModelError, match=r"a\.csv' was not read"):
        feedforward(model, y, DT, after="a.csv")
