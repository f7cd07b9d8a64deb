"""Numbers as C: names, comments, and as many digits as bring back the same bits."""

import math
import textwrap
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

_WIDTH = 98


def c_number(value: float) -> str:
    """Return a number as C, with the digits that bring back the same bits.

    Examples
    --------
    >>> c_number(0.1), c_number(-3.0), c_number(float("inf"))
    ('0.1', '-3.0', 'INFINITY')
    """
    number = float(value)
    if math.isnan(number):
        raise ValueError("a model of NaN cannot be written as C")
    if math.isinf(number):
        return "INFINITY" if number > 0.0 else "-INFINITY"
    return repr(number)


def c_comment(text: str) -> str:
    """Return text that may stand in a comment of C.

    Examples
    --------
    >>> c_comment("10 µm */ x")
    '10 um * / x'
    """
    plain = text.replace("µ", "u").replace("μ", "u").replace("*/", "* /").replace("/*", "/ *")
    plain = plain.replace("\\", "/").replace("\n", " ")
    return plain.encode("ascii", "replace").decode()


def c_array(
    name: str, dimensions: Sequence[str], values: ArrayLike, comment: str, kind: str = "fs_real"
) -> str:
    """Return the definition of a constant array of numbers of a kind, with its sizes in C."""
    sizes = "".join(f"[{d}]" for d in dimensions)
    body = _braces(np.asarray(values, dtype=np.float64), "    ")
    return f"{_wrapped(comment)}\nstatic const {kind} {name}{sizes} = {body};\n"


def c_flags(name: str, dimension: str, values: Sequence[int | str], comment: str) -> str:
    """Return the definition of a constant array of `int`: numbers, or their names."""
    listed = ", ".join(str(v) for v in values)
    return f"{_wrapped(comment)}\nstatic const int {name}[{dimension}] = {{{listed}}};\n"


def _wrapped(comment: str) -> str:
    lines = textwrap.wrap(c_comment(comment), _WIDTH - 6)
    return "/* " + "\n * ".join(lines) + " */"


def _braces(values: np.ndarray, indent: str) -> str:
    if values.ndim > 1:
        inner = f",\n{indent}".join(_braces(v, indent + "    ") for v in values)
        return "{\n" + indent + inner + "}"
    lines, line = [], ""
    for text in (c_number(v) for v in values.tolist()):
        if line and len(indent) + len(line) + len(text) + 2 > _WIDTH:
            lines.append(line)
            line = ""
        line += (" " if line else "") + text + ","
    lines.append(line.rstrip(","))
    return "{" + f"\n{indent} ".join(lines) + "}"
