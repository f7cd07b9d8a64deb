"""Files of NumPy: one array, or an archive of several."""

import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import RecordError
from flexstage.records.columns import FileColumns
from flexstage.records.datasets import (
    Tree,
    chosen_columns,
    reading,
    require_unpacked,
)


def read_numpy(path: Path, dataset: str | None = None) -> FileColumns:
    """Read the columns of a NumPy file, ``.npy`` or ``.npz``.

    `dataset` names arrays of an archive, ``u,y``. The fields of a structured array are columns with
    their names.

    Pickled objects are never loaded, as that would run what the file says.
    """
    with reading(path, "a NumPy"):
        try:
            arrays = _arrays(path)
        except ValueError as error:
            if "pickle" not in str(error):
                raise
            raise RecordError(
                f"'{path}' is pickled, which is not loaded, as that would run what it says: save "
                "plain arrays of numbers"
            ) from error
        return chosen_columns(_tree(arrays, path.stat().st_size), dataset)


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
            f"'{path}' is an archive of other files than NumPy's, such as a workbook: save the "
            "columns as CSV"
        )
    require_unpacked(size, path.stat().st_size, f"'{path}'")
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def _tree(arrays: dict[str, NDArray], file_size: int) -> Tree:
    tree = Tree(file_size=file_size)
    for path, array in arrays.items():
        parent, _, name = path.rpartition("/")
        # the fields of a lone array are columns by their own names
        tree.add(parent, name or ("" if array.dtype.names is not None else "column"), array)
    return tree
