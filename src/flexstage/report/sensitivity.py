"""Sensitivities of the figures of a stage, as a table."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from flexstage.base.arrays import Array
from flexstage.quantities.characteristic import WHOLE_STAGE
from flexstage.quantities.quantity import number
from flexstage.quantities.table import Cell, Column, Table, table
from flexstage.report.tables import LUMPED_ALONE_NOTE, LUMPED_NOTE, value_text
from flexstage.studies.explore.figures import ALIASES, Figure
from flexstage.studies.explore.sensitivity import LENGTH, SHARE, Sensitivities
from flexstage.studies.explore.variables import listed

# names of figures that are short enough above a column of numbers
_SHORTER = {"natural_frequency_hz": "freq.", "rotation_stroke": "stroke"}


def displayed_changes(
    sensitivities: Sensitivities, length: float | None = None, *, in_units: bool = False
) -> Array:
    """Return the displayed changes: in per cent of each figure, or in its unit, shape (f, d).

    Changes of a figure at rounding level are in its unit. A change that would be displayed as 0.00
    is 0.
    """
    # a smaller change is displayed as 0.00 [% of the figure]
    smallest = 0.005
    changes = sensitivities.changes(length)
    in_percent = (
        100.0
        * changes
        / np.where(sensitivities.vanishing, np.nan, np.abs(sensitivities.values))[:, None]
    )
    factors = np.array([figure.display.factor for figure in sensitivities.figures])
    in_unit = changes * factors[:, None]
    largest = np.abs(in_unit).max(axis=1, initial=0.0)[:, None]
    displayed = np.where(np.isnan(in_percent) | in_units, in_unit, in_percent)
    small = np.where(
        np.isnan(in_percent), np.abs(in_unit) <= 1e-3 * largest, np.abs(in_percent) < smallest
    )
    return np.where(small, 0.0, displayed)


def influential_parameters(sensitivities: Sensitivities) -> tuple[list[int], list[str]]:
    """Return the influential parameters, in order of their influence, and the labels of the others.

    Parameters that only change figures at rounding level are last.
    """
    changes = np.nan_to_num(np.abs(displayed_changes(sensitivities)))
    real = changes[~sensitivities.vanishing].max(axis=0, initial=0.0)
    faint = changes[sensitivities.vanishing]
    largest = faint.max(axis=1, initial=0.0)[:, None]
    faint = (faint / np.where(largest == 0.0, 1.0, largest)).max(axis=0, initial=0.0)
    # parameters that differ by rounding stay in the order of the stage
    order = [
        int(k)
        for k in np.lexsort((-faint.round(4), -real.round(4)))
        if real[k] > 0.0 or faint[k] > 0.0
    ]
    idle = [k for k in range(real.size) if k not in order]
    return order, [parameter_label(sensitivities, k) for k in idle]


def parameter_label(sensitivities: Sensitivities, index: int) -> str:
    """Return the name of a parameter, with the number of hinges that it represents."""
    names = sensitivities.equivalent[index]
    return names[0] if len(names) == 1 else f"{names[0]} (×{len(names)})"


def step_words(sensitivities: Sensitivities) -> str:
    """Return the steps of the parameters."""
    length = sensitivities.length
    if length is None:
        return f"+{100.0 * SHARE:g} % of each parameter"
    lengths = f"+{value_text(length, 'length')} of each length"
    if all(variable.dimension == "length" for variable in sensitivities.variables):
        return lengths
    return f"{lengths}, +{100.0 * SHARE:g} % of all other parameters"


def sensitivity_table(sensitivities: Sensitivities, *, in_units: bool = False) -> Table:
    """Return the changes of all figures, the most influential parameters first."""
    changes = displayed_changes(sensitivities, in_units=in_units)
    order, idle = influential_parameters(sensitivities)
    figure_indices = [
        i
        for i in range(len(sensitivities.figures))
        if np.isfinite(sensitivities.values[i])
        and not (sensitivities.vanishing[i] and not changes[i].any())
    ]
    columns = [Column("parameter", "words"), Column("value", "figures")]
    nominal: list[str | Cell] = ["nominal", ""]
    plain = [
        in_units or bool(sensitivities.vanishing[i]) for i in range(len(sensitivities.figures))
    ]
    for i in figure_indices:
        figure = sensitivities.figures[i]
        unit = f"[{figure.display.shown_unit}]" if plain[i] and figure.display.shown_unit else ""
        axis = "" if figure.axis == WHOLE_STAGE else figure.axis
        columns.append(Column(f"{axis} {unit}".strip(), "figures", short_label(figure)))
        nominal.append(Cell(figure.text(float(sensitivities.values[i]))))
    rows: list[list[str | Cell]] = [nominal]
    for k in order:
        v = sensitivities.variables[k]
        usual = value_text(v.usual, v.dimension) if v.usual else ""
        row: list[str | Cell] = [parameter_label(sensitivities, k), usual]
        for i in figure_indices:
            value = float(changes[i, k])
            row.append(Cell(change_text(value, in_units=plain[i]), value=value))
        rows.append(row)
    unit_text = "in their units" if in_units else "in per cent"
    steps = step_words(sensitivities)
    return table(
        f"{sensitivities.stage}, {sensitivities.model}: change of the figures {unit_text} for "
        f"{steps}",
        columns,
        rows,
        notes=tuple(_notes(sensitivities, idle, figure_indices)),
    )


def short_label(figure: Figure) -> str:
    """Return the short name of a figure's quantity, or its name with one word a line."""
    short = {quantity: name for name, quantity in ALIASES.items()} | _SHORTER
    words = figure.quantity.removesuffix("_hz").split("_")
    return short.get(figure.quantity, "\n".join(words))


def change_text(value: float, *, in_units: bool = False) -> str:
    """Return a change with its sign; a dot for zero.

    Examples
    --------
    >>> change_text(1.5), change_text(0.0), change_text(3.14159, in_units=True)
    ('+1.50', '·', '+3.14')
    """
    if not np.isfinite(value):
        return "–"
    if value == 0.0:
        return "·"
    if in_units or abs(value) >= 1000.0:
        digits = 3 if abs(value) >= 0.01 else 2
        return ("+" if value > 0.0 else "-") + number(abs(value), digits)
    return f"{value:+.2f}"


def _notes(
    sensitivities: Sensitivities, idle: list[str], figure_indices: list[int]
) -> Iterator[str]:
    if not figure_indices:
        yield "all figures are at rounding level"
        return
    omitted = [
        f.label.lower() for i, f in enumerate(sensitivities.figures) if i not in figure_indices
    ]
    if omitted:
        yield f"at rounding level, omitted: {', '.join(omitted)}"
    zero = [
        parameter_label(sensitivities, k)
        for k, v in enumerate(sensitivities.variables)
        if v.usual == 0.0 and v.dimension == "length"
    ]
    if sensitivities.length is None and zero and not all(name in idle for name in zero):
        yield f"a length of 0 is changed by {value_text(LENGTH, 'length')}"
    if any(len(names) > 1 for names in sensitivities.equivalent):
        yield "×2: the row represents two hinges with equal effects except for signs"
    if idle:
        yield f"{listed(idle)} {'has' if len(idle) == 1 else 'have'} no effect"


def skipped_notes(sensitivities: Sensitivities) -> Iterator[str]:
    """Yield notes on slopes that are no derivatives, and on the skipped parameters.

    Parameters with one reason share a note.
    """
    # frequencies that differ by less than this are equal [1]
    equal = 1e-4
    if sensitivities.model == "lumped":
        # no other model varies single hinges
        hinges = sensitivities.request is not None and sensitivities.request.hinges
        yield LUMPED_ALONE_NOTE if hinges else LUMPED_NOTE
    else:
        yield f"slopes are {sensitivities.provenance.settings['slopes']}"
    for first, second in combinations(sensitivities.figures, 2):
        if first.quantity == second.quantity == "natural_frequency_hz":
            values = [
                float(sensitivities.values[sensitivities.figures.index(f)]) for f in (first, second)
            ]
            if abs(values[0] - values[1]) <= equal * max(values):
                yield (
                    f"{first.name} and {second.name} are equal: a parameter that separates them "
                    "mixes their modes, and its effect cannot be assigned to one of them"
                )
    reasons: dict[str, list[str]] = {}
    for name, reason in sensitivities.skipped.items():
        reasons.setdefault(reason, []).append(name)
    for reason, names in reasons.items():
        yield f"skipped: {listed(names)}: {reason}"
