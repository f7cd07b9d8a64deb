"""Positioning figures against ISO 230-2:2014: worked by hand, and by loops over its definitions.

Evidence (Measuring and centring): ISO 230-2 (examples by hand, of a line and of a closed circle,
plain loops): $10^{-6}$

Evidence (Coverage of 95 % intervals): ISO 230-2, 5 and 3 runs: means; A and R, 600 repetitions:
92.5 to 98; at least 92.5 % required, *simulated*
"""

import math
import statistics

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.base.errors import RecordError
from flexstage.measure.motion.approaches import staircase_dwells
from flexstage.measure.motion.positioning import figures, positioning
from tests.tiers import limits, sizes

NAMES = (
    "reversal", "mean_reversal", "repeatability_upward", "repeatability_downward", "repeatability",
    "systematic_upward", "systematic_downward", "systematic", "mean_deviation",
    "accuracy_upward", "accuracy_downward", "accuracy",
)  # fmt: skip


def test_example_by_hand() -> None:
    """Three targets, two runs: every number below was worked with pencil and paper.

    Means up 3, 9, -2; down 8, 13, 6. Of two runs s = |difference| / sqrt 2: up 2, 4, 6 and down
    4, 2, 8 apart give s sqrt 2 = those. B_i = -5, -4, -8.
    """
    unit = 1e-9
    target = np.array([10e-6, 25e-6, 55e-6])
    up = target[:, None] + unit * np.array([[2, 4], [7, 11], [-5, 1]])
    down = target[:, None] + unit * np.array([[6, 10], [12, 14], [2, 10]])
    found = positioning(target, up, down)
    r = math.sqrt(2.0)
    expected = {
        "reversal": 8.0,
        "mean_reversal": -17.0 / 3.0,
        "repeatability_upward": 4.0 * 6.0 / r,
        "repeatability_downward": 4.0 * 8.0 / r,
        # target 3: 2 * 6 / r + 2 * 8 / r + 8 = 27.8 beats 4 * 8 / r = 22.6
        "repeatability": 28.0 / r + 8.0,
        "systematic_upward": 11.0,
        "systematic_downward": 7.0,
        "systematic": 15.0,
        # means of both directions 5.5, 11, 2
        "mean_deviation": 9.0,
        # up: 9 + 8 / r against -2 - 12 / r
        "accuracy_upward": 11.0 + 20.0 / r,
        # down: 13 + 4 / r = 15.83, 6 + 16 / r = 17.31; 8 - 8 / r = 2.34, 6 - 16 / r = -5.31
        "accuracy_downward": 32.0 / r,
        # 6 + 16 / r = 17.31 against -2 - 12 / r
        "accuracy": 8.0 + 28.0 / r,
    }
    for name, value in expected.items():
        assert getattr(found, name).value == pytest.approx(unit * value, rel=1e-9), name
    assert found.reversal_at_targets == pytest.approx(unit * np.array([-5.0, -4.0, -8.0]))
    assert found.mean_bidirectional == pytest.approx(unit * np.array([5.5, 11.0, 2.0]))
    assert found.runs == 2


def test_closed_circle_by_hand() -> None:
    """Four targets, two runs: 0 and 360 deg are one position, whose closure error stays.

    Means up 2, 5, -1, 4 and down 6, 10, 3, 10 arcsec; s = sqrt 2 but 2 sqrt 2 up at 360. B_i = -4,
    -5, -4, -6, so that the mean reversal is ((-4 - 6) / 2 - 5 - 4) / 3. Means of both 4, 7.5, 1, 7.
    """
    unit = math.radians(1.0 / 3600.0)
    target = np.radians([0.0, 120.0, 240.0, 360.0])
    up = target[:, None] + unit * np.array([[1, 3], [4, 6], [-2, 0], [2, 6]])
    down = target[:, None] + unit * np.array([[5, 7], [9, 11], [2, 4], [9, 11]])
    found = positioning(target, up, down, unit="rad", trials=50)
    r = math.sqrt(2.0)
    expected = {
        "reversal": 6.0, "mean_reversal": -14.0 / 3.0, "repeatability_upward": 8.0 * r,
        "repeatability_downward": 4.0 * r, "repeatability": 6.0 * r + 6.0,
        "systematic_upward": 6.0, "systematic_downward": 7.0, "systematic": 11.0,
        "mean_deviation": 6.5, "accuracy_upward": 5.0 + 6.0 * r,
        "accuracy_downward": 7.0 + 4.0 * r, "accuracy": 11.0 + 4.0 * r,
    }  # fmt: skip
    for name, value in expected.items():
        estimate = getattr(found, name)
        assert estimate.value == pytest.approx(unit * value, rel=1e-9), name
        assert estimate.unit == "rad"
    # the two runs close by 2.5 and 3.5
    assert found.closure is not None
    assert found.closure.value == pytest.approx(3.0 * unit, rel=1e-9)
    assert found.closure.uncertainty == pytest.approx(0.5 * unit, rel=1e-9)
    assert (found.positions, found.targets_required) == (3, 8)
    # the same readings at three targets, and of a linear axis, close nothing
    for other in (
        positioning(target[:3], up[:3], down[:3], unit="rad", trials=50),
        positioning(target, up, down, trials=50),
    ):
        assert other.closure is None
        reversal = other.reversal_at_targets.mean()
        assert other.mean_reversal.value == pytest.approx(reversal, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "travel", "asked"),
    [("rad", 30, 3), ("rad", 90, 3), ("rad", 91, 5), ("rad", 180, 5), ("rad", 181, 8),
     ("rad", 360, 8), ("rad", 405, 9), ("rad", 720, 16), ("m", 0.04, 5), ("m", 1.0, 5),
     ("m", 1.5, 8)],
)  # fmt: skip
def test_targets_that_the_standard_asks_for(unit, travel, asked) -> None:
    ends = np.array([0.0, np.radians(travel) if unit == "rad" else travel])
    readings = ends[:, None] + np.zeros((2, 2))
    found = positioning(ends, readings, readings, unit=unit, trials=2)
    assert found.targets_required == asked


def by_loops(up: list[list[float]], down: list[list[float]]) -> dict[str, float]:
    """Return the figures by the definitions of the standard, one target after the other."""
    m = len(up)
    mean_up = [statistics.fmean(row) for row in up]
    mean_down = [statistics.fmean(row) for row in down]
    s_up = [statistics.stdev(row) for row in up]
    s_down = [statistics.stdev(row) for row in down]
    b = [mean_up[i] - mean_down[i] for i in range(m)]
    r = [
        max(2.0 * s_up[i] + 2.0 * s_down[i] + abs(b[i]), 4.0 * s_up[i], 4.0 * s_down[i])
        for i in range(m)
    ]
    tops_up = [mean_up[i] + 2.0 * s_up[i] for i in range(m)]
    tops_down = [mean_down[i] + 2.0 * s_down[i] for i in range(m)]
    feet_up = [mean_up[i] - 2.0 * s_up[i] for i in range(m)]
    feet_down = [mean_down[i] - 2.0 * s_down[i] for i in range(m)]
    both = [0.5 * (mean_up[i] + mean_down[i]) for i in range(m)]
    return {
        "reversal": max(abs(v) for v in b),
        "mean_reversal": sum(b) / m,
        "repeatability_upward": 4.0 * max(s_up),
        "repeatability_downward": 4.0 * max(s_down),
        "repeatability": max(r),
        "systematic_upward": max(mean_up) - min(mean_up),
        "systematic_downward": max(mean_down) - min(mean_down),
        "systematic": max(mean_up + mean_down) - min(mean_up + mean_down),
        "mean_deviation": max(both) - min(both),
        "accuracy_upward": max(tops_up) - min(feet_up),
        "accuracy_downward": max(tops_down) - min(feet_down),
        "accuracy": max(tops_up + tops_down) - min(feet_up + feet_down),
    }


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000), targets=st.integers(2, 9), runs=st.integers(2, 6),
    scale=st.floats(0.1, 300.0),
)  # fmt: skip
def test_figures_equal_the_definitions(seed: int, targets: int, runs: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    target = np.cumsum(rng.uniform(3e-6, 11e-6, targets))
    both = (
        1e-9 * scale * (rng.standard_normal((2, targets, runs)) + rng.normal(size=(2, targets, 1)))
    )
    order = rng.permutation(targets)
    found = positioning(
        target[order], (target[:, None] + both[0])[order], (target[:, None] + both[1])[order],
        trials=50,
    )  # fmt: skip
    # what is left of a deviation after it was added to a target of some 50 um
    for name, value in by_loops(both[0].tolist(), both[1].tolist()).items():
        estimate = getattr(found, name)
        assert estimate.value == pytest.approx(value, rel=1e-6, abs=1e-19), name
        low, high = estimate.interval()
        assert low <= estimate.value <= high
        assert estimate.unit == "m"


def test_staircase_to_positioning() -> None:
    """A staircase run three times gives its targets from both sides, the ends from one only."""
    levels = np.array([0.0, 12e-6, 21e-6, 40e-6])
    once = np.concatenate((levels, levels[-2:0:-1]))
    command = np.repeat(np.concatenate((np.tile(once, 3), levels[:1])), 30)
    dwells = staircase_dwells(command)
    assert dwells is not None
    side = np.repeat(dwells.direction, 30)
    reading = command + 7e-9 * (side > 0) - 4e-9 * (side < 0) + 0.02 * (command - 20e-6) ** 2
    gone = dwells.approaches(reading)
    up, down, targets = gone.upward, gone.downward, gone.targets
    assert targets.tolist() == [1, 2]
    assert up.shape == down.shape == (2, 3)
    found = positioning(dwells.levels[targets], up, down, trials=20)
    assert found.mean_reversal.value == pytest.approx(11e-9, rel=1e-6)
    assert found.repeatability_upward.value == pytest.approx(0.0, abs=1e-18)
    bend = 0.02 * ((levels[1] - 20e-6) ** 2 - (levels[2] - 20e-6) ** 2)
    assert found.mean_deviation.value == pytest.approx(bend, rel=1e-6)


def test_settling_is_left_out() -> None:
    command = np.repeat([0.0, 1.0, 2.0, 1.0, 0.0], 40)
    dwells = staircase_dwells(command)
    assert dwells is not None
    reading = command + 0.3 * np.exp(-np.tile(np.arange(40.0), 5) / 1.5)
    late = dwells.means(reading, 0.5)
    assert late == pytest.approx([0.0, 1.0, 2.0, 1.0, 0.0], abs=1e-6)
    assert dwells.means(reading, 0.0)[0] > 0.01
    assert dwells.settled(200, 0.5).sum() == 100
    with pytest.raises(RecordError, match="below 1"):
        dwells.means(reading, 1.0)


def test_bad_input() -> None:
    target, good = np.array([0.0, 1.0]), np.ones((2, 3))
    with pytest.raises(RecordError, match="two targets and two runs"):
        positioning(target, good[:, :1], good[:, :1])
    with pytest.raises(RecordError, match="two targets and two runs"):
        positioning(target[:1], good[:1], good[:1])
    with pytest.raises(RecordError, match="as many runs"):
        positioning(target, good, good[:, :2])
    with pytest.raises(RecordError, match="each target"):
        positioning(target, good.T, good)
    with pytest.raises(RecordError, match="finite"):
        positioning(target, good * np.nan, good)
    with pytest.raises(RecordError, match="are equal"):
        positioning([1.0, 1.0], good, good)
    up_only = staircase_dwells(np.repeat([0.0, 1.0, 2.0], 20))
    assert up_only is not None
    with pytest.raises(RecordError, match="both from below and from above"):
        up_only.approaches(np.zeros(60))


def _coverage(repeats: int, spread_of_runs: float, runs: int) -> dict[str, float]:
    m = 11
    s = np.linspace(-1.0, 1.0, m)
    middle, reversal = 60e-9 * (s**2 + 0.3 * s), 30e-9 + 8e-9 * np.sin(3.0 * s)
    mean = np.array([middle + 0.5 * reversal, middle - 0.5 * reversal])
    sigma = np.full((2, m), 10e-9)
    truth = figures(mean, np.hypot(sigma, spread_of_runs))
    target = 9e-6 * np.arange(m)
    hits = dict.fromkeys(NAMES, 0)
    for i in range(repeats):
        rng = np.random.default_rng(np.random.SeedSequence(5, spawn_key=(i,)))
        x = mean[..., None] + sigma[..., None] * rng.standard_normal((2, m, runs))
        x = x + spread_of_runs * rng.standard_normal(runs) + target[:, None]
        found = positioning(target, x[0], x[1], trials=1000)
        for name in NAMES:
            hits[name] += getattr(found, name).covers(float(truth[name]))
    return {name: count / repeats for name, count in hits.items()}


@pytest.mark.parametrize("repeats", sizes(slow=150, evidence=600))
@pytest.mark.parametrize(("of_runs", "runs"), [(0.0, 5), (15e-9, 5), (0.0, 3)])
def test_intervals_cover(of_runs: float, runs: int, repeats: int) -> None:
    """Figures of means cover in 93 to 97 %; those with the largest spread in it may do so more
    often.

    The true spread of that target which happens to show the largest one is not known from n runs,
    so the interval of R and A takes both ends of what it may be.
    """
    share = _coverage(repeats, of_runs, runs)
    # 600 repetitions scatter by 0.9 % about 95 %
    low, high = limits(repeats, 0.925, 0.98, full=600)
    for name in NAMES:
        assert share[name] >= low, (name, share)
    if of_runs == 0.0:
        for name in ("mean_reversal", "systematic", "mean_deviation", "reversal"):
            assert share[name] <= high, (name, share)
