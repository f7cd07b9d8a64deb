"""One row of the table that an engineer quotes: a quantity, its axis, where it comes from."""

from dataclasses import dataclass

from flexstage.errors import ModelError

__all__ = ["ORIGINS", "QUANTITIES", "Characteristic"]

#: Quantities and the unit that their values are in: SI, but for the frequency, which says so.
QUANTITIES: dict[str, str] = {
    "input_displacement": "m",
    "output_displacement": "m",
    "transmission_ratio": "1",
    "max_stress": "Pa",
    "safety_factor": "1",
    "resolution": "m",
    "natural_frequency_hz": "Hz",
    "cross_coupling": "1",
    "parasitic_rotation": "rad",
    "input_stiffness": "N/m",
    "output_stiffness": "N/m",
    "straightness": "m",
    "straightness_out_of_plane": "m",
    "hysteresis_loop_width": "m",
}

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
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Characteristic:
    """A value of one quantity on one axis, from one origin.

    Parameters
    ----------
    quantity : str
        One of `QUANTITIES`.
    axis : str
        Name of the axis of the stage, ``x`` or ``y`` on the built-in ones.
    origin : str
        One of `ORIGINS`.
    value : float
        The value in `unit`.
    unit : str
        Unit of `value` and of `uncertainty`.
    uncertainty : float, optional
        Standard uncertainty, where one is known, in `unit`.
    note : str
        Condition or remark that belongs to the value.

    Raises
    ------
    ModelError
        The quantity or the origin is not a known one, the unit is not the quantity's, or the
        uncertainty is negative.
    """

    quantity: str
    axis: str
    origin: str
    value: float
    unit: str
    uncertainty: float | None = None
    note: str = ""

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise ModelError(
                f"unknown quantity '{self.quantity}': expected one of {', '.join(QUANTITIES)}"
            )
        if self.origin not in ORIGINS:
            raise ModelError(
                f"unknown origin '{self.origin}': expected one of {', '.join(ORIGINS)}"
            )
        if self.unit != QUANTITIES[self.quantity]:
            raise ModelError(
                f"{self.quantity} is held in '{QUANTITIES[self.quantity]}', got '{self.unit}'"
            )
        if self.uncertainty is not None and not self.uncertainty >= 0.0:
            raise ModelError(
                f"the uncertainty of {self.quantity} must be 0 or more, got {self.uncertainty!r}"
            )
