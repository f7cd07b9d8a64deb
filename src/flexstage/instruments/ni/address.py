"""An NI card by its address: ``ni://Dev1?x=ao0,ai0&amplifier=15&sensitivity=10um/V``."""

from collections.abc import Mapping, Sequence
from urllib.parse import parse_qsl, urlsplit

from flexstage.errors import ModelError, UnitError
from flexstage.instruments.limits import stage_limits
from flexstage.instruments.ni.acquisition import NiAcquisition
from flexstage.instruments.ni.backend import NiBackend
from flexstage.instruments.ni.daqmx import DaqmxBackend, driver_found
from flexstage.instruments.ni.setup import DriveOutput, NiSetup, SensorInput
from flexstage.instruments.ni.simulated import SimulatedBackend
from flexstage.stage import Stage
from flexstage.units import parse

__all__ = ["open_address", "setup_of_address"]

_OPTIONS = ("amplifier", "rate", "sensitivity", "simulated", "seed")
_SENSITIVITY = 10e-6  # of a simulated sensor, where none is given [m/V]
_NOISE = 0.2e-3  # of a simulated input [V]: 2 nm at that sensitivity


def open_address(
    address: str,
    stage: Stage | None = None,
    *,
    axes: Mapping[str, str] | None = None,
    setup: NiSetup | None = None,
) -> NiAcquisition:
    """Connect to an NI card; nothing moves by it.

    The address is ``ni://CARD?OPTIONS``. For each axis there is an option with the output of its
    drive and the input of its sensor (``x=ao0,ai0``); an axis of the stage that is not named
    gets those of its number. ``amplifier=15`` is the gain of the amplifiers [V/V],
    ``sensitivity=10um/V`` what the sensors read for a volt (a real card needs both),
    ``rate=20kHz`` how often outputs change, ``simulated=1`` asks for a simulated card and
    ``seed=3`` for its noise. A card is also simulated where there is no driver for a real one: its
    identity, its settings and the notes of every record say so.

    Parameters
    ----------
    address : str
        The address.
    stage : Stage, optional
        The stage: its axes and limits.
    axes : Mapping, optional
        Output and input by axis, as in the address: ``{"x": "ao0,ai0"}``.
    setup : NiSetup, optional
        What is wired, instead of the options on axes.

    Returns
    -------
    NiAcquisition
        The instrument.

    Raises
    ------
    ModelError
        The address is none.
    NotConnectedError
        The card is not there.

    Examples
    --------
    >>> card = open_address("ni://Dev1?x=ao0,ai0&amplifier=15&simulated=1")
    >>> card.identity.simulated, card.axes["x"].limits.voltage
    (True, (-150.0, 150.0))
    """
    options = _parts(address)[1]
    asked = _is_yes(options.get("simulated", "0"), address)
    reason = "" if asked else driver_found()
    simulated = asked or bool(reason)
    if setup is None:
        setup = setup_of_address(address, stage, axes=axes, simulated=simulated)
    elif unfit := sorted((set(options) | set(axes or ())) - {"simulated", "seed"}):
        raise ModelError(
            f"'{unfit[0]}' is said beside a setup that says what is wired to {address!r}: leave "
            "one of them out"
        )
    if not simulated:
        return NiAcquisition(setup, DaqmxBackend(), stage=stage)
    note = "simulated card, as asked for: nothing was measured" if asked else (
        f"simulated card, since {reason}: nothing was measured"
    )  # fmt: skip
    return NiAcquisition(setup, _simulated(setup, stage, options, address, note), stage=stage)


def setup_of_address(
    address: str,
    stage: Stage | None = None,
    *,
    axes: Mapping[str, str] | None = None,
    simulated: bool = False,
) -> NiSetup:
    """Return what an address says is wired.

    Parameters
    ----------
    address : str
        The address, as of `open_address`.
    stage : Stage, optional
        The stage, whose axes are wired.
    axes : Mapping, optional
        As of `open_address`.
    simulated : bool
        Whether the card is simulated, so that the sensitivity may be left out.

    Returns
    -------
    NiSetup
        What is wired.

    Raises
    ------
    ModelError
        An option is unknown or not what it should be.

    Examples
    --------
    >>> setup = setup_of_address("ni://Dev2?x=ao1,ai4&sensitivity=2um/V&amplifier=7.5")
    >>> setup.outputs[0].channel, setup.inputs[0].channel, setup.outputs[0].gain
    ('Dev2/ao1', 'Dev2/ai4', 7.5)
    """
    device, options = _parts(address)
    named = {**options, **(axes or {})}
    wires = _wires(address, named, [] if stage is None else [a.name for a in stage.axes])
    if not wires:
        raise ModelError(
            f"the address {address!r} names no axis: add its output and input, such as 'x=ao0,ai0'"
        )
    if "sensitivity" not in options and not simulated:
        raise ModelError(
            f"the address {address!r} does not say what a sensor reads for a volt: add it, such as "
            "'sensitivity=10um/V'"
        )
    if "amplifier" not in options and not simulated:
        raise ModelError(
            f"the address {address!r} does not say what amplifiers are behind the outputs, so that "
            "no voltage at a drive is known: add their gain, such as 'amplifier=15', or "
            "'amplifier=1' where there are none"
        )
    try:
        gain = parse(options["sensitivity"], "gain") if "sensitivity" in options else _SENSITIVITY
        rate = parse(options.get("rate", "10 kHz"), "frequency")
        amplifier = float(options.get("amplifier", "1"))
    except (UnitError, ValueError) as error:
        raise ModelError(f"the address {address!r} has a number that is none: {error}") from None
    return NiSetup(
        device=device,
        inputs=tuple(
            SensorInput(channel=f"{device}/{sensor}", name=axis, gain=gain)
            for axis, (_, sensor) in wires.items()
        ),
        outputs=tuple(
            DriveOutput(channel=f"{device}/{output}", axis=axis, sensor=axis, gain=amplifier)
            for axis, (output, _) in wires.items()
        ),
        output_rate_hz=rate,
    )


def _parts(address: str) -> tuple[str, dict[str, str]]:
    split = urlsplit(address)
    if split.scheme != "ni" or not split.netloc or split.path.strip("/"):
        raise ModelError(
            f"an NI card has an address such as 'ni://Dev1?x=ao0,ai0', got {address!r}"
        )
    pairs = parse_qsl(split.query, keep_blank_values=True)
    if len({k for k, _ in pairs}) != len(pairs):
        raise ModelError(f"the address {address!r} says something twice: say it once")
    return split.netloc, dict(pairs)


def _wires(
    address: str, options: Mapping[str, str], axes: Sequence[str]
) -> dict[str, tuple[str, str]]:
    """Return output and input by axis."""
    found = {axis: (f"ao{k}", f"ai{k}") for k, axis in enumerate(axes)}
    for name, text in options.items():
        if name in _OPTIONS:
            continue
        wires = [w.strip() for w in text.split(",")]
        if axes and name not in axes:
            known = ", ".join((*axes, *_OPTIONS))
            raise ModelError(f"the address {address!r} says '{name}': what it may say is {known}")
        if len(wires) != 2 or not (wires[0].startswith("ao") and wires[1].startswith("ai")):
            raise ModelError(
                f"the address {address!r} must name an output and an input for '{name}', such as "
                f"'{name}=ao0,ai0', got {text!r}"
            )
        found[name] = (wires[0], wires[1])
    return found


def _is_yes(text: str, address: str) -> bool:
    if text.lower() not in ("0", "1", "no", "yes", "false", "true"):
        raise ModelError(f"'simulated' is 0 or 1 in the address {address!r}, got {text!r}")
    return text.lower() in ("1", "yes", "true")


def _simulated(
    setup: NiSetup, stage: Stage | None, options: Mapping[str, str], address: str, note: str
) -> NiBackend:
    """A card whose sensors go over 80 % of their ranges while the drives go over theirs."""
    seed = options.get("seed", "0")
    if not seed.isdecimal():
        raise ModelError(f"'seed' is a whole number in the address {address!r}, got {seed!r}")
    wiring: dict[str, dict[str, float]] = {}
    for drive in setup.outputs:
        low, high = drive.drive_range
        if stage is not None and (own := stage_limits(stage, drive.axis).voltage) is not None:
            low, high = max(low, own[0]), min(high, own[1])
        sensor = setup.inputs[setup.number(drive.sensor) - 1]
        reach = 0.8 * min(sensor.voltage_range[1], -sensor.voltage_range[0])
        reach = reach if reach > 0.0 else 0.8 * sensor.voltage_range[1]
        wiring[sensor.channel] = {drive.channel: reach * drive.gain / max(abs(low), abs(high))}
    return SimulatedBackend(wiring, noise=_NOISE, seed=int(seed), note=note)
