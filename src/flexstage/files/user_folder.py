"""Where the files of a user are kept that no command names."""

import os
import sys
from pathlib import Path
from typing import Literal

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
