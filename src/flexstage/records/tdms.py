"""TDMS files of LabVIEW."""

import contextlib
import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import RecordError
from flexstage.lazy import require_extra
from flexstage.records.columns import FileColumns
from flexstage.records.datasets import StoredArray, Tree, chosen_columns, reading

_UNITS = ("unit_string", "NI_UnitDescription", "unit")


def read_tdms(path: Path, dataset: str | None = None) -> FileColumns:
    """Read the columns of a TDMS file.

    `dataset` is a group, ``run1``, or channels, ``run1/drive,run1/position``. Their properties
    ``wf_increment`` and ``wf_start_offset`` give the times.
    """
    require_extra("labview", "nptdms", "a TDMS file of LabVIEW", RecordError)
    from nptdms import TdmsFile

    with (
        reading(path, "a TDMS"),
        _quiet(),
        path.open("rb") as stream,
        TdmsFile.open(stream) as file,
    ):
        if file.file_status.incomplete_final_segment:
            raise RecordError(
                f"'{path}' was not written to its end: open and save it in LabVIEW, or record "
                "it again"
            )
        return chosen_columns(_tree(file, path.stat().st_size), dataset)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the library from writing to the terminal what is said by an error here."""
    from nptdms.log import log_manager

    level = log_manager.log_level
    log_manager.set_level(logging.CRITICAL)
    try:
        yield
    finally:
        log_manager.set_level(level)


def _tree(file: Any, file_size: int) -> Tree:
    tree = Tree(file_size=file_size)
    tree.texts = {str(k): str(v) for k, v in file.properties.items()}
    for group in file.groups():
        tree.texts |= {f"{group.name}/{k}": str(v) for k, v in group.properties.items()}
        tree.leaves += [_leaf(group.name, channel) for channel in group.channels() if len(channel)]
    return tree


def _leaf(group: str, channel: Any) -> StoredArray:
    properties = channel.properties
    interval = _number(properties.get("wf_increment"))
    return StoredArray(
        parent=group,
        name=channel.name,
        shape=(len(channel),),
        kind=np.dtype(channel.dtype).kind,
        load=_load(channel),
        unit=next((str(properties[u]).strip() for u in _UNITS if properties.get(u)), ""),
        interval=interval if interval > 0.0 else None,
        start=_number(properties.get("wf_start_offset")),
    )


def _load(channel: Any) -> Callable[[], NDArray]:
    return lambda: np.asarray(channel[:])


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float | np.number) else 0.0
