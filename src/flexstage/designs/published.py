"""Rows of published figures, written as briefly as the study prints them."""

from collections.abc import Iterator, Mapping

from flexstage.characteristic import Characteristic
from flexstage.quantities import QUANTITIES

#: By how much motion errors are claimed to be below those of a traditional stage, which is not
#: named, by stage [1]; `flexstage.studies.traditional` has what holds of it.
MOTION_ERROR_CLAIMS: Mapping[str, float] = {"vgtu-mechanical": 0.44, "vgtu-piezo": 0.17}

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
