"""Figures of a stage by short names, and requirements on them."""

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

# meaning of a short name for an axis of rotation
_OF_ROTATION = {"output_displacement": "rotation_stroke", "rms_displacement": "rms_rotation"}
#: Quantities that only a stage in an environment has.
NOISE_FIGURES = ("rms_displacement", "rms_rotation")
#: Default quantities of each axis, if the stage has them.
DEFAULT_QUANTITIES = (
    "transmission_ratio",
    "output_displacement",
    "rotation_stroke",
    "natural_frequency_hz",
    "max_stress",
    "cross_coupling",
    *NOISE_FIGURES,
)
#: Relative variation of a figure below which it is rounding error.
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
    """Name of the axis; ``stage`` for the whole stage."""

    @property
    def key(self) -> tuple[str, str]:
        """Quantity and axis."""
        return (self.quantity, self.axis)

    @property
    def name(self) -> str:
        """Name in requests: ``natural_frequency.x``, ``mass``."""
        return self._named(self.quantity.removesuffix("_hz"))

    @property
    def display(self) -> Quantity:
        """Label, unit and format of printed values."""
        return QUANTITIES[self.quantity]

    @property
    def label(self) -> str:
        """Name in words, without unit."""
        axis = "" if self.axis == WHOLE_STAGE else f" {self.axis}"
        return f"{self.display.label}{axis}"

    @property
    def heading(self) -> str:
        """Name in words with the printed unit."""
        return self.heading_in(self.display)

    def heading_in(self, quantity: Quantity) -> str:
        """Return the name in words with the printed unit of a quantity."""
        return f"{self.label} [{quantity.shown_unit}]" if quantity.shown_unit else self.label

    def text(self, value: float) -> str:
        """Write a value with its unit."""
        return f"{self.display.text(value)} {self.display.shown_unit}".strip()

    def read(self, text: str) -> float:
        """Read a value with its unit; a plain number may be in per cent.

        Raises
        ------
        ModelError
            The text has no number, or its unit is not one of the quantity.
        """
        if text.endswith("%") and self.display.unit == "1":
            text, factor = text[:-1].strip(), 0.01
        else:
            factor = 1.0
        try:
            if self.display.unit == "1":
                return factor * float(text)
            dimension = _DIMENSION.get(self.display.unit)
            if dimension is None:
                raise UnitError(f"give it in {self.display.unit}")
            return parse(text, dimension)
        except (UnitError, ValueError) as error:
            reason = str(error) if isinstance(error, UnitError) else "expected a plain number"
            raise ModelError(f"the value of {self.name}, '{text[:40]}': {reason}") from None

    def _named(self, quantity: str) -> str:
        return quantity if self.axis == WHOLE_STAGE else f"{quantity}.{self.axis}"


def figure_of(text: str, known: Collection[tuple[str, str]]) -> Figure:
    """Return the figure with a name, among those of a stage.

    Parameters
    ----------
    text : str
        Quantity and axis, ``natural_frequency.x``; the axis may be omitted if there is only one.
    known : collection of (str, str)
        Available quantities and axes.

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
    of_rotation = _OF_ROTATION.get(quantity, quantity)
    if name in ALIASES and (of_rotation, axis) in known:
        quantity = of_rotation
    axes = [a for q, a in known if q == quantity]
    if not known:
        raise ModelError(_no_axes(known))
    if not axes and quantity in QUANTITIES and {a for _, a in known} == {WHOLE_STAGE}:
        raise ModelError(f"there is no figure '{text[:60]}' here: {_no_axes(known)}")
    if not axes and quantity in NOISE_FIGURES and not any(q in NOISE_FIGURES for q, _ in known):
        raise ModelError(
            f"the figure '{text[:60]}' is one of a stage in its surroundings: describe them in a "
            "file, and give it to sweep, optimise or tolerance by --environment"
        )
    if not axes:
        names = dict.fromkeys(Figure(quantity=q, axis=WHOLE_STAGE).name for q, _ in known)
        short = [alias for alias, of in ALIASES.items() if any(q == of for q, _ in known)]
        raise ModelError(
            f"there is no figure '{text[:60]}' here; the figures are {', '.join(names)}"
            f"{did_you_mean(name, [*names, *short])}"
        )
    if not axis and (len(axes) == 1 or WHOLE_STAGE in axes):
        axis = WHOLE_STAGE if WHOLE_STAGE in axes else axes[0]
    if axis not in axes:
        which = f"'{text[:60]}'" if axis else f"'{text[:60]}' of which axis"
        raise ModelError(f"there is no {which}: choose {', '.join(f'{name}.{a}' for a in axes)}")
    return Figure(quantity=quantity, axis=axis)


def figures_of(texts: Sequence[str], known: Collection[tuple[str, str]]) -> tuple[Figure, ...]:
    """Return the figures with given names; a name without axis stands for all axes.

    Examples
    --------
    >>> known = [("max_stress", "x"), ("max_stress", "y"), ("mass", "stage")]
    >>> [figure.name for figure in figures_of(["stress"], known)]
    ['max_stress.x', 'max_stress.y']
    """
    axes = dict.fromkeys(axis for _, axis in known)
    figures: list[Figure] = []
    for text in texts:
        of_axes: list[Figure] = []
        for axis in axes if "." not in text else ():
            with suppress(ModelError):  # the axis does not have it
                of_axes.append(figure_of(f"{text}.{axis}", known))
        figures += of_axes or [figure_of(text, known)]
    return tuple(dict.fromkeys(figures))


def default_figures(known: Collection[tuple[str, str]]) -> tuple[Figure, ...]:
    """Return the default figures: ratio, stroke, frequency, stress and coupling of each axis.

    In an environment its rms as well.

    Raises
    ------
    ModelError
        The stage has no axes.
    """
    figures = tuple(
        Figure(quantity=q, axis=a) for q in DEFAULT_QUANTITIES for k, a in known if k == q
    )
    if not figures:
        raise ModelError(_no_axes(known))
    return figures


def _no_axes(known: Collection[tuple[str, str]]) -> str:
    """Return the message for a stage without default figures."""
    others = ", ".join(Figure(quantity=q, axis=a).name for q, a in known)
    return (
        "the stage has no axes, and so no ratio, stroke or frequency: add 'axes' to the stage "
        "file, each with its drive and its probe (for a drawing use 'flexstage import' with "
        "--drive and --probe)"
    ) + (f", or name one of its other figures, {others}" if others else "")


def requested_figures(
    texts: Sequence[str] | None, known: Collection[tuple[str, str]]
) -> tuple[Figure, ...]:
    """Return the figures with given names as `figures_of` does; without names the default ones."""
    return figures_of(texts, known) if texts else default_figures(known)


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirement(Stated):
    """A requirement on a figure: limits, in the unit of its quantity."""

    figure: Figure
    """The figure."""
    low: float | None = None
    """Lower limit; None for none."""
    high: float | None = None
    """Upper limit; None for none."""

    def __post_init__(self) -> None:
        if self.low is None and self.high is None:
            raise ModelError(f"a requirement on {self.figure.name} needs a limit")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ModelError(
                f"{self.figure.name} cannot be from {self.figure.text(self.low)} to "
                f"{self.figure.text(self.high)}: the lower limit is above the upper one"
            )

    @property
    def text(self) -> str:
        """The requirement as text with units."""
        name, low, high = self.figure.name, self.low, self.high
        if low is None:
            return f"{name} <= {self._limit_text(high)}"
        if high is None:
            return f"{name} >= {self._limit_text(low)}"
        if low == high:
            return f"{name} = {self._limit_text(low)}"
        return f"{name} = {self._limit_text(low)} to {self._limit_text(high)}"

    def __str__(self) -> str:
        """Return the requirement in the notation of the command line."""
        name, quantity = self.figure.name, self.figure.display

        def exact(value: float) -> str:
            dimension = _DIMENSION.get(quantity.unit)
            if dimension is None:
                return repr(value)
            return to_text(value, dimension, quantity.shown_unit)

        if self.low is None or (self.low != self.high and self.low == -(self.high or 0.0)):
            return f"{name} <= {exact(self.high or 0.0)}"
        if self.high is None:
            return f"{name} >= {exact(self.low)}"
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        return f"{name} = {exact(middle)}" + (f" +- {exact(half)}" if half else "")

    def _limit_text(self, value: float | None) -> str:
        assert value is not None
        quantity = self.figure.display
        return f"{value * quantity.factor:.6g} {quantity.shown_unit}".rstrip()

    def met(self, values: Array) -> NDArray[np.bool_]:
        """Return which values meet the requirement; NaN does not."""
        values = np.asarray(values)
        above = np.isfinite(values) if self.low is None else values >= self.low
        return above & (np.isfinite(values) if self.high is None else values <= self.high)

    def excess(self, values: Array) -> Array:
        """Return the excess over the nearer limit, as a share of it; negative inside the limits."""
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
        ``ratio.x = 1.7 +- 1 %``. The upper limit of a quantity that is zero in an ideal stage, such
        as a coupling, is that of its magnitude.
    known : collection of (str, str)
        Available quantities and axes.

    Raises
    ------
    ModelError
        The text is not a requirement, or its figure is unknown.

    Examples
    --------
    >>> stroke = requirement_of("stroke.x >= 60 um", [("output_displacement", "x")])
    >>> stroke.low, stroke.text
    (6e-05, 'output_displacement.x >= 60 µm')
    """
    match = _REQUIREMENT.match(text)
    if match is None:
        raise ModelError(
            f"'{text[:80]}' is not a requirement: expected a figure, a sign and a value with unit, "
            'such as "natural_frequency.x >= 300 Hz", "stress.x <= 200 MPa" or '
            '"ratio.x = 1.7 +- 1 %"'
        )
    figure = figure_of(match[1], known)
    value, *tolerance = _TOLERANCE.split(match[3], maxsplit=1)
    target = figure.read(value)
    low, high = _bounds(figure, match[2], target)
    if tolerance:
        if low != high:
            raise ModelError(f"'{text[:80]}': a tolerance belongs to '=', not to '{match[2]}'")
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
            # the sign of a quantity that is ideally zero, such as a coupling, is only its direction
            return -value if figure.display.zero > 0.0 and value > 0.0 else None, value
        case _:
            return value, value


def requirements_of(
    texts: Iterable[str | Requirement], known: Collection[tuple[str, str]]
) -> tuple[Requirement, ...]:
    """Return requirements; texts are read by `requirement_of`."""
    return tuple(
        text if isinstance(text, Requirement) else requirement_of(text, known) for text in texts
    )


def _tolerance(figure: Figure, text: str, target: float) -> float:
    if text.endswith("%"):
        try:
            share = 0.01 * float(text[:-1])
        except ValueError:
            raise ModelError(
                f"the tolerance of {figure.name}, '{text[:40]}', is not a percentage"
            ) from None
        width = share * abs(target)
    else:
        width = figure.read(text)
    if not 0.0 <= width < math.inf:
        raise ModelError(f"the tolerance of {figure.name} must be 0 or more, got '{text[:40]}'")
    return width
