"""Cycles, curves over the stroke, and the figures that are taken from them.

Evidence (Measuring and centring): minimum zone (brute force): $10^{-12}$

Evidence (Coverage of 95 % intervals): ranges, loop, reversal, slope, drift of a curve (white;
correlated 0.5, 0.9; 5, 10 cycles), 500 repetitions: 92.5 to 97.5 % required, *simulated*

Evidence (Coverage of 95 % intervals): ranges, loop, slope, minimum zone, 150 repetitions: 90 to 99
% required, *simulated*
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.motion.approaches import staircase_dwells
from flexstage.measure.motion.curve_fit import fit_motion_curve
from flexstage.measure.motion.cycles import cycles_by_range, motion_cycles, spread_estimate
from flexstage.measure.motion.motion_curve import (
    CurveBasis,
    MotionCurve,
    curve_loop_width,
    curve_range,
    narrowest_strip,
    zone_contacts,
)
from flexstage.measure.motion.reach import stroke, workspace
from flexstage.quantities.estimate import Estimate
from flexstage.report.figures.motion_error import draw_motion_error, draw_workspace
from flexstage.report.figures.style import encode
from tests.tiers import limits, sizes


def triangle(cycles: float, per: int) -> tuple[Array, Array]:
    """Return time in cycles and a triangle from 0 to 1."""
    t = np.arange(round(cycles * per) + 1) / per
    return t, 1.0 - 2.0 * np.abs(t % 1.0 - 0.5)


def shape(s: Array) -> Array:
    """Return an error over the stroke, of a share s of it from -1 to 1 [m]."""
    return 60e-9 * s**2 + 8e-9 * s**3 - 10e-9 * s


def half_loop(s: Array) -> Array:
    """Return half of the width of a loop [m]."""
    return 12.5e-9 * (1.0 - s**2) * (1.0 + 0.4 * s)


def record(
    seed: int,
    *,
    count: int = 5,
    per: int = 400,
    size: float = 1.0,
    noise: float = 10e-9,
    offsets: float = 30e-9,
    drift: float = 5e-9,
    memory: float = 0.0,
) -> tuple[Array, Array, Array]:
    """Return position, reading and time of cycles with offsets, drift and noise."""
    rng = np.random.default_rng(np.random.SeedSequence(11, spawn_key=(seed,)))
    t, x = triangle(count, per)
    s = 2.0 * x - 1.0
    back = t % 1.0 >= 0.5
    white = rng.standard_normal(t.size + 200)
    shaped = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white)
    error = np.asarray(shaped, dtype=np.float64)[200:]
    of_cycle = offsets * rng.standard_normal(count + 1)[t.astype(int)]
    y = size * (shape(s) + np.where(back, half_loop(s), -half_loop(s)))
    time = 4.0 * t
    return 100e-6 * x, y + of_cycle + drift * time + noise * error, time


def truths() -> dict[str, float]:
    """Return the figures of the curve behind `record`."""
    s = np.linspace(-1.0, 1.0, 4001)
    y = shape(s)
    # s^2 has the mean 1/3, and 3/5 s is the line through s^3
    line = (8e-9 * 0.6 - 10e-9, 60e-9 / 3.0)
    return {
        "range": float(np.ptp(y)),
        "least_squares": float(np.ptp(y - np.polyval(line, s))),
        "terminal": float(np.ptp(y - np.interp(s, [-1.0, 1.0], y[[0, -1]]))),
        "zone": zone_contacts(s[::10], y[::10])[0],
        "loop": float(2.0 * half_loop(s).max()),
        # the mean of 1 - s^2 is 2/3, and that of its odd part 0
        "reversal": -25e-9 * 2.0 / 3.0,
        "slope": line[0] / 50e-6,
        "drift": 5e-9,
    }


def estimates(curve: MotionCurve) -> dict[str, Estimate]:
    assert curve.drift_rate is not None
    return {
        "range": curve_range(curve),
        "least_squares": curve_range(curve, line="least_squares"),
        "terminal": curve_range(curve, line="terminal"),
        "loop": curve_loop_width(curve),
        "reversal": curve.reversal(),
        "slope": curve.slope(),
        "drift": curve.drift_rate,
    }


# cycles


@pytest.mark.parametrize("noise", [0.0, 1e-3, 1e-2])
def test_cycles_of_a_triangle(noise: float) -> None:
    t, x = triangle(5.3, 1000)
    x = x + noise * np.random.default_rng(3).standard_normal(t.size)
    found = motion_cycles(x)
    assert found.count == 5
    reach = 2 + 1000 * noise
    assert np.abs(found.runs[:, 0, 1] - (500 + 1000 * np.arange(5))).max() <= reach
    assert found.outside == pytest.approx(301, abs=2 * reach)
    assert str(found.outside) in found.notes[0]
    assert np.array_equal(found.runs[:, 0, 1], found.runs[:, 1, 0])
    directions = found.directions()
    assert (directions == 0).sum() == found.outside
    assert directions[100] == 1
    assert directions[700] == -1


def test_cycles_that_begin_high() -> None:
    """Where one more cycle can be had from high to high, the backward run comes first."""
    _, x = triangle(3.0, 200)
    found = motion_cycles(x[100:501])
    assert found.count == 2
    assert found.runs[0].tolist() == [[100, 200], [0, 100]]


def test_staircase_shares_its_last_level_between_the_runs() -> None:
    command = np.repeat([0.0, 1.0, 2.0, 3.0, 2.0, 1.0] * 3 + [0.0], 20)
    found = motion_cycles(command)
    assert found.count == 3
    top = found.runs[0, 0, 1]
    assert 60 < top < 80
    assert abs(top - 70) <= 1


def test_smaller_cycles_are_left_out() -> None:
    _, x = triangle(2.0, 300)
    small = 0.4 * triangle(2.0, 300)[1]
    found = motion_cycles(np.concatenate((x, small[1:], x[1:])))
    assert found.count == 4
    inner = np.concatenate((x[:100], x[100:40:-1], x[40:]))
    with pytest.raises(RecordError, match=r"got 1"):
        motion_cycles(inner)


def test_cycles_are_grouped_by_both_ends() -> None:
    """Also where no end of one range is near one of the next, and one is a cycle too short."""
    t = np.arange(1500) / 500.0
    rng = np.random.default_rng(7)
    x = np.concatenate([size * np.sin(2.0 * np.pi * t) for size in (50.0, 47.0, 30.0)])
    groups = cycles_by_range(x + 5e-3 * rng.standard_normal(x.size), unit="V")
    assert [(g.count, round(g.high)) for g in groups] == [(2, 50), (2, 47), (2, 30)]
    assert "2 cycles from -47 to 47 V" in groups[0].notes[0]
    # ends that wander by less than a hundredth belong together, however many there are
    same = np.concatenate([size * np.sin(2.0 * np.pi * t) for size in (50.0, 50.4, 50.8)])
    assert [g.count for g in cycles_by_range(same)] == [8]
    overshoot = np.concatenate((58.0 * np.sin(2.0 * np.pi * t[:500]), x[:1500]))
    found = motion_cycles(overshoot)
    assert (found.count, round(found.high)) == (2, 50)
    with pytest.raises(RecordError, match="got 1"):
        motion_cycles(np.concatenate((130.0 * np.sin(2.0 * np.pi * t[:750]), x[:1500])))


def test_cycles_refused() -> None:
    with pytest.raises(RecordError, match="command is constant"):
        motion_cycles(np.full(50, 3.0))
    with pytest.raises(RecordError, match="finite"):
        motion_cycles([0.0, np.nan] * 10)
    with pytest.raises(RecordError, match=r"2 whole cycles .* got 1"):
        motion_cycles(triangle(1.2, 100)[1])
    assert staircase_dwells(triangle(3.0, 100)[1]) is None


def test_a_rest_that_goes_on_keeps_its_direction() -> None:
    command = np.repeat([0.0, 1.0, 2.0, 1.0, 0.0], 20)
    command[48] += 0.4
    found = staircase_dwells(command)
    assert found is not None
    assert found.target.tolist() == [0, 1, 2, 2, 1, 0]
    assert found.direction.tolist() == [0, 1, 1, 1, -1, -1]


# curves


def test_curve_without_noise_is_exact() -> None:
    x, y, t = record(0, noise=0.0, offsets=0.0)
    curve = fit_motion_curve(x, y, t)
    truth = truths()
    for name, found in estimates(curve).items():
        # a grid of 401 points stands for integrals: 1 / 400^2, of terms that cancel to half
        assert found.value == pytest.approx(truth[name], rel=5e-5), name
    s = np.array([-0.7, 0.1, 0.9])
    position = 50e-6 * (1.0 + s)
    level = curve.value(position)[0] - shape(s)[0]
    assert curve.value(position) - level == pytest.approx(shape(s), abs=1e-14)
    width = curve.value(position, "backward") - curve.value(position, "forward")
    assert width == pytest.approx(2.0 * half_loop(s), abs=1e-14)
    zone = curve_range(curve, line="minimum_zone")
    assert zone.value == pytest.approx(truth["zone"], rel=2e-4)


def test_offsets_of_cycles_do_not_reach_the_shape() -> None:
    """An offset of each cycle leaves the shape of the mean curve, and its uncertainty, alone.

    It does not leave the drift alone, which is found from the levels of the cycles: without a drift
    in the fit the shape is the same to rounding.
    """
    x, y, t = record(3, offsets=0.0, drift=0.0)
    runs = motion_cycles(x)
    shifted = y.copy()
    for c, cycle in enumerate(runs.runs):
        shifted[cycle[0, 0] : cycle[1, 1]] += 1e-6 * (c - 1.7) ** 2
    one, two = (fit_motion_curve(x, v, t, drift=False, order=4) for v in (y, shifted))
    for figure in (curve_range, curve_loop_width, MotionCurve.reversal, MotionCurve.slope):
        a, b = figure(one), figure(two)
        assert b.value == pytest.approx(a.value, rel=1e-6), figure.__name__
        assert b.uncertainty == pytest.approx(a.uncertainty, rel=1e-6), figure.__name__
        assert a.degrees_of_freedom == pytest.approx(4.0)


def test_drift_is_taken_off() -> None:
    """A drift a thousand times the usual one changes no figure but its own rate."""
    x, y, t = record(4)
    one = fit_motion_curve(x, y, t, order=5)
    two = fit_motion_curve(x, y + 5e-6 * t, t, order=5)
    for figure in (curve_range, curve_loop_width, MotionCurve.reversal):
        assert figure(two).value == pytest.approx(figure(one).value, abs=1e-13)
    assert one.noise == pytest.approx(10e-9, rel=0.05)
    assert two.noise == pytest.approx(one.noise, rel=1e-6)
    assert one.drift_rate is not None
    assert two.drift_rate is not None
    assert two.drift_rate.value - one.drift_rate.value == pytest.approx(5e-6, rel=1e-9)
    without = fit_motion_curve(x, y + 5e-6 * t, t, order=5, drift=False)
    assert curve_loop_width(without).value > 1e-6
    assert without.drift_rate is None


def test_functional_is_linear() -> None:
    curve = fit_motion_curve(*record(5))
    at = np.array([10e-6, 37e-6, 92e-6])
    weights = np.array([0.3, -1.7, 1.4])
    found = curve.functional(weights, at, "forward")
    assert found.value == pytest.approx(float(weights @ curve.value(at, "forward")), rel=1e-12)
    each = curve.each_cycle(weights @ curve.rows(at, "forward"))
    assert each.mean() == pytest.approx(found.value, rel=1e-9)
    part = found.components[0]
    assert part.uncertainty == pytest.approx(each.std(ddof=1) / np.sqrt(each.size), rel=1e-9)
    assert part.degrees_of_freedom == 4


def test_level_loses_two_degrees_of_freedom() -> None:
    curve = fit_motion_curve(*record(6))
    level = curve.functional([1.0], [50e-6])
    assert level.components[0].degrees_of_freedom == 3
    assert level.components[0].uncertainty > 5e-9
    assert curve.functional([1.0, -1.0], [50e-6, 20e-6]).components[0].uncertainty < 5e-9


def test_order_follows_the_curve() -> None:
    """A wavy curve takes more terms than a straight one; none is followed beyond the bound."""
    x, y, t = record(7, size=0.0)
    s = x / 50e-6 - 1.0
    straight = fit_motion_curve(x, y, t)
    wavy = fit_motion_curve(x, y + 200e-9 * np.cos(6.0 * s + 0.4), t)
    # terms that drown in the noise are fitted too, up to an order that guides have
    assert straight.basis.order == 6
    assert wavy.basis.order >= 8
    assert curve_range(wavy).covers(400e-9)
    sharp = fit_motion_curve(x, y + 2e-6 * np.sign(s - 0.23), t)
    assert sharp.basis.order == 12
    assert sharp.model_error > 100e-9
    assert any("upper limit" in note for note in sharp.notes)
    assert any("common to all cycles" in note for note in sharp.notes)
    names = [part.name for part in curve_range(sharp).components]
    assert names == ["repeatability", "drift", "shape"]


def test_staircase_curve_goes_through_the_levels() -> None:
    levels = np.array([0.0, 13e-6, 29e-6, 50e-6])
    once = np.concatenate((levels, levels[-2:0:-1]))
    command = np.repeat(np.concatenate((np.tile(once, 4), levels[:1])), 25)
    t = np.arange(command.size) / 50.0
    rng = np.random.default_rng(8)
    settling = 5e-6 * np.exp(-np.tile(np.arange(25.0), command.size // 25) / 0.6)
    error = np.interp(command, levels, [0.0, 90e-9, -40e-9, 25e-9])
    y = command + error + settling + 1e-9 * rng.standard_normal(t.size)
    curve = fit_motion_curve(command, y, t)
    assert curve.basis.knots is not None
    assert np.allclose(curve.basis.knots, levels)
    assert curve.value(levels) - curve.value(levels[:1]) == pytest.approx(
        levels + np.array([0.0, 90e-9, -40e-9, 25e-9]), abs=2e-9
    )
    found = stroke(command, y, t)
    assert found.stroke.covers(50e-6 + 25e-9)
    assert found.stroke.uncertainty < 1e-9


def test_few_stations() -> None:
    """Eleven stations in a run, one reading at each, as a measuring machine gives them."""
    share = np.linspace(0.0, 1.0, 11)
    once = np.concatenate((share, share[-2:0:-1]))
    command = np.concatenate((np.tile(once, 5), share[:1]))
    rng = np.random.default_rng(21)
    along = 90e-6 * command + 30e-9 * rng.standard_normal(command.size)
    across = shape(2.0 * command - 1.0) + 1e-9 * rng.standard_normal(command.size)
    curve = fit_motion_curve(
        along, across, np.arange(command.size) + 0.0, cycles=motion_cycles(command)
    )
    assert curve.basis.order <= 4
    assert curve.basis.low == pytest.approx(0.0, abs=1e-7)
    assert curve.basis.high == pytest.approx(90e-6, abs=1e-7)
    found = curve_range(curve, line="least_squares")
    assert found.covers(truths()["least_squares"])
    assert found.uncertainty < 2e-9
    # the station at which the stage turns belongs to both runs
    top = np.where(command == 1.0, 10e-9, 0.0)
    time = np.arange(command.size) + 0.0
    raised = fit_motion_curve(along, across + top, time, cycles=motion_cycles(command), order=4)
    plain = fit_motion_curve(along, across, time, cycles=motion_cycles(command), order=4)
    for direction in ("forward", "backward"):
        change = raised.value([90e-6], direction) - plain.value([90e-6], direction)
        assert change[0] > 5e-9


def test_measured_position_of_a_staircase() -> None:
    """Rests of a measured position differ between the runs by the loop: no levels, but a curve."""
    levels = np.linspace(0.0, 1.0, 9)
    once = np.concatenate((levels, levels[-2:0:-1]))
    command = np.repeat(np.concatenate((np.tile(once, 4), levels[:1])), 40)
    side = np.sign(np.gradient(np.convolve(command, np.ones(41) / 41, mode="same")))
    along = 50e-6 * (command + 0.05 * command * (1.0 - command) * -side)
    curve = fit_motion_curve(
        along, 2e-3 * along, np.arange(command.size) / 100.0, cycles=motion_cycles(command)
    )
    assert curve.basis.knots is None
    assert curve.slope().value == pytest.approx(2e-3, rel=1e-6)


def test_curve_refused() -> None:
    x, y, t = record(1)
    with pytest.raises(RecordError, match="one length"):
        fit_motion_curve(x, y[:-1], t)
    with pytest.raises(RecordError, match="reading must be finite, got nan at sample 7"):
        fit_motion_curve(x, np.where(np.arange(t.size) == 7, np.nan, y), t)
    with pytest.raises(RecordError, match="rise"):
        fit_motion_curve(x, y, t[::-1])
    with pytest.raises(RecordError, match=r"3 whole cycles .* without drift"):
        fit_motion_curve(*record(1, count=2))
    assert fit_motion_curve(*record(1, count=2), drift=False).cycles == 2
    with pytest.raises(RecordError, match="too few"):
        fit_motion_curve(*record(1, per=20), order=12)
    with pytest.raises(RecordError, match="2001 samples"):
        fit_motion_curve(x[:-3], y[:-3], t[:-3], cycles=motion_cycles(x))
    curve = fit_motion_curve(x, y, t)
    with pytest.raises(ModelError, match="known from"):
        curve.value([120e-6])
    with pytest.raises(ModelError, match="direction"):
        curve.value([1e-6], "sideways")  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="line"):
        curve_range(curve, line="crooked")  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="range of positions"):
        CurveBasis(low=1.0, high=1.0, order=2)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 9999), count=st.integers(3, 30), slope=st.floats(-3.0, 3.0),
    rows=st.integers(1, 2),
)  # fmt: skip
def test_zone_equals_every_pair_of_lines(seed: int, count: int, slope: float, rows: int) -> None:
    """The narrowest zone is that of a search over all lines through two points."""
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.uniform(0.2, 1.0, count))
    y = rng.standard_normal((rows, count)) + slope * x
    width, weights = zone_contacts(x, y)
    px, py = np.tile(x, rows), y.ravel()
    best = np.inf
    for i in range(px.size):
        for j in range(i):
            if px[i] != px[j]:
                best = min(best, np.ptp(py - (py[i] - py[j]) / (px[i] - px[j]) * px))
    assert width == pytest.approx(best, abs=1e-12)
    assert float(np.sum(weights * y)) == pytest.approx(width, abs=1e-12)
    # no straight line changes the width
    assert float(np.sum(weights)) == pytest.approx(0.0, abs=1e-12)
    assert float(np.sum(weights * x)) == pytest.approx(0.0, abs=1e-10)


@pytest.mark.parametrize("tilt", [0.0, 40.0])
def test_zones_of_points_on_a_grid_and_on_a_line(tilt: float) -> None:
    # many points one over the other, and three on one edge
    x = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 2.0, 4.0])
    y = np.array([0.0, 1.0, 1.5, 0.5, -0.25, 0.0, 1.75, 0.0]) + tilt * x
    upper = max(np.interp(t, [0, 2, 4], [1, 1.75, 0]) - np.interp(t, [0, 1, 4], [0, -0.25, 0])
                for t in (0.0, 1.0, 2.0, 4.0))  # fmt: skip
    assert zone_contacts(x, y)[0] == pytest.approx(upper, rel=1e-12)
    line = np.linspace(0.0, 2.3, 7)
    assert zone_contacts(line, 0.7 * line + tilt)[0] == pytest.approx(0.0, abs=1e-13)


# stroke, linearity, coupling


def test_stroke_tells_hysteresis_from_drift() -> None:
    x, y, t = record(9, offsets=3e-9, drift=40e-9)
    found = stroke(x, 0.6 * x + 4.0 * y, t)
    ends = 0.6 * 100e-6 + 4.0 * (shape(np.array([1.0])) - shape(np.array([-1.0])))[0]
    assert found.stroke.covers(ends)
    assert found.loop_width.covers(4.0 * truths()["loop"])
    assert found.drift_rate is not None
    assert found.drift_rate.covers(160e-9)
    assert found.of_cycles.mean() == pytest.approx(found.stroke.value, rel=1e-12)
    assert found.repeatability.value == pytest.approx(found.of_cycles.std(ddof=1))
    assert found.gain.unit == "1"
    assert found.gain.value == pytest.approx(0.6, abs=1e-3)


def test_end_repeatability_shows_a_stroke_that_wanders() -> None:
    t, x = triangle(6.0, 200)
    top = 1.0 + 1e-3 * np.array([0.3, -1.1, 0.8, 0.2, -0.9, 0.7])[np.minimum(t.astype(int), 5)]
    found = stroke(x, 50e-6 * x * top, 2.0 * t, drift=False)
    low, high = found.end_repeatability
    assert low.value < 1e-12
    expected = 50e-9 * np.std([0.3, -1.1, 0.8, 0.2, -0.9, 0.7], ddof=1)
    assert high.value == pytest.approx(expected, rel=1e-3)
    assert found.repeatability.value == pytest.approx(expected, rel=1e-3)


def test_strip_of_many_points_is_the_narrowest() -> None:
    random = np.random.default_rng(3)
    x = np.sort(random.uniform(0.0, 1.0, 60_000))
    y = 0.3 * np.sin(7.3 * x) + 0.02 * random.normal(size=x.size)
    first, second, third = narrowest_strip(x, y)
    slope = (y[second] - y[first]) / (x[second] - x[first])
    width = np.ptp(y - slope * x)
    height = y[third] - y[first] - slope * (x[third] - x[first])
    assert abs(height) == pytest.approx(width, rel=1e-12)
    # a convex function of the slope that grows on both sides is least
    assert np.ptp(y - (slope + 1e-6) * x) > width
    assert np.ptp(y - (slope - 1e-6) * x) > width


def test_range_of_a_parabola_about_a_line() -> None:
    """Of y = a x + b x^2 over L, from one side to the other of any line of its slope: b L^2/4."""
    t, x = triangle(4.0, 250)
    slope, bend, length = 0.31e-6, 2.3e-10, 120.0
    curve = fit_motion_curve(length * x, slope * length * x + bend * (length * x) ** 2, t,
                             position_unit="V")  # fmt: skip
    # a grid of 401 points stands for the integrals
    for line in ("terminal", "least_squares", "minimum_zone"):
        found = curve_range(curve, line=line)  # type: ignore[arg-type]
        near = 1e-6 if line == "terminal" else 2e-4
        assert found.value == pytest.approx(0.25 * bend * length**2, rel=near), line
    with pytest.raises(ModelError, match="line"):
        curve_range(curve, line="best")  # type: ignore[arg-type]


def test_spread() -> None:
    with pytest.raises(RecordError, match="two finite values"):
        spread_estimate([1.0], unit="m")
    rng = np.random.default_rng(1)
    hits = sum(spread_estimate(rng.normal(3.0, 0.4, 5), unit="m").covers(0.4) for _ in range(600))
    assert 0.93 <= hits / 600 <= 0.97


# workspace


def sheared(corner_noise: float = 0.0, rounds: int = 3, seed: int = 0) -> Array:
    x, y, lean = 63e-6, 57e-6, 1.5e-3
    base = np.array([[0.0, 0.0], [x, 0.0], [x + lean * y, y], [lean * y, y]])
    rng = np.random.default_rng(np.random.SeedSequence(2, spawn_key=(seed,)))
    return base + corner_noise * rng.standard_normal((rounds, 4, 2))


def test_workspace_of_a_parallelogram() -> None:
    found = workspace(sheared())
    assert found.area.value == pytest.approx(63e-6 * 57e-6, rel=1e-12)
    assert found.area.unit == "m^2"
    assert found.squareness.value == pytest.approx(-np.arctan(1.5e-3), rel=1e-9)
    assert found.stroke_x[1].value == pytest.approx(63e-6, rel=1e-12)
    assert found.stroke_y[0].value == pytest.approx(57e-6 * np.hypot(1.0, 1.5e-3), rel=1e-12)
    assert found.diagonals[0].value == pytest.approx(np.hypot(63e-6 + 1.5e-3 * 57e-6, 57e-6))
    assert found.diagonals[1].value == pytest.approx(np.hypot(63e-6 - 1.5e-3 * 57e-6, 57e-6))


def test_uncertainty_of_a_workspace_by_hand() -> None:
    """Corner noise s: the area moves by half the diagonals, each corner by each coordinate."""
    s, rounds = 20e-9, 400
    found = workspace(sheared(s, rounds))
    d = [e.value for e in found.diagonals]
    area = 0.5 * s * np.sqrt(2.0 * d[0] ** 2 + 2.0 * d[1] ** 2) / np.sqrt(rounds)
    assert found.area.uncertainty == pytest.approx(area, rel=0.1)
    assert found.stroke_x[0].uncertainty == pytest.approx(s * np.sqrt(2.0 / rounds), rel=0.1)
    assert found.repeatability.covers(s)
    assert found.area.components[0].degrees_of_freedom == rounds - 1


def test_workspace_refused() -> None:
    good = sheared()
    for bad, message in (
        (good[:1], "two rounds"),
        (good[:, ::-1], "counterclockwise"),
        (good * np.nan, "finite"),
        (np.concatenate((good, good[:, :1]), axis=1), "four corners"),
    ):
        with pytest.raises(RecordError, match=message):
            workspace(bad)


# figures


def test_figures_are_drawn() -> None:
    curve = fit_motion_curve(*record(5))
    figure = draw_motion_error(curve, title="Straightness", position_label="x", label="error")
    axes = figure.axes[0]
    assert [line.get_label() for line in axes.get_lines()] == ["forward", "backward"]
    assert axes.get_xlabel() == "x [µm]"
    assert axes.get_ylabel() == "error [nm]"
    assert np.ptp(axes.get_lines()[0].get_ydata()) == pytest.approx(
        1e9 * curve_range(curve, "forward", line="none").value, rel=0.6
    )
    assert encode(figure, "png")[:4] == b"\x89PNG"
    flat = draw_motion_error(curve, line="none")
    assert flat.axes[0].get_title(loc="left") == ""
    found = workspace(sheared(10e-9))
    drawn = draw_workspace(found).axes[0]
    assert drawn.get_xlabel() == "x [µm]"
    assert any("63" in text.get_text() for text in drawn.texts)
    assert encode(draw_workspace(found, title="reached"), "svg").startswith(b"<?xml")


# coverage


def test_coverage_of_linear_figures() -> None:
    """The interval of a mean of five cycles holds the truth as often as it says."""
    truth = truths()
    hits = {"reversal": 0, "slope": 0, "drift": 0}
    cycles = motion_cycles(record(0, per=60)[0])
    for i in range(150):
        curve = fit_motion_curve(*record(i, per=60), cycles=cycles, order=4)
        assert curve.drift_rate is not None
        found = {"reversal": curve.reversal(), "slope": curve.slope(), "drift": curve.drift_rate}
        for name, estimate in found.items():
            hits[name] += estimate.covers(truth[name])
    for name, count in hits.items():
        # 150 repetitions scatter by 1.8 % about 95 %
        assert 0.92 <= count / 150 <= 0.98, (name, count)


@pytest.mark.parametrize(("repeats", "zones"), sizes(slow=(150, 45), evidence=(500, 150)))
@pytest.mark.parametrize(
    ("count", "memory"), [(5, 0.0), (5, 0.9), (10, 0.5)], ids=["white", "correlated", "ten"]
)
def test_coverage_of_all_figures(count: int, memory: float, repeats: int, zones: int) -> None:
    truth = truths()
    hits = dict.fromkeys(truth, 0)
    for i in range(repeats):
        curve = fit_motion_curve(*record(i, count=count, memory=memory))
        found = estimates(curve)
        if i < zones:
            found["zone"] = curve_range(curve, line="minimum_zone")
        for name, estimate in found.items():
            hits[name] += estimate.covers(truth[name])
    for name, hit in hits.items():
        share = hit / (zones if name == "zone" else repeats)
        # 500 repetitions scatter by 1 % about 95 %, 150 by 1.8 %
        low, high = (
            limits(zones, 0.90, 0.99, full=150)
            if name == "zone"
            else limits(repeats, 0.925, 0.975, full=500)
        )
        assert low <= share <= high, (name, share)


def test_range_of_nothing_is_compatible_with_nothing() -> None:
    """Where there is only noise, the interval of a range begins at 0 nineteen times in twenty."""
    hits, values = 0, []
    cycles = motion_cycles(record(0, per=100)[0])
    for i in range(75):
        curve = fit_motion_curve(*record(i, size=0.0, per=100), cycles=cycles, order=4)
        found = curve_range(curve, line="least_squares")
        hits += found.covers(0.0)
        assert found.interval()[0] >= 0.0
        values.append(found.value)
    assert hits >= 70
    # what noise adds is mostly taken off: the range itself is some 4 nm
    assert np.mean(values) < 2.5e-9


def test_a_turn_that_is_read_twice_gives_each_run_one() -> None:
    """Cycles that shared a reading would not be independent, and their scatter too small."""
    share = np.linspace(0.0, 1.0, 13)
    command = np.tile(np.concatenate((share, share[::-1])), 6)
    found = motion_cycles(command)
    assert found.runs[1].tolist() == [[26, 39], [39, 52]]
    rng = np.random.default_rng(3)
    found_values, variances = [], []
    for _ in range(150):
        noise = rng.standard_normal(command.size)
        curve = fit_motion_curve(
            command, noise, np.arange(command.size) + 0.0, cycles=found, order=3, drift=False
        )
        # the lower end leans on the readings there most
        end = curve.functional([1.0, -1.0], [0.0, 0.5])
        found_values.append(end.value)
        variances.append(end.uncertainty**2)
    # 150 draws of each: the ratio is known to 12 %
    assert np.var(found_values) == pytest.approx(np.mean(variances), rel=0.25)


@pytest.mark.parametrize("twice", [False, True])
def test_a_curve_is_the_same_wherever_positions_are_counted_from(twice: bool) -> None:
    share = np.linspace(0.0, 1.0, 13)
    command = np.tile(np.concatenate((share, share[::-1] if twice else share[-2:0:-1])), 4)
    noise = np.random.default_rng(8).standard_normal(command.size)
    time = np.arange(command.size) + 0.0
    here, there = (
        fit_motion_curve(command + origin, noise, time, cycles=motion_cycles(command), order=3)
        for origin in (0.0, 7.0)
    )
    for direction in ("forward", "backward"):
        at = np.array([0.1, 0.5, 0.93])
        assert there.value(at + 7.0, direction) == pytest.approx(
            here.value(at, direction), abs=1e-9
        )
