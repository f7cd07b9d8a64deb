"""Which parameter moves what, as a table."""

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

# where the short names of figures are too long above a column of numbers
_SHORTER = {"natural_frequency_hz": "freq.", "rotation_stroke": "stroke"}


def shown_changes(
    found: Sensitivities, length: float | None = None, *, in_units: bool = False
) -> Array:
    """Return the changes as they are shown: in per cent of each figure, or in its unit.

    Of a figure that is nothing but rounding there is no part, and its changes are in its unit;
    what is shown as 0.00 is nothing, shape (f, d).
    """
    # per cent of a figure, or parts of its largest change, below which a parameter moves nothing
    nothing = 0.005
    changes = found.changes(length)
    parts = 100.0 * changes / np.where(found.vanishing, np.nan, np.abs(found.values))[:, None]
    factors = np.array([figure.display.factor for figure in found.figures])
    own = changes * factors[:, None]
    largest = np.abs(own).max(axis=1, initial=0.0)[:, None]
    shown = np.where(np.isnan(parts) | in_units, own, parts)
    small = np.where(np.isnan(parts), np.abs(own) <= 1e-3 * largest, np.abs(parts) < nothing)
    return np.where(small, 0.0, shown)


def moving(found: Sensitivities) -> tuple[list[int], list[str]]:
    """Return the parameters that move a figure, those that move one most first, and the others.

    Those that only move what is nothing but rounding stand last.
    """
    shown = np.nan_to_num(np.abs(shown_changes(found)))
    real = shown[~found.vanishing].max(axis=0, initial=0.0)
    faint = shown[found.vanishing]
    largest = faint.max(axis=1, initial=0.0)[:, None]
    faint = (faint / np.where(largest == 0.0, 1.0, largest)).max(axis=0, initial=0.0)
    # what differs by rounding stays in the order of the stage
    order = [
        int(k)
        for k in np.lexsort((-faint.round(4), -real.round(4)))
        if real[k] > 0.0 or faint[k] > 0.0
    ]
    still = [k for k in range(real.size) if k not in order]
    return order, [parameter_label(found, k) for k in still]


def parameter_label(found: Sensitivities, index: int) -> str:
    """Return what a parameter is called, with how many hinges it stands for."""
    alike = found.equivalent[index]
    return alike[0] if len(alike) == 1 else f"{alike[0]} (×{len(alike)})"


def step_words(found: Sensitivities) -> str:
    """Say by what parameters change."""
    length = found.length
    if length is None:
        return f"+{100.0 * SHARE:g} % of each parameter"
    lengths = f"+{value_text(length, 'length')} of each length"
    if all(variable.dimension == "length" for variable in found.variables):
        return lengths
    return f"{lengths}, +{100.0 * SHARE:g} % of all else"


def sensitivity_table(found: Sensitivities, *, in_units: bool = False) -> Table:
    """Return the changes of all figures, those parameters first that move one most."""
    shown = shown_changes(found, in_units=in_units)
    order, rest = moving(found)
    kept = [
        i
        for i in range(len(found.figures))
        if np.isfinite(found.values[i]) and not (found.vanishing[i] and not shown[i].any())
    ]
    columns = [Column("parameter", "words"), Column("value", "figures")]
    now: list[str | Cell] = ["now", ""]
    plain = [in_units or bool(found.vanishing[i]) for i in range(len(found.figures))]
    for i in kept:
        figure = found.figures[i]
        unit = f"[{figure.display.shown_unit}]" if plain[i] and figure.display.shown_unit else ""
        axis = "" if figure.axis == WHOLE_STAGE else figure.axis
        columns.append(Column(f"{axis} {unit}".strip(), "figures", short_label(figure)))
        now.append(Cell(figure.text(float(found.values[i]))))
    rows: list[list[str | Cell]] = [now]
    for k in order:
        v = found.variables[k]
        usual = value_text(v.usual, v.dimension) if v.usual else ""
        row: list[str | Cell] = [parameter_label(found, k), usual]
        for i in kept:
            value = float(shown[i, k])
            row.append(Cell(change_text(value, in_units=plain[i]), value=value))
        rows.append(row)
    what = "in their units" if in_units else "in per cent of them"
    steps = step_words(found)
    return table(
        f"{found.stage}, {found.model}: change of the figures {what} for {steps}",
        columns,
        rows,
        notes=tuple(_notes(found, rest, kept)),
    )


def short_label(figure: Figure) -> str:
    """Return the short name of a figure's quantity, or its own one, one word a line."""
    short = {quantity: name for name, quantity in ALIASES.items()} | _SHORTER
    words = figure.quantity.removesuffix("_hz").split("_")
    return short.get(figure.quantity, "\n".join(words))


def change_text(value: float, *, in_units: bool = False) -> str:
    """Write a change with its sign; a dot for nothing.

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


def _notes(found: Sensitivities, rest: list[str], kept: list[int]) -> Iterator[str]:
    if not kept:
        yield "every figure that is looked at is nothing but rounding here"
        return
    left = [f.label.lower() for i, f in enumerate(found.figures) if i not in kept]
    if left:
        yield f"nothing but rounding, and left out: {', '.join(left)}"
    zero = [
        parameter_label(found, k)
        for k, v in enumerate(found.variables)
        if v.usual == 0.0 and v.dimension == "length"
    ]
    if found.length is None and zero and not all(name in rest for name in zero):
        yield f"a length that is 0 changes by {value_text(LENGTH, 'length')}"
    if any(len(alike) > 1 for alike in found.equivalent):
        yield "×2: the row stands for two hinges, which do the same but for signs"
    if rest:
        yield f"{listed(rest)} {'moves' if len(rest) == 1 else 'move'} none of them"


def skipped_notes(found: Sensitivities) -> Iterator[str]:
    """Say what the slopes are where they are no derivatives, and what is not among them, and why.

    Parameters of one reason stand together.
    """
    # frequencies that differ by less than this are one [1]
    equal = 1e-4
    if found.model == "lumped":
        # no other model moves hinges by themselves
        hinges = found.request is not None and found.request.hinges
        yield LUMPED_ALONE_NOTE if hinges else LUMPED_NOTE
    else:
        yield f"slopes are {found.provenance.settings['slopes']}"
    for one, other in combinations(found.figures, 2):
        if one.quantity == other.quantity == "natural_frequency_hz":
            values = [float(found.values[found.figures.index(f)]) for f in (one, other)]
            if abs(values[0] - values[1]) <= equal * max(values):
                yield (
                    f"{one.name} and {other.name} are equal: what changes them differently mixes "
                    "their modes, and which of them it moves is open"
                )
    reasons: dict[str, list[str]] = {}
    for name, reason in found.skipped.items():
        reasons.setdefault(reason, []).append(name)
    for reason, names in reasons.items():
        yield f"left out: {listed(names)}: {reason}"
