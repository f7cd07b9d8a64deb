"""What a drive did before a record is found where its readings depend on it."""

import numpy as np
import pytest

from flexstage.base.arrays import Array
from flexstage.hysteresis import Identification, LogCreep, identify, predict
from flexstage.hysteresis.identification.chain_residual import ChainResidual
from flexstage.hysteresis.identification.chain_search import find_chain, find_memories
from flexstage.hysteresis.identification.fit_rows import ChainValues
from flexstage.hysteresis.identification.measurement import measurement
from flexstage.records import Channel, Record
from flexstage.virtual import virtual_stack

DT = 0.01
LOW, HIGH = 4.0, 118.0
MIDDLE = 0.5 * (LOW + HIGH)
NOISE = 0.01
#: A stack whose law is none of the models, and which creeps.
STACK = virtual_stack((0.0, 120.0), 38.0, 0.13)
CREEP = LogCreep(rate_per_decade=0.015, per_decade=3)
T = DT * np.arange(2400)
#: Loops about the middle that grow to both ends of the range late in the record, and stay there.
GROWING = MIDDLE + 0.5 * (HIGH - LOW) * np.interp(T, [0.0, 19.0], [0.25, 1.0]) * np.sin(
    2.0 * np.pi * 0.83 * T
)
CYCLES = MIDDLE - 0.5 * (HIGH - LOW) * np.cos(np.pi * T[:800])
FALLING = MIDDLE + 0.5 * (HIGH - LOW) * np.linspace(1.0, 0.0, 800) * np.sin(7.0 * np.pi * T[:800])
#: Motion before a record, and the words for the memory that it leaves.
BEFORE: dict[str, Array] = {
    "cycles over the full range that ended at its low end": CYCLES,
    "cycles over the full range that ended at its high end": CYCLES[:-100],
    "decreasing cycles about the middle of the range": FALLING,
    "none since depolarisation at zero input": np.zeros(1),
}
NAMES = list(BEFORE)


def readings(before: Array, u: Array, dt: float = DT, seed: int = 3) -> Array:
    """Readings of the stack, with all that it did before simulated."""
    free = STACK.simulate(np.concatenate((before, u))).values
    y = CREEP.simulate(free, dt).values[before.size :]
    return y + np.random.default_rng(seed).normal(0.0, NOISE, u.size)


def record(u: Array, y: Array, dt: float = DT) -> Record:
    channels = (Channel(name="u", values=u, unit="V"), Channel(name="y", values=y, unit="um"))
    time: Array = np.linspace(0.0, dt * (u.size - 1), u.size)
    return Record(channels=channels, time=time)


@pytest.fixture(scope="module")
def known() -> Identification:
    """Model of a record whose start does not matter, as its range is reached at once."""
    u = np.concatenate((CYCLES, GROWING))
    return identify(record(u, readings(np.zeros(1), u)), "u", "y", model="preisach")


@pytest.mark.parametrize("memory", BEFORE)
def test_a_start_that_is_found_is_as_good_as_a_known_one(
    memory: str, known: Identification
) -> None:
    """Also: what fits is not taken for a jump or a drift of the sensor."""
    result = identify(
        record(GROWING, readings(BEFORE[memory], GROWING)), "u", "y", model="preisach"
    )
    assert result.rms_percent < 1.2 * known.rms_percent
    assert result.quality.findings == ()
    (warning,) = (w for w in result.warnings if "both ends" in w)
    assert warning.endswith(f"assumed: {result.measurement.sections[0].memory}")


def test_each_record_has_its_own_memory() -> None:
    memories = NAMES[1], NAMES[3]
    data = measurement(
        [record(GROWING, readings(BEFORE[m], GROWING, seed=i)) for i, m in enumerate(memories)],
        "u",
        "y",
    )
    sections = find_memories(data, find_chain(data)).sections
    assert tuple(s.memory for s in sections) == memories


def test_a_memory_is_tried_by_the_columns_of_all_records() -> None:
    """Records of other ranges have one grid of thresholds."""
    half = 0.5 * GROWING
    records = [record(u, readings(CYCLES, u)) for u in (GROWING, half)]
    search = ChainResidual(measurement(records, "u", "y"), None)
    usual = search.rms(ChainValues())
    search.set_memory(1, NAMES[1])
    assert search.rms(ChainValues()) != usual
    search.set_memory(1, NAMES[0])
    assert search.rms(ChainValues()) == pytest.approx(usual, rel=1e-9)


@pytest.mark.parametrize("memory", [NAMES[0], NAMES[3]])
def test_one_loop_at_each_of_several_speeds_shows_whether_it_begins_from_rest(memory: str) -> None:
    """A loop from rest is open; a closed one fits almost any memory alone, but not the others."""
    phase = 2.0 * np.pi * np.arange(600) / 600.0
    u = 60.0 - 60.0 * np.cos(phase)
    before = np.tile(u, 3) if memory == NAMES[0] else np.zeros(1)
    loops = []
    for seed, rate in enumerate((0.1, 1.0, 10.0)):
        dt = 1.0 / (600.0 * rate)
        loops.append(record(u, readings(before, u, dt, seed), dt))
    data = measurement(loops, "u", "y")
    found = find_memories(data, find_chain(data))
    assert {s.memory for s in found.sections} == {memory}


def test_a_prediction_begins_with_the_memory_that_the_first_samples_show(
    known: Identification,
) -> None:
    for memory, before in BEFORE.items():
        prediction = predict(known.model, record(GROWING, readings(before, GROWING)), "u", "y")
        # assumed at the low end, the other motions leave up to 1.5 %
        assert prediction.free_constant_rms_percent < 0.45, memory
