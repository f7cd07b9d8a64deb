"""One thing that is wrong with a stage."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True, kw_only=True)
class Issue:
    """One thing that is wrong with a stage, or looks so."""

    severity: Literal["error", "warning"]
    """Whether the stage cannot be as described, or only looks unlike what is meant."""
    code: str
    """Short name of the kind of issue."""
    what: tuple[str, ...]
    """Names of the bodies, hinges, drives or probes that it is about."""
    message: str
    """One sentence: what is wrong, what was found, how to mend it."""


def millimetres(*values: float) -> str:
    """Write lengths for people.

    One length, or the coordinates of a point [m].

    Examples
    --------
    >>> millimetres(0.2e-3), millimetres(3e-3, 4.5e-3)
    ('0.2 mm', '(3, 4.5) mm')
    """
    # nothing is known better than a nanometre; adding 0 turns -0 into 0
    texts = [f"{round(v * 1e3, 6) + 0.0:.6g}" for v in values]
    return f"{texts[0]} mm" if len(texts) == 1 else f"({', '.join(texts)}) mm"
