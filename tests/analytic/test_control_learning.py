"""Learning over whole periods: contraction in closed form, noise, steps that are taken back."""

import itertools

import numpy as np
import pytest

from flexstage.base.errors import LimitError, ModelError, RecordError
from flexstage.control import LearningSettings, learn, sine
from flexstage.control.learning import mean_error
from flexstage.hysteresis import DriveModel, Lag, PrandtlIshlinskii, StageModes, ValidityRange
from flexstage.hysteresis.limited_inverse import steady_output
from flexstage.instruments.protocol import Waveform
from flexstage.records import Channel, Record
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import Notch, ServoSettings

RATE = 2e3
WANTED = sine("x", 9e-6, 43e-6, 20.0, sample_rate_hz=RATE)
PERIODS = 4


def record(period, periods=PERIODS, noise=0.0, rng=None, first=0.0):
    y = np.tile(period, periods)
    if noise:
        y = y + noise * rng.standard_normal(y.size)
    time = first + np.arange(y.size) / RATE
    return Record(channels=(Channel(name="x", values=y, unit="m"),), time=time)


def through(response, values):
    f = np.fft.rfftfreq(values.size, 1.0 / RATE)
    return np.fft.irfft(np.fft.rfft(values) * response(f), values.size)


def targets(values):
    return Waveform(values={"x": values}, sample_rate_hz=RATE, quantity="position")


def nominal(f):
    return 1.0 / (1.0 + 1j * f / 170.0)


@pytest.mark.parametrize("error", [0.0, 0.3, -0.4])
def test_the_error_contracts_as_the_closed_form_says(error) -> None:
    """One harmonic alone: 1 - a (1 + Delta) in the first trial."""
    how = LearningSettings(trials=1, step=0.7, periods=PERIODS, band_hz=30.0, constant=False)

    def plant(f):
        return nominal(f) * (1.0 + error)

    made = learn(
        lambda w: record(through(plant, w.values["x"])),
        WANTED, targets(WANTED.positions["x"]), {"x": nominal}, how,
    )  # fmt: skip
    first, second = made.axes["x"].trials
    assert second.rms / first.rms == pytest.approx(abs(1.0 - 0.7 * (1.0 + error)), rel=1e-9)
    assert second.rms / first.rms <= how.contraction + 0.5


def test_measured_changes_mend_a_wrong_model() -> None:
    """A response that is wrong by 40 % and 20 degrees is seen in the first change."""
    how = LearningSettings(trials=4, step=1.0, periods=PERIODS, band_hz=30.0, constant=False)
    wrong = 0.6 * np.exp(1j * np.deg2rad(20.0))

    def plant(f):
        return nominal(f) * np.where(f > 0, wrong, 1.0)

    made = learn(
        lambda w: record(through(plant, w.values["x"])),
        WANTED, targets(WANTED.positions["x"]), {"x": nominal}, how,
    )  # fmt: skip
    rms = [t.rms for t in made.axes["x"].trials]
    gain = 1.0 + 0.0j
    for before, after in itertools.pairwise(rms):
        assert after / before == pytest.approx(abs(1.0 - wrong / gain), rel=1e-6)
        gain = 0.5 * (gain + wrong)  # half of what was seen is taken over
    assert rms[4] / rms[0] < 0.1 * abs(1.0 - wrong) ** 4


def test_a_model_of_the_wrong_sign_never_makes_it_worse() -> None:
    how = LearningSettings(trials=50, periods=PERIODS, constant=False)
    rng = np.random.default_rng(3)
    tried = []

    def run(w):
        tried.append(w.values["x"])
        return record(through(lambda f: -nominal(f), w.values["x"]), noise=3e-9, rng=rng)

    made = learn(run, WANTED, targets(WANTED.positions["x"]), {"x": nominal}, how)
    rms = [t.rms for t in made.axes["x"].trials]
    assert made.axes["x"].used == made.axes["x"].trials[0]
    np.testing.assert_array_equal(made.waveform.values["x"], WANTED.positions["x"])
    # what was clearly worse was taken back
    assert max(rms) == rms[1]
    assert np.max(np.abs(tried[-1] - tried[0])) < 0.5 * np.max(np.abs(tried[1] - tried[0]))
    assert rms[-1] < 1.3 * rms[0]


def test_it_ends_at_the_noise_and_does_not_learn_it() -> None:
    how = LearningSettings(trials=50, periods=16, band_hz=200.0, noise_factor=3.5)
    rng = np.random.default_rng(8)
    noise = 6e-9

    def run(w):
        return record(through(nominal, w.values["x"]), periods=16, noise=noise, rng=rng)

    made = learn(run, WANTED, targets(WANTED.positions["x"]), {"x": nominal}, how)
    axis = made.axes["x"]
    assert axis.reason == "the remaining error is noise"
    assert len(axis.trials) < 12
    true = through(nominal, made.waveform.values["x"]) - WANTED.positions["x"]
    # 21 numbers of 100 are learned, from a mean of 16 periods: 6 nm sqrt(0.21 / 16) = 0.7 nm
    assert np.sqrt(np.mean(true**2)) < 2.5e-9
    assert axis.trials[-1].noise == pytest.approx(noise * np.sqrt(0.21 / 16), rel=0.4)


def test_a_harmonic_is_learned_as_far_as_it_stands_out_of_its_noise() -> None:
    """Noise alone, two periods: of a harmonic with E and N the part 1 - N^2/E^2 is learned."""
    how = LearningSettings(trials=1, step=1.0, periods=2, noise_factor=0.0, band_hz=400.0)
    rng = np.random.default_rng(12)
    tried = []

    def run(w):
        tried.append(w.values["x"])
        got = record(w.values["x"], periods=2, noise=6e-9, rng=rng)
        run.errors.append(mean_error(got, "x", WANTED, "x", 2))
        return got

    run.errors = []
    learn(run, WANTED, targets(WANTED.positions["x"]), {"x": lambda f: 1.0 + 0.0 * f}, how)
    error, noise = run.errors[0]
    spectrum = np.fft.rfft(error)[:20]
    part = np.clip(1.0 - np.abs(noise[:20]) ** 2 / np.abs(spectrum) ** 2, 0.0, 1.0)
    change = np.fft.rfft(tried[1] - tried[0])[:20]
    np.testing.assert_allclose(change, part * spectrum, atol=1e-16)
    assert 0.0 < part.mean() < 0.9


def test_fifty_trials_stay_at_the_noise() -> None:
    how = LearningSettings(trials=50, periods=PERIODS, noise_factor=0.0)
    rng = np.random.default_rng(21)

    def plant(f):
        return 0.8 * nominal(f) * np.exp(-2j * np.pi * f * 1.5e-4)

    made = learn(
        lambda w: record(through(plant, w.values["x"]), noise=6e-9, rng=rng),
        WANTED, targets(WANTED.positions["x"]), {"x": nominal}, how,
    )  # fmt: skip
    rms = np.array([t.rms for t in made.axes["x"].trials])
    assert rms.size == 51
    # 51 of 100 numbers, from a mean of 4 periods: 2.1 nm in what is seen, as much in what is tried
    assert rms[15:].max() < 8e-9


def drive() -> DriveModel:
    return DriveModel(
        hysteresis=PrandtlIshlinskii(
            gain=3.1e-7, thresholds=np.array([3.0, 11.0, 29.0]),
            weights=np.array([9e-8, 7e-8, 5e-8]),
        ),
        modes=StageModes(frequency_hz=[211.0], damping_ratio=[0.021]),
        lag=Lag(delay=1.3e-3),
        validity=ValidityRange(
            input_range=(0.0, 120.0), output_range=(0.0, 6e-5), rate_range_hz=(1.0, 50.0)
        ),
    )  # fmt: skip


def test_voltages_of_a_hysteretic_drive_are_learned_through_its_model() -> None:
    own = drive()
    other = DriveModel(
        hysteresis=PrandtlIshlinskii(
            gain=2.8e-7, thresholds=np.array([2.0, 9.0, 26.0]),
            weights=np.array([1.2e-7, 6e-8, 6e-8]),
        ),
        modes=StageModes(frequency_hz=[211.4], damping_ratio=[0.018]),
        lag=Lag(delay=1.26e-3), validity=own.validity,
    )  # fmt: skip

    def run(w):
        from flexstage.hysteresis.limited_inverse import chain_response

        x = steady_output(other, w.values["x"])
        return record(through(lambda f: chain_response(other, f), x))

    start = Waveform(
        values={"x": 60.0 - 40.0 * np.cos(2 * np.pi * np.arange(100) / 100.0)},
        sample_rate_hz=RATE, quantity="voltage",
    )  # fmt: skip
    how = LearningSettings(trials=12, periods=PERIODS)
    made = learn(run, WANTED, start, {"x": own}, how,
                 limits={"x": AxisLimits(voltage=(0.0, 120.0), slew=4e4)})  # fmt: skip
    rms = [t.rms for t in made.axes["x"].trials]
    assert rms[0] > 1e-6
    assert rms[5] < 2e-2 * rms[0]
    assert min(rms) < 1e-8
    assert max(rms) == rms[0]


def test_the_mean_error_is_back_at_the_start_of_a_period() -> None:
    # a record that begins 17 samples into a period
    got = record(np.roll(WANTED.positions["x"], -17), first=17 / RATE)
    error, noise = mean_error(got, "x", WANTED, "x", PERIODS)
    np.testing.assert_allclose(error, 0.0, atol=1e-18)
    np.testing.assert_allclose(noise, 0.0, atol=1e-18)
    with pytest.raises(RecordError, match="record more"):
        mean_error(got, "x", WANTED, "x", PERIODS + 1)


def test_the_noise_of_a_mean_is_that_of_its_periods() -> None:
    rng = np.random.default_rng(4)
    _, spread = mean_error(
        record(WANTED.positions["x"], periods=64, noise=5e-9, rng=rng), "x", WANTED, "x", 64
    )
    # each of 51 harmonics: 5 nm sqrt(100) / sqrt(64), its variance known to 1/sqrt(64)
    assert np.sqrt(np.mean(np.abs(spread[1:-1]) ** 2)) == pytest.approx(5e-9 * 10.0 / 8.0, rel=0.06)


def test_what_cannot_be_learned_is_refused_in_words() -> None:
    run = lambda w: record(w.values["x"])  # noqa: E731
    start = targets(WANTED.positions["x"])
    with pytest.raises(ModelError, match="convergence is not certain"):
        LearningSettings(step=1.2)
    with pytest.raises(ModelError, match="2 periods"):
        LearningSettings(periods=1)
    with pytest.raises(ModelError, match="response of the closed loop"):
        learn(run, WANTED, start, {"x": drive()})
    with pytest.raises(ModelError, match="needs a start and a model"):
        learn(run, WANTED, start, {})
    with pytest.raises(ModelError, match="wider band"):
        learn(run, WANTED, start, {"x": nominal}, LearningSettings(band_hz=10.0))
    with pytest.raises(ModelError, match="100 samples"):
        learn(run, WANTED, targets(np.zeros(99)), {"x": nominal})
    slow = AxisLimits(position=(0.0, 1e-4), speed=1e-4)
    with pytest.raises(LimitError, match="lower the rate"):
        learn(
            lambda w: record(0.5 * w.values["x"]), WANTED, start, {"x": nominal},
            LearningSettings(periods=PERIODS), limits={"x": slow},
        )  # fmt: skip


STRAIGHT = DriveModel(
    hysteresis=PrandtlIshlinskii(gain=5e-7, thresholds=np.array([5.0]), weights=np.array([0.0])),
    # a reading shows the voltage of the sample before
    lag=Lag(delay=1.0 / RATE),
    validity=ValidityRange(
        input_range=(0.0, 120.0), output_range=(0.0, 6e-5), rate_range_hz=(1.0, 50.0)
    ),
)
CONTROL = ServoSettings(
    proportional=1e5, integral=1.4e8, notches=(Notch(frequency_hz=60.0, zero_damping=0.1),)
)


def controlled(added, gain=5e-7, periods=PERIODS, settle=80):
    """The control sample by sample, as its equations say; a reading is a sample old."""
    ((b0, b1, b2, a1, a2),) = CONTROL.sections(RATE)
    target = np.roll(WANTED.positions["x"], 1)
    z1 = z2 = integral = u = reading = 0.0
    readings = []
    for k in range((settle + periods) * added.size):
        e = target[k % added.size] - reading
        # the voltage of the sample before, and no longer the one before that
        reading = gain * u
        readings.append(reading)
        y = b0 * e + z1
        z1, z2 = b1 * e - a1 * y + z2, b2 * e - a2 * y
        integral += CONTROL.integral / RATE * y
        u = added[k % added.size] + CONTROL.proportional * y + integral
    return np.array(readings[settle * added.size :])


def learned_under_control(gain=5e-7, **options):
    phase = 2 * np.pi * np.arange(100) / 100.0
    start = Waveform(
        values={"x": 50.0 - 40.0 * np.cos(phase) + 3.0 * np.sin(3.0 * phase)},
        sample_rate_hz=RATE, quantity="voltage",
    )  # fmt: skip

    def run(w):
        y = controlled(w.values["x"], gain)
        time = np.arange(y.size) / RATE
        return Record(channels=(Channel(name="x", values=y, unit="m"),), time=time)

    how = LearningSettings(trials=1, step=1.0, periods=PERIODS, **options)
    made = learn(run, WANTED, start, {"x": STRAIGHT}, how, servo={"x": CONTROL})
    return made, start.values["x"]


def test_what_is_added_to_a_control_is_learned_in_one_trial_where_its_loop_is_known() -> None:
    made, start = learned_under_control()
    first, second = made.axes["x"].trials
    assert first.rms > 1e-7
    # the loop that was reckoned with is the loop that ran; 80 periods leave nothing of the start
    assert second.rms < 1e-6 * first.rms
    # the mean is the control's
    assert np.mean(made.waveform.values["x"]) == pytest.approx(np.mean(start), rel=1e-9)


def test_a_wrong_gain_under_control_contracts_as_the_closed_form_says() -> None:
    """Of one harmonic 1 - (1 + Delta) S'/S is left, S' of the loop with the other gain."""
    made, _ = learned_under_control(gain=5.9e-7, band_hz=30.0)
    first, second = made.axes["x"].trials
    c = CONTROL.response([20.0], RATE)[0]
    z1 = np.exp(-2j * np.pi * 20.0 / RATE)
    seen, true = (g * z1 / (1.0 + c * g * z1 * z1) for g in (5e-7, 5.9e-7))
    assert second.rms / first.rms == pytest.approx(abs(1.0 - true / seen), rel=1e-3)


def test_a_control_needs_the_model_of_its_drive() -> None:
    with pytest.raises(ModelError, match="needs the model of the drive"):
        learn(lambda _: None, WANTED, targets(WANTED.positions["x"]), {"x": nominal},
              servo={"x": CONTROL})  # fmt: skip


def test_without_a_mode_nothing_is_learned_far_above_the_cycles_of_the_identification() -> None:
    """Identified up to 50 Hz: a mode that was not seen may turn the phase beyond 300 Hz."""
    t = np.arange(100) / RATE
    low, high = (np.sin(2.0 * np.pi * f * t) for f in (280.0, 360.0))
    wanted = WANTED.positions["x"]
    start = Waveform(
        values={"x": np.roll(wanted, -1) / 5e-7}, sample_rate_hz=RATE, quantity="voltage"
    )

    def run(w):
        return record(5e-7 * np.roll(w.values["x"], 1) + 3e-8 * low + 2e-8 * high)

    how = LearningSettings(trials=1, step=1.0, periods=PERIODS)
    made = learn(run, WANTED, start, {"x": STRAIGHT}, how)
    left = 5e-7 * np.roll(made.waveform.values["x"], 1) - wanted + 3e-8 * low
    assert np.max(np.abs(left)) < 1e-12
    wide = LearningSettings(trials=1, step=1.0, periods=PERIODS, band_hz=400.0)
    made = learn(run, WANTED, start, {"x": STRAIGHT}, wide)
    left = 5e-7 * np.roll(made.waveform.values["x"], 1) - wanted + 3e-8 * low + 2e-8 * high
    assert np.max(np.abs(left)) < 1e-12
