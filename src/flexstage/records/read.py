"""Reading a measured file into a record: format, columns, units, time, and the checks."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import RecordError, UnitError
from flexstage.records.columns import Column, Columns
from flexstage.records.hdf5 import read_hdf5
from flexstage.records.matlab import read_matlab
from flexstage.records.numpy_file import read_numpy
from flexstage.records.record import Channel, Record, column_number
from flexstage.records.sampling import require_complete, require_rising, time_jitter
from flexstage.records.tdms import read_tdms
from flexstage.records.text import read_text
from flexstage.units import si_unit

__all__ = ["FORMATS", "read_record"]

#: Suffixes of the formats that `read_record` knows.
FORMATS: dict[str, tuple[str, ...]] = {
    "text": (".csv", ".txt", ".dat", ".tsv", ".asc", ".lvm"),
    "matlab": (".mat",),
    "hdf5": (".h5", ".hdf5", ".hdf"),
    "tdms": (".tdms",),
    "numpy": (".npy", ".npz"),
}

_SIGNATURES = (
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"MATLAB 5.0 MAT-file", "matlab"),
    (b"MATLAB 7.3 MAT-file", "matlab"),
    (b"TDSm", "tdms"),
    (b"\x93NUMPY", "numpy"),
)
_TIME_NAMES = frozenset(("t", "time", "times", "timestamp", "zeit", "x_value"))
# two statements of one sample rate may differ by their printed digits, and by no more
_SAME_RATE = 0.01


def read_record(
    path: str | Path,
    *,
    format: str | None = None,
    sample_rate_hz: float | None = None,
    time: str | int | None = None,
    units: Mapping[str, str] | None = None,
    dataset: str | None = None,
    names: Sequence[str] | None = None,
    columns: Sequence[str | int] | None = None,
    rows: tuple[int | None, int | None] | None = None,
    skip_lines: int = 0,
    delimiter: str | None = None,
    decimal: str | None = None,
) -> Record:
    r"""Read columns of measured data from a file.

    The format is known by the first bytes, then by the suffix. Every column of the file is a
    channel with the number that it has in the file, the time too. Units come from `units`, then
    from the file; a column without one keeps its numbers. Times come from `time`, then from the
    file's own sample rate, then from a column that is called time and says its unit.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    format : {"text", "matlab", "hdf5", "tdms", "numpy"}, optional
        The format, where neither content nor suffix says it.
    sample_rate_hz : float, optional
        Sample rate [Hz] of a file that does not say it.
    time : str or int, optional
        Name or number of the column of time; in seconds, where no unit is said.
    units : Mapping, optional
        Units by name or number of column, ``{"0": "V", "position": "um"}``.
    dataset : str, optional
        Which group, variable or array of a file that holds several; several with commas.
    names : sequence of str, optional
        Names of the columns, in place of those in the file.
    columns : sequence of str or int, optional
        The columns that will be used: only they must be complete. All, where not given.
    rows : tuple of int, optional
        First sample to read and the one before which to stop, either of them None.
    skip_lines : int
        How many lines of a text file to leave out at its start.
    delimiter : str, optional
        What divides the columns of a text file, or tab, comma, semicolon, space.
    decimal : {".", ","}, optional
        The decimal sign of a text file.

    Returns
    -------
    Record
        Channels in SI units, rising times [s], the file's hash, and notes on what was understood.

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
    ...     record = read_record(file, sample_rate_hz=200.0)
    >>> record.channel("pos").values, record.channel("pos").unit
    (array([1.25e-06, 1.50e-06]), 'm')
    """
    file = Path(path)
    try:
        content_hash = _hash(file)
        raw = _read(file, _format(file, format), dataset, skip_lines, delimiter, decimal)
        if names is not None:
            raw = raw.renamed(names)
        raw = _distinct(raw)
        raw = replace(raw, columns=_part(raw.columns, rows), start=raw.start + _offset(raw, rows))
        if not raw.columns or raw.columns[0].values.size < 2:
            raise RecordError("there are fewer than two samples: a record needs at least two")
        channels, notes = _in_si(raw, units or {})
        channels, times, more = _timed(raw, channels, time, sample_rate_hz)
        notes += more + _incomplete(channels, columns)
    except OSError as error:
        raise RecordError(f"'{file}' cannot be read: {error.strerror or error}") from error
    except RecordError as error:
        if str(file) in str(error):
            raise
        raise RecordError(f"'{file}': {error}") from error
    return Record(
        channels=tuple(channels),
        time=times,
        source=str(path),
        source_hash=content_hash,
        notes=(*raw.notes, *notes),
        attributes=dict(raw.attributes),
    )


def _hash(file: Path) -> str:
    if not file.exists():
        raise RecordError(f"there is no file '{file}'")
    if not file.is_file():
        raise RecordError(f"'{file}' is no file: give one file of measured columns")
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _format(file: Path, wanted: str | None) -> str:
    """Return the format: as told, by the first bytes, by the suffix."""
    if wanted is not None:
        suffix = f".{wanted.lower().lstrip('.')}"
        for name, suffixes in FORMATS.items():
            if wanted.lower() == name or suffix in suffixes:
                return name
        raise RecordError(f"the format must be one of {', '.join(FORMATS)}, got '{wanted}'")
    with file.open("rb") as stream:
        head = stream.read(64)
    suffix = file.suffix.lower()
    for signature, name in _SIGNATURES:
        if head.startswith(signature):
            return name
    if head.startswith(b"PK\x03\x04"):
        return "numpy"
    known = next((name for name, suffixes in FORMATS.items() if suffix in suffixes), "text")
    if known == "matlab" and _is_text(head):
        return "text"
    return known


def _is_text(head: bytes) -> bool:
    """Say whether a file could be what MATLAB writes by its option -ascii."""
    return bool(head) and all(byte >= 32 or byte in b"\t\r\n" for byte in head) and max(head) < 127


def _read(
    file: Path,
    known: str,
    dataset: str | None,
    skip_lines: int,
    delimiter: str | None,
    decimal: str | None,
) -> Columns:
    if known == "text":
        if dataset is not None:
            raise RecordError(f"'{file}' is a text file: it has no datasets, leave the option out")
        return read_text(file, skip_lines=skip_lines, delimiter=delimiter, decimal=decimal)
    if skip_lines or delimiter or decimal:
        raise RecordError(
            f"'{file}' is no text file: skip_lines, delimiter and decimal have no meaning for it"
        )
    readers = {"matlab": read_matlab, "hdf5": read_hdf5, "tdms": read_tdms, "numpy": read_numpy}
    return readers[known](file, dataset)


def _distinct(raw: Columns) -> Columns:
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
    note = f"columns of the same name ({', '.join(again)}) are told apart by their number"
    return replace(raw, columns=tuple(columns), notes=(*raw.notes, note))


def _part(
    columns: Sequence[Column], rows: tuple[int | None, int | None] | None
) -> tuple[Column, ...]:
    if rows is None:
        return tuple(columns)
    return tuple(replace(c, values=c.values[slice(*rows)].copy()) for c in columns)


def _offset(raw: Columns, rows: tuple[int | None, int | None] | None) -> float:
    """Return by how much later a part begins, where the file says its rate [s]."""
    if rows is None or raw.sample_rate_hz is None or not raw.columns:
        return 0.0
    return slice(*rows).indices(raw.columns[0].values.size)[0] / raw.sample_rate_hz


def _in_si(raw: Columns, units: Mapping[str, str]) -> tuple[list[Channel], list[str]]:
    """Return the columns in SI units, and what was done."""
    names = [c.name for c in raw.columns]
    said: dict[int, str] = {}
    for selector, unit in units.items():
        number = column_number(names, selector)
        if number in said:
            raise RecordError(f"column '{names[number]}' is given two units: give one")
        said[number] = unit
    channels, notes, found = [], [], []
    for number, column in enumerate(raw.columns):
        text = said.get(number, column.unit)
        try:
            factor, unit = si_unit(text) if text.strip() else (1.0, "")
        except UnitError as error:
            if number in said:
                raise RecordError(f"column '{column.name}': {error}") from error
            notes.append(
                f"'{text}' of column '{column.name}' is no known unit: left as in the file"
            )
            factor, unit = 1.0, ""
        if unit and number not in said:
            found.append(f"{column.name} in {text}")
        if number in said and column.unit and _known(column.unit) != (factor, unit):
            notes.append(
                f"column '{column.name}' says {column.unit!r} in the file, and is read as {text!r}"
            )
        values = column.values if factor == 1.0 else _scaled(column.values, factor)
        channels.append(Channel(name=column.name, values=values, unit=unit))
    if found:
        notes.append(f"units of the file: {', '.join(found)}")
    return channels, notes


def _scaled(values: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """Return values in SI, rounded once: 1.25 um is 1.25e-06 m, and not its neighbour."""
    whole = round(1.0 / factor)
    # a millionth is no float, but a million is
    return values / whole if whole > 1 and 1.0 / whole == factor else values * factor


def _known(text: str) -> tuple[float, str] | None:
    """Return what a unit is in SI, if it is known."""
    try:
        return si_unit(text)
    except UnitError:
        return None


def _timed(
    raw: Columns,
    channels: list[Channel],
    wanted: str | int | None,
    rate: float | None,
) -> tuple[list[Channel], NDArray[np.float64], list[str]]:
    """Return the times, and the channels with the column of time in seconds."""
    if rate is not None and not (np.isfinite(rate) and rate > 0.0):
        raise RecordError(f"the sample rate must be positive, got {rate} Hz")
    names = [c.name for c in channels]
    if wanted is not None:
        number = column_number(names, wanted)
        channels[number], notes = _as_seconds(channels[number])
        times = channels[number].values
        require_rising(times, names[number])
        given = rate if rate is not None else raw.sample_rate_hz
        where = "given" if rate is not None else f"in {raw.rate_source}"
        _require_same_rate(times, given, names[number], where)
        return channels, times, notes + _unevenness(times)
    size = channels[0].values.size
    own = raw.sample_rate_hz
    if rate is not None and own is not None and abs(own / rate - 1.0) > _SAME_RATE:
        raise RecordError(
            f"the sample rate is given as {rate:g} Hz, and {raw.rate_source} of the file says "
            f"{own:g} Hz: leave one out, or mend it"
        )
    called = [
        i for i, c in enumerate(channels) if c.name.lower() in _TIME_NAMES and c.unit in ("s", "")
    ]
    sure = [i for i in called if channels[i].unit == "s"]
    if rate is not None or own is not None:
        used = rate if rate is not None else own
        assert used is not None
        for i in sure:
            if np.isfinite(channels[i].values).all():
                _require_same_rate(channels[i].values, used, names[i], "given")
        source = "as given" if rate is not None else f"from {raw.rate_source} of the file"
        start = raw.start if own is not None else 0.0
        return channels, start + np.arange(size) / used, [f"sample rate {used:g} Hz, {source}"]
    number = _own_time(names, sure)
    if number is not None:
        times = channels[number].values
        require_rising(times, names[number])
        return channels, times, [f"times from column '{names[number]}'", *_unevenness(times)]
    raise RecordError(_no_time(raw, names, called))


def _own_time(names: Sequence[str], sure: Sequence[int]) -> int | None:
    """Return the only column of time, or the one that is called just so among several."""
    exact = [i for i in sure if names[i] == "time"]
    found = exact or list(sure)
    return found[0] if len(found) == 1 else None


def _no_time(raw: Columns, names: Sequence[str], called: Sequence[int]) -> str:
    hint = raw.hint
    if called and not hint:
        listed = " or ".join(f"'{names[i]}'" for i in called)
        hint = f"; column {listed} may be it: choose it by time"
    return (
        "the file does not say when its samples were taken: give the sample rate, or the column of "
        f"time (columns: {', '.join(f'{i}: {n}' for i, n in enumerate(names[:20]))}){hint}"
    )


def _as_seconds(channel: Channel) -> tuple[Channel, list[str]]:
    """Return a column that was chosen as time, in seconds."""
    if channel.unit == "":
        return replace(channel, unit="s"), [
            f"times from column '{channel.name}', which has no unit: taken as seconds"
        ]
    if channel.unit != "s":
        raise RecordError(
            f"column '{channel.name}' is in {channel.unit}, and cannot be the time: choose "
            "another, or say its unit, s or ms"
        )
    return channel, [f"times from column '{channel.name}'"]


def _require_same_rate(
    times: NDArray[np.float64], rate: float | None, name: str, where: str
) -> None:
    if rate is None or times.size < 2:
        return
    span = float(times[-1] - times[0])
    found = (times.size - 1) / span if span > 0.0 else np.inf
    if abs(found / rate - 1.0) > _SAME_RATE:
        raise RecordError(
            f"the sample rate {rate:g} Hz ({where}) and the times in column '{name}', whose mean "
            f"rate is {found:g} Hz, conflict: leave one out, or say the unit of the time (s or ms)"
        )


def _unevenness(times: NDArray[np.float64]) -> list[str]:
    jitter = time_jitter(times)
    if jitter <= 1e-3:
        return []
    return [f"steps of time differ from their mean by up to {100.0 * jitter:.3g} %"]


def _incomplete(channels: Sequence[Channel], wanted: Sequence[str | int] | None) -> list[str]:
    """Refuse incomplete columns among those that are wanted; return a note on the others."""
    names = [c.name for c in channels]
    used = (
        set(range(len(names)))
        if wanted is None
        else {column_number(names, selector) for selector in wanted}
    )
    incomplete = []
    for number, channel in enumerate(channels):
        if number in used:
            require_complete(channel.values, channel.name)
        elif not np.isfinite(channel.values).all():
            incomplete.append(channel.name)
    return [f"incomplete, as it is not used: column {', '.join(incomplete)}"] if incomplete else []
