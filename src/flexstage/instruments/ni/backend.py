"""What is needed of a driver of NI cards, so that it can be the real one or a simulated one.

All voltages are those at the terminals of the card, channels first: shape (channels, n).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from flexstage.arrays import Array
from flexstage.instruments.ni.setup import DriveOutput, NiSetup, SensorInput


@dataclass(frozen=True, slots=True, kw_only=True)
class CardInfo:
    """What the driver reports about a card.

    Examples
    --------
    >>> card = CardInfo(
    ...     vendor="NI", model="USB-6211", simulated=False, note="", single_rate_hz=250e3,
    ...     total_rate_hz=250e3, output_rate_hz=250e3, simultaneous=False,
    ... )
    >>> card.largest_rate_hz(4), card.rate_limit(4)
    (62500.0, '62500 Hz (250000 samples/s shared by 4 inputs)')
    """

    vendor: str
    """Who made it."""
    model: str
    """Which card it is."""
    serial_number: str = ""
    """Its serial number; empty where it has none."""
    simulated: bool
    """Whether there is no hardware behind it, so that nothing it gives was measured."""
    note: str
    """What a reader of a record should know of the driver."""
    single_rate_hz: float
    """Largest rate of a single input [Hz]."""
    total_rate_hz: float
    """Largest number of samples in a second of several inputs together [Hz]."""
    output_rate_hz: float
    """Largest rate of its outputs [Hz]; infinite where none is used."""
    simultaneous: bool
    """Whether each input has a converter of its own; else they share one by a multiplexer."""

    def largest_rate_hz(self, inputs: int) -> float:
        """Return the largest rate at which so many inputs, and the outputs in use, go together."""
        return min(self._input_rate_hz(inputs), self.output_rate_hz)

    def rate_limit(self, inputs: int) -> str:
        """Return the same rate as text, with what it is limited by."""
        rate = self.largest_rate_hz(inputs)
        if rate < self._input_rate_hz(inputs):
            return f"{rate:.6g} Hz (limit of its outputs)"
        if rate < self.single_rate_hz and not self.simultaneous:
            return f"{rate:.6g} Hz ({self.total_rate_hz:.6g} samples/s shared by {inputs} inputs)"
        return f"{rate:.6g} Hz (limit of its inputs)"

    def _input_rate_hz(self, inputs: int) -> float:
        shared = self.total_rate_hz / (1 if self.simultaneous else inputs)
        return min(self.single_rate_hz, shared if inputs > 1 else self.single_rate_hz)


class InputTask(Protocol):
    """Inputs that are sampled by a clock without end, once started."""

    @property
    def rate_hz(self) -> float:
        """Rate that the card keeps [Hz]."""
        ...

    @property
    def interval(self) -> float:
        """Time from one input's conversion to the next one's [s].

        Zero where all are converted at once, not a number where the driver does not report it.
        """
        ...

    def start(self) -> None:
        """Start the clock."""
        ...

    def available(self) -> int:
        """Return how many samples of each input wait to be read."""
        ...

    def read(self, count: int) -> Array:
        """Return the oldest samples that were not read [V], shape (channels, count)."""
        ...

    def close(self) -> None:
        """Stop the clock and give the inputs free."""
        ...


class OutputTask(Protocol):
    """Samples that are put out once by a clock; the outputs hold the last one."""

    def start(self) -> None:
        """Begin, with the next edge of the clock."""
        ...

    def done(self) -> bool:
        """Say whether the last sample was put out; after a stop, whether it was before."""
        ...

    def stop(self) -> None:
        """Stop where it is, from any thread."""
        ...

    def generated(self) -> int:
        """Return how many samples left the driver; -1 where it is not known.

        Up to the size of the card's memory they may be ahead of what was put out.
        """
        ...

    def close(self) -> None:
        """Give the outputs free; they hold what they give."""
        ...


class NiBackend(Protocol):
    """A driver of NI cards."""

    def describe(self, setup: NiSetup) -> CardInfo:
        """Ask the driver about a card, and whether its outputs can take the clock of its inputs."""
        ...

    def read_now(self, inputs: Sequence[SensorInput]) -> Array:
        """Return what stands at inputs now [V], shape (channels,)."""
        ...

    def write_now(self, outputs: Sequence[DriveOutput], volts: Array) -> None:
        """Put out voltages now [V], shape (channels,)."""
        ...

    def read_outputs(self, outputs: Sequence[DriveOutput]) -> Array:
        """Measure what outputs give, by internal channels of the card [V], shape (channels,).

        Not a number where the card has none; refused while the inputs are in use.
        """
        ...

    def open_input(self, inputs: Sequence[SensorInput], rate_hz: float, buffer: int) -> InputTask:
        """Prepare inputs; `buffer` samples of each are kept until they are read."""
        ...

    def open_output(
        self,
        outputs: Sequence[DriveOutput],
        volts: Array,
        rate_hz: float,
        *,
        clock: InputTask | None,
    ) -> OutputTask:
        """Prepare outputs for voltages [V], shape (channels, n).

        They take the clock of the inputs, and their own of `rate_hz` where there are none. Inputs
        that start later put out the first sample with their own first one.
        """
        ...

    def pause(self, seconds: float) -> None:
        """Let time pass."""
        ...

    def close(self) -> None:
        """Give all free."""
        ...
