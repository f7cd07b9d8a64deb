"""`flexstage twin`: a simulated stage behind a GCS controller on a TCP port."""

import contextlib
import ipaddress
import json
import signal
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from flexstage.cli.options import JsonOption, from_docstring, one_of, quantity
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.errors import NotConnectedError, UnitError

if TYPE_CHECKING:
    import socket

    from flexstage.instruments.pi.simulated.server import GcsServer

_MODELS = ("lumped", "superelement")
_AMPLIFIERS = ("voltage", "charge")
_IDENTITIES = ("E-727", "E-709", "E-712", "E-725", "E-753", "E-754", "E-516", "E-517", "flexstage")
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
    identity: Annotated[str, one_of(_IDENTITIES)] = _IDENTITIES[0],
    serial_number: str = "",
    hold_control: bool = False,
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
        Controller type that it reports, by which programs choose their driver; flexstage: own name
        and all commands.
    serial_number
        TEXT: Serial number that it reports (default: twin-SEED).
    hold_control
        The first program that sends a motion or a change keeps control until it disconnects
        (default: all have control, as with a real controller).
    """
    _check("--model", model, _MODELS)
    _check("--amplifier", amplifier, _AMPLIFIERS)
    _check("--identity", identity, _IDENTITIES)
    if not 0 <= port <= _PORTS:
        raise typer.BadParameter(f"--port must be 0 to {_PORTS}, got {port}")
    if not (serial_number.isascii() and serial_number.isprintable()):
        raise typer.BadParameter("--serial-number must be of plain printable characters")
    loop_rate = _rate(servo_rate)
    described = taken.stage(stage)

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
        device = VirtualController(made, serial_number=serial_number or f"twin-{seed}")
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


def _check(option: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        known = ", ".join(allowed[:-2]) + ", " * (len(allowed) > 2) + " or ".join(allowed[-2:])
        raise typer.BadParameter(f"{option} must be {known}, got '{value[:40]}'")


def _rate(text: str) -> float:
    rate = quantity(text, "frequency", bare_unit="Hz")
    if not 1e3 <= rate <= 50e3:
        raise UnitError(f"--servo-rate must be 1 kHz to 50 kHz, got '{text}'")
    return rate


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
    if not _is_loopback(host):
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


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


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
