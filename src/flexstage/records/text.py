"""Text files of numbers in columns: CSV, tabs, spaces, LabVIEW; array files of PI (GCS)."""

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.records.columns import FileColumn, FileColumns, complex_parts, labelled
from flexstage.records.read_options import TextLayout
from flexstage.records.record import SIMULATED
from flexstage.records.text_rows import (
    COMMENT_MARKS,
    COMPLEX,
    END_OF_HEADER,
    NUMBER,
    STAMP,
    X_VALUE,
    Heading,
    RowLayout,
    day,
    first_row,
    heading_of,
    is_comment,
    is_missing,
    row_of,
    text_lines,
)

_OPEN_DATES = (
    "; dates such as {} may begin with the month or the day, and none of them is unambiguous: "
    "write them as 2026-05-31"
)
#: Largest number of stored letters of a text.
_LETTERS = 30
# keys, numbers and separators of an array file of a GCS controller
_KEY = re.compile(r"#\s*(?:REM\s+)?([A-Z_]+[0-9]*)\s*=\s*(.*)")
_KEYS = re.compile(r"^#\s*(SEPARATOR|DIM|NDATA|SAMPLE_TIME|END_HEADER)\b", re.MULTILINE)
_GCS_NUMBER = re.compile(
    r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf)", re.IGNORECASE
)
_PLAIN_SECONDS = re.compile(r"\d\d(?:[.,]\d{1,9})?", re.ASCII)
# a line of white space alone
_BLANK_ROW = re.compile(r"^[^\S\n]+$", re.MULTILINE)
_SEPARATORS = {32: None, 9: "\t", 44: ",", 59: ";"}


@dataclass(slots=True, eq=False)
class _Table:
    """Rows of a file, and the text next to its numbers."""

    values: Array
    lines: list[int] = field(default_factory=list)
    words: dict[tuple[int, int], str] = field(default_factory=dict)
    remarks: list[tuple[int, str]] = field(default_factory=list)


def read_text(path: Path, how: TextLayout) -> FileColumns:
    """Read the columns of a text file.

    Delimiter and decimal sign are recognised if not given. An empty field is not a number (NaN),
    nor is text, which is stored separately.
    """
    delimiters = _delimiters(how.delimiter)
    lines = text_lines(path)
    if lines[-1].strip() == "END":  # a network analyser writes between BEGIN and END
        lines.pop()
    row = first_row(lines, how.skip, delimiters, how.decimal)
    if row is None:
        raise RecordError(f"'{path}' contains no numeric rows: is it the right file?")
    first, layout = row
    heading = heading_of(lines[how.skip : first], layout.width, layout.delimiter)
    if layout.trailing and not heading.names:
        # the last column has a name but no values
        wider = heading_of(lines[how.skip : first], layout.width + 1, layout.delimiter)
        heading = replace(wider, names=wider.names[:-1], units=wider.units[:-1])
    one_name = len(heading.names) != 2 and lines[first - 1].strip().count(",") == 0
    if layout.delimiter == "," and layout.width == 2 and how.delimiter is how.decimal is None:
        layout, heading = _one_or_two(lines, first, layout, heading, one_name and first > how.skip)
    return _columns(_without_last(_numbers(lines, first, layout)), heading, layout)


def _delimiters(requested: str | None) -> tuple[str | None, ...]:
    """Return the possible delimiters of columns; None is any white space."""
    if requested is None:
        return ("\t", ";", ",", None)
    if len(requested) != 1 or requested.isalnum() or requested in '+-."\n\r':
        raise RecordError(
            "the delimiter must be one character, or tab, comma, semicolon or space, got "
            f"{requested!r}"
        )
    return (None if requested == " " else requested,)


def _one_or_two(
    lines: list[str], first: int, layout: RowLayout, heading: Heading, one_name: bool
) -> tuple[RowLayout, Heading]:
    """Distinguish one column of decimal commas from two columns of integers, by the heading."""
    sample = [line for line in lines[first : first + 200] if line.strip()]
    if one_name and all(re.fullmatch(r"\s*[+-]?\d+,\d+\s*", line) for line in sample):
        single = RowLayout(delimiter=None, comma=True, width=1, trailing=False)
        return single, heading_of(lines[:first], 1, None)
    return layout, heading


def _numbers(lines: list[str], first: int, layout: RowLayout) -> _Table:
    """Read the rows, one by one if the fast reader refuses them."""
    body = lines[first:]
    if layout.trailing:
        mark = layout.delimiter or ""
        body = [line.rstrip().removesuffix(mark.strip() or mark) for line in body]
    remark = ""
    labview = any(line.startswith(END_OF_HEADER) for line in lines[:first])
    if labview and layout.delimiter == "\t" and not layout.words:
        # LabVIEW writes a comment behind the numbers of the first row
        fields, mark = row_of(lines[first], "\t")
        fields, excess = _fitted(fields, first + 1, layout)
        body[0], remark = "\t".join(fields), mark or excess
    block = "\n".join(body)
    # the decimal sign, even if only some numbers have decimals
    comma = layout.delimiter != "," and "," in block
    marks = ('"', *(m for m in COMMENT_MARKS if m != layout.delimiter))
    plain = not (layout.words and any(m in block for m in marks))
    if plain and not (comma and "." in block):
        table = _text_columns(lines, first, layout) if layout.words else _Table(np.zeros(0))
        used = [j for j in range(layout.width) if j not in (*layout.words, *layout.stamps)]
        stamps = _plain_stamps(body, layout)
        if table is not None and stamps is not None:
            try:
                with io.StringIO(_filled(block.replace(",", ".") if comma else block, layout)) as f:
                    values = np.loadtxt(
                        f,
                        delimiter=layout.delimiter,
                        comments=None,
                        ndmin=2,
                        dtype=np.float64,
                        usecols=used if len(used) < layout.width else None,
                    )
                # of a column alone, an empty field may look like no row
                rows = sum(bool(line.strip()) for line in lines[first:])
                if values.shape == (rows, len(used)):
                    table.values = np.full((values.shape[0], layout.width), np.nan)
                    table.values[:, used] = values
                    if remark:
                        table.remarks.append((first + 1, remark))
                    if layout.stamps:
                        table.values[:, list(layout.stamps)] = stamps
                    return table
            except ValueError:
                pass
    return _numbers_slowly(lines, first, layout)


def _filled(block: str, layout: RowLayout) -> str:
    """Return rows without quotes around numbers, and with NaN in empty fields.

    A quote elsewhere than around a whole field is a ValueError.
    """
    mark = layout.delimiter
    if mark is None:
        return block.replace('"', "")
    block = f"\n{block}\n"
    if '"' in block:
        edge = f"[{re.escape(mark)}\n]"
        block = re.sub(rf'(?<={edge})"([^"{re.escape(mark)}\n]*)"(?={edge})', r"\1", block)
        if '"' in block:
            raise ValueError("quotes within a field, or a delimiter within quotes")
    # what is a row of nothing, and no row, depends on the delimiter
    if _BLANK_ROW.search(block):
        return block
    for place in (f"{mark}{mark}", f"{mark}{mark}", f"\n{mark}", f"{mark}\n"):
        block = block.replace(place, f"{place[0]}nan{place[1]}")
    return block


def _plain_stamps(body: list[str], layout: RowLayout) -> Array | None:
    """Return the stamps of rows, shape (n, k); None if a row has no plain one in each column."""
    # the minute of many rows is parsed once
    minutes: dict[str, float | None] = {}
    stamps: list[float] = []
    for line in body if layout.stamps else ():
        if not line.strip():
            continue
        fields = line.split(layout.delimiter)
        if len(fields) != layout.width:
            return None
        for j in layout.stamps:
            minute, _, seconds = fields[j].strip(' "').rpartition(":")
            if minute not in minutes:
                minutes[minute] = _seconds(f"{minute}:00", layout)
            begin = minutes[minute]
            if begin is None or not _PLAIN_SECONDS.fullmatch(seconds):
                return None
            stamps.append(begin + float(seconds.replace(",", ".")))
    return np.array(stamps).reshape(-1, max(len(layout.stamps), 1))


def _without_last(table: _Table) -> _Table:
    """Remove rows of empty fields at the end, as oscilloscopes write them."""
    numeric = np.flatnonzero(np.isfinite(table.values).any(axis=1))
    last_number = int(numeric[-1]) if numeric.size else -1
    last = max(last_number, max((row for row, _ in table.words), default=-1))
    table.values = table.values[: last + 1]
    table.lines = table.lines[: last + 1]
    return table


def _text_columns(lines: list[str], first: int, layout: RowLayout) -> _Table | None:
    """Return the text of plain rows without their numbers; None if a row differs."""
    table = _Table(np.zeros(0))
    for number, line in enumerate(lines[first:], start=first + 1):
        if not line.strip():
            continue
        fields = line.split(layout.delimiter)
        short = layout.width - len(fields)
        if short > 0 and layout.words.issuperset(range(len(fields), layout.width)):
            fields += [""] * short
        elif short != -layout.trailing:
            return None
        for j in layout.words:
            text = fields[j].strip()
            if not is_missing(text):
                table.words[len(table.lines), j] = _stored_text(text)
        table.lines.append(number)
    return table


def _numbers_slowly(lines: list[str], first: int, layout: RowLayout) -> _Table:
    rows: list[list[float]] = []
    table = _Table(np.zeros(0))
    signs: dict[str, int] = {}
    for number, line in enumerate(lines[first:], start=first + 1):
        if not line.strip() or is_comment(line, layout.delimiter):
            continue
        fields, remark = row_of(line, layout.delimiter)
        fields, excess = _fitted(fields, number, layout)
        if remark or excess:
            table.remarks.append((number, remark or excess))
        row = []
        for j, text in enumerate(fields):
            value = _value(text, j, layout)
            if value is None:
                table.words[len(rows), j] = _stored_text(text)
            elif j not in layout.stamps:
                signs |= {sign: number for sign in ".," if sign in text and sign not in signs}
            row.append(np.nan if value is None else value)
        if len(signs) > 1:
            raise RecordError(
                f"line {number} has a decimal comma where others have a point, or a thousands "
                "separator: write the numbers with one decimal sign"
            )
        rows.append(row)
        table.lines.append(number)
    table.values = np.array(rows, dtype=np.float64).reshape(len(rows), layout.width)
    return table


def _fitted(fields: list[str], number: int, layout: RowLayout) -> tuple[list[str], str]:
    """Return a field for each column, and the text after the last."""
    count, width = len(fields), layout.width
    excess = fields[width:]
    if any(NUMBER.fullmatch(f) for f in excess) or not layout.words.issuperset(range(count, width)):
        raise RecordError(
            f"line {number} has {count} columns where the first row has {width}: correct the line, "
            "or skip lines above it by --text skip=N"
        )
    return fields[:width] + [""] * (width - count), " ".join(excess).strip()


def _value(text: str, column: int, layout: RowLayout) -> float | None:
    """Return the number in a field, NaN if it is missing; None for a text."""
    if is_missing(text):
        return np.nan
    if column in layout.stamps:
        return _seconds(text, layout)
    return float(text.replace(",", ".")) if NUMBER.fullmatch(text) else None


def _stored_text(text: str) -> str:
    return text if COMPLEX.fullmatch(text) else text[:_LETTERS]


def _seconds(text: str, layout: RowLayout) -> float | None:
    """Return a date or a time of day, in seconds from the beginning of the first day.

    Counted from that day, and not from 1970, a float resolves nanoseconds.
    """
    date, stamp = day(text, layout.month_first), STAMP.fullmatch(text)
    if stamp is None or date < 0:
        return None
    hours = int(stamp["h"])
    if stamp["half"]:
        hours = hours % 12 + 12 * (stamp["half"] == "P")
    seconds = float(stamp["s"].replace(",", "."))
    return 86400.0 * (date - layout.first_day) + 3600.0 * hours + 60.0 * int(stamp["min"]) + seconds


def _columns(table: _Table, heading: Heading, layout: RowLayout) -> FileColumns:
    names: Sequence[str] = _x_named(heading.names, table.values) or [""] * layout.width
    units: Sequence[str] = heading.units or [""] * layout.width
    notes = _remarks(table)
    columns: list[FileColumn] = []
    for j in range(layout.width):
        numbers = np.ascontiguousarray(table.values[:, j])
        if heading.empty_first and j == 0 and np.isnan(numbers).all():
            continue
        column = labelled(names[j] or f"column {j}", numbers, units[j])
        if j in layout.stamps:
            origin = numbers[np.isfinite(numbers).argmax()]
            column = FileColumn(name=column.name, values=numbers - origin, unit="s")
            notes.append(f"dates of '{column.name}' are read as seconds after the first")
        words = {row: text for (row, at), text in table.words.items() if at == j}
        if words and all(map(COMPLEX.fullmatch, words.values())):
            imaginary = np.where(np.isfinite(numbers), 0.0, np.nan)
            for row, text in words.items():
                value = complex(re.sub(r"\s", "", text.lower()).replace(",", ".").replace("i", "j"))
                numbers[row], imaginary[row] = value.real, value.imag
            columns += complex_parts(column, imaginary)
            continue
        if words:
            texts = np.zeros(numbers.size, dtype=f"<U{max(map(len, words.values()))}")
            texts[list(words)] = list(words.values())
            column = replace(column, words=texts)
        columns.append(column)
    dates = (f"'{text}'" for text in table.words.values() if "/" in text and STAMP.fullmatch(text))
    example = next(dates, "")
    return FileColumns(
        columns=tuple(columns),
        hint=example and _OPEN_DATES.format(example),
        sample_rate_hz=None if heading.interval is None else 1.0 / heading.interval,
        start=heading.start,
        rate_source=heading.interval_source,
        notes=tuple(notes),
        attributes=_attributes(heading.text),
        lines=np.array(table.lines) if table.words else None,
    )


def _attributes(heading: str) -> dict[str, str]:
    """Return the heading of a file, and what simulated it."""
    simulated = re.search(rf"^# {SIMULATED}: (.*)$", heading, re.MULTILINE)
    marks = {} if simulated is None else {SIMULATED: simulated[1].strip()}
    return ({"heading": heading} if heading else {}) | marks


def _x_named(names: Sequence[str], values: Array) -> Sequence[str]:
    """Return names of columns for which LabVIEW wrote times before each channel.

    The times of the first channel are used for all with equal times.
    """
    xs = [j for j, name in enumerate(names) if name == X_VALUE]
    if len(xs) < 2:
        return names
    # a channel that ends before others has no times there
    apart = np.abs(values[:, xs] - values[:, xs[:1]])
    same = bool(np.all((apart == 0.0) | np.isnan(apart))) and np.isfinite(values[:, xs[0]]).all()
    return [
        f"{X_VALUE} of {names[j + 1]}" if j in xs[int(same) :] and j + 1 < len(names) else name
        for j, name in enumerate(names)
    ]


def _remarks(table: _Table) -> list[str]:
    if not table.remarks:
        return []
    number, text = table.remarks[0]
    return [
        f"skipped text after the numbers of {len(table.remarks)} rows, such as "
        f"'{text[:_LETTERS]}' in line {number}"
    ]


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
    keys, first = _gcs_heading(lines)
    width, count = _positive_integer(keys, "DIM"), _positive_integer(keys, "NDATA")
    if width is None:
        raise RecordError("the heading has no '# DIM = ...', the number of columns: add it")
    values = _gcs_rows(lines, first, width, _separator(keys))
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


def _gcs_heading(lines: Sequence[str]) -> tuple[dict[str, str], int]:
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
    _require_key(number > 0, key, "a whole number from 1", text)
    return number


def _require_key(sound: bool, key: str, required: str, text: str) -> None:
    if not sound:
        raise RecordError(f"{key} in the heading must be {required}, got '{text[:30]}'")


def _separator(keys: Mapping[str, str]) -> str | None:
    """Return the delimiter of the columns; None is any white space."""
    text = keys.get("SEPARATOR", "32")
    code = int(text) if re.fullmatch(r"\d{1,3}", text) else -1
    required = "the code of space (32), tab (9), comma (44) or semicolon (59)"
    _require_key(code in _SEPARATORS, "SEPARATOR", required, text)
    return _SEPARATORS[code]


def _sample_time(keys: Mapping[str, str]) -> float | None:
    text = keys.get("SAMPLE_TIME")
    if text is None:
        return None
    interval = float(text) if _GCS_NUMBER.fullmatch(text) else 0.0
    sound = bool(np.isfinite(interval)) and interval > 0.0
    _require_key(sound, "SAMPLE_TIME", "a positive number of seconds", text)
    return interval


def _is_plain(line: str) -> bool:
    return line.isascii() and "_" not in line


def _gcs_rows(lines: Sequence[str], first: int, width: int, separator: str | None) -> Array:
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
            bad = next((f.strip() for f in fields if not _GCS_NUMBER.fullmatch(f.strip())), line)
            raise RecordError(
                f"line {number}: '{bad[:30]}' is not a number: correct the line, or record it again"
            )
    if not rows:
        raise RecordError("there are no numeric rows below the heading: record it again")
    return np.array(rows, dtype=np.float64)
