"""`flexstage export`: a stage for other programs."""

from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from flexstage.cli.common import (
    JsonOption,
    ModelOption,
    PlaneOption,
    StageArgument,
    console,
    folder_option,
    load_stage,
    make_table,
    print_json,
    progress_bar,
    relative,
)
from flexstage.cli.export_formats import FORMATS
from flexstage.cli.export_request import ExportRequest
from flexstage.errors import ModelError, StageError

__all__ = ["export"]

_Fmi = Literal["2.0", "3.0"]
_FMI: dict[str, tuple[_Fmi, ...]] = {"2.0": ("2.0",), "3.0": ("3.0",), "both": ("2.0", "3.0")}
_ALL = "all"
_SHOWN = 8  # files of a format in the table
_PRECISIONS = ("double", "single")


def export(
    stage: StageArgument,
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="|".join(FORMATS),
            help="What to write; several are divided by commas, 'all' is every one that the stage "
            "allows.",
        ),
    ],
    out: Annotated[
        Path,
        folder_option("Where to; several formats get a folder each in it."),
    ] = Path("exported"),
    model: ModelOption = "superelement",
    plane: PlaneOption = "auto",
    step: Annotated[
        str,
        typer.Option(metavar="TIME", help="Time between samples of fmu, c, mat and simulink."),
    ] = "0.1 ms",
    hysteresis: Annotated[
        list[str] | None,
        typer.Option(
            metavar="usual|none|NAME=FILE",
            help="Hysteresis of the piezo stacks: a Bouc-Wen loop of a usual width, none, or the "
            "file of 'flexstage identify' for each drive or axis (again for the next).",
        ),
    ] = None,
    creep: Annotated[
        float | None,
        typer.Option(
            parser=relative,
            metavar="SHARE",
            help='Creep of the stacks in a decade of time, such as "1.5%"; none if not given.',
        ),
    ] = None,
    bandwidth: Annotated[
        str | None,
        typer.Option(
            metavar="FREQUENCY",
            help='Bandwidth of the amplifiers, such as "2 kHz"; no amplifier if not given.',
        ),
    ] = None,
    current: Annotated[
        str | None,
        typer.Option(metavar="CURRENT", help='Largest current of an amplifier, such as "0.1 A".'),
    ] = None,
    sensor_bandwidth: Annotated[
        str | None,
        typer.Option(
            metavar="FREQUENCY",
            help="Bandwidth of the sensors; the readings are the true motion if not given.",
        ),
    ] = None,
    modes: Annotated[
        int | None,
        typer.Option(metavar="NUMBER", min=1, help="Modes that are kept; all if not given."),
    ] = None,
    fmi: Annotated[
        str, typer.Option(metavar="2.0|3.0|both", help="Version of FMI for fmu.")
    ] = "both",
    source_only: Annotated[
        bool, typer.Option("--source-only", help="No compiled library in the FMU.")
    ] = False,
    precision: Annotated[
        str, typer.Option(metavar="double|single", help="Numbers of the C header.")
    ] = "double",
    kerf: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH",
            help='Width of the cut, such as "0.28 mm": adds the path of the wire to the DXF.',
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Write a stage for Simulink, FMI, C, CAD and other tools."""
    wanted = _formats(to)
    if fmi not in _FMI:
        raise ModelError(f"--fmi is 2.0, 3.0 or both, got '{fmi[:40]}'")
    if precision not in _PRECISIONS:
        raise ModelError(f"--precision is double or single, got '{precision[:40]}'")
    from flexstage.report.files import write_files

    request = ExportRequest(
        stage=load_stage(stage),
        model=model,
        plane=plane,
        step=_number("--step", step, "time", "s"),
        hysteresis=hysteresis or ["usual"],
        creep=creep,
        bandwidth_hz=_optional("--bandwidth", bandwidth, "frequency", "Hz"),
        current_limit=_optional("--current", current, "current", "A"),
        sensor_bandwidth_hz=_optional("--sensor-bandwidth", sensor_bandwidth, "frequency", "Hz"),
        mode_count=modes,
        precision=precision,
        fmi=_FMI[fmi],
        source_only=source_only,
        kerf=_optional("--kerf", kerf, "length", "m"),
    )
    if to.strip() != _ALL and any(FORMATS[name].in_time for name in wanted):
        request.require_hysteresis()
    made: dict[str, dict[str, bytes]] = {}
    with progress_bar():
        for name in wanted:
            try:
                made[name] = FORMATS[name].write(request)
            except (ModelError, StageError) as error:
                if to.strip() != _ALL:
                    raise
                request.remarks.append(f"{name} was left out: {error}.")
    if not made:
        raise StageError(f"stage '{request.stage.name}' fits no format: {request.remarks[0]}")
    alone = len(made) == 1
    # all formats at once: where one cannot be written, none is
    written = iter(
        write_files(
            out,
            {
                file if alone else f"{name}/{file}": content
                for name, contents in made.items()
                for file, content in contents.items()
            },
        )
    )
    files = {name: list(islice(written, len(contents))) for name, contents in made.items()}
    notes = list(request.notes)
    if json:
        print_json(_results(request, made, files, notes))
        return
    screen = console()
    table = make_table(f"{request.stage.name} for other programs", "format", "<what", "<files")
    for name, paths in files.items():
        table.add_row(name, FORMATS[name].about, _shown(paths))
    screen.print(table)
    for note in notes:
        screen.print(f"note: {note}", style="dim", markup=False)


def _formats(text: str) -> list[str]:
    """The formats of a list, each once, in the order of the list."""
    if text.strip() == _ALL:
        return list(FORMATS)
    names = list(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in names:
        if name not in FORMATS:
            raise StageError(
                f"--to is one or more of {', '.join(FORMATS)}, divided by commas, or all, got "
                f"'{name[:40]}'"
            )
    return names


def _shown(paths: list[Path]) -> str:
    """A line for each file, and where there are very many for the first ones."""
    lines = [str(path) for path in paths]
    if len(lines) > _SHOWN:
        lines[_SHOWN - 1 :] = [f"and {len(lines) - _SHOWN + 1} more beside these"]
    return "\n".join(lines)


def _number(option: str, text: str, dimension: str, unit: str) -> float:
    from flexstage.units import parse

    value = parse(text, dimension, bare_unit=unit)
    if not value > 0.0:
        raise ModelError(f"{option} must be above zero, got '{text[:40]}'")
    return value


def _optional(option: str, text: str | None, dimension: str, unit: str) -> float | None:
    return None if text is None else _number(option, text, dimension, unit)


def _results(
    request: ExportRequest,
    made: dict[str, dict[str, bytes]],
    files: dict[str, list[Path]],
    notes: list[str],
) -> dict[str, Any]:
    import hashlib

    return {
        "stage": request.stage.name,
        "files": [
            {
                "format": name,
                "path": str(path),
                "bytes": len(content),
                "sha256": hashlib.sha256(content).hexdigest(),
            }
            for name, paths in files.items()
            for path, content in zip(paths, made[name].values(), strict=True)
        ],
        "notes": notes,
    }
