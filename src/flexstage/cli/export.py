"""`flexstage export`: a stage for other programs."""

from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer

from flexstage.cli.options import (
    CurrentOption,
    JsonOption,
    ModelOption,
    PlaneOption,
    QuietOption,
    from_docstring,
    one_of,
    optional,
    positive_length,
    refuse,
    relative,
)
from flexstage.cli.output import (
    FOLDER,
    console,
    print_json,
    print_notes,
    print_table,
    progress_bar,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.errors import ModelError, StageError
from flexstage.export.formats import FORMATS

if TYPE_CHECKING:
    from flexstage.export.request import ExportRequest
    from flexstage.fem import StageModel
    from flexstage.hysteresis import DriveModel
    from flexstage.stage import Stage
    from flexstage.system import Analysis

_Fmi = Literal["2.0", "3.0"]
_FMI: dict[str, tuple[_Fmi, ...]] = {"2.0": ("2.0",), "3.0": ("3.0",), "both": ("2.0", "3.0")}
_ALL = "all"
_SHOWN = 8  # files of a format in the table


@from_docstring
def export(
    stage: StageArgument,
    to: Annotated[str, typer.Option(metavar="|".join(FORMATS))],
    taken: StageOptions = AS_DESCRIBED,
    out: Annotated[Path, FOLDER] = Path("exported"),
    model: ModelOption = "superelement",
    plane: PlaneOption = "auto",
    time_step: str = "0.1 ms",
    hysteresis: list[str] | None = None,
    creep: Annotated[float | None, typer.Option(parser=relative)] = None,
    bandwidth: str | None = None,
    current: CurrentOption = None,
    sensor_bandwidth: str | None = None,
    keep_modes: Annotated[int | None, typer.Option(min=1)] = None,
    fmi: Annotated[str, one_of(_FMI)] = "both",
    source_only: bool = False,
    precision: Annotated[str, one_of(("double", "single"))] = "double",
    kerf: str | None = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Write a stage for Simulink, FMI, C, CAD and other tools.

    Parameters
    ----------
    to
        --to: Format; several separated by commas; 'all' writes every format that the stage allows.
    out
        Folder of the files; several formats get a subfolder each.
    time_step
        TIME: Time between samples (fmu, c, mat, simulink).
    hysteresis
        usual|none|NAME=FILE: Hysteresis of the piezo stacks: a Bouc-Wen loop of usual width, none,
        or the model file of 'flexstage identify' for a drive or axis (may be repeated).
    creep
        SHARE: Creep of the stacks per decade of time, such as "1.5%" (default: no creep).
    bandwidth
        FREQUENCY: Bandwidth of the amplifiers, such as "2 kHz" (default: no amplifier).
    sensor_bandwidth
        FREQUENCY: Bandwidth of the sensors (default: readings equal the true motion).
    keep_modes
        NUMBER: Number of modes to keep (default: all).
    fmi
        FMI version of the FMU.
    source_only
        Write the FMU with C sources only, without a compiled library.
    precision
        Floating-point precision of the C header.
    kerf
        LENGTH: Kerf of wire cutting, such as "0.28 mm"; adds the wire path to the DXF.
    """
    wanted = _formats(to)
    from flexstage.export.request import ExportRequest
    from flexstage.files.write import write_files

    described = taken.stage(stage)
    request = ExportRequest(
        stage=described,
        analyse=lambda: _analysed(described, model, plane),
        hysteresis=lambda: _read_hysteresis(hysteresis or ["usual"]),
        plane=plane,
        step=_number("--time-step", time_step, "time", "s"),
        creep=creep,
        bandwidth_hz=_number("--bandwidth", bandwidth, "frequency", "Hz"),
        current_limit=_number("--current", current, "current", "A"),
        sensor_bandwidth_hz=_number("--sensor-bandwidth", sensor_bandwidth, "frequency", "Hz"),
        mode_count=keep_modes,
        precision=precision,  # type: ignore[arg-type]
        fmi=_FMI[fmi],
        source_only=source_only,
        kerf=None if kerf is None else positive_length(kerf, "--kerf", "m"),
    )
    if to.strip() != _ALL and any(FORMATS[name].in_time for name in wanted):
        request.require_hysteresis()
    made: dict[str, dict[str, bytes]] = {}
    with progress_bar("export", quiet=quiet):
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
    print_table(
        screen,
        f"{request.stage.name} for other programs",
        ("format", "<what", "<files"),
        ((name, FORMATS[name].about, _shown(paths)) for name, paths in files.items()),
    )
    print_notes(screen, notes)


def _formats(text: str) -> list[str]:
    """The formats of a list, each once, in the order of the list."""
    if text.strip() == _ALL:
        return list(FORMATS)
    names = list(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in names:
        if name not in FORMATS:
            raise StageError(
                f"--to is one or more of {', '.join(FORMATS)}, separated by commas, or all, got "
                f"'{name[:40]}'"
            )
    return names


def _analysed(stage: "Stage", model: str, plane: str) -> "tuple[Analysis, StageModel | None]":
    from flexstage.studies import run_model
    from flexstage.studies.requests import ModelOptions

    run = run_model(stage, model, ModelOptions(plane=plane))  # type: ignore[arg-type]
    return run.analysis, run.mesh


def _read_hysteresis(given: Sequence[str]) -> "Mapping[str, DriveModel] | Literal['usual', 'none']":
    """Return the identified model of each drive, of texts ``NAME=FILE``.

    A text may be ``usual`` or ``none`` alone, which is returned.
    """
    from flexstage.hysteresis.model_file import read_model_file

    if len(given) == 1 and given[0] in ("usual", "none"):
        return cast(Literal["usual", "none"], given[0])
    models: dict[str, DriveModel] = {}
    for text in given:
        name, sign, path = text.partition("=")
        refuse(
            not (name and sign and path),
            f"--hysteresis is usual, none, or NAME=FILE for each drive, got '{text[:80]}'",
        )
        refuse(name in models, f"--hysteresis gives a model for '{name}' twice: give it once")
        models[name] = read_model_file(Path(path)).model
    return models


def _shown(paths: list[Path]) -> str:
    """A line for each file, and where there are very many for the first ones."""
    lines = [str(path) for path in paths]
    if len(lines) > _SHOWN:
        lines[_SHOWN - 1 :] = [f"and {len(lines) - _SHOWN + 1} more beside these"]
    return "\n".join(lines)


def _number(option: str, text: str | None, dimension: str, unit: str) -> Any:
    """Return what an option gives, above zero; None where it is not given."""
    value = optional(text, dimension, bare_unit=unit)
    refuse(value is not None and not value > 0.0, f"{option} must be above zero, got '{text}'")
    return value


def _results(
    request: "ExportRequest",
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
