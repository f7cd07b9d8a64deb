"""Names of the parts of a stage's mesh."""

from collections.abc import Iterable

__all__ = [
    "MOUNTING",
    "body_region",
    "either",
    "exactly",
    "neck_edge",
    "notch_region",
    "patch_edge",
    "surface_edge",
]

_SYNTAX = frozenset("^$\\.*+?()[]{}|")  # characters that mean something in an expression

#: Boundary by which the fixed bodies are held.
MOUNTING = "mounting"


def body_region(body: str) -> str:
    """Return the name of the region of a body, its half notches left out.

    Parameters
    ----------
    body : str
        Name of the body.

    Returns
    -------
    str
        The name.
    """
    return f"body {body}"


def notch_region(hinge: str, which: int) -> str:
    """Return the name of the region of one half of a notch.

    Parameters
    ----------
    hinge : str
        Name of the hinge.
    which : int
        0 for the half on its first body, 1 for that on its second.

    Returns
    -------
    str
        The name.
    """
    return f"notch {hinge} {'ab'[which]}"


def neck_edge(hinge: str) -> str:
    """Return the name of the boundary between the two halves of a notch.

    Parameters
    ----------
    hinge : str
        Name of the hinge.

    Returns
    -------
    str
        The name.
    """
    return f"neck {hinge}"


def surface_edge(hinge: str) -> str:
    """Return the name of the free surface of a notch.

    Parameters
    ----------
    hinge : str
        Name of the hinge.

    Returns
    -------
    str
        The name.
    """
    return f"surface {hinge}"


def patch_edge(drive: str, which: int) -> str:
    """Return the name of the patch on which a drive acts.

    Parameters
    ----------
    drive : str
        Name of the drive.
    which : int
        0 for the patch on the pushed body, 1 for that on the reacting one.

    Returns
    -------
    str
        The name.
    """
    return f"patch {drive} {('push', 'react')[which]}"


def exactly(name: str) -> str:
    r"""Return the regular expression that matches one name and no other.

    Parameters
    ----------
    name : str
        The name.

    Returns
    -------
    str
        The expression, in the dialect of the mesher.

    Examples
    --------
    >>> print(exactly("body x+"))
    body x\+
    """
    # names come from stage files, and the mesher takes every name for an expression
    return "".join(f"\\{c}" if c in _SYNTAX else c for c in name)


def either(names: Iterable[str]) -> str:
    """Return the regular expression that matches any of some names.

    Parameters
    ----------
    names : iterable of str
        The names.

    Returns
    -------
    str
        The expression.
    """
    return "|".join(f"({exactly(n)})" for n in names)
