"""A command that is ready to run: its samples, and which of them count."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import PlanError
from flexstage.instruments.waveform import Quantity, Waveform

#: More samples do not fit into memory.
_MOST_SAMPLES = 5_000_000


def require_size(size: float, kind: str) -> None:
    """Refuse a command that would not fit into memory, before it is made."""
    if size > _MOST_SAMPLES:
        raise PlanError(
            f"the command '{kind}' would have {size:.0f} samples, and at most {_MOST_SAMPLES} are "
            "allowed: make it shorter, or lower command_rate"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Strike:
    """Blows of a hammer."""

    axis: str
    """The axis along which the stage is struck."""
    hits: int
    """How often."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CommandWaveform:
    """What axes are to do."""

    waveform: Waveform
    """The samples."""
    cycles: int = 1
    """How often they are run."""
    first: int = 0
    """Samples at its beginning that prepare, and are not evaluated, over all cycles."""
    period: int = 0
    """Samples of a cycle; 0 where there are none."""
    reference: Mapping[str, Array]
    """Positions that shall be followed, by axis [m], shape (n,); empty for a mere command."""
    corner: Array | None = None
    """Number of the corner at which both axes rest, -1 on the way, shape (n,)."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""

    @property
    def axes(self) -> tuple[str, ...]:
        """The axes that it moves."""
        return tuple(self.waveform.values)

    @property
    def quantity(self) -> Quantity:
        """Whether voltages or positions are commanded."""
        return self.waveform.quantity

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return self.waveform.duration * self.cycles

    def at(self, axis: str, time: Array) -> Array:
        """Return the command of an axis at times from its first sample [V, or m].

        Before its beginning it is that of the first sample, after its end that of the last.
        """
        return self._at(self.waveform.values[axis], time)

    def reference_at(self, axis: str, time: Array) -> Array:
        """Return the positions that an axis shall follow at times from the first sample [m]."""
        return self._at(self.reference[axis], time)

    def corner_at(self, time: Array) -> Array:
        """Return the number of the corner at some times, -1 on the way."""
        if self.corner is None:
            return np.full(time.size, -1.0)
        k = np.clip(np.floor(time * self.waveform.sample_rate_hz + 1e-6), 0, self.corner.size - 1)
        return self.corner[k.astype(np.intp)]

    def _at(self, values: Array, time: Array) -> Array:
        k = np.asarray(time) * self.waveform.sample_rate_hz
        # a time on a sample is that sample, whatever rounding says
        k = np.where(np.abs(k - np.round(k)) < 1e-6, np.round(k), k)
        n = values.size
        k = np.clip(k, 0.0, n * self.cycles - 1.0)
        # from the last sample to the first of the next cycle the way is straight too
        return np.interp(k % n, np.arange(n + 1), np.append(values, values[0]))
