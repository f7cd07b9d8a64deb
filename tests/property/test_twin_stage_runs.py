"""However a run of a simulated stage is cut, its numbers are the same to the last bit.

Evidence (Instruments, twin, control): twin, a run in parts (the same run whole): bit by bit
"""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.stage.designs import design
from flexstage.virtual.build import virtual_stage
from flexstage.virtual.piezo_stage import PiezoStage
from flexstage.virtual.stage import ScrewStage, StageSamples, VirtualStage

FIELDS = ("time", "reading", "position", "voltage", "command")
# past the end of a block of drawn noise
LENGTH = 4700


@cache
def made(name: str) -> PiezoStage | ScrewStage:
    return virtual_stage(design(name), model="lumped", seed=11)


def joined(blocks: list[StageSamples]) -> dict[str, np.ndarray]:
    return {f: np.concatenate([getattr(b, f) for b in blocks], axis=-1) for f in FIELDS}


def commands(kind: str, seed: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.standard_normal((2, count)), axis=1)
    if kind == "screw":
        return 1e-4 + 1e-6 * walk
    return 60.0 + 40.0 * np.sin(0.1 * walk)


def feedforward(seed: int, count: int) -> np.ndarray:
    forward = commands("piezo", seed + 1, count)
    forward[:, : count // 3] = np.nan
    forward[0, count // 2 :] = np.nan
    return forward


@settings(max_examples=15, deadline=None)
@given(
    cuts=st.lists(st.integers(0, LENGTH), min_size=1, max_size=5),
    seed=st.integers(0, 10**6),
    servo=st.tuples(st.booleans(), st.booleans()),
)
@pytest.mark.parametrize("name", ["vgtu-piezo", "vgtu-mechanical"])
def test_a_run_cut_in_parts_is_the_same_run(
    name: str, cuts: list[int], seed: int, servo: tuple[bool, bool]
) -> None:
    stage = made(name)
    wanted = commands(stage.kind, seed, LENGTH)
    if stage.kind == "piezo":
        for a, on in enumerate(servo):
            if on:
                wanted[a] = 3e-5 + 2e-7 * (wanted[a] - 60.0)
    forward = feedforward(seed, LENGTH)
    stage.reset()
    whole = joined([stage.run(wanted, servo, forward)])
    stage.reset()
    bounds = [0, *sorted(cuts), LENGTH]
    parts = joined([stage.run(wanted[:, a:b], servo, forward[:, a:b]) for a, b in pairwise(bounds)])
    for field in FIELDS:
        assert np.array_equal(whole[field], parts[field]), field
    assert np.array_equal(whole["time"], np.arange(LENGTH) / stage.sample_rate_hz)


@pytest.mark.parametrize("name", ["vgtu-piezo", "vgtu-mechanical"])
def test_a_new_stage_of_a_seed_is_the_one_that_was_reset(name: str) -> None:
    stage: VirtualStage = made(name)
    stage.reset()
    wanted = commands(stage.kind, 3, 600)
    first = stage.run(wanted, (False, False))
    other = virtual_stage(design(name), model="lumped", seed=11).run(wanted, (False, False))
    third = virtual_stage(design(name), model="lumped", seed=12).run(wanted, (False, False))
    for field in FIELDS:
        assert np.array_equal(getattr(first, field), getattr(other, field)), field
    assert not np.array_equal(first.reading, third.reading)
    assert not np.array_equal(first.position, third.position)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    height=st.floats(0.0, 400.0),
    servo=st.tuples(st.booleans(), st.booleans()),
)
def test_whatever_is_commanded_voltages_stay_in_range_and_within_the_slew(
    seed: int, height: float, servo: tuple[bool, bool]
) -> None:
    stage = made("vgtu-piezo")
    stage.reset()
    rng = np.random.default_rng(seed)
    wanted = height * rng.uniform(-1.0, 1.0, (2, 500))
    for a, on in enumerate(servo):
        if on:
            wanted[a] *= 1e-6
    block = stage.run(wanted, servo, height * rng.uniform(-1.0, 1.0, (2, 500)))
    for u in (block.voltage, block.command):
        assert np.all(np.isfinite(u))
        assert u.min() >= 0.0
        assert u.max() <= 120.0 + 1e-9
    # 0.3 A into 6.4 uF
    assert np.abs(np.diff(block.voltage, axis=1)).max() * 1e4 <= 0.3 / 6.4e-6 * (1.0 + 1e-9)
    assert np.all(np.isfinite(block.reading))
