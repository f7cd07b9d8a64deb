"""Where a result comes from: software, description, settings, time."""

import dataclasses
import datetime
import hashlib
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field

import flexstage


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What a result was made from and with."""

    version: str
    """Version of flexstage."""
    input_hash: str
    """SHA-256 of the description that the result was computed from."""
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

    It is the SHA-256 of a dataclass of numbers, texts, tuples and other such dataclasses.
    """
    words: list[str] = []
    _spell(words, description)
    return hashlib.sha256("".join(words).encode()).hexdigest()


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
            words.append(f"{f.name}=")
            _spell(words, getattr(value, f.name))
        words.append(")")
    else:
        words.append(repr(value))


def provenance(description: object, settings: Mapping[str, str] | None = None) -> Provenance:
    """Record where a result comes from, now: its description and the choices that change it."""
    return Provenance(
        version=flexstage.__version__,
        input_hash=content_hash(description),
        created=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        settings=dict(settings or {}),
        python=platform.python_version(),
        machine=f"{platform.system()} {platform.machine()}",
    )
