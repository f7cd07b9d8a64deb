"""Whether a command and its readings suit what a model was identified on."""

import numpy as np
from numpy.typing import ArrayLike

from flexstage.errors import ModelError, UnitError
from flexstage.hysteresis.drive_model import DriveModel
from flexstage.hysteresis.identification.cycles import cycles
from flexstage.hysteresis.model import Array, samples
from flexstage.units import readable, si_unit

#: Spans that differ by more than this hint at a prefix of a unit: 1000, less a small loop.
PREFIX = 300.0
#: Rates that differ by more than this were not identified.
_OTHER_RATE = 1.5


def in_unit_of_model(values: ArrayLike, unit: str, model_unit: str, what: str) -> tuple[Array, str]:
    """Return values in the unit of a model.

    Units are empty where nobody has said. The sentence is empty where nothing was converted. A
    ModelError where one unit alone is known, or their dimensions differ.

    Examples
    --------
    >>> in_unit_of_model([0.02], "mm", "um", "reference")
    (array([20.]), 'the reference was converted from mm to um, the unit of the model')
    """
    given = samples(values, what)
    if unit == model_unit:
        return given, ""
    if not unit:
        raise ModelError(
            f"the {what} has no unit and the model is in {model_unit}: name it with "
            f'--reference-unit, such as --reference-unit "{model_unit}"'
        )
    if not model_unit:
        raise ModelError(
            f"the {what} is in {unit} and the model was identified without a unit: identify it "
            "again with --input-unit and --output-unit"
        )
    try:
        (own, si), (wanted, model_si) = si_unit(unit), si_unit(model_unit)
    except UnitError as error:
        raise ModelError(f"the {what} is in {unit}, the model in {model_unit}: {error}") from error
    if si != model_si:
        raise ModelError(
            f"the {what} is in {unit}, the model gives {model_unit}: name its unit with "
            "--reference-unit, or choose another column"
        )
    made = given * (own / wanted)
    return made, f"the {what} was converted from {unit} to {model_unit}, the unit of the model"


def unsuited(
    model: DriveModel,
    dt: float,
    *,
    command: ArrayLike,
    reading: ArrayLike | None = None,
) -> tuple[str, ...]:
    """Say where a command and its readings leave what a model was identified on.

    One sentence for each: the range of the command, spans that another prefix of the unit would
    explain, and rates of cycles that were not identified; none of a model without such ranges. The
    readings are wanted or measured ones.
    """
    if model.validity is None:
        return ()
    u = samples(command, "command")
    limits = model.validity
    spans = [("command", u, limits.input_range, model.input_unit)]
    if reading is not None:
        y = samples(reading, "reading")
        spans.append(("reference or reading", y, limits.output_range, model.output_unit))
    return tuple(
        said
        for said in (
            model.outside(u),
            *(_span(*given) for given in spans),
            _rate(u, dt, limits.rate_range_hz),
        )
        if said
    )


def _span(what: str, values: Array, known: tuple[float, float], unit: str) -> str:
    """Say that values span far more or far less than what is known."""
    own, size = float(np.ptp(values)), known[1] - known[0]
    if not size > 0.0 or size / PREFIX <= own <= size * PREFIX:
        return ""
    seen = f"{readable(unit, size)} that the model was identified on"
    if own == 0.0:
        return f"the {what} stands still, at {readable(unit, values[0], digits=5)}, of {seen}"
    much = f"{own / size:.3g} times" if own > size else f"1/{size / own:.3g} of"
    return f"the {what} spans {readable(unit, own)}, {much} the {seen}: is its unit right?"


def _rate(u: Array, dt: float, known: tuple[float, float]) -> str:
    """Say that cycles are faster or slower than those that are known."""
    if not known[1] > 0.0 or not np.ptp(u) > 0.0:
        return ""
    rates = cycles(u, dt).rates_hz
    slow, fast = known[0] / _OTHER_RATE, known[1] * _OTHER_RATE
    other = [rate for rate in rates if not slow <= rate <= fast]
    if not other:
        return ""
    at = f"{known[0]:.3g} Hz"
    if known[1] > known[0]:
        at = f"{known[0]:.3g} to {known[1]:.3g} Hz"
    found = ", ".join(f"{rate:.3g}" for rate in other)
    return (
        f"cycles repeat at {found} Hz and the model was identified at {at}: lag, creep and "
        "resonance at other rates are extrapolated; record cycles at that rate as well"
    )
