"""Names of exported files."""

__all__ = ["file_name"]

_LONGEST = 60  # characters; no system takes a name of more than 255 bytes


def file_name(name: str, fallback: str = "stage") -> str:
    """Return a name that a file can have on every system.

    Parameters
    ----------
    name : str
        Any name.
    fallback : str
        What is returned where nothing of the name is left.

    Returns
    -------
    str
        The same with every character that is special to some system replaced by a dash.

    Examples
    --------
    >>> file_name("a/b: c")
    'a-b--c'
    """
    kept = "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip(".")
    return kept[:_LONGEST] or fallback
