"""Names of the parts of a stage's mesh.

`which` is 0 for the half on a hinge's first body, or the patch on the pushed body, and 1 for the
other.
"""

from collections.abc import Iterable

_SYNTAX = frozenset("^$\\.*+?()[]{}|")  # characters that mean something in an expression

#: Boundary by which the fixed bodies are held.
MOUNTING = "mounting"


def body_region(body: str) -> str:
    """Return the name of the region of a body, its half notches left out."""
    return f"body {body}"


def notch_region(hinge: str, which: int) -> str:
    """Return the name of the region of one half of a notch."""
    return f"notch {hinge} {'ab'[which]}"


def neck_edge(hinge: str) -> str:
    """Return the name of the boundary between the two halves of a notch."""
    return f"neck {hinge}"


def surface_edge(hinge: str) -> str:
    """Return the name of the free surface of a notch."""
    return f"surface {hinge}"


def patch_edge(drive: str, which: int) -> str:
    """Return the name of the patch on which a drive acts."""
    return f"patch {drive} {('push', 'react')[which]}"


def exactly(name: str) -> str:
    r"""Return the regular expression that matches one name and no other.

    Examples
    --------
    >>> print(exactly("body x+"))
    body x\+
    """
    # names come from stage files, and the mesher takes every name for an expression
    return "".join(f"\\{c}" if c in _SYNTAX else c for c in name)


def either(names: Iterable[str]) -> str:
    """Return the regular expression that matches any of some names."""
    return "|".join(f"({exactly(n)})" for n in names)
