"""A drive: hysteresis, creep, delay and modes in a row, the units of it, and what suits it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.errors import ModelError, UnitError
from flexstage.hysteresis.chain.creep import Creep, Start, creep_start
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.identification.cycles import cycles
from flexstage.hysteresis.model import Array, HysteresisModel, samples
from flexstage.hysteresis.models.registry import MODELS
from flexstage.quantities.units import readable, si_unit

#: Cycles after which the memory of what was before is gone, also where it fades only.
_CONDITIONING = 4
#: Spans that differ by more than this hint at a prefix of a unit: 1000, less a small loop.
PREFIX = 300.0
#: Rates that differ by more than this were not identified.
_OTHER_RATE = 1.5
#: Units of what a drive has beside its hysteresis.
_CHAIN: Mapping[str, str] = {"creep_per_decade": "1", "delay": "s", "resonance_hz": "Hz"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidityRange:
    """What a model was identified on, beyond which it extrapolates."""

    input_range: tuple[float, float]
    """Lowest and highest input [`input_unit`]."""
    output_range: tuple[float, float]
    """Lowest and highest output [`output_unit`]."""
    rate_range_hz: tuple[float, float]
    """Slowest and fastest cycles [Hz]."""
    temperature: tuple[float, float] | None = None
    """Lowest and highest temperature [K]; None where nobody has said."""


def start_in_words(*starts: Start) -> str:
    """Return what a drive did before a record, as the end of a sentence about it.

    Several starts where the drive may have done any of them; the words follow "the drive had".

    Examples
    --------
    >>> start_in_words("rested"), start_in_words(30.0, math.inf)
    ('rested at the first command', 'moved for about 30 s or longer')
    """
    said = ["rested at the first command"] if "rested" in starts else []
    moved = sorted(float(s) for s in starts if s != "rested")
    if moved and moved[0] == 0.0:
        said.append("just left the low end of its range")
        moved = moved[1:]
    if moved:
        said.append(f"moved for {_for_how_long(moved[0], moved[-1])}")
    return " or ".join(said)


def start_data(start: Start) -> str | float:
    """Return what a drive did before as JSON can hold it: a time [s], or a word."""
    return "long" if start == math.inf else start


def _for_how_long(least: float, most: float) -> str:
    if least == math.inf:
        return "long"
    if most == math.inf:
        return f"about {readable('s', least, digits=2)} or longer"
    return f"about {readable('s', *sorted({least, most}), digits=2)}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveModel:
    """Hysteresis, creep, modes and delay in a row, from the command to the reading.

    ``reading(t) = offset + sign x modes(creep(hysteresis(command)))(t - delay)``
    """

    hysteresis: HysteresisModel
    """The hysteresis."""
    creep: Creep | None = None
    """Creep of what the hysteresis gives; None for none."""
    modes: StageModes | None = None
    """Modes of the stage in the reading, at unit static gain; None for none."""
    lag: Lag | None = None
    """Delay and lag of the acquisition; None for none."""
    offset: float = 0.0
    """Reading at no command, with no history [`output_unit`]."""
    sign: float = 1.0
    """1 where the reading rises with the command, -1 where it falls."""
    input_unit: str = "V"
    """Unit of the command; empty where nobody has said."""
    output_unit: str = "m"
    """Unit of the reading; empty where nobody has said."""
    validity: ValidityRange | None = None
    """What it was identified on."""
    start: Start = "rested"
    """What the drive did before the record that it was identified from."""

    def conditioned(self) -> Array:
        """Return the state of the hysteresis after cycles over all of the range, at its low end.

        What was before them is then forgotten. A drive is brought there by three slow cycles.

        Returns
        -------
        numpy.ndarray
            The state.

        Raises
        ------
        ModelError
            The model does not say on which range it was identified.
        """
        if self.validity is None:
            raise ModelError(
                "the model has no range to be conditioned over: give it a validity range"
            )
        low, high = self.validity.input_range
        return self.hysteresis.simulate([high, low] * _CONDITIONING).state

    def simulate(
        self,
        u: ArrayLike,
        dt: float,
        state: ArrayLike | None = None,
        *,
        start: Start | Array | None = None,
    ) -> Array:
        """Return the readings for a sequence of commands.

        Parameters
        ----------
        u : array_like
            Commands [`input_unit`], shape (n,).
        dt : float
            Time from one sample to the next [s].
        state : array_like, optional
            State of the hysteresis before the first of them; that after conditioning cycles where
            not given, and no history where the model does not say its range.
        start : "rested", float or numpy.ndarray, optional
            What the drive did before, for its creep, or the state of its creep. Where not given it
            had settled at the first command if a state is given, and else did what it did before
            the record that the model was identified from.

        Returns
        -------
        numpy.ndarray
            Readings [`output_unit`], shape (n,). Modes and lag have settled at the first command.
        """
        given = samples(u, "command")
        if start is None:  # 0 is a start as well
            start = self.start if state is None else "rested"
        if state is None and self.validity is not None:
            state = self.conditioned()
        y = self.hysteresis.simulate(given, state).values
        if self.creep is not None:
            y = self.creep.simulate(y, dt, creep_start(self.creep, y, dt, start)).values
        for element in (self.modes, self.lag):
            if element is not None:
                y = element.simulate(y, dt).values
        return self.offset + self.sign * y

    def outside(self, u: ArrayLike) -> str:
        """Say where commands leave what the model was identified on.

        Parameters
        ----------
        u : array_like
            Commands [`input_unit`], shape (n,).

        Returns
        -------
        str
            One sentence, or an empty text where they stay inside.
        """
        if self.validity is None:
            return ""
        given = np.asarray(u, dtype=np.float64)
        low, high = self.validity.input_range
        beyond = max(low - float(given.min()), float(given.max()) - high) / (high - low)
        if beyond <= 1e-6:
            return ""
        return (
            f"the commands, {readable(self.input_unit, given.min(), given.max())}, go beyond the "
            f"{readable(self.input_unit, low, high)} that the model was identified on, by up to "
            f"{100.0 * beyond:.2g} % of that range: its output there is extrapolated"
        )


def lowest_reading(drive: DriveModel) -> float:
    """Return the lowest reading that a drive was seen at; a ModelError where nobody says it."""
    if drive.validity is None:
        raise ModelError("--relative needs a model that says on which range it was identified")
    return drive.validity.output_range[0]


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
            f"the {what} has no unit and the model is in {model_unit}: say it behind "
            f'the column, such as --column "1 {model_unit}"'
        )
    if not model_unit:
        raise ModelError(
            f"the {what} is in {unit} and the model was identified without a unit: identify it "
            'again with units behind the columns, such as --output "1 um"'
        )
    try:
        (own, si), (wanted, model_si) = si_unit(unit), si_unit(model_unit)
    except UnitError as error:
        raise ModelError(f"the {what} is in {unit}, the model in {model_unit}: {error}") from error
    if si != model_si:
        raise ModelError(
            f"the {what} is in {unit}, the model gives {model_unit}: say its unit behind "
            "--column, or choose another column"
        )
    made = given * (own / wanted)
    return made, f"the {what} was converted from {unit} to {model_unit}, the unit of the model"


def unsuited(
    model: DriveModel, dt: float, *, command: ArrayLike, reading: ArrayLike | None = None
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


def parameter_unit(kind: str, name: str, input_unit: str, output_unit: str) -> str:
    """Return the unit of a parameter.

    Of a kind that has an exponent it is that for 1. A name may be an element, such as
    ``weights[3]``; units that nobody has said are called input and output.

    Examples
    --------
    >>> parameter_unit("bouc-wen", "gain", "V", "m")
    'm/V'
    """
    template = {**_CHAIN, **MODELS[kind].units}.get(name.split("[", maxsplit=1)[0], "1")
    return template.format(u=input_unit or "input", y=output_unit or "output")
