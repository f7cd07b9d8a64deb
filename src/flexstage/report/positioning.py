"""Tables of accuracy and repeatability of positioning, by the figures of ISO 230-2."""

import math
from dataclasses import dataclass

from flexstage.estimate import Estimate
from flexstage.measure.motion.positioning import Positioning
from flexstage.quantities import prefixed
from flexstage.table import Table, table

#: Figures of an axis: symbol, name, field of both directions; upward and downward have suffixes.
_AXIS: tuple[tuple[str, str, str], ...] = (
    ("A", "accuracy", "accuracy"),
    ("R", "repeatability", "repeatability"),
    ("E", "systematic deviation", "systematic"),
    ("M", "mean bidirectional deviation", "mean_deviation"),
    ("B", "reversal value", "reversal"),
    ("B̄", "mean reversal value", "mean_reversal"),
)
#: Digits of A that are shown, which is one more than machines are tested to.
_DIGITS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class PositioningTables:
    """The two tables of a test: figures of the axis, and values at the targets."""

    unit: str
    """Unit of all figures but the targets."""
    axis: Table
    """Figures of the axis."""
    targets: Table
    """Values at the targets."""


def positioning_tables(found: Positioning) -> PositioningTables:
    """Write the figures of an axis and of its targets, in unit and decimals of the accuracy."""
    accuracy = abs(found.accuracy.value)
    factor, prefix = prefixed(accuracy)
    shown = factor * accuracy
    digits = _DIGITS - 1 - math.floor(math.log10(shown)) if shown > 0.0 else 0
    decimals = min(max(digits, 0), _DIGITS - 1)  # of exact positions what is left is rounding

    def text(value: float) -> str:
        return f"{factor * value:.{decimals}f}".replace("-", "−")

    def given(name: str) -> tuple[str, ...]:
        estimate = getattr(found, name, None)
        return ("", "") if estimate is None else (text(estimate.value), _short(estimate, factor))

    across, of_target = prefixed(float(abs(found.target).max()))
    columns = (
        found.mean_upward, found.mean_downward, found.mean_bidirectional, found.reversal_at_targets,
        found.spread_upward, found.spread_downward, 4.0 * found.spread_upward,
        4.0 * found.spread_downward, found.repeatability_at_targets,
    )  # fmt: skip
    pm = "± (95 %)"
    of_axis = (
        (symbol, label, *given(f"{name}_upward"), *given(f"{name}_downward"), *given(name))
        for symbol, label, name in _AXIS
    )
    at_targets = (
        (f"{across * at:.7g}".replace("-", "−"), *(text(float(v[i])) for v in columns))
        for i, at in enumerate(found.target)
    )
    heads = ("x̄ ↑", "x̄ ↓", "x̄", "B", "s ↑", "s ↓", "R ↑", "R ↓", "R")
    return PositioningTables(
        unit=f"{prefix}m",
        axis=table("", ("", "<ISO 230-2", "upward", pm, "downward", pm, "both", pm), of_axis),
        targets=table("", (f"target [{of_target}m]", *heads), at_targets),
    )


def _short(estimate: Estimate, factor: float) -> str:
    return f"{float(f'{factor * estimate.expanded:.2g}'):g}"
