"""Tables of the report as HTML."""

from collections import defaultdict
from collections.abc import Collection
from dataclasses import fields, replace
from html import escape

from flexstage.characteristic import Characteristic
from flexstage.comparison import Comparison, ComparisonRow, shared_rows
from flexstage.hinges import Profile
from flexstage.quantities import Quantity, display, number
from flexstage.report.page import captioned, table_html
from flexstage.stage import Stage
from flexstage.units import DIMENSIONS

_TITLES = {
    "published-analytic": "analytic",
    "published-fem": "FEM",
    "published-measured": "measured",
}
#: What comes from manufacture: no model of the ideal geometry is compared with it.
MANUFACTURE = frozenset(("straightness", "straightness_out_of_plane", "linearity"))
LABEL_HEADS = ('<th class="text">Quantity</th>', '<th class="text">Axis</th>')
_MOST_NAMES = 12  # hinges that a row names
# what the study says of its own models: each against the experiment, and one against the other
_PAIRS = (
    ("published-measured", "published-analytic"),
    ("published-measured", "published-fem"),
    ("published-fem", "published-analytic"),
)


def column_title(column: str) -> str:
    """Return what a column of a comparison, an origin or a variant, is called."""
    return _TITLES.get(column, column)


def percent(value: float | None) -> str:
    """Write a difference in percent with its sign and one decimal; empty for none."""
    if value is None:
        return ""
    # a difference that rounds to nothing has no sign
    return "0.0 %" if abs(value) < 0.05 else f"{value:+.1f} %".replace("-", "−")


def characteristics_table(comparison: Comparison, quantities: Collection[str], caption: str) -> str:
    """Write some quantities by all origins side by side, the best of ours set off.

    Each value also stands unrounded in ``data-value``; a row that is the same for all axes stands
    once. Empty where we have no value of any of them.
    """
    rows = [
        row
        for row in shared_rows(comparison.rows)
        if row.quantity in quantities and any(column in row.cells for column in comparison.ours)
    ]
    shown = [c for c in comparison.columns if any(c in row.cells for row in rows)]
    published = [c for c in shown if c in comparison.published]
    ours = comparison.best
    others = [column for column in comparison.ours if column != ours]
    groups = "<th></th><th></th>"
    if published:
        groups += f'<th colspan="{len(published)}">published</th>'
    groups += f'<th colspan="{len(shown) - len(published)}">here, by model</th>'
    heads = [*LABEL_HEADS, *(f"<th>{escape(column_title(c))}</th>" for c in shown)]
    lines = []
    before = ""
    for row in rows:
        fitting = shown_in(row)
        cells = _label_cells(row, fitting)
        for column in shown:
            kind = "ours" if column == ours else "variant" if column in others else ""
            cells.append(_value_cell(row, column, fitting, kind))
        opening = '<tr class="next">' if row.quantity != before else "<tr>"
        lines.append(f"{opening}{''.join(cells)}</tr>")
        before = row.quantity
    return captioned(table_html(heads, lines, groups=groups), caption) if lines else ""


def differences_table(comparison: Comparison) -> str:
    """Write by how much each of our models differs from each published origin.

    Empty where nothing was published.
    """
    models = comparison.models
    groups = "<th></th><th></th>" + "".join(
        f'<th colspan="{len(models)}">to {column_title(c)}</th>' for c in comparison.published
    )
    # the longest name may be broken, or the last column stands outside the page
    names = [escape(m).replace("superelement", "super&shy;element") for m in models]
    heads = [*LABEL_HEADS, *[f"<th>{name}</th>" for name in names] * len(comparison.published)]
    lines = []
    for row in shared_rows(comparison.rows):
        if row.quantity in MANUFACTURE or row.quantity == "input_displacement":
            continue  # the latter is put into every model
        signed = [
            percent(row.difference_percent(m, c)).removesuffix(" %")
            for c in comparison.published
            for m in models
        ]
        if any(signed):
            label = _label_cells(row, replace(display(row.quantity), shown_unit=""))
            cells = [*label, *(f"<td>{text}</td>" for text in signed)]
            lines.append(f"<tr>{''.join(cells)}</tr>")
    caption = "Difference of each model here to each published origin [% of the published value]."
    return captioned(table_html(heads, lines, groups=groups), caption) if lines else ""


def published_table(comparison: Comparison) -> str:
    """Write what was published alone, with the differences between its own columns.

    Empty where nothing was published.
    """
    if not comparison.published:
        return ""
    pairs = [p for p in _PAIRS if set(p) <= set(comparison.published)]
    heads = [*LABEL_HEADS, *(f"<th>{column_title(c)}</th>" for c in comparison.published)]
    heads += [f"<th>{column_title(a)} to {column_title(b)}</th>" for a, b in pairs]
    lines, notes = [], []
    for row in shared_rows(comparison.rows):
        if not any(column in row.cells for column in comparison.published):
            continue
        fitting = shown_in(row)
        cells = _label_cells(row, fitting)
        cells += [_value_cell(row, c, fitting) for c in comparison.published]
        cells += [f"<td>{percent(row.difference_percent(a, b))}</td>" for a, b in pairs]
        remarks = [n for c in comparison.published if c in row.cells and (n := row.cells[c].note)]
        notes.append("; ".join(dict.fromkeys(remarks)))
        cells.append(f'<td class="text wrap">{escape(notes[-1])}</td>')
        lines.append(f"<tr>{''.join(cells)}</tr>")
    heads.append('<th class="text">remark</th>')
    caption = (
        "Published figures, and the differences between their own columns [% of the second one]. "
        "Values as they are printed."
    )
    return captioned(table_html(heads, lines), caption)


def hinge_table(stage: Stage, *, method: str = "wedge", plane: str = "auto") -> str:
    """Write the stiffness of every kind of hinge of a stage, by one method.

    Hinges that are alike in notch and roots share a row.
    """
    from flexstage.lumped import hinge_springs

    numbers = {hinge.name: i for i, hinge in enumerate(stage.hinges, start=1)}
    groups = defaultdict(list)
    for spring in hinge_springs(stage, method=method, plane=plane):  # type: ignore[arg-type]
        roots = spring.root_widths
        key = (spring.hinge.profile, spring.plane, roots and tuple(round(w, 9) for w in roots))
        groups[key].append(spring)
    lines = []
    for (profile, state, _), springs in groups.items():
        k = springs[0].stiffness
        named = [f"{s.hinge.name} ({numbers[s.hinge.name]})" for s in springs]
        if len(named) > _MOST_NAMES:
            named[_MOST_NAMES - 1 :] = [f"and {len(named) - _MOST_NAMES + 1} more"]
        names = ", ".join(named)
        cells = [
            f'<td class="text wrap">{escape(names)}</td>',
            f'<td class="text">{escape(_profile_text(profile))}</td>',
            f"<td>{number(profile.neck_thickness * 1e3, 3)}</td>",
            f"<td>{number(k[0, 0] * 1e-6)}</td>",
            f"<td>{number(k[1, 1] * 1e-6)}</td>",
            f"<td>{number(k[2, 2])}</td>",
            f'<td class="text">{escape(springs[0].method)}, plane {state}</td>',
        ]
        lines.append(f"<tr>{''.join(cells)}</tr>")
    heads = (
        '<th class="text">Hinges (number in the drawing)</th><th class="text">Profile</th>'
        "<th>Neck [mm]</th><th>Axial [N/µm]</th><th>Shear [N/µm]</th><th>Rotation [N m/rad]</th>"
        '<th class="text">Method</th>'
    )
    caption = (
        "Stiffness about the neck, lumped model. Hinges that are alike in notch and adjoining "
        "bodies share a row."
    )
    return captioned(table_html((heads,), lines), caption)


def shown_in(row: ComparisonRow) -> Quantity:
    """Return the unit that a row is shown in: one in which its values are not tiny.

    The usual one where some are published, as it is the one that they are printed in.
    """
    if any(column.startswith("published") for column in row.cells):
        return display(row.quantity)
    return display(row.quantity).fitting(max(abs(cell.value) for cell in row.cells.values()))


def _profile_text(profile: Profile) -> str:
    sizes = [
        f"{f.name.replace('_', ' ')} {getattr(profile, f.name) * 1e3:.4g} mm"
        for f in fields(profile)
        if f.name != "neck_thickness"
        and DIMENSIONS["length"] in getattr(f.type, "__metadata__", ())
    ]
    side = ", one-sided" if profile.one_sided else ""
    return f"{profile.kind}{side}" + "".join(f", {size}" for size in sizes)


def _label_cells(row: ComparisonRow, shown: Quantity) -> list[str]:
    remark = f"<br><small>{escape(row.remark)}</small>" if row.remark else ""
    return [
        f'<td class="text wrap">{escape(shown.heading)}{remark}</td>',
        f'<td class="text">{escape(row.axis)}</td>',
    ]


def _value_cell(row: ComparisonRow, column: str, shown: Quantity, kind: str = "") -> str:
    cell: Characteristic | None = row.cells.get(column)
    if cell is None:
        return f'<td class="{kind}">–</td>'
    title = f' title="{escape(cell.note, quote=True)}"' if cell.note else ""
    names = {"quantity": row.quantity, "axis": row.axis, "column": column, "value": cell.value}
    data = "".join(f' data-{k}="{escape(str(v), quote=True)}"' for k, v in names.items())
    return f'<td class="{kind}"{data}{title}>{cell.text(shown)}</td>'
