"""Names, strings, comments and numbers as MATLAB reads them; variables as a .mat file.

In every release and locale.
"""

import io
import re
import textwrap
import unicodedata
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.files.names import free_name
from flexstage.hysteresis.model import Array

# What MATLAB takes as a name: longer ones are cut without a word.
_LONGEST = 63
#: Words of the language MATLAB, which nothing can be called.
KEYWORDS = frozenset(
    ["break", "case", "catch", "classdef", "continue", "else", "elseif", "end", "for", "function",
     "global", "if", "otherwise", "parfor", "persistent", "return", "spmd", "switch", "try",
     "while"]
)  # fmt: skip
_WORDS = {
    "µ": "u", "·": "*", "×": "x", "−": "-", "–": "-", "—": "-", "°": " deg", "’": "'", "‘": "'",
    "“": '"', "”": '"', "ß": "ss", "ø": "o", "ᵀ": "^T", "≤": "<=", "≥": ">=", "≈": "~", "√": "sqrt",
    "Δ": "Delta", "Σ": "Sum", "Ω": "Ohm", "α": "alpha", "β": "beta", "γ": "gamma", "δ": "delta",
    "ζ": "zeta", "η": "eta", "λ": "lambda", "μ": "u", "π": "pi", "ρ": "rho", "σ": "sigma",
    "τ": "tau", "φ": "phi", "ψ": "psi", "ω": "omega",
}  # fmt: skip
_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻", "0123456789+-")
_HEADER = 116  # bytes of text at the start of a .mat file, level 5
# Names that stand for something in expressions of MATLAB.
_TAKEN = frozenset(("ans", "diag", "eps", "i", "inf", "j", "max", "min", "nan", "pi", "zeros"))


def plain(text: str) -> str:
    """Return a text on one line in ASCII: scripts are read in the character set of the machine."""
    text = re.sub("[⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻]+", lambda m: "^" + m[0].translate(_RAISED), text)
    for letter, instead in _WORDS.items():
        text = text.replace(letter, instead)
    # accents stand behind their letter once it is taken apart
    apart = unicodedata.normalize("NFKD", text)
    kept = "".join(c for c in apart if not unicodedata.combining(c))
    bare = kept.encode("ascii", "replace").decode("ascii")
    return " ".join("".join(c if c.isprintable() else " " for c in bare).split())


def quoted(text: str) -> str:
    """Return a text as a string of MATLAB, in single quotes.

    Examples
    --------
    >>> print(quoted("the stage's stiffness, 12 N/µm"))
    'the stage''s stiffness, 12 N/um'
    """
    return "'" + plain(text).replace("'", "''") + "'"


def comment(text: str) -> str:
    """Return a text as lines of comment, the last one ended."""
    lines = wrapped(plain(text), 90) or [""]
    return "".join(f"% {line}".rstrip() + "\n" for line in lines)


def wrapped(text: str, width: int) -> list[str]:
    """Break a text between words alone; a word that is longer than a line stands on its own."""
    return textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)


def identifier(text: str, *, longest: int = _LONGEST) -> str:
    """Return a name of MATLAB made of a text, which begins with a letter and is no word of it.

    Examples
    --------
    >>> identifier("vgtu-piezo"), identifier("2nd hinge"), identifier("end")
    ('vgtu_piezo', 'x2nd_hinge', 'end_')
    """
    name = re.sub(r"[^A-Za-z0-9_]+", "_", plain(text)).strip("_") or "x"
    if not name[0].isalpha():
        name = f"x{name}"
    if name in KEYWORDS:
        name += "_"
    return name[:longest]


def identifiers(texts: Iterable[str], *, longest: int = _LONGEST) -> dict[str, str]:
    """Return names of MATLAB by text, no two alike even where case does not count.

    The texts are unlike each other, and keep their order.
    """
    made: dict[str, str] = {}
    taken: set[str] = set()
    for text in texts:
        name = identifier(text, longest=longest)
        number = 1
        while name.lower() in taken:
            number += 1
            tail = f"_{number}"
            name = identifier(text, longest=longest - len(tail)) + tail
        taken.add(name.lower())
        made[text] = name
    return made


def valid_name(name: str, what: str, *, longest: int = _LONGEST) -> str:
    """Return a name after checking that MATLAB takes it."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name, re.ASCII) or name in KEYWORDS:
        raise ModelError(
            f"the {what} must be letters, digits and underscores, beginning with a letter, and no "
            f"word of MATLAB, got '{name}': take '{identifier(name, longest=longest)}'"
        )
    if len(name) > longest:
        raise ModelError(
            f"the {what} must have {longest} characters at most, since names of files are made "
            f"of it, got {len(name)}: take '{name[:longest]}'"
        )
    return name


def literal(values: ArrayLike) -> str:
    """Return a number, or a matrix, as MATLAB writes it; read again it is the same to the last bit.

    Examples
    --------
    >>> literal(0.1), literal([[1.0, -2.5], [float("inf"), 0.0]]), literal([])
    ('0.1', '[1, -2.5; Inf, 0]', 'zeros(1, 0)')
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0:
        return _number(float(array))
    rows = np.atleast_2d(array)
    if rows.size == 0:
        return f"zeros({rows.shape[0]}, {rows.shape[1]})"
    return "[" + "; ".join(", ".join(map(_number, row)) for row in rows.tolist()) + "]"


def _number(value: float) -> str:
    if np.isinf(value):
        return "Inf" if value > 0.0 else "-Inf"
    if np.isnan(value):
        return "NaN"
    text = repr(value)
    return text[:-2] if text.endswith(".0") else text


class Variables:
    """Matrices by names that MATLAB takes, and what they are, by the same names."""

    __slots__ = ("meanings", "values")

    def __init__(self) -> None:
        self.values: dict[str, Array] = {}
        self.meanings: dict[str, str] = {}

    def add(self, wanted: str, value: ArrayLike, meaning: str) -> str:
        """Add a number or a matrix and return its name; a number follows one that is taken."""
        # room for a sign of order behind the name, and for names of files made of it
        taken = {*_TAKEN, *(known.lower() for known in self.values)}
        name = free_name(identifier(wanted, longest=58), lambda n: n.lower() in taken)
        self.values[name] = np.atleast_2d(np.asarray(value, dtype=np.float64))
        self.meanings[name] = meaning
        return name


def mat_file(variables: Mapping[str, Any]) -> bytes:
    """Return a .mat file, level 5; a dict becomes a struct, the same variables the same bytes."""
    from scipy.io import savemat

    made = io.BytesIO()
    savemat(made, dict(variables), long_field_names=True, oned_as="column")
    # a date would make every file another one
    text = f"MATLAB 5.0 MAT-file, written by flexstage {__version__}"
    return text.ljust(_HEADER).encode("ascii")[:_HEADER] + made.getvalue()[_HEADER:]
