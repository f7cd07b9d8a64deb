"""An NI card by its address: ``ni://Dev1?x=ao0,ai0&amplifier=15&sensitivity=10um/V``."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar, get_args
from urllib.parse import urlsplit

import numpy as np

from flexstage.base.errors import ModelError, UnitError
from flexstage.instruments.connect import flag, options_of, whole_number
from flexstage.instruments.ni.acquisition import NiAcquisition
from flexstage.instruments.ni.daqmx import DaqmxBackend, driver_found
from flexstage.instruments.ni.setup import DriveOutput, NiBackend, NiSetup, SensorInput, Terminal
from flexstage.instruments.ni.simulated import SimulatedBackend
from flexstage.quantities.units import parse
from flexstage.stage import Stage
from flexstage.stage.limits import stage_limits

_OF_CARD = ("rate", "simulated", "seed")
_OF_SENSOR = ("sensitivity", "offset", "range", "terminal")
_OF_DRIVE = ("amplifier", "bias", "standing")
_SENSITIVITY = "10um/V"  # of a simulated sensor, where none is given
_NOISE = 0.2e-3  # of a simulated input [V]: 2 nm at that sensitivity

_T = TypeVar("_T")


def open_address(
    address: str,
    stage: Stage | None = None,
    *,
    axes: Mapping[str, str] | None = None,
    setup: NiSetup | None = None,
) -> NiAcquisition:
    """Connect to an NI card; this does not move the stage.

    The address is ``ni://CARD?OPTIONS``. Each axis has an option with the output of its drive and
    the input of its sensor (``x=ao0,ai0``), which can also be in `axes` (``{"x": "ao0,ai0"}``). By
    default an axis of the stage uses the output and input of its number. ``roll=ai2`` is a further
    sensor, without a drive.

    Options of sensors: ``sensitivity=10um/V`` (required for a real card), ``offset=1.3um`` at 0 V,
    ``range=5V`` for plus and minus 5 V or ``range=0V:10V``, ``terminal=rse`` (or ``nrse``,
    ``diff``, ``pseudo_diff``). Options of drives: ``amplifier=15``, the gain [V/V] (required for a
    real card), ``bias=-30V`` at the drive for 0 V of the card, ``standing=12V`` at the drive when
    connecting. Each option applies to all sensors or drives, or to one with its name after a dot:
    ``sensitivity.y=8.1um/V``.

    ``rate=20kHz`` is the update rate of the outputs, ``simulated=1`` selects a simulated card and
    ``seed=3`` its noise. A card is also simulated where the driver of real cards is missing; its
    identity, its settings and the notes of every record state this. A `setup` replaces the options
    of the wiring.

    Examples
    --------
    >>> card = open_address("ni://Dev1?x=ao0,ai0&amplifier=15&simulated=1")
    >>> card.identity.simulated, card.axes["x"].limits.voltage
    (True, (-150.0, 150.0))
    """
    options = _parts(address)[1]
    requested = flag(options, "simulated", False, address)
    reason = "" if requested else driver_found()
    simulated = requested or bool(reason)
    if setup is None:
        setup = setup_of_address(address, stage, axes=axes, simulated=simulated)
    elif unfit := sorted((set(options) | set(axes or ())) - {"simulated", "seed"}):
        raise ModelError(
            f"the option '{unfit[0]}' of {address!r} and 'setup' both describe the wiring: omit "
            "one of them"
        )
    if not simulated:
        return NiAcquisition(setup, DaqmxBackend(), stage=stage)
    note = "simulated card, as requested: not measured data" if requested else (
        f"simulated card, since {reason}: not measured data"
    )  # fmt: skip
    return NiAcquisition(setup, _simulated(setup, stage, options, address, note), stage=stage)


def open_card(
    address: str, stage: Stage, *, axes: Mapping[str, str] | None, timeout: float | None
) -> NiAcquisition:
    """Connect to an NI card for `connect`; its driver has its own timeouts."""
    del timeout
    return open_address(address, stage, axes=axes)


def setup_of_address(
    address: str,
    stage: Stage | None = None,
    *,
    axes: Mapping[str, str] | None = None,
    simulated: bool = False,
) -> NiSetup:
    """Return the wiring of an address as for `open_address`.

    A simulated card needs neither sensitivity nor gain of an amplifier.

    Examples
    --------
    >>> setup = setup_of_address(
    ...     "ni://Dev2?x=ao1,ai4&y=ao0,ai5&sensitivity=2um/V&sensitivity.y=-3um/V&amplifier=7.5"
    ...     "&terminal=rse&range.y=5V"
    ... )
    >>> x, y = setup.inputs
    >>> (x.channel, x.gain, x.terminal), (y.gain, y.terminal, y.voltage_range)
    (('Dev2/ai4', 2e-06, 'rse'), (-3e-06, 'rse', (-5.0, 5.0)))
    """
    device, options = _parts(address)
    axis_names = [] if stage is None else [a.name for a in stage.axes]
    wires = _wires(address, {**options, **(axes or {})}, axis_names)
    drives = [name for name, (output, _) in wires.items() if output]
    if not drives:
        raise ModelError(
            f"the address {address!r} names no axis: add its output and input, such as 'x=ao0,ai0'"
        )
    values = _AddressOptions(address, options, sensors=list(wires), drives=drives)
    if not simulated:
        values.require("sensitivity", wires, "the sensitivity of sensor '{}'", "10um/V")
        values.require("amplifier", drives, "the gain of the amplifier of axis '{}'", "15")
    return NiSetup(
        device=device,
        inputs=tuple(
            _sensor(values, name, f"{device}/{wire}", driven=bool(output))
            for name, (output, wire) in wires.items()
        ),
        outputs=tuple(
            DriveOutput(
                channel=f"{device}/{wires[axis][0]}",
                axis=axis,
                sensor=axis,
                gain=values.read("amplifier", axis, _number, 1.0),
                offset=values.read("bias", axis, _volts, 0.0),
                standing=values.read("standing", axis, _volts, None),
            )
            for axis in drives
        ),
        output_rate_hz=values.read("rate", "", lambda text: parse(text, "frequency"), 10e3),
    )


class _AddressOptions:
    """Options of an address, for all sensors or drives, or for one by its name."""

    def __init__(
        self, address: str, options: Mapping[str, str], *, sensors: Sequence[str], drives: list[str]
    ) -> None:
        self._address, self._options = address, options
        for key in options:
            option, dot, name = key.partition(".")
            if dot and (
                option not in (*_OF_SENSOR, *_OF_DRIVE)
                or name not in (sensors if option in _OF_SENSOR else drives)
            ):
                raise ModelError(
                    f"the address {address!r} has the unknown option '{key}': sensors "
                    f"({', '.join(sensors)}) have {', '.join(_OF_SENSOR)}, and drives "
                    f"({', '.join(drives)}) {', '.join(_OF_DRIVE)}, as in 'range.{sensors[0]}=5V'"
                )

    def require(self, option: str, names: Sequence[str] | Mapping, what: str, such: str) -> None:
        """Refuse an address without an option for one of the names."""
        for name in names:
            if option not in self._options and f"{option}.{name}" not in self._options:
                bare = ", or 'amplifier=1' without one" if option == "amplifier" else ""
                raise ModelError(
                    f"the address {self._address!r} does not give {what.format(name)}: add it, "
                    f"such as '{option}={such}' or '{option}.{name}={such}'{bare}"
                )

    def read(self, option: str, name: str, how: Callable[[str], _T], usual: _T) -> _T:
        """Return the value of an option for a sensor or drive."""
        key = f"{option}.{name}" if f"{option}.{name}" in self._options else option
        if key not in self._options:
            return usual
        try:
            return how(self._options[key])
        except (UnitError, ValueError) as error:
            raise ModelError(f"'{key}' in the address {self._address!r}: {error}") from None


def _sensor(values: _AddressOptions, name: str, channel: str, *, driven: bool) -> SensorInput:
    read = _metres if driven else _gain
    gain, unit = values.read("sensitivity", name, read, read(_SENSITIVITY))
    quantity = {"m": "length", "rad": "angle", "N": "force"}[unit]
    return SensorInput(
        channel=channel,
        name=name,
        unit=unit,
        gain=gain,
        offset=values.read("offset", name, lambda text: parse(text, quantity), 0.0),
        voltage_range=values.read("range", name, _range, (-10.0, 10.0)),
        terminal=values.read("terminal", name, _terminal, "default"),
    )


def _metres(text: str) -> tuple[float, str]:
    return parse(text, "gain"), "m"


def _gain(text: str) -> tuple[float, str]:
    """Return the sensitivity of a sensor without a drive, and its unit."""
    for quantity, unit in (("angle", "rad"), ("force", "N")):
        try:
            return parse(text.removesuffix("/V"), quantity), unit
        except UnitError:
            continue
    return _metres(text)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"expected a number such as 15, got '{text}'") from None


def _volts(text: str) -> float:
    return parse(text, "voltage")


def _range(text: str) -> tuple[float, float]:
    """Return the range of "5V", which is plus and minus 5 V, or of "0V:10V"."""
    low, colon, high = text.partition(":")
    return (_volts(low), _volts(high)) if colon else (-_volts(low), _volts(low))


def _terminal(text: str) -> Terminal:
    for known in get_args(Terminal):
        if text.lower().replace("-", "_") == known:
            return known
    raise ValueError(f"expected {', '.join(get_args(Terminal))}, got '{text}'")


def _parts(address: str) -> tuple[str, dict[str, str]]:
    split = urlsplit(address)
    if split.scheme != "ni" or not split.netloc or split.path.strip("/"):
        raise ModelError(
            f"the address of an NI card must be such as 'ni://Dev1?x=ao0,ai0', got {address!r}"
        )
    return split.netloc, options_of(address, split)


def _wires(
    address: str, options: Mapping[str, str], axes: Sequence[str]
) -> dict[str, tuple[str, str]]:
    """Return output and input by axis, followed by the inputs of sensors without a drive."""
    wired = {axis: (f"ao{k}", f"ai{k}") for k, axis in enumerate(axes)}
    known = (*_OF_CARD, *_OF_SENSOR, *_OF_DRIVE)
    alone: dict[str, tuple[str, str]] = {}
    for name, text in options.items():
        if name in known or "." in name:
            continue
        wires = [w.strip() for w in text.split(",")]
        if len(wires) == 1 and re.fullmatch(r"ai\d+", wires[0]) and name not in axes:
            alone[name] = ("", wires[0])
            continue
        if axes and name not in axes:
            raise ModelError(
                f"the address {address!r} has the unknown option '{name}': the options are "
                f"{', '.join((*axes, *known))}, or a further sensor such as '{name}=ai5'"
            )
        if not re.fullmatch(r"ao\d+,ai\d+", ",".join(wires)):
            raise ModelError(
                f"the address {address!r} must name an output and an input for '{name}', such as "
                f"'{name}=ao0,ai0', got {text!r}"
            )
        wired[name] = (wires[0], wires[1])
    return wired | alone


def _simulated(
    setup: NiSetup, stage: Stage | None, options: Mapping[str, str], address: str, note: str
) -> NiBackend:
    """Return a card whose sensors use 80 % of their ranges over the ranges of the drives."""
    seed = whole_number(options, "seed", 0, address)
    wiring: dict[str, dict[str, float]] = {}
    for drive in setup.outputs:
        low, high = drive.drive_range
        if stage is not None and (of_stage := stage_limits(stage, drive.axis).voltage) is not None:
            low, high = max(low, of_stage[0]), min(high, of_stage[1])
        sensor = setup.inputs[setup.number(drive.sensor) - 1]
        reach = 0.8 * min(sensor.voltage_range[1], -sensor.voltage_range[0])
        reach = reach if reach > 0.0 else 0.8 * sensor.voltage_range[1]
        wiring[sensor.channel] = {drive.channel: reach * drive.gain / max(abs(low), abs(high))}
    return SimulatedBackend(
        wiring,
        noise=_NOISE,
        seed=seed,
        note=note,
        standing={d.channel: float(d.output(np.array(d.begins_at))) for d in setup.outputs},
    )
