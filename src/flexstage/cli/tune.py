"""`flexstage tune`: position control from a stage or a measured frequency response."""

import math
from typing import TYPE_CHECKING, Annotated

import typer

from flexstage.cli.options import JsonOption, QuietOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    OutputFile,
    console,
    print_notes,
    print_result,
    print_table,
    progress_bar,
    write_file,
    write_picture,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageOptions, designs_like
from flexstage.measure.requests import TuneRequest
from flexstage.records.read_options import ReadOptions

if TYPE_CHECKING:
    from flexstage.control.measured_response import ResponseDesign
    from flexstage.control.tuning import AxesDesign
    from flexstage.system.servo import InnerLoop


@from_docstring
def tune(
    stage: Annotated[
        str | None, typer.Argument(autocompletion=designs_like, show_default=False)
    ] = None,
    *,
    request: TuneRequest,
    options: StageOptions = AS_DESCRIBED,
    read_options: ReadOptions,
    out: OutputFile = None,
    figure: FigureFile = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Tune a position control on a stage or a measured response.

    No model is fitted to a response. The margins hold for every member of a set: all repetitions,
    with their uncertainty and with shifted frequencies.

    Parameters
    ----------
    stage
        [STAGE]: A stage file, or the name of a built-in design.
    out
        Write the control as a file for budget --loop (.yaml), or as a function in C (.c).
    figure
        Draw open loops and sensitivities of the set (.svg, .png or .pdf).
    """
    from flexstage.control.measured_response import ResponseDesign
    from flexstage.control.tuning import tune_files
    from flexstage.studies.models import stage_tuning

    options.require_stage(stage, "a STAGE")
    with progress_bar("tune", quiet=quiet):
        design = (
            tune_files(request, read_options)
            if stage is None
            else stage_tuning(options.stage(stage), request)
        )
    axes = {"": design} if isinstance(design, ResponseDesign) else design.by_axis
    texts = {} if out is None else {
        out.with_name(f"{out.stem}-{name}{out.suffix}") if name else out: _text(axis, out.suffix)
        for name, axis in axes.items()
    }  # fmt: skip
    files = write_picture(figure, design.plot)
    for path, text in texts.items():
        write_file(path, text.encode())
    files = [*texts, *files]
    if json:
        print_result(design.to_dict(), files)
        return
    for name, axis in axes.items():
        _print(axis, f"{name}: " if name else "")
    if not isinstance(design, ResponseDesign):
        _print_axes(design)
    print_notes(console(), design.notes, files)


def _text(design: "ResponseDesign", suffix: str) -> str:
    if suffix != ".c":
        return design.loop_file()
    from flexstage.export.source.render import servo_source

    return servo_source(design.loop)


def _print(design: "ResponseDesign", of: str) -> None:
    screen, settings = console(), design.loop.settings
    above, _, below = design.unit.partition("/")
    inner = design.loop.damping
    if inner is not None and inner.kind == "iff":
        below = "N"  # the control commands a force
    gain = f"{below}/{above}" if below else "input/output"
    rows = [
        ("proportional gain", f"{settings.proportional:.5g}", gain),
        ("integral gain", f"{settings.integral:.5g}", f"{gain}/s"),
    ]
    for notch in settings.notches:
        rows.append(("notch", f"{notch.frequency_hz:.5g}", "Hz"))
        rows.append(("damping of its zeros", f"{notch.zero_damping:.4g}", "1"))
        rows.append(("damping of its poles", f"{notch.pole_damping:.4g}", "1"))
    for lead in settings.leads:
        rows.append(("zero of the lead", f"{lead.zero_hz:.5g}", "Hz"))
        rows.append(("pole of the lead", f"{lead.pole_hz:.5g}", "Hz"))
    if settings.filters:
        rows.append(("filters of second order", f"{len(settings.filters)}", "--json"))
    corners = (
        ("low-pass", settings.lowpass_hz),
        ("second integral below", settings.second_integral_hz),
    )
    rows += [(name, f"{corner:.5g}", "Hz") for name, corner in corners if corner is not None]
    if inner is not None:
        rows += _inner_rows(inner, gain)
    rate = design.loop.sample_rate
    print_table(
        screen, f"{of}{design.loop.name} at {rate:g} Hz", ("<setting", "value", "<unit"), rows
    )
    nominal, worst = design.nominal, design.worst
    lines = (
        ("gain margin", "gain_margin", 1.0, "1"),
        ("phase margin", "phase_margin", 180.0 / math.pi, "deg"),
        ("delay margin", "delay_margin", 1e6, "us"),
        ("largest sensitivity", "sensitivity_peak", 1.0, "1"),
        ("errors halved up to", "bandwidth_hz", 1.0, "Hz"),
        ("crossover", "crossover_hz", 1.0, "Hz"),
    )
    table = [
        (name, *(f"{factor * getattr(m, key):.4g}" for m in (nominal, worst)), unit)
        for name, key, factor, unit in lines
    ]
    print_table(
        screen,
        f"{of}margins of the measurement, and the worst of {len(design.members)} responses",
        ("<margin", "measured", "worst", "<unit"),
        table,
    )


def _inner_rows(inner: "InnerLoop", gain: str) -> list[tuple[str, str, str]]:
    """Return the rows of an inner loop; `gain` is the unit of that by position."""
    from flexstage.system.servo import PositionFeedback

    if not isinstance(inner, PositionFeedback):
        return [("gain of the inner loop", f"{inner.gain:.5g}", "V/N/s")]
    return [
        ("gain of the inner loop", f"{inner.gain:.5g}", gain),
        ("its filter", f"{inner.frequency_hz:.5g}", "Hz"),
        ("damping of its filter", f"{inner.damping_ratio:.4g}", "1"),
    ]


def _print_axes(design: "AxesDesign") -> None:
    decoupling, screen = design.decoupling, console()
    print_table(
        screen,
        f"voltages by the commands of the axes, by the response at "
        f"{decoupling.frequency_hz:.4g} Hz",
        ("<voltage", *decoupling.outputs),
        [
            (name, *(f"{value:.4g}" for value in row))
            for name, row in zip(decoupling.inputs, decoupling.matrix.tolist(), strict=True)
        ],
    )
    ends = ("at the lowest line", 0), ("at its frequency", decoupling.at), ("largest", None)
    rows = [
        (
            f"{where}, {label}",
            *(f"{v:.3g}" for v in (values.max(axis=0) if line is None else values[line])),
        )
        for where, line in dict(ends).items()
        for label, values in (("before", decoupling.before), ("after", decoupling.after))
    ]
    print_table(
        screen, "cross-talk, over the own motion", ("<cross-talk", *decoupling.outputs), rows
    )
    peak = max(one.sensitivity_peak for one in design.all_axes)
    print_table(
        screen,
        f"all axes together, the worst of {len(design.all_axes)} responses",
        ("<margin", "worst", "<unit"),
        [("largest singular value of the sensitivity", f"{peak:.4g}", "1")],
    )
