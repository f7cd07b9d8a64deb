"""Array files of PI's controllers (GCS): a heading of keys, then columns."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage.base.errors import RecordError
from flexstage.records.columns import FileColumns, labelled
from flexstage.records.text_rows import text_lines

_KEY = re.compile(r"#\s*(?:REM\s+)?([A-Z_]+[0-9]*)\s*=\s*(.*)")
_KEYS = re.compile(r"^#\s*(SEPARATOR|DIM|NDATA|SAMPLE_TIME|END_HEADER)\b", re.MULTILINE)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf)", re.IGNORECASE)
_SEPARATORS = {32: None, 9: "\t", 44: ",", 59: ";"}


def is_gcs_array(head: str) -> bool:
    r"""Return whether a text begins like an array file of a GCS controller.

    Examples
    --------
    >>> is_gcs_array("# SEPARATOR = 32\n# DIM = 2\n"), is_gcs_array("# DIM = 2\n1 2")
    (True, False)
    """
    return head.lstrip().startswith("#") and len(set(_KEYS.findall(head[:8192]))) > 1


def read_gcs_array(path: Path) -> FileColumns:
    r"""Read the columns of an array file of a GCS controller.

    Columns go by their ``NAME``, ``SAMPLE_TIME`` gives the sample rate. Units are not part of the
    format.

    Examples
    --------
    >>> import tempfile
    >>> head = "# SEPARATOR = 32\n# DIM = 1\n# SAMPLE_TIME = 0.002\n# NDATA = 2\n# END_HEADER\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "trace.gcs"
    ...     _ = file.write_text(head + "0.25\n0.75\n")
    ...     read_gcs_array(file).sample_rate_hz
    500.0
    """
    lines = text_lines(path)
    keys, first = _heading(lines)
    width, count = _positive_integer(keys, "DIM"), _positive_integer(keys, "NDATA")
    if width is None:
        raise RecordError("the heading has no '# DIM = ...', the number of columns: add it")
    values = _rows(lines, first, width, _separator(keys))
    if count is not None and len(values) != count:
        raise RecordError(
            f"there are {len(values)} rows of numbers, but the heading has NDATA = {count}: the "
            "file is truncated or joined from several; record it again"
        )
    names = [keys.get(f"NAME{j}") or f"column {j}" for j in range(width)]
    interval = _sample_time(keys)
    return FileColumns(
        columns=tuple(
            labelled(name, np.ascontiguousarray(values[:, j])) for j, name in enumerate(names)
        ),
        sample_rate_hz=None if interval is None else 1.0 / interval,
        rate_source="'SAMPLE_TIME'",
        notes=() if count is not None else ("the heading has no number of rows",),
        attributes={key: value for key, value in keys.items() if not key.startswith("NAME")},
    )


def _heading(lines: Sequence[str]) -> tuple[dict[str, str], int]:
    """Return the keys of the heading, and the number of the first line below it."""
    keys: dict[str, str] = {}
    for number, line in enumerate(lines):
        text = line.strip()
        if text and not text.startswith("#"):
            break
        if re.fullmatch(r"#\s*END_HEADER", text):
            return keys, number + 1
        entry = _KEY.fullmatch(text)
        if entry is not None:
            key, value = entry.groups()
            if keys.get(key, value) != value:
                raise RecordError(
                    f"line {number + 1} has {key} = {value}, but a line above {key} = {keys[key]}: "
                    "the file joins several records; split it"
                )
            keys[key] = value
    raise RecordError(
        "the heading has no '# END_HEADER': the file is truncated or is not an array file of a GCS "
        "controller; use the format text for other files"
    )


def _positive_integer(keys: Mapping[str, str], key: str) -> int | None:
    text = keys.get(key)
    if text is None:
        return None
    number = int(text) if re.fullmatch(r"\d{1,12}", text) else 0
    _require(number > 0, key, "a whole number from 1", text)
    return number


def _require(sound: bool, key: str, required: str, text: str) -> None:
    if not sound:
        raise RecordError(f"{key} in the heading must be {required}, got '{text[:30]}'")


def _separator(keys: Mapping[str, str]) -> str | None:
    """Return the delimiter of the columns; None is any white space."""
    text = keys.get("SEPARATOR", "32")
    code = int(text) if re.fullmatch(r"\d{1,3}", text) else -1
    required = "the code of space (32), tab (9), comma (44) or semicolon (59)"
    _require(code in _SEPARATORS, "SEPARATOR", required, text)
    return _SEPARATORS[code]


def _sample_time(keys: Mapping[str, str]) -> float | None:
    text = keys.get("SAMPLE_TIME")
    if text is None:
        return None
    interval = float(text) if _NUMBER.fullmatch(text) else 0.0
    sound = bool(np.isfinite(interval)) and interval > 0.0
    _require(sound, "SAMPLE_TIME", "a positive number of seconds", text)
    return interval


def _is_plain(line: str) -> bool:
    return line.isascii() and "_" not in line


def _rows(
    lines: Sequence[str], first: int, width: int, separator: str | None
) -> NDArray[np.float64]:
    rows = []
    for number, line in enumerate(lines[first:], start=first + 1):
        fields = line.split(separator)
        while fields and not fields[-1].strip():
            fields.pop()
        if not fields:
            continue
        if len(fields) != width:
            raise RecordError(
                f"line {number} has {len(fields)} columns, but the heading has DIM = {width}: the "
                "file is truncated or damaged; record it again"
            )
        try:
            # "1_000" and digits of other scripts are numbers for Python
            rows.append([float(field) for field in fields] if _is_plain(line) else [])
        except ValueError:
            rows.append([])
        if not rows[-1]:
            bad = next((f.strip() for f in fields if not _NUMBER.fullmatch(f.strip())), line)
            raise RecordError(
                f"line {number}: '{bad[:30]}' is not a number: correct the line, or record it again"
            )
    if not rows:
        raise RecordError("there are no numeric rows below the heading: record it again")
    return np.array(rows, dtype=np.float64)
