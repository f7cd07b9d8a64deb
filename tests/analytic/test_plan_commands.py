"""Commands of a plan against closed forms."""

import numpy as np
import pytest

from flexstage.base.errors import PlanError
from flexstage.experiments.axis_limits import AxisSetting
from flexstage.experiments.command import CommandWaveform, Strike
from flexstage.experiments.excitations import (
    BidirectionalTargets,
    Chirp,
    DescendingLoops,
    Designed,
    Dwell,
    EqualCycles,
    HammerImpacts,
    Multisine,
    RisingSteps,
    WorkspaceCorners,
)
from flexstage.experiments.verbs.excite import whole_part

X = AxisSetting(axis="x", quantity="voltage", low=-13.0, high=107.0, largest_rate=4e4,
                natural_frequency_hz=870.0)  # fmt: skip
Y = AxisSetting(axis="y", quantity="voltage", low=2.0, high=91.0, largest_rate=4e4)
SCREW = AxisSetting(axis="x", quantity="position", low=0.0, high=330e-6, largest_rate=0.29e-3,
                    smallest_step=0.47e-6)  # fmt: skip


def made(wanted, *settings: AxisSetting, rate: float = 1e3, **more) -> CommandWaveform:
    found = wanted.command({s.axis: s for s in settings or (X,)}, rate, **more)
    assert isinstance(found, CommandWaveform)
    return found


def test_a_triangle_has_two_slopes_and_meets_both_ends():
    found = made(EqualCycles(axis="x", rate=2.0, cycles=3, condition=2, low=0.1, high=0.9))
    v = found.waveform.values["x"]
    assert (v.min(), v.max()) == (pytest.approx(-1.0), pytest.approx(95.0))
    assert np.unique(np.round(np.abs(np.diff(v)) * 1e3, 6)) == pytest.approx([96.0 * 4.0])
    assert (found.first, found.period, v.size) == (1000, 500, 2501)
    assert v[0] == v[-1] == v.min()


def test_a_cosine_is_one():
    v = made(
        EqualCycles(axis="x", rate=1.0, cycles=1, condition=0, shape="cosine")
    ).waveform.values["x"]
    t = np.arange(1001) / 1e3
    # of rounding in the cosine and in the ends
    assert v == pytest.approx(47.0 - 60.0 * np.cos(2.0 * np.pi * t), abs=1e-12)


def test_steps_rest_at_both_ends_and_move_by_half_of_the_way_per_half_of_the_time():
    found = made(EqualCycles(axis="x", rate=2.0, cycles=2, condition=1, shape="steps", low=0.25))
    v = found.waveform.values["x"]
    assert (found.first, found.period, v.size) == (500, 500, 1501)
    assert (v[0], v[-1]) == (pytest.approx(17.0), pytest.approx(17.0))
    # a tenth of the half period, 25 samples, from -13 + 120/4 to 107 V
    assert v[500:751] == pytest.approx(np.append(v[500:526], np.full(225, 107.0)))
    assert v[750:776] == pytest.approx(124.0 - v[500:526])
    at = np.arange(13) / 25.0
    # a jerk of 32 over a quarter, and of -32 after it
    rise = np.where(at <= 0.25, 16.0 / 3.0 * at**3,
                    16.0 / 3.0 * (at**3 - 2.0 * np.maximum(at - 0.25, 0.0) ** 3))  # fmt: skip
    assert (v[500:513] - 17.0) / 90.0 == pytest.approx(rise, abs=1e-12)


def test_falling_cycles_end_at_the_share_that_was_asked_for():
    found = made(
        DescendingLoops(axis="x", rate=1.0, full=2, descending=4, smallest=0.2, condition=1)
    )
    v = found.waveform.values["x"]
    assert v.size == 7001
    assert np.ptp(v[1000:3001]) == pytest.approx(120.0)
    # at the end of the fall the swing is a fifth of the whole, at its low end
    assert v[-1] == pytest.approx(47.0 - 0.2 * 60.0)
    assert found.first == 1000


def test_a_multisine_has_its_lines_and_no_other():
    wanted = Multisine(axis="x", band=(97.0, 233.0), amplitude=1.3, period=0.5, periods=4, at=0.3)
    found = made(wanted, base_rate_hz=10e3)
    v, n = found.waveform.values["x"], found.period
    assert found.waveform.sample_rate_hz == pytest.approx(2500.0)
    assert found.first == n == 1250
    assert v.size == 5 * n + 1
    one = v[n : 2 * n]
    assert np.array_equal(one, v[3 * n : 4 * n])
    assert one.mean() == pytest.approx(X.place(0.3), abs=1e-9)
    assert np.max(np.abs(one - one.mean())) == pytest.approx(1.3)
    size = np.abs(np.fft.rfft(one - one.mean())) / n
    f = np.fft.rfftfreq(n, 1.0 / 2500.0)
    inside = (f >= 97.0) & (f <= 233.0)
    assert size[inside].min() > 0.9 * size[inside].max()
    assert size[~inside].max() < 1e-12


def test_a_small_sine_near_an_end_is_moved_inside():
    v = made(Multisine(axis="x", band=(97.0, 233.0), amplitude=1.3, at=0.0)).waveform.values["x"]
    assert v.min() >= X.low - 1e-12
    with pytest.raises(PlanError, match="exceeds the range"):
        made(Multisine(axis="x", band=(97.0, 233.0), amplitude=61.0))
    with pytest.raises(PlanError, match="needs an instrument with"):
        made(Multisine(axis="x", band=(97.0, 3600.0), amplitude=1.0), base_rate_hz=10e3)


def test_a_chirp_repeats_without_a_jump_and_covers_its_band():
    found = made(Chirp(axis="x", band=(83.0, 310.0), amplitude=0.7, period=1.0, periods=3),
                 base_rate_hz=10e3)  # fmt: skip
    v, n = found.waveform.values["x"], found.period
    fs = found.waveform.sample_rate_hz
    # no step is larger than the fastest sine makes, which scaling to whole cycles raises by < 1 %
    largest = 0.7 * 2.0 * np.pi * 310.0 / fs * 1.01
    assert np.max(np.abs(np.diff(v))) < largest
    size = np.abs(np.fft.rfft(v[:n] - v[:n].mean()))
    f = np.fft.rfftfreq(n, 1.0 / fs)
    power = np.cumsum(size**2) / np.sum(size**2)
    assert power[f <= 70.0][-1] < 0.01
    assert power[f <= 325.0][-1] > 0.98


def test_steps_rest_on_their_levels_and_keep_to_the_rate():
    found = made(RisingSteps(axis="x", levels=5, dwell=0.1, at=0.4, settle=0.3), SCREW, rate=500.0)
    v = found.waveform.values["x"]
    rests = [level for level in np.unique(v) if np.count_nonzero(v == level) >= 50]
    # of a screw: its smallest step
    assert np.diff(rests) == pytest.approx(0.47e-6 * np.ones(4), rel=1e-9)
    assert rests[0] == pytest.approx(0.4 * 330e-6)
    assert found.first == 150
    assert found.waveform.largest_rate("x") <= 0.29e-3
    with pytest.raises(PlanError, match="would end at"):
        made(RisingSteps(axis="x", advance=30e-6, levels=9, at=0.4), SCREW)
    with pytest.raises(PlanError, match="'step' in volts"):
        made(RisingSteps(axis="x"))


def test_targets_are_gone_to_from_both_sides_again_and_again():
    from flexstage.measure.motion.approaches import staircase_dwells

    found = made(
        BidirectionalTargets(axis="x", targets=6, rounds=3, dwell=0.2, low=0.1, high=0.9), SCREW
    )
    v = found.waveform.values["x"]
    gone = staircase_dwells(v).approaches(v)
    assert gone.upward.shape == gone.downward.shape == (6, 3)
    assert gone.upward[:, 0] == pytest.approx(np.linspace(0.1, 0.9, 6) * 330e-6)
    assert gone.targets.size == 6
    with pytest.raises(PlanError, match="commanded by voltage"):
        made(BidirectionalTargets(axis="x"))


def test_a_hold_rests_and_a_blow_has_no_samples():
    found = made(Dwell(axis="x", at=0.25, duration=1.5, settle=0.7))
    assert np.unique(found.waveform.values["x"]) == pytest.approx([17.0])
    assert (found.first, found.waveform.size) == (700, 2200)
    assert HammerImpacts(axis="y", impacts=3).command({}, 1e3) == Strike(axis="y", impacts=3)


def test_corners_are_gone_round_anticlockwise_and_numbered_where_both_axes_rest():
    found = made(WorkspaceCorners(rounds=3, dwell=0.1, travel=0.05, low=0.1, high=0.8), X, Y)
    x, y = found.waveform.values["x"], found.waveform.values["y"]
    assert found.corner is not None
    ends = {0: (0.1, 0.1), 1: (0.8, 0.1), 2: (0.8, 0.8), 3: (0.1, 0.8)}
    for k, (a, b) in ends.items():
        here = found.corner == k
        # half of each dwell, in three rounds and the one before
        assert np.count_nonzero(here) == 4 * 50
        assert np.unique(x[here]) == pytest.approx([X.place(a)])
        assert np.unique(y[here]) == pytest.approx([Y.place(b)])
    assert found.first == 4 * 150


def test_a_designed_record_is_that_of_the_identification_room():
    from flexstage.hysteresis import excitation

    found = made(Designed(axis="x", rates=(1.0, 8.0), hold_time=2.0, multisine=False))
    # a plan moves a real stage at its resonance only where it says so
    assert not Designed(axis="x").multisine
    own = excitation((-13.0, 107.0), sample_rate=1e3, rates=(1.0, 8.0), amplifier="slew=40 V/ms",
                     frequency=870.0, multisine=False, hold_time=2.0)  # fmt: skip
    assert np.array_equal(found.waveform.values["x"], own.voltage)
    with pytest.raises(PlanError, match="for a piezo stack"):
        made(Designed(axis="x"), SCREW)


def test_rates_are_whole_parts_of_the_highest():
    assert whole_part(3000.0, 10e3) == pytest.approx(10e3 / 3.0)
    assert whole_part(30e3, 10e3) == 10e3
    assert made(Dwell(axis="x"), rate=700.0).waveform.sample_rate_hz == pytest.approx(10e3 / 14.0)


def test_a_command_of_several_cycles_goes_on_without_a_jump():
    from dataclasses import replace

    one = made(EqualCycles(axis="x", rate=5.0, cycles=1, condition=0))
    values = {"x": one.waveform.values["x"][:-1]}
    found = replace(one, waveform=replace(one.waveform, values=values), cycles=3)
    time = np.array([-1.0, 0.0, 0.05, 0.1, 0.2, 0.2995, 0.5999, 7.0])
    got = found.at("x", time)
    low, high = -13.0, 107.0
    slope = (high - low) / 0.1
    assert got == pytest.approx(
        # after the end: the last sample
        [low, low, low + 0.05 * slope, high, low, high - 5e-4 * slope, low + 1e-3 * slope,
         low + 1e-3 * slope], rel=1e-9)  # fmt: skip
    assert found.duration == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (EqualCycles(axis="x", rate=200.0), "raise command_rate"),
        (EqualCycles(axis="x", rate=1e-3, cycles=9), "the limit is 5000000"),
        (RisingSteps(axis="x", step=1e-4, levels=1e5), "the limit is 5000000"),
    ],
)
def test_what_cannot_be_sampled_is_refused(wanted, words: str):
    with pytest.raises(PlanError, match=words):
        made(wanted)
