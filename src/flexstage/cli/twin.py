"""`flexstage twin`: a simulated stage behind a GCS controller on a TCP port."""

import contextlib
import json
import signal
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from flexstage.base.errors import ModelError, NotConnectedError, RecordError
from flexstage.cli.options import AxisOption, JsonOption, QuietOption, from_docstring, refuse
from flexstage.cli.output import (
    OutputFile,
    console,
    print_json,
    print_notes,
    progress_bar,
    record_format,
    write_file,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.instruments.requests import TwinRequest
from flexstage.web.options import is_loopback

if TYPE_CHECKING:
    import socket

    from flexstage.instruments.pi.simulated.server import GcsServer
    from flexstage.virtual.sensors import ChannelDescription


@from_docstring
def twin(
    stage: StageArgument,
    request: TwinRequest,
    play: list[Path] | None = None,
    axis: AxisOption = None,
    out: OutputFile = None,
    options: StageOptions = AS_DESCRIBED,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run a simulated stage behind a GCS 2.0 controller.

    Parameters
    ----------
    play
        FILE: Record whose voltage drives the stack of an axis; no port is opened. May be repeated:
        the records are played one after another. STAGE can then be a model of coupled drives, whose
        inputs are columns of one record.
    out
        Write the voltage and position of the last --play (.csv, .npz, .h5 or .mat).
    """
    incomplete = bool(play) != (out is not None) or (axis is not None and not play)
    refuse(
        incomplete, "--play and --out are used together, and --axis with them", typer.BadParameter
    )
    refuse(
        bool(play) and request.table is not None,
        "--table serves a table with the controller: omit it, or --play",
        typer.BadParameter,
    )
    from flexstage.hysteresis.coupled_drives.model_file import is_coupled_model

    model = Path(stage)
    described = None if is_coupled_model(model) else options.stage(stage)
    if play and out is not None:
        import numpy as np

        from flexstage.quantities.units import readable
        from flexstage.records.write import record_bytes

        kind = record_format(out)
        same = out.resolve() in (record.resolve() for record in play)
        refuse(same, f"--out {out} is a record of --play: name another file", RecordError)
        with progress_bar("twin", quiet=quiet):
            if described is None:
                other = axis is not None or options != AS_DESCRIBED or request != TwinRequest()
                refuse(
                    other or len(play) > 1,
                    "a model of coupled drives takes one record by --play, and --out, alone",
                    ModelError,
                )
                from flexstage.hysteresis.coupled_drives.prediction import played_record

                record, error = played_record(model, play[0]), None
            else:
                from flexstage.instruments.pi.simulated.address import played

                record, error = played(described, play, axis, request)
        write_file(out, record_bytes(record, kind))
        tracking = (
            {}
            if error is None
            else {
                "rms": float(np.sqrt(np.mean(error**2))),
                "largest": float(np.max(np.abs(error))),
                "mean": float(np.mean(error)),
            }
        )
        name = model.stem if described is None else described.name
        if as_json:
            files = {"records": [*map(str, play)], "files": [str(out)]}
            print_json({"stage": name, **files, "tracking": tracking or None})
            return
        if tracking:
            unit = record.channels[-1].unit
            rms, largest, mean = (readable(unit, value) for value in tracking.values())
            console().print(
                f"reading less reference of {play[-1]}: {rms} rms, {largest} at most, {mean} on "
                "average"
            )
        print_notes(console(), (), [out])
        return
    if described is None:
        raise ModelError("coupled drives have no simulated controller: give --play and --out")
    host, port = request.address
    with _stop_event() as stop, _reserve(host, port) as listener:
        from flexstage.instruments.pi.simulated.address import simulated_controller
        from flexstage.instruments.pi.simulated.server import GcsServer
        from flexstage.virtual.sensors import sensor_channels

        controller = simulated_controller(described, request)
        server = GcsServer(controller, listener=listener)
        try:
            with _address_errors(host, port):
                server.start()
            device = controller.device
            further = device.channels[len(sensor_channels(device.stage.axes)) :]
            _print_address(
                server, described.name, host, as_json=as_json, fast=request.fast, further=further
            )
            stop.wait()
        finally:
            server.close()
        if (lost := controller.pace.lost) > 0.0:
            typer.echo(
                f"flexstage: this computer was too slow: the simulated time stopped for {lost:.1f} "
                "s; choose a lower --servo-rate, or --fast",
                err=True,
            )


def _reserve(host: str, port: int) -> "socket.socket":
    from flexstage.instruments.pi.simulated.server import reserve

    with _address_errors(host, port):
        return reserve(host, port)


@contextlib.contextmanager
def _address_errors(host: str, port: int) -> Iterator[None]:
    try:
        yield
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise NotConnectedError(
            f"cannot listen at {host}:{port} ({why}): choose another host or port by --address; "
            "port 0 selects a free one"
        ) from error


def _print_address(
    server: "GcsServer",
    name: str,
    host: str,
    *,
    as_json: bool,
    fast: bool,
    further: "Sequence[ChannelDescription]",
) -> None:
    address, port = server.address
    if not is_loopback(host):
        typer.echo(
            f"flexstage: anyone who can reach {address}:{port} can move this simulated stage",
            err=True,
        )
    bracketed = f"[{address}]" if ":" in address else address
    where = f"gcs://{bracketed}:{port}"
    if as_json:
        result: dict[str, object] = {"stage": name, "address": where, "host": address}
        result |= {"port": port, "fast": fast}
        if further:
            result["channels"] = {channel.name: channel.number for channel in further}
        line = json.dumps(result)
    else:
        table = ", ".join(f"{channel.name} = channel {channel.number}" for channel in further)
        line = f"twin of {name} at {where} (simulated); Ctrl-C stops it"
        line += f"; table: {table}" * bool(table)
    typer.echo(line)
    typer.get_text_stream("stdout").flush()


@contextlib.contextmanager
def _stop_event() -> Iterator[threading.Event]:
    """Yield an event that SIGINT and SIGTERM set."""
    stop = threading.Event()
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {n: signal.signal(n, lambda *_: stop.set()) for n in numbers}
    try:
        yield stop
    finally:
        for n, handler in before.items():
            signal.signal(n, handler)
