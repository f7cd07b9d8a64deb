"""The data recorder of a simulated controller."""

from typing import Literal, Protocol

from flexstage.arrays import Array
from flexstage.instruments.protocol import Signal


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
        """Return what a table records; None for nothing."""
        ...

    def set_record_signal(self, table: int, signal: Signal | None) -> None:
        """Choose it; `Signal.source` is the identifier of an axis or the number of a channel."""
        ...

    def record_divider(self) -> int:
        """Return how many samples of the loop one sample of a record lasts."""
        ...

    def set_record_divider(self, divider: int) -> None:
        """Set it."""
        ...

    def arm_recorder(self, trigger: Literal["wave", "move", "now"]) -> None:
        """Start recording with the next waveform or blow, the next move, or now."""
        ...

    def recorded(self) -> int:
        """Return the number of samples that are there."""
        ...

    def recording(self) -> bool:
        """Say whether the recorder runs."""
        ...

    def record(self, table: int, first: int, count: int) -> Array:
        """Return samples of a table, counted from 0."""
        ...
