"""Weights of the time constants of creep: found where records ask for them, and not elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.arrays import Complex
from flexstage.hysteresis import PrandtlIshlinskii
from flexstage.hysteresis.chain.creep import Creep, CreepSpectrum, LogCreep
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.identification.chain_search import (
    ChainEstimate,
    find_chain,
    with_spectrum,
)
from flexstage.hysteresis.identification.fit_rows import ChainValues
from flexstage.hysteresis.identification.measurement import IdentificationData, measurement
from flexstage.hysteresis.model import Array
from flexstage.records import Channel, Record

DELAY = 0.0017
STACK = PrandtlIshlinskii(
    gain=0.071,
    thresholds=np.array([4.1, 11.7, 23.0, 37.0]),
    weights=np.array([0.013, 0.019, 0.008, 0.011]),
)
#: A loss at some 10 Hz, and creep over seconds, with little between them.
RELAXING = CreepSpectrum(times=(0.006, 2.3), weights=(0.11, 0.07))


def record(rate_hz: float, creep: Creep, seed: int, cycles: int = 9) -> Record:
    """Cycles of falling amplitude at 400 samples each, with noise of 0.02 % of the stroke."""
    dt = 1.0 / (400.0 * rate_hz)
    t: Array = np.linspace(0.0, (400 * cycles - 1) * dt, 400 * cycles)
    share = np.clip(1.2 - t / t[-1], 0.1, 1.0)
    u = 3.0 + 52.0 * (1.0 - share * np.cos(2.0 * np.pi * rate_hz * t))
    y = creep.simulate(STACK.simulate(u).values, dt).values
    y = Lag(delay=DELAY).simulate(y, dt).values
    y = y + np.random.default_rng(seed).normal(0.0, 0.002, t.size)
    return Record(channels=(Channel(name="u", values=u), Channel(name="y", values=y)), time=t)


def measured(creep: Creep, *rates_hz: float) -> IdentificationData:
    return measurement([record(f, creep, i) for i, f in enumerate(rates_hz)], "u", "y")


def relative(creep: Creep, frequency_hz: Array) -> Complex:
    response = creep.frequency_response(frequency_hz)
    return response / response[0]


#: The delay is known, and creep of the logarithm is what was found.
KNOWN = ChainEstimate(
    values=ChainValues(delay=DELAY, creep_per_decade=0.03),
    searched=("creep_per_decade",),
    errors={"creep_per_decade": 0.01},
)


def test_the_weights_of_a_loss_and_of_creep_are_found() -> None:
    found = with_spectrum(measured(RELAXING, 0.4, 3.1, 27.0), KNOWN)[1].values
    assert found.spectrum is not None
    assert replace(found, spectrum=None, creep_per_decade=0.03) == KNOWN.values
    # what loops show is the response at their rates, relative to one another
    f = np.geomspace(0.4, 27.0, 9)
    truth = relative(RELAXING, f)
    off = float(np.abs(relative(found.creep, f) - truth).max())
    # a coarse dictionary and time constants a decade apart leave some of it
    assert off < 0.02
    # creep of the logarithm that is best at the same rates is further off by far
    rates = np.linspace(0.0, 0.12, 61)
    logs = [relative(LogCreep(rate_per_decade=r, per_decade=1), f) for r in rates]
    assert min(float(np.abs(g - truth).max()) for g in logs) > 2.5 * off


def test_creep_of_the_logarithm_stays_one_number() -> None:
    creep = LogCreep(rate_per_decade=0.03, per_decade=1)
    assert with_spectrum(measured(creep, 0.4, 3.1, 27.0), KNOWN)[1] is KNOWN


def test_no_creep_gets_no_spectrum() -> None:
    none = LogCreep(rate_per_decade=0.0)
    bare = replace(KNOWN, values=ChainValues(delay=DELAY))
    assert with_spectrum(measured(none, 0.4, 27.0), bare)[1] is bare


def test_one_rate_tells_no_spectrum() -> None:
    assert with_spectrum(measured(RELAXING, 3.1), KNOWN)[1] is KNOWN


def test_what_is_held_out_is_not_seen() -> None:
    data = measured(RELAXING, 0.4, 27.0)
    train = (0, 2800)
    first = with_spectrum(data, KNOWN, train=train)[1].values
    assert first.spectrum is not None
    spoilt = []
    for s in data.sections:
        # counted as it was recorded, without what stands for the time before
        sample = np.arange(s.y.size) - s.history + s.first
        spoilt.append(s.y + 5.0 * (sample >= train[1]) * np.sin(s.u))
    other = replace(
        data,
        sections=tuple(replace(s, y=y) for s, y in zip(data.sections, spoilt, strict=True)),
    )
    assert with_spectrum(other, KNOWN, train=train)[1].values.spectrum == first.spectrum


@pytest.mark.parametrize("above", [0.0, 1.0])
def test_delay_and_loss_of_one_cycle_at_each_speed_are_separated(above: float) -> None:
    """The sum of lags in closed form: records that begin after a rest at the low or high end."""
    rates_hz, delay, creep = (0.3, 1.2, 5.0, 20.0), 4e-4, RELAXING
    records = []
    for seed, rate_hz in enumerate(rates_hz):
        dt = 1.0 / (300.0 * rate_hz)
        phase = np.linspace(0.0, 2.0 + above, round(300 * (1.0 + above / 2.0)) + 1)
        u = 55.0 - 52.0 * np.cos(np.pi * (phase - above))
        x = STACK.simulate(np.concatenate(([107.0, 3.0, u[0]], u))).values[3:]
        y = Lag(delay=delay).simulate(creep.simulate(x, dt).values, dt).values
        y = y + np.random.default_rng(seed).normal(0.0, 0.002, u.size)
        records.append(
            Record(
                channels=(Channel(name="u", values=u), Channel(name="y", values=y)),
                time=dt * np.arange(u.size, dtype=np.float64),
            )
        )
    data = measurement(records, "u", "y", periodic=False)
    first = find_chain(data)
    found, estimate = with_spectrum(data, first)
    # the delay of one number of creep takes the loss of the fast lag
    assert first.values.delay > 1.4 * delay
    assert estimate.values.spectrum is not None
    assert {s.start for s in found.sections} == {"rested"}
    f = np.array(rates_hz)
    late = [np.exp(-2j * np.pi * f * t) for t in (delay, first.values.delay, estimate.values.delay)]
    truth = relative(creep, f) * late[0]
    off = np.abs(relative(estimate.values.creep, f) * late[2] - truth).max()
    assert off < 0.01
    assert np.abs(relative(first.values.creep, f) * late[1] - truth).max() > 2.0 * off
    # each makes up for the other, mostly without the fastest record: the errors must say so
    errors, spectrum = estimate.errors, estimate.values.spectrum
    assert abs(estimate.values.delay - delay) < 3.0 * errors["delay"] < 2e-3
    per_decade = spectrum.rate_per_decade / sum(spectrum.weights)
    more = estimate.values.creep_per_decade - per_decade * sum(creep.weights)
    assert abs(more) < 3.0 * errors["creep_per_decade"] < 0.4
