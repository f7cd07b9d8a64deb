"""Identification from one period of a loop, and of drives without hysteresis.

Evidence (Hysteresis and records): one period of a loop from any point: the same model; creep of
steady motion (400 periods): 1e-12; creep of periods at two rates: 5 %.
"""

import math

import numpy as np
import pytest

from flexstage.base.errors import ModelError, RecordError
from flexstage.hysteresis import BoucWen, CreepSpectrum, DriveModel, LogCreep, identify, predict
from flexstage.hysteresis.chain.creep import creep_start
from flexstage.hysteresis.identification.fit_rows import ChainValues, filtered, rows_of
from flexstage.hysteresis.identification.measurement import measurement
from flexstage.hysteresis.models.line.law import Line
from flexstage.records import Channel, Record
from flexstage.virtual import virtual_stack

MODEL = "modified-prandtl-ishlinskii"


def record(u, y, dt):
    channels = (Channel(name="u", values=u, unit="V"), Channel(name="y", values=y, unit="m"))
    return Record(channels=channels, time=np.arange(u.size) * dt, source="a loop")


def loop(begin=0, closing=0, dt=5e-3, n=200, creep=0.0, noise=8e-9, drift=0.0):
    """One of many periods of a stack that is none of the models, from a sample on."""
    u = np.tile(61.0 - 58.0 * np.cos(2.0 * np.pi * np.arange(n) / n), 8)
    y = virtual_stack((0.0, 120.0), 38e-6, 0.13).simulate(u).values
    law = LogCreep(rate_per_decade=creep)
    y = law.simulate(y, dt, law.settled(y[n : 2 * n].mean(), dt)).values
    part = slice(6 * n + begin, 7 * n + begin + closing)
    y = y + np.random.default_rng(5).normal(0.0, noise, y.size) + 2.3e-6
    y = y + drift * (np.arange(y.size) - part.start) / n
    return record(u[part], y[part], dt)


def test_creep_in_steady_state_is_that_after_many_periods():
    creep = CreepSpectrum(times=(0.3, 7.0, 40.0), weights=(0.02, 0.03, 0.05))
    x = 1.7 + np.sin(0.1 * np.arange(64)) ** 3
    closed = np.append(x, x[0])
    state = creep_start(creep, closed, 0.11, "periodic")
    assert creep.simulate(x, 0.11, state).state == pytest.approx(state, rel=1e-12)
    long = creep.simulate(np.tile(x, 400), 0.11).values[-64:]
    assert creep.simulate(x, 0.11, state).values == pytest.approx(long, rel=1e-12)
    both = creep_start(creep, np.stack((closed, -2.0 * closed)), 0.11, "periodic")
    assert both == pytest.approx(np.stack((state, -2.0 * state)))


def test_a_delay_returns_at_the_end_of_the_period():
    (section,) = measurement([loop()], "u", "y").sections
    rows = rows_of([section])[0]
    n = section.u.size - section.history - 1
    assert section.periodic
    assert np.array_equal(rows.at, section.history + np.arange(n))
    delayed = filtered(section.u[:, None], section, rows, ChainValues(delay=2.25 * section.dt))
    period = section.u[section.history : -1]
    expected = 0.75 * np.roll(period, 2) + 0.25 * np.roll(period, 3)
    assert delayed[:, 0] == pytest.approx(expected)
    # and the first motion of a mode has faded
    quick = ChainValues(resonance_hz=3.0, damping_ratio=0.2)
    assert quick.modes is not None
    long = quick.modes.simulate(np.tile(period, 8), section.dt).values[-n:]
    assert filtered(section.u[:, None], section, rows, quick)[:, 0] == pytest.approx(long, abs=0.3)


def test_held_out_parts_are_parts_of_the_one_period():
    (rows,) = rows_of(measurement([loop(70, 1)], "u", "y").sections)
    assert rows.at.size == np.unique(rows.at).size == 200
    assert sorted(set(rows.cycle.tolist())) == list(range(1, 11))
    # also of a dense record whose first samples hardly move
    assert measurement([loop(120, 1, n=20_000)], "u", "y").sections[0].first == 0


@pytest.mark.parametrize(("begin", "closing"), [(0, 1), (63, 0), (100, 1), (171, 1)])
def test_a_period_may_begin_anywhere(begin, closing):
    reference, result = (
        identify(loop(*where, noise=0.0), "u", "y", model=MODEL, chain=ChainValues())
        for where in ((0, 0), (begin, closing))
    )
    assert result.measurement.sections[0].u.size == 201
    assert result.rms_percent == pytest.approx(reference.rms_percent, rel=0.01)
    assert result.rms_percent < 0.05
    assert reference.heldout_rms_percent is not None
    assert result.heldout_rms_percent == pytest.approx(reference.heldout_rms_percent, rel=0.2)
    assert result.model.start == math.inf
    assert result.starts == (math.inf,)
    assert any("one period, taken as repeated" in w for w in result.warnings)
    assert not any("reaches both ends" in w for w in result.warnings)
    # the same model predicts any other part of this motion
    other = predict(result.model, loop(137), "u", "y")
    assert other.as_predicted_rms_percent < 1.2 * result.rms_percent + 0.02


def test_one_rate_shows_no_creep_and_two_rates_do():
    steady = [loop(40, 1, creep=0.015), loop(110, dt=5e-2, creep=0.015)]
    one = identify(steady[0], "u", "y", model=MODEL)
    assert one.model.creep is None
    both = identify(steady, "u", "y", model=MODEL)
    assert both.model.creep is not None
    assert both.model.creep.rate_per_decade == pytest.approx(0.015, rel=0.05)
    assert both.rms_percent < 0.03


def test_a_lag_of_the_dictionary_is_not_forced_on_a_model_that_needs_none():
    law = BoucWen(gain=2.0e-6, hysteresis_gain=1.2e-6, beta=2.5, gamma=-1.0)
    u = np.sin(2.0 * np.pi * np.arange(1000) / 200)
    y = law.simulate(u).values
    result = identify(record(u[450:650], y[450:650], 1e-5), "u", "y", model="bouc-wen")
    assert result.rms_percent < 1e-3
    assert result.model.lag is None


def test_what_is_no_period_is_refused_and_names_the_option():
    u, y = (c.values for c in loop(20).channels)
    half = record(u[:100], y[:100], 5e-3)
    with pytest.raises(RecordError, match=r"no complete cycle.*add --periodic"):
        identify(half, "u", "y")
    with pytest.raises(RecordError, match=r"ends differ by .* % of the input range and .*--rows"):
        identify(half, "u", "y", periodic=True)
    two = record(np.tile(u, 2), np.tile(y, 2), 5e-3)
    with pytest.raises(RecordError, match="has 2 major cycles"):
        identify(two, "u", "y", periodic=True)
    with pytest.raises(ModelError, match="omit --zero drift"):
        identify(half, "u", "y", periodic=True, zero="drift")
    with pytest.raises(ModelError, match="omit --train"):
        identify(half, "u", "y", periodic=True, train=(0, 100))


def test_an_open_loop_is_a_period_only_by_request():
    drifting = loop(20, 1, drift=2e-6)
    with pytest.raises(RecordError, match="no complete cycle"):
        identify(drifting, "u", "y", model=MODEL)
    result = identify(drifting, "u", "y", model=MODEL, periodic=True)
    assert any("of the output range beyond noise: the motion was not" in w for w in result.warnings)
    few = loop(3, 1, n=30)
    with pytest.raises(RecordError, match="at least 50"):
        identify(few, "u", "y", model=MODEL)
    assert identify(few, "u", "y", model=MODEL, periodic=True).rms_percent < 0.1


# ------------------------------------------------------------------ drives without hysteresis


def linear(seed, delay=0.0, rates=(1.0,), width=0.0, noise=1e-3):
    """Cycles of falling amplitude of a capacitor, or of a stack of a loop width."""
    dt = 4e-3
    phase = 2.0 * np.pi * np.cumsum(np.repeat(rates, 2000)) * dt

    def drive(late):
        p = np.interp(np.arange(phase.size) - late / dt, np.arange(phase.size), phase)
        return 5.0 - (5.0 - 4.0 * p / phase[-1]) * np.cos(p)

    y = 2e-6 * drive(delay)
    if width:  # a third of the stroke by a stack, the rest straight
        y = (
            y * 2.0 / 3.0
            + virtual_stack((0.0, 10.0), 2e-5 / 3.0, 3.0 * width).simulate(drive(0.0)).values
        )
    y = y + noise * 2e-5 * np.random.default_rng(seed).normal(size=y.size)
    return record(drive(0.0), y, dt)


@pytest.mark.parametrize(("seed", "delay", "rates"), [(1, 0.0, (1.0,)), (2, 0.012, (1.0, 5.0))])
def test_a_linear_drive_is_a_line(seed, delay, rates):
    result = identify(linear(seed, delay, rates), "u", "y")
    assert result.kind == "line"
    assert {c.kind for c in result.candidates} > {"bouc-wen", "preisach"}
    assert result.model.creep is None
    (gain,) = result.parameters
    assert abs(gain.value - 2e-6) < 4.0 * gain.standard_error < 4e-9
    assert (result.model.lag.delay if result.model.lag else 0.0) == pytest.approx(delay, abs=2e-4)


def test_a_drive_with_a_narrow_loop_is_no_line():
    result = identify(linear(3, width=0.02), "u", "y")
    assert result.kind != "line"
    errors = {c.kind: c.heldout_rms_percent or math.nan for c in result.candidates}
    assert errors["line"] > 1.5 * errors[result.kind]


def test_a_line_has_an_exact_inverse():
    drive = DriveModel(hysteresis=Line(gain=-0.3), offset=2.0)
    y = drive.simulate([1.0, 4.0, -2.0], 0.1)
    assert y == pytest.approx([1.7, 0.8, 2.6])
    rising = Line(gain=0.3)
    u = [1.0, 4.0, -2.0]
    assert rising.inverse(rising.simulate(u).values).values == pytest.approx(u)
    assert all(p.holds for p in rising.properties())
