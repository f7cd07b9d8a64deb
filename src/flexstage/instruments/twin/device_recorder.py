"""The data recorder of a simulated controller."""

from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from flexstage.instruments.protocol import Signal

__all__ = ["RecordDevice"]

Array = NDArray[np.float64]


class RecordDevice(Protocol):
    """Tables of the recorder, as a server of commands sees them."""

    @property
    def record_tables(self) -> int:
        """Number of tables of the recorder."""
        ...

    @property
    def record_capacity(self) -> int:
        """Samples of each of them."""
        ...

    def record_signal(self, table: int) -> Signal | None:
        """Return what a table records; None for nothing.

        Parameters
        ----------
        table : int
            Number of the table, from 1.

        Returns
        -------
        Signal or None
            What it records.
        """
        ...

    def set_record_signal(self, table: int, signal: Signal | None) -> None:
        """Choose it; `Signal.source` is the identifier of an axis or the number of a channel.

        Parameters
        ----------
        table : int
            Number of the table, from 1.
        signal : Signal or None
            What to record; None for nothing.
        """
        ...

    def record_divider(self) -> int:
        """Return how many samples of the loop one sample of a record lasts.

        Returns
        -------
        int
            The number.
        """
        ...

    def set_record_divider(self, divider: int) -> None:
        """Set it.

        Parameters
        ----------
        divider : int
            Number of samples of the loop.
        """
        ...

    def arm_recorder(self, trigger: Literal["wave", "move", "now"]) -> None:
        """Start recording with the next waveform or blow, the next move, or now.

        Parameters
        ----------
        trigger : {"wave", "move", "now"}
            What starts it.
        """
        ...

    def recorded(self) -> int:
        """Return the number of samples that are there.

        Returns
        -------
        int
            The number.
        """
        ...

    def recording(self) -> bool:
        """Say whether the recorder runs.

        Returns
        -------
        bool
            Whether it is so.
        """
        ...

    def record(self, table: int, first: int, count: int) -> Array:
        """Return samples of a table, counted from 0.

        Parameters
        ----------
        table : int
            Number of the table, from 1.
        first : int
            Number of the first sample, from 0.
        count : int
            Number of samples.

        Returns
        -------
        numpy.ndarray
            The samples.
        """
        ...
