"""Short `repr` of large results: sizes in place of contents."""

import dataclasses
from collections.abc import Collection
from typing import Any

_LONGEST = 60  # characters of a text


def short_repr(self: Any) -> str:
    """Return a dataclass as text, with sizes in place of arrays, tuples and mappings.

    A dataclass uses this function as its ``__repr__``. Empty fields are omitted.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> short_repr(design("parallelogram").bodies[0])
    "Body(name='base', outline=<Loop>, mounting_holes=<2>, fixed=True, rigid=False)"
    """
    values = ((f.name, getattr(self, f.name)) for f in dataclasses.fields(self) if f.repr)
    text = ", ".join(f"{name}={_short(value)}" for name, value in values if not _empty(value))
    return f"{type(self).__name__}({text})"


def _empty(value: Any) -> bool:
    if getattr(value, "shape", None) == ():  # an array of one value, which has no length
        return False
    return value is None or (isinstance(value, Collection) and len(value) == 0)


def _short(value: Any) -> str:
    if isinstance(value, str):
        return repr(value if len(value) <= _LONGEST else f"{value[: _LONGEST - 1]}…")
    if hasattr(value, "shape"):
        return f"<{' × '.join(map(str, value.shape))}>" if value.shape else str(value)
    if isinstance(value, Collection):
        return f"<{len(value)}>"
    if dataclasses.is_dataclass(value):
        name = getattr(value, "name", None)
        return f"<{type(value).__name__}{f' {name!r}' if isinstance(name, str) else ''}>"
    return repr(value)
