"""An issue of a stage."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True, kw_only=True)
class Issue:
    """An error in the description of a stage, or a likely one."""

    severity: Literal["error", "warning"]
    """``error`` if the stage is impossible as described, ``warning`` if it looks unintended."""
    code: str
    """Short name of the kind of issue."""
    what: tuple[str, ...]
    """Names of the bodies, hinges, drives or probes concerned."""
    message: str
    """The fault, the value, and the remedy, in one sentence."""


def millimetres(*values: float) -> str:
    """Format lengths for messages.

    One length, or the coordinates of a point [m].

    Examples
    --------
    >>> millimetres(0.2e-3), millimetres(3e-3, 4.5e-3)
    ('0.2 mm', '(3, 4.5) mm')
    """
    # nothing is known better than a nanometre; adding 0 turns -0 into 0
    texts = [f"{round(v * 1e3, 6) + 0.0:.6g}" for v in values]
    return f"{texts[0]} mm" if len(texts) == 1 else f"({', '.join(texts)}) mm"
