"""Selection of the columns of a record among many arrays of a file."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from flexstage.base.errors import RecordError
from flexstage.records.columns import FileColumn, FileColumns, as_float, complex_parts, labelled

_RATE_NAMES = frozenset(
    ("fs", "samplerate", "sampleratehz", "samplingrate", "samplingratehz", "samplingfrequency")
)
_INTERVAL_NAMES = frozenset(("ts", "dt", "deltat", "sampletime", "interval", "sampleinterval"))
#: Every file may unpack to `_ALWAYS`, a large one to `_RATIO` times its size, none to more than
#: `_NEVER` [bytes]. Measured data with noise pack to a half or a tenth.
_ALWAYS, _RATIO, _NEVER = 2**28, 100, 2**32


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredArray:
    """An array in a file."""

    parent: str
    """Path of its group or structure; empty at the root."""
    name: str
    """Name in the group."""
    shape: tuple[int, ...]
    """Shape in the file."""
    kind: str
    """NumPy's letter of the type: ``f`` float, ``c`` complex..."""
    load: Callable[[], NDArray]
    """Function that returns the array."""
    label: str = ""
    """Heading, if the file has a better one than `name`."""
    unit: str = ""
    """Unit in the file, if any."""
    interval: float | None = None
    """Sample interval in the file, if any [s]."""
    start: float = 0.0
    """Time of the first sample in the file, if any [s]."""

    @property
    def path(self) -> str:
        """Path in the file."""
        return _path(self.parent, self.name)

    @property
    def core(self) -> tuple[int, ...]:
        """Shape without dimensions of length one."""
        return tuple(n for n in self.shape if n != 1)

    @property
    def samples(self) -> int:
        """Number of samples of its columns."""
        return max(self.core, default=0)

    @property
    def width(self) -> int:
        """Number of columns."""
        return 1 if len(self.core) == 1 else min(self.core)

    @property
    def usable(self) -> bool:
        """Whether it can be one or more columns."""
        return self.kind in "biufcM" and len(self.core) in (1, 2) and 0 not in self.shape

    def __str__(self) -> str:
        size = " x ".join(map(str, self.shape)) or "a number"
        why = "" if self.kind in "biufM" else ", complex" if self.kind == "c" else ", not numeric"
        return f"{self.path} ({size}{why})"


@dataclass(slots=True, kw_only=True, eq=False)
class Tree:
    """Content of a file."""

    file_size: int
    """Size of the file [bytes]."""
    leaves: list[StoredArray] = field(default_factory=list)
    """Arrays, in the order of the file."""
    numbers: dict[str, float] = field(default_factory=dict)
    """Single numbers, by path."""
    texts: dict[str, str] = field(default_factory=dict)
    """Texts, by path. ``units/u`` is the unit of ``u``, ``names/u`` its heading."""

    def add(self, parent: str, name: str, array: NDArray) -> None:
        """Add an array, a single number, a text, or the fields of a structure."""
        path, kind = _path(parent, name), array.dtype.kind
        if array.dtype.names is not None:
            for field_name in array.dtype.names:
                self.leaves.append(_in_memory(path, field_name, array[field_name]))
        elif array.size == 1 and kind in "US":
            self.texts[path] = str(array.reshape(-1)[0])
        elif array.size == 1 and kind in "biuf":
            self.numbers[path] = float(array.reshape(-1)[0])
        else:
            self.leaves.append(_in_memory(parent, name, array))


def _path(parent: str, name: str) -> str:
    return f"{parent}/{name}" if parent else name


def _in_memory(parent: str, name: str, array: NDArray) -> StoredArray:
    return StoredArray(
        parent=parent, name=name, shape=array.shape, kind=array.dtype.kind, load=lambda: array
    )


@contextmanager
def reading(path: Path, kind: str, hint: str = "") -> Iterator[None]:
    """Refuse a file on which its library fails, with the first line of the reason."""
    try:
        yield
    except RecordError as error:
        if str(path) in str(error):
            raise
        raise RecordError(f"'{path}': {error}") from error
    except Exception as error:  # a damaged file may cause almost any error in a library
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0][:120]
        raise RecordError(f"'{path}' cannot be read as {kind} file ({reason}){hint}") from error


def chosen_columns(tree: Tree, dataset: str | None) -> FileColumns:
    """Return the columns of a file: the selected ones, or the only matching ones.

    `dataset` is the path of a group or an array, or of several arrays, separated by commas.

    Arrays of a group with equal numbers of samples belong together; so do the columns of a matrix,
    whose samples are along its longer side.
    """
    leaves = _selected(tree, dataset) if dataset else _only(tree.leaves)
    for leaf in leaves:
        _require_usable(leaf)
    lengths = {leaf.samples for leaf in leaves}
    if len(lengths) > 1:
        listed = ", ".join(map(str, leaves))
        raise RecordError(f"the datasets {listed} differ in length: select equally long ones")
    size = 8 * sum(leaf.samples * leaf.width for leaf in leaves)
    require_unpacked(size, tree.file_size, _some(leaves))
    columns: list[FileColumn] = []
    notes: list[str] = []
    for leaf in leaves:
        notes += _append(columns, leaf, tree)
    used = {id(leaf) for leaf in leaves}
    skipped = [leaf for leaf in tree.leaves if id(leaf) not in used]
    if skipped and not dataset:
        notes.append(f"skipped arrays of another length or kind: {_some(skipped)}")
    rate, start, source, hint = _sampling(leaves, tree.numbers)
    attributes = {path: text for path, text in tree.texts.items() if not _is_label(path)}
    attributes |= {path: repr(number) for path, number in tree.numbers.items()}
    return FileColumns(
        columns=tuple(columns),
        sample_rate_hz=rate,
        start=start,
        rate_source=source,
        hint=hint,
        notes=tuple(notes),
        attributes=attributes,
    )


def _is_label(path: str) -> bool:
    return PurePosixPath(path).parent.name in {"units", "names"}


def _some(leaves: Sequence[StoredArray], most: int = 12) -> str:
    listed = ", ".join(str(leaf) for leaf in leaves[:most])
    more = len(leaves) - most
    return f"{listed} and {more} more" if more > 0 else listed


def _require_usable(leaf: StoredArray) -> None:
    if not leaf.usable:
        raise RecordError(f"{leaf} cannot be columns of a record: select a vector or a matrix")


def _selected(tree: Tree, dataset: str) -> list[StoredArray]:
    leaves: list[StoredArray] = []
    for word in dataset.split(","):
        leaves += _at(tree, word.strip().strip("/"))
    return leaves


def _at(tree: Tree, path: str) -> list[StoredArray]:
    for candidate in (path, path.replace(".", "/")):
        exact = [leaf for leaf in tree.leaves if leaf.path == candidate]
        if exact:
            return exact
        inside = [leaf for leaf in tree.leaves if f"{leaf.parent}/".startswith(f"{candidate}/")]
        if inside:
            return _only(inside)
    content = _some(tree.leaves) or "no arrays"
    raise RecordError(f"there is no dataset '{path}': the file contains {content}")


def _only(leaves: Sequence[StoredArray]) -> list[StoredArray]:
    """Return the leaves that belong together, if there is only one such set."""
    usable = [leaf for leaf in leaves if leaf.usable]
    if not usable:
        content = f"it contains {_some(leaves)}" if leaves else "it contains no arrays"
        raise RecordError(f"the file has no numeric column: {content}")
    sets: dict[tuple[str, int], list[StoredArray]] = {}
    for leaf in usable:
        sets.setdefault((leaf.parent, leaf.samples), []).append(leaf)
    several = [group for group in sets.values() if sum(leaf.width for leaf in group) > 1]
    if len(several) == 1:
        return several[0]
    if not several:
        names = {leaf.name for leaf in usable}
        if len(usable) == 1 or (
            len({leaf.samples for leaf in usable}) == 1 and len(names) == len(usable)
        ):
            return usable
    example = (several[0] if several else usable)[0]
    raise RecordError(
        f"the choice of columns is ambiguous: the file contains {_some(usable)}; select by the "
        f"option dataset, such as '{example.parent or example.path}', or several paths separated "
        "by commas"
    )


def _append(columns: list[FileColumn], leaf: StoredArray, tree: Tree) -> list[str]:
    """Add the columns of an array; return notes on it."""
    label = leaf.label or _text_of(tree, "names", leaf) or leaf.name
    unit = leaf.unit or _text_of(tree, "units", leaf)
    array = leaf.load()
    if array.size != int(np.prod(leaf.shape)):
        raise RecordError(f"{leaf} is truncated: the file ends before its last sample")
    if leaf.kind == "c":
        first = len(columns)
        notes = _real_columns(columns, leaf, label, unit, np.real(array))
        real, columns[first:] = columns[first:], []
        _real_columns(columns, leaf, label, unit, np.imag(array))
        imaginary, columns[first:] = columns[first:], []
        for real_part, imaginary_part in zip(real, imaginary, strict=True):
            columns += complex_parts(real_part, imaginary_part.values)
        return notes
    return _real_columns(columns, leaf, label, unit, array)


def _real_columns(
    columns: list[FileColumn], leaf: StoredArray, label: str, unit: str, array: NDArray
) -> list[str]:
    values = as_float(array, f"'{leaf.path}'")
    notes = []
    if leaf.kind == "M":
        unit = "s"
        notes.append(f"dates of '{label}' are read as seconds after the first")
    matrix = values.reshape(leaf.core)
    if matrix.ndim == 1:
        columns.append(labelled(label, matrix, unit))
        return notes
    if matrix.shape[0] < matrix.shape[1]:
        matrix = matrix.T
        notes.append(f"the samples of '{leaf.path}' are along its rows")
    columns += (
        FileColumn(name=f"{label} {j}", values=np.ascontiguousarray(matrix[:, j]), unit=unit)
        for j in range(matrix.shape[1])
    )
    return notes


def _text_of(tree: Tree, kind: str, leaf: StoredArray) -> str:
    prefix = f"{leaf.parent}/" if leaf.parent else ""
    return tree.texts.get(f"{prefix}{kind}/{leaf.name}", "")


def _sampling(
    leaves: Sequence[StoredArray], numbers: Mapping[str, float]
) -> tuple[float | None, float, str, str]:
    """Return sample rate, time of the first sample, their place in the file, and a hint."""
    timed = [leaf for leaf in leaves if leaf.interval]
    for leaf in timed:
        first = timed[0]
        if leaf.interval != first.interval or leaf.start != first.start:
            raise RecordError(
                f"'{first.path}' and '{leaf.path}' are sampled at different times (every "
                f"{first.interval} s from {first.start} s, every {leaf.interval} s from "
                f"{leaf.start} s): select columns of one rate by the option dataset"
            )
    if timed and timed[0].interval:
        return 1.0 / timed[0].interval, timed[0].start, f"'{timed[0].path}'", ""
    parents = {leaf.parent for leaf in leaves}
    near = [*PurePosixPath(next(iter(parents))).parents] if len(parents) == 1 else []
    places = [*(PurePosixPath(p) for p in parents), *near, PurePosixPath(".")]
    hint = ""
    for place in places:
        for path, number in numbers.items():
            if PurePosixPath(path).parent != place or not number > 0.0:
                continue
            word = PurePosixPath(path).name.lower().replace("_", "").replace(" ", "")
            if word in _RATE_NAMES:
                return number, 0.0, f"'{path}'", ""
            if word in _INTERVAL_NAMES:
                hint = (
                    f"; if '{path}' = {number:g} is the sample interval in seconds, the "
                    f"sample rate is {1.0 / number:g} Hz"
                )
    return None, 0.0, "", hint


def most_unpacked(packed: int) -> int:
    """Return the largest allowed size of an unpacked file.

    Examples
    --------
    >>> most_unpacked(1_000_000), most_unpacked(10_000_000)
    (268435456, 1000000000)
    """
    return min(max(_ALWAYS, _RATIO * packed), _NEVER)


def require_unpacked(unpacked: int, packed: int, what: str) -> None:
    """Refuse implausibly large unpacked data, before memory is allocated for it."""
    if unpacked > most_unpacked(packed):
        raise RecordError(
            f"{what} is too large to read: {unpacked / 1e6:,.0f} MB from a file of "
            f"{packed / 1e6:.3g} MB; save a part of it, or save it without compression"
        )
