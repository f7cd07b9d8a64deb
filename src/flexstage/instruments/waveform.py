"""A waveform: samples of one quantity for one or more axes, all at one rate."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError

Quantity = Literal["voltage", "position"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Waveform:
    """What axes are to follow.

    Examples
    --------
    >>> ramp = Waveform(values={"x": np.array([0.0, 60.0, 120.0])}, sample_rate_hz=10.0,
    ...                 quantity="voltage")
    >>> ramp.duration, ramp.largest_rate("x")
    (0.3, 600.0)
    """

    values: Mapping[str, Array]
    """Samples by axis [V, or m], shape (n,), n at least 2."""
    sample_rate_hz: float
    """Samples in a second [Hz]; straight lines between them."""
    quantity: Quantity
    """Whether the values are voltages of the drives, or positions under control."""

    def __post_init__(self) -> None:
        if self.quantity not in ("voltage", "position"):
            raise ModelError(
                f"a waveform is made of 'voltage' or 'position', got {self.quantity!r}"
            )
        if not 0.0 < self.sample_rate_hz < float("inf"):
            raise ModelError(
                f"the rate of a waveform must be positive and finite, got {self.sample_rate_hz!r}"
            )
        sizes = {np.shape(v) for v in self.values.values()}
        if len(sizes) != 1 or len(next(iter(sizes))) != 1 or next(iter(sizes))[0] < 2:
            raise ModelError(
                "a waveform needs one axis or more, each with the same number of samples, 2 at "
                f"least, got {sorted(sizes) or 'none'}"
            )
        for name, v in self.values.items():
            bad = np.flatnonzero(~np.isfinite(v))
            if bad.size:
                raise ModelError(
                    f"the waveform of axis '{name}' has the value {v[bad[0]]} at sample {bad[0]}: "
                    "every sample must be finite"
                )

    @property
    def size(self) -> int:
        """Number of samples."""
        return len(next(iter(self.values.values())))

    @property
    def duration(self) -> float:
        """Time that it takes [s], the step after the last sample included."""
        return self.size / self.sample_rate_hz

    def largest_rate(self, axis: str, *, closed: bool = False) -> float:
        """Return the largest slope of an axis [V/s, or m/s].

        Where the waveform is repeated (`closed`), the step from its end to its start counts.
        """
        v = self.values[axis]
        steps = np.diff(np.append(v, v[0]) if closed else v)
        return float(np.max(np.abs(steps))) * self.sample_rate_hz
