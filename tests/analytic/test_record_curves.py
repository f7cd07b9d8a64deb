"""Tables of branches and reversal curves: the input that a stack saw, made again from its table."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import RecordError
from flexstage.files.request import request_fields, request_of
from flexstage.records import Channel, Record, read_record
from flexstage.records.drives import from_branches, read_drive
from flexstage.records.read_options import DriveColumns, ReadOptions
from flexstage.virtual.stack import virtual_stack

#: Plays with a curved gain: a memory that is wiped out, of no class that is fitted.
STACK = virtual_stack((0.0, 120.0), 37e-6, 0.12).bent
LOW, HIGH = 7.0, 117.0


def moved(*corners: float, step: float = 2.5) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return inputs and outputs of a stack from each input to the next, with both ends."""
    ways = [
        np.linspace(a, b, int(np.ceil(abs(b - a) / step)) + 1)[:-1] for a, b in pairwise(corners)
    ]
    u = np.append(np.concatenate(ways), corners[-1])
    y = STACK.simulate(u).values
    ends = np.cumsum([0] + [w.size for w in ways])
    return [(u[a : b + 1], y[a : b + 1]) for a, b in pairwise(ends)]


def write(path: Path, heading: str, rows: list[str]) -> Path:
    path.write_text("\n".join([heading, *rows]) + "\n")
    return path


COLUMNS = {"input": "u V", "output": "y"}


def read(*files: Path, **given: object) -> Record:
    """Read a table as the texts of options say."""
    how, columns = ({}, dict(COLUMNS))
    for name, value in given.items():
        (how if name in request_fields(ReadOptions) else columns)[name] = value
    said = {name: text for name, text in columns.items() if text is not None}
    records, driven, follows = read_drive(
        list(files),
        request_of(DriveColumns, None, said),
        request_of(ReadOptions, None, how),
    )
    record = records[0]
    assert [c.name for c in record.channels] == [driven, follows]
    assert record.uniform
    return record


def explained(record: Record) -> int:
    """Assert that the stack gives the table again from the input of its record; return its rows."""
    u, y = (c.values for c in record.channels)
    there = np.isfinite(y)
    assert record.numbers is not None
    assert np.array_equal(there, np.isfinite(record.numbers))
    assert np.abs(STACK.simulate(u).values - y)[there].max() < 1e-9 * np.ptp(y[there])
    return int(there.sum())


# ------------------------------------------------------------------ two branches


def table(rise: tuple[np.ndarray, np.ndarray], fall: tuple[np.ndarray, np.ndarray]) -> list[str]:
    """Return rows of input, output while it rose, and output while it fell."""
    return [f"{u:.12g},{a:.17g},{b:.17g}" for u, a, b in zip(*rise, fall[1][::-1], strict=True)]


def closed_loop() -> list[str]:
    """Return the table of a loop that was run before it was measured."""
    ways = moved(LOW, HIGH, LOW, HIGH, LOW)
    return table(ways[2], ways[3])


@pytest.mark.parametrize("order", [1, -1])
def test_a_closed_loop_was_run_before(tmp_path: Path, order: int) -> None:
    rows = closed_loop()
    record = read(
        write(tmp_path / "a.csv", "u,up,down", rows[::order]), output=None, branches="up,down"
    )
    u, y = (c.values for c in record.channels)
    there = np.isfinite(y)
    assert explained(record) == 2 * len(rows)
    # one loop that nothing was measured in, then the branches: up, and down again
    first = int(there.argmax())
    assert there[first:].all()
    assert (u[0], u[:first].max(), u[first], u[first:].max(), u[-1]) == (LOW, HIGH, LOW, HIGH, LOW)
    assert any("follow earlier loops" in note for note in record.notes)
    assert any("delay and creep cannot be identified" in note for note in record.notes)
    assert record.sample_rate_hz == pytest.approx(1.0)
    rated = read(tmp_path / "a.csv", output=None, branches="up,down", sample_rate="4 Hz")
    assert rated.sample_rate_hz == pytest.approx(4.0)
    assert not any("cannot be identified" in note for note in rated.notes)


def test_a_loop_that_begins_at_rest_is_open(tmp_path: Path) -> None:
    rows = table(*moved(0.0, HIGH, 0.0))
    record = read(write(tmp_path / "a.csv", "u,up,down", rows), output=None, branches="up,down")
    assert record.size == explained(record) == 2 * len(rows)
    assert any("begin at rest" in note for note in record.notes)


def test_what_is_no_table_of_branches(tmp_path: Path) -> None:
    rows = closed_loop()
    half = [*rows, f"{HIGH + 1.0},,3e-5"]
    with pytest.raises(RecordError, match="'up' is missing or not a number"):
        read(write(tmp_path / "a.csv", "u,up,down", half), output=None, branches="up,down")
    twice = write(tmp_path / "b.csv", "u,up,down", rows + rows)
    with pytest.raises(RecordError, match=r"is not monotonic, as at row \d+"):
        read(twice, output=None, branches="up,down")
    with pytest.raises(RecordError, match="must be three columns"):
        read(twice, output=None, branches="up,u")
    one = np.full(9, 3.0)
    channels = tuple(Channel(name=n, values=one + i) for i, n in enumerate("uab"))
    with pytest.raises(RecordError, match="input is constant"):
        from_branches(Record(channels=channels, time=np.arange(9.0)), "u", "a", "b")
    plain = read_record(write(tmp_path / "c.csv", "u,up,down", rows), over="point")
    with pytest.raises(RecordError, match="sample rate must be positive"):
        from_branches(plain, "u", "up", "down", sample_rate_hz=-1.0)


# ------------------------------------------------------------------ reversal curves

REVERSALS = (91.0, 72.5, 53.0, 33.5, 12.0)


def curves(way: int = 1) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return curves as they are measured: from saturation to a reversal, and back."""
    reversals = REVERSALS if way > 0 else tuple(LOW + HIGH - r for r in REVERSALS)
    saturated = HIGH if way > 0 else LOW
    corners = [reversals[-1], saturated]
    for reversal in reversals:
        corners += [reversal, saturated]
    return moved(*corners)[2::2]


def rows_of(found: list[tuple[np.ndarray, np.ndarray]], labels: list[str]) -> list[str]:
    return [
        f"{label},{a:.12g},{b:.17g}"
        for label, (u, y) in zip(labels, found, strict=True)
        for a, b in zip(u, y, strict=True)
    ]


LABELS = {
    "numbers": [str(i + 1) for i in range(5)],
    "reversals": [str(r) for r in REVERSALS],
    "texts": ["first", "second", "third", "fourth", "fifth"],
}


@pytest.mark.parametrize("labels", LABELS)
@pytest.mark.parametrize("way", [1, -1])
def test_curves_below_one_another(tmp_path: Path, labels: str, way: int) -> None:
    found = curves(way)
    file = write(tmp_path / "a.csv", "curve,u,y", rows_of(found, LABELS[labels]))
    record = read(file, curve="curve")
    assert explained(record) == sum(u.size for u, _ in found)
    numbers = record.numbers[np.isfinite(record.numbers)]
    assert np.array_equal(numbers, np.arange(numbers.size))
    assert any("5 reversal curves" in note for note in record.notes)


def test_a_reversal_that_was_not_measured_is_said_by_its_label(tmp_path: Path) -> None:
    found = [(u[1:], y[1:]) for u, y in curves()]
    count = sum(u.size for u, _ in found)
    file = write(tmp_path / "a.csv", "curve,u,y", rows_of(found, LABELS["reversals"]))
    assert explained(read(file, curve="curve")) == count
    # without it the memory is that of a smaller loop
    file = write(tmp_path / "b.csv", "curve,u,y", rows_of(found, LABELS["numbers"]))
    u, y = (c.values for c in read(file, curve="curve").channels)
    there = np.isfinite(y)
    assert np.abs(STACK.simulate(u).values - y)[there].max() > 1e-4 * np.ptp(y[there])


def test_a_curve_a_file_and_a_curve_a_column(tmp_path: Path) -> None:
    found = curves()
    files = [
        write(tmp_path / f"{i}.csv", "u,y", [f"{a:.12g},{b:.17g}" for a, b in zip(*c, strict=True)])
        for i, c in enumerate(found)
    ]
    by_file = read(*files, curve="files")
    longest = max(u.size for u, _ in found)
    heading = ",".join(f"u{i},y{i}" for i in range(5))
    rows = [
        ",".join(f"{u[j]:.12g},{y[j]:.17g}" if j < u.size else "," for u, y in found)
        for j in range(longest)
    ]
    pairs = read(
        write(tmp_path / "p.csv", heading, rows),
        input="u4,u0,u1,u2,u3", output="y4,y0,y1,y2,y3", curve="columns",
    )  # fmt: skip
    for record in (by_file, pairs):
        assert explained(record) == sum(u.size for u, _ in found)
    assert by_file.source == ", ".join(map(str, files))
    # one column of input, where a curve is empty below its reversal
    reversals = (92.0, 52.0, 12.0)
    corners = [12.0, 112.0]
    for reversal in reversals:
        corners += [reversal, 112.0]
    found = moved(*corners, step=1.0)[2::2]
    inputs = found[-1][0]
    rows = [
        ",".join([f"{u:.12g}", *(f"{y[v == u][0]:.17g}" if u >= v[0] else "" for v, y in found)])
        for u in inputs
    ]
    shared = read(write(tmp_path / "s.csv", "u,a,b,c", rows), output="a,b,c", curve="columns")
    assert explained(shared) == sum(u.size for u, _ in found)


def test_what_is_no_set_of_curves(tmp_path: Path) -> None:
    found = curves()
    both = [found[0], (found[1][0][::-1], found[1][1][::-1])]
    file = write(tmp_path / "a.csv", "curve,u,y", rows_of(both, ["1", "2"]))
    with pytest.raises(RecordError, match=r"rises along some curves and falls along others \(2\)"):
        read(file, curve="curve")
    away = np.abs(np.linspace(-9.0, 9.0, 19))
    there = [(away + r, away + r) for r in REVERSALS]
    file = write(tmp_path / "b.csv", "curve,u,y", rows_of(there, LABELS["numbers"]))
    with pytest.raises(RecordError, match="a plain record"):
        read(file, curve="curve")
    with pytest.raises(RecordError, match="need one input column, or one for each, got 2"):
        read(file, input="u,y", output="curve,y,u", curve="columns")
    empty = write(tmp_path / "c.csv", "u,b,a", ["1,,2", "2,,3", "3,,4"])
    with pytest.raises(RecordError, match="curve 'b' has no row"):
        read(empty, output="a,b", curve="columns")
