"""A command that is ready to run: its samples, and which of them count."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.instruments.waveform import Quantity, Waveform

__all__ = ["Command", "Strike"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Strike:
    """Blows of a hammer.

    Parameters
    ----------
    axis : str
        The axis along which the stage is struck.
    hits : int
        How often.
    """

    axis: str
    hits: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Command:
    """What axes are to do.

    Parameters
    ----------
    waveform : Waveform
        The samples.
    cycles : int
        How often they are run.
    first : int
        Samples at its beginning that prepare, and are not evaluated, over all cycles.
    period : int
        Samples of a cycle; 0 where there are none.
    reference : Mapping
        Positions that shall be followed, by axis [m], shape (n,); empty for a mere command.
    corner : numpy.ndarray, optional
        Number of the corner at which both axes rest, -1 on the way, shape (n,).
    notes : tuple of str
        What a reader should know.
    """

    waveform: Waveform
    cycles: int = 1
    first: int = 0
    period: int = 0
    reference: Mapping[str, Array]
    corner: Array | None = None
    notes: tuple[str, ...] = ()

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
        """Return the command of an axis at some times.

        Parameters
        ----------
        axis : str
            The axis.
        time : numpy.ndarray
            Times from its first sample [s], shape (n,).

        Returns
        -------
        numpy.ndarray
            The command [V, or m]; before its beginning that of the first sample, after its end that
            of the last.
        """
        return self._at(self.waveform.values[axis], time)

    def reference_at(self, axis: str, time: Array) -> Array:
        """Return the positions that an axis shall follow.

        Parameters
        ----------
        axis : str
            The axis.
        time : numpy.ndarray
            Times from the first sample [s], shape (n,).

        Returns
        -------
        numpy.ndarray
            The positions [m].
        """
        return self._at(self.reference[axis], time)

    def corner_at(self, time: Array) -> Array:
        """Return the number of the corner at some times, -1 on the way.

        Parameters
        ----------
        time : numpy.ndarray
            Times from the first sample [s], shape (n,).

        Returns
        -------
        numpy.ndarray
            The numbers.
        """
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
