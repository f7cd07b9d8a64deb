"""Reading measured files into records: format, columns, units, time, and the checks."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexstage.base.errors import RecordError, UnitError
from flexstage.base.provenance import file_hash
from flexstage.files.request import request_of
from flexstage.records.binary_files import read_hdf5, read_numpy, read_tdms
from flexstage.records.cmm import has_report, read_coordinates
from flexstage.records.columns import (
    GRAVITY,
    FileColumn,
    FileColumns,
    gravity_unit,
    is_acceleration,
    measured_unit,
)
from flexstage.records.gcs_array import is_gcs_array, read_gcs_array
from flexstage.records.matlab import read_matlab
from flexstage.records.read_options import ReadOptions, TextLayout
from flexstage.records.record import Channel, Record, column_and_unit, column_number
from flexstage.records.sampling import (
    LARGEST_STEP,
    LARGEST_UNEVEN_STEP,
    require_complete,
    require_uniform,
    resample_uniform,
    timed,
)
from flexstage.records.text import read_text
from flexstage.records.text_rows import decoded
from flexstage.records.universal_file import read_universal
from flexstage.records.universal_sets import is_universal

# with marks of thousands, two decimal signs, or none that is known
_LIKE_NUMBER = re.compile(r"(?!\d\d?\.\d\d?\.\d{2,4}$)[+-]?[\d.,' ]+([eE][+-]?\d+)?")

#: Suffixes of the formats that `read_record` knows; reports of measuring machines have none.
FORMATS: dict[str, tuple[str, ...]] = {
    "text": (".csv", ".txt", ".dat", ".tsv", ".asc", ".lvm"),
    "matlab": (".mat",),
    "hdf5": (".h5", ".hdf5", ".hdf"),
    "tdms": (".tdms",),
    "numpy": (".npy", ".npz"),
    "universal": (".uff", ".unv", ".ufb", ".bunv"),
    "gcs": (".gcs",),
    "cmm": (),
}

_SIGNATURES = (
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"MATLAB 5.0 MAT-file", "matlab"),
    (b"MATLAB 7.3 MAT-file", "matlab"),
    (b"TDSm", "tdms"),
    (b"\x93NUMPY", "numpy"),
)
# enough for the preamble of a report, little to look through in a file of many samples
_HEAD = 65_536


def read_record(
    path: str | Path,
    options: ReadOptions | None = None,
    *,
    units: Mapping[str, str] | None = None,
    names: Sequence[str] | None = None,
    columns: Sequence[str | int] | None = None,
    partial: Sequence[str | int] = (),
    over: Literal["time", "point"] = "time",
    largest_step: float | None = None,
    labels: str | int | None = None,
    **how: Any,
) -> Record:
    r"""Read columns of measured data from a file.

    The format is known by the first bytes, then by the suffix. Every column of the file is a
    channel with the number that it has in the file, the time too. Units come from `units`, or from
    behind the names of columns that are asked for, ``"2 um"``, then from the file; a column without
    one keeps its numbers. Times come from `time`, then from the
    file's own sample rate, then from a column that is called time and says its unit. A file of
    frequency responses, and a report of a measuring machine, has no times: `Record.over` says so.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    options : ReadOptions, optional
        What the file does not say itself: rate, time, rows, format.
    units : Mapping, optional
        Units by name or number of column, ``{"0": "V", "position": "um"}``; ``"length"`` stands for
        all lengths of a measuring machine, the name of a complex function for both its parts.
    names : sequence of str, optional
        Names of the columns, in place of those in the file.
    columns : sequence of str or int, optional
        The columns that will be used: only they must be complete. All, where not given, but those
        that hold nothing but text, whose values are NaN.
    partial : sequence of str or int, optional
        Further columns, which may be incomplete.
    over : {"time", "point"}
        What the rows of a file follow one another by that does not say it: time, or their number.
    largest_step : float, optional
        Longest step of a column of time that is no gap, over the median one.
    labels : str or int, optional
        A column that labels the rows: texts in it are numbered as they first appear.
    **how
        Fields of `ReadOptions`, in place of those of `options`.

    Returns
    -------
    Record
        Channels in SI units, rising times [s], the file's hash, and notes on what was understood.
        Of functions in a universal file, ``output of NAME``, ``input of NAME``, ``output unit of
        NAME``, ``input unit of NAME`` and ``kind of NAME`` are attributes.

    Validity
    --------
    A factor turns a unit into an SI unit: logarithmic units (dB) are unknown, and a temperature in
    degrees Celsius stays one. Numbers are double precision.

    Raises
    ------
    RecordError
        The file cannot be read, is damaged or ambiguous, has no times, or its samples are
        incomplete, repeated, out of order or have gaps.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "loop.csv"
    ...     _ = file.write_text("drive (V);pos (um)\n0,5;1,25\n0,75;1,5\n")
    ...     record = read_record(file, sample_rate=200.0)
    >>> record.channel("pos").values, record.channel("pos").unit
    (array([1.25e-06, 1.50e-06]), 'm')
    """
    file, options = Path(path), request_of(ReadOptions, options, how)
    rows = options.rows
    try:
        content_hash = _hash(file)
        raw = _read(file, format_of(file, options.format), options)
        if names is not None:
            raw = raw.renamed(names)
        raw = _distinct(raw)
        first = 0
        if rows is not None and raw.columns:
            first = slice(*rows).indices(raw.columns[0].values.size)[0]
            raw = raw.part(slice(*rows))
        if not raw.columns or raw.columns[0].values.size < 2:
            raise RecordError("there are fewer than two samples: a record needs at least two")
        if labels is not None:
            raw = raw.numbered(column_number([c.name for c in raw.columns], labels))
        used = _used(raw, columns)
        for number in sorted(used):
            raw.require_numbers(number)
        timed_by = () if options.time is None else (options.time,)
        said = _units_said(raw, (*(columns or ()), *partial, *timed_by), units or {})
        channels, notes = _in_si(raw, said, _accelerations(raw, file))
        kind = _kind(raw, over, options)
        if kind == "time":
            if largest_step is None:
                largest_step = LARGEST_UNEVEN_STEP if options.resample else LARGEST_STEP
            channels, times, more = timed(raw, channels, options.time, options.rate, largest_step)
            notes += more
        else:
            size = raw.columns[0].values.size
            times = np.arange(size, dtype=np.float64) if raw.axis is None else raw.axis
        notes += _left_out(raw, channels, used)
    except OSError as error:
        raise RecordError(f"'{file}' cannot be read: {error.strerror or error}") from error
    except RecordError as error:
        if str(file) in str(error):
            raise
        raise RecordError(f"'{file}': {error}") from error
    record = Record(
        channels=tuple(channels),
        time=times,
        source=str(path),
        source_hash=content_hash,
        notes=(*raw.notes, *notes),
        attributes=dict(raw.attributes),
        over=kind,
        numbers=None if not first else np.arange(first, first + times.size, dtype=np.float64),
    )
    if not options.resample:
        return record
    if kind != "time":
        raise RecordError(
            f"'{record.source}' is over {kind}, and --resample is for samples over time: leave it "
            "out"
        )
    return resample_uniform(record, options.resample[0])


def _hash(file: Path) -> str:
    if not file.exists():
        raise RecordError(f"there is no file '{file}'")
    if not file.is_file():
        raise RecordError(f"'{file}' is no file: give one file of measured columns")
    return file_hash(file)


def _read(file: Path, known: str, options: ReadOptions) -> FileColumns:
    dataset, how = options.dataset, options.text
    if known in ("text", "gcs") and dataset is not None:
        raise RecordError(f"'{file}' is a text file: it has no datasets, leave the option out")
    if known == "text":
        return read_text(file, how)
    if known == "cmm":
        return read_coordinates(file, dataset, how)
    if how != TextLayout():
        raise RecordError(
            f"'{file}' is no text file of columns: the layout of one (--text) has no meaning for it"
        )
    if known == "gcs":
        return read_gcs_array(file)
    readers = {
        "matlab": read_matlab,
        "hdf5": read_hdf5,
        "tdms": read_tdms,
        "numpy": read_numpy,
        "universal": read_universal,
    }
    return readers[known](file, dataset)


def _distinct(raw: FileColumns) -> FileColumns:
    """Number columns that have the same name."""
    names = [c.name for c in raw.columns]
    again = sorted({n for n in names if names.count(n) > 1}) if len(set(names)) < len(names) else []
    if not again:
        return raw
    taken = set(names)
    columns = []
    for number, column in enumerate(raw.columns):
        name = column.name
        if name in again:
            name = f"{name} #{number}"
            while name in taken:
                name += "'"
            taken.add(name)
        columns.append(replace(column, name=name))
    note = f"columns of the same name ({', '.join(again)}) are distinguished by their number"
    return replace(raw, columns=tuple(columns), notes=(*raw.notes, note))


def _kind(
    raw: FileColumns, wanted: str, options: ReadOptions
) -> Literal["time", "frequency", "point"]:
    """Return what the samples follow one another by: as the file says, else as asked."""
    if wanted not in ("time", "point"):
        raise RecordError(f"rows follow one another by time or by point, got {wanted!r}")
    kind = raw.over
    if kind == "time" and wanted == "point" and raw.sample_rate_hz is None:
        kind = "point"
    if kind != "time" and (options.time is not None or options.sample_rate):
        why = "its rows are points" if kind == "point" else "it is over frequency"
        raise RecordError(f"{why}, without times: leave sample rate and column of time out")
    return kind


def _asked(raw: FileColumns, selector: str | int) -> tuple[tuple[int, ...], str]:
    """Return the columns that a name or number stands for, and the unit behind it."""
    if (text := str(selector).strip()) in raw.groups:
        return raw.groups[text], ""
    group, _, unit = text.partition(" ")
    if unit and group in raw.groups:
        return raw.groups[group], unit.strip()
    number, unit = column_and_unit([c.name for c in raw.columns], selector)
    return (number,), unit


def _units_said(
    raw: FileColumns, columns: Sequence[str | int], units: Mapping[str, str]
) -> dict[int, str]:
    """Return the units that are given to columns, behind them or by themselves."""
    given = [(_asked(raw, column)[0], unit, False) for column, unit in units.items()]
    behind = [(*_asked(raw, column), True) for column in columns]
    said: dict[int, str] = {}
    for numbers, unit, again in (*given, *behind):
        for number in numbers if unit else ():
            if number in said and not (again and said[number] == unit):
                raise RecordError(
                    f"column '{raw.columns[number].name}' is given two units: give one"
                )
            said[number] = unit
    return said


def _accelerations(raw: FileColumns, file: Path) -> str:
    """Return what says that a file is of accelerations, where its columns do not; empty if none."""
    if raw.attributes.get("heading", "").startswith("LabVIEW Measurement"):
        return "of an acquisition by LabVIEW"
    for column in raw.columns:
        if is_acceleration(column.name) or column.unit == "m/s^2":
            return f"beside column '{column.name}'"
    return "by the name of the file" if is_acceleration(file.stem) else ""


def _in_si(
    raw: FileColumns, said: Mapping[int, str], accelerations: str
) -> tuple[list[Channel], list[str]]:
    """Return the columns in SI units, by those that are said of some, and what was done."""
    channels, notes, found = [], [], []
    for number, column in enumerate(raw.columns):
        text = said.get(number, column.unit)
        meant = column
        if column.si is None and text.strip() in GRAVITY and number not in said:
            meant, note = _weighed(column, accelerations)
            notes += note
        try:
            factor, unit = _si(meant, text, number in said)
        except UnitError as error:
            if number in said:
                raise RecordError(f"column '{column.name}': {error}") from error
            notes.append(
                f"'{text}' of column '{column.name}' is no known unit: left as in the file"
            )
            factor, unit = 1.0, ""
        if unit and number not in said:
            found.append(f"{column.name} in {text}")
        if number in said and column.unit and (column.si or _known(column.unit)) != (factor, unit):
            notes.append(
                f"column '{column.name}' says {column.unit!r} in the file, and is read as {text!r}"
            )
        values = column.values if factor == 1.0 else _scaled(column.values, factor)
        channels.append(Channel(name=column.name, values=values, unit=unit, texts=column.texts))
    if found:
        notes.append(f"units of the file: {', '.join(found)}")
    return channels, notes


def _weighed(column: FileColumn, accelerations: str) -> tuple[FileColumn, list[str]]:
    """Return a column in g with what that is, and a note where its unit does not say it."""
    unit = column.unit.strip()
    if gravity_unit(unit, "") is not None:
        return column, []
    because = "as its name says" if is_acceleration(column.name) else accelerations
    if because:
        note = (
            f"'{unit}' of column '{column.name}' is taken as the acceleration of gravity, "
            f"{because}: of a mass, give its unit as gram"
        )
        return replace(column, si=(GRAVITY[unit], "m/s^2")), [note]
    if _known(unit) is None:
        return column, []
    note = (
        f"'{unit}' of column '{column.name}' is taken as a mass: of an acceleration, give its unit "
        "as g_n"
    )
    return column, [note]


def _scaled(values: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """Return values in SI, rounded once: 1.25 um is 1.25e-06 m, and not its neighbour."""
    whole = round(1.0 / factor)
    # a millionth is no float, but a million is
    return values / whole if whole > 1 and 1.0 / whole == factor else values * factor


def _si(column: FileColumn, text: str, given: bool) -> tuple[float, str]:
    """Return what the unit of a column is in SI: as given, as its format says, by its name."""
    if column.si is not None and not given:
        return column.si
    if (meant := gravity_unit(text.strip(), column.name)) is not None:
        return meant
    return measured_unit(text) if text.strip() else (1.0, "")


def _known(text: str) -> tuple[float, str] | None:
    """Return what a unit is in SI, if it is known."""
    try:
        return measured_unit(text)
    except UnitError:
        return None


def _used(raw: FileColumns, wanted: Sequence[str | int] | None) -> set[int]:
    """Return the columns that must be complete: those wanted, or all that hold numbers."""
    if wanted is not None:
        return {number for selector in wanted for number in _asked(raw, selector)[0]}
    return {
        i
        for i, column in enumerate(raw.columns)
        if not _is_text(column) and (column.words is not None or np.isfinite(column.values).any())
    }


def _is_text(column: FileColumn) -> bool:
    """Say whether a column holds text alone, and none that was meant as a number."""
    if column.words is None or np.isfinite(column.values).any():
        return False
    return not any(_LIKE_NUMBER.fullmatch(word) for word in np.unique(column.words) if word)


def _left_out(raw: FileColumns, channels: Sequence[Channel], used: set[int]) -> list[str]:
    """Refuse incomplete columns among those that are used; return notes on the others."""
    incomplete, text = [], []
    for number, (column, channel) in enumerate(zip(raw.columns, channels, strict=True)):
        if number in used:
            require_complete(channel.values, channel.name)
        elif column.words is not None and (column.words != "").any():
            text.append(f"{channel.name} ('{column.words[(column.words != '').argmax()]}')")
        elif not np.isfinite(channel.values).all():
            incomplete.append(channel.name)
    notes = [f"left out, as they hold text: {', '.join(text)}"] if text else []
    if incomplete:
        notes.append(f"incomplete, as it is not used: column {', '.join(incomplete)}")
    return notes


_SUCH = {
    "time": "samples with their times or their rate",
    "point": "a report of a measuring machine, or a table of positions",
    "frequency": "a universal file of frequency responses or spectra",
}


def read_files(
    files: Sequence[Path],
    columns: Sequence[str | int] | None,
    *,
    options: ReadOptions = ReadOptions(),
    over: Literal["time", "point", "frequency", "any", "table"] = "time",
    even: bool = False,
    labels: str | int | None = None,
    partial: Sequence[str | int] = (),
) -> list[Record]:
    """Read files, one record for each.

    `columns` are those that are used (all, where None); `partial` are further ones, which may be
    incomplete. `over` is what the samples must follow one another by: with point, rows of a text
    need no times; with table, times are not looked at. With `even`, uneven times are refused.
    `labels` is the column that labels the rows, with numbers or texts.
    """
    read = []
    for file, how in zip(files, options.of_each(len(files)), strict=True):
        record = read_record(
            file,
            how,
            columns=columns,
            partial=partial,
            over="point" if over in ("point", "table") else "time",
            labels=labels,
        )
        if over not in ("any", "table", record.over):
            raise RecordError(
                f"'{file}' is over {record.over}, and a record over {over} is needed: give "
                f"{_SUCH[over]}"
            )
        if even:
            require_uniform(record)
        read.append(record)
    return read


def format_of(file: Path, wanted: str | None = None) -> str:
    """Return the format of a file: as told (or a suffix), by its first bytes, by its suffix."""
    if wanted is not None:
        suffix = f".{wanted.lower().lstrip('.')}"
        for name, suffixes in FORMATS.items():
            if wanted.lower() == name or suffix in suffixes:
                return name
        raise RecordError(f"the format must be one of {', '.join(FORMATS)}, got '{wanted}'")
    with file.open("rb") as stream:
        head = stream.read(_HEAD)
    suffix = file.suffix.lower()
    for signature, name in _SIGNATURES:
        if head.startswith(signature):
            return name
    if head.startswith(b"PK\x03\x04"):
        return "numpy"
    known = next((name for name, suffixes in FORMATS.items() if suffix in suffixes), "text")
    if known == "matlab" and _is_ascii(head[:64]):
        return "text"
    return _kind_of_text(head) if known == "text" else known


def _is_ascii(head: bytes) -> bool:
    """Say whether a file could be what MATLAB writes by its option -ascii."""
    return bool(head) and all(byte >= 32 or byte in b"\t\r\n" for byte in head) and max(head) < 127


def _kind_of_text(head: bytes) -> str:
    """Return which text a file is, whose suffix does not say more."""
    if is_universal(head):
        return "universal"
    # whole lines, as half a letter would change the encoding
    text = decoded(head if len(head) < _HEAD else head[: (head.rfind(b"\n") + 1) // 2 * 2])
    if is_gcs_array(text):
        return "gcs"
    return "cmm" if has_report(text.splitlines()) else "text"
