"""`flexstage excite`: the drive record for the identification of a piezo stage."""

from typing import Annotated, Any

import typer

from flexstage.cli.options import AxisOption, JsonOption, from_docstring, refuse
from flexstage.cli.output import (
    OutputFile,
    console,
    count,
    print_json,
    print_notes,
    print_table,
    record_format,
    write_file,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageOptions, designs_like
from flexstage.hysteresis.requests import ExciteRequest


@from_docstring
def excite(
    stage: Annotated[
        str | None, typer.Argument(autocompletion=designs_like, show_default=False)
    ] = None,
    *,
    request: ExciteRequest,
    options: StageOptions = AS_DESCRIBED,
    axis: AxisOption = None,
    out: OutputFile = None,
    json: JsonOption = False,
) -> None:
    """Design the drive record for an identification.

    The record contains major loops, reversal curves and nested loops at two rates, a step and hold,
    and a small multisine at the resonance. It is within the limits of stack and amplifier, and
    identifies hysteresis, lag, creep and resonance.

    Parameters
    ----------
    stage
        [STAGE]: A stage file, or the name of a built-in design: the source of the voltage range and
        capacitance of the stack, and of the lowest natural frequency.
    out
        Write the record (.csv, .npz, .h5 or .mat).
    """
    from flexstage.hysteresis.excitations.design import excitation

    format = record_format(out)
    options.require_stage(stage, "a STAGE")
    refuse(stage is None and axis is not None, "--axis needs a STAGE: name it before the options")
    if stage is None:
        record = excitation(request=request)
    else:
        from flexstage.experiments.excitations import excitation_of

        record = excitation_of(options.stage(stage), request, axis)
    if out is not None:
        from flexstage.records.write import record_bytes

        write_file(out, record_bytes(record.record(), format))
    result = record.to_dict() | {"file": None if out is None else str(out)}
    if json:
        print_json(result)
    else:
        _print(result)


def _print(result: dict[str, Any]) -> None:
    """Print the table for people."""
    low, high = result["voltage_range"]
    where = f"{result['stage']}, axis {result['axis']}: " if result["stage"] else ""
    screen = console()
    rows = []
    for part in result["parts"]:
        ends = (f"{v:.1f}" for v in part["voltage_range"])
        times = (f"{part['start']:.2f}", f"{part['duration']:.2f}", f"{part['rate_hz']:.3g}")
        slope = f"{part['largest_slope']:.4g}"
        rows.append((part["name"], *times, *ends, part["turning_points"], slope))
    print_table(
        screen,
        f"{where}{low:g} V to {high:g} V in {result['duration']:.4g} s, {result['shape']}, "
        f"{count(result['samples'], 'sample')} at {result['sample_rate_hz']:g} Hz",
        ("part", "start, s", "time, s", "rate, Hz", "from, V", "to, V", "reversals", "slope, V/s"),
        rows,
    )
    if result["sampled_for"]:
        screen.print(f"sample rate     {result['sample_rate_hz']:g} Hz for {result['sampled_for']}")
    screen.print(f"largest slope   {result['largest_slope']:.4g} V/s")
    if result["largest_current"] is not None:
        screen.print(
            f"current         {1e3 * result['largest_current']:.3g} mA at most, "
            f"{1e3 * result['rms_current']:.3g} mA rms"
        )
    screen.print(f"memory covered  {100.0 * result['coverage']:.0f} %")
    if result["omitted"]:
        screen.print(f"omitted: {'; '.join(result['omitted'])}", markup=False)
    for warning in result["warnings"]:
        screen.print(f"warning: {warning}", style="yellow", markup=False)
    print_notes(screen, (), filter(None, [result["file"]]))
