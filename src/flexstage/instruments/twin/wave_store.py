"""Wave tables of a controller in the unit of the wire, and how they come to the device."""

from collections.abc import Sequence

import numpy as np

from flexstage.arrays import Array
from flexstage.instruments.twin import errors_gcs as code
from flexstage.instruments.twin.controller import VirtualController
from flexstage.instruments.twin.errors_gcs import GcsError

_MICRO = 1e-6


class WaveStore:
    """Tables whose numbers are um where they run as positions, and V where they run as voltages.

    What they are is known when an axis starts: under control, and of a screw, positions. So the
    device gets its tables only then. Parts that are appended are joined when they are asked for:
    a long table comes in thousands of lines.
    """

    def __init__(self, device: VirtualController) -> None:
        self._device = device
        self._parts: dict[int, list[Array]] = {}
        self._sizes: dict[int, int] = {}
        #: What is added to the waveform of an axis, in the unit of the wire.
        self.offsets: dict[str, float] = dict.fromkeys(device.axes, 0.0)
        #: Unit in SI, and offset, in which the device has a table; none where it has not got it.
        self._given: dict[int, tuple[float, float]] = {}

    def size(self, table: int) -> int:
        """Return the number of samples of a table."""
        return self._sizes.get(table, 0)

    def filled(self) -> list[int]:
        """Return the tables that have samples."""
        return sorted(table for table, size in self._sizes.items() if size)

    def room(self, table: int) -> int:
        """Return how many samples a table can have beside the others."""
        others = sum(size for number, size in self._sizes.items() if number != table)
        return self._device.wave_capacity - others

    def samples(self, table: int) -> Array:
        """Return the samples of a table in the unit of the wire."""
        parts = self._parts.get(table, [])
        if len(parts) > 1:
            parts[:] = [np.concatenate(parts)]
        return parts[0] if parts else np.empty(0)

    def in_use(self, table: int) -> bool:
        """Say whether an axis runs a table now."""
        return any(
            table in self._device.wave_choice(axis)
            for axis in self._device.axes
            if self._device.wave_running(axis)
        )

    def replace(self, table: int, samples: Array) -> None:
        """Replace the samples of a table, in the unit of the wire; none clears it."""
        self._change(table)
        self._parts[table] = [samples] if samples.size else []
        self._sizes[table] = samples.size

    def append(self, table: int, samples: Array) -> None:
        """Append samples, in the unit of the wire, to a table."""
        self._change(table)
        self._parts.setdefault(table, []).append(samples)
        self._sizes[table] = self.size(table) + samples.size

    def give(self, axes: Sequence[str]) -> None:
        """Give the device, in SI, the tables that some axes are about to run.

        Two axes cannot read one table as different quantities, or with different offsets.
        """
        wanted: dict[int, tuple[float, float]] = {}
        for axis in axes:
            table, feedforward = self._device.wave_choice(axis)
            if not table:
                raise GcsError(code.NO_WAVE_CHOSEN)
            screw = self._device.axes[axis].kind == "screw"
            unit = _MICRO if screw or self._device.servo_on(axis) else 1.0
            for number, its in ((table, (unit, self.offsets[axis])), (feedforward, (1.0, 0.0))):
                if number and not self.size(number):
                    raise GcsError(code.WAVE_NOT_DEFINED)
                if number and wanted.setdefault(number, its) != its:
                    raise GcsError(code.WAVE_OUT_OF_RANGE)
        missing = {table: how for table, how in wanted.items() if self._given.get(table) != how}
        if any(self.in_use(table) for table in missing):
            raise GcsError(code.WAVE_RUNNING)
        # what is no longer in a table must not take the room of what is in another one
        for table in range(1, self._device.wave_tables + 1):
            if table not in self._given and self._device.wave(table).size:
                self._device.set_wave(table, np.empty(0))
        for table, (unit, offset) in missing.items():
            self._device.set_wave(table, (self.samples(table) + offset) * unit)
            self._given[table] = unit, offset

    def _change(self, table: int) -> None:
        if self.in_use(table):
            raise GcsError(code.WAVE_RUNNING)
        self._given.pop(table, None)
