"""What `flexstage identify` finds, as data and for people; how it fits the drive's description."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexstage.cli.output import print_notes, print_table
from flexstage.cli.predict import start_value
from flexstage.errors import StageError
from flexstage.files.plain import picked, plain
from flexstage.units import readable

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.hysteresis.identification.identify import Identification
    from flexstage.hysteresis.identification.model_choice import Candidate
    from flexstage.records import Record
    from flexstage.stage import Stage


def identification_result(
    found: "Identification", read: "list[Record]", files: list[Path]
) -> dict[str, Any]:
    """Return an identification as plain data."""
    return {
        "records": [r.source for r in read],
        **picked(
            found,
            "model=kind",
            "rms_percent",
            "max_percent",
            "heldout_rms_percent",
            "heldout_free_constant_rms_percent=heldout_free_rms_percent",
            "heldout_standard_error_percent=heldout_standard_error",
            "heldout_max_percent",
            "heldout_band_percent",
        ),
        "start": start_value(found.model.start),
        "settling": {"value": found.settling, "unit": found.model.output_unit},
        "noise_percent": found.noise_percent,
        "fitted": found.settings["fitted"],
        "stroke": {"value": found.stroke, "unit": found.model.output_unit},
        "parameters": _parameters(found),
        "chain": _chain_values(found),
        "candidates": [
            {
                **picked(c, "model=kind", "parameters=size", "rms_percent", "heldout_rms_percent"),
                "heldout_free_constant_rms_percent": c.heldout_free_rms_percent,
                "failed": c.failed or None,
            }
            for c in found.candidates
        ],
        **picked(found, "verdict", "warnings"),
        "notes": sorted({note for r in read for note in r.notes}),
        "files": [str(file) for file in files],
    }


def _parameters(found: "Identification") -> dict[str, Any]:
    """Value, standard error and unit of each parameter; arrays of them for arrays."""
    import numpy as np

    from flexstage.hysteresis.drive_model import parameter_unit

    m = found.model
    made: dict[str, Any] = {}
    for name, value in m.hysteresis.parameters().items():
        array = np.asarray(value, dtype=np.float64)
        error = np.full(array.shape, np.nan)
        for estimate in found.parameters:
            base, _, index = estimate.name.partition("[")
            if base == name:
                place = tuple(int(i) for i in index.rstrip("]").split(",")) if index else ()
                error[place] = estimate.standard_error
        made[name] = {
            "value": array.tolist(),
            "standard_error": None if np.isnan(error).all() else plain(error),
            "unit": parameter_unit(found.kind, name, m.input_unit, m.output_unit),
        }
    return made


def _chain_values(found: "Identification") -> dict[str, Any]:
    m = found.model
    errors = {e.name: e.standard_error for e in found.chain}
    return {
        "delay": {
            "value": m.lag.delay if m.lag is not None else 0.0,
            "standard_error": plain(errors.get("delay")),
            "unit": "s",
        },
        "creep_per_decade": {
            "value": m.creep.rate_per_decade if m.creep is not None else 0.0,
            "standard_error": plain(errors.get("creep_per_decade")),
            "unit": "1",
        },
        "resonance": {
            "value": m.modes.frequency_hz[0] if m.modes is not None else None,
            "standard_error": plain(errors.get("resonance_hz")),
            "unit": "Hz",
        },
        "offset": {
            "value": m.offset,
            "standard_error": found.offset.standard_error,
            "unit": m.output_unit,
        },
        "sign": m.sign,
    }


def print_identification(
    screen: "Console", found: "Identification", result: dict[str, Any]
) -> None:
    """Print candidates, how well the best one fits, parameters, warnings and files."""
    errors = "fitted, % rms", "held out, as predicted, % rms", "with a free constant, % rms"
    print_table(
        screen,
        f"{found.kind}: {', '.join(result['records'])}",
        ("model", "parameters", *errors),
        ((c.kind, c.size, *_percents(c)) for c in found.candidates),
    )
    for c in found.candidates:
        if c.failed:
            screen.print(f"{c.kind}: {c.failed}", style="yellow", markup=False)
    for line in _in_words(found):
        screen.print(line, markup=False)
    heads = "name", "value", "standard error", "<unit"
    print_table(screen, "parameters", heads, _rows(found, result))
    for warning in found.warnings:
        screen.print(f"warning: {warning}", style="yellow", markup=False)
    print_notes(screen, result["notes"], result["files"])


def _percents(candidate: "Candidate") -> tuple[str, str, str]:
    """What a model leaves where it was fitted, and on what was held out, for the table."""
    c = candidate
    if c.rms_percent is None:
        return "failed", "", ""
    if c.failed:
        return f"{c.rms_percent:.3f}", "diverges", ""
    held = [
        "" if value is None else f"{value:.3f}"
        for value in (c.heldout_rms_percent, c.heldout_free_rms_percent)
    ]
    return f"{c.rms_percent:.3f}", held[0], held[1]


def _in_words(found: "Identification") -> list[str]:
    """What was fitted and how well, line by line."""
    from flexstage.hysteresis.drive_model import start_in_words
    from flexstage.units import readable, readable_unit

    m, (low, high) = found.model, found.measurement.input_range
    shown, factor = readable_unit(found.stroke, m.output_unit)  # one unit for all readings
    shown, driven = shown or "output", m.input_unit or "input"
    slope = factor * found.stroke / (high - low)
    said = [
        f"fitted: {found.settings['fitted']}",
        f"stroke {factor * found.stroke:.4g} {shown} over {readable(driven, low, high, digits=4)}, "
        f"{slope:.3g} {shown}/{driven} on average; noise about {found.noise_percent:.2f} % of the "
        "stroke",
    ]
    if found.heldout_rms_percent is not None:
        error = found.heldout_standard_error
        known = "" if error is None else f" +- {error:.3f} (standard error)"
        said.append(
            f"held out, as predicted: {found.heldout_rms_percent:.3f}{known} % of the stroke rms; "
            f"95 % within {found.heldout_band_percent:.2f}, largest {found.heldout_max_percent:.2f}"
        )
    else:
        said.append(f"largest error {found.max_percent:.2f} % of the stroke")
    if m.creep is not None:
        of = "the first record" if len(found.measurement.sections) > 1 else "the record"
        said.append(
            f"before {of} the drive seems to have {start_in_words(*found.starts)}; creep "
            f"of that changes readings by up to {factor * found.settling:.2g} {shown}"
        )
    return said


def _rows(found: "Identification", result: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    """Name, value, standard error and unit of what was found, as people read them."""
    from flexstage.hysteresis.drive_model import parameter_unit
    from flexstage.units import readable_unit

    m = found.model
    shown, factor = readable_unit(found.stroke, m.output_unit)
    unknown = {e.name for e in found.chain if math.isinf(e.standard_error)}
    made = []
    for name, row in result["parameters"].items():
        value, error = row["value"], row["standard_error"]
        if not isinstance(value, float) or (value == 0.0 and error is None):
            continue  # a table, or what this model does without
        power = _power(parameter_unit(found.kind, name, "input", "output"))
        unit = parameter_unit(found.kind, name, m.input_unit, shown)
        made.append((name, *_numbers(value, error, factor**power), unit))
    for name, row in result["chain"].items():
        if not isinstance(row, dict) or row["value"] is None:
            continue
        value, error = row["value"], row["standard_error"]
        own, times = readable_unit(max(abs(value), error or 0.0), row["unit"])
        if name == "offset":
            own, times = shown or "output", factor
        elif name == "creep_per_decade":
            own, times = "%", 100.0
        number, known = _numbers(value, error, times)
        known = "not determined" if name in unknown else known
        made.append((name.replace("_", " "), number, known, own))
    return made


def _power(unit: str) -> int:
    """Whether the output is over or under the line of a unit."""
    over, _, under = unit.partition("/")
    return ("output" in over) - ("output" in under)


def _numbers(value: float, error: float | None, factor: float) -> tuple[str, str]:
    """A value to the digits that its standard error leaves, and that error."""
    value *= factor
    if not error:
        return f"{value:.4g}", ""
    error *= factor
    least = min(error, abs(value) or error)
    return f"{value:.{max(1 - math.floor(math.log10(least)), 0)}f}", f"{error:.2g}"


#: A record beyond this many times what the drive takes or moves is not of it as it is described.
_BEYOND = 3.0
#: One of less than this share is of a small part of its range, or of another prefix of the unit.
_SMALL = 1.0 / 100.0


def against_description(
    found: "Identification", described: "Stage", axis: str | None
) -> tuple[str, ...]:
    """Compare range and stroke of a record with the drive of a stage.

    The axis is the first one where None. Returns a sentence for each that does not suit the drive.
    """
    from flexstage.lumped import lumped_system
    from flexstage.stage import PiezoStack
    from flexstage.system import analyse_axis

    if not described.axes:
        raise StageError(f"{described.name} has no axis: give it one, or leave --stage out")
    chosen = described.axis(axis) if axis is not None else described.axes[0]
    drive = described.drive_of(chosen.name)
    if not isinstance(drive, PiezoStack):
        raise StageError(
            f"axis '{chosen.name}' of {described.name} is driven by a {drive.kind}, and a piezo "
            "stack is needed: choose another axis, or leave --stage out"
        )
    system = lumped_system(described)
    port = next(a for a in system.axes if a.name == chosen.name)
    # a stack on the stage moves less, and one that is measured by itself does not pass the stage
    strokes = (drive.free_stroke, abs(analyse_axis(system, port).output_displacement))
    low, high = found.measurement.input_range
    of = f"the drive of axis '{chosen.name}' of {described.name}"
    said = []
    if drive.voltage_range is not None:
        takes = (drive.voltage_range[1] - drive.voltage_range[0],)
        said.append(
            _compare("input", high - low, found.model.input_unit, "V", takes, f"{of} takes")
        )
    said.append(
        _compare("output", found.stroke, found.model.output_unit, "m", strokes, f"{of} moves")
    )
    return tuple(sentence for sentence in said if sentence)


def _compare(
    what: str, span: float, unit: str, wanted: str, known: tuple[float, ...], verb: str
) -> str:
    """Say that a span is far from what is known, whichever of it is meant."""
    if unit != wanted:
        own = f"in {unit}" if unit else "without a unit"
        return f"the {what} is {own} and {verb} {wanted}: the two cannot be compared"
    least, most = min(known), max(known)
    if _SMALL * least <= span <= _BEYOND * most:
        return ""
    nearest = most if span > most else least
    times = span / nearest if span > nearest else nearest / span
    return (
        f"the {what} spans {readable(unit, span)} and {verb} {readable(unit, nearest)}, "
        f"{times:.3g} times {'less' if span > nearest else 'more'}: is the unit of the {what} "
        "right, and is it the record of this drive?"
    )
