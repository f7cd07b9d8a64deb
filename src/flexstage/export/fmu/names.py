"""Names as C and as FMI take them."""

import re

__all__ = ["identifier", "structured"]

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\[[0-9]+(,[0-9]+)*\])?")


def identifier(name: str) -> str:
    """Return a name as C takes it.

    Parameters
    ----------
    name : str
        Any name.

    Returns
    -------
    str
        Letters, digits and underscores of it, not a digit first.

    Examples
    --------
    >>> identifier("vgtu-piezo"), identifier("2 axes")
    ('vgtu_piezo', 'stage_2_axes')
    """
    kept = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")
    return kept if re.match(r"[A-Za-z]", kept) else f"stage_{kept}".rstrip("_")


def structured(name: str) -> str:
    """Return a dotted name as FMI's structured naming convention has it.

    Parameters
    ----------
    name : str
        Parts with dots between them; a part that is a number counts the part before it.

    Returns
    -------
    str
        Numbers in brackets, other parts that are no identifiers between quotes.

    Examples
    --------
    >>> structured("mode.3.damping_ratio"), structured("left-x.command")
    ('mode[3].damping_ratio', "'left-x'.command")
    """
    out: list[str] = []
    for part in name.split("."):
        if part.isdigit() and out:
            out[-1] += f"[{part}]"
        elif _PLAIN.fullmatch(part):
            out.append(part)
        else:
            plain = part.encode("ascii", "replace").decode()
            out.append("'" + plain.replace("\\", "\\\\").replace("'", "\\'") + "'")
    return ".".join(out)
