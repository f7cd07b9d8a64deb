"""Rows of published figures, written as briefly as the study prints them."""

from collections.abc import Iterator

from flexstage.characteristic import Characteristic
from flexstage.quantities import QUANTITIES

#: Note of a figure that is printed once for a stage with two axes.
BOTH_AXES = "printed once, for both axes"


def rows(
    origin: str,
    quantity: str,
    *,
    x: float | None = None,
    y: float | None = None,
    both: float | None = None,
    note: str = "",
) -> Iterator[Characteristic]:
    """Give the rows of one published quantity.

    The figures are in SI units; `both` is printed once for both axes, `note` is a condition or
    remark.
    """
    if both is not None:
        x, y = both, both
        note = f"{BOTH_AXES}; {note}" if note else BOTH_AXES
    for axis, value in (("x", x), ("y", y)):
        if value is not None:
            yield Characteristic(
                quantity=quantity,
                axis=axis,
                origin=origin,
                value=value,
                unit=QUANTITIES[quantity].unit,
                note=note,
            )
