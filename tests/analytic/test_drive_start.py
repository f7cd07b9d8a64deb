"""What a drive did before a sequence, against creep in closed form."""

import math

import numpy as np
import pytest

from flexstage.hysteresis import DriveModel, LogCreep, PrandtlIshlinskii
from flexstage.hysteresis.chain.creep import Start
from flexstage.hysteresis.drive_model import start_in_words

DT = 0.01
COMMANDS = 5.0 - 4.0 * np.cos(2.0 * np.pi * DT * np.arange(1000))


def drive(own: Start) -> DriveModel:
    """Return creep behind a straight line."""
    line = PrandtlIshlinskii(gain=1.0, thresholds=np.ones(1), weights=np.zeros(1))
    return DriveModel(hysteresis=line, creep=LogCreep(rate_per_decade=0.02), start=own)


@pytest.mark.parametrize("own", ["rested", 0.0, math.inf])
@pytest.mark.parametrize("start", ["rested", 0.0, 5.0, math.inf])
def test_a_start_that_is_given_replaces_that_of_the_model(own: Start, start: Start) -> None:
    given = drive(own).simulate(COMMANDS, DT, start=start)
    np.testing.assert_array_equal(given, drive(start).simulate(COMMANDS, DT))


def test_settling_from_the_low_end_is_a_sum_of_exponentials() -> None:
    creep = LogCreep(rate_per_decade=0.02)
    begun, settled = (drive("rested").simulate(COMMANDS, DT, start=s) for s in (0.0, math.inf))
    t = DT * (1.0 + np.arange(COMMANDS.size))
    lags = creep.lag_gains[:, None] * np.exp(-t / creep.time_constants[:, None])
    way = np.mean(COMMANDS) - np.min(COMMANDS)
    np.testing.assert_allclose(settled - begun, way * lags.sum(axis=0), atol=1e-12)


def test_what_cannot_be_told_apart_is_named_together() -> None:
    assert start_in_words("rested") == "rested at the first command"
    assert start_in_words(math.inf) == "moved for long"
    assert start_in_words(math.inf, 1000.0, 460.0) == "moved for about 460 s or longer"
    assert start_in_words(2.15, 1.0) == "moved for about 1 to 2.1 s"
    assert start_in_words(0.0, "rested", 30.0) == (
        "rested at the first command or just left the low end of its range or moved for about 30 s"
    )
