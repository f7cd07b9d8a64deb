"""Interval and band of an identification, against the stretch that follows what was identified.

Stretches of random length are cut from the two public records of a PICMA stack
(`../shared/data/picma-p885`), a model is identified, and the stretch of the same length that
follows is predicted, with the memory of the first. Cycles of it that are larger or smaller than all
that were fitted are not counted: no record shows the error of a motion that it does not contain.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest

from flexstage.hysteresis import Lag, LogCreep, identify
from flexstage.hysteresis.prediction import predict
from flexstage.records import Channel, Record, read_record
from flexstage.virtual import virtual_stack
from tests.shared_data import DATA, needs

MODELS = "preisach", "bouc-wen", "maxwell-slip", "modified-prandtl-ishlinskii"


def part(record: Record, start: int, stop: int) -> Record:
    """Cut a record."""
    channels = tuple(replace(c, values=c.values[start:stop]) for c in record.channels)
    time = record.time[start:stop] - record.time[start]
    return replace(record, channels=channels, time=time)


def measured(count: int) -> Iterator[tuple[Record, int]]:
    """Yield two neighbouring stretches of the stack, and the size of each.

    One in three is of loops of one amplitude; in the other file they grow and fall, and rest.
    """
    files = [
        read_record(DATA / "picma-p885" / name, sample_rate=200.0)
        for name in ("Test_Vi_Do_Di.dat", "Model_Vi_Do.dat")
    ]
    # the constants were found with the seeds 1 and 2
    rng = np.random.default_rng(3)
    for k in range(count):
        record = files[k % 3 == 2]
        size = int(rng.integers(2000, min(6000, record.size // 2)))
        start = int(rng.integers(0, record.size - 2 * size))
        yield part(record, start, start + 2 * size), size


def simulated(count: int) -> Iterator[tuple[Record, int]]:
    """Yield cycles of random size and rate, over a decade, of a law that is none of the models.

    The zero of the sensor wanders, by up to a thousandth of the stroke.
    """
    dt, size = 0.002, 16000
    for seed in range(200, 200 + count):
        rng = np.random.default_rng(seed)
        moves, volts = [], 0.0
        while sum(map(len, moves)) < size:
            end = volts < 60.0
            target = 120.0 * (end if rng.random() > 0.6 or not moves else rng.random())
            rate = 10.0 ** rng.uniform(-0.1, 0.9)
            steps = max(int(0.5 * abs(target - volts) / 120.0 / rate / dt), 4)
            share = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, steps + 1) / steps)
            moves.append(volts + (target - volts) * share)
            volts = target
        u = np.concatenate(moves)[:size]
        y = virtual_stack((0.0, 120.0), 38e-6, rng.uniform(0.08, 0.15)).simulate(u).values
        y = LogCreep(rate_per_decade=rng.uniform(0.005, 0.03)).simulate(y, dt).values
        y = Lag(delay=rng.uniform(0.0, 1e-3)).simulate(y, dt).values
        wander = np.cumsum(rng.normal(size=size)) / np.sqrt(size)
        y += 38e-6 * 10.0 ** rng.uniform(-4.0, -3.0) * wander
        y += rng.normal(0.0, 10.0 ** rng.uniform(-8.5, -7.3), size)
        channels = (Channel(name="0", values=u, unit="V"), Channel(name="4", values=y, unit="m"))
        yield Record(channels=channels, time=np.arange(size) * dt, source=f"{seed}"), size // 2


@dataclass(frozen=True)
class Following:
    """What an identification states, and what the following stretch shows [% of the stroke]."""

    interval: tuple[float, float] | None
    within: float
    rms: float


def following(record: Record, size: int, model: str) -> Following | None:
    """Identify the first stretch and predict the second; None if that one moves otherwise."""
    found = identify(part(record, 0, size), "0", "4", model=model)
    section, band = found.measurement.sections[0], found.heldout_band_percent
    assert band is not None
    prediction = predict(found.model, record, "0", "4")
    low, high = section.cycles.range
    fitted = section.cycles.swing[section.cycles.bounds[:-1] >= section.warm_up] * (high - low)
    span = float(np.ptp(prediction.command))
    counted = np.zeros(record.size, dtype=bool)
    dt = record.time[1] - record.time[0]
    bounds = [*(round(c.time / dt) for c in prediction.cycles), record.size]
    for cycle, first, after in zip(prediction.cycles, bounds[:-1], bounds[1:], strict=True):
        counted[first:after] = 0.95 * fitted.min() <= cycle.swing * span <= 1.05 * fitted.max()
    counted[:size] = False
    if counted.sum() < 0.2 * size:
        return None
    error = 100.0 * (prediction.measured - prediction.predicted)[counted] / found.stroke
    return Following(
        interval=found.heldout_interval_percent,
        within=float(np.mean(np.abs(error) <= band)),
        rms=float(np.sqrt(np.mean(error**2))),
    )


def shares(stretches: Iterator[tuple[Record, int]]) -> tuple[list[bool], list[float], list[float]]:
    """Return whether each determined interval holds the error that follows, widths, and bands.

    The width is the quotient of the ends of an interval; of a band the share inside is returned.
    """
    every = [following(*s, MODELS[k % len(MODELS)]) for k, s in enumerate(stretches)]
    results = [f for f in every if f is not None]
    determined = [(f.rms, *f.interval) for f in results if f.interval is not None]
    inside = [low <= rms <= high for rms, low, high in determined]
    return inside, [high / low for _, low, high in determined], [f.within for f in results]


@needs("picma-p885")
@pytest.mark.slow
def test_interval_and_band_hold_the_following_stretch() -> None:
    """Of 95 % that are stated, at least 90 % hold: 49 of 49 intervals, and bands on 57 stretches.

    All of 49 is no sign of intervals that are too wide: where 95 % hold, it happens in one of
    twelve such runs. Their width is limited instead: of errors of six cycles, 95 % lie within a
    factor of 4.8.
    """
    inside, widths, within = shares(measured(60))
    assert len(within) >= 54
    assert len(inside) >= 45
    assert np.mean(inside) >= 0.90
    assert np.median(widths) < 6.0
    assert 0.90 <= np.mean(within) <= 0.99


@pytest.mark.slow
def test_they_hold_at_other_rates_and_amplitudes() -> None:
    """Twelve simulated stacks: of 95 % one miss is usual, and three are not."""
    inside, _, within = shares(simulated(12))
    assert len(inside) >= 10
    assert np.sum(inside) >= len(inside) - 2
    assert 0.90 <= np.mean(within) <= 0.99


@needs("picma-p885")
@pytest.mark.evidence
def test_good_stretches_have_no_fault() -> None:
    """The manual says of 200 of them that nothing was reported."""
    for stretches in (measured(100), simulated(100)):
        for record, size in stretches:
            found = identify(part(record, 0, size), "0", "4", model="preisach")
            assert not found.quality.findings, record.source
