"""`flexstage twin`: a simulated stage behind a GCS controller on a TCP port."""

import contextlib
import json
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from flexstage.base.errors import NotConnectedError
from flexstage.cli.options import AxisOption, JsonOption, QuietOption, from_docstring, refuse
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
from flexstage.instruments.requests import TwinRequest
from flexstage.web.options import is_loopback

if TYPE_CHECKING:
    import socket

    from flexstage.instruments.pi.simulated.server import GcsServer


@from_docstring
def twin(
    stage: StageArgument,
    request: TwinRequest,
    play: Path | None = None,
    axis: AxisOption = None,
    out: OutputFile = None,
    taken: StageOptions = AS_DESCRIBED,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run a simulated stage behind a GCS 2.0 controller.

    Parameters
    ----------
    play
        FILE: Record whose voltage the stack of an axis gets; no port is opened.
    out
        Write voltage and position that --play gives (.csv, .npz, .h5 or .mat).
    """
    alone = (play is None) != (out is None) or (axis is not None and play is None)
    refuse(alone, "--play and --out go together, and --axis with them", typer.BadParameter)
    described = taken.stage(stage)
    if play is not None and out is not None:
        from flexstage.instruments.pi.simulated.address import played
        from flexstage.records.write import record_bytes

        kind = record_format(out)
        with progress_bar("twin", quiet=quiet):
            record = played(described, play, axis, request)
        write_file(out, record_bytes(record, kind))
        said = {"stage": described.name, "record": str(play), "files": [str(out)]}
        print_json(said) if as_json else print_notes(console(), (), [out])
        return
    host, port = request.address
    with _ended_by_signals() as ended, _reserved(host, port) as listener:
        from flexstage.instruments.pi.simulated.address import simulated_controller
        from flexstage.instruments.pi.simulated.server import GcsServer

        controller = simulated_controller(described, request)
        server = GcsServer(controller, listener=listener)
        try:
            with _taken(host, port):
                server.start()
            _say_where(server, described.name, host, as_json=as_json, fast=request.fast)
            ended.wait()
        finally:
            server.close()
        if (lost := controller.pace.lost) > 0.0:
            typer.echo(
                f"flexstage: this computer was too slow by {lost:.1f} s: simulated time stood "
                "still for that long; choose a lower --servo-rate, or --fast",
                err=True,
            )


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
            f"cannot listen at {host}:{port} ({why}): choose another port by --address, 0 for any "
            "that is free, or another host"
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
