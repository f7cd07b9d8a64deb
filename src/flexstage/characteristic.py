"""The table that an engineer quotes: a quantity, its axis, where it comes from, its value."""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, fields

from flexstage.choose import nearest
from flexstage.errors import ModelError
from flexstage.quantities import QUANTITIES, Quantity, beside, display

#: Where a value can come from.
ORIGINS: tuple[str, ...] = (
    "published-analytic",
    "published-fem",
    "published-measured",
    "lumped",
    "superelement",
    "plane",
    "solid",
    "measured",
    "virtual",
)


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
    """One of `flexstage.quantities.QUANTITIES`."""
    axis: str
    """Name of the axis of the stage, ``x`` or ``y`` on the built-in ones."""
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
            raise ModelError(
                f"unknown quantity '{self.quantity}': expected one of {', '.join(QUANTITIES)}"
            )
        if self.origin not in ORIGINS:
            raise ModelError(
                f"unknown origin '{self.origin}': expected one of {', '.join(ORIGINS)}"
            )
        if self.unit != QUANTITIES[self.quantity].unit:
            raise ModelError(
                f"{self.quantity} is held in '{QUANTITIES[self.quantity].unit}', got '{self.unit}'"
            )
        if self.uncertainty is not None and not self.uncertainty >= 0.0:
            raise ModelError(
                f"the uncertainty of {self.quantity} must be 0 or more, got {self.uncertainty!r}"
            )

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
            Quantity of the rows.
        axis : str, optional
            Axis of the rows.
        origin : str, optional
            Origin of the rows.

        Returns
        -------
        Characteristics
            The rows, in order; all where nothing is asked.
        """
        wanted = {"quantity": quantity, "axis": axis, "origin": origin}
        asked = {name: value for name, value in wanted.items() if value is not None}
        return Characteristics(
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
        rows = self.select(quantity, axis, origin)
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
        rows = self.select(quantity)
        axes = dict.fromkeys(row.axis for row in rows)
        if axis not in axes:
            return f": it is known of axis {', '.join(axes)}"
        return f": it comes from {', '.join(row.origin for row in rows.select(axis=axis))}"

    def columns(self) -> dict[str, list[object]]:
        """Return the table by columns, as data-frame libraries take it.

        Returns
        -------
        dict of str to list
            quantity, axis, origin, value, unit, uncertainty and note.
        """
        names = [f.name for f in fields(Characteristic)]
        return {name: [getattr(row, name) for row in self] for name in names}


def _choices(names: Collection[str]) -> str:
    return f": there is {', '.join(names)}" if names else ": the table is empty"
