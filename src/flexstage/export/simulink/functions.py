"""Functions of MATLAB that a Simulink model holds, one for each hysteresis."""

from collections.abc import Mapping
from typing import Any

from flexstage import __version__
from flexstage.export.simulink.matlab_text import comment, identifier, literal, valid_name
from flexstage.hysteresis import HysteresisModel
from flexstage.hysteresis.models.registry import matlab_code
from flexstage.hysteresis.models.source_code import source_file


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
            "Each call moves u on a straight line from its last value, for which y is exact; the "
            f"memory begins at rest, and 'clear {name}' brings it back there."
        )
        + comment(f"Written by flexstage {__version__}.")
        + "%#codegen\n"
        + "".join(source_file(f"{part}.m").decode("ascii") for part in code.parts)
        + _parameters(code.parameters)
    )


def _parameters(numbers: Mapping[str, tuple[Any, str]]) -> str:
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
