"""Work that is done once: its result is read where the same was done before.

Results are kept as arrays by name: nothing in them is ever executed.
"""

import dataclasses
import functools
import hashlib
import json
import logging
import platform
from collections.abc import Callable, Mapping
from importlib import import_module, metadata
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from flexstage.base.provenance import content_hash
from flexstage.files.cache.cache import TYPES, Cache, Entry

_P = ParamSpec("_P")
_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)

#: What results are computed and drawn with.
_LIBRARIES = ("matplotlib", "netgen-mesher", "ngsolve", "numba", "numpy", "scipy", "shapely")


class Memory:
    """Results of work in a cache, by all that they depend on.

    That is the name of the function and its arguments, down to the last digit, the source of this
    package, and the versions of what it computes with: after any change, of the description or of
    the program, the work is done again. Without a cache it always is.
    """

    def __init__(self, cache: Cache | None) -> None:
        #: Where results are kept; None where they are not.
        self.cache = cache
        self._read: dict[str, None] = {}
        self._made: dict[str, None] = {}

    @property
    def read(self) -> tuple[str, ...]:
        """What was read, by name."""
        return tuple(self._read)

    @property
    def made(self) -> tuple[str, ...]:
        """What was made anew, by name."""
        return tuple(self._made)

    def recall(
        self, name: str, work: Callable[_P, _T], *arguments: _P.args, **named: _P.kwargs
    ) -> _T:
        """Return what a function of this package gives, read where its arguments are known.

        What is no content of a result (see `pack`) must be functions; of a result that was read
        each of them does the work again when it is called. What is no plain data is not kept.
        """
        if self.cache is None:
            return work(*arguments, **named)
        try:
            key = content_hash((_surroundings(), work, arguments, named))
        except TypeError as error:
            _LOG.info("%s is not looked for: %s", name, error)
            return work(*arguments, **named)
        entry = self.cache.load(key)
        if entry is not None:
            self._read[name] = None

            @functools.cache
            def left_out() -> tuple[Any, ...]:
                return pack(work(*arguments, **named))[1]

            def again(place: int) -> Callable[..., Any]:
                return functools.partial(_called, left_out, place)

            return unpack(entry, again)
        self._made[name] = None
        made = work(*arguments, **named)
        try:
            entry, _ = pack(made)
        except NotPlainError as error:
            _LOG.info("%s is not kept: %s", name, error)
            return made
        self.cache.store(key, entry)
        self.cache.trim()
        return made


def _called(functions: Callable[[], tuple[Any, ...]], place: int, *given: Any) -> Any:
    return functions()[place](*given)


@functools.cache
def _surroundings() -> tuple[str, ...]:
    """Hash of the package's files, and the versions of what it runs on."""
    return (
        source_hash(Path(__file__).parents[1]),
        platform.python_version(),
        platform.machine(),
        *(f"{name} {metadata.version(name)}" for name in _LIBRARIES),
    )


def source_hash(folder: Path) -> str:
    """Return a hash of all files in a folder, but those that Python compiles."""
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if "__pycache__" not in path.parts and path.is_file():
            content = hashlib.sha256(path.read_bytes()).hexdigest()
            found.update(f"{path.relative_to(folder).as_posix()} {content}\n".encode())
    return found.hexdigest()


_TREE = "tree"
_PACKAGE = "flexstage."
_SCALARS = (type(None), bool, int, float, str)


class NotPlainError(TypeError):
    """A value that is more than data of this package."""


def pack(value: object) -> tuple[Entry, tuple[Any, ...]]:
    """Return a value as arrays by name, and what was left out of it.

    The value consists of dataclasses of this package, tuples, lists, mappings, arrays, numbers and
    text; what stands in several places is kept once. Fields that are not compared
    (``compare=False``) are no content, and left out in the order in which they stand.

    Raises
    ------
    NotPlainError
        There is something else in it.

    Examples
    --------
    >>> entry, _ = pack({"loops": (np.zeros(3), 2.5), "of": None})
    >>> unpack(entry)
    {'loops': (array([0., 0., 0.]), 2.5), 'of': None}
    """
    packer = _Packer()
    tree = json.dumps(packer.node(value), separators=(",", ":"))
    entry = {_TREE: np.frombuffer(tree.encode(), dtype=np.uint8)}
    entry |= {str(i): array for i, array in enumerate(packer.arrays)}
    return entry, tuple(packer.left_out)


def unpack(entry: Entry, again: Callable[[int], Any] | None = None) -> Any:
    """Return the value that was packed; `again` gives what was left out, by its place."""
    tree = json.loads(entry[_TREE].tobytes())
    return _Unpacker(entry, again).value(tree)


class _Packer:
    """A tree in JSON: scalars as they are, all else a list that begins with what it is."""

    def __init__(self) -> None:
        self.arrays: list[NDArray] = []
        self.left_out: list[Any] = []
        self._seen: dict[int, int] = {}

    def node(self, value: Any) -> Any:
        if type(value) in _SCALARS:
            return value
        if isinstance(value, np.generic):
            return self.node(value.item())
        if isinstance(value, complex):
            return ["complex", value.real, value.imag]
        if (seen := self._seen.get(id(value))) is not None:
            return ["same", seen]
        made = self._node(value)
        # numbered when they are complete, as they are when they are read
        self._seen[id(value)] = len(self._seen)
        return made

    def _node(self, value: Any) -> list[Any]:
        kind = type(value)
        if isinstance(value, np.ndarray):
            return self._array(value)
        if dataclasses.is_dataclass(value):
            name, parts = _name(kind), []
            for field in dataclasses.fields(value):
                if field.compare:
                    parts.append(self.node(getattr(value, field.name)))
                else:
                    parts.append(["left out", len(self.left_out)])
                    self.left_out.append(getattr(value, field.name))
            return ["object", name, parts]
        if kind is list or isinstance(value, tuple):
            name = kind.__name__ if kind in (list, tuple) else _name(kind)
            return [name, [self.node(one) for one in value]]
        if isinstance(value, Mapping):
            return ["mapping", [[self.node(k), self.node(v)] for k, v in value.items()]]
        raise NotPlainError(f"a {kind.__name__} is no plain data")

    def _array(self, array: NDArray) -> list[Any]:
        kind = next((t for t in TYPES if np.dtype(t) == array.dtype), None)
        if kind is None:
            raise NotPlainError(f"an array of {array.dtype} is not kept")
        # sums over an array depend on the order of its numbers in memory
        columns = array.flags.f_contiguous and not array.flags.c_contiguous
        self.arrays.append(array.T if columns else array)
        return ["columns" if columns else "array", len(self.arrays) - 1]


class _Unpacker:
    def __init__(self, entry: Entry, again: Callable[[int], Any] | None) -> None:
        self._entry, self._again = entry, again
        self._made: list[Any] = []

    def value(self, node: Any) -> Any:
        if not isinstance(node, list):
            return node
        match node:
            case ["complex", real, imaginary]:
                return complex(real, imaginary)
            case ["same", place]:
                return self._made[place]
            case ["left out", place]:
                return None if self._again is None else self._again(place)
        made = self._whole(*node)
        self._made.append(made)
        return made

    def _whole(self, what: str, *parts: Any) -> Any:
        if what in ("array", "columns"):
            array = self._entry[str(parts[0])].copy()
            return array.T if what == "columns" else array
        if what == "mapping":
            return {self.value(key): self.value(one) for key, one in parts[0]}
        if what in ("list", "tuple"):
            return (list if what == "list" else tuple)(map(self.value, parts[0]))
        if what != "object":
            kind = _class(what)
            # a named tuple takes its parts one by one
            return getattr(kind, "_make", kind)(map(self.value, parts[0]))
        kind = _class(parts[0])
        made = object.__new__(kind)
        for field, node in zip(dataclasses.fields(kind), parts[1], strict=True):
            object.__setattr__(made, field.name, self.value(node))
        return made


def _name(kind: type) -> str:
    if not kind.__module__.startswith(_PACKAGE) or "<" in kind.__qualname__:
        raise NotPlainError(f"{kind.__qualname__} is no class of this package")
    return f"{kind.__module__}:{kind.__qualname__}"


def _class(name: str) -> Any:
    """Return a class that holds data: of what a file names nothing else is touched."""
    module, _, qualified = name.partition(":")
    kind: Any = import_module(module) if module.startswith(_PACKAGE) else None
    for part in qualified.split("."):
        kind = getattr(kind, part)
    if not isinstance(kind, type) or not (
        dataclasses.is_dataclass(kind) or issubclass(kind, tuple)
    ):
        raise NotPlainError(f"{name} holds no data")
    return kind
