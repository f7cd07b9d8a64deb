"""Driver of real cards: NI-DAQmx, by NI's Python package."""

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from types import ModuleType
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ControllerError, ModelError, NotConnectedError
from flexstage.base.lazy import require_extra
from flexstage.instruments.ni.setup import (
    CardInfo,
    DriveOutput,
    InputTask,
    NiBackend,
    NiSetup,
    SensorInput,
)

#: Error numbers of a card that is disconnected or does not exist.
GONE = {-200220, -201003, -201401, -89130}
#: Error numbers of a property that a card or a task does not have.
NOT_SUPPORTED = {-200197, -200452}
#: Error numbers of a signal that cannot be routed inside a card.
NO_ROUTE = {-89136, -89139, -89140, -200368}
#: Messages of frequent errors, by number.
SENTENCES = {
    -200220: "there is no such card: look up its name in NI MAX",
    -201003: "the card cannot be reached: check its cable and power",
    -200279: "samples were overwritten before they were read: record more slowly or fewer sensors",
    -200222: "samples came faster than they were read: record more slowly or fewer sensors",
    -200290: "the outputs ran out of samples: run the waveform more slowly",
    -200621: "the outputs ran out of samples: run the waveform more slowly",
    -50103: "another program or task uses the same channels of the card: end it first",
    -200284: "the samples did not arrive in time: check that the clock of the card runs",
    -200019: "the card cannot convert so fast: record more slowly or fewer sensors",
    -200081: "the card cannot sample all inputs at this rate: record more slowly or fewer sensors",
    -200077: "the card does not support one of the settings, such as a range or a rate",
    -200170: "the card has no such channel: look up its channels in NI MAX",
    -200561: "a voltage is outside the range of the output",
    **dict.fromkeys(
        NO_ROUTE,
        "the outputs of this card cannot use the clock of its inputs: use a card of the M or X "
        "series",
    ),
}
_TIMEOUT = 10.0
_WIDEST = 10.0  # range in which outputs are read back [V]
#: Product categories of cards that can route the clock of their inputs to their outputs.
_FAMILIES = ("M_SERIES_DAQ", "X_SERIES_DAQ", "S_SERIES_DAQ", "E_SERIES_DAQ", "MIODAQ")


def driver_found() -> str:
    """Return the reason why NI-DAQmx cannot be used here; empty where it can."""
    try:
        import nidaqmx
        from nidaqmx.errors import DaqNotFoundError, DaqNotSupportedError, Error
    except ImportError:
        return "the Python package nidaqmx is not installed"
    try:
        nidaqmx.Task().close()
    except DaqNotFoundError:
        return "the driver NI-DAQmx is not installed on this computer"
    except DaqNotSupportedError:
        return "NI-DAQmx does not support this computer"
    except Error as error:
        return f"NI-DAQmx does not work: {str(error).splitlines()[0]}"
    return ""


class DaqmxBackend(NiBackend):
    """NI cards by NI-DAQmx.

    Inputs are sampled continuously into a buffer. Outputs use the sample clock of the inputs, which
    is routed inside the card, and are started first: they wait for its first edge. So no start
    trigger is necessary; a trigger a few ticks before or after that edge could shift the outputs by
    a sample. The first input is sampled at the edge at which the output of the same number changes,
    and reads the previous output.

    Validity: with drives, cards of the M and X series (S, E and mioDAQ are accepted too, and the
    driver decides), with inputs and outputs on one card; not CompactDAQ, whose modules use the
    clocks of their chassis, and not USB-600x, whose outputs cannot use the clock of the inputs.
    Without drives, any card with analogue inputs. Outputs are read back on the multiplexed cards of
    the M and X series.
    """

    def __init__(self, library: ModuleType | None = None) -> None:
        if library is None:
            require_extra("ni", "nidaqmx", "a card of National Instruments", NotConnectedError)
            import nidaqmx as library
            import nidaqmx.constants
            import nidaqmx.errors
            import nidaqmx.stream_readers
            import nidaqmx.stream_writers
            import nidaqmx.system
        self._ni: Any = library

    def describe(self, setup: NiSetup) -> CardInfo:
        note = f"NI-DAQmx by nidaqmx {getattr(self._ni, '__version__', '')}".strip()
        with self._sentences(setup.device):
            card = self._ni.system.Device(setup.device)
            simulated = bool(card.is_simulated)
            if setup.outputs:
                self._require_shared_clock(card, setup.device)
            return CardInfo(
                vendor="NI",
                model=str(card.product_type),
                serial_number=f"{card.serial_num:08X}",
                simulated=simulated,
                note=f"card simulated by NI MAX: not measured data; {note}" if simulated else note,
                single_rate_hz=float(card.ai_max_single_chan_rate),
                total_rate_hz=float(card.ai_max_multi_chan_rate),
                output_rate_hz=float(card.ao_max_rate) if setup.outputs else math.inf,
                simultaneous=bool(card.ai_simultaneous_sampling_supported),
            )

    def _require_shared_clock(self, card: Any, device: str) -> None:
        """Refuse a card whose outputs cannot use the clock of its inputs."""
        try:
            family = str(card.product_category.name)
        except ValueError:  # a category that is newer than the package
            family = "UNKNOWN"
        if family in _FAMILIES and card.ao_samp_clk_supported:
            return
        raise ModelError(
            f"the outputs of card '{device}' ({card.product_type}) cannot use the clock of its "
            "inputs, which drives need: use a card of the M or X series, such as USB-6211 or "
            "PCIe-6321, or connect sensors only"
        )

    def read_now(self, inputs: Sequence[SensorInput]) -> Array:
        data = np.zeros(len(inputs))
        with self._sentences("the inputs"), self._task() as task:
            self._add_inputs(task, inputs)
            reader = self._ni.stream_readers.AnalogMultiChannelReader(task.in_stream)
            reader.read_one_sample(data, timeout=_TIMEOUT)
        return data

    def write_now(self, outputs: Sequence[DriveOutput], volts: Array) -> None:
        with self._sentences("the outputs"), self._task() as task:
            self._add_outputs(task, outputs)
            writer = self._ni.stream_writers.AnalogMultiChannelWriter(
                task.out_stream, auto_start=True
            )
            writer.write_one_sample(np.ascontiguousarray(volts, dtype=np.float64), timeout=_TIMEOUT)

    def read_outputs(self, outputs: Sequence[DriveOutput]) -> Array:
        unknown, data = np.full(len(outputs), np.nan), np.zeros(len(outputs))
        device = _device(outputs[0].channel)
        with self._sentences("the inputs"), self._task() as task:
            if self._ni.system.Device(device).is_simulated:  # a simulated card reads a sine
                return unknown
            for drive in outputs:
                name = drive.channel.strip("/").rsplit("/", maxsplit=1)[-1]
                try:
                    task.ai_channels.add_ai_voltage_chan(
                        f"{device}/_{name}_vs_aognd", min_val=-_WIDEST, max_val=_WIDEST
                    )
                except self._ni.errors.DaqError as error:
                    if int(error.error_code) in GONE:
                        raise
                    return unknown
            reader = self._ni.stream_readers.AnalogMultiChannelReader(task.in_stream)
            reader.read_one_sample(data, timeout=_TIMEOUT)
        return data

    def open_input(self, inputs: Sequence[SensorInput], rate_hz: float, buffer: int) -> "_Input":
        continuous = self._ni.constants.AcquisitionType.CONTINUOUS
        with self._sentences("the inputs"), self._task(keep=True) as task:
            self._add_inputs(task, inputs)
            task.timing.cfg_samp_clk_timing(rate_hz, sample_mode=continuous, samps_per_chan=buffer)
            device = _device(inputs[0].channel)
            return _Input(self, task, len(inputs), device, self._interval(task, device, inputs))

    def open_output(
        self,
        outputs: Sequence[DriveOutput],
        volts: Array,
        rate_hz: float,
        *,
        clock: InputTask | None,
    ) -> "_Output":
        constants = self._ni.constants
        device = clock.device if isinstance(clock, _Input) else ""
        if volts.shape[1] == 1:  # a finite task needs at least two samples
            volts = np.repeat(volts, 2, axis=1)
        with self._sentences("the outputs"), self._task(keep=True) as task:
            self._add_outputs(task, outputs)
            task.timing.cfg_samp_clk_timing(
                rate_hz,
                source=f"/{device}/ai/SampleClock" if device else "",
                active_edge=constants.Edge.RISING,
                sample_mode=constants.AcquisitionType.FINITE,
                samps_per_chan=volts.shape[1],
            )
            writer = self._ni.stream_writers.AnalogMultiChannelWriter(
                task.out_stream, auto_start=False
            )
            writer.write_many_sample(
                np.ascontiguousarray(volts, dtype=np.float64), timeout=_TIMEOUT
            )
            return _Output(self, task)

    def pause(self, seconds: float) -> None:
        time.sleep(seconds)

    def close(self) -> None:
        pass  # tasks are closed one by one

    def _add_inputs(self, task: Any, inputs: Sequence[SensorInput]) -> None:
        for sensor in inputs:
            task.ai_channels.add_ai_voltage_chan(
                sensor.channel,
                terminal_config=self._ni.constants.TerminalConfiguration[sensor.terminal.upper()],
                min_val=sensor.voltage_range[0],
                max_val=sensor.voltage_range[1],
            )

    def _add_outputs(self, task: Any, outputs: Sequence[DriveOutput]) -> None:
        for drive in outputs:
            task.ao_channels.add_ao_voltage_chan(
                drive.channel, min_val=drive.voltage_range[0], max_val=drive.voltage_range[1]
            )

    def _interval(self, task: Any, device: str, inputs: Sequence[SensorInput]) -> float:
        """Return the time between conversions [s]; NaN where the driver does not report it."""
        if len(inputs) == 1:
            return 0.0
        if self._ni.system.Device(device).ai_simultaneous_sampling_supported:
            return 0.0
        try:
            return 1.0 / float(task.timing.ai_conv_rate)
        except self._ni.errors.DaqError as error:
            if int(error.error_code) in NOT_SUPPORTED:
                return math.nan
            raise

    @contextmanager
    def _task(self, *, keep: bool = False) -> Iterator[Any]:
        """Create a task, and close it after the block; with `keep`, only if the block fails."""
        task = self._ni.Task()
        complete = False
        try:
            yield task
            complete = True
        finally:
            if not (keep and complete):
                task.close()

    @contextmanager
    def _sentences(self, what: str) -> Iterator[None]:
        """Translate errors of the driver into errors of flexstage."""
        errors = self._ni.errors
        try:
            yield
        except (errors.DaqNotFoundError, errors.DaqNotSupportedError) as error:
            raise NotConnectedError(
                "the driver NI-DAQmx is not installed on this computer: install it from NI, or use "
                "a simulated card"
            ) from error
        except errors.DaqError as error:
            code = int(error.error_code)
            meaning = SENTENCES.get(code, str(error).splitlines()[0].rstrip("."))
            message = f"NI-DAQmx refuses {what} with error {code}: {meaning}"
            if code in GONE:
                raise NotConnectedError(message) from error
            raise ControllerError(message, code) from error


class _Input:
    def __init__(
        self, backend: DaqmxBackend, task: Any, channels: int, device: str, interval: float
    ) -> None:
        self._backend, self._task, self._channels = backend, task, channels
        self.device, self.interval = device, interval
        self.rate_hz = float(task.timing.samp_clk_rate)
        self._reader = backend._ni.stream_readers.AnalogMultiChannelReader(task.in_stream)

    def start(self) -> None:
        with self._backend._sentences("the inputs"):
            self._task.start()

    def available(self) -> int:
        with self._backend._sentences("the inputs"):
            return int(self._task.in_stream.avail_samp_per_chan)

    def read(self, count: int) -> Array:
        data = np.zeros((self._channels, count))
        with self._backend._sentences("the inputs"):
            count_read = self._reader.read_many_sample(
                data, number_of_samples_per_channel=count, timeout=_TIMEOUT
            )
        return data[:, :count_read]

    def close(self) -> None:
        with self._backend._sentences("the inputs"):
            self._task.close()


class _Output:
    def __init__(self, backend: DaqmxBackend, task: Any) -> None:
        self._backend, self._task = backend, task
        # A stopped task does not report its progress, which is therefore read before the stop.
        self._ended: tuple[bool, int] | None = None

    def start(self) -> None:
        with self._backend._sentences("the outputs"):
            self._task.start()

    def done(self) -> bool:
        if self._ended is not None:
            return self._ended[0]
        with self._backend._sentences("the outputs"):
            return bool(self._task.is_task_done())

    def stop(self) -> None:
        if self._ended is not None:
            return
        ended = (False, -1)
        with suppress(ControllerError, NotConnectedError):
            ended = (self.done(), self.generated())
        with self._backend._sentences("the outputs"):
            self._task.stop()
        self._ended = ended

    def generated(self) -> int:
        if self._ended is not None:
            return self._ended[1]
        with self._backend._sentences("the outputs"):
            return int(self._task.out_stream.total_samp_per_chan_generated)

    def close(self) -> None:
        with self._backend._sentences("the outputs"):
            self._task.close()


def _device(channel: str) -> str:
    return channel.strip("/").split("/", maxsplit=1)[0]
