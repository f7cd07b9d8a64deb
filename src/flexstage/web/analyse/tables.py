"""Tables of the view Analyse: what the models found, side by side."""

from collections.abc import Sequence

from flexstage.quantities.characteristic import WHOLE_STAGE, Characteristic
from flexstage.quantities.comparison import compare, title_of
from flexstage.quantities.quantity import Quantity, number
from flexstage.quantities.table import Cell, Table, table
from flexstage.report.tables import cause_words, percent
from flexstage.system import DriveCondition
from flexstage.web.analyse.work import Analysed
from flexstage.web.preferences import Preferences

#: What is looked at first.
_FIRST = frozenset(
    (
        "transmission_ratio", "output_displacement", "rotation_stroke", "input_stiffness",
        "output_stiffness", "max_stress", "safety_factor", "natural_frequency_hz",
        "natural_frequency_with_stack_hz", "cross_coupling", "buckling_factor",
    )
)  # fmt: skip
# An estimate of an error is seen above this part of the value [1]: the half of four digits.
_SEEN = 5e-5


def figures_tables(preferences: Preferences, found: Sequence[Analysed]) -> tuple[Table, Table]:
    """Set the figures of models side by side: those that are looked at first, and all others.

    Of two models there is the difference of the second to the first as well.
    """
    rows = compare(row for one in found for row in one.analysis.characteristics).rows
    models = [one.model for one in found]
    heads = ["figure", "<axis", *(title_of(model) for model in models)]
    heads += ["difference"] if len(models) == 2 else []
    first, others = [], []
    for row in rows:
        shown = preferences.shown(row.quantity)
        axis = "" if row.axis == WHOLE_STAGE else row.axis
        cells = [Cell(shown.heading, small=row.remark), axis]
        cells += [_cell(row.cells.get(model), shown) for model in models]
        if len(models) == 2:
            cells.append(percent(row.difference_percent(models[1], models[0])) or "–")
        fails = any(cell.failing for cell in row.cells.values())
        (first if fails or row.quantity in _FIRST else others).append(cells)
    return table("", heads, first), table("", heads, others)


def _cell(row: Characteristic | None, shown: Quantity) -> Cell:
    if row is None:
        return Cell("–")
    text, note = row.text(shown), row.note
    spread = row.uncertainty
    if spread is not None:
        told = f"± {number(spread * shown.factor, 2)}"
        note = f"{told}; {note}" if note else told
        # what is below the last digit is in no one's way
        if spread > _SEEN * abs(row.value):
            text = f"{text} ± {number(spread * shown.factor, 1)}"
    return Cell(text, row.value, note, failing=row.failing)


def modes_table(found: Sequence[Analysed], drives: DriveCondition) -> Table:
    """Set the lowest natural frequencies of models side by side, in one condition of the drives."""
    columns = [one.analysis.modes[drives] for one in found if drives in one.analysis.modes]
    count = min(6, max((c.frequency_hz.size for c in columns), default=0))
    rows = []
    for k in range(count):
        cells: list[str | Cell] = [str(k + 1)]
        for each in columns:
            if k >= each.frequency_hz.size:
                cells.append(Cell("–"))
                continue
            value = float(each.frequency_hz[k])
            spread = each.uncertainty_hz
            more = "" if spread is None else f" ± {number(float(spread[k]), 1)}"
            cells.append(Cell(number(value) + more, value))
        rows.append(cells)
    heads = ["mode", *(f"{title_of(one.model)} [Hz]" for one in found)]
    return table("", heads, rows)


def hinges_table(one: Analysed) -> Table:
    """Return the largest equivalent stress of each hinge at the full stroke of each axis."""
    stress = one.analysis.hinge_stress
    of = cause_words(one.analysis)
    rows = [
        [hinge.name, *(f"{stress[axis][hinge.name] * 1e-6:.1f}" for axis in stress)]
        for hinge in one.analysis.stage.hinges
        if any(stress.values())
    ]
    return table("", ["hinge", *(f"{of} {axis} [MPa]" for axis in stress)], rows)
