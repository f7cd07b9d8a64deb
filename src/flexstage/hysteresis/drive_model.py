"""Model of a drive: hysteresis, creep, modes and delay in series, its units and validity range."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.creep import Creep, Start, creep_start
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.identification.cycles import cycles
from flexstage.hysteresis.model import Array, HysteresisModel, samples
from flexstage.hysteresis.models.registry import MODELS
from flexstage.hysteresis.requests import Zero
from flexstage.quantities.units import readable, si_unit
from flexstage.records import Channel

#: Number of cycles that erase the memory of earlier motion, also if it only fades.
_CONDITIONING = 4
#: Smallest ratio of spans that indicates a wrong prefix of a unit: 1000, less a small loop.
PREFIX = 300.0
#: Smallest ratio of a rate to those of the identification that is an extrapolation.
_OTHER_RATE = 1.5
#: Units of the linear chain of a drive.
_CHAIN: Mapping[str, str] = {"creep_per_decade": "1", "delay": "s", "resonance_hz": "Hz"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidityRange:
    """Range of an identification, outside which a model extrapolates."""

    input_range: tuple[float, float]
    """Lowest and highest input [`input_unit`]."""
    output_range: tuple[float, float]
    """Lowest and highest output [`output_unit`]."""
    rate_range_hz: tuple[float, float]
    """Slowest and fastest cycles [Hz]."""
    temperature: tuple[float, float] | None = None
    """Lowest and highest temperature [K]; None if unknown."""


def start_in_words(*starts: Start) -> str:
    """Describe the motion of a drive before a record, after the words "the drive had".

    Several starts are alternatives.

    Examples
    --------
    >>> start_in_words("rested"), start_in_words(30.0, math.inf)
    ('rested at the first command', 'moved for about 30 s or longer')
    """
    histories = ["rested at the first command"] if "rested" in starts else []
    times = sorted(float(s) for s in starts if s != "rested")
    if times and times[0] == 0.0:
        histories.append("just left the low end of its range")
        times = times[1:]
    if times:
        histories.append(f"moved for {_duration_text(times[0], times[-1])}")
    return " or ".join(histories)


def start_data(start: Start) -> str | float:
    """Return a start as JSON can represent it: a time [s], or a word."""
    return "long" if start == math.inf else start


def _duration_text(least: float, most: float) -> str:
    if least == math.inf:
        return "long"
    if most == math.inf:
        return f"about {readable('s', least, digits=2)} or longer"
    return f"about {readable('s', *sorted({least, most}), digits=2)}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveState:
    """State of a drive at a sample, one step before its next command."""

    hysteresis: Array
    """State of the hysteresis; its first element is the last command."""
    creep: Start | Array = "rested"
    """State of the creep, or the motion from which it follows."""
    modes: Array | None = None
    """State of the modes; None if they have settled at the next command."""
    lag: Array | None = None
    """State of the lag; None if it has settled at the next command."""
    step: float = 0.0
    """Time between the samples in the state of the lag [s]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveModel:
    """Hysteresis, creep, modes and delay in series, from the command to the reading.

    ``reading(t) = offset + sign x modes(creep(hysteresis(command)))(t - delay)``
    """

    hysteresis: HysteresisModel
    """The hysteresis."""
    creep: Creep | None = None
    """Creep of the output of the hysteresis; None for none."""
    modes: StageModes | None = None
    """Modes of the stage in the reading, at unit static gain; None for none."""
    lag: Lag | None = None
    """Delay and lag of the acquisition; None for none."""
    offset: float = 0.0
    """Reading at no command, with no history [`output_unit`]."""
    sign: float = 1.0
    """1 if the reading rises with the command, -1 if it falls."""
    input_unit: str = "V"
    """Unit of the command; empty if unknown."""
    output_unit: str = "m"
    """Unit of the reading; empty if unknown."""
    validity: ValidityRange | None = None
    """Range of its identification."""
    start: Start = "rested"
    """Motion of the drive before the record of the identification."""
    zero: Zero = "one"
    """Zero of the sensor: one of all records, or one of each, with or without a linear drift. The
    offset is then the mean of the identification, and only changes of readings are predicted.
    """

    def conditioned(self) -> Array:
        """Return the state of the hysteresis after cycles over the full range, at its low end.

        They erase earlier motion. Three slow cycles bring a drive to this state.

        Returns
        -------
        numpy.ndarray
            The state.

        Raises
        ------
        ModelError
            The model has no validity range.
        """
        if self.validity is None:
            raise ModelError(
                "the model has no range for conditioning cycles: give it a validity range"
            )
        low, high = self.validity.input_range
        return self.hysteresis.simulate([high, low] * _CONDITIONING).state

    def before(self, start: Start | Array | None = None) -> DriveState:
        """Return the state after conditioning cycles, or without history where no range is known.

        The start, of its creep, is by default that of the record of the identification.
        """
        memory = self.hysteresis.initial_state() if self.validity is None else self.conditioned()
        return DriveState(hysteresis=memory, creep=self.start if start is None else start)

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
            not given, or without history if the model has no validity range.
        start : "rested", float or numpy.ndarray, optional
            Motion of the drive before, for its creep, or the state of its creep. Where not given,
            rest at the first command if a state is given, otherwise the start of the record of the
            identification.

        Returns
        -------
        numpy.ndarray
            Readings [`output_unit`], shape (n,). Modes and lag have settled at the first command.
        """
        before = self.before(start)
        if state is not None:
            memory = np.asarray(state, dtype=np.float64)
            before = DriveState(hysteresis=memory, creep="rested" if start is None else start)
        return self.response(u, dt, before)[0]

    def response(self, u: ArrayLike, dt: float, before: DriveState) -> tuple[Array, DriveState]:
        """Return the readings for a sequence of commands, and the state of the drive at its end.

        Parameters
        ----------
        u : array_like
            Commands [`input_unit`], shape (n,).
        dt : float
            Time from one sample to the next [s].
        before : DriveState
            State one step before the first of them, such as the one at the end of the sequence
            before, whose step may be another.

        Returns
        -------
        tuple of numpy.ndarray and DriveState
            Readings [`output_unit`], shape (n,), and the state at the last sample.
        """
        response = self.hysteresis.simulate(samples(u, "command"), before.hysteresis)
        y, memory = response.values, response.state
        creep, modes, lag = before.creep, before.modes, before.lag
        if self.creep is not None:
            response = self.creep.simulate(y, dt, creep_start(self.creep, y, dt, creep))
            y, creep = response.values, response.state
        if self.modes is not None:
            response = self.modes.simulate(y, dt, modes)
            y, modes = response.values, response.state
        if self.lag is not None:
            lag = None if lag is None else self.lag.resampled(lag, before.step, dt)
            response = self.lag.simulate(y, dt, lag)
            y, lag = response.values, response.state
        state = DriveState(hysteresis=memory, creep=creep, modes=modes, lag=lag, step=dt)
        return self.offset + self.sign * y, state

    def outside(self, u: ArrayLike) -> str:
        """Return a warning about commands outside the range of the identification.

        Parameters
        ----------
        u : array_like
            Commands [`input_unit`], shape (n,).

        Returns
        -------
        str
            One sentence, or an empty text if they are inside.
        """
        beyond = self.beyond(u)
        if self.validity is None or beyond <= 1e-6:
            return ""
        commands = np.asarray(u, dtype=np.float64)
        return (
            f"the commands, {readable(self.input_unit, commands.min(), commands.max())}, exceed "
            f"the range of the identification, "
            f"{readable(self.input_unit, *self.validity.input_range)}, by up to "
            f"{100.0 * beyond:.2g} % of that range: the output there is extrapolated"
        )

    def beyond(self, u: ArrayLike) -> float:
        """Return how far commands exceed the range of the identification, over that range [1]."""
        if self.validity is None:
            return 0.0
        low, high = self.validity.input_range
        below, above = low - float(np.min(u)), float(np.max(u)) - high
        return max(below, above, 0.0) / (high - low)


def requested_readings(
    drive: DriveModel, channel: Channel, *, relative: bool
) -> tuple[Array, tuple[str, ...]]:
    """Return a reference as readings of a drive, in its unit, and notes.

    A relative one counts from the lowest reading of the identification. A ModelError without a
    validity range, or if an absolute one is given for a sensor without a fixed zero.
    """
    if not relative and drive.zero != "one":
        raise ModelError(
            "each record of the identification has a zero of its own, so that an absolute "
            "reference has no meaning: count it from the lowest reading, by --relative"
        )
    values, note = in_unit_of_model(channel.values, channel.unit, drive.output_unit, "reference")
    if relative:
        if drive.validity is None:
            raise ModelError("--relative needs a model with a validity range")
        values = values + drive.validity.output_range[0]
    return values, (note,) if note else ()


def in_unit_of_model(values: ArrayLike, unit: str, model_unit: str, what: str) -> tuple[Array, str]:
    """Return values in the unit of a model.

    Unknown units are empty. The second result is a note on the conversion, or empty. A ModelError
    if only one unit is known, or their dimensions differ.

    Examples
    --------
    >>> in_unit_of_model([0.02], "mm", "um", "reference")
    (array([20.]), 'the reference was converted from mm to um, the unit of the model')
    """
    numbers, option = samples(values, what), "column" if what == "reference" else what
    if unit == model_unit:
        return numbers, ""
    if not unit:
        raise ModelError(
            f"the {what} has no unit and the model is in {model_unit}: give it after "
            f'the column, such as --{option} "1 {model_unit}"'
        )
    if not model_unit:
        raise ModelError(
            f"the {what} is in {unit} and the model was identified without a unit: identify it "
            'again with units after the columns, such as --output "1 um"'
        )
    (unit_factor, si), (model_factor, model_si) = si_unit(unit), si_unit(model_unit)
    if si != model_si:
        raise ModelError(
            f"the {what} is in {unit}, that of the model in {model_unit}: give its unit with "
            f"--{option}, or select another column"
        )
    converted = numbers * (unit_factor / model_factor)
    return converted, f"the {what} was converted from {unit} to {model_unit}, the unit of the model"


def range_warnings(
    model: DriveModel, dt: float, *, command: ArrayLike, reading: ArrayLike | None = None
) -> tuple[str, ...]:
    """Return warnings about a command and its readings outside the validity range of a model.

    One sentence for each: the range of the command, spans that indicate a wrong prefix of the unit,
    and other rates of cycles; none for a model without such ranges. The readings are requested or
    measured ones.
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
        sentence
        for sentence in (
            model.outside(u),
            *(_span(*span) for span in spans),
            _rate(u, dt, limits.rate_range_hz),
        )
        if sentence
    )


def _span(what: str, values: Array, limits: tuple[float, float], unit: str) -> str:
    """Return a warning about values that span far more or far less than the limits."""
    spread, size = float(np.ptp(values)), limits[1] - limits[0]
    if not size > 0.0 or size / PREFIX <= spread <= size * PREFIX:
        return ""
    reference = f"{readable(unit, size)} of the identification"
    if spread == 0.0:
        value, span = readable(unit, values[0], digits=5), readable(unit, size)
        return f"the {what} is constant at {value}; the identification had a span of {span}"
    much = f"{spread / size:.3g} times" if spread > size else f"1/{size / spread:.3g} of"
    return f"the {what} spans {readable(unit, spread)}, {much} the {reference}: check its unit"


def _rate(u: Array, dt: float, limits: tuple[float, float]) -> str:
    """Return a warning about cycles faster or slower than those of the identification."""
    if not limits[1] > 0.0 or not np.ptp(u) > 0.0:
        return ""
    rates = cycles(u, dt).rates_hz
    slow, fast = limits[0] / _OTHER_RATE, limits[1] * _OTHER_RATE
    other = [rate for rate in rates if not slow <= rate <= fast]
    if not other:
        return ""
    at = f"{limits[0]:.3g} Hz"
    if limits[1] > limits[0]:
        at = f"{limits[0]:.3g} to {limits[1]:.3g} Hz"
    rates_text = ", ".join(f"{rate:.3g}" for rate in other)
    return (
        f"cycles repeat at {rates_text} Hz and the model was identified at {at}: lag, creep and "
        "resonance at other rates are extrapolated; record cycles at that rate as well"
    )


def parameter_unit(kind: str, name: str, input_unit: str, output_unit: str) -> str:
    """Return the unit of a parameter.

    For a kind with an exponent it is that for 1. A name may be an element, such as ``weights[3]``;
    unknown units are called input and output.

    Examples
    --------
    >>> parameter_unit("bouc-wen", "gain", "V", "m")
    'm/V'
    """
    template = {**_CHAIN, **MODELS[kind].units}.get(name.split("[", maxsplit=1)[0], "1")
    return template.format(u=input_unit or "input", y=output_unit or "output")
