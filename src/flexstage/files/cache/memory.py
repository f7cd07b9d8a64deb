"""Memoisation: results of functions in a cache, by function and arguments.

Results are stored as arrays by name: nothing in them is ever executed.
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

#: Libraries on which results and figures depend.
_LIBRARIES = ("matplotlib", "netgen-mesher", "ngsolve", "numba", "numpy", "scipy", "shapely")


class Memory:
    """Results of functions in a cache, by all that they depend on.

    That is the name of the function, its arguments to the last digit, the source of this package,
    and the versions of its libraries: after any change of description or program the result is
    computed again. Without a cache it is always computed.
    """

    def __init__(self, cache: Cache | None) -> None:
        #: The cache; None for none.
        self.cache = cache
        self._read: dict[str, None] = {}
        self._computed: dict[str, None] = {}

    @property
    def read(self) -> tuple[str, ...]:
        """Names of results that were read."""
        return tuple(self._read)

    @property
    def computed(self) -> tuple[str, ...]:
        """Names of results that were computed."""
        return tuple(self._computed)

    def recall(
        self, name: str, work: Callable[_P, _T], *arguments: _P.args, **keywords: _P.kwargs
    ) -> _T:
        """Return the result of a function of this package, from the cache where it is there.

        Parts of a result that are not stored (see `pack`) must be functions; in a result from the
        cache each of them runs `work` again when it is called. A result that is not plain data is
        not stored.
        """
        if self.cache is None:
            return work(*arguments, **keywords)
        try:
            key = content_hash((_surroundings(), work, arguments, keywords))
        except TypeError as error:
            _LOG.info("%s is not in the cache: %s", name, error)
            return work(*arguments, **keywords)
        entry = self.cache.load(key)
        if entry is not None:
            self._read[name] = None

            @functools.cache
            def functions() -> tuple[Any, ...]:
                return pack(work(*arguments, **keywords))[1]

            def substitute(place: int) -> Callable[..., Any]:
                return functools.partial(_called, functions, place)

            return unpack(entry, substitute)
        self._computed[name] = None
        result = work(*arguments, **keywords)
        try:
            entry, _ = pack(result)
        except NotPlainError as error:
            _LOG.info("%s is not stored: %s", name, error)
            return result
        self.cache.store(key, entry)
        self.cache.trim()
        return result


def _called(functions: Callable[[], tuple[Any, ...]], place: int, *arguments: Any) -> Any:
    return functions()[place](*arguments)


@functools.cache
def _surroundings() -> tuple[str, ...]:
    """Return the hash of the source, and the versions of interpreter, machine and libraries."""
    return (
        source_hash(Path(__file__).parents[1]),
        platform.python_version(),
        platform.machine(),
        *(f"{name} {metadata.version(name)}" for name in _LIBRARIES),
    )


def source_hash(folder: Path) -> str:
    """Return a hash of all files in a folder, without compiled ones."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if "__pycache__" not in path.parts and path.is_file():
            content = hashlib.sha256(path.read_bytes()).hexdigest()
            digest.update(f"{path.relative_to(folder).as_posix()} {content}\n".encode())
    return digest.hexdigest()


_TREE = "tree"
_PACKAGE = "flexstage."
_SCALARS = (type(None), bool, int, float, str)


class NotPlainError(TypeError):
    """A value that is not plain data of this package."""


def pack(value: object) -> tuple[Entry, tuple[Any, ...]]:
    """Return a value as arrays by name, and the parts that are not stored.

    The value consists of dataclasses of this package, tuples, lists, mappings, arrays, numbers and
    text; a part that occurs several times is stored once. Fields that are not compared
    (``compare=False``) are not stored, and are returned in order.

    Raises
    ------
    NotPlainError
        The value contains something else.

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
    return entry, tuple(packer.omitted)


def unpack(entry: Entry, substitute: Callable[[int], Any] | None = None) -> Any:
    """Return the value of an entry; `substitute` returns a part that was not stored, by number."""
    tree = json.loads(entry[_TREE].tobytes())
    return _Unpacker(entry, substitute).value(tree)


class _Packer:
    """A tree in JSON: scalars as they are, all else as a list that begins with its kind."""

    def __init__(self) -> None:
        self.arrays: list[NDArray] = []
        self.omitted: list[Any] = []
        self._numbers: dict[int, int] = {}

    def node(self, value: Any) -> Any:
        if type(value) in _SCALARS:
            return value
        if isinstance(value, np.generic):
            return self.node(value.item())
        if isinstance(value, complex):
            return ["complex", value.real, value.imag]
        if (place := self._numbers.get(id(value))) is not None:
            return ["same", place]
        packed = self._node(value)
        # numbered when complete, as in reading
        self._numbers[id(value)] = len(self._numbers)
        return packed

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
                    parts.append(["omitted", len(self.omitted)])
                    self.omitted.append(getattr(value, field.name))
            return ["object", name, parts]
        if kind is list or isinstance(value, tuple):
            name = kind.__name__ if kind in (list, tuple) else _name(kind)
            return [name, [self.node(one) for one in value]]
        if isinstance(value, Mapping):
            return ["mapping", [[self.node(k), self.node(v)] for k, v in value.items()]]
        raise NotPlainError(f"a {kind.__name__} is not plain data")

    def _array(self, array: NDArray) -> list[Any]:
        kind = next((t for t in TYPES if np.dtype(t) == array.dtype), None)
        if kind is None:
            raise NotPlainError(f"an array of {array.dtype} cannot be stored")
        # sums over an array depend on the order of its numbers in memory
        columns = array.flags.f_contiguous and not array.flags.c_contiguous
        self.arrays.append(array.T if columns else array)
        return ["columns" if columns else "array", len(self.arrays) - 1]


class _Unpacker:
    def __init__(self, entry: Entry, substitute: Callable[[int], Any] | None) -> None:
        self._entry, self._substitute = entry, substitute
        self._complete: list[Any] = []

    def value(self, node: Any) -> Any:
        if not isinstance(node, list):
            return node
        match node:
            case ["complex", real, imaginary]:
                return complex(real, imaginary)
            case ["same", place]:
                return self._complete[place]
            case ["omitted", number]:
                return None if self._substitute is None else self._substitute(number)
        value = self._node(*node)
        self._complete.append(value)
        return value

    def _node(self, what: str, *parts: Any) -> Any:
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
        thing = object.__new__(kind)
        for field, node in zip(dataclasses.fields(kind), parts[1], strict=True):
            object.__setattr__(thing, field.name, self.value(node))
        return thing


def _name(kind: type) -> str:
    if not kind.__module__.startswith(_PACKAGE) or "<" in kind.__qualname__:
        raise NotPlainError(f"{kind.__qualname__} is not a class of this package")
    return f"{kind.__module__}:{kind.__qualname__}"


def _class(name: str) -> Any:
    """Return a data class by name; refuse any other name in a file."""
    module, _, qualified = name.partition(":")
    kind: Any = import_module(module) if module.startswith(_PACKAGE) else None
    for part in qualified.split("."):
        kind = getattr(kind, part)
    if not isinstance(kind, type) or not (
        dataclasses.is_dataclass(kind) or issubclass(kind, tuple)
    ):
        raise NotPlainError(f"{name} is not a data class")
    return kind
