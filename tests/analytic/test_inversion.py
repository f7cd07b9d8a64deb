"""The inverse of a drive on the drive itself, its limits, and the figures of a loop."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.hysteresis import (
    MODELS,
    AsymmetricBoucWen,
    BoucWen,
    Dahl,
    Duhem,
    GeneralisedBoucWen,
    GeneralisedMaxwellSlip,
    ModifiedPrandtlIshlinskii,
    PrandtlIshlinskii,
    Preisach,
)
from flexstage.hysteresis.chain.creep import CreepSpectrum, LogCreep
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.drive_model import DriveModel, DriveState, ValidityRange
from flexstage.hysteresis.inversion import feedforward, smoothed
from flexstage.hysteresis.loops import loop_branches, loop_width, tracking
from flexstage.virtual.stack import virtual_stack
from tests.hysteresis_vectors import of_kind

LOW, HIGH = 4.0, 116.0
THRESHOLDS = np.array([5.0, 13.0, 29.0])
EACH = {
    **{kind: of_kind(kind)[0].model for kind in MODELS},
    "bouc-wen": BoucWen(gain=3.1e-7, hysteresis_gain=1.1e-7, beta=0.031, gamma=0.017),
    "asymmetric-bouc-wen": AsymmetricBoucWen(
        gain=3.1e-7, quadratic=2.1e-10, cubic=-1.3e-12, hysteresis_gain=1.1e-7, beta=0.031,
        gamma=0.017, lowest_input=0.0, highest_input=120.0,
    ),
    "generalised-bouc-wen": GeneralisedBoucWen(
        gain=3.4e-7, hysteresis_gain=1.0e-7, shape=(0.03, 0.002, 0.015, 0.001, -0.002, 0.0005),
        centre=57.0,
    ),
    "dahl": Dahl(gain=2.9e-7, stiffness=0.9e-7, limit=2.3e-6),
    "duhem": Duhem(
        rate=0.047, anhysteretic=np.array([0.0, 3.3e-7, 2.1e-10]), tangent=np.array([2.1e-7]),
        input_range=(0.0, 120.0),
    ),
    "prandtl-ishlinskii": PrandtlIshlinskii(
        gain=2.3e-7, thresholds=THRESHOLDS, weights=np.array([0.4e-7, 0.3e-7, 0.2e-7])
    ),
    "modified-prandtl-ishlinskii": ModifiedPrandtlIshlinskii(
        gain=2.3e-7, thresholds=THRESHOLDS, weights=np.array([0.4e-7, 0.3e-7, 0.2e-7]),
        dead_zones=np.array([9e-6, 21e-6]), dead_zone_weights=np.array([-0.05, -0.07]),
    ),
    "maxwell-slip": GeneralisedMaxwellSlip(
        stiffness=2.7e6, thresholds=np.array([1.1e-6, 3.7e-6]),
        element_stiffness=np.array([4.1e5, 2.3e5]), dead_zones=np.array([12e-6]),
        dead_zone_weights=np.array([1.9e5]),
    ),
    "preisach": Preisach(
        thresholds=np.array([0.0, 7.0, 19.0]), knots=np.array([0.0, 37.0, 81.0, 120.0]),
        slopes=np.array([[2.1e-7, 2.2e-7, 2.4e-7], [0.5e-7, 0.4e-7, 0.6e-7], [0.2e-7] * 3]),
    ),
}  # fmt: skip
CHAINS = {
    "no chain": {},
    "creep": {"creep": LogCreep(rate_per_decade=0.013)},
    "spectrum": {"creep": CreepSpectrum(times=(0.002, 0.3, 41.0), weights=(0.3, 0.04, 0.06))},
    "delay": {"lag": Lag(delay=0.0104)},
    "resonance": {"modes": StageModes(frequency_hz=(41.0,), damping_ratio=(0.023,), share=(1.0,))},
    "all": {
        "creep": LogCreep(rate_per_decade=0.013),
        "lag": Lag(delay=0.0104),
        "modes": StageModes(frequency_hz=(41.0,), damping_ratio=(0.023,), share=(1.0,)),
    },
}
DT = 0.002


def drive_of(kind, **more):
    """A drive that falls with its command, and reads something at rest."""
    return DriveModel(
        hysteresis=EACH[kind], offset=-7.3e-6, sign=-1.0,
        validity=ValidityRange(
            input_range=(LOW, HIGH), output_range=(-60e-6, 0.0), rate_range_hz=(0.4, 4.0)
        ),
        **more,
    )  # fmt: skip


def reference_within(drive, share=0.8, size=1500):
    """Smooth, of falling amplitude, standing still at both ends; inside what the drive reaches."""
    low, high = drive.hysteresis.simulate([HIGH, LOW, HIGH]).values[1:]
    t = np.arange(size) * DT
    s = np.sin(np.pi * np.clip((t - 0.3) / (t[-1] - 0.6), 0.0, 1.0))
    turns = np.sin(2.0 * np.pi * 1.7 * (t - 0.3))
    level = 0.5 + 0.5 * share * s**4 * turns
    return drive.offset + drive.sign * (low + level * (high - low))


def test_every_model_is_here():
    assert set(EACH) == set(MODELS)


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("kind", EACH)
def test_the_inverse_tracks_its_own_model(kind, chain):
    drive = drive_of(kind, **CHAINS[chain])
    wanted = reference_within(drive)
    made = feedforward(drive, wanted, DT, limits=(LOW - 4.0, HIGH + 4.0))
    assert made.limited == 0
    assert np.ptp(made.command) > 30.0
    # the prediction is made again, forwards, by the caller's means
    again, _ = drive.response(made.command, DT, made.before)
    assert np.array_equal(again, made.predicted)
    span = float(np.ptp(wanted))
    error = np.abs(again - made.reference).max() / span
    # The inverse is exact for hysteresis and creep. A delay is led by less than a sample, and a
    # resonance undone, by interpolation between the samples, which is what is left then.
    assert error < {"no chain": 1e-12, "creep": 1e-10}.get(chain, 3e-4)
    if chain in {"no chain", "creep", "delay"}:
        assert made.smoothing == 0.0
        assert np.array_equal(made.reference, wanted)
    else:
        assert made.smoothing == np.abs(made.reference - made.requested).max()
    # without an inverse the loop is open by some percent: the test would see it
    straight = (
        (wanted - drive.offset) / drive.sign / np.ptp(EACH[kind].simulate([HIGH, LOW]).values)
    )
    naive, _ = drive.response(LOW + straight * (HIGH - LOW), DT, made.before)
    assert np.abs(naive - wanted).max() / span > 0.02


@pytest.mark.parametrize("before", ["rested", 0.0, 20.0, math.inf])
@pytest.mark.parametrize("chain", ["creep", "spectrum"])
def test_creep_begins_as_the_drive_was_before(chain, before):
    drive = drive_of("preisach", **CHAINS[chain])
    wanted = reference_within(drive)
    limits = (LOW - 60.0, HIGH + 60.0)
    made = feedforward(drive, wanted, DT, limits=limits, after=drive.before(before))
    assert made.limited == 0
    again = drive.simulate(made.command, DT, start=before)
    assert np.abs(again - wanted).max() < 1e-9 * np.ptp(wanted)
    # a drive that says so itself needs no word
    own = feedforward(replace(drive, start=before), wanted, DT, limits=limits)
    assert np.array_equal(own.command, made.command)
    # another past asks for another command: the reference has its mean where it begins
    if before in {0.0, 20.0}:
        rested = feedforward(drive, wanted, DT, limits=limits)
        assert np.abs(rested.command - made.command).max() > 0.3


def test_a_drive_that_has_just_left_its_low_end_is_no_default():
    drive = drive_of("preisach", start=math.inf, **CHAINS["creep"])
    u = 60.0 - 50.0 * np.cos(2.0 * np.pi * np.arange(900) * DT)
    just_left, moved = drive.simulate(u, DT, start=0.0), drive.simulate(u, DT)
    low = replace(drive, start=0.0).simulate(u, DT)
    assert np.array_equal(just_left, low)
    assert np.abs(just_left - moved).max() > 0.01 * np.ptp(moved)


@pytest.mark.parametrize("kind", EACH)
def test_limits_hold_at_every_sample(kind):
    drive = drive_of(kind)
    wanted = reference_within(drive, 1.25)
    limits, slew = (9.0, 103.0), 700.0
    made = feedforward(drive, wanted, DT, limits=limits, largest_rate=slew)
    assert made.command.min() >= limits[0]
    assert made.command.max() <= limits[1]
    assert np.abs(np.diff(made.command)).max() <= slew * DT * (1.0 + 1e-12)
    assert made.limited > 0
    assert any("limits changed" in note for note in made.notes)
    free = feedforward(drive, wanted, DT, limits=limits)
    assert np.abs(np.diff(free.command)).max() > slew * DT
    assert free.command.min() >= limits[0]
    assert free.command.max() <= limits[1]
    endless = feedforward(drive, wanted, DT, limits=limits, largest_rate=math.inf)
    assert np.array_equal(endless.command, free.command)
    assert endless.notes == free.notes
    assert made.largest_error == np.abs(made.predicted - wanted).max()
    assert made.rms_error == pytest.approx(math.sqrt(np.mean((made.predicted - wanted) ** 2)))


@pytest.mark.parametrize("kind", EACH)
def test_what_the_memory_keeps_out_of_reach_is_cut_and_told(kind):
    """The ends that a model reaches depend on its memory: some samples are beyond them."""
    drive = drive_of(kind)
    wanted = reference_within(drive, 1.25)
    made = feedforward(drive, wanted, DT, limits=(0.0, 120.0))
    assert 30 < made.limited < 150
    assert 0.0 <= made.command.min() < 0.3
    assert made.command.max() == pytest.approx(120.0)
    assert f"limits changed {made.limited} of 1500 samples" in made.notes[0]
    # the samples that are not told are followed
    off = np.abs(made.predicted - wanted) > 1e-9 * np.ptp(wanted)
    assert off.sum() <= made.limited


def one_period(drive, share, size=250):
    """One period of 2 Hz, inside what the drive reaches by the share of it."""
    low, high = drive.hysteresis.simulate([HIGH, LOW, HIGH]).values[1:]
    turn = 2.0 * np.pi * np.arange(size) / size
    level = 0.5 - 0.5 * share * (np.cos(turn) + 0.1 * np.sin(3.0 * turn))
    return drive.offset + drive.sign * (low + level * (high - low))


@pytest.mark.parametrize("kind", EACH)
@pytest.mark.parametrize("chain", CHAINS)
def test_a_motion_that_repeats_is_followed_without_smoothing(kind, chain):
    drive = drive_of(kind, **CHAINS[chain])
    wanted = one_period(drive, 0.7)
    made = feedforward(drive, wanted, DT, periods=7, limits=(0.0, 120.0))
    assert made.limited == 0
    assert made.smoothing == 0.0
    # the modes swing at the beginning, by what the start lacks of the rate
    late = slice(-2 * wanted.size, -40)
    error = made.predicted[late] - np.tile(wanted, 7)[late]
    # a straight line between samples is not the sine that harmonics are undone for
    assert np.abs(error).max() < 1e-3 * np.ptp(wanted)
    np.testing.assert_array_equal(made.predicted, drive.response(made.command, DT, made.before)[0])


def test_harmonics_above_the_band_are_left_out_and_told():
    drive = drive_of("preisach", **CHAINS["resonance"])
    wanted = one_period(drive, 0.7)  # of 2 and 6 Hz
    made = feedforward(drive, wanted, DT, periods=2, band_hz=5.0)
    left = np.abs(np.fft.rfft(made.reference[: wanted.size] - wanted))
    assert np.flatnonzero(left > 1e-9 * left.max()).tolist() == [3]
    assert made.smoothing == pytest.approx(2.0 * left.max() / wanted.size, rel=1e-3)
    assert any("smoothed to a bandwidth of 5 Hz" in note for note in made.notes)


@pytest.mark.parametrize("kind", EACH)
@pytest.mark.parametrize("chain", CHAINS)
def test_an_endless_repetition_repeats(kind, chain):
    drive = drive_of(kind, **CHAINS[chain])
    wanted = one_period(drive, 0.7)
    made = feedforward(drive, wanted, DT, periods=0, limits=(0.0, 120.0))
    assert made.limited == 0
    np.testing.assert_allclose(made.predicted, wanted, rtol=0.0, atol=1e-8 * np.ptp(wanted))
    x = drive.hysteresis.simulate(np.tile(made.command, 30), made.before.hysteresis).values
    one, other = x[-500:-250], x[-250:]
    np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-8 * np.ptp(other))
    slow = feedforward(drive, wanted, DT, periods=0, limits=(0.0, 120.0), largest_rate=400.0)
    steps = np.diff(np.append(slow.command, slow.command[0]))
    assert np.abs(steps).max() <= 400.0 * DT * (1.0 + 1e-12)
    assert slow.limited > 0


@pytest.mark.parametrize("kind", EACH)
def test_limits_of_a_motion_that_repeats_hold(kind):
    """Also where what the ends reach depends on the memory, and after a stretch at an end."""
    drive = drive_of(kind)
    wanted = one_period(drive, 1.25)
    for periods in (0, 3):
        made = feedforward(drive, wanted, DT, periods=periods, limits=(0.0, 120.0))
        assert made.command.min() >= 0.0
        assert made.command.max() <= 120.0
        assert 0 < made.limited < made.command.size / 2
        assert f"limits changed {made.limited} of" in made.limit_note
        off = np.abs(made.predicted - made.requested) > 1e-8 * np.ptp(wanted)
        assert off.sum() <= made.limited


@pytest.mark.parametrize("kind", ["duhem", "asymmetric-bouc-wen"])
def test_the_nearest_input_of_an_output_out_of_reach(kind):
    model = EACH[kind]
    path = np.array([37.0, 91.0, 53.0, 108.0])
    wanted = model.simulate(path).values
    wanted[1] += 1e-3
    with pytest.raises(ModelError, match="at sample 1"):
        model.inverse(wanted)
    near = model.nearest(wanted)
    assert near.values[:2] == pytest.approx([37.0, 120.0])
    assert model.simulate(near.values[2:], model.simulate(near.values[:2]).state).values == (
        pytest.approx(wanted[2:], rel=1e-9)
    )


def test_limits_of_the_model_are_its_range():
    drive = drive_of("preisach")
    made = feedforward(drive, reference_within(drive, 1.2), DT)
    assert made.command.min() >= LOW
    assert made.command.max() <= HIGH
    assert np.ptp(made.command) == pytest.approx(HIGH - LOW, rel=1e-12)
    with pytest.raises(ModelError, match="limits of the command must rise"):
        feedforward(drive, reference_within(drive), DT, limits=(9.0, 9.0))
    beyond = feedforward(drive, reference_within(drive, 1.2), DT, limits=(0.0, 120.0))
    assert any("range of the identification, 4 to 116 V" in note for note in beyond.notes)


def test_a_reference_with_corners_is_smoothed_and_the_change_is_said():
    drive = drive_of("preisach", **CHAINS["resonance"])
    smooth = reference_within(drive)
    t = np.arange(smooth.size) * DT
    middle, half = 0.5 * (smooth.max() + smooth.min()), 0.3 * np.ptp(smooth)
    wanted = middle + half * (1.0 - 4.0 * np.abs((1.3 * t) % 1.0 - 0.5))
    made = feedforward(drive, wanted, DT)
    assert np.array_equal(made.reference, smoothed(wanted, DT, 41.0 / 4.0))
    assert made.smoothing == pytest.approx(np.abs(made.reference - wanted).max(), rel=1e-12)
    # a Gaussian of spread s takes slope * s * sqrt(2 / pi) off a corner of +-slope
    spread = math.sqrt(math.log(2.0)) / (2.0 * math.pi * 41.0 / 4.0)
    corner = 4.0 * 1.3 * half * spread * math.sqrt(2.0 / math.pi)
    assert made.smoothing == pytest.approx(corner, rel=0.02)
    assert any("smoothed to a bandwidth of 10.2 Hz" in note for note in made.notes)
    wide = feedforward(drive, wanted, DT, band_hz=33.0)
    assert wide.smoothing < 0.4 * made.smoothing


def test_out_of_reach_is_refused_with_the_range():
    drive = drive_of("dahl")
    with pytest.raises(ModelError, match=r"range of the drive, -60 to 0 um: shift the reference"):
        feedforward(drive, reference_within(drive) + 1e-3, DT)
    part = feedforward(drive, reference_within(drive) + 12e-6, DT)
    assert 0 < part.limited < part.command.size
    assert "with a command of 4 to 116 V the drive reaches -60 to 0 um" in part.limit_note
    # within narrower limits the range of the identification is out of reach as well
    within = drive.hysteresis.simulate([60.0, 0.0], drive.conditioned()).values
    ends = sorted(1e6 * (drive.offset + drive.sign * within))
    with pytest.raises(ModelError, match=rf"range of the drive, {ends[0]:.4g} to {ends[1]:.4g} um"):
        feedforward(drive, reference_within(drive) + 1e-3, DT, limits=(0.0, 60.0))


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"dt": 0.0}, "step between samples"),
        ({"dt": math.nan}, "step between samples"),
        ({"largest_rate": 0.0}, "largest rate"),
        ({"largest_rate": math.nan}, "largest rate"),
        ({"band_hz": 0.0}, "band"),
        ({"band_hz": math.inf}, "band"),
        ({"periods": -1}, "at least 1, or 0"),
        ({"periods": 2, "band_hz": -3.0}, "the band must be positive"),
        ({"band_hz": 1e-9}, "too low for a sequence of 3 s"),
        ({"limits": (math.nan, 5.0)}, "must rise"),
        ({"after": DriveState(hysteresis=np.ones(1))}, "a state of dahl"),
        ({"after": "rested"}, "rested is called rest"),
        ({"reference": [0.0, math.nan]}, "must be finite"),
        ({"reference": []}, "sequence of numbers"),
    ],
)
def test_bad_input_is_refused(more, said):
    drive = drive_of("dahl")
    given = {"reference": reference_within(drive), "dt": DT, **more}
    with pytest.raises(ModelError, match=said):
        feedforward(drive, given.pop("reference"), given.pop("dt"), **given)


def test_models_without_range_or_inverse_say_so():
    bare = DriveModel(hysteresis=EACH["dahl"])
    with pytest.raises(ModelError, match="validity range"):
        feedforward(bare, np.linspace(0.0, 1e-5, 9), DT)
    with pytest.raises(ModelError, match="limits of the command"):
        feedforward(bare, np.linspace(0.0, 1e-5, 9), DT, after="rest")
    stack = DriveModel(
        hysteresis=virtual_stack((0.0, 120.0), 38e-6, 0.11),
        validity=ValidityRange(
            input_range=(0.0, 120.0), output_range=(0.0, 3.8e-5), rate_range_hz=(1.0, 1.0)
        ),
    )
    with pytest.raises(ModelError, match="has no inverse"):
        feedforward(stack, np.linspace(1e-5, 2e-5, 40), DT)


@pytest.mark.parametrize("kind", EACH)
def test_the_conditioned_state_repeats(kind):
    drive = drive_of(kind)
    state = drive.conditioned()
    again = EACH[kind].simulate([HIGH, LOW], state)
    assert again.values[1] == pytest.approx(
        EACH[kind].simulate([HIGH, LOW], again.state).values[1], rel=1e-9
    )
    assert state[0] == LOW


def test_the_width_of_an_ellipse():
    n = 2000
    phase = 2.0 * np.pi * np.arange(3 * n + 1) / n
    a, b, lag = 3.7, 11.0, 0.21
    x, y = 2.0 - a * np.cos(phase), 5.0 - b * np.cos(phase - lag)
    bounds = np.arange(4) * n
    # the branches differ by 2 b sin(lag) sqrt(1 - ((x - 2) / a)^2), most at the middle
    assert loop_width(x, y, bounds) == pytest.approx(2.0 * b * math.sin(lag), rel=1e-5)
    levels, rising, falling = loop_branches(x, y, bounds)
    half = np.sqrt(np.maximum(1.0 - ((levels - 2.0) / a) ** 2, 0.0))
    assert np.abs(falling - rising - 2.0 * b * math.sin(lag) * half).max() < 2e-3 * b
    assert (levels[0], levels[-1]) == pytest.approx((2.0 - a, 2.0 + a))
    # a circle: as wide as it is high
    assert loop_width(x, a * np.sin(phase), bounds) == pytest.approx(2.0 * a, rel=1e-5)


def test_what_both_branches_share_is_no_width_but_an_error():
    n = 500
    phase = 2.0 * np.pi * np.arange(2 * n + 1) / n
    wanted = -3.0 * np.cos(phase)
    found = tracking(wanted, wanted + 0.4 + 0.1 * wanted, np.array([0, n, 2 * n]))
    assert found.loop_width < 1e-12
    assert found.largest == pytest.approx(0.7, rel=1e-12)
    # mean of (0.4 + 0.3 c)^2 = 0.16 + 0.045
    assert found.rms == pytest.approx(math.sqrt(0.205), rel=2e-3)


def test_cycles_that_have_nothing_in_common_are_refused():
    x = np.array([0.0, 1.0, 0.0, 1.0, 5.0, 4.0])
    with pytest.raises(ModelError, match="one whole cycle at least"):
        loop_width(x, x, [0])
    with pytest.raises(ModelError, match="no level in common"):
        loop_width(x, x, [0, 2, 5])


def test_smoothing_passes_the_band_at_half_power_and_keeps_a_line():
    t = np.arange(4000) * 1e-3
    for frequency_hz in (3.0, 8.0, 17.0):
        wave = np.sin(2.0 * np.pi * frequency_hz * t)
        passed = np.ptp(smoothed(wave, 1e-3, 8.0)[1500:2500]) / 2.0
        assert passed == pytest.approx(2.0 ** (-0.5 * (frequency_hz / 8.0) ** 2), rel=2e-3)
    line = 0.3 + 1.7 * t
    assert np.abs(smoothed(line, 1e-3, 8.0) - line)[500:-500].max() < 1e-12
