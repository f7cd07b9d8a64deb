"""How a response is to be estimated: kinds of excitation and what is asked of each."""

from dataclasses import dataclass
from typing import Literal

from flexstage.errors import ModelError

Excitation = Literal["auto", "random", "periodic", "hammer", "step", "sweep"]


@dataclass(frozen=True, slots=True, kw_only=True)
class HitOptions:
    """How hits of a hammer, or steps, are found and cut out."""

    trigger: float = 0.1
    """Level that a hit rises above, as a share of the greatest of the record [1]."""
    pre_trigger: int | None = None
    """Samples before the level that belong to the hit; where not given, some more than the contact
    lasts.
    """
    bounce: float = 0.05
    """A second contact above this share of the peak makes a double hit [1]."""
    force_window: bool = False
    """Whether the force is set to zero after the contact."""
    exponential: float | None = None
    """What is left of an exponential window at the end of a hit [1]; no window where not given, as
    for a motion that has decayed by then.
    """

    def __post_init__(self) -> None:
        shares = {"trigger": self.trigger, "bounce": self.bounce, "exponential": self.exponential}
        for name, share in shares.items():
            if share is not None and not 0.0 < share < 1.0:
                raise ModelError(f"{name} is a share between 0 and 1, got {share!r}")
        if self.pre_trigger is not None and self.pre_trigger < 0:
            raise ModelError(f"samples before a hit are 0 or more, got {self.pre_trigger}")


@dataclass(frozen=True, slots=True, kw_only=True)
class PeriodOptions:
    """How the periods of a repeated excitation are cut out."""

    samples: int | None = None
    """Samples in a period; found where not given."""
    drop: int | None = None
    """Periods left out at the start, in which the motion settles; found where not given."""

    def __post_init__(self) -> None:
        if self.samples is not None and self.samples < 8:
            raise ModelError(f"a period has eight samples or more, got {self.samples}")
        if self.drop is not None and self.drop < 0:
            raise ModelError(f"the number of periods left out is 0 or more, got {self.drop}")
