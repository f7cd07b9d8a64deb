"""What no model of a drive explains is found, named and placed; clean records show nothing."""

import functools
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from flexstage.base.errors import RecordError
from flexstage.hysteresis import Dahl, PrandtlIshlinskii
from flexstage.hysteresis.chain.creep import CreepSpectrum, LogCreep
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.identification.baseline_shift import baseline_shifts
from flexstage.hysteresis.identification.cycles import cycles
from flexstage.hysteresis.identification.faults import butterfly, range_end, without_spikes
from flexstage.hysteresis.identification.fit_rows import ChainValues
from flexstage.hysteresis.identification.identify import identify
from flexstage.hysteresis.identification.measurement import measurement
from flexstage.hysteresis.identification.model_fit import fit_data
from flexstage.hysteresis.identification.quality_report import misrecorded
from flexstage.records import Channel, Record
from flexstage.virtual.stack import virtual_stack

DT = 0.005
CHAIN = ChainValues(creep_per_decade=0.013)
NOISE = 0.04
#: Its output stands still behind every turning point, over 26 V.
BACKLASH = PrandtlIshlinskii(gain=0.02, thresholds=np.array([13.0]), weights=np.array([0.3]))


def drive(size=6000, rate_hz=1.3):
    """Cycles of falling amplitude from 2 V to 112 V at most."""
    t = np.arange(size) * DT
    share = np.clip(1.3 - t / (size * DT), 0.12, 1.0)
    return 2.0 + 55.0 * (1.0 - share * np.cos(2.0 * np.pi * rate_hz * t))


def stack(u, seed=7, noise=NOISE, late=0.0):
    """A stack of 38 um over 120 V, in um, with creep, a delay and noise."""
    free = virtual_stack((0.0, 120.0), 38.0, 0.13).simulate(u).values
    y = LogCreep(rate_per_decade=0.013).simulate(free, DT).values - 11.3
    y = Lag(delay=late).simulate(y, DT).values if late else y
    return y + np.random.default_rng(seed).normal(0.0, noise, u.size)


def record(u, y):
    channels = (Channel(name="u", values=u, unit="V"), Channel(name="y", values=y, unit="um"))
    return Record(channels=channels, time=np.arange(u.size) * DT, source="a drive")


def found_in(u, y, model="preisach", chain=CHAIN, **more):
    return identify(record(u, y), "u", "y", model=model, chain=chain, **more)


def kinds(found):
    return [f.kind for f in found.quality.findings]


U = drive()
TIME = np.arange(U.size) * DT
CLEAN = stack(U)
STROKE = float(np.ptp(CLEAN))


def staircase(hold=20, levels=60):
    steps = 56.0 + 50.0 * np.sin(np.arange(levels) * 0.31) * np.linspace(1.0, 0.3, levels)
    return np.repeat(steps, hold)


def ringing(u, dt=1e-3):
    """A stage at 97 Hz, hardly damped, seen at 1 kHz."""
    modes = StageModes(frequency_hz=(97.0,), damping_ratio=(0.02,), share=(1.0,))
    return modes.simulate(0.34 * u, dt).values


def polarised(e, coercive=31.0, width=9.0):
    """Strain of a ferroelectric, P^2, whose polarisation P relaxes to its branch with the field."""
    p, strain = -1.0, np.empty(e.size)
    last = e[0]
    for k, now in enumerate(e):
        branch = np.tanh((now - np.sign(now - last) * coercive) / width)
        p += (branch - p) * (1.0 - np.exp(-abs(now - last) / 4.0))
        strain[k] = 12.0 * p * p + 0.05 * now * p
        last = now
    return strain


# ---------------------------------------------------------------------------------------- spikes


def test_no_motion_is_taken_for_spikes():
    rng = np.random.default_rng(5)
    triangle = 90.0 * np.abs((np.arange(3000) / 97.3) % 2.0 - 1.0)
    fast = 50.0 + 47.0 * np.sin(2.0 * np.pi * np.arange(3000) / 17.0)
    held = staircase()
    jump = CLEAN + np.where(TIME > 17.3, 3.0, 0.0)
    toggling = np.where(np.arange(U.size) % 97 == 0, 1.0, 0.0)
    records = {
        "clean": (U, CLEAN),
        "without noise": (U, stack(U, noise=0.0)),
        "triangle": (triangle, BACKLASH.simulate(triangle).values),
        "17 samples in a cycle": (fast, 0.3 * fast + rng.normal(0.0, 0.02, fast.size)),
        "staircase": (held, 0.34 * held),
        "staircase with ringing": (held, ringing(held)),
        "late staircase": (held, np.roll(ringing(held), 3) + rng.normal(0.0, 0.1, held.size)),
        "coarse converter": (U, np.round(CLEAN / 0.7) * 0.7),
        "bit that toggles": (U, np.round(CLEAN / 0.7 + 0.5 * toggling) * 0.7),
        "jump": (U, jump),
        "noisy input": (U + rng.normal(0.0, 0.6, U.size), CLEAN),
        "heavy tails": (U, CLEAN + 0.02 * rng.standard_t(5, U.size)),
    }  # fmt: skip
    taken = {name: without_spikes(u, y)[1].tolist() for name, (u, y) in records.items()}
    assert taken == {name: [] for name in records}


@pytest.mark.parametrize("size", [0.05, 0.3, 20.0])
@pytest.mark.parametrize("length", [1, 2, 3])
def test_spikes_are_taken_out_and_nothing_else(size, length):
    rng = np.random.default_rng(8)
    places = np.array([611, 2203, 2299, 4507])
    at = np.concatenate([places + k for k in range(length)])
    y = CLEAN.copy()
    y[at] += size * STROKE * np.tile(rng.choice([-1.0, 1.0], places.size), length)
    mended, found = without_spikes(U, y)
    assert found.tolist() == sorted(at.tolist())
    assert np.abs(mended - CLEAN)[at].max() < 8.0 * NOISE
    assert np.array_equal(np.delete(mended, at), np.delete(CLEAN, at))


@pytest.mark.slow
def test_four_spikes_change_neither_stroke_nor_delay_nor_creep():
    u = drive(4000)
    y = stack(u, late=0.012)
    spiked = y.copy()
    spiked[[909, 1730, 2544, 3412]] += np.array([90.0, -200.0, 35.0, 60.0])
    clean, found = (found_in(u, own, model="dahl", chain=None) for own in (y, spiked))
    assert found.stroke == pytest.approx(clean.stroke, rel=1e-3)
    for one, other in zip(found.chain, clean.chain, strict=True):
        assert abs(one.value - other.value) < 0.1 * other.standard_error
    # but for the last digit of a figure in one of them
    without, with_spikes = (
        [re.sub(r"\d[\d.]*", "#", w) for w in f.warnings if "spikes" not in w]
        for f in (clean, found)
    )
    assert without == with_spikes
    (finding,) = found.quality.findings
    assert finding.kind == "spikes"
    assert finding.at == pytest.approx(np.array([909, 1730, 2544, 3412]) * DT)
    assert "4 samples of the output are spikes (at 4.545, 8.65, 12.72, ... s)" in finding.text


# -------------------------------------------------------------------------------------- clipping


def ends(u, y, noise=NOISE):
    return range_end(u, y, cycles(u, DT), noise)


@pytest.mark.parametrize("cut", [0.13, 0.03])
@pytest.mark.parametrize("after", [0.0, NOISE])
def test_an_output_that_stops_is_found(cut, after):
    rng = np.random.default_rng(3)
    high, low = CLEAN.max(), CLEAN[200:].min()  # at first it is lower than it comes back to
    for y, level in (
        (np.minimum(CLEAN, high - cut * STROKE), high - cut * STROKE),
        (np.maximum(CLEAN, low + cut * STROKE), low + cut * STROKE),
    ):
        found = ends(U, y + rng.normal(0.0, after, U.size))
        assert found is not None
        assert found.kind == "clipping"
        assert found.level == pytest.approx(level, abs=0.004 * STROKE)
        assert 0.3 * cut * STROKE < found.lost < 1.3 * cut * STROKE
        truth = int(np.sum(np.abs(y - level) < 1e-9))
        assert found.samples == pytest.approx(truth, rel=0.5)


@pytest.mark.parametrize("level", [-1.0, 1.0])
def test_noise_does_not_hide_an_output_that_stops(level):
    rng = np.random.default_rng(5)
    high, noise = CLEAN[1000:].max(), 0.01 * STROKE
    y = np.minimum(CLEAN, high - 0.06 * STROKE) + rng.normal(0.0, noise, U.size)
    end = ends(level * (U - 60.0), level * y, noise)
    assert end is not None
    assert end.kind == "clipping"
    assert level * end.level == pytest.approx(high - 0.06 * STROKE, abs=0.01 * STROKE)
    assert ends(U, CLEAN + rng.normal(0.0, noise, U.size), noise) is None


def test_a_ferroelectric_saturates_or_turns_back_and_is_not_clipped():
    bent = STROKE * np.tanh((CLEAN - CLEAN.min()) / (0.5 * STROKE))
    end = ends(U, bent)
    assert end is not None
    assert end.kind == "saturation"
    low = CLEAN[1000:].min() + 0.1 * STROKE
    turned = measurement([record(U, np.abs(CLEAN - low))], "u", "y").findings
    assert [f.kind for f in turned] == ["butterfly"]
    # too little for a minimum of the mean of a branch, but it turns at the end
    turned = ends(U, np.where(low > CLEAN, low + 0.3 * (low - CLEAN), CLEAN))
    assert turned is not None
    assert turned.kind == "butterfly"


def test_one_sample_in_a_hundred_is_enough():
    level = float(np.quantile(CLEAN, 0.99))
    found = ends(U, np.minimum(CLEAN, level))
    assert found is not None
    assert (found.kind, found.level, found.samples) == ("clipping", level, 60)


def monitored(y, share, seed, rate_hz=1.3):
    """What is found where the input was read with noise."""
    u = drive(y.size, rate_hz)
    noise = np.random.default_rng(seed).normal(0.0, share * float(np.ptp(u)), u.size)
    return [f.kind for f in measurement([record(u + noise, y)], "u", "y").findings]


@functools.cache
def quiet(rate_hz):
    return stack(drive(rate_hz=rate_hz), late=0.012, noise=0.003)


@pytest.mark.parametrize("share", [0.001, 0.002, 0.005, 0.01, 0.02])
def test_noise_of_the_input_clips_nothing(share):
    for rate_hz in (0.31, 1.3, 4.7):
        y = quiet(rate_hz)
        level = float(np.quantile(y, 0.99))
        for seed in range(2):
            assert monitored(y, share, seed, rate_hz) == []
        assert monitored(np.minimum(y, level), share, 4, rate_hz) == ["clipping"]
        assert monitored(np.minimum(y, y.max() - 0.13 * STROKE), share, 5, rate_hz) == ["clipping"]


def test_values_alike_at_the_end_are_clipped_even_behind_the_turns():
    late = stack(U, late=0.02)
    level = float(np.quantile(late, 0.99))
    end = ends(U, np.minimum(late, level))
    assert end is not None
    assert (end.kind, end.level, end.lost, end.samples) == ("clipping", level, NOISE, 60)


def test_an_amplifier_that_limits_softly_is_found():
    soft = 30.0 * np.tanh(CLEAN / 15.0)
    end = ends(U, soft)
    assert end is not None
    assert end.kind == "saturation"


def test_an_end_that_is_reached_is_none_that_clips():
    rng = np.random.default_rng(4)
    held = np.repeat(staircase(1), 20)
    waits = np.concatenate((np.full(900, 112.0), U, np.full(700, 2.0)))
    for name, (u, y) in {
        "clean": (U, CLEAN),
        "late": (U, stack(U, late=0.04)),
        "stands still behind turns": (U, BACKLASH.simulate(U).values),
        "the same with noise": (U, BACKLASH.simulate(U).values + rng.normal(0.0, NOISE, U.size)),
        "waits at both ends": (waits, np.round(stack(waits), 1)),
        "coarse converter": (U, np.round(CLEAN / 0.7) * 0.7),
        "staircase": (held, 0.3 * held),
        "noisy input": (U + rng.normal(0.0, 0.6, U.size), CLEAN),
    }.items():
        assert ends(u, y, 0.0 if "noise" not in name else NOISE) is None, name


def test_clipping_is_named_with_the_value_of_the_record():
    found = measurement([record(U, -np.minimum(CLEAN, 20.0))], "u", "y")
    (finding,) = found.findings
    assert finding.kind == "clipping"
    assert "is clipped at -20 um" in finding.text


# ------------------------------------------------------------------------------------- butterfly


def test_a_butterfly_is_told_from_a_lag():
    t = np.arange(4000) * DT
    u = 11.0 + 83.0 * np.sin(2.0 * np.pi * 0.47 * t)
    for sign in (1.0, -1.0):
        found = butterfly(u, sign * polarised(u), cycles(u, DT))
        assert found is not None
        # the polarisation follows its branch some volts late
        assert 26.0 < found[0] < 44.0
        assert -44.0 < found[1] < -26.0
    even = butterfly(u, 0.002 * (u - 20.0) ** 2, cycles(u, DT))
    assert even is not None
    assert even[0] == pytest.approx(even[1], abs=1e-9)
    for late in (0.02, 0.1, 0.3, 0.5):  # up to a quarter of a cycle
        follows = 11.0 + 83.0 * np.sin(2.0 * np.pi * 0.47 * (t - late))
        assert butterfly(u, follows, cycles(u, DT)) is None
    for u, y in ((U, CLEAN), (staircase(), ringing(staircase())), (U, BACKLASH.simulate(U).values)):
        assert butterfly(u, y, cycles(u, DT)) is None


def test_no_model_fits_a_butterfly():
    t = np.arange(3000) * DT
    u = 21.0 + 73.0 * np.sin(2.0 * np.pi * 0.47 * t)
    found = found_in(u, polarised(u), chain=ChainValues())
    assert not found.quality.fits
    assert kinds(found) == ["butterfly"]
    assert found.warnings[0].startswith("no model fits: the smallest residual is")
    assert "keep the drive voltage unipolar" in found.warnings[1]
    even = 83.0 * np.sin(2.0 * np.pi * 0.47 * t)
    with pytest.raises(RecordError, match="butterfly loop: the output turns back"):
        measurement([record(even, polarised(even))], "u", "y")


# --------------------------------------------------------------------------------- jump and drift


def shifts(*records, chain=CHAIN):
    """Baseline shifts of records, by a chain that may be wrong."""
    m = measurement([record(u, y) for u, y in records], "u", "y")
    return baseline_shifts(fit_data(m, chain))


def jumped(place, share, u=U, y=CLEAN):
    return y + np.where(np.arange(u.size) >= place, share * STROKE, 0.0)


@pytest.mark.parametrize(("share", "place"), [(0.02, 3550), (-0.05, 4801), (0.2, 3777)])
def test_a_jump_of_the_zero_is_placed(share, place):
    found = found_in(U, jumped(place, share))
    (jump,) = found.quality.findings
    assert jump.kind == "jump"
    assert jump.at[0] == pytest.approx(place * DT, abs=3.0 * DT)
    assert jump.size == pytest.approx(share * STROKE, rel=0.1)
    assert (
        f"at {jump.at[0]:.6g} s and keeps the new level"
        in found.warnings[int(not found.quality.fits)]
    )


#: What a search makes of a record with a jump: creep at its limit, none, a spectrum.
MISLED = (
    ChainValues(creep_per_decade=0.12, delay=0.004),
    ChainValues(),
    ChainValues(
        creep_per_decade=0.07, spectrum=CreepSpectrum(times=(0.1, 30.0), weights=(0.02, 0.18))
    ),
)


@pytest.mark.parametrize("chain", MISLED)
@pytest.mark.parametrize(("share", "place"), [(0.005, 2700), (-0.01, 1903), (0.01, 5460)])
def test_a_small_jump_is_found_whatever_was_taken_for_creep(share, place, chain):
    (jump,) = shifts((U, jumped(place, share)), chain=chain)
    assert (jump.kind, jump.record) == ("jump", 0)
    assert jump.at[0] == pytest.approx(place * DT, abs=3.0 * DT)
    assert jump.size == pytest.approx(share * STROKE, rel=0.35)


def test_a_jump_is_found_on_a_staircase():
    levels = np.concatenate((np.arange(0.0, 101.0, 5.0), np.arange(95.0, -1.0, -5.0)))
    u = np.tile(np.repeat(levels, 10), 15)[:6000]
    y = stack(u) + np.where(np.arange(u.size) * DT >= 17.305, 3.0, 0.0)
    (jump,) = shifts((u, y))
    assert (jump.kind, jump.at) == ("jump", (17.305,))
    assert jump.size == pytest.approx(3.0, abs=0.01)


def test_a_jump_is_no_change_of_gain_by_next_to_nothing():
    u = drive(rate_hz=0.2)
    y = stack(u) + np.where(np.arange(u.size) * DT >= 26.0, 3.0, 0.0)
    assert all(fault.kind == "jump" for fault in shifts((u, y)))


def test_a_jump_stands_out_of_much_noise():
    """What is left without the jump is white, and each of its samples counts."""
    y = jumped(677, 2.0 / STROKE) + np.random.default_rng(4).normal(0.0, 0.5, U.size)
    (jump,) = shifts((U[:1200], y[:1200]))
    assert jump.at[0] == pytest.approx(677 * DT, abs=3.0 * DT)
    assert jump.size == pytest.approx(2.0, rel=0.1)


def test_a_jump_is_found_between_two_rates():
    fast = drive(2500, rate_hz=6.1)
    u = np.concatenate((U[:3500], fast))
    y = stack(u)
    (jump,) = shifts((u, jumped(3300, 0.02, u, y)), chain=MISLED[2])
    assert jump.at[0] == pytest.approx(3300 * DT, abs=3.0 * DT)
    assert jump.percent == pytest.approx(2.0, rel=0.15)


def test_a_jump_belongs_to_its_record():
    other = drive(4000, rate_hz=0.7)
    y = stack(other, seed=3)
    (jump,) = shifts((U, CLEAN), (other, jumped(2345, -0.02, other, y)))
    assert (jump.kind, jump.record) == ("jump", 1)
    assert jump.at[0] == pytest.approx(2345 * DT, abs=3.0 * DT)


def test_what_has_no_jump_shows_none():
    """Noise that wanders, and loops that are not alike, are no changes of the zero."""
    rng = np.random.default_rng(12)
    u = U[:3000]
    for _ in range(4):
        white = rng.normal(0.0, 1.0, u.size)
        wander = np.convolve(white, np.exp(-np.arange(800) / 150.0), mode="same")
        bowed = np.interp(np.arange(u.size), np.arange(0, 3001, 150), rng.normal(size=21))
        for extra in (wander / wander.std(), bowed * np.sin(0.05 * u) * 2.0):
            assert shifts((u, CLEAN[:3000] + 0.1 * extra)) == []


def test_two_jumps_are_two():
    y = jumped(1500, 0.02) - jumped(4000, 0.014) + CLEAN
    found = shifts((U, y))
    assert [f.at[0] for f in found] == pytest.approx([1500 * DT, 4000 * DT], abs=4.0 * DT)
    assert [f.percent for f in found] == pytest.approx([2.0, -1.4], abs=0.2)


def test_a_jump_that_the_input_makes_is_no_jump_of_the_zero():
    stepped = 2.0 + 0.4 * (U - 2.0) + np.where(np.arange(U.size) >= 2500, 60.0, 0.0)
    y = stack(stepped)
    assert shifts((stepped, jumped(2500, 0.02, stepped, y))) == []
    assert shifts((stepped, jumped(4300, 0.02, stepped, y))) != []
    # before both ends of the range were reached a jump cannot be told from earlier motion
    assert shifts((stepped, jumped(2300, 0.02, stepped, y))) == []


def test_drift_is_named_and_fitted():
    speed = 0.2
    y = CLEAN + speed * TIME
    blind = found_in(U, y)
    (drift,) = blind.quality.findings
    assert drift.kind == "drift"
    assert drift.size == pytest.approx(speed * TIME[-1], rel=0.25)
    assert "--zero drift" in drift.text
    clean, told = found_in(U, CLEAN), found_in(U, y, zero="drift")
    assert kinds(told) == []
    assert told.heldout_rms_percent < 0.4 * blind.heldout_rms_percent
    assert told.heldout_rms_percent < 1.2 * clean.heldout_rms_percent * clean.stroke / told.stroke
    moved = [f.model.hysteresis.simulate(U).values for f in (clean, told, blind)]
    told_off, blind_off = (np.ptp(moved[0] - other) for other in moved[1:])
    assert told_off < 0.5 * blind_off


@pytest.mark.parametrize("chain", [CHAIN, MISLED[2]])
@pytest.mark.parametrize("share", [0.015, -0.03])
def test_a_small_drift_is_told_from_creep(share, chain):
    y = CLEAN + share * STROKE * np.linspace(0.0, 1.0, U.size)
    (drift,) = shifts((U, y), chain=chain)
    assert drift.kind == "drift"
    # what had settled before the record is known as badly
    assert drift.percent == pytest.approx(100.0 * share, abs=0.9)


def test_what_creeps_does_not_drift():
    settles = CLEAN + 0.02 * STROKE * np.log10(1.0 + TIME / 0.1)
    assert kinds(found_in(U, settles)) == []


@pytest.mark.parametrize(
    "creep",
    [
        LogCreep(rate_per_decade=0.04),
        LogCreep(rate_per_decade=0.02, longest=3.0),
        CreepSpectrum(times=(0.3, 3.0), weights=(0.02, 0.04)),
    ],
)
def test_creep_behind_a_large_step_is_neither_jump_nor_drift(creep):
    t = np.arange(6000) * DT
    u = np.where(t < 8.0, U, 104.0)
    u[t >= 20.0] = U[t < 10.0]
    free = virtual_stack((0.0, 120.0), 38.0, 0.13).simulate(u).values
    y = creep.simulate(free, DT).values + np.random.default_rng(1).normal(0.0, NOISE, u.size)
    assert shifts((u, y)) == []


# ------------------------------------------------- another time, gain, unit or column than it seems


def wandering(size=3000, seed=2, widths=(10.0, 80.0), small=1.0):
    """A random walk between 0 and 120 V, which is often at its ends; `small` is its quick part."""
    rng = np.random.default_rng(seed)
    quick, slow = (gaussian_filter1d(rng.standard_normal(size), width) for width in widths)
    mixed = small * quick / quick.std() + slow / slow.std()
    return 60.0 + 60.0 * np.tanh(1.2 * mixed / np.std(mixed))


def misrecordings(u, y, chain=CHAIN):
    return misrecorded(fit_data(measurement([record(u, y)], "u", "y"), chain))


@pytest.mark.parametrize("late", [-1.0, -0.3, 0.35, 1.0])
@pytest.mark.parametrize("u", [U, wandering()], ids=["cycles", "walk"])
def test_an_output_of_another_time_is_named(u, late):
    y, k = stack(u), round(abs(late) / DT)
    u, y = (u[k:], y[:-k]) if late > 0.0 else (u[:-k], y[k:])
    try:
        (fault,) = misrecordings(u, y)
    except RecordError as error:  # so late that it seems to be another column, or to lead
        said = str(error)
    else:
        assert fault.kind == "shift"
        said = fault.text
    seconds = re.search(r"moves about ([\d.]+) (s|ms) (before|after)", said)
    if seconds is None:
        assert "the output leads the input" in said
        return
    size = float(seconds[1]) * (1e-3 if seconds[2] == "ms" else 1.0)
    assert (size if seconds[3] == "after" else -size) == pytest.approx(late, abs=0.03)


@pytest.mark.parametrize(("change", "place"), [(0.05, 3000), (-0.03, 3600)])
@pytest.mark.parametrize("u", [U, wandering(U.size)], ids=["cycles", "walk"])
def test_a_change_of_the_gain_is_placed(u, change, place):
    y = stack(u) * np.where(np.arange(u.size) >= place, 1.0 + change, 1.0)
    (fault,) = misrecordings(u, y)
    assert (fault.kind, fault.record) == ("gain", 0)
    assert fault.at[0] == pytest.approx(place * DT, abs=10.0 * DT)
    assert fault.percent == pytest.approx(100.0 * change, rel=0.15)
    # it is no jump of the zero, though it moves the mean as well
    assert kinds(found_in(u, y)) == ["gain"]


def test_cycles_of_another_rate_or_size_have_no_other_gain_or_time():
    slow = np.concatenate((drive(3000, 0.7), drive(3000, 3.1)))
    lagging = Lag(time_constant=0.016).simulate(stack(slow), DT).values  # of 10 Hz
    assert misrecordings(slow, lagging, replace(CHAIN, delay=0.016)) == []
    even = 60.0 - 60.0 * np.cos(2.0 * np.pi * 1.25 * TIME) * np.where(TIME % 4.0 < 2.0, 1.0, 0.5)
    for u, y in ((U, CLEAN), (even, stack(even)), (U, jumped(3550, 0.03))):
        assert misrecordings(u, y) == []


def test_a_reading_as_input_is_named():
    own = 2.7 * (CLEAN - CLEAN.min()) + np.random.default_rng(1).normal(0.0, 0.1, U.size)
    found = found_in(own[:3000], CLEAN[:3000], model="dahl")
    assert any("the output is a straight line of the input within" in w for w in found.warnings)


def test_steps_of_a_converter_are_named():
    coarse = measurement([record(U, np.round(CLEAN / 0.3) * 0.3)], "u", "y")
    assert any("read in steps of 0.3 um, 0.85 % of the stroke" in w for w in coarse.warnings)


def test_the_noise_of_a_coarse_converter_is_at_least_that_of_its_steps():
    for step in (0.2, 2.0):
        y = np.round(stack(U, noise=0.0) / step) * step
        (section,) = measurement([record(U, y)], "u", "y").sections
        assert section.noise >= step / np.sqrt(12.0)


@pytest.mark.parametrize(
    ("volts", "metres", "named"),
    [(1.0, 1e-6, False), (1.0, 1e-3, True), (1e-3, 1e-6, True), (1e3, 1e-6, True)],
    ids=["as it is", "mm for um", "mV for V", "V for mV"],
)
def test_a_motion_per_volt_that_no_drive_has_is_named(volts, metres, named):
    channels = (
        Channel(name="u", values=volts * U[:2000], unit="V"),
        Channel(name="y", values=metres * CLEAN[:2000], unit="m"),
    )
    made = measurement([Record(channels=channels, time=TIME[:2000])], "u", "y")
    assert any("check the units of both columns" in w for w in made.warnings) == named


@pytest.mark.parametrize("seed", range(4))
def test_swapped_columns_of_a_walk_are_refused(seed):
    u = wandering(seed=seed, widths=(8.0, 400.0), small=0.25)  # hardly any large loop
    y = stack(u)
    measurement([record(u, y)], "u", "y")
    with pytest.raises(RecordError, match="the output leads the input"):
        measurement([record(y, u)], "u", "y")


def test_clean_records_show_nothing():
    u = U[:4000]
    for model, seed in (("preisach", 1), ("dahl", 2)):
        found = found_in(u, stack(u, seed), model=model)
        assert kinds(found) == []
        assert found.quality.fits
        assert found.quality.line_percent > 2.0
        assert not any("straight line" in w or "in steps of" in w for w in found.warnings)


def test_noise_is_nothing_that_a_model_should_explain():
    u = drive(1500)
    y = Dahl(gain=0.3, stiffness=1e-3, limit=2e-2).simulate(u).values
    loud = y + np.random.default_rng(6).normal(0.0, 1.6, u.size)
    found = found_in(u, loud, model="dahl", chain=ChainValues())
    assert found.rms_percent > 3.0
    assert found.quality.fits
