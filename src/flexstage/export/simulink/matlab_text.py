"""Names, strings, comments and numbers of MATLAB in any release and locale, and .mat files."""

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

# Longest name in MATLAB: it silently truncates longer ones.
_LONGEST = 63
#: Keywords of MATLAB.
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
# Names with a meaning in MATLAB expressions.
_RESERVED = frozenset(("ans", "diag", "eps", "i", "inf", "j", "max", "min", "nan", "pi", "zeros"))


def plain(text: str) -> str:
    """Return a text on one line in ASCII, since MATLAB reads scripts in the local encoding."""
    text = re.sub("[⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻]+", lambda m: "^" + m[0].translate(_RAISED), text)
    for letter, instead in _WORDS.items():
        text = text.replace(letter, instead)
    # decomposition separates letters and accents
    decomposed = unicodedata.normalize("NFKD", text)
    letters = "".join(c for c in decomposed if not unicodedata.combining(c))
    ascii_text = letters.encode("ascii", "replace").decode("ascii")
    return " ".join("".join(c if c.isprintable() else " " for c in ascii_text).split())


def quoted(text: str) -> str:
    """Return a text as a MATLAB string in single quotes.

    Examples
    --------
    >>> print(quoted("the stage's stiffness, 12 N/µm"))
    'the stage''s stiffness, 12 N/um'
    """
    return "'" + plain(text).replace("'", "''") + "'"


def comment(text: str) -> str:
    """Return a text as comment lines."""
    lines = wrapped(plain(text), 90) or [""]
    return "".join(f"% {line}".rstrip() + "\n" for line in lines)


def wrapped(text: str, width: int) -> list[str]:
    """Break a text between words; a word longer than a line is alone on its line."""
    return textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)


def identifier(text: str, *, longest: int = _LONGEST) -> str:
    """Return a valid MATLAB name from a text, which is not a keyword.

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
    """Return MATLAB names by text, unique regardless of case, in the order of the texts."""
    names: dict[str, str] = {}
    used: set[str] = set()
    for text in texts:
        name = identifier(text, longest=longest)
        number = 1
        while name.lower() in used:
            number += 1
            tail = f"_{number}"
            name = identifier(text, longest=longest - len(tail)) + tail
        used.add(name.lower())
        names[text] = name
    return names


def valid_name(name: str, what: str, *, longest: int = _LONGEST) -> str:
    """Return a name after checking that it is valid in MATLAB."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name, re.ASCII) or name in KEYWORDS:
        raise ModelError(
            f"the {what} must begin with a letter, have only letters, digits and underscores, and "
            f"not be a keyword of MATLAB, got '{name}': use '{identifier(name, longest=longest)}'"
        )
    if len(name) > longest:
        raise ModelError(
            f"the {what} must have at most {longest} characters, since it is part of names of "
            f"files, got {len(name)}: use '{name[:longest]}'"
        )
    return name


def literal(values: ArrayLike) -> str:
    """Return a number or matrix as MATLAB text, which is read back to the same bits.

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
    """Matrices and their meanings by MATLAB names."""

    __slots__ = ("meanings", "values")

    def __init__(self) -> None:
        self.values: dict[str, Array] = {}
        self.meanings: dict[str, str] = {}

    def add(self, base: str, value: ArrayLike, meaning: str) -> str:
        """Add a number or a matrix and return its name, with a number if the name is taken."""
        # leaves space for a number, and for names of files with this name
        used = {*_RESERVED, *(existing.lower() for existing in self.values)}
        name = free_name(identifier(base, longest=58), lambda n: n.lower() in used)
        self.values[name] = np.atleast_2d(np.asarray(value, dtype=np.float64))
        self.meanings[name] = meaning
        return name


def mat_file(variables: Mapping[str, Any]) -> bytes:
    """Return a .mat file, level 5; a dict becomes a struct. Equal variables give equal bytes."""
    from scipy.io import savemat

    stream = io.BytesIO()
    savemat(stream, dict(variables), long_field_names=True, oned_as="column")
    # without a date, which would make every file different
    text = f"MATLAB 5.0 MAT-file, written by flexstage {__version__}"
    return text.ljust(_HEADER).encode("ascii")[:_HEADER] + stream.getvalue()[_HEADER:]


def cell(texts: tuple[str, ...]) -> Any:
    """Return texts as a column of cells of a .mat file."""
    column = np.empty((len(texts), 1), dtype=object)
    column[:, 0] = texts
    return column
