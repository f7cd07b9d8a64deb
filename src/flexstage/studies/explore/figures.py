"""Figures of a stage by short names, and what is required of them."""

import math
import re
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.choose import did_you_mean
from flexstage.base.errors import ModelError, UnitError
from flexstage.files.ranges import Stated
from flexstage.quantities.characteristic import WHOLE_STAGE
from flexstage.quantities.quantity import ALIASES, QUANTITIES, Quantity, full_name
from flexstage.quantities.units import DIMENSIONS, parse, to_text

# what a short name means of an axis that is a rotation
_OF_ROTATION = {"output_displacement": "rotation_stroke"}
#: What is looked at first of every axis, as far as a stage has it.
USUAL = (
    "transmission_ratio",
    "output_displacement",
    "rotation_stroke",
    "natural_frequency_hz",
    "max_stress",
    "cross_coupling",
)
#: A figure that varies by less than this share of its size varies by rounding alone.
ROUNDING = 1e-9
_DIMENSION = {d.si: d.name for d in DIMENSIONS.values()}
_REQUIREMENT = re.compile(r"^\s*([\w.\- ]+?)\s*(>=|<=|==|=|>|<|≥|≤)\s*(.+?)\s*$")
_TOLERANCE = re.compile(r"\s*(?:\+-|\+/-|±)\s*")


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Figure:
    """A quantity of one axis, or of the whole stage."""

    quantity: str
    """One of `flexstage.quantities.quantity.QUANTITIES`."""
    axis: str
    """Name of the axis; ``stage`` for the whole."""

    @property
    def key(self) -> tuple[str, str]:
        """Quantity and axis."""
        return (self.quantity, self.axis)

    @property
    def name(self) -> str:
        """Its name as it is given: ``natural_frequency.x``, ``mass``."""
        return self._named(self.quantity.removesuffix("_hz"))

    @property
    def shown(self) -> Quantity:
        """Label, unit and digits in which it is shown."""
        return QUANTITIES[self.quantity]

    @property
    def label(self) -> str:
        """Its name in words, without unit."""
        axis = "" if self.axis == WHOLE_STAGE else f" {self.axis}"
        return f"{self.shown.label}{axis}"

    @property
    def heading(self) -> str:
        """Its name in words, with the unit that it is shown in."""
        return self.heading_in(self.shown)

    def heading_in(self, shown: Quantity) -> str:
        """Return its name in words, with another unit that it is shown in."""
        return f"{self.label} [{shown.shown_unit}]" if shown.shown_unit else self.label

    def text(self, value: float) -> str:
        """Write a value with its unit."""
        return f"{self.shown.text(value)} {self.shown.shown_unit}".strip()

    def read(self, text: str) -> float:
        """Read a value with its unit; a plain number may be in per cent.

        Raises
        ------
        ModelError
            There is no number, or the unit is not one of the quantity.
        """
        if text.endswith("%") and self.shown.unit == "1":
            text, factor = text[:-1].strip(), 0.01
        else:
            factor = 1.0
        try:
            if self.shown.unit == "1":
                return factor * float(text)
            dimension = _DIMENSION.get(self.shown.unit)
            if dimension is None:
                raise UnitError(f"give it in {self.shown.unit}")
            return parse(text, dimension)
        except (UnitError, ValueError) as error:
            told = str(error) if isinstance(error, UnitError) else "expected a plain number"
            raise ModelError(f"the value of {self.name}, '{text[:40]}': {told}") from None

    def _named(self, quantity: str) -> str:
        return quantity if self.axis == WHOLE_STAGE else f"{quantity}.{self.axis}"


def figure_of(text: str, known: Collection[tuple[str, str]]) -> Figure:
    """Return the figure of a name, among those that a stage has.

    Parameters
    ----------
    text : str
        Quantity and axis, ``natural_frequency.x``; the axis may be left out where there is one.
    known : collection of (str, str)
        Quantities and axes that there are.

    Raises
    ------
    ModelError
        There is no such figure, or several axes have it.

    Examples
    --------
    >>> figure_of("stroke.x", [("output_displacement", "x"), ("mass", "stage")]).quantity
    'output_displacement'
    """
    name, _, axis = text.strip().partition(".")
    quantity = full_name(name)
    turned = _OF_ROTATION.get(quantity, quantity)
    if name in ALIASES and (turned, axis) in known:
        quantity = turned
    axes = [a for q, a in known if q == quantity]
    if not known:
        raise ModelError(_no_axes(known))
    if not axes and quantity in QUANTITIES and {a for _, a in known} == {WHOLE_STAGE}:
        raise ModelError(f"there is no figure '{text[:60]}' here: {_no_axes(known)}")
    if not axes:
        names = dict.fromkeys(Figure(quantity=q, axis=WHOLE_STAGE).name for q, _ in known)
        short = [alias for alias, of in ALIASES.items() if any(q == of for q, _ in known)]
        raise ModelError(
            f"there is no figure '{text[:60]}' here: there is {', '.join(names)}"
            f"{did_you_mean(name, [*names, *short])}"
        )
    if not axis and (len(axes) == 1 or WHOLE_STAGE in axes):
        axis = WHOLE_STAGE if WHOLE_STAGE in axes else axes[0]
    if axis not in axes:
        which = f"'{text[:60]}'" if axis else f"'{text[:60]}' of which axis"
        raise ModelError(f"there is no {which}: choose {', '.join(f'{name}.{a}' for a in axes)}")
    return Figure(quantity=quantity, axis=axis)


def figures_of(texts: Sequence[str], known: Collection[tuple[str, str]]) -> tuple[Figure, ...]:
    """Return the figures of some names; one without an axis is that of every axis that has it.

    Examples
    --------
    >>> known = [("max_stress", "x"), ("max_stress", "y"), ("mass", "stage")]
    >>> [figure.name for figure in figures_of(["stress"], known)]
    ['max_stress.x', 'max_stress.y']
    """
    axes = dict.fromkeys(axis for _, axis in known)
    found: list[Figure] = []
    for text in texts:
        of_axes: list[Figure] = []
        for axis in axes if "." not in text else ():
            with suppress(ModelError):  # an axis that has none
                of_axes.append(figure_of(text, [key for key in known if key[1] == axis]))
        found += of_axes or [figure_of(text, known)]
    return tuple(dict.fromkeys(found))


def usual_figures(known: Collection[tuple[str, str]]) -> tuple[Figure, ...]:
    """Return what is looked at first: ratio, stroke, frequency, stress, coupling of every axis.

    Raises
    ------
    ModelError
        There is none, as the stage describes no axes.
    """
    found = tuple(Figure(quantity=q, axis=a) for q in USUAL for k, a in known if k == q)
    if not found:
        raise ModelError(_no_axes(known))
    return found


def _no_axes(known: Collection[tuple[str, str]]) -> str:
    """Say what a stage lacks that has none of the usual figures."""
    others = ", ".join(Figure(quantity=q, axis=a).name for q, a in known)
    return (
        "the stage describes no axes, and so has no ratio, stroke or frequency: add 'axes' to the "
        "stage file, each with its drive and the probe that reads it (of a drawing "
        "by 'flexstage import' with --drive and --probe)"
    ) + (f", or name one of its other figures, {others}" if others else "")


def chosen_figures(
    texts: Sequence[str] | None, known: Collection[tuple[str, str]]
) -> tuple[Figure, ...]:
    """Return the figures of some names as `figures_of` does; the usual ones where none is given."""
    return figures_of(texts, known) if texts else usual_figures(known)


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirement(Stated):
    """What is required of a figure: bounds, in the unit of its quantity."""

    figure: Figure
    """The figure."""
    low: float | None = None
    """Least value that is allowed."""
    high: float | None = None
    """Greatest value that is allowed."""

    def __post_init__(self) -> None:
        if self.low is None and self.high is None:
            raise ModelError(f"a requirement of {self.figure.name} needs a bound")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ModelError(
                f"{self.figure.name} cannot be from {self.figure.text(self.low)} to "
                f"{self.figure.text(self.high)}: the lower bound is above the upper one"
            )

    @property
    def text(self) -> str:
        """It in words and units."""
        name, low, high = self.figure.name, self.low, self.high
        if low is None:
            return f"{name} <= {self._written(high)}"
        if high is None:
            return f"{name} >= {self._written(low)}"
        if low == high:
            return f"{name} = {self._written(low)}"
        return f"{name} = {self._written(low)} to {self._written(high)}"

    def __str__(self) -> str:
        """Return it as a command takes it."""
        name, shown = self.figure.name, self.figure.shown

        def written(value: float) -> str:
            dimension = _DIMENSION.get(shown.unit)
            return repr(value) if dimension is None else to_text(value, dimension, shown.shown_unit)

        if self.low is None or (self.low != self.high and self.low == -(self.high or 0.0)):
            return f"{name} <= {written(self.high or 0.0)}"
        if self.high is None:
            return f"{name} >= {written(self.low)}"
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        return f"{name} = {written(middle)}" + (f" +- {written(half)}" if half else "")

    def _written(self, value: float | None) -> str:
        assert value is not None
        shown = self.figure.shown
        return f"{value * shown.factor:.6g} {shown.shown_unit}".rstrip()

    def met(self, values: Array) -> NDArray[np.bool_]:
        """Say which values meet it; NaN does not."""
        values = np.asarray(values)
        above = np.isfinite(values) if self.low is None else values >= self.low
        return above & (np.isfinite(values) if self.high is None else values <= self.high)

    def excess(self, values: Array) -> Array:
        """Return how far values are beyond the nearer bound, in parts of it; negative within."""
        values = np.asarray(values, dtype=np.float64)
        beyond = np.full(values.shape, -math.inf)
        for bound, sign in ((self.low, -1.0), (self.high, 1.0)):
            if bound is not None:
                beyond = np.maximum(beyond, sign * (values - bound) / (abs(bound) or 1.0))
        return np.where(np.isnan(values), math.nan, beyond)


def requirement_of(text: str, known: Collection[tuple[str, str]]) -> Requirement:
    """Read a requirement.

    Parameters
    ----------
    text : str
        ``stroke.x >= 60 um``, ``stress.x <= 200 MPa``, ``ratio.x = 1.7``, or with a tolerance,
        ``ratio.x = 1.7 +- 1 %``. A greatest value of what may be nothing, as of a coupling, is that
        of its magnitude.
    known : collection of (str, str)
        Quantities and axes that there are.

    Raises
    ------
    ModelError
        It is none, or of a figure that there is not.

    Examples
    --------
    >>> kept = requirement_of("stroke.x >= 60 um", [("output_displacement", "x")])
    >>> kept.low, kept.text
    (6e-05, 'output_displacement.x >= 60 µm')
    """
    found = _REQUIREMENT.match(text)
    if found is None:
        raise ModelError(
            f"'{text[:80]}' is no requirement: expected a figure, a sign and a value with unit, "
            'such as "natural_frequency.x >= 300 Hz", "stress.x <= 200 MPa" or '
            '"ratio.x = 1.7 +- 1 %"'
        )
    figure = figure_of(found[1], known)
    value, *tolerance = _TOLERANCE.split(found[3], maxsplit=1)
    target = figure.read(value)
    low, high = _bounds(figure, found[2], target)
    if tolerance:
        if low != high:
            raise ModelError(f"'{text[:80]}': a tolerance belongs to '=', not to '{found[2]}'")
        width = _tolerance(figure, tolerance[0], target)
        low, high = target - width, target + width
    return Requirement(figure=figure, low=low, high=high)


def bounded(figure: Figure, sign: str, value: float) -> Requirement:
    """Return the requirement that a figure is >=, <= or = a value."""
    low, high = _bounds(figure, sign, value)
    return Requirement(figure=figure, low=low, high=high)


def _bounds(figure: Figure, sign: str, value: float) -> tuple[float | None, float | None]:
    match sign:
        case ">=" | ">" | "≥":
            return value, None
        case "<=" | "<" | "≤":
            # what may be nothing, as a coupling, has a sign that says its way alone
            return -value if figure.shown.zero > 0.0 and value > 0.0 else None, value
        case _:
            return value, value


def requirements_of(
    texts: Iterable[str | Requirement], known: Collection[tuple[str, str]]
) -> tuple[Requirement, ...]:
    """Return requirements, those that are texts as `requirement_of` reads them."""
    return tuple(
        text if isinstance(text, Requirement) else requirement_of(text, known) for text in texts
    )


def _tolerance(figure: Figure, text: str, target: float) -> float:
    if text.endswith("%"):
        try:
            share = 0.01 * float(text[:-1])
        except ValueError:
            raise ModelError(
                f"the tolerance of {figure.name}, '{text[:40]}', is no share"
            ) from None
        width = share * abs(target)
    else:
        width = figure.read(text)
    if not 0.0 <= width < math.inf:
        raise ModelError(f"the tolerance of {figure.name} must be 0 or more, got '{text[:40]}'")
    return width
