"""How it is learned, and what was learned."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from flexstage.errors import ModelError
from flexstage.instruments.waveform import Waveform


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
