"""Text reports of PC-DMIS in English, as columns over repeated measurements."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexstage.base.errors import RecordError
from flexstage.records.columns import FileColumn, FileColumns
from flexstage.records.read_options import TextLayout
from flexstage.records.text_rows import text_lines

_ANGLES = frozenset(("A", "PA"))
# coordinates, diameter, radius, length, height, distance or form (M), angles
_AXES = _ANGLES | {*"XYZDRLHMT", "PR", "PX", "PY", "PZ"}
# rows of tables of position that are no coordinates
_SKIPPED = frozenset(
    ("TP", "DF", "DD", "D1", "D2", "D3", "LD", "LF", "WD", "WF", "DS", "RS", "RT", "S", "V", "MM")
)
_ROLES = {
    **dict.fromkeys(("AX", "AXIS"), "axis"),
    **dict.fromkeys(("NOMINAL", "NOM"), "nominal"),
    **dict.fromkeys(("MEAS", "MEASURED", "ACTUAL", "ACT"), "measured"),
    **dict.fromkeys(("DEV", "DEVIATION"), "deviation"),
}
_TOKEN = re.compile(r"\S+")
_NUMBER = re.compile(r"[+-]?[0-9.,'\u2019]*[0-9][.,]?(?:[eE][+-]?\d+)?")
# the bar that shows the position of a value in its tolerance
_BAR = re.compile(r"[-#<>=*|+.]+")
_AXIS = re.compile(r"[A-Z][A-Z0-9]{0,2}")
_UNIT = re.compile(r"\bUNITS?\s*=\s*([^\W\d]+)", re.IGNORECASE)
_UNITS = {"MM": "mm", "IN": "inch", "INCH": "inch", "INCHES": "inch", "CM": "cm", "DEG": "deg"}
_OF = re.compile(r"\b(?:LOCATION|POSITION)\s+OF\s+(.+)", re.IGNORECASE)
_SHAPES = re.compile(
    "CIRCLE|SPHERE|CYLINDER|PLANE|POINT|LINE|CONE|SLOT|ELLIPSE|SET|CURVE|SURFACE|TORUS|NOTCH|"
    "POLYGON|WIDTH|ROUND|SQUARE|FEATURE",
    re.IGNORECASE,
)
_LONGEST_OPENING = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class _Dimension:
    """The line that opens a dimension."""

    line: int
    name: str
    feature: str
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Heading:
    """The columns of a table: role and right end of each."""

    roles: tuple[str, ...]
    ends: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Row:
    """Values of one axis, as printed, by role."""

    line: int
    feature: str
    axis: str
    unit: str
    values: dict[str, str]


#: Nominal and measured value, with their unit, of each measurement of a feature along an axis.
_Series = dict[tuple[str, str], list[tuple[float, float, str]]]


def has_report(lines: Sequence[str]) -> bool:
    """Return whether a text has a table of PC-DMIS, by its heading.

    Examples
    --------
    >>> has_report(["AX    NOMINAL   +TOL   -TOL   MEAS   DEV   OUTTOL"])
    True
    """
    return any(_heading(line) is not None for line in lines)


def _heading(line: str) -> _Heading | None:
    tokens = list(_TOKEN.finditer(line.expandtabs()))
    roles = [_ROLES.get(token[0].upper(), "") for token in tokens]
    if not roles or roles[0] != "axis" or not {"nominal", "measured"} <= set(roles):
        return None
    return _Heading(roles=tuple(roles[1:]), ends=tuple(token.end() for token in tokens[1:]))


def read_coordinates(
    path: Path, dataset: str | None = None, how: TextLayout = TextLayout()
) -> FileColumns:
    r"""Read the text report of a coordinate measuring machine, by PC-DMIS in English.

    `dataset` names features, separated by commas; the decimal sign is recognised if not given.
    Angles are in degrees; the unit of lengths is that of the report, and the group ``length``
    selects all lengths.

    Each feature and axis has two columns, ``SPH1.X`` and ``SPH1.X nominal``. Row k is the k-th
    measurement of all features, as at successive positions of a stage. Distances and form errors
    have the name of their dimension, ``DIST1.M``.

    Validity
    --------
    Values with the printed digits of the report. Tolerances and rows of true position, which have
    no nominal value, are not read.

    Examples
    --------
    >>> import tempfile
    >>> table = "DIM L1= LOCATION OF SPHERE SPH1  UNITS=MM\nAX NOMINAL MEAS\nX {} {}\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "points.txt"
    ...     _ = file.write_text(table.format(10.0, 10.0025) + table.format(12.5, 12.498))
    ...     columns = read_coordinates(file)
    >>> columns.columns[0].name, columns.columns[0].values, columns.columns[0].unit
    ('SPH1.X', array([10.0025, 12.498 ]), 'mm')
    """
    lines = text_lines(path)
    lines[: how.skip] = [""] * how.skip
    if not has_report(lines):
        raise RecordError(
            "there is no table of PC-DMIS in English, with AX, NOMINAL and MEAS in its heading: "
            "export a table with a column for each coordinate, and omit the option format"
        )
    rows, skipped = _rows(lines)
    if not rows:
        raise RecordError("its tables have no row of an axis: print the report again")
    sign = decimal_sign(((r.line, text) for r in rows for text in r.values.values()), how.decimal)
    series: _Series = {}
    for row in rows:
        series.setdefault((row.feature, row.axis), []).append((*_numbers(row, sign), row.unit))
    series = _selected(series, dataset)
    count = _require_equal(series)
    columns: list[FileColumn] = []
    for (feature, axis), measurements in series.items():
        name, unit = f"{feature}.{axis}", _common_unit(feature, axis, measurements)
        nominal, measured = (np.array([values[k] for values in measurements]) for k in (0, 1))
        columns.append(FileColumn(name=name, values=measured, unit=unit))
        columns.append(FileColumn(name=f"{name} nominal", values=nominal, unit=unit))
    notes = [f"{len(series)} coordinates, each measured {count} times"]
    if skipped:
        notes.append(f"skipped rows that are no coordinates: {', '.join(sorted(skipped))}")
    axes = [axis for _, axis in series for _ in ("measured", "nominal")]
    return FileColumns(
        columns=tuple(columns),
        notes=tuple(notes),
        attributes={"features": ", ".join(dict.fromkeys(feature for feature, _ in series))},
        over="point",
        groups={"length": tuple(i for i, axis in enumerate(axes) if axis not in _ANGLES)},
    )


def _selected(series: _Series, dataset: str | None) -> _Series:
    if dataset is None:
        return series
    selected = [word.strip() for word in dataset.split(",")]
    features = dict.fromkeys(feature for feature, _ in series)
    for word in selected:
        if word not in features:
            raise RecordError(
                f"there is no feature '{word}': the report has {', '.join([*features][:40])}"
            )
    return {key: values for key, values in series.items() if key[0] in selected}


def _require_equal(series: _Series) -> int:
    """Return the number of measurements of each coordinate."""
    (first, usual), *others = ((key, len(values)) for key, values in series.items())
    for key, count in others:
        if count != usual:
            raise RecordError(
                f"{'.'.join(first)} is measured {usual} times and {'.'.join(key)} {count} times: "
                "every feature and axis needs the same number of measurements; select features by "
                "the option dataset"
            )
    if usual < 2:
        raise RecordError(
            "each feature is measured once, but a record needs at least two rows: put the reports "
            "of successive positions into one file, one after the other"
        )
    return usual


def _common_unit(feature: str, axis: str, measurements: list[tuple[float, float, str]]) -> str:
    units = {unit for _, _, unit in measurements}
    if len(units) > 1:
        raise RecordError(
            f"{feature}.{axis} is in {' and in '.join(sorted(u or 'no unit' for u in units))}: "
            "export all of its rows in one unit"
        )
    return "deg" if axis in _ANGLES else units.pop()


def _rows(lines: Sequence[str]) -> tuple[list[_Row], set[str]]:
    rows: list[_Row] = []
    skipped: set[str] = set()
    dimension: _Dimension | None = None
    heading: _Heading | None = None
    for number, line in _joined(lines):
        opened = _dimension(number, line[:_LONGEST_OPENING])
        if opened is not None:
            dimension, heading = opened, None
            continue
        new_heading = _heading(line)
        if new_heading is not None:
            if dimension is None:
                raise RecordError(
                    f"line {number}: a table without a dimension above it: print the report with "
                    "the lines 'DIM ...'"
                )
            heading = new_heading
            continue
        axis = line.split(maxsplit=1)[0].upper() if line.strip() else ""
        if heading is None or dimension is None or not _is_row(line, axis):
            continue
        if axis in _SKIPPED:
            skipped.add(axis)
        elif axis in _AXES:
            rows.append(_row(number, line, axis, dimension, heading))
        else:
            raise RecordError(
                f"line {number}: the axis '{axis[:20]}' is unknown, expected one of "
                f"{', '.join(sorted(_AXES))}: omit the dimension from the report"
            )
    return rows, skipped


def _joined(lines: Sequence[str]) -> list[tuple[int, str]]:
    """Return the lines with their numbers, joined with the next line after ``,$``."""
    joined: list[tuple[int, str]] = []
    open_line: tuple[int, str] | None = None
    for number, raw in enumerate(lines, start=1):
        line = raw.expandtabs().rstrip()
        start, text = (
            (open_line[0], f"{open_line[1]}  {line.strip()}") if open_line else (number, line)
        )
        if text.endswith(",$"):
            open_line = start, text[:-2].rstrip()
            continue
        open_line = None
        joined.append((start, text))
    return joined if open_line is None else [*joined, open_line]


def _is_row(line: str, axis: str) -> bool:
    """Return whether a line below a heading is a row, and not a footer of the page."""
    words = line.split()
    if any("=" in word and not _BAR.fullmatch(word) for word in words):
        return False
    numbers = sum(_NUMBER.fullmatch(word) is not None for word in words[1:])
    return numbers > 2 or (numbers > 0 and _AXIS.fullmatch(axis) is not None)


def _dimension(number: int, line: str) -> _Dimension | None:
    """Return the dimension that a line opens, if any."""
    label = next((f for f in _UNIT.finditer(line) if "=" in line[: f.start()]), None)
    if label is None and re.match(r"\s*DIM\s.*=", line, re.IGNORECASE) is None:
        return None
    name, _, text = line[: label.start() if label else len(line)].partition("=")
    unit = _UNITS.get(label[1].upper(), "") if label else ""
    if label and not unit:
        raise RecordError(
            f"line {number}: the unit '{label[1]}' is unknown, expected MM, IN or DEG"
        )
    name = " ".join(re.sub(r"^\s*DIM\s+", "", name, flags=re.IGNORECASE).split())
    return _Dimension(line=number, name=name, feature=_feature(text), unit=unit)


def _feature(text: str) -> str:
    """Return the feature of a dimension; empty if the text does not show it."""
    english = _OF.search(text)
    if english is not None:
        words = english[1].replace(",", " ").split()
        while len(words) > 1 and _SHAPES.fullmatch(words[0]):
            words.pop(0)
        return words[0]
    words = re.split(r"\s{2,}", text.strip())[0].split()
    return "" if not words or any("=" in word for word in words) else words[-1].split(",")[0]


def _row(number: int, line: str, axis: str, dimension: _Dimension, heading: _Heading) -> _Row:
    tokens = list(_TOKEN.finditer(line))[1:]
    while tokens and _BAR.fullmatch(tokens[-1][0]):
        tokens.pop()
    for token in tokens:
        if not _NUMBER.fullmatch(token[0]):
            raise RecordError(
                f"line {number}: '{token[0][:30]}' in the row of {axis} is not a number: correct "
                "it, or omit the dimension from the report"
            )
    places = list(range(len(tokens)))
    if len(tokens) != len(heading.ends):
        places = _aligned(number, [token.end() for token in tokens], heading)
    values = {
        heading.roles[place]: token[0]
        for place, token in zip(places, tokens, strict=True)
        if heading.roles[place]
    }
    # a row that ends before its deviation may have lost digits of earlier values
    for name in ("nominal", "measured", "deviation"):
        if name in heading.roles and name not in values:
            raise RecordError(
                f"line {number}: the row of {axis} has no {name} value: print the report again, "
                "with nominal and measured values"
            )
    feature = dimension.name if axis == "M" else dimension.feature
    if not feature:
        raise RecordError(
            f"line {dimension.line}: the feature of dimension '{dimension.name}' is unclear: print "
            "the report in English"
        )
    return _Row(line=number, feature=feature, axis=axis, unit=dimension.unit, values=values)


def _aligned(number: int, ends: Sequence[int], heading: _Heading) -> list[int]:
    """Return the columns of numbers in a row with empty fields, by their right ends."""
    places: list[int] = []
    # largest distance between the right ends of a number and its heading
    shift = 4
    for end in ends:
        place = min(range(len(heading.ends)), key=lambda j: abs(heading.ends[j] - end))
        if abs(heading.ends[place] - end) > shift or place in places:
            raise RecordError(
                f"line {number}: its {len(ends)} numbers are not aligned with the "
                f"{len(heading.ends)} headings of the table: print the report again"
            )
        places.append(place)
    return places


def _numbers(row: _Row, sign: str) -> tuple[float, float]:
    """Return the nominal and the measured value of a row."""
    nominal, measured = row.values["nominal"], row.values["measured"]
    where = f"line {row.line}"
    values = printed_number(nominal, sign, where), printed_number(measured, sign, where)
    deviation = row.values.get("deviation")
    if deviation is not None and not is_difference(deviation, measured, nominal, sign):
        raise RecordError(
            f"{where}: the deviation {deviation} of {row.axis} is not measured minus nominal "
            f"({measured} and {nominal}): does the heading match the row? Print the report again"
        )
    return values


_BODY = re.compile(r"[+-]?([0-9.,]*[0-9][.,]?)([eE][+-]?\d+)?")
# thousands separators that are no decimal sign
_SPACES = re.compile("(?<=[0-9])[\u00a0\u2009\u202f '\u2019](?=[0-9]{3}(?![0-9]))")
_OTHER = {".": ",", ",": "."}


def decimal_sign(numbers: Iterable[tuple[int, str]], requested: str | None = None) -> str:
    """Return the decimal sign of numbers in a text, each with the number of its line.

    ``0,025`` and ``10,0012`` can only have a decimal comma, ``1,234.5`` only a decimal point;
    ``1,234`` may be either.

    Examples
    --------
    >>> decimal_sign([(1, "10,000"), (2, "0,012")])
    ','
    """
    if requested is not None:
        return requested
    proofs: dict[str, tuple[int, str]] = {}
    open_: dict[str, tuple[int, str]] = {}
    for line, text in numbers:
        sign, sure = _sign_of(_SPACES.sub("", text))
        if sign:
            (proofs if sure else open_).setdefault(sign, (line, text))
    if len(proofs) == 2:
        (a, first), (b, second) = proofs["."], proofs[","]
        raise RecordError(
            f"'{first}' in line {a} has a decimal point, '{second}' in line {b} a decimal comma: "
            "export the file with one sign"
        )
    for sign in proofs:
        if _OTHER[sign] in open_:
            line, text = open_[_OTHER[sign]]
            raise RecordError(
                f"line {line}: '{text}' has a thousands separator or another decimal sign than "
                "other numbers: export the file with one sign, or give it by --text decimal=SIGN"
            )
        return sign
    if "," in open_:
        line, text = open_[","]
        raise RecordError(
            f"line {line}: the comma in '{text}' may be a decimal sign or a thousands separator: "
            "give the decimal sign by --text decimal=SIGN"
        )
    return "."


def _sign_of(text: str) -> tuple[str, bool]:
    """Return the possible decimal sign of a number, and whether it is unambiguous."""
    parts = _BODY.fullmatch(text)
    if parts is None:
        return "", False
    body, exponent = parts[1], parts[2]
    last = next((c for c in reversed(body) if c in _OTHER), "")
    if not last:
        return "", False
    if _OTHER[last] in body:
        return last, True
    if body.count(last) > 1:
        return _OTHER[last], True
    integer, _, decimals = body.partition(last)
    thousands = len(decimals) == 3 and re.fullmatch(r"[1-9]\d{0,2}", integer) is not None
    return last, not thousands or exponent is not None


def printed_number(text: str, sign: str, where: str) -> float:
    """Return a printed number; the other sign is a thousands separator. `where` is for messages.

    Examples
    --------
    >>> printed_number("-1.234,5", ",", "line 3")
    -1234.5
    """
    plain = _SPACES.sub("", text.strip())
    other = re.escape(_OTHER[sign])
    point = re.escape(sign)
    integer = rf"[1-9]\d{{0,2}}(?:{other}\d{{3}})+|\d*"
    grouped = re.fullmatch(rf"([+-]?)({integer})(?:{point}(\d*))?([eE][+-]?\d{{1,3}})?", plain)
    if grouped is None or not (grouped[2] or grouped[3]):
        raise RecordError(
            f"{where}: '{text.strip()[:30]}' is not a number with the decimal sign '{sign}': "
            "correct it, or give the decimal sign by --text decimal=SIGN"
        )
    digits = grouped[2].replace(_OTHER[sign], "")
    return float(f"{grouped[1]}{digits or '0'}.{grouped[3] or '0'}{grouped[4] or ''}")


def is_difference(deviation: str, measured: str, nominal: str, sign: str) -> bool:
    """Return whether a deviation is measured minus nominal, within the printed digits.

    Its negative is accepted too: some machines count deviations away from zero.

    Examples
    --------
    >>> is_difference("0,012", "10,0124", "10,000", ","), is_difference("0,2", "10,0", "10,0", ",")
    (True, False)
    """
    texts = (deviation, measured, nominal)
    difference, a, b = (printed_number(text, sign, "deviation") for text in texts)
    # each of the three is rounded to its own last digit
    digits = sum(0.5 * _last_digit(text, sign) for text in texts)
    return abs(abs(difference) - abs(a - b)) <= 1.05 * digits + 1e-12 * max(abs(a), abs(b))


def _last_digit(text: str, sign: str) -> float:
    """Return one unit of the last digit of a number."""
    mantissa, _, exponent = text.lower().partition("e")
    decimals = len(mantissa.rpartition(sign)[2]) if sign in mantissa else 0
    return 10.0 ** (int(exponent or 0) - decimals)
