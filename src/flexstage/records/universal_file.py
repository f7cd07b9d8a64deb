"""Universal files of modal test systems: functions at points (data set 58) as columns in SI.

Units are from the labels, else from the units of the file (data set 164).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError, UnitError
from flexstage.records.columns import GRAVITY, FileColumn, FileColumns, measured_unit
from flexstage.records.universal_sets import KINDS, Function, FunctionAxis, UnitSystem, read_sets

Domain = Literal["time", "frequency"]
_DOMAINS: dict[int, Domain] = {17: "time", 18: "frequency"}
# kinds of functions over time or frequency by definition, for an abscissa without a kind
_BY_KIND: dict[int, Domain] = {1: "time", **dict.fromkeys((2, 3, 4, 6, 9, 10, 12), "frequency")}
_SI: dict[Domain, str] = {"time": "s", "frequency": "Hz"}
# kinds whose names have only the points
_UNNAMED = frozenset((1, 4))
# numbers from a wrong byte order exceed this
_NO_QUANTITY = 1e31
_ACCELERATION = 12
# kinds of quantity with units in set 164: powers of length and force, SI unit; of a rotation
_BY_SYSTEM = {
    8: ((1, 0, "m"), (0, 0, "rad")),
    9: ((0, 1, "N"), (1, 1, "N*m")),
    11: ((1, 0, "m/s"), (0, 0, "rad/s")),
    12: ((1, 0, "m/s^2"), (0, 0, "rad/s^2")),
    13: ((0, 1, "N"), (1, 1, "N*m")),
    17: ((0, 0, "s"), (0, 0, "s")),
    18: ((0, 0, "Hz"), (0, 0, "Hz")),
}
# kinds of functions with values in the unit of the ordinate; squares are ambiguous
_PLAIN = frozenset((1, 12))
_RATIOS = frozenset((4, 5))
_COHERENCE = 6


def read_universal(path: Path, dataset: str | None = None) -> FileColumns:
    r"""Read functions of a universal file, data sets 58 as text or binary.

    `dataset` has names, numbers from 0, or ranges of numbers such as ``0-11``, separated by commas.
    Functions with different abscissas are refused.

    A function of complex values has two columns, ``NAME real`` and ``NAME imaginary``. The name has
    the point and direction of the response, then of the reference, ``12:+z/3:+x``; functions other
    than time responses and frequency response functions have their kind before it.

    Validity
    --------
    Functions over time and frequency, not over order, revolutions or temperature. The step of the
    abscissa has six printed digits, which limits the accuracy of time and frequency.

    Examples
    --------
    >>> import tempfile
    >>> points = f"{4:5}{0:10}{0:5}{0:10} {'NONE':10}{12:10}{3:4} {'NONE':10}{3:10}{1:4}"
    >>> stored = "         2         2         1  2.50000E+00  5.00000E-01"
    >>> axes = [f"{quantity:10}" for quantity in (18, 12, 13, 0)]
    >>> lines = ["    -1", "    58", *(5 * ["NONE"]), points, stored, *axes]
    >>> lines += ["  3.12500E-01 -1.75000E+00", "    -1", ""]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "frf.uff"
    ...     _ = file.write_text("\n".join(lines))
    ...     columns = read_universal(file)
    >>> columns.columns[0].name, columns.columns[0].values, columns.axis
    ('12:+z/3:+x', array([ 0.3125, -1.75  ]), array([2.5, 3. ]))
    """
    functions = read_sets(path.read_bytes())
    if not functions:
        raise RecordError("the file has no function (data set 58): export time data or FRFs")
    names = _names(functions)
    selected = _selected(names, dataset)
    tables = {i: _values(functions[i], names[i]) for i in selected}
    domain, axis = _abscissa(functions, names, tables)
    columns: list[FileColumn] = []
    groups: dict[str, tuple[int, ...]] = {}
    notes: list[str] = []
    attributes: dict[str, str] = {}
    for number in selected:
        function, name = functions[number], names[number]
        units = function_units(function)
        if units.note:
            notes.append(f"{name}: {units.note}")
        values = tables[number][:, 1:]
        parts = (name,) if values.shape[1] == 1 else (f"{name} real", f"{name} imaginary")
        groups[name] = tuple(range(len(columns), len(columns) + len(parts)))
        columns += (
            FileColumn(name=p, values=np.ascontiguousarray(v), unit=units.text, si=units.si)
            for p, v in zip(parts, values.T, strict=True)
        )
        attributes |= _attributes(function, name, units.output, units.input)
    even = all(not functions[i].layout.uneven for i in selected)
    step = float(axis[1] - axis[0])
    if domain == "time" and not even:
        columns.append(FileColumn(name="time", values=axis, unit="s"))
    return FileColumns(
        columns=tuple(columns),
        sample_rate_hz=1.0 / step if domain == "time" and even else None,
        start=float(axis[0]) if domain == "time" and even else 0.0,
        rate_source="the step of the abscissa",
        notes=tuple(notes),
        attributes=attributes,
        over=domain,
        axis=axis if domain == "frequency" else None,
        groups=groups,
    )


def _names(functions: Sequence[Function]) -> list[str]:
    """Return a distinct name for each function."""
    names: list[str] = []
    for function in functions:
        name = "/".join(point for point in (function.response, function.reference) if point)
        if function.kind not in _UNNAMED or not name:
            name = f"{_kind(function)} {name}".strip()
        names.append(name)
    repeated = {name for name in names if names.count(name) > 1}
    return [f"{name} #{i}" if name in repeated else name for i, name in enumerate(names)]


def _kind(function: Function) -> str:
    return KINDS[function.kind] if function.kind < len(KINDS) else f"function {function.kind}"


def _listed(names: Sequence[str], most: int = 20) -> str:
    listed = ", ".join(f"{i}: {name}" for i, name in enumerate(names[:most]))
    return listed + (f" and {len(names) - most} more" if len(names) > most else "")


def _selected(names: Sequence[str], dataset: str | None) -> list[int]:
    """Return the numbers of the selected functions."""
    if dataset is None:
        return list(range(len(names)))
    numbers: list[int] = []
    for word in (w.strip() for w in dataset.split(",")):
        span = re.fullmatch(r"(\d{1,7})(?:-(\d{1,7}))?", word)
        if word in names:
            numbers.append(names.index(word))
        elif span is not None and int(span[2] or span[1]) < len(names):
            numbers += range(int(span[1]), int(span[2] or span[1]) + 1)
        else:
            raise RecordError(f"there is no function '{word}': the file has {_listed(names)}")
    selected = list(dict.fromkeys(numbers))
    if not selected:
        raise RecordError(f"'{dataset}' selects no function: the file has {_listed(names)}")
    return selected


def _values(function: Function, name: str) -> Array:
    try:
        table = function.table()
    except RecordError as error:
        raise RecordError(f"function '{name}': {error}") from None
    largest = float(np.max(np.abs(table), where=np.isfinite(table), initial=0.0))
    if largest >= _NO_QUANTITY:
        raise RecordError(
            f"function '{name}' has implausible numbers up to {largest:.1e}: the byte order in the "
            "file may be wrong; export it as text"
        )
    return table


def _abscissa(
    functions: Sequence[Function], names: Sequence[str], tables: Mapping[int, Array]
) -> tuple[Domain, Array]:
    """Return the domain of the functions, and their common abscissa in SI."""
    first, *others = tables
    domain, axis = _one_abscissa(functions[first], names[first], tables[first])
    for number in others:
        other, its = _one_abscissa(functions[number], names[number], tables[number])
        if other != domain or its.size != axis.size or not _same(its, axis):
            described = (
                f"{first}: {names[first]} ({_span(domain, axis)}) and {number}: {names[number]} "
                f"({_span(other, its)})"
            )
            raise RecordError(
                f"its functions have different abscissas, such as {described}: select functions by "
                f"the option dataset, of {_listed(names)}"
            )
    if not np.all(np.diff(axis) > 0.0) and domain == "frequency":
        raise RecordError(f"the frequencies of function '{names[first]}' must rise")
    return domain, axis


def _one_abscissa(function: Function, name: str, table: Array) -> tuple[Domain, Array]:
    domain = _DOMAINS.get(function.abscissa.quantity)
    if domain is None and function.abscissa.quantity in (0, 1):
        domain = _BY_KIND.get(function.kind)
    if domain is None:
        raise RecordError(
            f"function '{name}' is over neither time nor frequency (kind "
            f"{function.abscissa.quantity}): select others by the option dataset"
        )
    unit = axis_unit(function.abscissa, None) if function.abscissa.label else (1.0, _SI[domain])
    if unit is None or unit[1] != _SI[domain]:
        raise RecordError(
            f"the {domain} of function '{name}' has the label '{function.abscissa.label}', which "
            f"is no unit of {domain}: export it in {_SI[domain]}"
        )
    axis = table[:, 0] * unit[0]
    if not np.isfinite(axis).all():
        raise RecordError(f"the {domain} of function '{name}' is not finite at all of its samples")
    return domain, axis


def _same(one: Array, other: Array) -> bool:
    scale = float(np.abs(other).max())
    # an abscissa is printed with six digits
    same = 2e-6
    return bool(np.abs(one - other).max() <= same * scale)


def _span(domain: Domain, axis: Array) -> str:
    return f"{axis.size} samples from {axis[0]:g} to {axis[-1]:g} {_SI[domain]}"


def _attributes(function: Function, name: str, output: str, input: str) -> dict[str, str]:
    texts = {
        "kind": _kind(function),
        "output": function.response,
        "input": function.reference,
        "output unit": output,
        "input unit": input,
        "title": function.title,
        "date": function.date,
    }
    return {f"{key} of {name}": text for key, text in texts.items() if text}


@dataclass(frozen=True, slots=True, kw_only=True)
class FunctionUnits:
    """Units of a function, in SI."""

    text: str = ""
    """Unit of the values in the file."""
    si: tuple[float, str] | None = None
    """Factor and SI unit; None if unknown."""
    output: str = ""
    """SI unit of the output; empty if unknown."""
    input: str = ""
    """SI unit of the input; empty if unknown."""
    note: str = ""
    """Remark on the units."""


def axis_unit(axis: FunctionAxis, system: UnitSystem | None) -> tuple[float, str] | None:
    """Return the factor and SI unit of an axis; None if unknown.

    Examples
    --------
    >>> axis_unit(FunctionAxis(quantity=12, label="g"), None)
    (9.80665, 'm/s^2')
    >>> axis_unit(FunctionAxis(quantity=12), None) is None
    True
    """
    if axis.label in GRAVITY:
        return (GRAVITY[axis.label], "m/s^2") if axis.quantity == _ACCELERATION else None
    if axis.label:
        try:
            return measured_unit(axis.label)
        except UnitError:
            return None
    if axis.quantity in (17, 18):
        return 1.0, _BY_SYSTEM[axis.quantity][0][2]
    if system is None or axis.quantity not in _BY_SYSTEM:
        return None
    length, force, unit = _BY_SYSTEM[axis.quantity][int(axis.rotational)]
    return 1.0 / (system.length**length * system.force**force), unit


def function_units(function: Function) -> FunctionUnits:
    """Return the units of a function in SI.

    Validity
    --------
    Power spectra and correlations have no unit: in some programs the label is the quantity, in
    others its square.
    """
    if function.kind == _COHERENCE:
        return FunctionUnits(text="1", si=(1.0, "1"))
    numerator = axis_unit(function.ordinate, function.system)
    if function.kind in _PLAIN or (function.kind == 0 and function.denominator.quantity == 0):
        return FunctionUnits(
            text=function.ordinate.label or (numerator[1] if numerator else ""),
            si=numerator,
            output=numerator[1] if numerator else "",
            note=_unknown(function.ordinate, numerator),
        )
    if function.kind in _RATIOS or function.kind == 0:
        return _ratio(function, numerator)
    return FunctionUnits()


def _ratio(function: Function, numerator: tuple[float, str] | None) -> FunctionUnits:
    """Return the units of an output over an input."""
    above, below = function.ordinate, function.denominator
    denominator = axis_unit(below, function.system)
    if numerator is not None and _is_whole(above, numerator[1], below, denominator):
        output, _, per = numerator[1].rpartition("/") if "(" not in numerator[1] else ("", "", "")
        return FunctionUnits(text=above.label, si=numerator, output=output, input=per)
    output = numerator[1] if numerator else ""
    per = denominator[1] if denominator else ""
    if numerator is None or denominator is None:
        notes = (_unknown(above, numerator), _unknown(below, denominator))
        return FunctionUnits(output=output, input=per, note="; ".join(n for n in notes if n))
    return FunctionUnits(
        text=_quotient(above.label or output, below.label or per),
        si=(numerator[0] / denominator[0], _quotient(output, per)),
        output=output,
        input=per,
    )


def _is_whole(
    above: FunctionAxis, unit: str, below: FunctionAxis, denominator: tuple[float, str] | None
) -> bool:
    """Return whether the label of the ordinate is already that of the quotient."""
    kinds = _BY_SYSTEM.get(above.quantity)
    plain = kinds[int(above.rotational)][2] if kinds else ""
    if denominator is not None:
        return bool(plain) and unit == _quotient(plain, denominator[1])
    # "m/s" is a velocity, not a length over a time as input
    return not below.label and unit != plain and "/" in unit and not unit.endswith(("/s", "/s^2"))


def _quotient(above: str, below: str) -> str:
    if above == below:
        return "1"
    return f"{above}/({below})" if "/" in below else f"{above}/{below}"


def _unknown(axis: FunctionAxis, unit: tuple[float, str] | None) -> str:
    return f"'{axis.label}' is an unknown unit" if axis.label and unit is None else ""
