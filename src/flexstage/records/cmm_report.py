"""Text reports of PC-DMIS in English: dimensions, each with a table of axes."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from flexstage.errors import RecordError
from flexstage.records.cmm_numbers import decimal_sign, is_difference, printed_number

#: Axes that are angles.
ANGLES = frozenset(("A", "PA"))
# coordinates, diameter, radius, length, height, distance or form (M), angles
_AXES = ANGLES | {*"XYZDRLHMT", "PR", "PX", "PY", "PZ"}
# rows of tables of position that are no coordinate
_LEFT_OUT = frozenset(
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
# the bar that shows where in its tolerance a value is
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
# how far right ends of a number and its heading may be apart
_SHIFT = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class CoordinateReading:
    """One value that a measuring machine reports."""

    feature: str
    """What was measured."""
    axis: str
    """Which coordinate of it."""
    nominal: float
    """Where it should be, in `unit`."""
    measured: float
    """Where it is, in `unit`."""
    unit: str
    """The unit; empty where the report does not say it."""


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
    dimension: _Dimension
    axis: str
    values: dict[str, str]


def has_report(lines: Sequence[str]) -> bool:
    """Say whether a text has a table as PC-DMIS writes it, by its heading.

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


def read_report(
    lines: Sequence[str], decimal: str | None
) -> tuple[list[CoordinateReading], tuple[str, ...]]:
    """Read the tables of a report: the values, and the kinds of rows that are no coordinates.

    Values go by the name of the feature, distances and errors of form (M) by that of the dimension.
    """
    rows, left_out = _rows(lines)
    if not rows:
        raise RecordError("there is no row of an axis in its tables: print the report again")
    sign = decimal_sign(((r.line, text) for r in rows for text in r.values.values()), decimal)
    return [_reading(row, sign) for row in rows], tuple(sorted(left_out))


def _rows(lines: Sequence[str]) -> tuple[list[_Row], set[str]]:
    rows: list[_Row] = []
    left_out: set[str] = set()
    dimension: _Dimension | None = None
    heading: _Heading | None = None
    for number, line in _joined(lines):
        opened = _dimension(number, line[:_LONGEST_OPENING])
        if opened is not None:
            dimension, heading = opened, None
            continue
        found = _heading(line)
        if found is not None:
            if dimension is None:
                raise RecordError(
                    f"line {number}: a table stands below no dimension that says what is measured: "
                    "print the report with the lines 'DIM ...'"
                )
            heading = found
            continue
        axis = line.split(maxsplit=1)[0].upper() if line.strip() else ""
        if heading is None or dimension is None or not _is_row(line, axis):
            continue
        if axis in _LEFT_OUT:
            left_out.add(axis)
        elif axis in _AXES:
            rows.append(_row(number, line, axis, dimension, heading))
        else:
            raise RecordError(
                f"line {number}: the axis '{axis[:20]}' is unknown, expected one of "
                f"{', '.join(sorted(_AXES))}: leave the dimension out of the report"
            )
    return rows, left_out


def _joined(lines: Sequence[str]) -> list[tuple[int, str]]:
    """Return the lines with their numbers, those that end in ``,$`` with what follows."""
    joined: list[tuple[int, str]] = []
    held: tuple[int, str] | None = None
    for number, raw in enumerate(lines, start=1):
        line = raw.expandtabs().rstrip()
        start, text = (held[0], f"{held[1]}  {line.strip()}") if held else (number, line)
        if text.endswith(",$"):
            held = start, text[:-2].rstrip()
            continue
        held = None
        joined.append((start, text))
    return joined if held is None else [*joined, held]


def _is_row(line: str, axis: str) -> bool:
    """Say whether a line below a heading is a row of it, and not a footer of the page."""
    words = line.split()
    if any("=" in word and not _BAR.fullmatch(word) for word in words):
        return False
    numbers = sum(_NUMBER.fullmatch(word) is not None for word in words[1:])
    return numbers > 2 or (numbers > 0 and _AXIS.fullmatch(axis) is not None)


def _dimension(number: int, line: str) -> _Dimension | None:
    """Return what a line opens, if it opens a dimension."""
    given = next((f for f in _UNIT.finditer(line) if "=" in line[: f.start()]), None)
    if given is None and re.match(r"\s*DIM\s.*=", line, re.IGNORECASE) is None:
        return None
    name, _, text = line[: given.start() if given else len(line)].partition("=")
    unit = _UNITS.get(given[1].upper(), "") if given else ""
    if given and not unit:
        raise RecordError(
            f"line {number}: the unit '{given[1]}' is unknown, expected MM, IN or DEG"
        )
    name = " ".join(re.sub(r"^\s*DIM\s+", "", name, flags=re.IGNORECASE).split())
    return _Dimension(line=number, name=name, feature=_feature(text), unit=unit)


def _feature(text: str) -> str:
    """Return the feature that a dimension is of; nothing where the text does not tell."""
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
                "it, or leave the dimension out of the report"
            )
    places = list(range(len(tokens)))
    if len(tokens) != len(heading.ends):
        places = _aligned(number, [token.end() for token in tokens], heading)
    values = {
        heading.roles[place]: token[0]
        for place, token in zip(places, tokens, strict=True)
        if heading.roles[place]
    }
    # a row that ends before its deviation may have lost digits of what stands before
    for name in ("nominal", "measured", "deviation"):
        if name in heading.roles and name not in values:
            raise RecordError(
                f"line {number}: there is no {name} value in the row of {axis}: print the report "
                "again, with nominal and measured values"
            )
    return _Row(line=number, dimension=dimension, axis=axis, values=values)


def _aligned(number: int, ends: Sequence[int], heading: _Heading) -> list[int]:
    """Return the columns of numbers where some are left empty, by where they end."""
    places: list[int] = []
    for end in ends:
        place = min(range(len(heading.ends)), key=lambda j: abs(heading.ends[j] - end))
        if abs(heading.ends[place] - end) > _SHIFT or place in places:
            raise RecordError(
                f"line {number}: its {len(ends)} numbers do not stand below the "
                f"{len(heading.ends)} headings of the table: print the report again"
            )
        places.append(place)
    return places


def _reading(row: _Row, sign: str) -> CoordinateReading:
    where = f"line {row.line}"
    nominal, measured = (
        printed_number(row.values[name], sign, where) for name in ("nominal", "measured")
    )
    given = row.values.get("deviation")
    if given is not None and not is_difference(
        given, row.values["measured"], row.values["nominal"], sign
    ):
        raise RecordError(
            f"{where}: the deviation {given} of {row.axis} is not measured minus nominal "
            f"({row.values['measured']} and {row.values['nominal']}): is the heading that of the "
            "row? Print the report again"
        )
    feature = row.dimension.name if row.axis == "M" else row.dimension.feature
    if not feature:
        raise RecordError(
            f"line {row.dimension.line}: it is not clear of which feature dimension "
            f"'{row.dimension.name}' is: print the report in English"
        )
    return CoordinateReading(
        feature=feature, axis=row.axis, nominal=nominal, measured=measured, unit=row.dimension.unit
    )
