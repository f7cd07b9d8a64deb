"""Whether two figures differ by more than their uncertainties explain."""

from dataclasses import dataclass

from flexstage.characteristic import Characteristic
from flexstage.errors import ModelError
from flexstage.estimate import Estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """How far one figure is above another."""

    value: float
    """The difference, in the unit of the figures."""
    percent: float | None
    """The same in percent of the reference; None where that is 0."""
    expanded: float | None
    """Expanded uncertainty of the difference at 95 %; None where neither figure has one."""
    significant: bool | None
    """Whether the difference is larger than that; None where it cannot be said."""


def difference(figure: Characteristic, reference: Characteristic) -> Difference:
    """Compare two figures of the same quantity.

    The difference is significant at 95 % where it exceeds its expanded uncertainty, with degrees of
    freedom after Welch and Satterthwaite (JCGM 100:2008, G.4). A figure without uncertainty counts
    as exact beside one that has one: of a model the verdict then asks whether the measurement
    contradicts it, not by how much the model itself may be off.

    Examples
    --------
    >>> measured = Characteristic(quantity="natural_frequency_hz", axis="x", origin="measured",
    ...     value=337.0, unit="Hz", uncertainty=0.4, degrees_of_freedom=9.0)
    >>> model = Characteristic(quantity="natural_frequency_hz", axis="x", origin="solid",
    ...     value=320.9, unit="Hz")
    >>> found = difference(measured, model)
    >>> print(f"{found.percent:.1f} %, significant: {found.significant}")
    5.0 %, significant: True
    """
    if figure.quantity != reference.quantity:
        raise ModelError(
            f"a {figure.quantity} cannot be compared with a {reference.quantity}: choose rows of "
            "one quantity"
        )
    value = float(figure.value - reference.value)
    percent = None if reference.value == 0.0 else float(100.0 * value / abs(reference.value))
    parts = tuple(c.contribution for c in (figure, reference) if c.contribution is not None)
    if not parts:
        return Difference(value=value, percent=percent, expanded=None, significant=None)
    whole = Estimate(value=value, unit=figure.unit, components=parts)
    expanded = whole.coverage_factor * whole.uncertainty
    return Difference(
        value=value, percent=percent, expanded=expanded, significant=bool(abs(value) > expanded)
    )
