"""Commands that tell how a piezo controller and its parts are: bits, digits, interfaces."""

from collections.abc import Sequence

from flexstage.instruments.twin import errors_gcs as code
from flexstage.instruments.twin.command import (
    Client,
    GcsCommand,
    Reply,
    chosen,
    fact,
    printed,
    unsigned,
)
from flexstage.instruments.twin.commands_motion import of_axes, of_inputs
from flexstage.instruments.twin.errors_gcs import GcsError
from flexstage.instruments.twin.gcs_state import MICRO, ControllerState

#: Bits of the status register.
_SERVO, _MOVING, _ON_TARGET = 1 << 12, 1 << 13, 1 << 15
#: Largest number of the converter of an input, 18 bits with sign.
_DIGITS = (1 << 17) - 1
#: What an input that has no range of its own reads at most [um, or urad].
_FULL_SCALE = 100.0
#: Range of an axis's sensor over that of its positions; a stage at rest is below them.
_SENSOR_SPAN = 1.5
#: Part of the range of the voltage that is no way to its end.
_AT_END = 1e-6


def _bits(state: ControllerState, axis: str) -> int:
    device = state.device
    return (
        _SERVO * device.servo_on(axis)
        + _MOVING * device.moving(axis)
        + _ON_TARGET * device.on_target(axis)
    )


def status_register(state: ControllerState) -> str:
    """Return what ``#4`` answers."""
    return "0x" + "".join(f"{_bits(state, axis):04X}" for axis in state.axes)


def _registers(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    if len(words) % 2:
        raise GcsError(code.NUMBER_OF_PARAMETERS)
    given = list(zip(words[::2], words[1::2], strict=True)) or [(a, "1") for a in state.axes]
    for axis, register in given:
        if axis not in state.axes:
            raise GcsError(code.UNKNOWN_AXIS)
        if unsigned(register) != 1:
            raise GcsError(code.OUT_OF_RANGE)
    return [f"{axis} {register}=0x{_bits(state, axis):04X}" for axis, register in given]


def _overflow(state: ControllerState, axis: str) -> str:
    """Say whether position control asks for more voltage than there is."""
    if state.axes[axis].kind != "piezo" or not state.device.servo_on(axis):
        return "0"
    low, high = state.voltage_range(axis)
    slack = _AT_END * (high - low)
    return str(int(not low + slack < state.device.voltage(axis) < high - slack))


def _normalized(state: ControllerState, channel: int) -> float:
    """Return a reading as a part of the largest one [%], 0 in the middle of its range."""
    reading = state.device.channel(channel) / MICRO
    axes = list(state.axes)
    if channel > len(axes):
        return 100.0 * reading / _FULL_SCALE
    low, high = (end / MICRO for end in state.position_range(axes[channel - 1]))
    return 100.0 * (2.0 * reading - high - low) / (_SENSOR_SPAN * (high - low))


def _digits(state: ControllerState, channel: int) -> str:
    return str(max(-_DIGITS, min(_DIGITS, round(_DIGITS * _normalized(state, channel) / 100.0))))


def _interfaces(state: ControllerState, _: Client, words: Sequence[str]) -> Reply:
    facts = {
        "RSBAUD": "0",  # no serial line
        "IPADR": f"{state.host}:{state.port}",
        "IPSTART": "0",
        "IPMASK": "255.255.255.255",
        "MACADR": "00-00-00-00-00-00",
    }
    return [f"{name}={value}" for name, value in chosen(words, facts, code.UNKNOWN_PARAMETER)]


#: Commands of the controller's state; inputs for the target, and switches of the stage, are none.
STATUS = (
    GcsCommand("AOS?", "[{<AxisID>}]", "Get Analog Input Offset",
               of_axes(lambda _, __: printed(0.0))),
    GcsCommand("IFC?", "[{<InterfacePam>}]", "Get Interface Parameters", _interfaces),
    GcsCommand("LIM?", "[{<AxisID>}]", "Indicate Limit Switches", of_axes(lambda _, __: "0")),
    GcsCommand("OVF?", "[{<AxisID>}]", "Get Overflow State", of_axes(_overflow)),
    GcsCommand("SRG?", "[{<AxisID> <RegisterID>}]", "Query Status Register Value", _registers,
               poll=True),
    GcsCommand("SSN?", "", "Get Device Serial Number",
               fact(lambda s: s.device.identity.serial_number or "0")),
    GcsCommand("TAD?", "[{<InputID>}]", "Get ADC Value Of Input Signal", of_inputs(_digits)),
    GcsCommand("TNS?", "[{<InputID>}]", "Get Normalized Input Signal Value",
               of_inputs(lambda s, n: printed(_normalized(s, n)))),
    GcsCommand("TRS?", "[{<AxisID>}]", "Indicate Reference Switch", of_axes(lambda _, __: "0")),
)  # fmt: skip
