"""Work that is done once: its result is read where the same was done before."""

import functools
import hashlib
import logging
import platform
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import flexstage
from flexstage.cache.cache import Cache
from flexstage.cache.packing import NotPlainError, pack, unpack
from flexstage.provenance import content_hash

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
        source_hash(Path(flexstage.__file__).parent),
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
