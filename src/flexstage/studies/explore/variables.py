"""Varied parameters and their ranges."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import ModelError, UnitError
from flexstage.files.expression import is_expression
from flexstage.files.ranges import Stated
from flexstage.quantities.units import DIMENSIONS, parse, readable_text, to_text
from flexstage.stage.designs import StageTemplate
from flexstage.stage.designs.parameters import StageParameter

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_SHARE = re.compile(rf"(?:\+-|±)?\s*({_NUMBER})\s*%")
_COUNT = re.compile(r"\s*/\s*(\d+)\s*$")
_EXPECTED = (
    'expected NAME=LOW..HIGH, such as {0}="{1}", followed by /6 for six values, or {0}="20 %" '
    "for 20 % to either side of its value"
)
# part of the names of data of an actuator
_ACTUATOR = "actuator"
#: Default range of a parameter to either side, as a share of its value.
DEFAULT_SHARE = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable(Stated):
    """A varied parameter of a stage with its bounds, in SI units."""

    name: str
    """Name, as in `flexstage.stage.designs.find_stage`."""
    low: float
    """Lower bound."""
    high: float
    """Upper bound."""
    usual: float
    """Value in the description."""
    dimension: str
    """Dimension of `flexstage.quantities.units.DIMENSIONS`; empty for a plain number."""
    count: int | None = None
    """Number of values on a grid; None if not given."""
    description: str = ""
    """Description of the parameter."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ModelError(
                f"the range of '{self.name}' must be from a lower to a higher value, got "
                f"{self.text(self.low)} to {self.text(self.high)}"
            )
        if self.count is not None and not 2 <= self.count <= 100_000:
            raise ModelError(
                f"'{self.name}' must have 2 to 100 000 values on a grid, got {self.count}"
            )

    @property
    def middle(self) -> float:
        """Mean of the bounds."""
        return 0.5 * (self.low + self.high)

    @property
    def unit(self) -> str:
        """Printed unit of the bounds; empty for a plain number."""
        return self.text(max(abs(self.low), abs(self.high))).partition(" ")[2]

    @property
    def si_unit(self) -> str:
        """SI unit of the values."""
        return DIMENSIONS[self.dimension].si if self.dimension else "1"

    @property
    def factor(self) -> float:
        """Factor from SI to `unit`."""
        return 1.0 / parse(f"1 {self.unit}", self.dimension) if self.dimension else 1.0

    @property
    def heading(self) -> str:
        """Name with unit."""
        # with the symbols of headings of figures
        unit = re.sub(r"\bu(?=m|rad)", "µ", self.unit)
        return f"{self.name} [{unit}]" if unit else self.name

    @property
    def range_text(self) -> str:
        """Bounds in the notation of ranges, to three digits."""
        low, high = (f"{bound * self.factor:.3g}" for bound in (self.low, self.high))
        return f"{low}..{high} {self.unit}".strip()

    def __str__(self) -> str:
        """Return the variable in the notation of the command line: ``leg_neck=0.3..0.8 mm/6``."""
        low, high = (self._exactly(bound) for bound in (self.low, self.high))
        unit = f" {self.unit}"
        if low.endswith(unit) and high.endswith(unit):  # a common unit is written once
            low = low.removesuffix(unit)
        return f"{self.name}={low}..{high}" + (f"/{self.count}" if self.count else "")

    def _exactly(self, value: float) -> str:
        return to_text(value, self.dimension, self.unit) if self.dimension else repr(value)

    def text(self, value: float) -> str:
        """Write a value with its unit, in the notation of files."""
        if not self.dimension or not math.isfinite(value):
            return f"{value:.12g}"
        return readable_text(value, self.dimension)


def variables_of(template: StageTemplate, texts: Sequence[str | Variable]) -> tuple[Variable, ...]:
    """Read varied parameters and their ranges.

    Parameters
    ----------
    template : StageTemplate
        The stage.
    texts : sequence of str or Variable
        Variables, or texts such as ``leg_neck=0.3..0.8 mm``, followed by ``/6`` for six values on a
        grid; or ``x.*=20 %``: all parameters whose names match the pattern, by 20 % to either side.
        Data of an actuator match only a pattern that names it, such as ``x.actuator.*``.

    Returns
    -------
    tuple of Variable
        The variables in the order of the texts; those of a pattern in the order of the stage.

    Raises
    ------
    ModelError
        A parameter is unknown, given twice or not continuous, or a range is invalid.

    Examples
    --------
    >>> neck, = variables_of(StageTemplate.of("vgtu-piezo"), ["x.leg_neck=0.3..0.8 mm/6"])
    >>> neck.low, neck.high, neck.count
    (0.0003, 0.0008, 6)
    """
    known = {p.name: p for p in template.parameters}
    variables: dict[str, Variable] = {}
    for text in texts:
        if isinstance(text, Variable):
            if text.name in variables:
                raise ModelError(f"the range of '{text.name}' is given twice: remove one")
            variables[text.name] = text
            continue
        name, equals, limits = (part.strip() for part in text.partition("="))
        if not name or not equals or not limits:
            expected = _expected(known.values())
            raise ModelError(f"'{text[:80]}' is not a range of a parameter: {expected}")
        if name in known:
            names = [name]
        else:
            names = [n for n in known if fnmatchcase(n, name) and _value(known[n]) is not None]
            if _ACTUATOR not in name:
                names = [n for n in names if not is_data_sheet(n)]
        if not names:
            raise ModelError(
                f"{template.source} has no parameter '{name[:60]}' that can be varied; its "
                f"parameters are {listed([n for n in known if _value(known[n]) is not None])}"
                f"{did_you_mean(name, known)}"
            )
        for each in names:
            if each in variables:
                raise ModelError(f"the range of '{each}' is given twice: remove one")
            variables[each] = _variable(known[each], limits, text)
    return tuple(variables.values())


def is_data_sheet(name: str) -> bool:
    """Return whether a parameter is a property of an actuator, such as its stiffness."""
    return _ACTUATOR in name.split(".")


def every_variable(template: StageTemplate, share: float = DEFAULT_SHARE) -> tuple[Variable, ...]:
    """Return all continuous parameters that are not zero, with a share to either side."""
    variables = []
    for parameter in template.parameters:
        value = _value(parameter)
        if value:
            variables.append(_around(parameter, value, share))
    return tuple(variables)


def matching_names(
    known: Mapping[str, object], patterns: Sequence[str], source: str, noun: str = "parameter"
) -> list[str]:
    """Return the names that match the patterns; each pattern must match one."""
    matches: list[str] = []
    for pattern in patterns:
        names = [pattern] if pattern in known else [n for n in known if fnmatchcase(n, pattern)]
        if not names:
            raise ModelError(
                f"{source} has no {noun} '{pattern[:60]}'; the names are {listed(list(known))}"
                f"{did_you_mean(pattern, known)}"
            )
        matches += names
    return matches


def _value(parameter: StageParameter) -> float | None:
    """Return the value of a continuous parameter; None for a word, an integer or an expression."""
    value = parameter.value
    if not isinstance(value, float) or is_expression(parameter.text):
        return None
    known = parameter.dimension or re.fullmatch(_NUMBER, parameter.text.strip())
    return value if known and math.isfinite(value) else None


def _variable(parameter: StageParameter, limits: str, text: str) -> Variable:
    usual = _value(parameter)
    if usual is None:
        why = "follows from others" if is_expression(parameter.text) else "is not continuous"
        raise ModelError(
            f"'{parameter.name}' ({parameter.text}) {why}, and cannot be varied: omit it, or give "
            "it a value with --set"
        )
    match = _COUNT.search(limits)
    count, ends = int(match[1]) if match else None, _COUNT.sub("", limits)
    if (share := _SHARE.fullmatch(ends)) is not None:
        return _around(parameter, usual, 0.01 * float(share[1]), count)
    low, dots, high = (part.strip() for part in ends.partition(".."))
    if not dots or not low or not high:
        raise ModelError(f"'{text[:80]}' is not a range of a parameter: {_expected([parameter])}")
    if re.fullmatch(_NUMBER, low):  # a common unit follows the second number
        low = f"{low} {re.sub(rf'^{_NUMBER}', '', high).strip()}".strip()
    try:
        bounds = [_read(value, parameter.dimension) for value in (low, high)]
    except (UnitError, ValueError) as error:
        raise ModelError(f"the range of '{parameter.name}', '{limits[:60]}': {error}") from None
    return Variable(
        name=parameter.name,
        low=bounds[0],
        high=bounds[1],
        usual=usual,
        dimension=parameter.dimension,
        count=count,
        description=parameter.description,
    )


def _around(
    parameter: StageParameter, value: float, share: float, count: int | None = None
) -> Variable:
    if not 0.0 < share < math.inf or value == 0.0:
        raise ModelError(
            f"'{parameter.name}' is {parameter.text}, and cannot be varied by {100.0 * share:g} %: "
            "give a range"
        )
    # rounded, so that 12 mm + 20 % is not 14.399999999999999 mm
    low, high = (float(f"{value + sign * share * abs(value):.12g}") for sign in (-1.0, 1.0))
    return Variable(
        name=parameter.name,
        low=low,
        high=high,
        usual=value,
        dimension=parameter.dimension,
        count=count,
        description=parameter.description,
    )


def _read(text: str, dimension: str) -> float:
    if dimension:
        return parse(text, dimension)
    if not re.fullmatch(_NUMBER, text):
        raise ModelError(f"expected a plain number, got '{text[:40]}'")
    return float(text)


def _expected(parameters: Iterable[StageParameter]) -> str:
    for parameter in parameters:
        value = _value(parameter)
        if value and parameter.dimension in DIMENSIONS:
            variable = _around(parameter, value, DEFAULT_SHARE)
            return _EXPECTED.format(parameter.name, variable.range_text)
    return _EXPECTED.format("neck", "0.3..0.8 mm")


def listed(names: Sequence[str]) -> str:
    """Return names with commas between, twelve at most."""
    others = f" and {len(names) - 12} more" if len(names) > 12 else ""
    return (", ".join(names[:12]) or "none") + others
