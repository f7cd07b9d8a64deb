"""Files of modal test systems, controllers and measuring machines, written by hand for tests."""

import struct
from collections.abc import Iterable, Sequence

import numpy as np

OPEN = b"    -1\n"


def function_58(
    values: Sequence[complex],
    *,
    x: Sequence[float] | None = None,
    start: float = 0.0,
    step: float = 0.5,
    double: bool = True,
    binary: str = "",
    single_x: bool = True,
    kind: int = 4,
    response: tuple[int, int] = (12, 3),
    reference: tuple[int, int] = (3, -1),
    abscissa: tuple[int, str] = (18, "Hz"),
    ordinate: tuple[int, str] = (12, "m/s^2"),
    denominator: tuple[int, str] = (13, "N"),
    title: str = "hammer on the frame",
    newline: bytes = b"\n",
) -> bytes:
    """Return data set 58 as the public description of the format has it."""
    y = np.asarray(values)
    data_type = (4 if double else 2) if y.dtype.kind != "c" else (6 if double else 5)
    row = [y.real] if y.dtype.kind != "c" else [y.real, y.imag]
    numbers = [v for j, parts in enumerate(zip(*row, strict=True)) for v in _with_x(x, j, parts)]
    axes = [abscissa, ordinate, denominator, (0, "")]
    record_7 = f"{data_type:10d}{len(y):10d}{int(x is None):10d}"
    record_7 += f"{start if x is None else 0.0:13.5E}{step if x is None else 0.0:13.5E}{0.0:13.5E}"
    heading = [
        title,
        "NONE",
        "04-Mar-21 10:00:00",
        "NONE",
        "NONE",
        f"{kind:5d}{1:10d}{1:5d}{0:10d} {'NONE':10s}{response[0]:10d}{response[1]:4d}"
        f" {'NONE':10s}{reference[0]:10d}{reference[1]:4d}",
        record_7,
        *(f"{q:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {unit or 'NONE':20s}" for q, unit in axes),
    ]
    lines = newline.join(line.encode("latin-1") for line in heading) + newline
    if binary:
        body = _binary(numbers, binary, double, x is not None, len(row), single_x)
        order = 1 if binary == "<" else 2
        first = f"    58b{order:6d}{2:6d}{11:12d}{len(body):12d}{0:6d}{0:6d}{0:12d}{0:12d}"
        return _closed(first.encode() + newline + lines + body, newline)
    body = newline.join(_text(numbers, double, x is not None, len(row))) + newline
    return _closed(f"{58:6d}".encode() + newline + lines + body, newline)


def _closed(content: bytes, newline: bytes) -> bytes:
    return OPEN.rstrip().rjust(6) + newline + content + b"    -1" + newline


def _with_x(x: Sequence[float] | None, j: int, parts: Iterable[float]) -> list[float]:
    return [*([] if x is None else [x[j]]), *parts]


def _text(numbers: Sequence[float], double: bool, uneven: bool, width: int) -> Iterable[bytes]:
    widths = [13] * 6
    if double:
        widths = [20] * 4 if not uneven else [13, 20] * 2 if width == 1 else [13, 20, 20]
    for at in range(0, len(numbers), len(widths)):
        part = zip(numbers[at : at + len(widths)], widths, strict=False)
        yield "".join(f"{v:{w}.{5 if w == 13 else 12}E}" for v, w in part).encode()


def _binary(
    numbers: Sequence[float], order: str, double: bool, uneven: bool, width: int, single_x: bool
) -> bytes:
    letters = ("d" if double else "f") * width
    if uneven:
        letters = ("f" if single_x or not double else "d") + letters
    return b"".join(
        struct.pack(order + letters, *numbers[at : at + len(letters)])
        for at in range(0, len(numbers), len(letters))
    )


def units_164(length: float, force: float) -> bytes:
    """Return data set 164, units of the file."""
    numbers = "".join(f"{v:25.16E}".replace("E", "D") for v in (length, force, 1.0))
    text = f"{164:6d}\n{9:10d}{'user units':>20s}{2:10d}\n{numbers}\n{273.15:25.16E}\n"
    return OPEN + text.encode() + b"    -1\n"


def gcs_array(
    rows: Sequence[Sequence[float]], names: Sequence[str], sample_time: float, **keys: object
) -> str:
    """Return an array file of a GCS controller; a key that is None is left out."""
    said: dict[str, object] = {
        "VERSION": 1,
        "TYPE": 1,
        "SEPARATOR": 32,
        "DIM": len(names),
        "SAMPLE_TIME": f"{sample_time:.6f}",
        "NDATA": len(rows),
    }
    said |= keys
    head = ["# REM controller of a test", "#"]
    head += [f"# {key} = {value} " for key, value in said.items() if value is not None]
    head += [f"# NAME{j} = {name}" for j, name in enumerate(names)] + ["# ", "# END_HEADER "]
    sign = chr(int(str(said["SEPARATOR"]))) if said["SEPARATOR"] is not None else " "
    return "\n".join([*head, *(sign.join(f"{v!r}" for v in row) + " " for row in rows)]) + "\n"


def report(
    points: Sequence[Sequence[tuple[str, Sequence[tuple[str, float, float]]]]],
    *,
    order: Sequence[str] = ("NOMINAL", "+TOL", "-TOL", "MEAS", "DEV", "OUTTOL"),
    unit: str = "MM",
    opening: str = "DIM LOC{number}= LOCATION OF SPHERE {feature}  UNITS={unit}",
    axis_word: str = "AX",
    words: dict[str, str] | None = None,
    decimal: str = ".",
    digits: int = 4,
    width: int = 12,
) -> str:
    """Return a text report, one block for each feature at each point."""
    lines = ["DATE=17-Sep-21          TIME=10:04:11", "PART NAME  : stage, plate of spheres", ""]
    heading = axis_word.ljust(2) + "".join((words or {}).get(w, w).rjust(width) for w in order)
    number = 0
    for features in points:
        for feature, axes in features:
            number += 1
            lines.append(opening.format(number=number, feature=feature, unit=unit))
            lines.append(heading)
            for axis, nominal, measured in axes:
                cells = {
                    "NOMINAL": nominal,
                    "+TOL": 0.05,
                    "-TOL": -0.05,
                    "MEAS": measured,
                    "DEV": measured - nominal,
                    "OUTTOL": 0.0,
                }
                row = axis.ljust(2) + "".join(f"{cells[w]:{width}.{digits}f}" for w in order)
                lines.append(row.replace(".", decimal) + " ----#----")
    return "\n".join(lines) + "\n"
