"""Origin of a result: software, description, settings, time."""

import dataclasses
import datetime
import functools
import hashlib
import inspect
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flexstage.base.version import __version__


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Origin of a result."""

    version: str
    """Version of flexstage."""
    input_hash: str
    """SHA-256 of the description of the computed object."""
    created: str
    """Date and time, UTC, ISO 8601."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Choices that change the result."""
    python: str
    """Version of Python."""
    machine: str
    """Operating system and processor."""


def content_hash(description: object) -> str:
    """Return a hash of a description that is equal exactly when its fields are.

    It is the SHA-256 of a dataclass of numbers, texts, tuples, mappings, arrays and other such
    dataclasses. Fields that are not compared (``compare=False``) do not count; a function counts by
    its name, a partial one by its arguments as well.
    """
    words: list[str] = []
    _spell(words, description)
    return hashlib.sha256("".join(words).encode()).hexdigest()


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _spell(words: list[str], value: object) -> None:
    # numbers first, as most of a description is coordinates
    if isinstance(value, float):
        words.append(value.hex())
    elif isinstance(value, (tuple, list)):
        words.append("[")
        for item in value:
            _spell(words, item)
            words.append(",")
        words.append("]")
    elif dataclasses.is_dataclass(value):
        words.append(f"{type(value).__name__}(")
        for f in dataclasses.fields(value):
            if f.compare:
                words.append(f"{f.name}=")
                _spell(words, getattr(value, f.name))
        words.append(")")
    elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
        words.append(f"{value.dtype.str}{value.shape}")
        words.append(hashlib.sha256(value.tobytes()).hexdigest())
    elif isinstance(value, Mapping):
        words.append("{")
        _spell(words, tuple(value.items()))
        words.append("}")
    elif isinstance(value, functools.partial):
        _spell(words, ("partial", value.func, value.args, value.keywords))
    elif inspect.isfunction(value) and "<" not in value.__qualname__:
        words.append(f"{value.__module__}.{value.__qualname__}")
    elif type(value).__repr__ is object.__repr__ or callable(value):
        raise TypeError(f"a {type(value).__name__} has no content to compare")
    else:
        words.append(repr(value))


def provenance(description: object, settings: Mapping[str, str] | None = None) -> Provenance:
    """Return the origin of a result that is made now from a description, with some settings."""
    return Provenance(
        version=__version__,
        input_hash=content_hash(description),
        created=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        settings=dict(settings or {}),
        python=platform.python_version(),
        machine=f"{platform.system()} {platform.machine()}",
    )
