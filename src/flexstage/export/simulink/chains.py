"""Amplifier, hysteresis, creep and sensor as Simulink blocks; MATLAB functions of hysteresis."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexstage.base.version import __version__
from flexstage.export.simulink.matlab_text import (
    Variables,
    comment,
    identifier,
    literal,
    valid_name,
    wrapped,
)
from flexstage.export.simulink.system import Node, System, Wiring
from flexstage.files.names import free_name
from flexstage.hysteresis import Amplifier, Creep, HysteresisModel, Sensor
from flexstage.hysteresis.models.registry import matlab_code
from flexstage.hysteresis.models.source_code import source_file

#: Multiplication of a column of signals by the matrix of a Gain block.
VECTOR_GAIN = "Matrix(K*u) (u vector)"


def gain(name: str, variable: str, meaning: str, label: str = "") -> Node:
    """Return a block that multiplies a column of signals by a matrix expression."""
    return Node(
        name, "Gain", {"Gain": variable, "Multiplication": VECTOR_GAIN}, meaning, label=label
    )


def _scalar(name: str, value: str, meaning: str) -> Node:
    settings = {"Gain": value, "Multiplication": "Element-wise(K.*u)"}
    return Node(name, "Gain", settings, meaning)


def _port(kind: str, name: str, meaning: str) -> Node:
    settings = {"PortDimensions": "1"} if kind == "Inport" else {}
    return Node(name, kind, settings, meaning)


def _sum(name: str, signs: str, meaning: str) -> Node:
    return Node(name, "Sum", {"Inputs": signs, "IconShape": "round"}, meaning, inputs=len(signs))


def amplifier(model: Amplifier, name: str, variables: Variables) -> System:
    """Return an amplifier: T u' = g c - u with limited rate, and an integrator with limits.

    Its variables begin with the name, like those of creep and sensor.
    """
    w = Wiring("amplifier: one pole, limited rate, limited range")
    names = {
        what: variables.add(f"{name}_{what}", value, meaning)
        for what, value, meaning in (
            ("gain", model.gain, "voltage over command [1]"),
            ("per_T", 1.0 / model.time_constant, "2 pi times the bandwidth [1/s]"),
        )
    }
    w.add(_port("Inport", "command", "command [V]"))
    w.add(_scalar("g", names["gain"], "voltage over command [1]"))
    w.add(_sum("lag", "+-", "lag of the voltage [V]"))
    w.add(_scalar("per_T", names["per_T"], "2 pi times the bandwidth [1/s]"))
    at = w.chain("command", "g", "lag", "per_T")
    if np.isfinite(model.largest_rate):
        rate = variables.add(
            f"{name}_rate", model.largest_rate, "largest rate of the voltage [V/s]"
        )
        w.block(
            "rate",
            "Saturate",
            {"UpperLimit": rate, "LowerLimit": f"-{rate}"},
            "largest rate: slew limit, or current over capacitance [V/s]",
        )
        at = w.chain(at, "rate")
    settings = {"InitialCondition": "0"}
    if model.voltage_range is not None:
        low, high = model.voltage_range
        at_low = variables.add(f"{name}_low", low, "lowest voltage [V]")
        at_high = variables.add(f"{name}_high", high, "highest voltage [V]")
        settings = {
            "InitialCondition": f"min(max(0, {at_low}), {at_high})",
            "LimitOutput": "on",
            "UpperSaturationLimit": at_high,
            "LowerSaturationLimit": at_low,
        }
    w.block("voltage", "Integrator", settings, "voltage [V]")
    w.add(_port("Outport", "u", "voltage [V]"))
    w.chain(at, "voltage", "u")
    w.connect("voltage", "lag", port=2)
    return w.system()


def hysteresis(function: str, sample_time: str, meaning: str) -> System:
    """Return a hysteresis: the input is sampled, and a function with memory steps.

    The sample time is an expression [s].
    """
    w = Wiring(meaning)
    w.add(_port("Inport", "u", "input of the hysteresis"))
    w.block(
        "sampled",
        "ZeroOrderHold",
        {"SampleTime": sample_time},
        "samples of the input; the function is exact for a straight line between two",
    )
    w.block("hysteresis", "MatlabFunction", meaning=meaning, function=function)
    w.add(_port("Outport", "y", "output of the hysteresis, held for one sample"))
    w.chain("u", "sampled", "hysteresis", "y")
    return w.system()


def creep(model: Creep, name: str, variables: Variables) -> System:
    """Return creep: parallel lags, and the sum of input and lags."""
    rate = 1.0 / model.time_constants
    m = rate.size
    w = Wiring("creep: parallel lags")
    spread = variables.add(f"{name}_spread", np.ones((m, 1)), "one input for every lag [1]")
    rates = variables.add(f"{name}_per_tau", rate[None, :], "1 over time constants [1/s]")
    share = variables.add(
        f"{name}_share", model.lag_gains[None, :], "share of each lag in the output [1]"
    )
    w.add(_port("Inport", "x", "motion without creep"))
    w.add(gain("spread", spread, "one input for every lag [1]"))
    w.add(_sum("lag", "+-", "input of each lag less its output"))
    # a diagonal matrix: a column of factors could turn a column of signals into a matrix
    w.add(gain("per_tau", f"diag({rates})", "1 over time constants [1/s]"))
    w.block("lags", "Integrator", {"InitialCondition": f"zeros({m}, 1)"}, "lags")
    w.add(gain("share", share, "share of each lag [1]"))
    w.add(_sum("with_creep", "++", "motion with creep"))
    w.add(_port("Outport", "y", "motion with creep"))
    w.chain("x", "spread", "lag", "per_tau", "lags", "share")
    w.connect("lags", "lag", port=2)
    w.connect("x", "with_creep")
    w.connect("share", "with_creep", port=2)
    w.connect("with_creep", "y")
    return w.system()


def sensor(model: Sensor, name: str, variables: Variables) -> System:
    """Return a sensor without noise: gain, lag, offset, mains pick-up and resolution."""
    w = Wiring("sensor without noise")
    w.add(_port("Inport", "x", "true motion"))
    at = "x"
    if model.bandwidth_hz is not None:
        tau = 1.0 / (2.0 * np.pi * model.bandwidth_hz)
        variable = variables.add(f"{name}_T", tau, "time constant of the sensor [s]")
        w.block(
            "lag",
            "TransferFcn",
            {"Numerator": "[1]", "Denominator": f"[{variable} 1]"},
            f"lag of the sensor, {model.bandwidth_hz:.6g} Hz",
        )
        at = w.chain(at, "lag")
    if model.gain != 1.0:
        factor = variables.add(f"{name}_gain", model.gain, "reading over motion [1]")
        w.add(_scalar("gain", factor, "reading over motion [1]"))
        at = w.chain(at, "gain")
    at = _added(w, at, model, name, variables)
    if model.quantisation > 0.0:
        steps = variables.add(f"{name}_step", model.quantisation, "smallest step of the reading")
        w.block(
            "steps", "Quantizer", {"QuantizationInterval": steps}, "smallest step of the reading"
        )
        at = w.chain(at, "steps")
    w.add(_port("Outport", "y", "reading"))
    w.chain(at, "y")
    return w.system()


def _added(w: Wiring, at: str, model: Sensor, name: str, variables: Variables) -> str:
    """Add the offset and the mains pick-up."""
    sources: list[Node] = []
    if model.offset != 0.0:
        value = variables.add(f"{name}_offset", model.offset, "reading at no motion")
        sources.append(
            Node("offset", "Constant", {"Value": value}, "reading at no motion", inputs=0)
        )
    if model.mains_amplitude != 0.0:
        value = variables.add(f"{name}_mains", model.mains_amplitude, "mains pick-up")
        settings: dict[str, Any] = {
            "Amplitude": value,
            "Frequency": f"2*pi*{literal(model.mains_frequency_hz)}",
            "Phase": literal(model.mains_phase),
            "SampleTime": "0",
        }
        sources.append(
            Node(
                "mains",
                "SineWave",
                settings,
                f"mains pick-up, {model.mains_frequency_hz:g} Hz",
                inputs=0,
            )
        )
    if not sources:
        return at
    total = w.add(_sum("reading", "+" * (1 + len(sources)), "reading before rounding"))
    w.connect(at, total)
    for port, source in enumerate(sources, 2):
        w.connect(w.add(source), total, port=port)
    return total


class Functions:
    """Texts of functions by name, with a prefix; the same model has the same function."""

    __slots__ = ("_models", "_prefix", "texts")

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self.texts: dict[str, str] = {}
        self._models: list[tuple[HysteresisModel, str]] = []

    def add(self, model: HysteresisModel, base: str) -> str:
        """Return the name of the function of a model, based on a name."""
        for existing, name in self._models:
            if existing is model:
                return name
        suffix = identifier(base.removesuffix("_hysteresis"), longest=63)
        room = 63 - len(self._prefix) - 3
        used = {existing.lower() for existing in self.texts}
        name = free_name(f"{self._prefix}{suffix[:room]}", lambda n: n.lower() in used)
        self.texts[name] = hysteresis_function(model, name)
        self._models.append((model, name))
        return name


def hysteresis_function(model: HysteresisModel, name: str) -> str:
    """Return a hysteresis model as a MATLAB function with memory.

    Each call moves the input on a straight line from its last value to a new one, with an exact
    output. The memory is in persistent variables; ``clear`` with the name of the function resets it
    to rest.

    Validity: that of the model. The same text runs in a MATLAB Function block of Simulink, with a
    memory for each block, and in GNU Octave.

    Examples
    --------
    >>> from flexstage.hysteresis import BoucWen
    >>> model = BoucWen(gain=0.593e-6, hysteresis_gain=0.441e-6, beta=0.05, gamma=0.03)
    >>> print(hysteresis_function(model, "stack_x").splitlines()[0])
    function y = stack_x(u)
    """
    valid_name(name, "name of a function")
    code = matlab_code(model)
    return (
        f"function y = {name}(u)\n"
        + comment(f"{name.upper()} Hysteresis of kind {model.kind}: output y for the next input u.")
        + comment(
            "Each call moves u on a straight line from its last value, with an exact y. The memory "
            f"is initially at rest; 'clear {name}' resets it."
        )
        + comment(f"Written by flexstage {__version__}.")
        + "%#codegen\n"
        + "".join(source_file(f"{part}.m").decode("ascii") for part in code.parts)
        + _parameters(code.parameters)
    )


def _parameters(numbers: Mapping[str, tuple[Any, str]]) -> str:
    body = ""
    for name, (value, meaning) in numbers.items():
        lines = wrapped(literal(value), 89)
        body += comment(meaning) + f"p.{name} = " + " ...\n    ".join(lines) + ";\n"
    return "\nfunction p = parameters()\n" + body + "end\n"
