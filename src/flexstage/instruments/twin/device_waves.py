"""Waveforms of a simulated controller."""

from collections.abc import Collection, Sequence
from typing import Protocol

from flexstage.arrays import Array


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
        """Return the samples of a table [m or V: whichever the axis takes that runs it]."""
        ...

    def set_wave(self, table: int, samples: Array) -> None:
        """Replace the samples of a table; an empty sequence clears it."""
        ...

    def wave_rate_divider(self) -> int:
        """Return how many samples of the loop one sample of a table lasts."""
        ...

    def set_wave_rate_divider(self, divider: int) -> None:
        """Set it; straight lines join the samples."""
        ...

    def wave_choice(self, axis: str) -> tuple[int, int]:
        """Return the table of an axis and that of its feedforward, 0 for none."""
        ...

    def choose_wave(self, axis: str, table: int, feedforward: int = 0) -> None:
        """Choose them."""
        ...

    def wave_cycles(self, axis: str) -> int:
        """Return how often the waveform of an axis is run; 0 for endlessly."""
        ...

    def set_wave_cycles(self, axis: str, cycles: int) -> None:
        """Set it."""
        ...

    def start_waves(self, axes: Sequence[str], onward: Collection[str] = ()) -> None:
        """Check every sample of the chosen tables against the limits, then start all in step."""
        ...

    def stop_waves(self, axes: Sequence[str]) -> None:
        """Stop them; the axes hold where they are."""
        ...

    def wave_running(self, axis: str) -> bool:
        """Say whether a waveform runs on an axis."""
        ...
