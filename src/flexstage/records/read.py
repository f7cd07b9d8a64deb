"""Reading of measured files into records: format, columns, units, time and checks."""

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
from flexstage.records.matlab import read_matlab
from flexstage.records.read_options import ReadOptions, TextLayout
from flexstage.records.record import SIMULATED, Channel, Record, column_and_unit, column_number
from flexstage.records.sampling import (
    LARGEST_STEP,
    LARGEST_UNEVEN_STEP,
    require_complete,
    require_uniform,
    resample_uniform,
    timed,
)
from flexstage.records.text import is_gcs_array, read_gcs_array, read_text
from flexstage.records.text_rows import decoded
from flexstage.records.universal_file import read_universal
from flexstage.records.universal_sets import is_universal

#: Suffixes of the formats of `read_record`; reports of measuring machines have none.
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
# bytes to examine: enough for the preamble of a report
_HEAD = 65_536

# with thousands separators, two decimal signs, or an unknown one
_LIKE_NUMBER = re.compile(r"(?!\d\d?\.\d\d?\.\d{2,4}$)[+-]?[\d.,' ]+([eE][+-]?\d+)?")


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
    **fields: Any,
) -> Record:
    r"""Read columns of measured data from a file.

    The format follows from the first bytes, then from the suffix. Every column of the file,
    including the time, is a channel with the number that it has in the file. Units come from
    `units`, or from the text after a selected column, ``"2 um"``, then from the file; a column
    without unit keeps its numbers. Times come from `time`, then from the sample rate in the file,
    then from a column called time with a unit. A file of frequency responses, and a report of a
    measuring machine, has no times, see `Record.over`.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    options : ReadOptions, optional
        Rate, time, rows and format, if the file does not state them.
    units : Mapping, optional
        Units by name or number of column, ``{"0": "V", "position": "um"}``; ``"length"`` selects
        all lengths of a measuring machine, the name of a complex function both its parts.
    names : sequence of str, optional
        Names of the columns, in place of those in the file.
    columns : sequence of str or int, optional
        The used columns: only these must be complete. By default all except text columns, whose
        values are NaN.
    partial : sequence of str or int, optional
        Further columns, which may be incomplete.
    over : {"time", "point"}
        Independent variable of the rows, if the file does not state it: time, or their number.
    largest_step : float, optional
        Longest step of a column of time that is no gap, over the median step.
    labels : str or int, optional
        A column that labels the rows: texts in it are numbered as they first appear.
    **fields
        Fields of `ReadOptions`, in place of those of `options`.

    Returns
    -------
    Record
        Channels in SI units, rising times [s], the hash of the file, and notes. For functions in a
        universal file, ``output of NAME``, ``input of NAME``, ``output unit of NAME``, ``input unit
        of NAME`` and ``kind of NAME`` are attributes.

    Validity
    --------
    Units convert to SI by a factor: logarithmic units (dB) are unknown, and a temperature in
    degrees Celsius remains so. Numbers are double precision.

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
    file, options = Path(path), request_of(ReadOptions, options, fields)
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
            raise RecordError("a record needs at least two samples")
        if labels is not None:
            raw = raw.numbered(column_number([c.name for c in raw.columns], labels))
        used = _used(raw, columns)
        for number in sorted(used):
            raw.require_numbers(number)
        timed_by = () if options.time is None else (options.time,)
        user_units = _user_units(raw, (*(columns or ()), *partial, *timed_by), units or {})
        channels, notes = _in_si(raw, user_units, _accelerations(raw, file))
        kind = _kind(raw, over, options)
        if kind == "time":
            if largest_step is None:
                largest_step = LARGEST_UNEVEN_STEP if options.resample else LARGEST_STEP
            channels, times, time_notes = timed(
                raw, channels, options.time, options.rate, largest_step
            )
            notes += time_notes
        else:
            size = raw.columns[0].values.size
            times = np.arange(size, dtype=np.float64) if raw.axis is None else raw.axis
        notes += _unused_notes(raw, channels, used)
        # a run marks its records by yes, and reports it
        if (simulated := raw.attributes.get(SIMULATED, "no")) not in ("no", "yes"):
            notes.append(f"'{file.name}' was not measured but simulated: {simulated}")
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
            f"'{record.source}' is over {kind}, but --resample is for samples over time: omit it"
        )
    return resample_uniform(record, options.resample[0])


def _hash(file: Path) -> str:
    if not file.exists():
        raise RecordError(f"there is no file '{file}'")
    if not file.is_file():
        raise RecordError(f"'{file}' is not a file: give a file of measured columns")
    return file_hash(file)


def _read(file: Path, format_name: str, options: ReadOptions) -> FileColumns:
    dataset, layout = options.dataset, options.text
    if format_name in ("text", "gcs") and dataset is not None:
        raise RecordError(f"'{file}' is a text file without datasets: omit the option dataset")
    if format_name == "text":
        return read_text(file, layout)
    if format_name == "cmm":
        return read_coordinates(file, dataset, layout)
    if layout != TextLayout():
        raise RecordError(
            f"'{file}' is not a text file of columns: --text does not apply to it, omit it"
        )
    if format_name == "gcs":
        return read_gcs_array(file)
    readers = {
        "matlab": read_matlab,
        "hdf5": read_hdf5,
        "tdms": read_tdms,
        "numpy": read_numpy,
        "universal": read_universal,
    }
    return readers[format_name](file, dataset)


def _distinct(raw: FileColumns) -> FileColumns:
    """Number columns that have the same name."""
    names = [c.name for c in raw.columns]
    repeated = (
        sorted({n for n in names if names.count(n) > 1}) if len(set(names)) < len(names) else []
    )
    if not repeated:
        return raw
    used = set(names)
    columns = []
    for number, column in enumerate(raw.columns):
        name = column.name
        if name in repeated:
            name = f"{name} #{number}"
            while name in used:
                name += "'"
            used.add(name)
        columns.append(replace(column, name=name))
    note = f"columns of the same name ({', '.join(repeated)}) are distinguished by their number"
    return replace(raw, columns=tuple(columns), notes=(*raw.notes, note))


def _kind(
    raw: FileColumns, requested: str, options: ReadOptions
) -> Literal["time", "frequency", "point"]:
    """Return the independent variable of the samples, of the file or else the requested one."""
    if requested not in ("time", "point"):
        raise RecordError(f"rows must be over time or point, got {requested!r}")
    kind = raw.over
    if kind == "time" and requested == "point" and raw.sample_rate_hz is None:
        kind = "point"
    if kind != "time" and (options.time is not None or options.sample_rate):
        why = "its rows are points" if kind == "point" else "it is over frequency"
        raise RecordError(f"{why}, without times: omit sample rate and time column")
    return kind


def _selected_columns(raw: FileColumns, selector: str | int) -> tuple[tuple[int, ...], str]:
    """Return the columns of a name or number, and the unit after it."""
    if (text := str(selector).strip()) in raw.groups:
        return raw.groups[text], ""
    group, _, unit = text.partition(" ")
    if unit and group in raw.groups:
        return raw.groups[group], unit.strip()
    number, unit = column_and_unit([c.name for c in raw.columns], selector)
    return (number,), unit


def _user_units(
    raw: FileColumns, columns: Sequence[str | int], units: Mapping[str, str]
) -> dict[int, str]:
    """Return the units that the user gave to columns, after their names or in `units`."""
    by_name = [(_selected_columns(raw, column)[0], unit, False) for column, unit in units.items()]
    after_name = [(*_selected_columns(raw, column), True) for column in columns]
    user_units: dict[int, str] = {}
    for numbers, unit, again in (*by_name, *after_name):
        for number in numbers if unit else ():
            if number in user_units and not (again and user_units[number] == unit):
                raise RecordError(f"column '{raw.columns[number].name}' has two units: give one")
            user_units[number] = unit
    return user_units


def _accelerations(raw: FileColumns, file: Path) -> str:
    """Return the evidence that a file is of accelerations, other than its column; else empty."""
    if raw.attributes.get("heading", "").startswith("LabVIEW Measurement"):
        return "as the file is an acquisition by LabVIEW"
    for column in raw.columns:
        if is_acceleration(column.name) or column.unit == "m/s^2":
            return f"as in column '{column.name}'"
    return "by the name of the file" if is_acceleration(file.stem) else ""


def _in_si(
    raw: FileColumns, user_units: Mapping[int, str], accelerations: str
) -> tuple[list[Channel], list[str]]:
    """Return the columns in SI units, by units of the user or of the file, and notes."""
    channels, notes, file_units = [], [], []
    for number, column in enumerate(raw.columns):
        text = user_units.get(number, column.unit)
        source = column
        if column.si is None and text.strip() in GRAVITY and number not in user_units:
            source, note = _gravity_or_gram(column, accelerations)
            notes += note
        try:
            factor, unit = _si(source, text, number in user_units)
        except UnitError as error:
            if number in user_units:
                raise RecordError(f"column '{column.name}': {error}") from error
            notes.append(f"unknown unit '{text}' of column '{column.name}': values as in the file")
            factor, unit = 1.0, ""
        if unit and number not in user_units:
            file_units.append(f"{column.name} in {text}")
        differs = (column.si or _si_or_none(column.unit)) != (factor, unit)
        if number in user_units and column.unit and differs:
            notes.append(
                f"column '{column.name}' is in {column.unit!r} in the file, but read as {text!r}"
            )
        values = column.values if factor == 1.0 else _scaled(column.values, factor)
        channels.append(Channel(name=column.name, values=values, unit=unit, texts=column.texts))
    if file_units:
        notes.append(f"units of the file: {', '.join(file_units)}")
    return channels, notes


def _gravity_or_gram(column: FileColumn, accelerations: str) -> tuple[FileColumn, list[str]]:
    """Return a column in g with the meaning of its unit, and a note if that was assumed."""
    unit = column.unit.strip()
    if gravity_unit(unit, "") is not None:
        return column, []
    because = "by its name" if is_acceleration(column.name) else accelerations
    if because:
        note = (
            f"'{unit}' of column '{column.name}' is taken as the acceleration of gravity, "
            f"{because}: for a mass, give the unit gram"
        )
        return replace(column, si=(GRAVITY[unit], "m/s^2")), [note]
    if _si_or_none(unit) is None:
        return column, []
    note = (
        f"'{unit}' of column '{column.name}' is taken as a mass: for an acceleration, give the "
        "unit g_n"
    )
    return column, [note]


def _scaled(values: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """Return values in SI with one rounding, so that 1.25 um is 1.25e-06 m."""
    divisor = round(1.0 / factor)
    # a millionth is not exact in binary, but a million is
    return values / divisor if divisor > 1 and 1.0 / divisor == factor else values * factor


def _si(column: FileColumn, text: str, by_user: bool) -> tuple[float, str]:
    """Return factor and SI unit of a column: by the user, by its format, or by its name."""
    if column.si is not None and not by_user:
        return column.si
    if (gravity := gravity_unit(text.strip(), column.name)) is not None:
        return gravity
    return measured_unit(text) if text.strip() else (1.0, "")


def _si_or_none(text: str) -> tuple[float, str] | None:
    """Return factor and SI unit of a unit; None if it is unknown."""
    try:
        return measured_unit(text)
    except UnitError:
        return None


def _used(raw: FileColumns, selected: Sequence[str | int] | None) -> set[int]:
    """Return the columns that must be complete: the selected ones, or all with numbers."""
    if selected is not None:
        return {number for selector in selected for number in _selected_columns(raw, selector)[0]}
    return {
        i
        for i, column in enumerate(raw.columns)
        if not _is_text(column) and (column.words is not None or np.isfinite(column.values).any())
    }


def _is_text(column: FileColumn) -> bool:
    """Return whether a column contains only text that is not like a number."""
    if column.words is None or np.isfinite(column.values).any():
        return False
    return not any(_LIKE_NUMBER.fullmatch(word) for word in np.unique(column.words) if word)


def _unused_notes(raw: FileColumns, channels: Sequence[Channel], used: set[int]) -> list[str]:
    """Refuse incomplete used columns; return notes on incomplete other columns."""
    incomplete, text = [], []
    for number, (column, channel) in enumerate(zip(raw.columns, channels, strict=True)):
        if number in used:
            require_complete(channel.values, channel.name)
        elif column.words is not None and (column.words != "").any():
            text.append(f"{channel.name} ('{column.words[(column.words != '').argmax()]}')")
        elif not np.isfinite(channel.values).all():
            incomplete.append(channel.name)
    notes = [f"skipped columns with text: {', '.join(text)}"] if text else []
    if incomplete:
        notes.append(f"incomplete columns that are not used: {', '.join(incomplete)}")
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

    `columns` are the used columns (None for all); `partial` are further ones, which may be
    incomplete. `over` is the required independent variable: with point, rows of a text need no
    times; with table, times are ignored. With `even`, non-uniform times are refused. `labels` is
    the column with labels of the rows, numbers or texts.
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


def format_of(file: Path, requested: str | None = None) -> str:
    """Return the format of a file: by request, by its first bytes, or by its suffix."""
    if requested is not None:
        suffix = f".{requested.lower().lstrip('.')}"
        for name, suffixes in FORMATS.items():
            if requested.lower() == name or suffix in suffixes:
                return name
        raise RecordError(f"the format must be one of {', '.join(FORMATS)}, got '{requested}'")
    with file.open("rb") as stream:
        head = stream.read(_HEAD)
    suffix = file.suffix.lower()
    for signature, name in _SIGNATURES:
        if head.startswith(signature):
            return name
    if head.startswith(b"PK\x03\x04"):
        return "numpy"
    kind = next((name for name, suffixes in FORMATS.items() if suffix in suffixes), "text")
    if kind == "matlab" and _is_ascii(head[:64]):
        return "text"
    return _kind_of_text(head) if kind == "text" else kind


def _is_ascii(head: bytes) -> bool:
    """Return whether a file may be text, as MATLAB writes with its option -ascii."""
    return bool(head) and all(byte >= 32 or byte in b"\t\r\n" for byte in head) and max(head) < 127


def _kind_of_text(head: bytes) -> str:
    """Return the format of a text file, by its first lines."""
    if is_universal(head):
        return "universal"
    # whole lines, as half a letter would change the encoding
    text = decoded(head if len(head) < _HEAD else head[: (head.rfind(b"\n") + 1) // 2 * 2])
    if is_gcs_array(text):
        return "gcs"
    return "cmm" if has_report(text.splitlines()) else "text"
