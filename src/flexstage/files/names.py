"""Valid names of files, and the folders of a user."""

import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal

# No system accepts a name of more than 255 bytes, with its ending.
_CHARACTERS, _BYTES = 60, 180
# Reserved for devices on Windows, with any ending.
_DEVICES = frozenset(
    ["con", "prn", "aux", "nul", *(f"{port}{i}" for port in ("com", "lpt") for i in range(1, 10))]
)


def file_name(name: str, fallback: str = "stage") -> str:
    """Return a name for a file that is valid on every system; the fallback for an empty one.

    Dashes replace special characters; none is first, where programs would read it as an option.

    Examples
    --------
    >>> file_name("a/b: c")
    'a-b--c'
    """
    safe = "".join(c if c.isalnum() or c in "-_.+" else "-" for c in name).strip(".").lstrip("-.+")
    safe = safe[:_CHARACTERS].encode()[:_BYTES].decode(errors="ignore") or fallback
    return f"_{safe}" if safe.partition(".")[0].lower() in _DEVICES else safe


def file_names(names: Iterable[str], fallback: str = "axis") -> list[str]:
    """Return a valid, unique name of a file for each name, whatever the case of letters.

    Examples
    --------
    >>> file_names(["x 1", "x/1", "y"])
    ['x-1', 'x-1-2', 'y']
    """
    unique: list[str] = []
    for name in names:
        plain = file_name(name, fallback)
        count, free = 2, plain
        while free.lower() in {f.lower() for f in unique}:
            free, count = f"{plain}-{count}", count + 1
        unique.append(free)
    return unique


def free_name(base: str, is_taken: Callable[[str], bool]) -> str:
    """Return a free name: the base, or the base with a number.

    Examples
    --------
    >>> free_name("x", {"x", "x_2"}.__contains__)
    'x_3'
    """
    name, count = base, 1
    while is_taken(name):
        count += 1
        name = f"{base}_{count}"
    return name


#: Folders by kind: in ``%LOCALAPPDATA%``, in the ``Library`` of macOS, and in other home folders.
_PLACES = {
    "cache": ("flexstage/cache", "Caches", ".cache"),
    "data": ("flexstage", "Application Support", ".local/share"),
    "state": ("flexstage/state", "Application Support", ".local/state"),
}


def user_folder(kind: Literal["cache", "data", "state"]) -> Path:
    """Return the folder of caches, data or state; it need not exist.

    It is ``$FLEXSTAGE_CACHE`` or ``$FLEXSTAGE_STATE`` if set, else the folder of the platform, with
    ``$XDG_CACHE_HOME`` and similar variables.
    """
    if kind != "data" and (override := os.environ.get(f"FLEXSTAGE_{kind.upper()}")):
        return Path(override)
    windows, mac, elsewhere = _PLACES[kind]
    if base := os.environ.get(f"XDG_{kind.upper()}_HOME"):
        return Path(base) / "flexstage"
    if sys.platform == "win32" and (base := os.environ.get("LOCALAPPDATA")):
        return Path(base) / windows
    if sys.platform == "darwin":
        return Path.home() / "Library" / mac / "flexstage"
    return Path.home() / elsewhere / "flexstage"
