"""Files of MATLAB: versions 4 to 7 here, version 7.3 as the HDF5 file that it is."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.errors import RecordError
from flexstage.records.columns import FileColumns
from flexstage.records.datasets import StoredArray, Tree, chosen_columns
from flexstage.records.hdf5 import read_hdf5
from flexstage.records.matlab_structure import require_sound

_HDF5 = b"\x89HDF\r\n\x1a\n"
_DEEPEST = 12
_MOST_ITEMS = 200


def read_matlab(path: Path, dataset: str | None = None) -> FileColumns:
    """Read the columns of a MATLAB file, of any version.

    `dataset` is variables, ``data.u,data.y``, or a structure, ``data``.
    """
    with path.open("rb") as stream:
        head = stream.read(520)
    if _HDF5 in (head[:8], head[512:520]):
        return read_hdf5(path, dataset)
    from scipy.io import loadmat
    from scipy.io.matlab import matfile_version

    try:
        with warnings.catch_warnings(), path.open("rb") as stream:
            # the version that the reader below goes by, whatever the text at the start says
            if matfile_version(stream)[0] != 0:
                stream.seek(0)
                require_sound(stream.read())
            stream.seek(0)
            # it warns of a variable that it cannot read, which is missing then and said to be
            warnings.simplefilter("ignore")
            variables = loadmat(stream, struct_as_record=True, chars_as_strings=True)
    except RecordError as error:
        raise RecordError(f"'{path}': {error}") from error
    except Exception as error:  # a damaged file makes nearly any error there
        raise RecordError(
            f"'{path}' cannot be read as a MATLAB file ({_first_line(error)}): save it again"
        ) from error
    walk = _Walk()
    for name, value in variables.items():
        if not name.startswith("__"):
            walk.visit("", name, value, 0)
    tree = Tree(
        leaves=tuple(walk.leaves),
        numbers=walk.numbers,
        texts=walk.texts,
        file_size=path.stat().st_size,
    )
    if walk.unread and not any(leaf.usable for leaf in tree.leaves):
        raise RecordError(
            f"'{path}' holds objects that only MATLAB reads ({', '.join(walk.unread)}): save their "
            "columns as plain arrays"
        )
    return chosen_columns(tree, dataset)


def _first_line(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return (text[0] if text else type(error).__name__)[:120]


class _Walk:
    """Gathers the arrays, numbers and texts of nested structures and cells."""

    def __init__(self) -> None:
        self.leaves: list[StoredArray] = []
        self.numbers: dict[str, float] = {}
        self.texts: dict[str, str] = {}
        self.unread: list[str] = []

    def visit(self, parent: str, name: str, value: Any, depth: int) -> None:
        from scipy.io.matlab import MatlabFunction, MatlabOpaque

        path = f"{parent}/{name}" if parent else name
        if not isinstance(value, np.ndarray) or depth > _DEEPEST:
            return
        if isinstance(value, MatlabOpaque | MatlabFunction):
            self.unread.append(path)
        elif value.dtype.names is not None or value.dtype.kind == "O":
            self._inside(parent, name, value, depth)
        elif value.dtype.kind in "US":
            if value.size == 1:
                self.texts[path] = str(value.reshape(-1)[0])
        elif value.size == 1 and value.dtype.kind in "biuf":
            self.numbers[path] = float(value.reshape(-1)[0])
        elif value.size:
            leaf = StoredArray(
                parent=parent,
                name=name,
                shape=value.shape,
                kind=value.dtype.kind,
                load=lambda: value,
            )
            self.leaves.append(leaf)

    def _inside(self, parent: str, name: str, value: np.ndarray, depth: int) -> None:
        marks = "()" if value.dtype.names is not None else "{}"
        for i, item in enumerate(value.reshape(-1)[:_MOST_ITEMS]):
            label = name if value.size == 1 else f"{name}{marks[0]}{i + 1}{marks[1]}"
            path = f"{parent}/{label}" if parent else label
            if value.dtype.names is None:
                self.visit(parent, label, item, depth + 1)
            else:
                for field in value.dtype.names:
                    self.visit(path, field, item[field], depth + 1)
