"""The chain where records hardly tell it: one rate, and what a drive did before."""

import math

import numpy as np
import pytest

from flexstage.hysteresis import DriveModel, LogCreep, PrandtlIshlinskii
from flexstage.hysteresis.chain.creep import Start
from flexstage.hysteresis.drive_model import ValidityRange
from flexstage.hysteresis.identification.chain_search import find_chain, find_starts
from flexstage.hysteresis.identification.fit_rows import ChainValues
from flexstage.hysteresis.identification.measurement import measurement
from flexstage.records import Channel, Record

DT = 0.01
PLAYS = PrandtlIshlinskii(
    gain=1.0,
    thresholds=np.linspace(0.05, 0.4, 6),
    weights=np.array([0.5, 0.2, 0.1, 0.1, 0.05, 0.05]),
)


def loops(rate, seconds, last=0.2):
    """Return cycles whose size falls, after two over the whole range."""
    t = np.arange(round(seconds / DT)) * DT
    size = np.interp(t, [0.0, 2.0 / rate, seconds], [1.0, 1.0, last])
    return 0.5 - 0.5 * size * np.cos(2.0 * np.pi * rate * t)


def record(u, creep, *, start: Start = "rested", zero=0.0, slow=0.0):
    """Return a record of a drive that creeps, with what else moves slowly beside it."""
    drive = DriveModel(
        hysteresis=PLAYS,
        creep=LogCreep(rate_per_decade=creep) if creep > 0.0 else None,
        validity=ValidityRange(
            input_range=(0.0, 1.0), output_range=(0.0, 2.0), rate_range_hz=(0.1, 10.0)
        ),
    )
    y = drive.simulate(u, DT, start=start) + zero + slow * np.linspace(0.0, 1.0, u.size) ** 2
    y = y + np.random.default_rng(3).normal(0.0, 3e-4, u.size)
    channels = (Channel(name="u", values=u), Channel(name="y", values=y))
    return Record(channels=channels, time=np.arange(u.size) * DT)


@pytest.mark.parametrize("creep", [0.0, 0.015, 0.04])
def test_creep_that_one_rate_shows_is_kept(creep: float) -> None:
    """Also that of no usual stack; a coarse model of the hysteresis is off by half a per cent."""
    data = measurement([record(loops(0.5, 40.0), creep)], "u", "y")
    found = find_chain(data).values.creep_per_decade
    assert found == pytest.approx(creep, abs=0.0075)


def test_a_slow_change_of_few_cycles_is_not_taken_for_large_creep() -> None:
    """Something slow of 1 % beside creep of 1.5 %: at two rates it would show, here it must not."""
    u = loops(0.5, 12.0, last=0.9)
    data = measurement([record(u, 0.015, slow=0.015)], "u", "y")
    found = find_chain(data).values.creep_per_decade
    assert 0.01 < found < 0.024


def test_records_on_one_zero_tell_what_was_before_them() -> None:
    """Each record alone may begin otherwise; with the right start both have one constant."""
    made = [
        record(loops(r, s), 0.03, start=math.inf, zero=2.0) for r, s in ((0.5, 24.0), (5.0, 4.0))
    ]
    data = measurement(made, "u", "y")
    starts, _ = find_starts(data, find_chain(data))
    assert starts == (math.inf, math.inf)
    # and so it is where the creep is known and nothing else is looked for
    known = find_chain(data, ChainValues(creep_per_decade=0.03))
    assert find_starts(data, known) == ((math.inf, math.inf), 0.0)
    # nothing is remembered without creep
    assert find_starts(data, find_chain(data, ChainValues()))[0] == ("rested", "rested")


def test_records_on_one_zero_are_not_given_pasts_that_put_them_on_two() -> None:
    """Cycles that are all alike hold little else: each by itself would be given another past."""
    made = [
        record(loops(rate, seconds, last=1.0), 0.03, start=2.0, zero=2.0)
        for rate, seconds in ((0.5, 12.0), (5.0, 2.0))
    ]
    data = measurement(made, "u", "y")
    starts, _ = find_starts(data, find_chain(data))
    assert starts[0] == starts[1]


def test_what_another_past_would_give_is_in_the_error_of_creep() -> None:
    """A short record tells little of its past, a long one tells it."""
    widths = []
    for cycles in (3, 30):
        made = [record(loops(r, cycles / r), 0.02, start=5.0) for r in (0.5, 5.0)]
        data = measurement(made, "u", "y")
        widths.append(find_starts(data, find_chain(data))[1])
    assert widths[0] > 0.0015
    assert widths[1] < 0.5 * widths[0]
