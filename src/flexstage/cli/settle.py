"""`flexstage settle`: settling time of a move, plain, shaped, and in minimum time."""

import math
from typing import TYPE_CHECKING

from flexstage.cli.options import AxisOption, JsonOption, QuietOption, from_docstring, refuse
from flexstage.cli.output import (
    FigureFile,
    OutputFile,
    console,
    print_notes,
    print_result,
    print_table,
    progress_bar,
    record_format,
    write_file,
    write_picture,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.studies.requests import SettleRequest

if TYPE_CHECKING:
    from flexstage.studies.settling import SettlingStudy, SettlingTime


@from_docstring
def settle(
    stage: StageArgument,
    request: SettleRequest,
    axis: AxisOption = None,
    write: str = "zvd",
    out: OutputFile = None,
    figure: FigureFile = None,
    options: StageOptions = AS_DESCRIBED,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Settling time of a move: plain, shaped, in minimum time.

    Each is predicted, with its scatter over the tolerance of the modes, and simulated, in open loop
    and with feedback.

    Parameters
    ----------
    write
        NAME: Move that --out writes: step, jerk-limited, zv, zvd, ei, minimum-time or "robust
        minimum-time".
    out
        Write its voltages for a controller, the twin or the panel (.csv, .npz, .h5 or .mat).
    figure
        Draw distance from the end over time (.svg, .png or .pdf).
    """
    from flexstage.studies.settling import VOLTAGES
    from flexstage.studies.settling import settle as run

    format = record_format(out)
    kinds = ", ".join(VOLTAGES)
    refuse(write not in VOLTAGES, f"--write is one of {kinds}, got '{write[:60]}'")
    with progress_bar("settle", quiet=quiet):
        study = run(options.stage(stage), request, axis)
    files = write_picture(figure, study.plot)
    if out is not None:
        from flexstage.records.write import record_bytes

        write_file(out, record_bytes(study.record(write), format))
        files = [out, *files]
    if json:
        print_result(study.to_dict(), files)
        return
    _print(study)
    print_notes(console(), study.notes, files)


def _print(study: "SettlingStudy") -> None:
    from flexstage.quantities.table import Column
    from flexstage.quantities.units import readable

    columns = [Column("move", "title"), Column("command, ms")]
    for group in ("open loop, ms", "with feedback, ms"):
        columns += [Column(name, group=group) for name in ("predicted", "95 %", "simulated")]
    columns += [Column("peak, um"), Column("current, mA", spare=True)]
    rows = [
        (
            move.kind,
            f"{1e3 * move.duration:.1f}",
            *_times(move.open_loop),
            *_times(move.feedback),
            f"{1e6 * move.peak:.2f}",
            "" if move.current is None else f"{1e3 * move.current:.0f}",
        )
        for move in study.moves
    ]
    shaped = ", ".join(f"{f:.4g} Hz" for f, _ in study.shapers)
    move, band = readable("m", study.distance), readable("m", study.band)
    caption = f"{study.stage}, axis {study.axis}: {move} to within {band}; shaped for {shaped}"
    print_table(console(), caption, columns, rows)


def _times(times: "SettlingTime | None") -> tuple[str, str, str]:
    if times is None:
        return "", "", ""
    values = (times.predicted, times.quantile, times.simulated)
    first, second, third = (f"{1e3 * t:.1f}" if math.isfinite(t) else "never" for t in values)
    return first, second, third
