"""`flexstage twin`: a simulated stage behind a GCS controller on a TCP port."""

import contextlib
import json
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer

from flexstage.cli.options import (
    AxisOption,
    JsonOption,
    QuietOption,
    from_docstring,
    one_of,
    quantity,
    refuse,
)
from flexstage.cli.output import (
    OutputFile,
    console,
    print_json,
    print_notes,
    progress_bar,
    write_file,
)
from flexstage.cli.reading import record_format
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.errors import LimitError, ModelError, NotConnectedError, UnitError
from flexstage.web.options import is_loopback

if TYPE_CHECKING:
    import socket

    from flexstage.instruments.pi.simulated.server import GcsServer
    from flexstage.stage import Stage

_MODELS = ("lumped", "superelement")
_AMPLIFIERS = ("voltage", "charge")
_IDENTITIES = ("E-727", "E-709", "E-712", "E-725", "E-753", "E-754", "E-516", "E-517", "C-863",
               "C-884", "flexstage")  # fmt: skip
_PORTS = 65535


@from_docstring
def twin(
    stage: StageArgument,
    taken: StageOptions = AS_DESCRIBED,
    port: int = 50000,
    host: str = "127.0.0.1",
    seed: Annotated[int, typer.Option(min=0)] = 0,
    model: Annotated[str, one_of(_MODELS)] = "lumped",
    servo_rate: str = "10 kHz",
    amplifier: Annotated[str, one_of(_AMPLIFIERS)] = "voltage",
    fast: bool = False,
    identity: Annotated[str | None, one_of(_IDENTITIES)] = None,
    axes: str = "",
    serial_number: str = "",
    hold_control: bool = False,
    play: Path | None = None,
    axis: AxisOption = None,
    out: OutputFile = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run a simulated stage behind a GCS 2.0 controller.

    Parameters
    ----------
    port
        NUMBER: TCP port; 0 for any free port.
    host
        ADDRESS: Address to listen on; any address but 127.0.0.1 lets others on the network move the
        stage.
    seed
        NUMBER: Random seed of the simulated stage.
    model
        Model of the mechanics: rigid bodies, or finite elements, condensed.
    servo_rate
        FREQUENCY: Rate of the servo loop, such as "10 kHz".
    amplifier
        Amplifier of the piezo stacks; no effect on screw drives.
    fast
        Advance simulated time by commands instead of real time.
    identity
        Controller type that it reports, by which programs choose their driver (default: E-727, or
        C-884 for screws); flexstage: own name and all commands.
    axes
        NAMES: Identifiers of its axes, such as "Z" or "X,Y" (default: 1,2,...).
    serial_number
        TEXT: Serial number that it reports (default: twin-SEED).
    play
        FILE: Record whose voltage the stack of an axis gets; no port is opened.
    out
        Write voltage and position that --play gives (.csv, .npz, .h5 or .mat).
    hold_control
        The first program that sends a motion or a change keeps control until it disconnects
        (default: all have control, as with a real controller).
    """
    misuse = typer.BadParameter
    refuse(not 0 <= port <= _PORTS, f"--port must be 0 to {_PORTS}, got {port}", misuse)
    plain = serial_number.isascii() and serial_number.isprintable()
    refuse(not plain, "--serial-number must be of plain printable characters", misuse)
    loop_rate = quantity(servo_rate, "frequency", bare_unit="Hz")
    sentence = f"--servo-rate must be 1 kHz to 50 kHz, got '{servo_rate}'"
    refuse(not 1e3 <= loop_rate <= 50e3, sentence, UnitError)
    alone = (play is None) != (out is None) or (axis is not None and play is None)
    refuse(alone, "--play and --out go together, and --axis with them", misuse)
    described = taken.stage(stage)
    if play is not None and out is not None:
        how = {"model": model, "seed": seed, "amplifier": amplifier}
        with progress_bar("twin", quiet=quiet):
            _play(described, play, out, axis, loop_rate, how)
        said = {"stage": described.name, "record": str(play), "files": [str(out)]}
        print_json(said) if as_json else print_notes(console(), (), [out])
        return
    names = axes.split(",") if axes else []
    named = [*names, *(str(i) for i in range(len(names) + 1, len(described.axes) + 1))]
    if len(set(named)) != len(described.axes) or not all(
        n.isascii() and n.isalnum() and len(n) <= 8 for n in named
    ):
        raise typer.BadParameter(
            f"--axes must be {len(described.axes)} or fewer different names of 1 to 8 letters or "
            f"digits, such as X,Y, got '{axes[:40]}'"
        )

    with _ended_by_signals() as ended, _reserved(host, port) as listener:
        from flexstage.instruments.pi.simulated.clock import FastTime, Pacemaker
        from flexstage.instruments.pi.simulated.controller import VirtualController
        from flexstage.instruments.pi.simulated.gcs_state import MODELS, OWN
        from flexstage.instruments.pi.simulated.interpreter import Interpreter
        from flexstage.instruments.pi.simulated.server import GcsServer
        from flexstage.virtual.build import virtual_stage

        made = virtual_stage(
            described,
            model=cast(Literal["lumped", "superelement"], model),
            seed=seed,
            sample_rate_hz=loop_rate,
            amplifier=cast(Literal["voltage", "charge"], amplifier),
        )
        identity = identity or ("C-884" if made.kind == "screw" else _IDENTITIES[0])
        device = VirtualController(made, serial_number=serial_number or f"twin-{seed}", names=names)
        real = Pacemaker(device)
        interpreter = Interpreter(
            device,
            FastTime(device) if fast else real,
            model=MODELS.get(identity, OWN),
            hold=hold_control,
        )
        server = GcsServer(interpreter, listener=listener)
        try:
            with _taken(host, port):
                server.start()
            _say_where(server, described.name, host, as_json=as_json, fast=fast)
            ended.wait()
        finally:
            server.close()
        if real.lost > 0.0:
            typer.echo(
                f"flexstage: this computer was too slow by {real.lost:.1f} s: simulated time stood "
                "still for that long; choose a lower --servo-rate, or --fast",
                err=True,
            )


def _play(
    stage: "Stage", file: Path, out: Path, axis: str | None, loop_rate: float, how: dict[str, Any]
) -> None:
    """Simulate what a stage does under the voltage of a record; refuse what exceeds its limits."""
    from flexstage.instruments.limits import check_waveform
    from flexstage.instruments.waveform import Waveform
    from flexstage.records.files import read_files
    from flexstage.records.likely_columns import taken_drive
    from flexstage.records.read_options import ReadOptions
    from flexstage.records.write import record_bytes
    from flexstage.virtual.build import virtual_stage

    kind, name = record_format(out), stage.axis(axis).name if axis else stage.axes[0].name
    ((driven,), _, _) = taken_drive(file, ((), ("none",)), ReadOptions())
    (record,) = read_files([file], [driven], units=[None], even=True)
    rate, values = record.sample_rate_hz, record.channel(driven).values
    made = virtual_stage(stage, sample_rate_hz=rate * max(1, round(loop_rate / rate)), **how)
    waveform = Waveform(values={name: values}, sample_rate_hz=rate, quantity="voltage")
    try:
        check_waveform(made.limits, waveform)
    except LimitError as error:
        raise ModelError(f"'{file}': {error}") from error
    write_file(out, record_bytes(made.played(name, values, rate), kind))


def _reserved(host: str, port: int) -> "socket.socket":
    from flexstage.instruments.pi.simulated.server import reserve

    with _taken(host, port):
        return reserve(host, port)


@contextlib.contextmanager
def _taken(host: str, port: int) -> Iterator[None]:
    try:
        yield
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise NotConnectedError(
            f"cannot listen at {host}:{port} ({why}): choose another --port, 0 for any that is "
            "free, or another --host"
        ) from error


def _say_where(server: "GcsServer", name: str, host: str, *, as_json: bool, fast: bool) -> None:
    address, port = server.address
    if not is_loopback(host):
        typer.echo(f"flexstage: anyone who reaches {address}:{port} can move this stage", err=True)
    bracketed = f"[{address}]" if ":" in address else address
    where = f"gcs://{bracketed}:{port}"
    if as_json:
        said = {"stage": name, "address": where, "host": address, "port": port, "fast": fast}
        line = json.dumps(said)
    else:
        line = f"twin of {name} at {where} (simulated); Ctrl-C ends it"
    typer.echo(line)
    typer.get_text_stream("stdout").flush()


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[threading.Event]:
    """Give an event that an interrupt, or a request to terminate, sets."""
    ended = threading.Event()
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {n: signal.signal(n, lambda *_: ended.set()) for n in numbers}
    try:
        yield ended
    finally:
        for n, handler in before.items():
            signal.signal(n, handler)
