"""Uncertainty budgets: equation, influences and correlations from a file, and their evaluation."""

import ast
import math
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from decimal import Decimal
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, NoReturn, cast

import numpy as np

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import ModelError, RecordError, UnitError
from flexstage.files.decoder import Decoder, read, read_file, show
from flexstage.files.expression import (
    Amount,
    Grammar,
    Powers,
    QuantityExpression,
    check_name,
    computing,
    evaluate,
    fold,
    noun_of,
    parse,
    power,
    powers_in,
    product,
    short_text,
)
from flexstage.files.format import Form, Format
from flexstage.files.nodes import Mapping, Node, Scalar
from flexstage.files.plain import picked, plain
from flexstage.files.request import request_of
from flexstage.files.result import Result
from flexstage.measure.requests import UncertaintyRequest
from flexstage.measure.uncertainty.monte_carlo import MonteCarlo, monte_carlo, validate
from flexstage.measure.uncertainty.propagate import (
    Influence,
    Propagated,
    correlation_matrix,
    propagate,
)
from flexstage.records.columns import measured_unit

_APPLIED = ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log")


def _applied(name: str, *arguments: Any) -> Any:
    """A function by its name, of the kind of its arguments: floats, arrays or uncertain numbers.

    Angles are in rad.

    Examples
    --------
    >>> sin(0.5)
    0.479425538604203
    """
    if any(isinstance(a, np.ndarray) for a in arguments):
        # values outside the domain come back as no numbers, which the caller counts
        with np.errstate(all="ignore"):
            return getattr(np, name)(*arguments)
    if all(isinstance(a, (int, float)) for a in arguments):
        return getattr(math, name)(*map(float, arguments))
    import GTC

    return getattr(GTC, name)(*arguments)


def fabs(x: Any) -> Any:
    """Return the value without its sign; an uncertain number keeps its uncertainty."""
    if isinstance(x, np.ndarray):
        return np.abs(x)
    # GTC's own abs gives up the derivative
    return -x if x < 0.0 else +x


def hypot(x: Any, *others: Any) -> Any:
    """Return the distance of a point from the origin."""
    return sqrt(sum((other * other for other in others), x * x))


#: The functions by the name that an equation calls them by.
FUNCTIONS: dict[str, Callable[..., Any]] = {name: partial(_applied, name) for name in _APPLIED}
FUNCTIONS |= {"abs": fabs, "hypot": hypot}
sqrt, sin, cos, tan, asin, acos, atan, atan2, exp, log = (FUNCTIONS[name] for name in _APPLIED)

#: What an equation may be made of.
INFLUENCES = Grammar("influence", "numbers and names of influences", tuple(FUNCTIONS))
_OPERATIONS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
_TEMPERATURE = powers_in("K")


def equation_of(text: str) -> QuantityExpression:
    """Read an equation such as ``l * (1 + c) / cos(a) - d * pitch``.

    Only numbers, names, ``+ - * / **``, brackets, ``pi`` and the functions ``sqrt sin cos tan asin
    acos atan atan2 exp log abs hypot`` have a meaning; whatever else the text holds is refused
    before anything is computed.

    Examples
    --------
    >>> volume = equation_of("pi * d**2 / 4 * h")
    >>> round(compute(volume, {"d": 2.0, "h": 3.0}), 4)
    9.4248
    """
    equation = parse(text, INFLUENCES)
    for unit in sorted(equation.units):
        raise UnitError(f"enter a number with a unit, '{unit}', as an influence")
    return equation


def compute(equation: QuantityExpression, values: dict[str, Any]) -> Any:
    """Compute an equation with uncertain numbers, arrays or floats, one for each of its names.

    Numbers are floats, so that a power that is too large ends as an error.
    """
    constants = {name: float(amount.value) for name, amount in equation.constants.items()}
    arguments = equation.by_name({**constants, "pi": math.pi}, values)
    try:
        return fold(equation.tree, computing(arguments, _OPERATIONS, FUNCTIONS))
    except (ArithmeticError, ValueError) as error:
        raise ModelError(
            f"the equation {short_text(equation.text)} has no value: {error}"
        ) from error


def require_unit(equation: QuantityExpression, units: dict[str, str], unit: str) -> None:
    """Refuse an equation that joins what is of two kinds, or whose result is not of its unit.

    A number in the equation is dimensionless, except next to a temperature in degrees Celsius,
    where it is a temperature too: the reference of an expansion is written as ``t - 20``. Angles
    are dimensionless, as in SI.
    """
    plain: Powers = ()
    arguments = equation.by_name(
        dict.fromkeys([*equation.constants, "pi"], plain),
        {name: powers_in(one) for name, one in units.items()},
    )
    celsius = {f"p_{name}" for name, one in units.items() if one == "degC"}

    def in_celsius(node: ast.expr, kind: Powers) -> bool:
        return kind == _TEMPERATURE and not celsius.isdisjoint(_names(node))

    def same_kind(does: str, nodes: list[ast.expr], kinds: tuple[Powers, ...]) -> Powers:
        (a, b), (first, second) = nodes, kinds
        if first == second or (_is_number(b) and in_celsius(a, first)):
            return first
        if _is_number(a) and in_celsius(b, second):
            return second
        hint = "; enter a number with a unit as an influence"
        raise ModelError(
            f"the equation {does} {equation.part(a)}, {noun_of(first)}, and {equation.part(b)}, "
            f"{noun_of(second)}, which differ in dimension: give both the same dimension"
            f"{hint if _is_number(a) or _is_number(b) else ''}"
        )

    def step(node: ast.expr, *kinds: Powers) -> Powers:
        match node:
            case ast.Name(id=name):
                return arguments[name]
            case ast.UnaryOp():
                return kinds[0]
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right):
                does = "adds" if isinstance(op, ast.Add) else "subtracts"
                return same_kind(does, [left, right], kinds)
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                return _raised(equation, left, right, kinds)
            case ast.BinOp(op=op):
                return product(kinds[0], kinds[1], 1 if isinstance(op, ast.Mult) else -1)
            case ast.Call(func=ast.Name(id="atan2" | "hypot" as name), args=args):
                common = kinds[0]
                for one, kind in zip(args[1:], kinds[1:], strict=True):
                    common = same_kind(f"takes {name} of", [args[0], one], (common, kind))
                return common if name == "hypot" else plain
            case ast.Call(func=ast.Name(id="abs")):
                return kinds[0]
            case ast.Call(func=ast.Name(id="sqrt")):
                return power(Amount(Fraction(1), kinds[0]), Amount(Fraction(1, 2))).powers
            case ast.Call(func=ast.Name(id=name), args=args) if kinds[0]:
                _refuse(
                    f"takes {name} of {equation.part(args[0])}, {noun_of(kinds[0])}, where only a "
                    "dimensionless number or an angle is allowed"
                )
        return plain

    powers, required = fold(equation.tree, step), powers_in(unit)
    if powers != required:
        raise ModelError(
            f"the equation gives {noun_of(powers)}, but the result is {noun_of(required)}: "
            "correct the equation, the unit of the result or that of an influence"
        )


def _raised(
    equation: QuantityExpression, base: ast.expr, exponent: ast.expr, kinds: tuple[Powers, ...]
) -> Powers:
    """The dimension of a power."""
    if kinds[1]:
        _refuse(f"raises to the power of {equation.part(exponent)}, {noun_of(kinds[1])}")
    if not kinds[0]:
        return kinds[0]
    if not _is_number(exponent):
        _refuse(
            f"raises {equation.part(base)}, {noun_of(kinds[0])}, to the power of "
            f"{equation.part(exponent)}, where only a number is allowed"
        )
    alone = replace(equation, tree=exponent, names=frozenset())
    return power(Amount(Fraction(1), kinds[0]), evaluate(alone, {})).powers


def _names(node: ast.expr) -> set[str]:
    return {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}


def _is_number(node: ast.expr) -> bool:
    """Say whether a part of the tree is made of numbers alone."""
    words = _names(node) - {"pi"}
    return all(word.startswith("_") for word in words)


def _refuse(what: str) -> NoReturn:
    raise ModelError(f"the equation {what}: divide by what makes it a plain number")


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

    def monte_carlo(self, request: UncertaintyRequest | None = None, **fields: Any) -> MonteCarlo:
        """Draw the result at random, in SI.

        Fields of `UncertaintyRequest` may be named in place of those of a request.
        """
        request = request_of(UncertaintyRequest, request, fields)
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
        decoder.refuse(places["influences"], "influences", "expected at least one entry, got none")
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
        return f"the equation names '{name}', which is not an influence{did_you_mean(name, have)}"
    for name in have:
        if name not in equation.names:
            return f"the equation does not use the influence '{name}'"
    return ""


def _read_correlation(decoder: Decoder, node: Node, path: str, _base: Any) -> _Correlation:
    form = "3 entries, [name, name, coefficient]"
    first, second, coefficient = decoder.items(node, path, 3, form)
    return _Correlation(
        decoder.text(first, f"{path}[0]"),
        decoder.text(second, f"{path}[1]"),
        decoder.number(coefficient, f"{path}[2]"),
    )


def _read_influence(decoder: Decoder, node: Node, path: str, _base: Any) -> Influence:
    if not isinstance(node, Mapping):
        sentence = f"an influence must be a mapping with 'name' and 'value', got {show(node)}"
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
                    f"the influence '{name}' has '{key}' but no uncertainty: give its uncertainty "
                    f"or its half_width, or omit '{key}' for a constant",
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
    number, unit_text, inverse = match.groups()
    try:
        factor, unit = measured_unit(unit_text or inverse or "1")
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EvaluatedBudget(Result):
    """Evaluation of an uncertainty budget by the GUM and by Monte Carlo."""

    table_key: ClassVar[str] = "influences"

    budget: Budget
    """The budget."""
    propagated: Propagated
    """Result to first order, in SI."""
    simulated: MonteCarlo
    """Result by Monte Carlo, in SI."""

    def data(self) -> dict[str, Any]:
        budget, propagated, simulated = self.budget, self.propagated, self.simulated
        agreement = validate(propagated, simulated)
        scale = 1.0 / budget.factor

        def scaled(ends: tuple[float, float]) -> list[float]:
            return [scale * end for end in ends]

        ends = propagated.interval(simulated.confidence)
        u = propagated.uncertainty
        return {
            "quantity": budget.quantity,
            "unit": budget.unit,
            "equation": budget.equation.text,
            "confidence": simulated.confidence,
            "influences": [
                {
                    **picked(line, "name", "value", "standard_uncertainty=uncertainty"),
                    **picked(line, "unit", "degrees_of_freedom", "distribution", "kind"),
                    "sensitivity": scale * line.sensitivity,
                    "contribution": scale * line.contribution,
                    **picked(line, "share", "source"),
                }
                for line in propagated.lines
            ],
            "correlations": [
                {"between": [first, second], "coefficient": r}
                for first, second, r in budget.correlations
            ],
            "gum": {
                "value": scale * propagated.value,
                "standard_uncertainty": scale * u,
                "degrees_of_freedom": plain(propagated.degrees_of_freedom),
                "coverage_factor": 0.5 * (ends[1] - ends[0]) / u if u > 0.0 else None,
                "expanded_uncertainty": scale * 0.5 * (ends[1] - ends[0]),
                "interval": scaled(ends),
            },
            "monte_carlo": {
                "value": scale * simulated.value,
                "standard_uncertainty": scale * simulated.uncertainty,
                "interval": scaled(simulated.symmetric),
                "shortest_interval": scaled(simulated.shortest),
                "trials": simulated.trials,
                "seed": simulated.seed,
                "tolerance": None if simulated.tolerance is None else scale * simulated.tolerance,
            },
            "agreement": {
                "valid": agreement.valid,
                "tolerance": scale * agreement.tolerance,
                "low": scale * agreement.low,
                "high": scale * agreement.high,
            },
            "notes": [*_constants(budget), *propagated.notes, *filter(None, [budget.notes])],
        }


def evaluate_budget(
    budget: Budget, request: UncertaintyRequest | None = None, **fields: Any
) -> EvaluatedBudget:
    """Propagate a budget to first order and by Monte Carlo.

    Fields of `UncertaintyRequest` may be named in place of those of a request.
    """
    request = request_of(UncertaintyRequest, request, fields)
    return EvaluatedBudget(
        request=request,
        budget=budget,
        propagated=budget.propagate(),
        simulated=budget.monte_carlo(request),
    )


def _constants(budget: "Budget") -> list[str]:
    exact = [i.name for i in budget.influences if i.standard_uncertainty == 0.0]
    if not exact:
        return []
    are = "is assumed constant" if len(exact) == 1 else "are assumed constant"
    return [f"{', '.join(exact)} {are} and exact"]
