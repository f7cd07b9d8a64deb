"""Reads an uncertainty budget from a file: an equation, its influences and their correlations."""

import math
import re
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any, Literal, NoReturn, cast

from flexstage.choose import did_you_mean
from flexstage.errors import ModelError, RecordError, UnitError
from flexstage.experiment.uncertainty.expression import Expression
from flexstage.experiment.uncertainty.influence import Influence
from flexstage.experiment.uncertainty.monte_carlo import MonteCarlo, monte_carlo
from flexstage.experiment.uncertainty.propagate import Propagated, propagate
from flexstage.files.nodes import Mapping, Node, Scalar, Sequence, parse_yaml, read_text
from flexstage.records.columns import measured_unit

_TOP = ("quantity", "unit", "equation", "influences", "correlations", "notes")
_INFLUENCE = (
    "name",
    "value",
    "uncertainty",
    "half_width",
    "distribution",
    "dof",
    "kind",
    "flat_share",
    "source",
)
_NUMBER = r"[+-]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][+-]?\d{1,3})?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})(?:\s*([^\d\s.,+-].{{0,40}}?)|\s+(1/.{{1,40}}?))?\s*")


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """An uncertainty budget, in SI."""

    quantity: str
    """What the result is called."""
    unit: str
    """Unit that the result is shown in."""
    factor: float
    """How many SI units one of it is."""
    si: str
    """SI unit of the result."""
    equation: Expression
    """The result from its influences."""
    influences: tuple[Influence, ...]
    """The influences, values in SI."""
    correlations: dict[tuple[str, str], float]
    """Correlation coefficients by the names of two influences."""
    source: str = ""
    """Where it comes from."""
    notes: str = ""
    """Remarks of its author."""

    def propagate(self) -> Propagated:
        """Propagate to first order.

        Returns
        -------
        Propagated
            Result in SI, and budget.
        """
        names = tuple(i.name for i in self.influences)
        function = self.equation.ordered(names)
        return propagate(function, self.influences, self.correlations, unit=self.si)

    def monte_carlo(
        self,
        *,
        trials: int | Literal["auto"] = "auto",
        seed: int = 0,
        confidence: float = 0.95,
    ) -> MonteCarlo:
        """Draw the result at random.

        Parameters
        ----------
        trials : int or "auto"
            Number of trials, or as many as two digits of the uncertainty need.
        seed : int
            Seed of the draws.
        confidence : float
            Probability that the intervals hold the value [1].

        Returns
        -------
        MonteCarlo
            Result in SI.
        """
        names = tuple(i.name for i in self.influences)
        return monte_carlo(
            self.equation.ordered(names),
            self.influences,
            self.correlations,
            trials=trials,
            seed=seed,
            confidence=confidence,
            unit=self.si,
        )


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
    return budget_from_text(read_text(path, "budget file", RecordError), str(path))


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
    return _Reader(source).budget(parse_yaml(text, source, "budget file", RecordError))


class _Reader:
    """Turns nodes into a budget; every message names a line."""

    def __init__(self, source: str) -> None:
        self.source = source

    def refuse(self, line: int, message: str) -> NoReturn:
        raise RecordError(f"{self.source}, line {line}: {message}")

    def budget(self, root: Node) -> Budget:
        if not isinstance(root, Mapping):
            self.refuse(root.line, "a budget begins with 'quantity: NAME'")
        self.known(root, _TOP, "budget")
        for key in ("equation", "influences"):
            if key not in root.items:
                self.refuse(root.line, f"the budget has no '{key}'")
        influences = tuple(map(self.influence, self.sequence(root, "influences")))
        unit = self.text(root, "unit", "1")
        try:
            factor, si = measured_unit(unit)
        except UnitError as error:
            self.refuse(root.items["unit"].line, str(error))
        equation = self.equation(root, influences)
        try:
            equation.require_unit({i.name: i.unit for i in influences}, si)
        except ModelError as error:
            self.refuse(root.items["equation"].line, str(error))
        return Budget(
            quantity=self.text(root, "quantity", "result"),
            unit=unit,
            factor=factor,
            si=si,
            equation=equation,
            influences=influences,
            correlations=self.correlations(root, {i.name for i in influences}),
            source=self.source,
            notes=self.text(root, "notes", ""),
        )

    def equation(self, root: Mapping, influences: tuple[Influence, ...]) -> Expression:
        line = root.items["equation"].line
        try:
            equation = Expression(self.text(root, "equation", ""))
        except ModelError as error:
            self.refuse(line, str(error))
        have = [i.name for i in influences]
        for name in equation.names:
            if name not in have:
                hint = did_you_mean(name, have)
                self.refuse(line, f"the equation names '{name}', which is no influence{hint}")
        unused = [name for name in have if name not in equation.names]
        if unused:
            self.refuse(line, f"the equation does not use the influence '{unused[0]}'")
        return equation

    def influence(self, node: Node) -> Influence:
        if not isinstance(node, Mapping):
            self.refuse(node.line, "an influence is a mapping with 'name' and 'value'")
        self.known(node, _INFLUENCE, "influence")
        name = self.text(node, "name", "")
        if not Expression.is_name(name):
            self.refuse(node.line, f"an influence needs a name of letters, got '{name[:40]}'")
        if "value" not in node.items:
            self.refuse(node.line, f"the influence '{name}' has no value")
        value, unit = self.quantity(node, "value", None)
        sizes = {
            key: self.quantity(node, key, unit)[0]
            for key in ("uncertainty", "half_width")
            if key in node.items
        }
        if not sizes:
            self.constant(node, name)
            sizes["uncertainty"] = 0.0
        freedom = self.number(node, "dof", math.inf)
        repeated = math.isfinite(freedom) and "half_width" not in sizes
        try:
            return Influence(
                name=name,
                value=value,
                unit=unit,
                distribution=self.text(node, "distribution", "") or None,
                degrees_of_freedom=freedom,
                kind=cast(Any, self.text(node, "kind", "A" if repeated else "B")),
                flat_share=self.number(node, "flat_share", 0.5),
                source=self.text(node, "source", ""),
                **sizes,
            )
        except ModelError as error:
            self.refuse(node.line, str(error))

    def constant(self, node: Mapping, name: str) -> None:
        """Refuse what is said of an uncertainty that is not there."""
        for key in ("distribution", "dof", "flat_share"):
            if key in node.items:
                self.refuse(
                    node.key_lines[key],
                    f"the influence '{name}' has '{key}' and no uncertainty: give its uncertainty "
                    f"or its half_width, or leave '{key}' out of a constant",
                )

    def correlations(self, root: Mapping, names: set[str]) -> dict[tuple[str, str], float]:
        found: dict[tuple[str, str], float] = {}
        if "correlations" not in root.items:
            return found
        for node in self.sequence(root, "correlations"):
            if not isinstance(node, Sequence) or len(node.items) != 3:
                self.refuse(node.line, "a correlation is written [name, name, coefficient]")
            parts = [n.value if isinstance(n, Scalar) else None for n in node.items]
            a, b, r = parts
            if not isinstance(r, (int, float)) or isinstance(r, bool) or not -1.0 <= r <= 1.0:
                self.refuse(node.line, f"a correlation coefficient lies from -1 to 1, got {r!r}")
            for name in (a, b):
                if name not in names:
                    self.refuse(node.line, f"a correlation names {name!r}, which is no influence")
            if a == b or (a, b) in found or (b, a) in found:
                self.refuse(node.line, f"the correlation of {a} and {b} must be given once, of two")
            found[str(a), str(b)] = float(r)
        return found

    def known(self, node: Mapping, keys: tuple[str, ...], what: str) -> None:
        for key, line in node.key_lines.items():
            if key not in keys:
                hint = did_you_mean(key, keys)
                self.refuse(line, f"a {what} has no '{key[:40]}': it has {', '.join(keys)}{hint}")

    def sequence(self, node: Mapping, key: str) -> list[Node]:
        found = node.items[key]
        if not isinstance(found, Sequence) or not found.items:
            self.refuse(found.line, f"'{key}' is a list with at least one entry")
        return found.items

    def text(self, node: Mapping, key: str, default: str) -> str:
        found = node.items.get(key)
        if found is None:
            return default
        if not isinstance(found, Scalar) or found.value is None:
            self.refuse(found.line, f"'{key}' is a text")
        return found.text.strip()

    def number(self, node: Mapping, key: str, default: float) -> float:
        found = node.items.get(key)
        if found is None:
            return default
        value = found.value if isinstance(found, Scalar) else None
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            self.refuse(found.line, f"'{key}' is a plain number")
        return float(value)

    def quantity(self, node: Mapping, key: str, wanted: str | None) -> tuple[float, str]:
        """Read a value and its unit as SI; a degree Celsius is a kelvin where it is a width."""
        found = node.items[key]
        text = self.text(node, key, "")
        match = _QUANTITY.fullmatch(text)
        if match is None:
            self.refuse(
                found.line, f"'{key}' is a number and a unit, as '12 nm', got '{text[:40]}'"
            )
        number, written, inverse = match.groups()
        try:
            factor, unit = measured_unit(written or inverse or "1")
        except UnitError as error:
            self.refuse(found.line, str(error))
        if wanted == "degC" and unit in ("K", "degC"):
            unit = wanted
        if wanted is not None and unit != wanted:
            self.refuse(
                found.line,
                f"the value is in {wanted}, but '{key}' is '{text[:40]}': give it in the same kind "
                "of unit",
            )
        value = float(Decimal(number) * Decimal(repr(factor)))
        if not math.isfinite(value):
            self.refuse(found.line, f"'{text[:40]}' is too large to be a number")
        return value, unit
