"""Simulated stages: a controller by its address in this process, or the playback of a record."""

import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from flexstage.base.arrays import Array
from flexstage.base.errors import (
    FlexstageError,
    LimitError,
    ModelError,
    NotConnectedError,
    RecordError,
)
from flexstage.files.request import request_fields
from flexstage.instruments.connect import flag, longest_silence, options_of, whole_number
from flexstage.instruments.limits import check_waveform
from flexstage.instruments.pi.connection import TransferLimits
from flexstage.instruments.pi.controller import PiController
from flexstage.instruments.pi.simulated.clock import FastTime, Pacemaker
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.gcs_state import GENERIC, MODELS
from flexstage.instruments.pi.simulated.interpreter import Interpreter
from flexstage.instruments.pi.simulated.server import STOP, ServerSession
from flexstage.instruments.protocol import Waveform
from flexstage.instruments.requests import TwinRequest
from flexstage.instruments.transport import InProcess
from flexstage.records import Record
from flexstage.records.contents import (
    column_label,
    contents,
    is_time,
    likely_drive,
    read_whole,
)
from flexstage.records.read import read_files
from flexstage.records.record import SIMULATED
from flexstage.stage import Stage
from flexstage.stage.designs import design
from flexstage.system.environment import Environment, read_environment
from flexstage.virtual.build import virtual_stage
from flexstage.virtual.neck_widths import measured_necks
from flexstage.virtual.stage import VirtualStage

_OF_REQUEST = ("model", "servo_rate", "amplifier", "environment", "table")
_OPTIONS = ("seed", *_OF_REQUEST, "fast", "scatter", "quiet")
#: Line limit of a simulated controller, longer than that of a real one.
_LONG_LINES = 16384
_LONGEST_WAIT = 60.0


def open_twin(
    address: str, stage: Stage | None, *, axes: Mapping[str, str] | None, timeout: float | None
) -> PiController:
    """Connect to a simulated controller in this process: ``twin://NAME?seed=3&model=lumped``."""
    parts = urlsplit(address.strip())
    options = options_of(address, parts, _OPTIONS)
    name = parts.netloc + parts.path
    if stage is None:
        if not name:
            raise ModelError(
                f"'{address}' has no name of a stage: write twin://vgtu-piezo, or give the stage"
            )
        stage = design(name)
    elif name not in ("", stage.name):
        raise ModelError(
            f"'{address}' is a twin of '{name}', and the stage is '{stage.name}': omit the name, "
            "as in twin://?seed=3"
        )
    silence = longest_silence(timeout, _LONGEST_WAIT)
    request = TwinRequest(
        seed=whole_number(options, "seed", 0, address),
        **_request_options(options, _OF_REQUEST, address),
        fast=flag(options, "fast", True, address),
        identity="flexstage",
    )
    controller = simulated_controller(
        stage,
        request,
        quiet=flag(options, "quiet", False, address),
        scatter=flag(options, "scatter", True, address),
    )
    controller.pace.start()
    conversation = Loopback(controller, ends_time=True)
    link = InProcess(conversation, name=f"twin of {stage.name}")
    transfer = TransferLimits(line_limit=_LONG_LINES)
    return PiController.open(link, stage, axes=axes, timeout=silence, transfer=transfer)


def _request_options(
    options: Mapping[str, str], names: tuple[str, ...], address: str
) -> dict[str, Any]:
    """Return the options of an address that are options of a twin."""
    values = {}
    for name in (name for name in names if name in options):
        try:
            values[name] = request_fields(TwinRequest)[name].read(options[name])
        except FlexstageError as error:
            raise ModelError(f"'{name}' of '{address}': {error}") from None
    return values


def _environment(request: TwinRequest) -> Environment | None:
    return None if request.environment is None else read_environment(request.environment)


def simulated_controller(
    stage: Stage, request: TwinRequest, *, quiet: bool = False, scatter: bool = True
) -> Interpreter:
    """Return the requested controller; its time does not pass until its pace is started."""
    _require_names(request.axes, len(stage.axes))
    stage_in_time: VirtualStage = virtual_stage(
        stage,
        model=request.model,
        seed=request.seed,
        sample_rate_hz=request.servo_rate,
        amplifier=request.amplifier,
        quiet=quiet,
        scatter=scatter,
        widths=measured_necks(request.widths, stage),
        environment=_environment(request),
    )
    if request.table is not None:
        from flexstage.centring.table_file import read_table
        from flexstage.virtual.table import StageOnTable

        stage_in_time = StageOnTable(stage_in_time, read_table(request.table))
    identity = request.identity or ("C-884" if stage_in_time.kind == "screw" else "E-727")
    serial_number = f"twin-{request.seed}"
    device = VirtualController(stage_in_time, serial_number=serial_number, names=request.axes)
    return Interpreter(
        device,
        FastTime(device) if request.fast else Pacemaker(device),
        model=MODELS.get(identity, GENERIC),
    )


def _require_names(requested: tuple[str, ...], axes: int) -> None:
    names = [*requested, *(str(i) for i in range(len(requested) + 1, axes + 1))]
    plain = all(n.isascii() and n.isalnum() and len(n) <= 8 for n in names)
    if len(set(names)) != axes or not plain:
        raise ModelError(
            f"--axes must be at most {axes} different names of 1 to 8 letters or digits, such as "
            f"X,Y, got '{','.join(requested)[:40]}'"
        )


def played(
    stage: Stage, files: Sequence[Path], axis: str | None, request: TwinRequest
) -> tuple[Record, Array | None]:
    """Play the voltages of records one after another; return the response to the last.

    All are refused if one is beyond the limits. If the last has a column ``reference`` in the unit
    of the reading, as `compensate` writes it, the error of the reading is returned too.
    """
    name = stage.axis(axis).name if axis else stage.axes[0].name
    records = [_drive(file) for file in files]
    rate = records[0].sample_rate_hz
    stage_in_time = virtual_stage(
        stage,
        model=request.model,
        seed=request.seed,
        sample_rate_hz=rate * max(1, round(request.servo_rate / rate)),
        amplifier=request.amplifier,
        widths=measured_necks(request.widths, stage),
        environment=_environment(request),
    )
    for file, record in zip(files, records, strict=True):
        if abs(record.sample_rate_hz - rate) > 1e-6 * rate:
            raise RecordError(
                f"records that are played one after another must have one sample rate, got "
                f"{rate:g} Hz and, of '{file}', {record.sample_rate_hz:g} Hz: resample one"
            )
        voltage = {name: record.channels[0].values}
        waveform = Waveform(values=voltage, sample_rate_hz=rate, quantity="voltage")
        try:
            check_waveform(stage_in_time.limits, waveform)
        except LimitError as error:
            raise ModelError(f"'{file}': {error}") from error
    voltages = [record.channels[0].values for record in records]
    starts = [0.0, *(float(values[-1]) for values in voltages[:-1])]
    *_, result = [
        stage_in_time.played(name, values, rate, before=start)
        for values, start in zip(voltages, starts, strict=True)
    ]
    simulated = f"{result.attributes[SIMULATED]}, seed {request.seed}"
    result, position = replace(result, attributes={SIMULATED: simulated}), result.channels[-1]
    for reference in records[-1].channels[1:]:
        if reference.unit == position.unit:
            return result, position.values - reference.values
    return result, None


def _drive(file: Path) -> Record:
    """Read the voltage of a record, and its reference if it has one."""
    columns = [c for c in contents(*read_whole(file))["columns"] if not is_time(c)]
    voltages = [c["number"] for c in likely_drive(columns)[0] if c["unit"] in ("V", "")]
    if len(voltages) != 1:
        raise RecordError(
            f"'{file}' must have one column of a voltage next to its time, such as 'voltage (V)', "
            f"got {len(voltages)} of {', '.join(map(column_label, columns)) or 'none'}"
        )
    references = [c["number"] for c in columns if c["name"] == "reference"][:1]
    (record,) = read_files([file], [*voltages, *references], even=True)
    channels = tuple(record.channel(column) for column in (*voltages, *references))
    return replace(record, channels=channels)


class Loopback:
    """Session in memory, which answers immediately.

    Any thread may send; a stop (character 24) does not wait for other threads. With `ends_time` the
    clock of the controller ends with the session.
    """

    def __init__(self, interpreter: Interpreter, *, ends_time: bool = False) -> None:
        self._interpreter, self._ends_time = interpreter, ends_time
        #: Name of the controller.
        self.name = interpreter.device.identity.model
        self._session = ServerSession(interpreter)
        self._answers = bytearray()
        self._lock = threading.Lock()
        self._closed = False

    def send(self, data: bytes) -> None:
        """Send bytes; the commands are carried out before this returns."""
        self._open()
        if STOP in data:
            self._session.stop()
        with self._lock:
            self._answers += self._session.feed(data)

    def receive(self, timeout: float = 0.0) -> bytes:
        """Return the answers so far, without waiting."""
        self._open()
        with self._lock:
            answers, self._answers = bytes(self._answers), bytearray()
        return answers

    def another(self) -> "Loopback":
        """Open a second session with the same controller."""
        return Loopback(self._interpreter)

    def close(self) -> None:
        """End the session; repeated calls have no effect."""
        if not self._closed:
            self._closed = True
            self._session.close()
            if self._ends_time:
                self._interpreter.pace.close()

    def _open(self) -> None:
        if self._closed:
            raise NotConnectedError("the session with the simulated controller was closed")
