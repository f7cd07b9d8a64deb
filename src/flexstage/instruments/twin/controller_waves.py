"""Waveforms of a simulated controller: tables, and the axes that run them."""

from collections.abc import Collection, Sequence

from flexstage.arrays import Array
from flexstage.instruments.twin.axis_state import AxisState, check_feedforward, check_wave
from flexstage.instruments.twin.controller_core import ControllerCore
from flexstage.instruments.twin.device import Refusal, RefusedError
from flexstage.instruments.twin.wave_tables import WaveRun


class ControllerWaves(ControllerCore):
    """Wave tables and generators.

    A table holds positions for an axis under control, and voltages for one in open loop. When its
    waveform has ended an axis holds the last sample.
    """

    @property
    def wave_tables(self) -> int:
        """Number of tables."""
        return self._tables.count

    @property
    def wave_capacity(self) -> int:
        """Samples over all tables."""
        return self._tables.capacity

    def wave(self, table: int) -> Array:
        """Return the samples of a table [m or V: whichever the axis takes that runs it]."""
        return self._tables.samples(table)

    def set_wave(self, table: int, samples: Array) -> None:
        """Replace the samples of a table; an empty sequence clears it."""
        self._tables.known(table)
        for name, state in self._states.items():
            if state.wave is not None and table in self._choice[name]:
                raise RefusedError(
                    Refusal.WAVE_RUNNING, f"wave table {table} runs on axis '{name}': stop it first"
                )
        self._tables.replace(table, samples)

    def wave_rate_divider(self) -> int:
        """Return how many samples of the loop one sample of a table lasts."""
        return self._divider

    def set_wave_rate_divider(self, divider: int) -> None:
        """Set how many samples of the loop one sample of a table lasts."""
        if divider < 1:
            raise RefusedError(
                Refusal.BAD_VALUE,
                f"a sample of a table lasts 1 sample of the loop or more, got {divider}",
            )
        for state in self._states.values():
            self._need_no_wave(state)
        self._divider = int(divider)

    def wave_choice(self, axis: str) -> tuple[int, int]:
        """Return the table of an axis and that of its feedforward, 0 for none."""
        self._axis(axis)
        return self._choice[axis]

    def choose_wave(self, axis: str, table: int, feedforward: int = 0) -> None:
        """Choose the table of an axis and that of its feedforward, 0 for none."""
        state = self._axis(axis)
        self._need_no_wave(state)
        if feedforward:
            self._piezo(axis)
        for number in (table, feedforward):
            if number:
                self._tables.known(number)
        self._choice[axis] = (int(table), int(feedforward))

    def wave_cycles(self, axis: str) -> int:
        """Return how often the waveform of an axis is run; 0 for endlessly."""
        self._axis(axis)
        return self._cycles[axis]

    def set_wave_cycles(self, axis: str, cycles: int) -> None:
        """Set how often the waveform of an axis is run; 0 for endlessly."""
        state = self._axis(axis)
        self._need_no_wave(state)
        if cycles < 0:
            raise RefusedError(
                Refusal.BAD_VALUE, f"a waveform runs 0 times (endlessly) or more, got {cycles}"
            )
        self._cycles[axis] = int(cycles)

    def start_waves(self, axes: Sequence[str], onward: Collection[str] = ()) -> None:
        """Check every sample of the chosen tables against the limits, then start all in step.

        The cycles of axes that go `onward` each begin where the one before has ended. Where
        anything is refused, nothing has started.
        """
        self._need_drives()
        runs = [
            (state, self._prepared(axis, state, axis in onward))
            for axis, state in self._named(axes)
        ]
        for state, run in runs:
            state.run(run, self._sample)
        self._recorder.trigger("wave", self._sample + 1)

    def stop_waves(self, axes: Sequence[str]) -> None:
        """Stop waveforms; the axes hold where they are, and those that run none go on."""
        for _, state in self._named(axes):
            if state.wave is not None:
                state.stop(self._sample)

    def wave_running(self, axis: str) -> bool:
        """Say whether a waveform runs on an axis."""
        return self._axis(axis).wave is not None

    def _named(self, axes: Sequence[str]) -> list[tuple[str, AxisState]]:
        return [(axis, self._axis(axis)) for axis in dict.fromkeys(axes)]

    def _prepared(self, axis: str, state: AxisState, onward: bool) -> WaveRun:
        self._need_no_wave(state)
        table, beside = self._choice[axis]
        samples = self._filled(axis, table)
        cycles = self._cycles[axis]
        divider = self._divider
        shift = float(samples[-1] - samples[0]) if onward and cycles != 1 else 0.0
        samples = check_wave(
            state, samples, cycles, divider, state.present(self._sample), shift=shift
        )
        voltages = None
        if beside:
            voltages = check_feedforward(
                state, self._filled(axis, beside), samples.size, cycles, divider
            )
        return WaveRun(
            first=self._sample + 1,
            table=samples,
            divider=divider,
            cycles=cycles,
            feedforward=voltages,
            shift=shift,
        )

    def _filled(self, axis: str, table: int) -> Array:
        if not table:
            raise RefusedError(Refusal.NO_WAVE, f"no wave table is chosen for axis '{axis}'")
        samples = self._tables.samples(table)
        if not samples.size:
            raise RefusedError(Refusal.NO_WAVE, f"wave table {table} of axis '{axis}' is empty")
        return samples
