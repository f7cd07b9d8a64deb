r"""Arrays as a controller sends them: a heading of keys, then rows of numbers."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import ControllerError
from flexstage.instruments.gcs.replies import excerpt, number

_KEY = re.compile(r"#\s*([A-Z_]+[0-9]*)\s*=\s*(.*)")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GcsArray:
    """Columns of numbers."""

    columns: NDArray[np.float64]
    """The numbers, shape (columns, rows)."""
    sample_time: float | None = None
    """Time from row to row [s]; None where the heading does not say."""


def parse_array(lines: Sequence[str], width: int, rows: int, what: str) -> GcsArray:
    """Read an array.

    Examples
    --------
    >>> text = "# DIM = 2|# SAMPLE_TIME = 0.002|# NDATA = 1|# END_HEADER|0.5 -1.25"
    >>> array = parse_array(text.split("|"), 2, 1, "DRR?")
    >>> array.columns.tolist(), array.sample_time
    ([[0.5], [-1.25]], 0.002)
    """
    keys: dict[str, str] = {}
    body = 0
    while body < len(lines) and lines[body].startswith("#"):
        found = _KEY.match(lines[body].strip())
        if found:
            keys[found[1]] = found[2].strip()
        body += 1
    interval = number(keys["SAMPLE_TIME"], what) if "SAMPLE_TIME" in keys else None
    values = _numbers(lines[body:], keys.get("SEPARATOR", "32"), what)
    if values.shape != (rows, width):
        raise ControllerError(
            f"'{what}' asked for {rows} rows of {width} columns, and {values.shape[0]} rows of "
            f"{values.shape[1]} came: the answer was cut, or is that to something else"
        )
    return GcsArray(columns=np.ascontiguousarray(values.T), sample_time=interval)


def _numbers(lines: Sequence[str], separator: str, what: str) -> NDArray[np.float64]:
    divided = {"32": None, "9": "\t", "44": ",", "59": ";"}
    if separator not in divided:
        raise ControllerError(
            f"the columns of the answer to '{what}' are divided by character {excerpt(separator)}, "
            "and space, tab, comma or semicolon is known"
        )
    words = [line.split(divided[separator]) for line in lines]
    if len({len(row) for row in words}) > 1:
        raise ControllerError(
            f"the rows of the answer to '{what}' differ in length: the answer was cut"
        )
    try:
        # "1_000" and digits of other scripts are numbers to Python
        plain = not any("_" in line or not line.isascii() for line in lines)
        rows = [[float(word) if plain else number(word, what) for word in row] for row in words]
    except ValueError:
        rows = [[number(word, what) for word in row] for row in words]
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(rows[0]) if rows else 0)
