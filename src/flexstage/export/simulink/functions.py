"""Functions of MATLAB that a Simulink model holds, one for each hysteresis."""

from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import Any

import numpy as np

from flexstage import __version__
from flexstage.errors import ModelError
from flexstage.export.simulink.matlab_text import comment, identifier, literal, valid_name
from flexstage.hysteresis import (
    AsymmetricBoucWen,
    BoucWen,
    Dahl,
    Duhem,
    GeneralisedBoucWen,
    GeneralisedMaxwellSlip,
    HysteresisModel,
    ModifiedPrandtlIshlinskii,
    PrandtlIshlinskii,
    Preisach,
)
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.models.bouc_wen_common import classical_law
from flexstage.hysteresis.models.bouc_wen_steps import law_of
from flexstage.hysteresis.models.play_model import Sum
from flexstage.hysteresis.models.power_law import power_table

# Parameters by name, and what is said of each.
_Numbers = Mapping[str, tuple[Any, str]]
_PLAYS = "half the gap of each play [unit of u]"


class Functions:
    """Texts by the names of their functions, which begin with a prefix.

    A model that comes again keeps its name.
    """

    __slots__ = ("_models", "_prefix", "_texts")

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._texts: dict[str, str] = {}
        self._models: list[tuple[HysteresisModel, str]] = []

    def add(self, model: HysteresisModel, wanted: str) -> str:
        """Return the name of the function of a model that belongs to what is wanted."""
        for known, name in self._models:
            if known is model:
                return name
        suffix = identifier(wanted.removesuffix("_hysteresis"), longest=63)
        room = 63 - len(self._prefix) - 3
        base = name = f"{self._prefix}{suffix[:room]}"
        count = 1
        while name.lower() in {taken.lower() for taken in self._texts}:
            count += 1
            name = f"{base}_{count}"
        self._texts[name] = hysteresis_function(model, name)
        self._models.append((model, name))
        return name

    @property
    def texts(self) -> Mapping[str, str]:
        """Texts by name."""
        return dict(self._texts)


def hysteresis_function(model: HysteresisModel, name: str) -> str:
    """Return a hysteresis model as a function of MATLAB that remembers.

    Each call moves the input on a straight line from its last value to a new one; the output is
    exact for it, to rounding. The memory is in persistent variables: it begins at rest, and
    ``clear`` with the name of the function brings it back there.

    Validity: that of the model. The same text runs as a MATLAB Function block of Simulink, which
    has a memory of its own for each block, and in GNU Octave.

    Examples
    --------
    >>> model = BoucWen(gain=0.593e-6, hysteresis_gain=0.441e-6, beta=0.05, gamma=0.03)
    >>> print(hysteresis_function(model, "stack_x").splitlines()[0])
    function y = stack_x(u)
    """
    valid_name(name, "name of a function")
    writer = _WRITERS.get(type(model))
    if writer is None:
        known = ", ".join(sorted(kind.kind for kind in _WRITERS))
        raise ModelError(
            f"a {model.kind} model is not written for Simulink: identify the record with one of "
            f"{known}"
        )
    parts, numbers = writer(model)
    return (
        f"function y = {name}(u)\n"
        + comment(f"{name.upper()} Hysteresis of kind {model.kind}: output y for the next input u.")
        + comment(
            "Each call moves u on a straight line from its last value, for which y is exact; the "
            f"memory begins at rest, and 'clear {name}' brings it back there."
        )
        + comment(f"Written by flexstage {__version__}.")
        + "%#codegen\n"
        + "".join(_part(part) for part in parts)
        + _parameters(numbers)
    )


def _part(name: str) -> str:
    return files("flexstage.export.simulink").joinpath("m", f"{name}.m").read_text("ascii")


def _parameters(numbers: _Numbers) -> str:
    body = "".join(
        comment(meaning) + f"p.{name} = {_wrapped(literal(value))};\n"
        for name, (value, meaning) in numbers.items()
    )
    return "\nfunction p = parameters()\n" + body + "end\n"


def _wrapped(text: str, width: int = 88) -> str:
    """Break a matrix into lines of a script."""
    lines, line = [], ""
    for word in text.split(" "):
        if line and len(line) + len(word) > width:
            lines.append(line)
            line = word
        else:
            line = f"{line} {word}" if line else word
    return " ...\n    ".join([*lines, line])


def _bouc_wen_like(
    cubic: list[float], law: Array, exponent: float
) -> tuple[tuple[str, ...], _Numbers]:
    """The law is A, n, the centre, and psi by direction, loaded or not, side of the centre."""
    numbers: dict[str, tuple[Any, str]] = {
        "cubic": (cubic, "factors of u, u^2 and u^3 [unit of y per unit of u, u^2, u^3]"),
        "A": (law[0], "slope dh/du at h = 0 [unit of y per unit of u]"),
        "centre": (law[2], "input at which the shape function changes [unit of u]"),
        "unloaded": (
            law[[4, 5, 8, 9]],
            "shape function where h unloads: u falls below, above the centre; rises below, above",
        ),
        "loaded": (law[[6, 7, 10, 11]], "shape function where h is loaded, in the same order"),
    }
    if exponent in (1.0, 2.0):
        return ("bouc_wen", f"power_{exponent:g}"), numbers
    table = power_table(exponent)
    numbers |= {
        "n": (exponent, "exponent [1]"),
        "low": (table[0], "series in z below z = exp(-1.1)"),
        "middle": (table[1:3], "series in ln z about z = 1: towards saturation, away from zero"),
        "high": (table[3], "series in 1/z above z = exp(1.1)"),
        "at_zero": (table[5, 1:3], "n times the distance at z = 1"),
        "at_low": (table[5, 3:5], "n times the distance at z = exp(-1.1)"),
        "at_high": (table[5, 5:7], "n times the distance at z = exp(1.1)"),
    }
    return ("bouc_wen", "power_n"), numbers


def _bouc_wen(m: BoucWen) -> tuple[tuple[str, ...], _Numbers]:
    law = classical_law(m.hysteresis_gain, m.beta, m.gamma, m.exponent)
    return _bouc_wen_like([m.gain, 0.0, 0.0], law, m.exponent)


def _asymmetric(m: AsymmetricBoucWen) -> tuple[tuple[str, ...], _Numbers]:
    law = classical_law(m.hysteresis_gain, m.beta, m.gamma, m.exponent)
    return _bouc_wen_like([m.gain, m.quadratic, m.cubic], law, m.exponent)


def _generalised(m: GeneralisedBoucWen) -> tuple[tuple[str, ...], _Numbers]:
    law = law_of(m.hysteresis_gain, m.exponent, m.centre, m.shape_function())
    return _bouc_wen_like([m.gain, 0.0, 0.0], law, m.exponent)


def _dahl(m: Dahl) -> tuple[tuple[str, ...], _Numbers]:
    return ("dahl",), {
        "gain": (m.gain, "gain of the straight part [unit of y per unit of u]"),
        "stiffness": (m.stiffness, "slope of the friction at zero [unit of y per unit of u]"),
        "limit": (m.limit, "friction that is approached [unit of y]"),
        "exponent": (m.exponent, "exponent [1]"),
    }


def _duhem(m: Duhem) -> tuple[tuple[str, ...], _Numbers]:
    def padded(coefficients: Array) -> Array:
        return np.pad(coefficients, (0, 4 - coefficients.size))

    return ("duhem",), {
        "rate": (m.rate, "how fast the output comes to its curve [per unit of u]"),
        "f": (padded(m.anhysteretic), "coefficients of the curve, from the constant up"),
        "g": (padded(m.tangent), "coefficients of the slope on the curve, from the constant up"),
    }


def _plays(
    total: Sum,
    knots: Array | None = None,
    slopes: Array | None = None,
    offsets: Array | None = None,
) -> tuple[tuple[str, ...], _Numbers]:
    gain, thresholds, inner, by_play, constants = total
    none = np.zeros(0)
    return ("plays",), {
        "gain": (gain, "part of the input itself [unit of y per unit of u]"),
        "thresholds": (thresholds, _PLAYS),
        "knots": (inner, "where the functions of the plays change their slope [unit of u]"),
        "slopes": (by_play, "slopes of these functions, one row a play [unit of y per unit of u]"),
        "offsets": (constants, "their values at zero, continued from each interval [unit of y]"),
        "line_knots": (none if knots is None else knots, "where the line after them has kinks"),
        "line_slopes": (np.ones(1) if slopes is None else slopes, "slopes of this line [1]"),
        "line_offsets": (np.zeros(1) if offsets is None else offsets, "its values at zero"),
    }


def _sum(m: PrandtlIshlinskii | Preisach) -> tuple[tuple[str, ...], _Numbers]:
    return _plays(m.play_terms())


def _modified(m: ModifiedPrandtlIshlinskii) -> tuple[tuple[str, ...], _Numbers]:
    line = m.line()
    return _plays(m.play_terms(), line.knots, line.slopes, line.offsets())


def _slip(m: GeneralisedMaxwellSlip) -> tuple[tuple[str, ...], _Numbers]:
    gain, thresholds, knots, slopes, offsets = m.play_terms()
    return ("maxwell_slip",), {
        "gain": (gain, "slope of all elements together [V/m]"),
        "thresholds": (thresholds, "displacement from which each element slides [m]"),
        "knots": (knots, "where the bent spring changes its slope [m]"),
        "slopes": (slopes, "slopes of the bent spring, and of the elements, negative [V/m]"),
        "offsets": (offsets, "their values at zero, continued from each interval [V]"),
    }


_WRITERS: dict[type[HysteresisModel], Callable[[Any], tuple[tuple[str, ...], _Numbers]]] = {
    BoucWen: _bouc_wen,
    AsymmetricBoucWen: _asymmetric,
    GeneralisedBoucWen: _generalised,
    Dahl: _dahl,
    Duhem: _duhem,
    PrandtlIshlinskii: _sum,
    ModifiedPrandtlIshlinskii: _modified,
    Preisach: _sum,
    GeneralisedMaxwellSlip: _slip,
}
