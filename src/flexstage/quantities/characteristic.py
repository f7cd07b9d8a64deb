"""Table of characteristics of a stage: quantity, axis, origin and value."""

import math
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass, fields
from typing import Literal, Self, get_args

from flexstage.base.choose import did_you_mean, has_no, nearest, unknown
from flexstage.base.errors import ModelError
from flexstage.quantities.estimate import Component, Estimate
from flexstage.quantities.quantity import (
    QUANTITIES,
    Quantity,
    display,
    full_name,
    value_and_uncertainty,
    within_digits,
)

#: Possible origins of a value.
ORIGINS: tuple[str, ...] = (
    "published-analytic",
    "published-fem",
    "published-measured",
    "lumped",
    "superelement",
    "plane",
    "superelement-3d",
    "solid",
    "measured",
    "virtual",
)

#: What a figure is: measured on a real bench, or by simulated instruments; computed by a model
#: that was fitted to the published figure, or was not; or an input from a data sheet or assumed.
Kind = Literal["measured", "simulated", "fitted", "predicted", "given"]
KINDS: tuple[Kind, ...] = get_args(Kind)

# what every model takes from the description or from a data sheet
_INPUTS = frozenset(("input_displacement", "width", "height", "thickness"))

#: Axis of rows that belong to the whole stage.
WHOLE_STAGE = "stage"


@dataclass(frozen=True, slots=True, kw_only=True)
class Characteristic:
    """A value of one quantity on one axis, from one origin.

    Raises
    ------
    ModelError
        The quantity or the origin is unknown, the unit is not that of the quantity, the
        uncertainty is negative, or a figure that is not published is called fitted.
    """

    quantity: str
    """One of `flexstage.quantities.quantity.QUANTITIES`."""
    axis: str
    """Name of the axis of the stage, ``x`` or ``y`` on the built-in ones; ``stage`` for all."""
    origin: str
    """One of `ORIGINS`."""
    value: float
    """The value in `unit`."""
    unit: str
    """Unit of `value` and of `uncertainty`."""
    uncertainty: float | None = None
    """Standard uncertainty, where one is known, in `unit`."""
    note: str = ""
    """Condition or remark that belongs to the value."""
    degrees_of_freedom: float | None = None
    """Degrees of freedom of the uncertainty; None if infinite, or without uncertainty."""
    fitted: bool = False
    """True for a published figure that dimensions or drives of the description were fitted to."""

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise ModelError(unknown("quantity", self.quantity, QUANTITIES))
        if self.origin not in ORIGINS:
            raise ModelError(unknown("origin", self.origin, ORIGINS))
        if self.unit != QUANTITIES[self.quantity].unit:
            unit = QUANTITIES[self.quantity].unit
            raise ModelError(f"the unit of {self.quantity} is '{unit}', got '{self.unit}'")
        if self.uncertainty is not None and not self.uncertainty >= 0.0:
            raise ModelError(
                f"the uncertainty of {self.quantity} must be 0 or more, got {self.uncertainty!r}"
            )
        if self.fitted and not self.published:
            raise ModelError(f"only a published figure can be fitted to, got one of {self.origin}")

    @property
    def published(self) -> bool:
        """True for a figure of a publication."""
        return self.origin.startswith("published")

    @property
    def failing(self) -> str:
        """Limit that the value violates, as text; empty if none."""
        return QUANTITIES[self.quantity].failing(self.value)

    @property
    def contribution(self) -> Component | None:
        """Contribution to the uncertainty of a derived value; None without uncertainty."""
        if self.uncertainty is None:
            return None
        freedom = math.inf if self.degrees_of_freedom is None else self.degrees_of_freedom
        return Component(
            name=self.origin, uncertainty=self.uncertainty, degrees_of_freedom=freedom, kind="B"
        )

    @property
    def estimate(self) -> Estimate:
        """The value with its uncertainty, if any."""
        component = self.contribution
        components = () if component is None else (component,)
        return Estimate(value=self.value, unit=self.unit, components=components, note=self.note)

    @property
    def label(self) -> str:
        """Name of the quantity in words."""
        return display(self.quantity).label

    @property
    def shown_unit(self) -> str:
        """Unit of `text` and of `shown_value`, ``µm``, ``MPa``; empty for a plain number."""
        return display(self.quantity).shown_unit

    @property
    def shown_value(self) -> float:
        """The value in `shown_unit`."""
        return self.value * display(self.quantity).factor

    def text(self, quantity: Quantity | None = None) -> str:
        """Write the value with its significant digits.

        A published value has the digits of its source; a measured one ends at the second digit of
        its uncertainty; that of a model has four significant digits, or fewer if its uncertainty
        requires it. The unit is the printed one of the quantity, or that of `quantity`.

        Examples
        --------
        >>> Characteristic(quantity="straightness", axis="x", origin="published-measured",
        ...     value=9e-08, unit="m").text()
        '0.09'
        """
        quantity = quantity or display(self.quantity)
        if self.published:
            return f"{self.value * quantity.factor:.10g}"
        plain = quantity.text(self.value)
        if self.uncertainty and abs(self.value) >= quantity.zero:
            to_uncertainty = value_and_uncertainty(
                self.value * quantity.factor, self.uncertainty * quantity.factor
            )[0]
            # four digits suffice for a model, even if its mesh has converged further
            return (
                to_uncertainty if self.origin == "measured" else min(to_uncertainty, plain, key=len)
            )
        return plain

    def spread_text(self, quantity: Quantity | None = None) -> str:
        """Write the uncertainty with the digits of `text`; empty if unknown.

        Examples
        --------
        >>> Characteristic(quantity="natural_frequency_hz", axis="x", origin="superelement",
        ...     value=353.24, unit="Hz", uncertainty=0.3712).spread_text()
        '0.4'
        """
        if self.uncertainty is None:
            return ""
        quantity = quantity or display(self.quantity)
        uncertainty = self.uncertainty * quantity.factor
        if self.origin == "measured":
            return value_and_uncertainty(self.value * quantity.factor, uncertainty)[1]
        return within_digits(self.text(quantity), uncertainty)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredCharacteristic(Characteristic):
    """A measured characteristic with the components of its uncertainty.

    Examples
    --------
    >>> noise = Component(name="noise", uncertainty=3e-9, degrees_of_freedom=9)
    >>> stroke = MeasuredCharacteristic.from_estimate(
    ...     Estimate(value=63e-6, unit="m", components=(noise,)),
    ...     quantity="output_displacement", axis="x", origin="measured", test="motion",
    ... )
    >>> stroke.uncertainty, stroke.degrees_of_freedom, stroke.text()
    (3e-09, 9.0, '63.0000')
    """

    components: tuple[Component, ...] = ()
    """Independent contributions to its uncertainty."""
    bounds: tuple[float, float] | None = None
    """Ends of its 95 % interval where that is not symmetric about the value."""
    test: str
    """Name of the test, or of the step of a plan."""

    @classmethod
    def from_estimate(
        cls, estimate: Estimate, *, quantity: str, axis: str, origin: str, test: str
    ) -> Self:
        """Return an estimate as a characteristic of a quantity, axis and test."""
        freedom = estimate.degrees_of_freedom
        return cls(
            quantity=quantity,
            axis=axis,
            origin=origin,
            value=estimate.value,
            unit=estimate.unit,
            uncertainty=estimate.uncertainty,
            note=estimate.note,
            degrees_of_freedom=None if math.isinf(freedom) else freedom,
            components=estimate.components,
            bounds=estimate.bounds,
            test=test,
        )

    @property
    def estimate(self) -> Estimate:
        return Estimate(
            value=self.value,
            unit=self.unit,
            components=self.components,
            bounds=self.bounds,
            note=self.note,
        )

    @property
    def row(self) -> Characteristic:
        """Row of a table or of a stage file, without test and components."""
        return Characteristic(**{f.name: getattr(self, f.name) for f in fields(Characteristic)})


class Characteristics(tuple[Characteristic, ...]):
    """A tidy table of characteristics: one row for each quantity, axis and origin.

    It is a tuple of its rows.

    Examples
    --------
    >>> table = Characteristics(
    ...     Characteristic(quantity="resolution", axis=a, origin="measured", value=v, unit="m")
    ...     for a, v in (("x", 2e-08), ("y", 3e-08))
    ... )
    >>> table.value("resolution", "x")
    2e-08
    """

    __slots__ = ()

    def __repr__(self) -> str:
        origins = Counter(row.origin for row in self)
        return f"Characteristics({', '.join(f'{n} {origin}' for origin, n in origins.items())})"

    def select(
        self, quantity: str | None = None, axis: str | None = None, origin: str | None = None
    ) -> "Characteristics":
        """Return the matching rows.

        Parameters
        ----------
        quantity : str, optional
            Quantity of the rows, by its name or a short one such as ``natural_frequency``.
        axis : str, optional
            Axis of the rows.
        origin : str, optional
            Origin of the rows.

        Returns
        -------
        Characteristics
            The rows, in order; all of them without arguments.

        Raises
        ------
        ModelError
            There is no such quantity or origin at all, or no such axis in the table.
        """
        if quantity is not None:
            quantity = full_name(quantity)
            if quantity not in QUANTITIES:
                hint = did_you_mean(quantity, QUANTITIES) or _choices({r.quantity for r in self})
                raise ModelError(f"there is no quantity '{quantity[:60]}'{hint}")
        if origin is not None and origin not in ORIGINS:
            raise ModelError(unknown("origin", origin, ORIGINS))
        axes = dict.fromkeys(row.axis for row in self)
        if axis is not None and axes and axis not in axes:
            raise ModelError(has_no("the table", "axis", axis, axes))
        return self._fitting(quantity, axis, origin)

    def _fitting(self, quantity: str | None, axis: str | None, origin: str | None) -> Self:
        criteria = {"quantity": quantity, "axis": axis, "origin": origin}
        values = {name: value for name, value in criteria.items() if value is not None}
        return type(self)(
            row for row in self if all(getattr(row, k) == v for k, v in values.items())
        )

    def value(self, quantity: str, axis: str, origin: str | None = None) -> float:
        """Return one value.

        Parameters
        ----------
        quantity : str
            The quantity.
        axis : str
            The axis.
        origin : str, optional
            Origin of the value; not needed where there is only one.

        Returns
        -------
        float
            The value, in the unit of the quantity.

        Raises
        ------
        ModelError
            No row fits, or more than one.
        """
        quantity = full_name(quantity)
        rows = self._fitting(quantity, axis, origin)
        if len(rows) != 1:
            what = f"{quantity} of axis '{axis}'" + (f" from '{origin}'" if origin else "")
            origins = ", ".join(row.origin for row in rows)
            raise ModelError(
                f"there is no {what}{self._instead(quantity, axis)}"
                if not rows
                else f"there are {len(rows)} values of {what}: name one origin of {origins}"
            )
        return rows[0].value

    def _instead(self, quantity: str, axis: str) -> str:
        """Return a suggestion for a quantity and an axis that no row has."""
        quantities = dict.fromkeys(row.quantity for row in self)
        if quantity not in quantities:
            near = nearest(quantity, quantities)
            return f": did you mean '{near}'?" if near else _choices(quantities)
        rows = self._fitting(quantity, None, None)
        axes = dict.fromkeys(row.axis for row in rows)
        if axis not in axes:
            return f": it is known of axis {', '.join(axes)}"
        return f": it comes from {', '.join(row.origin for row in rows._fitting(None, axis, None))}"

    def columns(self) -> dict[str, list[object]]:
        """Return the table by columns, as data-frame libraries accept it.

        Returns
        -------
        dict of str to list
            quantity, axis, origin, value, unit, uncertainty and note.
        """
        names = [f.name for f in fields(Characteristic) if f.name != "fitted"]
        return {name: [getattr(row, name) for row in self] for name in names}


def shown_units(rows: Iterable[Characteristic]) -> dict[str, Quantity]:
    """Return the printed unit of each quantity of a table, the same on every axis.

    A prefix suits the largest value, but published quantities have their default unit, as printed
    in the source.
    """
    largest: dict[str, float] = {}
    for row in rows:
        size = max(abs(row.value), row.uncertainty or 0.0)
        size = math.inf if row.published else size
        largest[row.quantity] = max(size, largest.get(row.quantity, 0.0))
    return {quantity: display(quantity).fitting(size) for quantity, size in largest.items()}


def fitted_to(figure: Characteristic, references: Iterable[Characteristic]) -> tuple[str, ...]:
    """Return the origins of references that the model of a computed figure was fitted to."""
    if figure.published or figure.origin in ("measured", "virtual"):
        return ()
    key = (figure.quantity, figure.axis)
    return tuple(r.origin for r in references if r.fitted and (r.quantity, r.axis) == key)


def kind_of(figure: Characteristic, references: Iterable[Characteristic] = ()) -> Kind:
    """Return what a figure is, next to references that a model may have been fitted to.

    Examples
    --------
    >>> both = {"quantity": "resolution", "axis": "x", "unit": "m"}
    >>> printed = Characteristic(**both, origin="published-fem", value=1.55e-7, fitted=True)
    >>> ours = Characteristic(**both, origin="lumped", value=1.553e-7)
    >>> kind_of(printed), kind_of(ours), kind_of(ours, [printed])
    ('predicted', 'predicted', 'fitted')
    """
    if figure.origin == "virtual":
        return "simulated"
    if figure.origin in ("measured", "published-measured"):
        return "measured"
    if figure.quantity in _INPUTS:
        return "given"
    return "fitted" if fitted_to(figure, references) else "predicted"


def comparable(figure: Characteristic, reference: Characteristic) -> bool:
    """Return whether two figures are like things, so that their difference means something.

    It does for two of the same kind, and for a prediction and a measurement; but not for a figure
    and one that it was fitted to, nor for a simulated one and any other.
    """
    kinds = {kind_of(figure, (reference,)), kind_of(reference, (figure,))}
    return "fitted" not in kinds and (len(kinds) == 1 or kinds == {"measured", "predicted"})


def in_order(figures: Iterable[MeasuredCharacteristic]) -> tuple[MeasuredCharacteristic, ...]:
    """Return figures by quantity, in the order of tables, then by axis."""
    order = {quantity: i for i, quantity in enumerate(QUANTITIES)}
    return tuple(sorted(figures, key=lambda f: (order[f.quantity], f.axis)))


def one_of_each(figures: Iterable[MeasuredCharacteristic]) -> tuple[MeasuredCharacteristic, ...]:
    """Return the first figure of each quantity and axis, in the order of tables."""
    first: dict[tuple[str, str], MeasuredCharacteristic] = {}
    for figure in figures:
        first.setdefault((figure.quantity, figure.axis), figure)
    return in_order(first.values())


def measured_value(published: Iterable[Characteristic], quantity: str, axis: str) -> float | None:
    """Return the published measured value of a quantity on an axis; None if there is none."""
    key = (quantity, axis, "published-measured")
    return next((r.value for r in published if (r.quantity, r.axis, r.origin) == key), None)


def _choices(names: Collection[str]) -> str:
    return f": there is {', '.join(names)}" if names else ": the table is empty"
