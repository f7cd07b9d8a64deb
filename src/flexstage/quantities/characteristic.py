"""The table that an engineer quotes: a quantity, its axis, where it comes from, its value."""

import math
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass, fields
from typing import Self

from flexstage.base.choose import did_you_mean, has_no, nearest, unknown
from flexstage.base.errors import ModelError
from flexstage.quantities.estimate import Component, Estimate
from flexstage.quantities.quantity import (
    QUANTITIES,
    Quantity,
    beside,
    display,
    full_name,
    within_digits,
)

#: Where a value can come from.
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


#: What stands for the axis in rows that belong to the whole stage.
WHOLE_STAGE = "stage"


@dataclass(frozen=True, slots=True, kw_only=True)
class Characteristic:
    """A value of one quantity on one axis, from one origin.

    Raises
    ------
    ModelError
        The quantity or the origin is not a known one, the unit is not the quantity's, or the
        uncertainty is negative.
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
    """Degrees of freedom of the uncertainty; None where it is known without doubt, or there is
    none.
    """

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise ModelError(unknown("quantity", self.quantity, QUANTITIES))
        if self.origin not in ORIGINS:
            raise ModelError(unknown("origin", self.origin, ORIGINS))
        if self.unit != QUANTITIES[self.quantity].unit:
            raise ModelError(
                f"{self.quantity} is held in '{QUANTITIES[self.quantity].unit}', got '{self.unit}'"
            )
        if self.uncertainty is not None and not self.uncertainty >= 0.0:
            raise ModelError(
                f"the uncertainty of {self.quantity} must be 0 or more, got {self.uncertainty!r}"
            )

    @property
    def failing(self) -> str:
        """What is required, where the value fails the criterion of its quantity; else empty."""
        return QUANTITIES[self.quantity].failing(self.value)

    @property
    def contribution(self) -> Component | None:
        """What its uncertainty adds to that of whatever is made of it; None where none is known."""
        if self.uncertainty is None:
            return None
        freedom = math.inf if self.degrees_of_freedom is None else self.degrees_of_freedom
        return Component(
            name=self.origin, uncertainty=self.uncertainty, degrees_of_freedom=freedom, kind="B"
        )

    @property
    def estimate(self) -> Estimate:
        """The value with its uncertainty; exact where none is known."""
        own = self.contribution
        components = () if own is None else (own,)
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
        """The value in the unit that the quantity is shown in."""
        return self.value * display(self.quantity).factor

    def text(self, shown: Quantity | None = None) -> str:
        """Write the value with the digits that are known of it.

        A published value as it is printed; a measured one to the second digit of its uncertainty;
        that of a model with four significant digits, or fewer where its uncertainty says so. In the
        unit that the quantity is shown in, or in that of `shown`.

        Examples
        --------
        >>> Characteristic(quantity="straightness", axis="x", origin="published-measured",
        ...     value=9e-08, unit="m").text()
        '0.09'
        """
        shown = shown or display(self.quantity)
        if self.origin.startswith("published"):
            return f"{self.value * shown.factor:.10g}"
        plain = shown.text(self.value)
        if self.uncertainty and abs(self.value) >= shown.zero:
            known = beside(self.value * shown.factor, self.uncertainty * shown.factor)[0]
            # of a model four digits are enough, however well its mesh has settled
            return known if self.origin == "measured" else min(known, plain, key=len)
        return plain

    def spread_text(self, shown: Quantity | None = None) -> str:
        """Write its uncertainty with the digits of `text`; empty where none is known.

        Examples
        --------
        >>> Characteristic(quantity="natural_frequency_hz", axis="x", origin="superelement",
        ...     value=353.24, unit="Hz", uncertainty=0.3712).spread_text()
        '0.4'
        """
        if self.uncertainty is None:
            return ""
        shown = shown or display(self.quantity)
        if self.origin == "measured":
            return beside(self.value * shown.factor, self.uncertainty * shown.factor)[1]
        return within_digits(self.text(shown), self.uncertainty * shown.factor)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredCharacteristic(Characteristic):
    """A characteristic that a test gave, with what its uncertainty comes from.

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
        """Say of which quantity and axis an estimate is, and which test gave it."""
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
        """The same as a row of a table or of a stage file: without test and contributions."""
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
        """Return the rows that fit.

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
            The rows, in order; all where nothing is asked.

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
        wanted = {"quantity": quantity, "axis": axis, "origin": origin}
        asked = {name: value for name, value in wanted.items() if value is not None}
        return type(self)(
            row for row in self if all(getattr(row, k) == v for k, v in asked.items())
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
            Where it comes from; not needed where there is one origin.

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
            found = ", ".join(row.origin for row in rows)
            raise ModelError(
                f"there is no {what}{self._instead(quantity, axis)}"
                if not rows
                else f"there are {len(rows)} values of {what}: name one origin of {found}"
            )
        return rows[0].value

    def _instead(self, quantity: str, axis: str) -> str:
        """Say what was probably meant by a quantity and an axis that no row has."""
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
        """Return the table by columns, as data-frame libraries take it.

        Returns
        -------
        dict of str to list
            quantity, axis, origin, value, unit, uncertainty and note.
        """
        names = [f.name for f in fields(Characteristic)]
        return {name: [getattr(row, name) for row in self] for name in names}


def shown_units(rows: Iterable[Characteristic]) -> dict[str, Quantity]:
    """Return the unit that each quantity of a table is shown in, the same on every axis.

    One in which its values are not tiny; the usual one where some are published, as it is the one
    that they are printed in.
    """
    largest: dict[str, float] = {}
    for row in rows:
        size = max(abs(row.value), row.uncertainty or 0.0)
        size = math.inf if row.origin.startswith("published") else size
        largest[row.quantity] = max(size, largest.get(row.quantity, 0.0))
    return {quantity: display(quantity).fitting(size) for quantity, size in largest.items()}


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
    """Return what was measured of an axis by those who published it; None where nothing was."""
    wanted = (quantity, axis, "published-measured")
    return next((r.value for r in published if (r.quantity, r.axis, r.origin) == wanted), None)


def _choices(names: Collection[str]) -> str:
    return f": there is {', '.join(names)}" if names else ": the table is empty"
