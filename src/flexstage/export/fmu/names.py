"""Names as C and as FMI take them."""

import re
from collections.abc import Iterable

from flexstage.export.simulink.matlab_text import plain

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\[[0-9]+(,[0-9]+)*\])?")


def identifier(name: str) -> str:
    """Return a name as C takes it, not a digit first.

    Examples
    --------
    >>> identifier("vgtu-piezo"), identifier("2 axes")
    ('vgtu_piezo', 'stage_2_axes')
    """
    kept = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")
    return kept if re.match(r"[A-Za-z]", kept) else f"stage_{kept}".rstrip("_")


def plain_names(names: Iterable[str]) -> list[str]:
    """Return a name of one part, in ASCII, for each name of drives or of probes, no two alike.

    Examples
    --------
    >>> plain_names(["x", "x.1", "x_1", "Kühler"])
    ['x', 'x_1', 'x_1_2', 'Kuhler']
    """
    found: list[str] = []
    for name in names:
        base = free = plain(name).replace(".", "_") or "_"
        count = 1
        # these two begin names of other variables
        while free in found or free in ("mode", "sensor"):
            count += 1
            free = f"{base}_{count}"
        found.append(free)
    return found


def structured(name: str) -> str:
    """Return a dotted name as FMI's structured naming convention has it.

    A part that is a number counts the part before it; others that are no identifiers are quoted.

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
