r"""Iterative learning over whole periods, in the frequency domain.

A periodic motion has the same error in every period, so that its command can be learned from one
trial to the next. With the error :math:`E_k(f)` of trial k, averaged over its periods,

.. math:: X_{k+1}(f) = X_k(f) + \alpha\, w_k(f)\, \hat G(f)^{-1} E_k(f)

where X is the output of the hysteresis, :math:`\hat G` the linear chain after it, and the voltage
follows from X by the inverse of the hysteresis over a repeating period. From X the drive is linear
as far as the model is exact: :math:`G = \hat G (1 + \Delta)`. Each harmonic contracts by
:math:`|1 - \alpha w (1 + \Delta)| \le |1 - \alpha w| + \alpha w |\Delta| < 1` for every
:math:`\alpha w \le 1` as long as the model error :math:`|\Delta| < 1`; this is the condition of
S. Arimoto and others (J. Robotic Systems 1 (1984) 123) for one harmonic. The weights
:math:`w = \max(0, 1 - N^2/|E|^2)` correct a harmonic only as far as it exceeds its noise N, which
is estimated from the scatter of the periods, and near a mode only as far as its frequency is
known. A trial that is worse than the best one by more than a quarter is rejected and the step
halved. So trials stay near the best one, and the result is never worse than the start. In open loop
creep and drift continue between the trials; learning follows them, and the last accepted trial is
the result.

Under a position control the learned voltages are added to its own. The control reduces their
effect by the sensitivity :math:`S = 1/(1 + C P)`, so that :math:`\hat G` becomes :math:`\hat G S`.
Its integral determines the mean, which is not learned. A slow loop is enough: it corrects creep and
drift, and learning corrects what repeats.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import LimitError, ModelError, RecordError
from flexstage.control.loop_plant import loop_plant
from flexstage.control.trajectory import Trajectory, at_times, samples_of_period
from flexstage.hysteresis import DriveModel
from flexstage.hysteresis.limited_inverse import chain_response, steady_input, steady_output
from flexstage.instruments.protocol import Waveform
from flexstage.records import Record
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import ServoSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningSettings:
    """Settings of learning.

    Raises
    ------
    ModelError
        A setting is out of its range.
    """

    trials: int = 5
    """Largest number of trials after the first run."""
    step: float = 0.9
    """Part of the error that is corrected in a trial [1], above 0 and at most 1."""
    model_error: float = 0.5
    """Largest expected error of the model's response [1], below 1."""
    band_hz: float | None = None
    """Highest frequency that is learned [Hz] (default: 1.3 times the lowest mode of a drive, or 6
    times the fastest cycles that it was identified on if it has no mode; at most a quarter of the
    sample rate).
    """
    periods: int = 10
    """Periods at the end of a record that are averaged, 2 or more."""
    noise_factor: float = 2.5
    """Learning ends when no harmonic exceeds its noise by more than this factor [1]; 0 for all
    trials.
    """
    constant: bool = True
    """Whether the mean position is learned as well."""
    frequency_error: float = 0.005
    """Relative error of the model's natural frequencies [1]: harmonics near a mode are learned with
    smaller steps.
    """

    def __post_init__(self) -> None:
        if not (self.trials >= 0 and self.periods >= 2):
            raise ModelError(
                "learning needs at least 0 trials, of at least 2 periods, got "
                f"{self.trials!r} and {self.periods!r}"
            )
        if not (0.0 < self.step <= 1.0 and 0.0 <= self.model_error < 1.0):
            raise ModelError(
                "the step must be above 0 and at most 1 and the model error below 1, or "
                f"convergence is not certain; got {self.step!r} and {self.model_error!r}"
            )

    @property
    def contraction(self) -> float:
        """Largest factor by which the error of a harmonic shrinks in a trial, away from noise."""
        return 1.0 - self.step + self.step * self.model_error


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One trial of one axis."""

    number: int
    """Its number; 0 is the run of the start."""
    rms: float
    """Root mean square of the mean period's error [m]."""
    largest: float
    """Its largest value [m]."""
    noise: float
    """Root mean square of the noise of the mean period [m]."""
    step: float
    """Step of the next trial [1]."""
    accepted: bool
    """Whether the trial was accepted."""
    harmonics: int
    """Number of harmonics that exceed the noise."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LearnedAxis:
    """Result of learning of one axis."""

    trials: tuple[Trial, ...]
    """All trials."""
    best: Trial
    """The trial with the smallest error."""
    used: Trial
    """The trial of the result: the latest whose error is that of the best, within a quarter and its
    noise.
    """
    reason: str
    """Reason why learning ended."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Learning:
    """Result of learning."""

    waveform: Waveform
    """The learned period, of all axes."""
    axes: Mapping[str, LearnedAxis]
    """Trials by axis."""
    settings: LearningSettings
    """The settings."""
    notes: tuple[str, ...] = field(default=())
    """Notes for the report."""


ResponseOf = Callable[[Array], Complex]

#: Largest error of an accepted trial over that of the best one, plus the noise.
_WORSE = 1.25
#: A change this many times above its noise corrects the model of the response.
_CLEAR = 10.0
#: Highest learned frequency over the lowest mode.
_BEYOND = 1.3
#: Highest learned frequency over the fastest cycles of the identification, for a model without
#: mode.
_UNSEEN = 6.0


def mean_error(
    record: Record, column: str | int, reference: Trajectory, axis: str, periods: int
) -> tuple[Array, Complex]:
    """Return the mean error of the last periods of a record, and its noise by harmonic.

    Reference less reading at the samples of the reference [m], shape (n,), and the standard
    deviation of each harmonic, as `numpy.fft.rfft` counts them [m], shape (n // 2 + 1). Time 0 of
    the record is the first sample of a period.
    """
    rate = record.sample_rate_hz
    size = samples_of_period(reference, rate)
    values = record.channel(column).values
    if values.size < periods * size:
        raise RecordError(
            f"the record has {values.size / size:.3g} periods, and the average needs {periods}: "
            "record more, or average fewer"
        )
    first = values.size - periods * size
    spectra = np.fft.rfft(values[first:].reshape(periods, size), axis=1)
    f = np.arange(size // 2 + 1) / reference.period
    # back to where a period begins
    turn = np.exp(-2j * np.pi * f * float(record.time[first]))
    spectra = spectra * turn / size
    mean = spectra.mean(axis=0)
    noise = np.sqrt(np.mean(np.abs(spectra - mean) ** 2, axis=0) / (periods - 1))
    n = reference.size
    common = min(mean.size, n // 2 + 1)
    spectrum, spread = np.zeros(n // 2 + 1, np.complex128), np.zeros(n // 2 + 1)
    spectrum[:common], spread[:common] = mean[:common] * n, noise[:common] * n
    target = at_times(reference, axis, reference.time)
    error = np.asarray(target - np.fft.irfft(spectrum, n), dtype=np.float64)
    return error, spread.astype(np.complex128)


class AxisLearner:
    """State of the learning of one axis.

    The model is that of the drive, or the response of the reading to the learned command. With a
    servo the learned voltages are added to its own; without one, the axis is in open loop.
    """

    def __init__(
        self,
        reference: Trajectory,
        start: Waveform,
        model: Mapping[str, DriveModel | ResponseOf],
        axis: str,
        how: LearningSettings,
        limits: AxisLimits | None,
        servo: ServoSettings | None = None,
    ) -> None:
        if axis not in start.values or axis not in model:
            raise ModelError(
                f"axis '{axis}' of the trajectory needs a start and a model to learn from"
            )
        if start.size != reference.size or start.sample_rate_hz != reference.sample_rate_hz:
            raise ModelError(
                f"the start must be one period of the trajectory, {reference.size} samples at "
                f"{reference.sample_rate_hz:g} Hz, got {start.size} at {start.sample_rate_hz:g} Hz"
            )
        if servo is not None:
            # the integral of the control determines the mean: learning cannot change it
            how = replace(how, constant=False)
        self.how, self.limits, self.quantity = how, limits, start.quantity
        self.rate, self.size = reference.sample_rate_hz, reference.size
        axis_model = model[axis]
        self.drive = axis_model if isinstance(axis_model, DriveModel) else None
        if self.drive is not None and start.quantity != "voltage":
            raise ModelError(
                "the model of a drive describes the effect of voltages: to learn targets of a "
                "position control, give the response of the closed loop"
            )
        if servo is not None and self.drive is None:
            raise ModelError(
                "learning of voltages that are added to those of a control needs the model of the "
                f"drive: give the model of axis '{axis}', or a response and no control"
            )
        self.f: Array = np.asarray(np.fft.rfftfreq(self.size, 1.0 / self.rate), np.float64)
        self.learned = self._band(axis_model)
        self.inverse = np.zeros(self.f.size, dtype=np.complex128)
        response = axis_model(self.f[self.learned]) if callable(axis_model) else chain_response(
            axis_model, self.f[self.learned]
        )  # fmt: skip
        if servo is not None and self.drive is not None:
            # the control reduces the effect of the added voltages by its sensitivity
            response = response * _sensitivity(self.drive, servo, self.f[self.learned], self.rate)
        self.response = np.ones(self.f.size, dtype=np.complex128)
        self.response[self.learned] = response
        self.gain = np.ones(self.f.size, dtype=np.complex128)
        self.inverse[self.learned] = _cautious(axis_model, self.f[self.learned], how) / response
        self.values = np.asarray(start.values[axis], dtype=np.float64)
        self.x = self.values if self.drive is None else steady_output(self.drive, self.values)
        self.good_values, self.good_x = self.values, self.x
        self.good_error: Array | None = None
        self.good_noise: Complex = np.zeros(self.f.size, dtype=np.complex128)
        self.step = how.step
        self.trials: list[Trial] = []
        self.first: tuple[Array, Trial]
        self.best: Trial | None = None
        self.good: Trial | None = None
        self.reason = ""
        self.notes: list[str] = []

    def evaluate(self, number: int, error: Array, noise: Complex) -> None:
        """Accept or reject a trial."""
        if not self.how.constant:
            error = error - float(np.mean(error))
        band = np.fft.rfft(error)
        inside = np.asarray(np.fft.irfft(np.where(self.learned, band, 0.0), self.size))
        rms = float(np.sqrt(np.mean(inside**2)))
        spread = np.abs(noise) * self.learned / self.size
        level = float(np.sqrt(spread[0] ** 2 + 2.0 * np.sum(spread[1:] ** 2)))
        best = self.best
        allowed = math.inf if best is None else _WORSE * best.rms + 2.0 * max(level, best.noise)
        accepted = rms <= allowed
        self.step = min(2.0 * self.step, self.how.step) if accepted else 0.5 * self.step
        stands_out = self.learned & (np.abs(band) > self.how.noise_factor * np.abs(noise))
        trial = Trial(
            number=number, rms=rms, largest=float(np.max(np.abs(inside))), noise=level,
            step=self.step, accepted=accepted, harmonics=int(stands_out.sum()),
        )  # fmt: skip
        self.trials.append(trial)
        if best is None:
            self.first = self.values, trial
        if accepted:
            self._refine(error, noise)
            # the latest accepted one: the drive creeps, and the best may be outdated
            self.good, self.good_values, self.good_x = trial, self.values, self.x
            self.good_error, self.good_noise = error, noise
        if best is None or rms < best.rms:
            self.best = trial
        if not stands_out.any() or rms <= level * min(self.how.noise_factor, 1.0):
            self.reason = "the remaining error is noise"
        elif self.step < 1e-3 * self.how.step:
            self.reason = "smaller steps gave no improvement"

    def _refine(self, error: Array, noise: Complex) -> None:
        """Correct the model of the response where the effect of a change exceeds the noise."""
        if self.good_error is None:
            return
        effect = np.fft.rfft(self.good_error - error)
        change = np.fft.rfft(self.x - self.good_x)
        clear = np.abs(effect) > _CLEAR * (np.abs(noise) + np.abs(self.good_noise))
        clear &= self.learned & (np.abs(change) > 0.0)
        ratio = effect[clear] / (change[clear] * self.response[clear])
        # a ratio beyond the expected model error has another cause
        likely = np.abs(ratio - 1.0) <= self.how.model_error
        harmonics = np.flatnonzero(clear)[likely]
        self.gain[harmonics] = 0.5 * (self.gain[harmonics] + ratio[likely])

    def next(self) -> Array:
        """Return the next trial, from the last accepted one: one period [V, or m].

        `LimitError` where it would be faster than the axis allows.
        """
        if self.reason or self.good_error is None:
            self.values, self.x = self.good_values, self.good_x
            return self.values
        error = np.fft.rfft(self.good_error)
        size2 = np.maximum(np.abs(error) ** 2, 1e-300)
        weight = np.clip(1.0 - np.abs(self.good_noise) ** 2 / size2, 0.0, 1.0)
        inverse = self.inverse / self.gain
        change = np.fft.irfft(self.step * weight * inverse * error, self.size)
        self.x = self.good_x + change
        self.values = self._values()
        return self.values

    def selected(self) -> tuple[Array, Trial]:
        """Return the latest accepted trial, or the start where no trial was better."""
        assert self.good is not None
        if self.good.rms < self.first[1].rms:
            return self.good_values, self.good
        return self.first

    def result(self) -> LearnedAxis:
        """Return all trials."""
        assert self.best is not None
        assert self.good is not None
        return LearnedAxis(
            trials=tuple(self.trials), best=self.best, used=self.selected()[1],
            reason=self.reason or "all trials were run",
        )  # fmt: skip

    def _values(self) -> Array:
        """Return the command for the output of the hysteresis, or the target, within limits."""
        limits = self.limits
        if self.drive is not None:
            inverse = steady_input(self.drive, self.x, None if limits is None else limits.voltage)
            values, beyond = inverse.command, int(inverse.missed.sum())
            if beyond:
                self.notes.append(
                    f"{beyond} samples of a trial were outside the range of the drive"
                )
        else:
            values = self.x
            bounds = None if limits is None else getattr(limits, self.quantity)
            if bounds is not None:
                values = np.clip(values, *bounds)
        largest = None if limits is None else (
            limits.slew if self.quantity == "voltage" else limits.speed
        )  # fmt: skip
        if largest is not None:
            steepest = float(np.max(np.abs(np.diff(np.append(values, values[0]))))) * self.rate
            if steepest > largest:
                unit = "V/s" if self.quantity == "voltage" else "m/s"
                raise LimitError(
                    f"the learned command would change at {steepest:.4g} {unit}, and its limit is "
                    f"{largest:.4g} {unit}: lower the rate of the motion, or make it smaller"
                )
        return values

    def _band(self, model: DriveModel | ResponseOf) -> NDArray[np.bool_]:
        highest = self.how.band_hz
        if highest is None:
            highest = 0.25 * self.rate
            if isinstance(model, DriveModel) and model.modes is not None:
                highest = min(highest, _BEYOND * min(model.modes.frequency_hz))
            elif isinstance(model, DriveModel) and model.validity is not None:
                # an unidentified mode may be anywhere above
                fastest = max(model.validity.rate_range_hz[1], self.rate / self.size)
                highest = min(highest, _UNSEEN * fastest)
        learned = (self.f <= highest) & (self.f < 0.5 * self.rate)
        if not self.how.constant:
            learned[0] = False
        if not learned[1:].any():
            raise ModelError(
                f"no harmonic of the trajectory is below {highest:.4g} Hz: give a wider band"
            )
        return learned


def _sensitivity(drive: DriveModel, servo: ServoSettings, f: Array, rate: float) -> Complex:
    """Return the sensitivity of a control at the mean slope of its drive."""
    loop = servo.response(f, rate) * loop_plant(drive, rate).response(f)
    return np.asarray(1.0 / (1.0 + loop), dtype=np.complex128)


def _cautious(model: DriveModel | ResponseOf, f: Array, settings: LearningSettings) -> Array:
    """Return the factor of each step that the uncertainty of the modes allows."""
    if not isinstance(model, DriveModel) or model.modes is None or not settings.frequency_error:
        return np.ones(f.size)
    scattered = [
        replace(model.modes, frequency_hz=[s * m for m in model.modes.frequency_hz])
        for s in (1.0 - settings.frequency_error, 1.0 + settings.frequency_error)
    ]
    nominal = model.modes.frequency_response(f)
    change = np.max([np.abs(m.frequency_response(f) / nominal - 1.0) for m in scattered], axis=0)
    return np.asarray(np.minimum(1.0, settings.model_error / np.maximum(change, 1e-12)))


def learn(
    run: Callable[[Waveform], Record],
    reference: Trajectory,
    start: Waveform,
    model: Mapping[str, DriveModel | ResponseOf],
    settings: LearningSettings | None = None,
    *,
    limits: Mapping[str, AxisLimits] | None = None,
    columns: Mapping[str, str] | None = None,
    servo: Mapping[str, ServoSettings] | None = None,
) -> Learning:
    """Learn the command that makes a stage follow a periodic trajectory.

    Parameters
    ----------
    run : callable
        Repeats one period and returns a record that ends with the periods to be averaged, without
        the settling ones before them. Time 0 of the record is the first sample of a period.
    reference : Trajectory
        The reference.
    start : Waveform
        One period to begin with, at the rate of the reference: voltages, or targets of a control.
    model : Mapping
        By axis: the identified drive, for voltages in open loop; otherwise the response of the
        reading to the command, a function from frequencies [Hz] to complex values.
    settings : LearningSettings, optional
        Settings of learning.
    limits : Mapping, optional
        Limits by axis, which no trial exceeds.
    columns : Mapping, optional
        Column of the reading by axis (default: that with the name of the axis).
    servo : Mapping, optional
        Settings of the position control by axis, for voltages that are added to its own while it
        follows the trajectory; the trajectory then has the rate of the loop (default: open loop).

    Returns
    -------
    Learning
        The best period, and the errors of all trials.

    Raises
    ------
    ModelError
        Start and reference differ in length or rate, or an axis has no model.
    RecordError
        A record has too few periods.

    Notes
    -----
    Validity: learning follows the reading of the sensor. Mains pickup of the sensor is learned
    where the trajectory is synchronous with it, since it cannot be distinguished from a motion.
    Then run the periods of a trial in two halves, half a period of the mains apart, and return the
    mean of both; the control must not follow the mains either (`tune` with ``mains_hz``).

    A drive that cycles for minutes creeps by about one part in a hundred. Motions need that much
    clearance from the ends of its range; otherwise the control saturates and the error grows.
    """
    options = settings or LearningSettings()
    limits_of, loops = limits or {}, servo or {}
    axes = {a: AxisLearner(reference, start, model, a, options, limits_of.get(a), loops.get(a))
            for a in reference.axes}  # fmt: skip
    trial = start
    for number in range(options.trials + 1):
        record = run(trial)
        for axis, learner in axes.items():
            column = (columns or {}).get(axis, axis)
            error, noise = mean_error(record, column, reference, axis, options.periods)
            learner.evaluate(number, error, noise)
        if number == options.trials or all(learner.reason for learner in axes.values()):
            break
        trial = Waveform(
            values={a: learner.next() for a, learner in axes.items()},
            sample_rate_hz=start.sample_rate_hz,
            quantity=start.quantity,
        )
    best = Waveform(
        values={a: learner.selected()[0] for a, learner in axes.items()},
        sample_rate_hz=start.sample_rate_hz,
        quantity=start.quantity,
    )
    return Learning(
        waveform=best,
        axes={a: learner.result() for a, learner in axes.items()},
        settings=options,
        notes=tuple(note for learner in axes.values() for note in learner.notes),
    )
