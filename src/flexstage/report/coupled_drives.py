"""The identification of coupled drives and oscillators, as tables and as sentences."""

import math
from collections.abc import Iterator

from flexstage.hysteresis.coupled_drives.identify import CoupledDriveIdentification
from flexstage.hysteresis.coupled_drives.inverse import CoupledCommand
from flexstage.hysteresis.coupled_drives.prediction import CoupledPredictions
from flexstage.hysteresis.oscillator.identify import OscillatorIdentification
from flexstage.quantities.table import Table, table
from flexstage.quantities.units import readable, readable_unit


def levels_table(result: CoupledDriveIdentification, caption: str = "") -> Table:
    """Return the errors at each level of the inputs."""
    inputs = result.model.input_unit
    largest = max(level.output_rms for level in result.levels)
    outputs, factor = readable_unit(largest, result.model.output_unit)
    headings = (
        f"input rms [{inputs}]",
        "records",
        f"output rms [{outputs}]",
        "~noise",
        "floor of linear systems",
        "linear, this level",
        "this model",
        *(["held out"] if result.held_out else []),
    )
    rows = []
    for k, level in enumerate(result.levels):
        held_out = [_number(factor * result.held_out[k])] if result.held_out else []
        errors = (level.noise, level.floor, level.linear_error, level.error)
        scaled = (_number(factor * value) for value in errors)
        cells = (f"{factor * level.output_rms:.4g}", *scaled, *held_out)
        rows.append((f"{level.input_rms:.3g}", level.records, *cells))
    return table(caption, headings, rows, notes=[f"errors: rms of the outputs [{outputs}]"])


def coupled_predictions_table(result: CoupledPredictions, caption: str = "") -> Table:
    """Return the errors of a model on records."""
    largest = max(p.output_rms for p in result.predictions)
    unit, factor = readable_unit(largest, result.model.output_unit)
    headings = ("record", f"output rms [{unit}]", f"error rms [{unit}]", "error [%]", "largest")
    rows = [
        (
            p.source,
            f"{factor * p.output_rms:.4g}",
            f"{factor * p.error:.3g}",
            f"{100.0 * p.error / p.output_rms:.2f}",
            f"{factor * p.largest:.3g}",
        )
        for p in result.predictions
    ]
    return table(caption, headings, rows)


def coupled_modes_table(result: CoupledDriveIdentification) -> Table:
    """Return the modes that the levels have in common, and how they soften."""
    levels, model = result.levels, result.model
    middle = len(levels) // 2
    headings = (
        *(f"at {level.input_rms:.3g} {model.input_unit} [Hz]" for level in levels),
        "damping [%]",
        "<input vector",
        "imaginary share",
        "~compliance",
    )
    rows = []
    for i in range(result.modes.frequency_hz.size):
        frequencies = (_number(level.frequency_hz[i], 5) for level in levels)
        shape = " ".join(f"{value:+.2f}" for value in result.modes.input_shapes[i])
        rows.append(
            (
                *frequencies,
                _number(100.0 * levels[middle].damping_ratio[i]),
                shape,
                f"{result.modes.imaginary_share[i]:.2f}",
                f"{model.drives.compliance[i]:.3f}",
            )
        )
    return table("modes", headings, rows)


def coupled_drives_in_words(result: CoupledDriveIdentification) -> list[str]:
    """Return what was identified, line by line."""
    model, drives = result.model, result.model.drives
    lines = [
        f"linear system of order {model.system.order} from {', '.join(model.inputs)} to "
        f"{', '.join(model.outputs)}"
    ]
    if len(result.levels) > 1:
        strengths = ", ".join(f"{c:.2f}" for c in drives.strength)
        lines.append(
            f"softening with the level of the force in each stack: strengths {strengths}; "
            f"exponent {drives.exponent:.2f}"
        )
    ranges = (
        f"{name} {low:.3g} to {high:.3g} {model.input_unit}"
        for name, (low, high) in zip(model.inputs, model.level_range, strict=True)
    )
    lines.append(f"valid for levels of {', '.join(ranges)} rms")
    return lines


def coupled_command_in_words(result: CoupledCommand) -> list[str]:
    """Return sentences on commands and their predicted errors."""
    model = result.model
    ranges = (
        f"{name} {readable(model.input_unit, low, high, digits=4)}"
        for name, low, high in zip(
            model.inputs,
            result.command.min(0).tolist(),
            result.command.max(0).tolist(),
            strict=True,
        )
    )
    errors = (
        f"{name} {readable(model.output_unit, rms)} rms, {readable(model.output_unit, largest)} at "
        "most"
        for name, rms, largest in zip(
            model.outputs, result.rms_error.tolist(), result.largest_error.tolist(), strict=True
        )
    )
    return [
        f"{len(result.time)} samples: {'; '.join(ranges)}",
        f"predicted error: {'; '.join(errors)} (for the model itself: its deviation from the "
        "measured stage adds to this)",
    ]


def coupled_parts(
    result: CoupledDriveIdentification | OscillatorIdentification,
) -> Iterator[Table | str]:
    """Yield the tables and lines on a model of coupled drives, or of an oscillator."""
    if isinstance(result, CoupledDriveIdentification):
        yield levels_table(result, "coupled drives")
        yield from coupled_drives_in_words(result)
        yield coupled_modes_table(result)
        return
    model, fitted = result.model, result.fitted.predictions[0]
    yield _oscillator_table(result)
    error, motion, largest = (
        readable(model.output_unit, v) for v in (fitted.error, fitted.output_rms, model.largest)
    )
    yield f"natural frequency of small motion {model.frequency_hz:.4g} Hz"
    yield (
        f"fitted: error {error} rms of a motion of {motion} rms, "
        f"{100.0 * fitted.error / fitted.output_rms:.2g} %; valid up to {largest} from rest"
    )
    if result.tested is not None:
        yield coupled_predictions_table(result.tested, "test on other records")
        yield from result.tested.notes


def _oscillator_table(result: OscillatorIdentification) -> Table:
    u, y = result.model.input_unit or "input", result.model.output_unit or "output"
    free = "exponent" in result.fit.values
    units = {
        "mass": "kg" if (u, y) == ("N", "m") else f"{u} s^2/{y}",
        "damping": f"{u} s/{y}",
        "beta_gamma": "" if free else f"1/{y}",
        "beta_delta": "" if free else f"1/{y}",
        "exponent": "",
        "initial_velocity": f"{y}/s",
        "initial_force": u,
    }
    units |= dict.fromkeys(("stiffness", "alpha"), f"{u}/{y}")
    errors = result.fit.standard_errors
    rows = [
        (name.replace("_", " "), f"{value:.5g}", f"{errors[name]:.2g}", units.get(name, y))
        for name, value in result.fit.values.items()
    ]
    caption = f"oscillator with a Bouc-Wen force: {result.fitted.predictions[0].source}"
    return table(caption, ("name", "value", "standard error", "<unit"), rows)


def _number(value: float, digits: int = 3) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}g}"
