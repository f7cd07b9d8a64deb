"""A stage as it is asked for, simulated: behind a controller, or under the voltage of a record."""

from pathlib import Path

from flexstage.errors import LimitError, ModelError
from flexstage.instruments.limits import check_waveform
from flexstage.instruments.pi.simulated.clock import FastTime, Pacemaker
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.gcs_state import MODELS, OWN
from flexstage.instruments.pi.simulated.interpreter import Interpreter
from flexstage.instruments.pi.simulated.request import TwinRequest
from flexstage.instruments.waveform import Waveform
from flexstage.records import Record
from flexstage.records.files import read_files
from flexstage.records.likely_columns import taken_drive
from flexstage.records.read_options import ReadOptions
from flexstage.stage import Stage
from flexstage.virtual.build import virtual_stage


def simulated_controller(
    stage: Stage, request: TwinRequest, *, quiet: bool = False, scatter: bool = True
) -> Interpreter:
    """Return the controller that is asked for; its time stands still until its pace is started."""
    _require_names(request.axes, len(stage.axes))
    made = virtual_stage(
        stage,
        model=request.model,
        seed=request.seed,
        sample_rate_hz=request.servo_rate,
        amplifier=request.amplifier,
        quiet=quiet,
        scatter=scatter,
    )
    identity = request.identity or ("C-884" if made.kind == "screw" else "E-727")
    serial_number = request.serial_number or f"twin-{request.seed}"
    device = VirtualController(made, serial_number=serial_number, names=request.axes)
    return Interpreter(
        device,
        FastTime(device) if request.fast else Pacemaker(device),
        model=MODELS.get(identity, OWN),
        hold=request.hold_control,
    )


def _require_names(given: tuple[str, ...], axes: int) -> None:
    named = [*given, *(str(i) for i in range(len(given) + 1, axes + 1))]
    plain = all(n.isascii() and n.isalnum() and len(n) <= 8 for n in named)
    if len(set(named)) != axes or not plain:
        raise ModelError(
            f"--axes must be {axes} or fewer different names of 1 to 8 letters or digits, such as "
            f"X,Y, got '{','.join(given)[:40]}'"
        )


def played(stage: Stage, file: Path, axis: str | None, request: TwinRequest) -> Record:
    """Return what a stage does under the voltage of a record; refuse what exceeds its limits."""
    name = stage.axis(axis).name if axis else stage.axes[0].name
    ((driven,), _, _) = taken_drive(file, ((), ("none",)), ReadOptions())
    (record,) = read_files([file], [driven], units=[None], even=True)
    rate, values = record.sample_rate_hz, record.channel(driven).values
    made = virtual_stage(
        stage,
        model=request.model,
        seed=request.seed,
        sample_rate_hz=rate * max(1, round(request.servo_rate / rate)),
        amplifier=request.amplifier,
    )
    waveform = Waveform(values={name: values}, sample_rate_hz=rate, quantity="voltage")
    try:
        check_waveform(made.limits, waveform)
    except LimitError as error:
        raise ModelError(f"'{file}': {error}") from error
    return made.played(name, values, rate)
