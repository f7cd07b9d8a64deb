"""The real driver: NI-DAQmx, by NI's own Python package."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import ControllerError, NotConnectedError
from flexstage.instruments.ni.backend import InputTask
from flexstage.instruments.ni.daqmx_codes import GONE, SENTENCES
from flexstage.instruments.ni.setup import DriveOutput, SensorInput

__all__ = ["DaqmxBackend", "driver_found"]

Array = NDArray[np.float64]

_TIMEOUT = 10.0


def driver_found() -> str:
    """Say why NI-DAQmx cannot be used here.

    Returns
    -------
    str
        The reason; empty where it can.
    """
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


class DaqmxBackend:
    """NI cards by NI-DAQmx.

    Inputs are sampled without end into a buffer and read from there. Outputs go with the sample
    clock of the inputs and, where asked, begin with their start trigger; both are routed inside
    the card. An input is sampled at the edge at which the output of the same number changes, so
    that it sees the output before.

    Validity: cards whose analogue outputs take a clock; inputs and outputs on one card. How many
    samples were put out before a stop is known to some samples.

    Parameters
    ----------
    library : module, optional
        The package ``nidaqmx``; imported where not given.

    Raises
    ------
    NotConnectedError
        The package is not installed.
    """

    def __init__(self, library: ModuleType | None = None) -> None:
        if library is None:
            try:
                import nidaqmx as library
            except ImportError as error:
                raise NotConnectedError(
                    "NI cards need the package nidaqmx: install flexstage[ni]"
                ) from error
            import nidaqmx.constants
            import nidaqmx.errors
            import nidaqmx.stream_readers
            import nidaqmx.stream_writers
            import nidaqmx.system
        self._ni: Any = library

    @property
    def simulated(self) -> bool:
        """False: what NI MAX simulates says so by its serial number of zero."""
        return False

    @property
    def note(self) -> str:
        """The package and its version."""
        return f"NI-DAQmx by nidaqmx {getattr(self._ni, '__version__', '')}".strip()

    def identify(self, device: str) -> tuple[str, str]:
        """Return the type and the serial number of a card.

        Parameters
        ----------
        device : str
            Its name in NI MAX.

        Returns
        -------
        tuple of str
            Both.

        Raises
        ------
        NotConnectedError
            There is no such card.
        """
        with self._sentences(device):
            card = self._ni.system.Device(device)
            return str(card.product_type), f"{card.serial_num:08X}"

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
        data = np.zeros(len(inputs))
        with self._sentences("the inputs"), self._task() as task:
            self._add_inputs(task, inputs)
            reader = self._ni.stream_readers.AnalogMultiChannelReader(task.in_stream)
            reader.read_one_sample(data, timeout=_TIMEOUT)
        return data

    def write_now(self, outputs: Sequence[DriveOutput], volts: Array) -> None:
        """Put out voltages now.

        Parameters
        ----------
        outputs : sequence of DriveOutput
            The outputs.
        volts : numpy.ndarray
            Their voltages [V], shape (channels,).
        """
        with self._sentences("the outputs"), self._task() as task:
            self._add_outputs(task, outputs)
            writer = self._ni.stream_writers.AnalogMultiChannelWriter(
                task.out_stream, auto_start=True
            )
            writer.write_one_sample(np.ascontiguousarray(volts, dtype=np.float64), timeout=_TIMEOUT)

    def kept_rate(self, inputs: Sequence[SensorInput], rate_hz: float) -> float:
        """Return the rate that the card would keep.

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
        task = self.open_input(inputs, rate_hz, 1000)
        try:
            return task.rate_hz
        finally:
            task.close()

    def open_input(self, inputs: Sequence[SensorInput], rate_hz: float, buffer: int) -> "_Input":
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
        continuous = self._ni.constants.AcquisitionType.CONTINUOUS
        with self._sentences("the inputs"):
            task = self._ni.Task()
            with self._closing_on_error(task):
                self._add_inputs(task, inputs)
                task.timing.cfg_samp_clk_timing(
                    rate_hz, sample_mode=continuous, samps_per_chan=buffer
                )
                return _Input(self, task, len(inputs), _device(inputs[0].channel))

    def open_output(
        self,
        outputs: Sequence[DriveOutput],
        volts: Array,
        rate_hz: float,
        *,
        clock: InputTask | None,
        wait_for_start: bool,
    ) -> "_Output":
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
            Inputs with whose clock they go.
        wait_for_start : bool
            Whether the start of the inputs starts them.

        Returns
        -------
        OutputTask
            The task.
        """
        constants = self._ni.constants
        device = clock.device if isinstance(clock, _Input) else ""
        with self._sentences("the outputs"):
            task = self._ni.Task()
            with self._closing_on_error(task):
                self._add_outputs(task, outputs)
                task.timing.cfg_samp_clk_timing(
                    rate_hz,
                    source=f"/{device}/ai/SampleClock" if device else "",
                    active_edge=constants.Edge.RISING,
                    sample_mode=constants.AcquisitionType.FINITE,
                    samps_per_chan=volts.shape[1],
                )
                if device and wait_for_start:
                    task.triggers.start_trigger.cfg_dig_edge_start_trig(
                        f"/{device}/ai/StartTrigger", trigger_edge=constants.Edge.RISING
                    )
                writer = self._ni.stream_writers.AnalogMultiChannelWriter(
                    task.out_stream, auto_start=False
                )
                writer.write_many_sample(
                    np.ascontiguousarray(volts, dtype=np.float64), timeout=_TIMEOUT
                )
                return _Output(self, task)

    def pause(self, seconds: float) -> None:
        """Let time pass.

        Parameters
        ----------
        seconds : float
            How much [s].
        """
        time.sleep(seconds)

    def close(self) -> None:
        """Do nothing: tasks are closed one by one."""

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

    @contextmanager
    def _task(self) -> Iterator[Any]:
        task = self._ni.Task()
        try:
            yield task
        finally:
            task.close()

    @contextmanager
    def _closing_on_error(self, task: Any) -> Iterator[None]:
        whole = False
        try:
            yield
            whole = True
        finally:
            if not whole:
                task.close()

    @contextmanager
    def _sentences(self, what: str) -> Iterator[None]:
        """Turn errors of the driver into ours, one sentence each."""
        errors = self._ni.errors
        try:
            yield
        except (errors.DaqNotFoundError, errors.DaqNotSupportedError) as error:
            raise NotConnectedError(
                "the driver NI-DAQmx is not installed on this computer: install it from NI, or ask "
                "for a simulated card"
            ) from error
        except errors.DaqError as error:
            code = int(error.error_code)
            meant = SENTENCES.get(code, str(error).splitlines()[0].rstrip("."))
            message = f"NI-DAQmx refuses {what} with error {code}: {meant}"
            if code in GONE:
                raise NotConnectedError(message) from error
            raise ControllerError(message, code) from error


class _Input:
    def __init__(self, backend: DaqmxBackend, task: Any, channels: int, device: str) -> None:
        self._backend, self._task, self._channels = backend, task, channels
        self.device = device
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
            found = self._reader.read_many_sample(
                data, number_of_samples_per_channel=count, timeout=_TIMEOUT
            )
        return data[:, :found]

    def close(self) -> None:
        with self._backend._sentences("the inputs"):
            self._task.close()


class _Output:
    def __init__(self, backend: DaqmxBackend, task: Any) -> None:
        self._backend, self._task = backend, task
        self._count: int | None = None  # known once it was stopped

    def start(self) -> None:
        with self._backend._sentences("the outputs"):
            self._task.start()

    def done(self) -> bool:
        with self._backend._sentences("the outputs"):
            return self._count is not None or bool(self._task.is_task_done())

    def stop(self) -> None:
        if self._count is not None:
            return
        # Asked before the stop, since a task that was stopped does not tell; -1 where it does not.
        count = -1
        with suppress(ControllerError, NotConnectedError):
            count = self.generated()
        with self._backend._sentences("the outputs"):
            self._task.stop()
        self._count = count

    def generated(self) -> int:
        if self._count is not None:
            return self._count
        with self._backend._sentences("the outputs"):
            return int(self._task.out_stream.total_samp_per_chan_generated)

    def close(self) -> None:
        if self._count is None:
            count = -1
            with suppress(ControllerError, NotConnectedError):
                count = self.generated()
            self._count = count
        with self._backend._sentences("the outputs"):
            self._task.close()


def _device(channel: str) -> str:
    return channel.strip("/").split("/", maxsplit=1)[0]
