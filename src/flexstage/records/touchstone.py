"""Touchstone files of network analysers: frequency responses between ports, as columns."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import RecordError
from flexstage.records.columns import FileColumn, FileColumns, complex_parts
from flexstage.records.text_rows import text_lines

_OPTIONS = re.compile(
    r"^[ \t]*#[ \t]*(?:(?P<unit>[kMG]?hz)\b)?[ \t]*(?:(?P<kind>[syzhg])\b)?[ \t]*"
    r"(?:(?P<form>ri|ma|db)\b)?[ \t]*(?:r[ \t]+(?P<reference>[\d.+e-]+))?[ \t]*(?:!.*)?$",
    re.IGNORECASE | re.MULTILINE,
)
_SUFFIX = re.compile(r"\.s(\d{1,2})p", re.IGNORECASE)
_HERTZ = {"hz": 1.0, "khz": 1e3, "mhz": 1e6, "ghz": 1e9}
# numbers of a row by which ports are told where the suffix does not
_PORTS = {3: 1, 9: 2}


def is_touchstone(text: str) -> bool:
    r"""Say whether a text is a Touchstone file.

    Examples
    --------
    >>> is_touchstone("! shaker\n# HZ S RI R 50\n10 0.5 0.25\n"), is_touchstone("# a remark\n")
    (True, False)
    """
    found = _OPTIONS.search(text)
    return found is not None and found["kind"] is not None and found["form"] is not None


def from_polar(
    magnitude: NDArray[np.float64], phase: NDArray[np.float64], *, decibel: bool
) -> NDArray[np.complex128]:
    """Return complex values by their magnitudes and phases.

    Phases are in rad; a magnitude in decibel is 20 times its common logarithm.

    Examples
    --------
    >>> from_polar(np.array([20.0]), np.array([np.pi / 2]), decibel=True).imag
    array([10.])
    """
    size = np.power(10.0, magnitude / 20.0) if decibel else magnitude
    return np.asarray(size * np.exp(1j * phase), dtype=np.complex128)


def read_touchstone(path: Path) -> FileColumns:
    r"""Read the responses of a Touchstone file, version 1.

    The line of options says unit of frequency and form of the values: real and imaginary part (RI),
    magnitude and degrees (MA), decibels and degrees (DB). ``2/1`` is the response at port 2 to port
    1. Version 2 is refused.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "stage.s1p"
    ...     _ = file.write_text("# kHz S RI R 50\n0.5 0.25 -0.75\n1.0 0.5 -1.25\n")
    ...     columns = read_touchstone(file)
    >>> columns.columns[1].name, columns.columns[1].values, columns.axis
    ('1/1 imaginary', array([-0.75, -1.25]), array([ 500., 1000.]))
    """
    lines = text_lines(path)
    options = next((m for m in map(_OPTIONS.match, lines) if m is not None), None)
    said = {} if options is None else {k: v for k, v in options.groupdict().items() if v}
    if any(line.lstrip().lower().startswith("[version]") for line in lines):
        raise RecordError("it is a Touchstone file of version 2: save it as version 1 (.s2p)")
    rows = _rows(lines)
    suffix = _SUFFIX.fullmatch(path.suffix)
    ports = int(suffix[1]) if suffix else _PORTS.get(len(rows[0]), 0)
    if not ports:
        raise RecordError(
            f"its rows have {len(rows[0])} numbers, which tells no number of ports: name it .s1p "
            "(3 numbers), .s2p (9 numbers)..."
        )
    table, notes = _table(rows, ports)
    form = said.get("form", "ma").lower()
    columns: list[FileColumn] = []
    for at in range(ports * ports):
        first, second = table[:, 1 + 2 * at], table[:, 2 + 2 * at]
        values = first + 1j * second
        if form != "ri":
            values = from_polar(first, np.radians(second), decibel=form == "db")
        # of two ports the first column of the matrix comes first, of all others the first row
        row, column = (at % 2, at // 2) if ports == 2 else divmod(at, ports)
        name = f"{row + 1}/{column + 1}"
        columns += complex_parts(
            FileColumn(name=name, values=values.real.copy()), values.imag.copy()
        )
    kind = said.get("kind", "s").upper()
    if kind != "S":
        notes.append(f"its {kind} parameters are read as they stand, over the reference")
    if np.any(np.diff(table[:, 0]) <= 0.0):
        raise RecordError("its frequencies must rise: sort the lines, or leave repeated ones out")
    return FileColumns(
        columns=tuple(columns),
        notes=tuple(notes),
        attributes={"heading": options[0].strip()} if options else {},
        over="frequency",
        axis=table[:, 0] * _HERTZ[said.get("unit", "ghz").lower()],
    )


def _rows(lines: list[str]) -> list[list[float]]:
    rows = []
    for number, line in enumerate(lines, start=1):
        plain = line.partition("!")[0].strip()
        if not plain or plain.startswith("#"):
            continue
        try:
            rows.append([float(word) for word in plain.split()])
        except ValueError:
            raise RecordError(f"line {number} of the Touchstone file holds no numbers") from None
    if not rows:
        raise RecordError("the Touchstone file holds no row of numbers: is it whole?")
    return rows


def _table(rows: list[list[float]], ports: int) -> tuple[NDArray[np.float64], list[str]]:
    """Return a row for each frequency; of many ports a row goes over several lines."""
    width, notes = 1 + 2 * ports * ports, []
    if ports <= 2:
        noise = next((i for i, row in enumerate(rows) if i and len(row) == 5), len(rows))
        if noise < len(rows) and ports == 2:
            notes = [f"left out: {len(rows) - noise} lines of noise parameters"]
            rows = rows[:noise]
        odd = next((i for i, row in enumerate(rows) if len(row) != width), None)
        if odd is not None:
            raise RecordError(
                f"row {odd + 1} of the Touchstone file has {len(rows[odd])} numbers where {ports} "
                f"ports have {width}: correct the row, or export the file again"
            )
    numbers = [number for row in rows for number in row]
    if len(numbers) % width:
        raise RecordError(
            f"it has {len(numbers)} numbers, and {ports} ports have {width} for each frequency: "
            "the file is cut short; export it again"
        )
    return np.array(numbers).reshape(-1, width), notes
