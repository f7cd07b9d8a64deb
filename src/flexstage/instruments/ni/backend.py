"""What is needed of a driver of NI cards, so that it can be the real one or a simulated one.

All voltages are those at the terminals of the card, channels first: shape (channels, n).
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexstage.instruments.ni.setup import DriveOutput, SensorInput

__all__ = ["InputTask", "NiBackend", "OutputTask"]

Array = NDArray[np.float64]


class InputTask(Protocol):
    """Inputs that are sampled by a clock without end, once started."""

    @property
    def rate_hz(self) -> float:
        """Rate that the card keeps [Hz]."""
        ...

    def start(self) -> None:
        """Start the clock."""
        ...

    def available(self) -> int:
        """Return how many samples of each input wait to be read."""
        ...

    def read(self, count: int) -> Array:
        """Return the oldest samples that were not read.

        Parameters
        ----------
        count : int
            How many of each input.

        Returns
        -------
        numpy.ndarray
            Voltages [V], shape (channels, count).
        """
        ...

    def close(self) -> None:
        """Stop the clock and give the inputs free."""
        ...


class OutputTask(Protocol):
    """Samples that are put out once by a clock; the outputs hold the last one."""

    def start(self) -> None:
        """Begin, or wait for the start of the inputs where it was opened so."""
        ...

    def done(self) -> bool:
        """Say whether the last sample was put out."""
        ...

    def stop(self) -> None:
        """Stop where it is, from any thread."""
        ...

    def generated(self) -> int:
        """Return how many samples were put out; -1 where nobody knows."""
        ...

    def close(self) -> None:
        """Give the outputs free; they hold what they give."""
        ...


class NiBackend(Protocol):
    """A driver of NI cards."""

    @property
    def simulated(self) -> bool:
        """Whether there is no card behind it."""
        ...

    @property
    def note(self) -> str:
        """What a reader of a record should know of the driver."""
        ...

    def identify(self, device: str) -> tuple[str, str]:
        """Return the type and the serial number of a card.

        Parameters
        ----------
        device : str
            Its name.

        Returns
        -------
        tuple of str
            Both.

        Raises
        ------
        NotConnectedError
            There is no such card.
        """
        ...

    def read_now(self, inputs: Sequence[SensorInput]) -> Array:
        """Return what stands at inputs now.

        Parameters
        ----------
        inputs : sequence of SensorInput
            The inputs.

        Returns
        -------
        numpy.ndarray
            Their voltages [V], shape (channels,).
        """
        ...

    def write_now(self, outputs: Sequence[DriveOutput], volts: Array) -> None:
        """Put out voltages now.

        Parameters
        ----------
        outputs : sequence of DriveOutput
            The outputs.
        volts : numpy.ndarray
            Their voltages [V], shape (channels,).
        """
        ...

    def kept_rate(self, inputs: Sequence[SensorInput], rate_hz: float) -> float:
        """Return the rate that the card would keep for one that is asked for.

        Parameters
        ----------
        inputs : sequence of SensorInput
            The inputs.
        rate_hz : float
            Rate that is wanted [Hz].

        Returns
        -------
        float
            The rate [Hz].
        """
        ...

    def open_input(self, inputs: Sequence[SensorInput], rate_hz: float, buffer: int) -> InputTask:
        """Prepare inputs.

        Parameters
        ----------
        inputs : sequence of SensorInput
            The inputs.
        rate_hz : float
            Rate of samples [Hz].
        buffer : int
            How many samples of each are kept until they are read.

        Returns
        -------
        InputTask
            The task.
        """
        ...

    def open_output(
        self,
        outputs: Sequence[DriveOutput],
        volts: Array,
        rate_hz: float,
        *,
        clock: InputTask | None,
        wait_for_start: bool,
    ) -> OutputTask:
        """Prepare outputs.

        Parameters
        ----------
        outputs : sequence of DriveOutput
            The outputs.
        volts : numpy.ndarray
            What they put out [V], shape (channels, n).
        rate_hz : float
            Rate of their own clock [Hz].
        clock : InputTask or None
            Inputs with whose clock they go; with their own where there are none.
        wait_for_start : bool
            Whether the first sample is put out at the instant of the first sample of the inputs,
            which are started later.

        Returns
        -------
        OutputTask
            The task.
        """
        ...

    def pause(self, seconds: float) -> None:
        """Let time pass.

        Parameters
        ----------
        seconds : float
            How much [s].
        """
        ...

    def close(self) -> None:
        """Give all free."""
        ...
