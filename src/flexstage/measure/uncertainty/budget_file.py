"""Reads an uncertainty budget from a file: an equation, its influences and their correlations."""

import math
import re
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple, cast

from flexstage.choose import did_you_mean
from flexstage.errors import ModelError, RecordError, UnitError
from flexstage.files.decoder import Decoder, read, read_file, show
from flexstage.files.expression import QuantityExpression, check_name
from flexstage.files.format import Form, Format
from flexstage.files.nodes import Mapping, Node, Scalar
from flexstage.files.request import request_of
from flexstage.measure.requests import UncertaintyRequest
from flexstage.measure.uncertainty.expression import (
    INFLUENCES,
    compute,
    equation_of,
    require_unit,
)
from flexstage.measure.uncertainty.influence import Influence, correlation_matrix
from flexstage.measure.uncertainty.monte_carlo import MonteCarlo, monte_carlo
from flexstage.measure.uncertainty.propagate import Propagated, propagate
from flexstage.records.columns import measured_unit

_NUMBER = r"[+-]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][+-]?\d{1,3})?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})(?:\s*([^\d\s.,+-].{{0,40}}?)|\s+(1/.{{1,40}}?))?\s*")


class _Correlation(NamedTuple):
    """A correlation coefficient with the names of two influences."""

    first: str
    second: str
    coefficient: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """An uncertainty budget."""

    quantity: str = "result"
    """What the result is called."""
    unit: str = "1"
    """Unit that the result is shown in."""
    equation: QuantityExpression
    """The result from its influences, in SI."""
    influences: tuple[Influence, ...]
    """The influences, values in SI."""
    correlations: tuple[_Correlation, ...] = ()
    """Correlation coefficients, each after the names of two influences."""
    notes: str = ""
    """Remarks of its author."""

    @property
    def factor(self) -> float:
        """How many SI units one unit of the result is."""
        return measured_unit(self.unit)[0]

    @property
    def si(self) -> str:
        """SI unit of the result."""
        return measured_unit(self.unit)[1]

    def propagate(self) -> Propagated:
        """Propagate to first order; the result is in SI."""
        return propagate(self._result, self.influences, self._coefficients(), unit=self.si)

    def monte_carlo(self, request: UncertaintyRequest | None = None, **asked: Any) -> MonteCarlo:
        """Draw the result at random, in SI.

        Fields of `UncertaintyRequest` may be named in place of those of a request.
        """
        request = request_of(UncertaintyRequest, request, asked)
        return monte_carlo(
            self._result,
            self.influences,
            self._coefficients(),
            trials=request.trials,
            seed=request.seed,
            confidence=request.confidence,
            unit=self.si,
        )

    def _result(self, *values: Any) -> Any:
        names = (one.name for one in self.influences)
        return compute(self.equation, dict(zip(names, values, strict=True)))

    def _coefficients(self) -> dict[tuple[str, str], float]:
        return {(one.first, one.second): one.coefficient for one in self.correlations}


def read_budget(path: Path) -> Budget:
    """Read an uncertainty budget from a file.

    Parameters
    ----------
    path : pathlib.Path
        A YAML file with ``quantity``, ``unit``, ``equation``, ``influences`` (each with ``name``,
        ``value``, ``uncertainty`` or ``half_width`` unless it is a constant, and if wanted
        ``distribution``, ``dof``, ``kind``, ``source``) and ``correlations`` (each
        ``[name, name, coefficient]``).

    Returns
    -------
    Budget
        The budget, in SI.

    Raises
    ------
    RecordError
        There is no such file, or it is no budget; the line is named.
    """
    return _budget(*read_file(path, BUDGET_FILE))


def budget_from_text(text: str, source: str = "budget") -> Budget:
    """Read an uncertainty budget from text.

    Examples
    --------
    >>> budget = budget_from_text('''
    ... quantity: stroke
    ... unit: um
    ... equation: l * (1 + c)
    ... influences:
    ...   - {name: l, value: 63.12 um, uncertainty: 12 nm, dof: 9}
    ...   - {name: c, value: 0, half_width: 0.03 %}
    ... ''')
    >>> round(budget.propagate().uncertainty * 1e9, 2)
    16.23
    """
    return _budget(*read(text, source, BUDGET_FILE))


class _Quantity(NamedTuple):
    """A value in SI with its unit."""

    value: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Entry:
    """An influence: its value, and its uncertainty or half-width unless it is a constant."""

    name: str
    """Its name in the equation."""
    value: _Quantity
    """Its best estimate."""
    uncertainty: _Quantity | None = None
    """Its standard uncertainty."""
    half_width: _Quantity | None = None
    """Half of the interval that it lies in."""
    distribution: str | None = None
    """How it is spread: normal, student, uniform, triangular, arcsine or trapezoidal."""
    dof: float = math.inf
    """Degrees of freedom of its uncertainty."""
    kind: str | None = None
    """A from repeated observations, B otherwise; A where degrees of freedom are given."""
    flat_share: float = 0.5
    """Top over base of a trapezoid [1]."""
    source: str = ""
    """Where its figures come from."""


def _budget(decoder: Decoder, root: Mapping) -> Budget:
    budget: Budget = decoder.build(Budget, root, "")
    budget = replace(
        budget,
        quantity=budget.quantity.strip(),
        unit=budget.unit.strip(),
        notes=budget.notes.strip(),
    )
    places, influences = root.items, budget.influences
    if not influences:
        decoder.refuse(places["influences"], "influences", "expected one entry at least, got none")
    try:
        unit = budget.si
    except UnitError as error:
        decoder.refuse_again(places["unit"], "unit", error)
    if fault := _unmatched(budget.equation, [one.name for one in influences]):
        decoder.refuse(places["equation"], "equation", fault)
    try:
        require_unit(budget.equation, {one.name: one.unit for one in influences}, unit)
    except (ModelError, UnitError) as error:
        decoder.refuse_again(places["equation"], "equation", error)
    pairs = [((one.first, one.second), one.coefficient) for one in budget.correlations]
    for k in range(len(pairs)):
        try:
            correlation_matrix(influences, pairs[: k + 1])
        except ModelError as error:
            place = decoder.items(places["correlations"], "correlations", None, "entries")[k]
            decoder.refuse(place, f"correlations[{k}]", str(error))
    return budget


def _unmatched(equation: QuantityExpression, have: list[str]) -> str:
    """Say what only one of equation and influences names; nothing where all is well."""
    for name in sorted(equation.names - set(have)):
        return f"the equation names '{name}', which is no influence{did_you_mean(name, have)}"
    for name in have:
        if name not in equation.names:
            return f"the equation does not use the influence '{name}'"
    return ""


def _read_correlation(decoder: Decoder, node: Node, path: str, _base: Any) -> _Correlation:
    written = "3 entries, [name, name, coefficient]"
    first, second, coefficient = decoder.items(node, path, 3, written)
    return _Correlation(
        decoder.text(first, f"{path}[0]"),
        decoder.text(second, f"{path}[1]"),
        decoder.number(coefficient, f"{path}[2]"),
    )


def _read_influence(decoder: Decoder, node: Node, path: str, _base: Any) -> Influence:
    if not isinstance(node, Mapping):
        sentence = f"an influence is a mapping with 'name' and 'value', got {show(node)}"
        decoder.refuse(node, path, sentence)
    entry: _Entry = decoder.build(_Entry, node, path)
    name = entry.name.strip()
    try:
        check_name(name, INFLUENCES)
    except UnitError as error:
        decoder.refuse_again(node.items["name"], f"{path}.name", error)
    sizes: dict[str, float] = {}
    for key in ("uncertainty", "half_width"):
        if (size := getattr(entry, key)) is not None:
            sizes[key] = _width(decoder, node.items[key], f"{path}.{key}", entry.value, size)
    if not sizes:
        for key in ("distribution", "dof", "flat_share"):
            if key in node.items:
                decoder.refuse(
                    node.items[key],
                    f"{path}.{key}",
                    f"the influence '{name}' has '{key}' and no uncertainty: give its uncertainty "
                    f"or its half_width, or leave '{key}' out of a constant",
                )
        sizes["uncertainty"] = 0.0
    repeated = math.isfinite(entry.dof) and "half_width" not in sizes
    try:
        return Influence(
            name=name,
            value=entry.value.value,
            unit=entry.value.unit,
            distribution=entry.distribution or None,
            degrees_of_freedom=entry.dof,
            kind=cast(Any, entry.kind or ("A" if repeated else "B")),
            flat_share=entry.flat_share,
            source=entry.source.strip(),
            **sizes,
        )
    except ModelError as error:
        decoder.refuse(node, path, str(error))


def _width(decoder: Decoder, node: Node, path: str, value: _Quantity, size: _Quantity) -> float:
    """Return a width in the unit of its value; a degree Celsius is a kelvin there.

    Percent are of the value, unless that is a number, or a temperature with a zero of its own.
    """
    if "%" in show(node) and value.unit not in ("1", "degC"):
        return size.value * abs(value.value)
    unit = "degC" if value.unit == "degC" and size.unit == "K" else size.unit
    if unit != value.unit:
        decoder.refuse(
            node,
            path,
            f"the value is in {value.unit}, but '{path.rpartition('.')[2]}' is {show(node)}: give "
            "it in the same kind of unit",
        )
    return size.value


def _read_quantity(decoder: Decoder, node: Node, path: str, _base: Any) -> _Quantity:
    text = node.text.strip() if isinstance(node, Scalar) else ""
    match = _QUANTITY.fullmatch(text)
    if match is None:
        decoder.refuse(node, path, f"expected a number and a unit, as '12 nm', got {show(node)}")
    number, written, inverse = match.groups()
    try:
        factor, unit = measured_unit(written or inverse or "1")
    except UnitError as error:
        decoder.refuse_again(node, path, error)
    value = float(Decimal(number) * Decimal(repr(factor)))
    if not math.isfinite(value):
        decoder.refuse(node, path, f"{show(node)} is too large to be a number")
    return _Quantity(value, unit)


def _read_equation(decoder: Decoder, node: Node, path: str, _base: Any) -> QuantityExpression:
    try:
        return equation_of(decoder.text(node, path).strip())
    except UnitError as error:
        decoder.refuse_again(node, path, error)


#: The kind of file that holds an uncertainty budget.
BUDGET_FILE = Format(
    noun="budget file",
    begins="quantity: NAME",
    error=RecordError,
    only=True,
    forms={
        _Correlation: Form(
            read=_read_correlation,
            schema=lambda _: {"type": "array", "minItems": 3, "maxItems": 3},
        ),
        QuantityExpression: Form(
            read=_read_equation, schema=lambda _: {"type": ["string", "number"]}
        ),
        Influence: Form(
            read=_read_influence, schema=lambda builder: builder.describe(_Entry, named=True)
        ),
        _Quantity: Form(read=_read_quantity, schema=lambda _: {"type": ["string", "number"]}),
    },
)
