"""`flexstage excite`: the drive record that a piezo stage is identified from."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import (
    AxisOption,
    CurrentOption,
    JsonOption,
    SlewOption,
    from_docstring,
    optional,
    quantity,
    refuse,
    voltage_range,
)
from flexstage.cli.output import (
    OutputFile,
    console,
    count,
    print_json,
    print_notes,
    print_table,
    write_file,
)
from flexstage.cli.reading import record_format
from flexstage.cli.stage_options import AS_DESCRIBED, StageOptions, designs_like
from flexstage.errors import ModelError, StageError
from flexstage.files.plain import picked

if TYPE_CHECKING:
    from flexstage.hysteresis.excitations.design import Excitation


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class _Plant:
    """What is driven."""

    stage: str | None = None
    axis: str | None = None
    voltage_range: tuple[float, float] | None = None
    capacitance: float | None = None
    natural_frequency_hz: float | None = None


@from_docstring
def excite(
    stage: Annotated[
        str | None, typer.Argument(autocompletion=designs_like, show_default=False)
    ] = None,
    taken: StageOptions = AS_DESCRIBED,
    axis: AxisOption = None,
    voltage: str | None = None,
    loop_rates: str | None = None,
    duration: str | None = None,
    sample_rate: str | None = None,
    slew: SlewOption = None,
    current: CurrentOption = None,
    capacitance: str | None = None,
    frequency: str | None = None,
    shape: str = "smooth",
    hold_time: str | None = None,
    rest: str | None = None,
    multisine: bool = True,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    out: OutputFile = None,
    json: JsonOption = False,
) -> None:
    """Design the drive record for an identification.

    The record contains major loops, reversal curves and nested loops at two rates, a step and hold,
    and a small multisine at the resonance, within the limits of stack and amplifier. It identifies
    hysteresis, lag, creep and resonance.

    Parameters
    ----------
    stage
        [STAGE]: A stage file, or the name of a built-in design. It gives the voltage range and
        capacitance of the stack and the lowest natural frequency.
    voltage
        LOW:HIGH: Voltage range, such as "0:120" (default: that of the stack).
    loop_rates
        FREQUENCIES: Repetition rates of the major loop, such as "0.5,5" in Hz (default: chosen).
    duration
        TIME: Longest duration of the record, such as "60 s".
    sample_rate
        RATE: Sample rate, such as "10 kHz" (default: as the fastest loop and the multisine
        require).
    capacitance
        CAPACITANCE: Capacitance of the stack, such as "6.4 uF" (default: that of STAGE).
    frequency
        FREQUENCY: Lowest natural frequency with the drives in place (default: that of the lumped
        model of STAGE).
    shape
        smooth|sine|triangle: Shape of the voltage between turning points.
    hold_time
        TIME: Hold time after the step, for creep; "0 s" for none.
    rest
        VOLTAGE: Voltage before and after the record (default: 0 V if within the range).
    multisine
        --multisine/--no-multisine: Add a small multisine at the natural frequency.
    seed
        NUMBER: Random seed of the phases of the multisine.
    out
        Write the record (.csv, .npz, .h5 or .mat).
    """
    from flexstage.hysteresis.excitations.design import excitation

    format = record_format(out)
    plant = _plant(stage, taken, axis, needs_frequency=frequency is None)
    words = [] if loop_rates is None else loop_rates.split(",")
    rates = [quantity(word, "frequency", bare_unit="Hz") for word in words]
    made = excitation(
        _voltage_range(voltage, plant),
        sample_rate_hz=optional(sample_rate, "frequency", bare_unit="Hz"),
        duration=optional(duration, "time", bare_unit="s"),
        rates_hz=rates or None,
        shape=shape,
        slope_limit=optional(slew, "slew rate", bare_unit="V/s"),
        current_limit=optional(current, "current"),
        capacitance=optional(capacitance, "capacitance") or plant.capacitance,
        natural_frequency_hz=optional(frequency, "frequency", bare_unit="Hz")
        or plant.natural_frequency_hz,
        resonance=multisine,
        hold=optional(hold_time, "time", bare_unit="s"),
        rest_voltage=optional(rest, "voltage", bare_unit="V"),
        seed=seed,
    )
    if out is not None:
        from flexstage.records.write import record_bytes

        write_file(out, record_bytes(made.record(), format))
    result = _result(made, plant, out)
    if json:
        print_json(result)
    else:
        _print(result)


def _voltage_range(text: str | None, plant: _Plant) -> tuple[float, float]:
    """Read a range such as "0:120", and refuse one that the stack does not take."""
    allowed = plant.voltage_range
    if text is None:
        if allowed is None:
            raise ModelError('--voltage is needed, such as "0:120": no stack gives a range')
        return allowed
    low, high = voltage_range(text)
    if allowed is not None and not allowed[0] <= low < high <= allowed[1]:
        raise ModelError(
            f"--voltage must be within {allowed[0]:g} V to {allowed[1]:g} V, which the stack of "
            f"axis '{plant.axis}' of {plant.stage} allows, got {low:g} V to {high:g} V"
        )
    return low, high


def _plant(
    text: str | None, taken: StageOptions, axis: str | None, *, needs_frequency: bool
) -> _Plant:
    """Read what a stage says about its stack and its lowest natural frequency."""
    taken.require_stage(text, "a STAGE")
    if text is None:
        refuse(axis is not None, "--axis needs a STAGE: name it before the options")
        return _Plant()
    from flexstage.experiments.axis_limits import lowest_frequency
    from flexstage.stage import PiezoStack

    stage = taken.stage(text)
    sentence = f"{stage.name} has no axis: give it one, or leave STAGE out"
    refuse(not stage.axes, sentence, StageError)
    chosen = stage.axis(axis) if axis is not None else stage.axes[0]
    drive = stage.drive_of(chosen.name)
    if not isinstance(drive, PiezoStack):
        raise StageError(
            f"axis '{chosen.name}' of {stage.name} is driven by a {drive.kind}, and a piezo stack "
            "is needed: choose another axis, or leave STAGE out"
        )
    return _Plant(
        stage=stage.name,
        axis=chosen.name,
        voltage_range=drive.voltage_range,
        capacitance=drive.capacitance,
        natural_frequency_hz=lowest_frequency(stage) if needs_frequency else None,
    )


def _result(made: "Excitation", plant: _Plant, out: Path | None) -> dict[str, Any]:
    """Return everything that is shown, as plain data in SI units."""
    return {
        "stage": plant.stage,
        "axis": plant.axis,
        "natural_frequency_hz": plant.natural_frequency_hz,
        **picked(made, "shape", "sample_rate_hz"),
        "sampled_for": made.sampled_for or None,
        "samples": made.time.size,
        **picked(made, "duration", "rates_hz"),
        "voltage_range": [float(made.voltage.min()), float(made.voltage.max())],
        **picked(
            made,
            "rest_voltage",
            "largest_slope",
            "largest_current",
            "rms_current",
            "coverage",
            "parts",
            "left_out",
            "warnings",
        ),
        "file": None if out is None else str(out),
    }


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
        ("part", "start, s", "time, s", "rate, Hz", "from, V", "to, V", "turns", "slope, V/s"),
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
    screen.print(f"memory visited  {100.0 * result['coverage']:.0f} %")
    if result["left_out"]:
        screen.print(f"left out: {'; '.join(result['left_out'])}", markup=False)
    for warning in result["warnings"]:
        screen.print(f"warning: {warning}", style="yellow", markup=False)
    print_notes(screen, (), filter(None, [result["file"]]))
