"""Export of a record: CSV, NumPy, HDF5 and MATLAB, all of which `read_record` reads back."""

import csv
import io
import re
from collections.abc import Container, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage.base.errors import RecordError
from flexstage.files.write import write_whole
from flexstage.records.record import SIMULATED, Channel, Record
from flexstage.records.text_rows import COMMENT_MARKS

_SUFFIXES = {".csv": "csv", ".npz": "npz", ".h5": "hdf5", ".hdf5": "hdf5", ".mat": "mat"}
_RESERVED = frozenset(("units", "names", SIMULATED))


def record_bytes(record: Record, format: str) -> bytes:
    r"""Return a record as the content of a file.

    Columns, names and units are written exactly; the time is a column ``time`` in seconds, first
    unless the record already has this column. A record over points has no such column, and is read
    back as ``over="point"``. Equal records give equal bytes.

    Validity
    --------
    Of notes and attributes only that of a simulation is written. Line breaks in names become
    spaces.

    Examples
    --------
    >>> t = np.array([0.0, 0.005])
    >>> r = Record(channels=(Channel(name="drive", values=t * 20.0, unit="V"),), time=t)
    >>> print(record_bytes(r, "csv").decode().replace("\r", ""), end="")
    time (s),drive (V)
    0.0,0.0
    0.005,0.1
    """
    writers = {"csv": _csv, "npz": _npz, "hdf5": _hdf5, "mat": _mat}
    if format not in writers:
        raise RecordError(f"the format must be one of {', '.join(writers)}, got '{format}'")
    return writers[format](_with_time(record), record.attributes.get(SIMULATED, ""))


def write_record(record: Record, path: str | Path) -> Path:
    """Write a record to a file, atomically; the suffix selects the format.

    Parameters
    ----------
    record : Record
        The record.
    path : str or pathlib.Path
        The file: .csv, .npz, .h5, .hdf5 or .mat.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    RecordError
        The suffix is unknown, or the file cannot be written.
    """
    target = Path(path)
    format = _SUFFIXES.get(target.suffix.lower())
    if format is None:
        raise RecordError(
            f"'{target.name}' must end in one of {', '.join(_SUFFIXES)}: the suffix selects the "
            "format"
        )
    content = record_bytes(record, format)
    write_whole(target, content, RecordError)
    return target


def _with_time(record: Record) -> tuple[Channel, ...]:
    """Return the columns, the time among them."""
    if record.over == "frequency":
        raise RecordError(
            "a record over frequency cannot be written, as these formats do not identify it: keep "
            "its source file"
        )
    if record.over == "point":
        return record.channels
    time_columns = [c for c in record.channels if c.name == "time"]
    if not time_columns:
        return (Channel(name="time", values=record.time, unit="s"), *record.channels)
    same = [c for c in time_columns if c.unit == "s" and np.array_equal(c.values, record.time)]
    if len(time_columns) == len(same) == 1:
        return record.channels
    raise RecordError(
        "the record has a column 'time' that is not its time, but would be read as time: rename it"
    )


def _csv(channels: tuple[Channel, ...], simulated: str) -> bytes:
    stream = io.StringIO()
    if simulated:
        stream.write(f"# {SIMULATED}: {simulated}\r\n")
    stream.write(",".join(map(_quoted, channels)) + "\r\n")
    writer = csv.writer(stream)
    # the shortest digits that give the same bits
    writer.writerows(zip(*(map(repr, c.values.tolist()) for c in channels), strict=True))
    return stream.getvalue().encode("utf-8", "replace")


def file_label(name: str, unit: str) -> str:
    """Return the name of a column on one line, without a text that would be read as a unit."""
    name = " ".join(re.sub(r"[\x00-\x1f]", " ", name).split())
    # empty brackets prevent a bracket in the name from being read as a unit
    return f"{name} []" if not unit and re.search(r"[)\]]$| / ", name) else name


def _label(channel: Channel) -> str:
    return file_label(channel.name, channel.unit)


def _quoted(channel: Channel) -> str:
    """Return the heading of a column of CSV."""
    heading = f"{_label(channel)} ({channel.unit})" if channel.unit else _label(channel)
    # a heading that begins like a comment, or contains a delimiter, needs quotes
    if re.search('[",;\t]', heading) or heading.startswith(COMMENT_MARKS):
        heading = '"' + heading.replace('"', '""') + '"'
    return heading


def file_keys(names: Iterable[str], reserved: Container[str]) -> list[str]:
    """Return a portable name for each column that is not reserved."""
    keys: list[str] = []
    for name in names:
        word = re.sub(r"\W", "_", name, flags=re.ASCII)[:40]
        word = word if word[:1].isalpha() else f"c_{word}"
        key, number = word, 1
        while key in keys or key in reserved:
            number += 1
            key = f"{word}_{number}"
        keys.append(key)
    return keys


def _keys(channels: tuple[Channel, ...]) -> list[str]:
    return file_keys((c.name for c in channels), _RESERVED)


def _npz(channels: tuple[Channel, ...], simulated: str) -> bytes:
    stream = io.BytesIO()
    arrays: dict[str, NDArray] = {SIMULATED: np.array(simulated)} if simulated else {}
    for key, channel in zip(_keys(channels), channels, strict=True):
        arrays[key] = channel.values
        arrays[f"names/{key}"] = np.array(_label(channel))
        arrays[f"units/{key}"] = np.array(channel.unit)
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    return stream.getvalue()


def _hdf5(channels: tuple[Channel, ...], simulated: str) -> bytes:
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w", track_order=True) as file:
        if simulated:
            file.attrs[SIMULATED] = simulated
        for key, channel in zip(_keys(channels), channels, strict=True):
            dataset = file.create_dataset(key, data=channel.values, track_times=False)
            dataset.attrs["name"] = _label(channel)
            dataset.attrs["unit"] = channel.unit
    return stream.getvalue()


def _mat(channels: tuple[Channel, ...], simulated: str) -> bytes:
    from scipy.io import savemat

    keys = _keys(channels)
    content: dict[str, object] = {
        key: channel.values for key, channel in zip(keys, channels, strict=True)
    }
    if simulated:
        content[SIMULATED] = simulated
    content["units"] = {key: c.unit for key, c in zip(keys, channels, strict=True)}
    content["names"] = {key: _label(c) for key, c in zip(keys, channels, strict=True)}
    stream = io.BytesIO()
    savemat(stream, content, oned_as="column", long_field_names=True, do_compression=True)
    # the first 116 bytes are a text with the time of day, which would differ for equal records
    data = bytearray(stream.getvalue())
    data[:116] = b"MATLAB 5.0 MAT-file, a record of flexstage".ljust(116)
    return bytes(data)
