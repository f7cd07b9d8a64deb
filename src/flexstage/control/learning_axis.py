"""Learning of one axis: how it is done, what is tried next and taken back, what was learned."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import LimitError, ModelError, RecordError
from flexstage.control.loop_plant import loop_plant
from flexstage.control.tracking_run import at_times, samples_of_period
from flexstage.control.trajectory import Trajectory
from flexstage.hysteresis import DriveModel
from flexstage.hysteresis.limited_inverse import chain_response, steady_input, steady_output
from flexstage.instruments.protocol import Waveform
from flexstage.records import Record
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import ServoSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningSettings:
    """How it is learned.

    Raises
    ------
    ModelError
        A setting is out of its range.
    """

    trials: int = 5
    """Most trials after the first run."""
    step: float = 0.9
    """Part of the error that is taken away in a trial [1], above 0 and at most 1."""
    model_error: float = 0.5
    """Largest error of the model's response that is reckoned with [1], below 1."""
    band_hz: float | None = None
    """Highest frequency that is learned [Hz]. Where not given, 1.3 times the lowest mode of a
    drive, or 6 times the fastest cycles that it was identified on if none was found; not above a
    quarter of the sample rate.
    """
    periods: int = 10
    """Periods at the end of a record that are averaged, 2 or more."""
    noise_factor: float = 2.5
    """It stops when no harmonic stands out of its noise by more than this factor [1]; 0 makes all
    trials.
    """
    constant: bool = True
    """Whether the mean position is learned as well."""
    frequency_error: float = 0.005
    """How far natural frequencies may be from the model's, over themselves [1]: harmonics near a
    mode are learned by smaller steps for it.
    """

    def __post_init__(self) -> None:
        if not (self.trials >= 0 and self.periods >= 2):
            raise ModelError(
                "learning takes 0 trials or more, of 2 periods or more, got "
                f"{self.trials!r} and {self.periods!r}"
            )
        if not (0.0 < self.step <= 1.0 and 0.0 <= self.model_error < 1.0):
            raise ModelError(
                "the step must be above 0 and at most 1 and the model error below 1, or it is not "
                f"known to converge; got {self.step!r} and {self.model_error!r}"
            )

    @property
    def contraction(self) -> float:
        """Largest factor by which the error of a harmonic shrinks in a trial, away from noise."""
        return 1.0 - self.step + self.step * self.model_error


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One trial of one axis."""

    number: int
    """Its number; 0 is the run with what was there at the start."""
    rms: float
    """Root mean square of the mean period's error [m]."""
    largest: float
    """Its largest value [m]."""
    noise: float
    """Root mean square of what the mean period still has of noise [m]."""
    step: float
    """The step with which the next trial is made [1]."""
    kept: bool
    """Whether it is the best so far."""
    harmonics: int
    """Harmonics that stand out of the noise."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LearnedAxis:
    """What was learned of one axis."""

    trials: tuple[Trial, ...]
    """All trials."""
    best: Trial
    """The one with the smallest error."""
    used: Trial
    """The one that is returned: the latest that is as good as the best, within a quarter and its
    noise.
    """
    reason: str
    """Why it ended."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Learning:
    """What was learned."""

    waveform: Waveform
    """The best one period, of all axes."""
    axes: Mapping[str, LearnedAxis]
    """Trials by axis."""
    settings: LearningSettings
    """How it was learned."""
    notes: tuple[str, ...] = field(default=())
    """What is to be told."""


ResponseOf = Callable[[Array], Complex]

#: A trial is as good as the best one with this many times its error, beside the noise.
_WORSE = 1.25
#: A change this many times above its noise tells how the drive really responds.
_CLEAR = 10.0
#: What is learned reaches this far beyond the lowest mode.
_BEYOND = 1.3
#: ... or, where the model has no mode, to this many times the fastest cycles it was identified on.
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
            f"the record has {values.size / size:.3g} periods, and {periods} are to be averaged: "
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
    kept = min(mean.size, n // 2 + 1)
    made, spread = np.zeros(n // 2 + 1, np.complex128), np.zeros(n // 2 + 1)
    made[:kept], spread[:kept] = mean[:kept] * n, noise[:kept] * n
    wanted = at_times(reference, axis, reference.time)
    error = np.asarray(wanted - np.fft.irfft(made, n), dtype=np.float64)
    return error, spread.astype(np.complex128)


class AxisLearner:
    """What one axis has learned so far.

    The model is that of the drive, or the response of the reading to what is learned. With a servo
    the learned voltages are added to its own; open loop where there is none.
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
            # the integral of the control holds the mean: what is learned cannot move it
            how = replace(how, constant=False)
        self.how, self.limits, self.quantity = how, limits, start.quantity
        self.rate, self.size = reference.sample_rate_hz, reference.size
        own = model[axis]
        self.drive = own if isinstance(own, DriveModel) else None
        if self.drive is not None and start.quantity != "voltage":
            raise ModelError(
                "the model of a drive describes the effect of voltages: to learn targets of a "
                "position control, give the response of the closed loop"
            )
        if servo is not None and self.drive is None:
            raise ModelError(
                "voltages that are added to those of a control are learned through the model of "
                f"the drive: give the model of axis '{axis}', or a response and no control"
            )
        self.f: Array = np.asarray(np.fft.rfftfreq(self.size, 1.0 / self.rate), np.float64)
        self.learned = self._band(own)
        self.inverse = np.zeros(self.f.size, dtype=np.complex128)
        response = own(self.f[self.learned]) if callable(own) else chain_response(
            own, self.f[self.learned]
        )  # fmt: skip
        if servo is not None and self.drive is not None:
            # of what is added, the control takes back what it sees
            response = response * _left(self.drive, servo, self.f[self.learned], self.rate)
        self.response = np.ones(self.f.size, dtype=np.complex128)
        self.response[self.learned] = response
        self.gain = np.ones(self.f.size, dtype=np.complex128)
        self.inverse[self.learned] = _cautious(own, self.f[self.learned], how) / response
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

    def take(self, number: int, error: Array, noise: Complex) -> None:
        """Look at a trial: keep it, or take it back."""
        if not self.how.constant:
            error = error - float(np.mean(error))
        band = np.fft.rfft(error)
        inside = np.asarray(np.fft.irfft(np.where(self.learned, band, 0.0), self.size))
        rms = float(np.sqrt(np.mean(inside**2)))
        spread = np.abs(noise) * self.learned / self.size
        level = float(np.sqrt(spread[0] ** 2 + 2.0 * np.sum(spread[1:] ** 2)))
        best = self.best
        allowed = math.inf if best is None else _WORSE * best.rms + 2.0 * max(level, best.noise)
        better = rms <= allowed
        self.step = min(2.0 * self.step, self.how.step) if better else 0.5 * self.step
        stands_out = self.learned & (np.abs(band) > self.how.noise_factor * np.abs(noise))
        made = Trial(
            number=number, rms=rms, largest=float(np.max(np.abs(inside))), noise=level,
            step=self.step, kept=better, harmonics=int(stands_out.sum()),
        )  # fmt: skip
        self.trials.append(made)
        if best is None:
            self.first = self.values, made
        if better:
            self._refine(error, noise)
            # the latest of the good ones: a drive creeps on, and the best of all may be of old
            self.good, self.good_values, self.good_x = made, self.values, self.x
            self.good_error, self.good_noise = error, noise
        if best is None or rms < best.rms:
            self.best = made
        if not stands_out.any() or rms <= level * min(self.how.noise_factor, 1.0):
            self.reason = "what is left is noise"
        elif self.step < 1e-3 * self.how.step:
            self.reason = "no smaller step was better"

    def _refine(self, error: Array, noise: Complex) -> None:
        """Learn how far the response is from the model's, where a change stood out of the noise."""
        if self.good_error is None:
            return
        came = np.fft.rfft(self.good_error - error)
        change = np.fft.rfft(self.x - self.good_x)
        clear = np.abs(came) > _CLEAR * (np.abs(noise) + np.abs(self.good_noise))
        clear &= self.learned & (np.abs(change) > 0.0)
        seen = came[clear] / (change[clear] * self.response[clear])
        # what the model error that is reckoned with cannot explain is taken for something else
        likely = np.abs(seen - 1.0) <= self.how.model_error
        at = np.flatnonzero(clear)[likely]
        self.gain[at] = 0.5 * (self.gain[at] + seen[likely])

    def next(self) -> Array:
        """Return what is tried next, from the best so far: one period [V, or m].

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

    def chosen(self) -> tuple[Array, Trial]:
        """Return the latest of the good trials, or the start where nothing was better."""
        assert self.good is not None
        if self.good.rms < self.first[1].rms:
            return self.good_values, self.good
        return self.first

    def result(self) -> LearnedAxis:
        """Return all trials."""
        assert self.best is not None
        assert self.good is not None
        return LearnedAxis(
            trials=tuple(self.trials), best=self.best, used=self.chosen()[1],
            reason=self.reason or "all trials were made",
        )  # fmt: skip

    def _values(self) -> Array:
        """From what the hysteresis has to give, or the target, to what is sent; within limits."""
        limits = self.limits
        if self.drive is not None:
            found = steady_input(self.drive, self.x, None if limits is None else limits.voltage)
            made, beyond = found.command, int(found.missed.sum())
            if beyond:
                self.notes.append(f"{beyond} samples of a trial were out of reach of the drive")
        else:
            made = self.x
            bounds = None if limits is None else getattr(limits, self.quantity)
            if bounds is not None:
                made = np.clip(made, *bounds)
        most = None if limits is None else (
            limits.slew if self.quantity == "voltage" else limits.speed
        )  # fmt: skip
        if most is not None:
            steepest = float(np.max(np.abs(np.diff(np.append(made, made[0]))))) * self.rate
            if steepest > most:
                raise LimitError(
                    f"what was learned would change by {steepest:.4g} in a second, at most "
                    f"{most:.4g} is allowed: lower the rate of the motion, or make it smaller"
                )
        return made

    def _band(self, own: DriveModel | ResponseOf) -> NDArray[np.bool_]:
        highest = self.how.band_hz
        if highest is None:
            highest = 0.25 * self.rate
            if isinstance(own, DriveModel) and own.modes is not None:
                highest = min(highest, _BEYOND * min(own.modes.frequency_hz))
            elif isinstance(own, DriveModel) and own.validity is not None:
                # a mode that was not seen may be anywhere above
                fastest = max(own.validity.rate_range_hz[1], self.rate / self.size)
                highest = min(highest, _UNSEEN * fastest)
        learned = (self.f <= highest) & (self.f < 0.5 * self.rate)
        if not self.how.constant:
            learned[0] = False
        if not learned[1:].any():
            raise ModelError(
                f"no harmonic of the trajectory lies below {highest:.4g} Hz: give a wider band"
            )
        return learned


def _left(drive: DriveModel, servo: ServoSettings, f: Array, rate: float) -> Complex:
    """Return the sensitivity of a control at the mean slope of its drive."""
    loop = servo.response(f, rate) * loop_plant(drive, rate).response(f)
    return np.asarray(1.0 / (1.0 + loop), dtype=np.complex128)


def _cautious(own: DriveModel | ResponseOf, f: Array, how: LearningSettings) -> Array:
    """Return the part of each step that the known frequencies of the modes allow."""
    if not isinstance(own, DriveModel) or own.modes is None or not how.frequency_error:
        return np.ones(f.size)
    moved = [
        replace(own.modes, frequency_hz=[s * m for m in own.modes.frequency_hz])
        for s in (1.0 - how.frequency_error, 1.0 + how.frequency_error)
    ]
    here = own.modes.frequency_response(f)
    change = np.max([np.abs(m.frequency_response(f) / here - 1.0) for m in moved], axis=0)
    return np.asarray(np.minimum(1.0, how.model_error / np.maximum(change, 1e-12)))
