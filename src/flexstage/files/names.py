"""Names that files can have, and the folders where those of a user are kept."""

import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal

# No system takes a name of more than 255 bytes, and endings are put behind it.
_CHARACTERS, _BYTES = 60, 180
# What Windows keeps for devices, whatever follows behind a dot.
_DEVICES = frozenset(
    ["con", "prn", "aux", "nul", *(f"{port}{i}" for port in ("com", "lpt") for i in range(1, 10))]
)


def file_name(name: str, fallback: str = "stage") -> str:
    """Return a name that a file can have on every system, the fallback where nothing is left.

    Dashes stand for special characters; none is first, where programs take it for an option.

    Examples
    --------
    >>> file_name("a/b: c")
    'a-b--c'
    """
    kept = "".join(c if c.isalnum() or c in "-_.+" else "-" for c in name).strip(".").lstrip("-.+")
    kept = kept[:_CHARACTERS].encode()[:_BYTES].decode(errors="ignore") or fallback
    return f"_{kept}" if kept.partition(".")[0].lower() in _DEVICES else kept


def file_names(names: Iterable[str], fallback: str = "axis") -> list[str]:
    """Return a name that a file can have for each name, no two alike in any case of letters.

    Examples
    --------
    >>> file_names(["x 1", "x/1", "y"])
    ['x-1', 'x-1-2', 'y']
    """
    found: list[str] = []
    for name in names:
        plain = file_name(name, fallback)
        count, free = 2, plain
        while free.lower() in {f.lower() for f in found}:
            free, count = f"{plain}-{count}", count + 1
        found.append(free)
    return found


def free_name(wanted: str, is_taken: Callable[[str], bool]) -> str:
    """Return a name that is not taken: the one that is wanted, or that with a number behind it.

    Examples
    --------
    >>> free_name("x", {"x", "x_2"}.__contains__)
    'x_3'
    """
    name, count = wanted, 1
    while is_taken(name):
        count += 1
        name = f"{wanted}_{count}"
    return name


#: By kind: the folder in ``%LOCALAPPDATA%``, in the ``Library`` of macOS, and at home elsewhere.
_PLACES = {
    "cache": ("flexstage/cache", "Caches", ".cache"),
    "data": ("flexstage", "Application Support", ".local/share"),
    "state": ("flexstage/state", "Application Support", ".local/state"),
}


def user_folder(kind: Literal["cache", "data", "state"]) -> Path:
    """Return where caches, data, or the state of work are kept; the folder need not exist.

    It is ``$FLEXSTAGE_CACHE`` or ``$FLEXSTAGE_STATE`` if that is set, else the platform's place,
    where ``$XDG_CACHE_HOME`` and the like are respected.
    """
    if kind != "data" and (named := os.environ.get(f"FLEXSTAGE_{kind.upper()}")):
        return Path(named)
    windows, mac, elsewhere = _PLACES[kind]
    if base := os.environ.get(f"XDG_{kind.upper()}_HOME"):
        return Path(base) / "flexstage"
    if sys.platform == "win32" and (base := os.environ.get("LOCALAPPDATA")):
        return Path(base) / windows
    if sys.platform == "darwin":
        return Path.home() / "Library" / mac / "flexstage"
    return Path.home() / elsewhere / "flexstage"
