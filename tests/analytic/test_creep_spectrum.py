"""Weights of the time constants of creep: found where records ask for them, and not elsewhere."""

from dataclasses import replace

import numpy as np

from flexstage.hysteresis import PrandtlIshlinskii
from flexstage.hysteresis.chain.creep import Creep, CreepSpectrum, LogCreep
from flexstage.hysteresis.chain.element import Complex
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.identification.chain_residual import with_spectrum
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


KNOWN = ChainValues(delay=DELAY, creep_per_decade=0.03)


def test_the_weights_of_a_loss_and_of_creep_are_found() -> None:
    found = with_spectrum(measured(RELAXING, 0.4, 3.1, 27.0), KNOWN)
    assert found.spectrum is not None
    assert replace(found, spectrum=None, creep_per_decade=0.03) == KNOWN
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
    assert with_spectrum(measured(creep, 0.4, 3.1, 27.0), KNOWN) is KNOWN


def test_no_creep_gets_no_spectrum() -> None:
    none = LogCreep(rate_per_decade=0.0)
    bare = replace(KNOWN, creep_per_decade=0.0)
    assert with_spectrum(measured(none, 0.4, 27.0), bare) is bare


def test_one_rate_tells_no_spectrum() -> None:
    assert with_spectrum(measured(RELAXING, 3.1), KNOWN) is KNOWN


def test_what_is_held_out_is_not_seen() -> None:
    data = measured(RELAXING, 0.4, 27.0)
    train = (0, 2800)
    first = with_spectrum(data, KNOWN, train=train)
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
    assert with_spectrum(other, KNOWN, train=train).spectrum == first.spectrum
