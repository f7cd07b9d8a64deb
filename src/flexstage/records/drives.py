"""Records of a drive: over time, or as tables of branches and of reversal curves."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.records.contents import default_drive_columns
from flexstage.records.read import read_files
from flexstage.records.read_options import (
    DriveColumns,
    ReadOptions,
    RowRange,
    read_column,
    write_rows,
)
from flexstage.records.record import Channel, Record
from flexstage.records.sampling import require_rate

#: Largest distance between the ends of a closed loop, as a share of its width.
_CLOSED = 0.2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Piece:
    """Consecutive rows with a monotonic input."""

    u: Array
    y: Array
    rows: Array
    name: str = ""
    reversal: float | None = None

    @property
    def way(self) -> float:
        """1 if the input rises, -1 if it falls."""
        return float(np.sign(self.u[-1] - self.u[0]))

    def turned(self) -> "_Piece":
        return replace(self, u=self.u[::-1], y=self.y[::-1], rows=self.rows[::-1])


def from_branches(
    record: Record,
    input: str | int,
    up: str | int,
    down: str | int,
    *,
    sample_rate_hz: float | None = None,
) -> Record:
    """Return the loop from a table of its two branches.

    The table has one row for each input, rising or falling; unmeasured outputs and their sample
    numbers are NaN. The default sample rate is 1 Hz.

    The input rises along the first branch and falls along the second. A closed loop is preceded by
    an unmeasured loop. A loop that is open at its lower end begins at rest.

    Examples
    --------
    >>> table = {"u": [0.0, 5.0, 10.0], "up": [0.0, 1.0, 3.0], "down": [0.4, 2.0, 3.0]}
    >>> channels = tuple(Channel(name=n, values=np.array(v)) for n, v in table.items())
    >>> loop = from_branches(Record(channels=channels, time=np.arange(3.0)), "u", "up", "down")
    >>> loop.channel("u").values
    array([ 0.,  5., 10., 10.,  5.,  0.])
    """
    driven = record.channel(input)
    branches = [record.channel(c) for c in (up, down)]
    _require_three("input, up and down branch", driven, *branches)
    _require_one_unit("branches", branches)
    pieces = [_piece(record, driven.values, b.values, b.name) for b in branches]
    step = _step(pieces)
    _require_one_way(pieces, float(np.ptp(driven.values)), driven.name)
    rise, fall = (p if p.way == way else p.turned() for p, way in zip(pieces, (1, -1), strict=True))
    wide = np.interp(rise.u, fall.u[::-1], fall.y[::-1]) - rise.y
    closed = abs(fall.y[-1] - rise.y[0]) <= _CLOSED * float(np.abs(wide).max())
    low, high = float(rise.u[0]), float(rise.u[-1])
    before = [_unmeasured(rise.u[:1]), _way([low, high, low], step)] if closed else []
    state = (
        "the loop is closed: assumed to follow earlier loops"
        if closed
        else "the loop is open at its lower end: assumed to begin at rest"
    )
    output = replace(branches[0], name=f"{branches[0].name}, {branches[1].name}")
    return _assembled(record, driven, output, [*before, rise, fall], sample_rate_hz, state)


def curves_in_rows(
    record: Record,
    input: str | int,
    output: str | int,
    curve: str | int,
    *,
    sample_rate_hz: float | None = None,
) -> Record:
    """Return the measurement of reversal curves in consecutive rows of a table.

    First-order reversal curves (I. D. Mayergoyz, Phys. Rev. Lett. 56 (1986) 1518): the input goes
    from saturation to a reversal, unmeasured, and back, measured.

    Parameters
    ----------
    record : Record
        The table.
    input, output : str or int
        The columns of input and output.
    curve : str or int
        The column with a constant value in each curve: its number, or its reversal point.
    sample_rate_hz : float, optional
        Sample rate of the rows [Hz]; 1 Hz if not given.

    Returns
    -------
    Record
        Input and output over time, from the first approach to saturation on; unmeasured outputs and
        their sample numbers are NaN.

    Raises
    ------
    RecordError
        The column does not number curves, or the input of a curve is not monotonic.
    """
    driven, follows, labels = (record.channel(c) for c in (input, output, curve))
    _require_three("input, output and curve", driven, follows, labels)
    ends = np.flatnonzero(np.diff(labels.values)) + 1
    bounds = [0, *ends.tolist(), record.size]
    if len(bounds) - 1 > record.size // 2:
        raise RecordError(
            f"column '{labels.name}' has {len(bounds) - 1} successive values in {record.size} "
            "rows: it does not number curves of several rows; select the column that does"
        )
    pieces = [
        replace(
            _piece(record, driven.values, follows.values, f"{labels.values[a]:g}", slice(a, b)),
            reversal=float(labels.values[a]),
        )
        for a, b in pairwise(bounds)
    ]
    return _reversal_curves(record, driven, follows, pieces, sample_rate_hz)


def curves_in_columns(
    record: Record,
    inputs: Sequence[str | int],
    outputs: Sequence[str | int],
    *,
    sample_rate_hz: float | None = None,
) -> Record:
    """Return the measurement of reversal curves in separate columns."""
    driven = [record.channel(c) for c in inputs]
    follow = [record.channel(c) for c in outputs]
    if len(driven) not in (1, len(follow)):
        raise RecordError(
            f"{len(follow)} curves need one input column, or one for each, got {len(driven)}"
        )
    for channels in (driven, follow):
        _require_one_unit("curves", channels)
    pieces = [
        _piece(record, u.values, y.values, y.name)
        for u, y in zip(driven * (len(follow) // len(driven)), follow, strict=True)
    ]
    return _reversal_curves(record, driven[0], follow[0], pieces, sample_rate_hz)


def curves_in_records(
    records: Sequence[Record],
    input: str | int,
    output: str | int,
    *,
    sample_rate_hz: float | None = None,
) -> Record:
    """Return the measurement of reversal curves in separate records."""
    pairs = [(r.channel(input), r.channel(output)) for r in records]
    for channels in zip(*pairs, strict=True):
        _require_one_unit("curves", channels)
    before = np.concatenate(([0], np.cumsum([r.size for r in records])))
    pieces = [
        replace(piece, rows=piece.rows + first)
        for piece, first in (
            (_piece(r, u.values, y.values, r.source), first)
            for r, (u, y), first in zip(records, pairs, before[:-1], strict=True)
        )
    ]
    base = replace(
        records[0],
        source=", ".join(r.source for r in records),
        source_hash=", ".join(r.source_hash for r in records),
        notes=tuple(dict.fromkeys(note for r in records for note in r.notes)),
    )
    return _reversal_curves(base, *pairs[0], pieces, sample_rate_hz)


def _require_three(what: str, *channels: Channel) -> None:
    if len({id(channel) for channel in channels}) < 3:
        raise RecordError(f"{what} must be three columns: select one for each")


def _require_one_unit(what: str, channels: Sequence[Channel]) -> None:
    if len({channel.unit for channel in channels}) > 1:
        listed = ", ".join(f"{c.name} in {c.unit or 'no unit'}" for c in channels)
        raise RecordError(f"the {what} have different units ({listed}): give equal units")


def _piece(record: Record, u: Array, y: Array, name: str, rows: slice = slice(None)) -> _Piece:
    """Return the measured rows of a curve."""
    numbers = np.arange(record.size, dtype=np.float64) if record.numbers is None else record.numbers
    there = np.isfinite(u[rows]) & np.isfinite(y[rows])
    if not there.any():
        raise RecordError(f"curve '{name}' has no row with an input and an output")
    return _Piece(u=u[rows][there], y=y[rows][there], rows=numbers[rows][there], name=name)


def _require_one_way(pieces: Sequence[_Piece], span: float, name: str) -> None:
    # largest setback of a measured input, as a share of its range
    setback = 0.02
    for piece in pieces:
        u = piece.u if piece.way >= 0.0 else -piece.u
        back = np.maximum.accumulate(u) - u
        at = int(back.argmax())
        if back[at] > setback * span:
            raise RecordError(
                f"the input '{name}' of '{piece.name}' is not monotonic, as at row "
                f"{piece.rows[at]:.0f}, where it is {piece.u[at]:g}: a branch or a curve needs a "
                "monotonic input; a table with the complete input path is a plain record: omit "
                "--branches or --curve"
            )


def _step(pieces: Sequence[_Piece]) -> float:
    """Return the usual step of the input from row to row."""
    steps = np.concatenate([np.abs(np.diff(p.u)) for p in pieces])
    steps = steps[steps > 0.0]
    if not steps.size:
        raise RecordError("the input is constant: select the column of the command")
    return float(np.median(steps))


def _unmeasured(u: Array) -> _Piece:
    return _Piece(u=u, y=np.full(u.size, np.nan), rows=np.full(u.size, np.nan))


def _way(corners: Sequence[float], step: float) -> _Piece:
    """Return the unmeasured path through some inputs, without its two ends."""
    distinct = [c for i, c in enumerate(corners) if i == 0 or c != corners[i - 1]]
    parts = [
        np.linspace(a, b, max(int(np.ceil(abs(b - a) / step - 1e-9)), 1) + 1)[:-1]
        for a, b in pairwise(distinct)
    ]
    return _unmeasured(np.concatenate(parts)[1:] if parts else np.zeros(0))


def _reversal_curves(
    record: Record,
    driven: Channel,
    follows: Channel,
    pieces: Sequence[_Piece],
    rate: float | None,
) -> Record:
    """Join curves into one record, each from saturation to its reversal and back."""
    every, step = np.concatenate([p.u for p in pieces]), _step(pieces)
    _require_one_way(pieces, float(np.ptp(every)), driven.name)
    ways = {p.way for p in pieces} - {0.0}
    if len(ways) != 1:
        falls = [p.name for p in pieces if p.way < 0.0]
        raise RecordError(
            f"the input '{driven.name}' rises along some curves and falls along others "
            f"({', '.join(falls[:5])}): reversal curves need one direction; give the curves of "
            "each direction separately"
        )
    way = ways.pop()
    saturated = float((way * every).max() * way)
    opposite = float((way * every).min() * way)
    reversals = _reversals(pieces, way, step)
    path, last = [_unmeasured(np.array([opposite]))], opposite
    for piece, reversal in zip(pieces, reversals, strict=True):
        path += [_way([last, saturated, reversal, float(piece.u[0])], step), piece]
        last = float(piece.u[-1])
    state = (
        f"{len(pieces)} reversal curves, each assumed to start from saturation at {saturated:g}"
        f"{' ' + driven.unit if driven.unit else ''}, the end of the table"
    )
    return _assembled(record, driven, follows, path, rate, state)


def _reversals(pieces: Sequence[_Piece], way: float, step: float) -> list[float]:
    """Return the reversal point of each curve: its label, or its first row."""
    first = [float(p.u[0]) for p in pieces]
    labels = [p.reversal for p in pieces]
    # a label just below the first row of every curve is the reversal point, not a number
    if all(
        s is not None and 0.0 <= way * (u - s) <= 1.5 * step
        for s, u in zip(labels, first, strict=True)
    ):
        return [float(s) for s in labels if s is not None]
    return first


def _assembled(
    record: Record,
    driven: Channel,
    follows: Channel,
    path: Sequence[_Piece],
    rate: float | None,
    state: str,
) -> Record:
    require_rate(rate)
    u, y, rows = (np.concatenate([getattr(p, f) for p in path]) for f in ("u", "y", "rows"))
    # assumed rate of the rows of a table without times [Hz]
    nominal_hz = 1.0
    if rate is None:
        state += (
            f"; {nominal_hz:g} row per second is assumed without times: delay and creep cannot be "
            "identified"
        )
    return Record(
        channels=(replace(driven, values=u), replace(follows, values=y)),
        time=np.arange(u.size) / (nominal_hz if rate is None else rate),
        source=record.source,
        source_hash=record.source_hash,
        notes=(*record.notes, state),
        attributes=record.attributes,
        numbers=rows,
    )


def read_drive(
    files: Sequence[Path], columns: DriveColumns, how: ReadOptions = ReadOptions()
) -> tuple[list[Record], str | int, str | int]:
    """Read commands and responses of a drive: over time, or as tables of curves.

    Returns the records, uniformly sampled with NaN for unmeasured outputs, then the columns of
    input and output. Over time, default columns follow from units and names in the first file, with
    a note.
    """
    input, output = columns.input, columns.output
    if not columns.is_table:
        column_notes: list[str] = []
        if not (input and output):
            input, output, *column_notes = default_drive_columns(files[0], (input, output), how)
        pair = [*input, *output]
        if len(pair) != 2:
            raise RecordError(
                "--input and --output must name one column each, except with --curve columns"
            )
        read = read_files(files, pair, options=how, even=True)
        read[0] = replace(read[0], notes=(*column_notes, *read[0].notes))
        return read, pair[0], pair[1]
    if not input or not (output or columns.branches):
        raise RecordError(
            "a table without times needs --input, and --output or --branches: name the columns"
        )
    option = "--branches" if columns.branches else "--curve"
    for other, value in (("--time", how.time), ("--resample", how.resample or None)):
        if value is not None:
            raise RecordError(f"{option} is for tables without times: omit {other}")
    if columns.branches and (columns.curve is not None or output):
        other = "--output" if output else "--curve"
        raise RecordError(f"--branches names both columns of the output: omit {other}")
    records = (_loops if columns.branches else _curves)(files, columns, how)
    driven, follows = records[0].channels
    return records, driven.name, follows.name


def train_range(rows: RowRange | None, read: list[Record]) -> tuple[int, int] | None:
    """Return the samples to fit, first and one after the last, by their number in the records.

    `rows` numbers them as in the files.
    """
    if rows is None:
        return None
    spans = {_span(rows, record) for record in read}
    if len(spans) > 1:
        raise RecordError(
            "--train is one range of samples for all files, but their resampling differs: give "
            "one file, or omit --train"
        )
    first, stop = spans.pop()
    size = max(r.size for r in read)
    if first >= size or (stop is not None and stop <= 0):
        raise RecordError(
            f"--train {write_rows(rows)} contains none of the samples {_numbered(read)} of the "
            "files"
        )
    return max(first, 0), size if stop is None else stop


def _span(rows: RowRange, record: Record) -> tuple[int, int | None]:
    numbers = record.numbers
    if numbers is None:
        return rows[0] or 0, rows[1]
    if np.isnan(numbers).any():
        raise RecordError(
            "--train is for samples over time: for branches or curves, select rows by --rows"
        )
    if np.array_equal(numbers, numbers[0] + np.arange(numbers.size)):
        begin = int(numbers[0])
        return (rows[0] or 0) - begin, None if rows[1] is None else rows[1] - begin
    first, stop = (None if n is None else int(np.searchsorted(numbers, n)) for n in rows)
    return first or 0, stop


def _numbered(read: list[Record]) -> str:
    ends = [(0, r.size - 1) if r.numbers is None else r.numbers[[0, -1]] for r in read]
    return f"{min(e[0] for e in ends):.0f} to {max(e[1] for e in ends):.0f}"


def _loops(files: Sequence[Path], columns: DriveColumns, how: ReadOptions) -> list[Record]:
    if len(columns.branches) != 2 or len(columns.input) != 1:
        raise RecordError(
            f"--branches needs two columns, UP,DOWN, and one --input, got {len(columns.branches)} "
            f"and {len(columns.input)}"
        )
    (input,), (up, down) = columns.input, columns.branches
    read = read_files(files, [input, up, down], options=_timeless(how), over="table")
    return [
        from_branches(table, input, up, down, sample_rate_hz=each.rate)
        for table, each in zip(read, how.of_each(len(files)), strict=True)
    ]


def _timeless(how: ReadOptions) -> ReadOptions:
    return replace(how, sample_rate=())


def _curves(files: Sequence[Path], columns: DriveColumns, how: ReadOptions) -> list[Record]:
    inputs, outputs, curve = columns.input, columns.output, columns.curve or ""
    table = partial(read_files, files, options=_timeless(how), over="table")
    rates = [each.rate for each in how.of_each(len(files))]
    if curve != "columns" and len(inputs) * len(outputs) != 1:
        raise RecordError(
            "--input and --output must name one column each; if each curve has its own column, use "
            "--curve columns"
        )
    if curve == "columns":
        # unmeasured rows of a curve are empty
        read = table(inputs[:1], partial=[*inputs[1:], *outputs])
        return [
            curves_in_columns(one, inputs, outputs, sample_rate_hz=rate)
            for one, rate in zip(read, rates, strict=True)
        ]
    pair = [inputs[0], outputs[0]]
    if curve == "files":
        read = table(pair)
        return [curves_in_records(read, inputs[0], outputs[0], sample_rate_hz=rates[0])]
    by = read_column(curve)
    read = table([*pair, by], labels=by)
    return [
        curves_in_rows(one, inputs[0], outputs[0], by, sample_rate_hz=rate)
        for one, rate in zip(read, rates, strict=True)
    ]
