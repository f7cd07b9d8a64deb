"""Axes and waveforms as devices for scans of laboratory frameworks, which are not imported."""

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from flexstage.base.errors import ControllerError
from flexstage.instruments.limits import check_position
from flexstage.instruments.protocol import Instrument, MotionAxis, Signal, Waveform
from flexstage.instruments.record_run import run_waveform
from flexstage.records import Record


class MotionStatus:
    """Status of a motion that runs in another thread, with callbacks at its end.

    Examples
    --------
    >>> status = MotionStatus(lambda: None)
    >>> status.wait(timeout=10.0)
    >>> status.done, status.success
    (True, True)
    """

    def __init__(self, work: Callable[[], object]) -> None:
        self._over, self._lock = threading.Event(), threading.Lock()
        self._error: BaseException | None = None
        self._callbacks: list[Callable[[MotionStatus], object]] = []
        threading.Thread(target=self._run, args=(work,), name="motion", daemon=True).start()

    def __repr__(self) -> str:
        """Return the state of the motion, as frameworks display it."""
        ended = "complete" if self._error is None else f"failed: {self._error}"
        return f"<motion {ended if self.done else 'in progress'}>"

    @property
    def done(self) -> bool:
        """Whether it has ended, with or without success."""
        return self._over.is_set()

    @property
    def success(self) -> bool:
        """Whether it has ended with success."""
        return self.done and self._error is None

    def add_callback(self, callback: Callable[["MotionStatus"], object]) -> None:
        """Call a function with this status at the end, or now if it has already ended."""
        with self._lock:
            if not self.done:
                self._callbacks.append(callback)
                return
        callback(self)

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        """Return the error of a failed motion, else None; `TimeoutError` if it has not ended."""
        if not self._over.wait(timeout):
            raise TimeoutError(f"the motion has not ended within {timeout:g} s")
        return self._error

    def wait(self, timeout: float | None = None) -> None:
        """Wait for the end [s]; raise the error of a motion that failed."""
        if (error := self.exception(timeout)) is not None:
            raise error

    def _run(self, work: Callable[[], object]) -> None:
        try:
            work()
        except BaseException as error:  # noqa: BLE001 - reported by wait() and exception()
            self._error = error
        with self._lock:
            self._over.set()
        for callback in self._callbacks:
            callback(self)


def _key(instrument: Instrument, unit: str) -> dict[str, Any]:
    identity = instrument.identity
    source = " ".join(w for w in (identity.vendor, identity.model, identity.serial_number) if w)
    return {"source": source, "dtype": "number", "shape": [], "units": unit}


class ScanAxis:
    """An axis that a scan moves and reads, in m; the first move switches its position control on.

    It implements bluesky's protocols of movable, readable, locatable, checkable and stoppable
    devices, which suffice for adapters to other frameworks. `stop` stops all axes of the stage.
    """

    parent = None

    def __init__(self, instrument: Instrument, axis: str, *, name: str = "") -> None:
        self._instrument, self.name = instrument, name or axis
        self._axis: MotionAxis = instrument.axes[axis]
        self._setpoint = self._axis.position()

    @property
    def position(self) -> float:
        """Reading of its sensor [m]."""
        return self._axis.position()

    @property
    def hints(self) -> dict[str, list[str]]:
        """Field for plots."""
        return {"fields": [self.name]}

    def set(self, value: float) -> MotionStatus:
        """Move to a position [m]; a position outside the limits is refused before any motion."""
        self.check_value(value)
        if not self._axis.closed_loop:
            self._axis.set_closed_loop(True)
        self._axis.move_to(float(value), wait=False)
        self._setpoint = float(value)
        return MotionStatus(self._axis.wait)

    def check_value(self, value: float) -> None:
        """Refuse a position [m] outside the limits, without motion."""
        check_position(self._axis.limits, float(value), self._axis.name)

    def stop(self, success: bool = True) -> None:
        """Stop all axes of the stage; a motion in progress fails."""
        del success
        self._instrument.stop()

    def locate(self) -> dict[str, float]:
        """Return setpoint and reading [m]."""
        return {"setpoint": self._setpoint, "readback": self.position}

    def read(self) -> dict[str, dict[str, float]]:
        """Return reading and setpoint [m], with the time of the computer's clock."""
        now, at = time.time(), self.locate()
        values = {self.name: at["readback"], f"{self.name}_setpoint": at["setpoint"]}
        return {field: {"value": value, "timestamp": now} for field, value in values.items()}

    def describe(self) -> dict[str, dict[str, Any]]:
        """Return the description of `read`: source, unit, limits."""
        limits = self._axis.limits.position
        key = _key(self._instrument, "m")
        if limits is not None:
            key |= {"lower_ctrl_limit": limits[0], "upper_ctrl_limit": limits[1]}
        return {self.name: key, f"{self.name}_setpoint": dict(key)}


class FlyScan:
    """A waveform with its record as a fly scan: kickoff, complete, collect.

    Arguments are those of `run_waveform`. Position control is switched as the waveform needs it.
    Times of the samples are those of the record, which ends when it was read, by the computer's
    clock.
    """

    parent = None

    def __init__(
        self,
        instrument: Instrument,
        waveform: Waveform,
        signals: Sequence[Signal],
        *,
        rate_hz: float,
        cycles: int = 1,
        name: str = "waveform",
    ) -> None:
        self._instrument, self._signals, self.name = instrument, tuple(signals), name
        self._waveform = waveform
        self._run_it = lambda: run_waveform(
            instrument, waveform, self._signals, rate_hz=rate_hz, cycles=cycles
        )
        self._status: MotionStatus | None = None
        self._ended = 0.0
        #: The record of the last completed run.
        self.record: Record | None = None

    def kickoff(self) -> MotionStatus:
        """Check the complete waveform and start it."""
        if self._status is not None and not self._status.done:
            raise ControllerError(f"'{self.name}' is already running: complete it first")
        self.record = None
        self._status = MotionStatus(self._run)
        return MotionStatus(lambda: None)

    def complete(self) -> MotionStatus:
        """Return the status of the started run."""
        if self._status is None:
            raise ControllerError(f"'{self.name}' was not started: kick it off first")
        return self._status

    def stop(self, success: bool = True) -> None:
        """Stop all axes of the stage; a run in progress fails."""
        del success
        self._instrument.stop()

    def describe_collect(self) -> Mapping[str, Mapping[str, Any]]:
        """Return the description of `collect`, in one stream with its name."""
        return {self.name: {s.name: _key(self._instrument, s.unit) for s in self._signals}}

    def collect(self) -> Iterator[dict[str, Any]]:
        """Yield the samples of the record as events."""
        if self.record is None:
            raise ControllerError(f"'{self.name}' has no record: kick it off and complete it first")
        columns = {s.name: self.record.channel(s.name).values.tolist() for s in self._signals}
        begun = self._ended - float(self.record.time[-1])
        for k, t in enumerate((begun + self.record.time).tolist()):
            data = {name: values[k] for name, values in columns.items()}
            yield {"time": t, "data": data, "timestamps": dict.fromkeys(data, t)}

    def _run(self) -> None:
        for name in self._waveform.values:
            axis, closed = self._instrument.axes[name], self._waveform.quantity == "position"
            if axis.closed_loop != closed:
                axis.set_closed_loop(closed)
        self.record = self._run_it()
        self._ended = time.time()
