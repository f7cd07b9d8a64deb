"""Waveforms of a simulated controller."""

from collections.abc import Collection, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["WaveDevice"]

Array = NDArray[np.float64]


class WaveDevice(Protocol):
    """Wave tables and generators, as a server of commands sees them."""

    @property
    def wave_tables(self) -> int:
        """Number of tables."""
        ...

    @property
    def wave_capacity(self) -> int:
        """Samples over all tables."""
        ...

    def wave(self, table: int) -> Array:
        """Return the samples of a table [m or V: whichever the axis takes that runs it].

        Parameters
        ----------
        table : int
            Number of the table, from 1.

        Returns
        -------
        numpy.ndarray
            The samples.
        """
        ...

    def set_wave(self, table: int, samples: Array) -> None:
        """Replace the samples of a table; an empty sequence clears it.

        Parameters
        ----------
        table : int
            Number of the table, from 1.
        samples : numpy.ndarray
            Samples, shape (n,).
        """
        ...

    def wave_rate_divider(self) -> int:
        """Return how many samples of the loop one sample of a table lasts.

        Returns
        -------
        int
            The number.
        """
        ...

    def set_wave_rate_divider(self, divider: int) -> None:
        """Set it; straight lines join the samples.

        Parameters
        ----------
        divider : int
            Number of samples of the loop.
        """
        ...

    def wave_choice(self, axis: str) -> tuple[int, int]:
        """Return the table of an axis and that of its feedforward, 0 for none.

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        tuple of int
            Both numbers.
        """
        ...

    def choose_wave(self, axis: str, table: int, feedforward: int = 0) -> None:
        """Choose them.

        Parameters
        ----------
        axis : str
            The axis.
        table : int
            Number of the table, from 1.
        feedforward : int
            Number of the table of its feedforward; 0 for none.
        """
        ...

    def wave_cycles(self, axis: str) -> int:
        """Return how often the waveform of an axis is run; 0 for endlessly.

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        int
            The number.
        """
        ...

    def set_wave_cycles(self, axis: str, cycles: int) -> None:
        """Set it.

        Parameters
        ----------
        axis : str
            The axis.
        cycles : int
            How often it is run; 0 for endlessly.
        """
        ...

    def start_waves(self, axes: Sequence[str], onward: Collection[str] = ()) -> None:
        """Check every sample of the chosen tables against the limits, then start all in step.

        Parameters
        ----------
        axes : sequence of str
            The axes.
        onward : collection of str
            Those whose cycles each begin where the one before has ended.
        """
        ...

    def stop_waves(self, axes: Sequence[str]) -> None:
        """Stop them; the axes hold where they are.

        Parameters
        ----------
        axes : sequence of str
            The axes.
        """
        ...

    def wave_running(self, axis: str) -> bool:
        """Say whether a waveform runs on an axis.

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        bool
            Whether it is so.
        """
        ...
