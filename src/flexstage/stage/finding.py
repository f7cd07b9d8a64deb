"""One thing that is wrong with a stage."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["Finding", "millimetres"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that is wrong with a stage, or looks so.

    Parameters
    ----------
    severity : {"error", "warning"}
        Whether the stage cannot be as described, or only looks unlike what is meant.
    code : str
        Short name of the kind of finding.
    what : tuple of str
        Names of the bodies, hinges, drives or probes that it is about.
    message : str
        One sentence: what is wrong, what was found, how to mend it.
    """

    severity: Literal["error", "warning"]
    code: str
    what: tuple[str, ...]
    message: str


def millimetres(*values: float) -> str:
    """Write lengths for people.

    Parameters
    ----------
    *values : float
        One length, or the coordinates of a point [m].

    Returns
    -------
    str
        ``"0.2 mm"`` or ``"(3, 4.5) mm"``.

    Examples
    --------
    >>> millimetres(0.2e-3), millimetres(3e-3, 4.5e-3)
    ('0.2 mm', '(3, 4.5) mm')
    """
    # nothing is known better than a nanometre; adding 0 turns -0 into 0
    texts = [f"{round(v * 1e3, 6) + 0.0:.6g}" for v in values]
    return f"{texts[0]} mm" if len(texts) == 1 else f"({', '.join(texts)}) mm"
