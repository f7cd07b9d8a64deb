"""Columns of NumPy, TDMS and HDF5 files."""

import contextlib
import logging
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexstage.base.errors import RecordError
from flexstage.base.lazy import require_extra
from flexstage.records.columns import FileColumns
from flexstage.records.datasets import (
    StoredArray,
    Tree,
    chosen_columns,
    reading,
    require_unpacked,
)


def read_numpy(path: Path, dataset: str | None = None) -> FileColumns:
    """Read the columns of a NumPy file, ``.npy`` or ``.npz``.

    `dataset` names arrays of an archive, ``u,y``. The fields of a structured array are columns with
    their names.

    Pickled objects are never loaded, as they could run code.
    """
    with reading(path, "a NumPy"):
        try:
            arrays = _arrays(path)
        except ValueError as error:
            if "pickle" not in str(error):
                raise
            raise RecordError(
                f"'{path}' is pickled, which is never loaded, as it could run code: save plain "
                "arrays of numbers"
            ) from error
        return chosen_columns(_numpy_tree(arrays, path.stat().st_size), dataset)


def _arrays(path: Path) -> dict[str, NDArray]:
    with path.open("rb") as stream:
        archive = stream.read(2) == b"PK"
        if not archive:
            stream.seek(0)
            array = np.load(stream, allow_pickle=False)
            return {"": array}
    with zipfile.ZipFile(path) as content:
        size = sum(item.file_size for item in content.infolist())
        names = content.namelist()
    if any(not name.endswith(".npy") for name in names):
        raise RecordError(
            f"'{path}' is an archive of files other than NumPy's, such as a workbook: save the "
            "columns as CSV"
        )
    require_unpacked(size, path.stat().st_size, f"'{path}'")
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def _numpy_tree(arrays: dict[str, NDArray], file_size: int) -> Tree:
    tree = Tree(file_size=file_size)
    for path, array in arrays.items():
        parent, _, name = path.rpartition("/")
        # the fields of a lone array are columns by their own names
        tree.add(parent, name or ("" if array.dtype.names is not None else "column"), array)
    return tree


_UNITS = ("unit_string", "NI_UnitDescription", "unit")


def read_tdms(path: Path, dataset: str | None = None) -> FileColumns:
    """Read the columns of a TDMS file.

    `dataset` names a group, ``run1``, or channels, ``run1/drive,run1/position``. Their properties
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
                f"'{path}' is incomplete: open and save it in LabVIEW, or record it again"
            )
        return chosen_columns(_tdms_tree(file, path.stat().st_size), dataset)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Suppress messages of the library that errors report here."""
    from nptdms.log import log_manager

    level = log_manager.log_level
    log_manager.set_level(logging.CRITICAL)
    try:
        yield
    finally:
        log_manager.set_level(level)


def _tdms_tree(file: Any, file_size: int) -> Tree:
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


_DEEPEST = 12
_MOST = 20_000


def read_hdf5(path: Path, dataset: str | None = None) -> FileColumns:
    """Read the columns of an HDF5 file.

    `dataset` names a group, ``run1``, or datasets, ``run1/u,run1/y``. Attributes ``unit`` and
    ``name`` of a dataset are its unit and heading.
    """
    import h5py

    with reading(path, "an HDF5", ": is it complete?"), h5py.File(str(path), "r") as file:
        tree = Tree(file_size=path.stat().st_size)
        _Walk(tree, matlab="MATLAB_class" in _attribute_names(file)).group("", file, 0)
        return chosen_columns(tree, dataset)


def _attribute_names(file: Any) -> set[str]:
    return {name for key in file for name in _attributes(file.get(key))}


def _attributes(thing: Any) -> dict[str, Any]:
    return dict(thing.attrs) if thing is not None else {}


class _Walk:
    """Gathers the datasets of a file, without their numbers."""

    def __init__(self, tree: Tree, *, matlab: bool) -> None:
        self.tree = tree
        self.matlab = matlab

    def group(self, path: str, group: Any, depth: int) -> None:
        import h5py

        self._describe(path, group)
        for name in group:
            # a soft or external link may be circular, or lead out of the file
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue
            thing = group[name]
            if isinstance(thing, h5py.Group):
                if depth < _DEEPEST and not name.startswith("#"):
                    self.group(f"{path}/{name}" if path else name, thing, depth + 1)
            elif isinstance(thing, h5py.Dataset) and len(self.tree.leaves) < _MOST:
                self._dataset(path, name, thing)

    def _describe(self, path: str, thing: Any) -> None:
        """Keep what the attributes of a group say."""
        for key, value in _attributes(thing).items():
            where = f"{path}/{key}" if path else key
            text = _text(value)
            if text is not None:
                self.tree.texts[where] = text
            elif np.size(value) == 1 and np.asarray(value).dtype.kind in "biuf":
                self.tree.numbers[where] = float(np.asarray(value).reshape(-1)[0])

    def _dataset(self, parent: str, name: str, dataset: Any) -> None:
        path = f"{parent}/{name}" if parent else name
        attributes = _attributes(dataset)
        if dataset.shape is None or "MATLAB_empty" in attributes or dataset.size == 0:
            return
        if _text(attributes.get("MATLAB_class")) == "char" and dataset.size < 10_000:
            self.tree.texts[path] = "".join(chr(code) for code in np.asarray(dataset).reshape(-1))
            return
        if dataset.dtype.names is not None and set(dataset.dtype.names) != {"real", "imag"}:
            for field in dataset.dtype.names:
                self._leaf(path, field, dataset, dataset.dtype[field].kind, _field(dataset, field))
            return
        kind = "c" if dataset.dtype.names is not None else dataset.dtype.kind
        if dataset.size == 1:
            value = dataset[()]
            text = _text(value)
            if text is not None:
                self.tree.texts[path] = text
            elif kind in "biuf":
                self.tree.numbers[path] = float(np.asarray(value).reshape(-1)[0])
            return
        self._leaf(parent, name, dataset, kind, _loader(dataset, turned=self.matlab))

    def _leaf(
        self, parent: str, name: str, dataset: Any, kind: str, load: Callable[[], NDArray]
    ) -> None:
        attributes = _attributes(dataset)
        unit = _text(attributes.get("unit", attributes.get("units"))) or ""
        label = _text(attributes.get("name", attributes.get("long_name"))) or ""
        is_field = dataset.dtype.names is not None and kind != "c"
        shape = tuple(dataset.shape)
        self.tree.leaves.append(
            StoredArray(
                parent=parent,
                name=name,
                shape=shape[::-1] if self.matlab else shape,
                kind=kind,
                load=load,
                label="" if is_field else label,
                unit="" if is_field else unit,
            )
        )


def _loader(dataset: Any, *, turned: bool) -> Callable[[], NDArray]:
    def load() -> NDArray:
        array = np.asarray(dataset[()])
        if array.dtype.names is not None:
            # MATLAB's complex numbers
            array = array["real"] + 1j * array["imag"]
        # MATLAB writes the first index as the one that runs fastest
        return array.T if turned else array

    return load


def _field(dataset: Any, name: str) -> Callable[[], NDArray]:
    return lambda: np.asarray(dataset[name])


def _text(value: Any) -> str | None:
    """Return an attribute as text, if it is one."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value if isinstance(value, str) else None
