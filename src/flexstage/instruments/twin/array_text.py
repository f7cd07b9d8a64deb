"""Arrays as a GCS controller sends them: a heading of keys, then rows of numbers."""

from collections.abc import Iterator, Sequence

import numpy as np

from flexstage.arrays import Array

#: Rows of a piece: small enough that a client that reads slowly holds little memory.
_ROWS = 1000


def array_text(
    columns: Sequence[Array], names: Sequence[str], sample_time: float, remark: str
) -> Iterator[str]:
    r"""Return an array in pieces of text, the last of which ends with a line feed and no space.

    Columns are of one length, 1 at least; `sample_time` is from row to row [s].

    Examples
    --------
    >>> text = "".join(array_text([np.array([0.25, 0.5])], ["x"], 1e-4, "twin"))
    >>> text.splitlines()[5], text[-17:]
    ('# SAMPLE_TIME = 0.000100000000 ', '\n5.000000000e-01\n')
    """
    size = len(columns[0])
    heading = [
        f"REM = {remark}",
        "VERSION = 1",
        "TYPE = 1",
        "SEPARATOR = 32",
        f"DIM = {len(columns)}",
        f"SAMPLE_TIME = {sample_time:.12f}",
        f"NDATA = {size}",
        *(f"NAME{j} = {name}" for j, name in enumerate(names)),
        "END_HEADER",
    ]
    yield "".join(f"# {line} \n" for line in heading)
    row = " ".join(["%.9e"] * len(columns))
    for first in range(0, size, _ROWS):
        rows = np.column_stack([column[first : first + _ROWS] for column in columns])
        last = first + _ROWS >= size
        pattern = f"{row} \n" * (len(rows) - last) + (f"{row}\n" if last else "")
        yield pattern % tuple(rows.ravel().tolist())
