"""Parameters that are varied, and between which values."""

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
_HOW = (
    'expected NAME=LOW..HIGH, such as {0}="{1}", with /6 behind it for six values, or {0}="20 %" '
    "for the value that it has and 20 % to either side"
)
# the part of a name behind which the data sheet of an actuator stands
_ACTUATOR = "actuator"
#: Share of its value by which a parameter is varied to either side where nothing is said.
USUAL_SHARE = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable(Stated):
    """A parameter of a stage that is varied between two bounds, in SI units."""

    name: str
    """Its name, as `flexstage.stage.designs.find_stage` sets it."""
    low: float
    """Least value."""
    high: float
    """Greatest value."""
    usual: float
    """The value that it has in the description."""
    dimension: str
    """Its dimension, of `flexstage.quantities.units.DIMENSIONS`; empty for a plain number."""
    count: int | None = None
    """Number of values on a grid, where one is given."""
    description: str = ""
    """What it is."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ModelError(
                f"'{self.name}' must go from a lower to a higher value, got {self.text(self.low)} "
                f"to {self.text(self.high)}"
            )
        if self.count is not None and not 2 <= self.count <= 100_000:
            raise ModelError(f"'{self.name}' takes 2 to 100 000 values on a grid, got {self.count}")

    @property
    def middle(self) -> float:
        """The value half-way between the bounds."""
        return 0.5 * (self.low + self.high)

    @property
    def unit(self) -> str:
        """The unit in which its bounds are best read; empty for a plain number."""
        return self.text(max(abs(self.low), abs(self.high))).partition(" ")[2]

    @property
    def si_unit(self) -> str:
        """The SI unit of its values."""
        return DIMENSIONS[self.dimension].si if self.dimension else "1"

    @property
    def factor(self) -> float:
        """What a value is multiplied by, to be shown in `unit`."""
        return 1.0 / parse(f"1 {self.unit}", self.dimension) if self.dimension else 1.0

    @property
    def heading(self) -> str:
        """Its name with its unit."""
        # as figures are headed
        unit = re.sub(r"\bu(?=m|rad)", "µ", self.unit)
        return f"{self.name} [{unit}]" if unit else self.name

    @property
    def range_text(self) -> str:
        """Its bounds as a range is given, to three digits."""
        low, high = (f"{bound * self.factor:.3g}" for bound in (self.low, self.high))
        return f"{low}..{high} {self.unit}".strip()

    def __str__(self) -> str:
        """Return it as a command takes it: ``leg_neck=0.3..0.8 mm/6``."""
        low, high = (self._exactly(bound) for bound in (self.low, self.high))
        unit = f" {self.unit}"
        if low.endswith(unit) and high.endswith(unit):  # stands once
            low = low.removesuffix(unit)
        return f"{self.name}={low}..{high}" + (f"/{self.count}" if self.count else "")

    def _exactly(self, value: float) -> str:
        return to_text(value, self.dimension, self.unit) if self.dimension else repr(value)

    def text(self, value: float) -> str:
        """Write a value with its unit, as a file has it."""
        if not self.dimension or not math.isfinite(value):
            return f"{value:.12g}"
        return readable_text(value, self.dimension)


def variables_of(template: StageTemplate, texts: Sequence[str | Variable]) -> tuple[Variable, ...]:
    """Read which parameters are varied, and between which values.

    Parameters
    ----------
    template : StageTemplate
        The stage.
    texts : sequence of str or Variable
        What is varied, as it is or in words: ``leg_neck=0.3..0.8 mm``; with ``/6`` behind it for
        six values on a grid; or
        ``x.*=20 %``: all parameters whose names fit the pattern, 20 % to either side; the data
        sheet of an actuator only where the pattern names it, as ``x.actuator.*``.

    Returns
    -------
    tuple of Variable
        In the order given; of a pattern in the order of the stage.

    Raises
    ------
    ModelError
        No parameter is called so, one is given twice or cannot be varied, or a range is none.

    Examples
    --------
    >>> neck, = variables_of(StageTemplate.of("vgtu-piezo"), ["x.leg_neck=0.3..0.8 mm/6"])
    >>> neck.low, neck.high, neck.count
    (0.0003, 0.0008, 6)
    """
    known = {p.name: p for p in template.parameters}
    found: dict[str, Variable] = {}
    for text in texts:
        if isinstance(text, Variable):
            if text.name in found:
                raise ModelError(f"the range of '{text.name}' is given twice: leave one out")
            found[text.name] = text
            continue
        name, equals, told = (part.strip() for part in text.partition("="))
        if not name or not equals or not told:
            raise ModelError(f"'{text[:80]}' is no range of a parameter: {_how(known.values())}")
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
            if each in found:
                raise ModelError(f"the range of '{each}' is given twice: leave one out")
            found[each] = _variable(known[each], told, text)
    return tuple(found.values())


def is_data_sheet(name: str) -> bool:
    """Say whether a parameter is a figure of a bought actuator, such as its stiffness."""
    return _ACTUATOR in name.split(".")


def every_variable(template: StageTemplate, share: float = USUAL_SHARE) -> tuple[Variable, ...]:
    """Return all parameters that are continuous and not zero, a share to either side of each."""
    variables = []
    for parameter in template.parameters:
        value = _value(parameter)
        if value:
            variables.append(_around(parameter, value, share))
    return tuple(variables)


def matching_names(
    known: Mapping[str, object], patterns: Sequence[str], source: str, noun: str = "parameter"
) -> list[str]:
    """Return the names that fit some patterns; refuse one that none fits."""
    found: list[str] = []
    for pattern in patterns:
        names = [pattern] if pattern in known else [n for n in known if fnmatchcase(n, pattern)]
        if not names:
            raise ModelError(
                f"{source} has no {noun} '{pattern[:60]}'; there is {listed(list(known))}"
                f"{did_you_mean(pattern, known)}"
            )
        found += names
    return found


def _value(parameter: StageParameter) -> float | None:
    """Value of a continuous parameter; None of a word, a whole number, or what follows others."""
    value = parameter.value
    if not isinstance(value, float) or is_expression(parameter.text):
        return None
    known = parameter.dimension or re.fullmatch(_NUMBER, parameter.text.strip())
    return value if known and math.isfinite(value) else None


def _variable(parameter: StageParameter, told: str, text: str) -> Variable:
    usual = _value(parameter)
    if usual is None:
        why = "follows from others" if is_expression(parameter.text) else "is no continuous number"
        raise ModelError(
            f"'{parameter.name}' ({parameter.text}) {why}, and cannot be varied: leave it out, or "
            "give it a value of its own with --set"
        )
    found = _COUNT.search(told)
    count, ends = int(found[1]) if found else None, _COUNT.sub("", told)
    if (share := _SHARE.fullmatch(ends)) is not None:
        return _around(parameter, usual, 0.01 * float(share[1]), count)
    low, dots, high = (part.strip() for part in ends.partition(".."))
    if not dots or not low or not high:
        raise ModelError(f"'{text[:80]}' is no range of a parameter: {_how([parameter])}")
    if re.fullmatch(_NUMBER, low):  # the unit stands once, behind the second
        low = f"{low} {re.sub(rf'^{_NUMBER}', '', high).strip()}".strip()
    try:
        bounds = [_read(value, parameter.dimension) for value in (low, high)]
    except (UnitError, ValueError) as error:
        raise ModelError(f"the range of '{parameter.name}', '{told[:60]}': {error}") from None
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
            f"'{parameter.name}' is {parameter.text}, and cannot be varied by {100.0 * share:g} % "
            "of it: give a range"
        )
    # rounded, so that 20 % of 12 mm is no 14.399999999999999 mm
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


def _how(parameters: Iterable[StageParameter]) -> str:
    for parameter in parameters:
        value = _value(parameter)
        if value and parameter.dimension in DIMENSIONS:
            return _HOW.format(parameter.name, _around(parameter, value, USUAL_SHARE).range_text)
    return _HOW.format("neck", "0.3..0.8 mm")


def listed(names: Sequence[str]) -> str:
    """Return names as a sentence has them, twelve at most."""
    more = f" and {len(names) - 12} more" if len(names) > 12 else ""
    return (", ".join(names[:12]) or "none") + more
