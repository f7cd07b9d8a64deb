"""Tables of the report as HTML."""

from collections import defaultdict
from dataclasses import fields
from html import escape

from flexstage.characteristic import Characteristic
from flexstage.hinges import Profile
from flexstage.report.comparison import Comparison, ComparisonRow
from flexstage.report.quantities import display, number
from flexstage.stage import Stage
from flexstage.units import DIMENSIONS

__all__ = [
    "characteristics_table",
    "column_title",
    "differences_table",
    "hinge_table",
    "published_table",
]

_TITLES = {
    "published-analytic": "analytic",
    "published-fem": "FEM",
    "published-measured": "measured",
}
_FEW = 2  # columns of ours beside which there is room for differences
_MOST_NAMES = 12  # hinges that a row names
# what the study says of its own models: each against the experiment, and one against the other
_PAIRS = (
    ("published-measured", "published-analytic"),
    ("published-measured", "published-fem"),
    ("published-fem", "published-analytic"),
)


def column_title(column: str) -> str:
    """Return what a column of a comparison is called.

    Parameters
    ----------
    column : str
        An origin, or the name of a variant.

    Returns
    -------
    str
        Its title.
    """
    return _TITLES.get(column, column)


def percent(value: float | None) -> str:
    """Write a difference in percent with its sign.

    Parameters
    ----------
    value : float or None
        The difference [%].

    Returns
    -------
    str
        One decimal; empty for none.
    """
    return "" if value is None else f"{value:+.1f} %".replace("-", "−")


def characteristics_table(comparison: Comparison) -> str:
    """Write all origins side by side, the best of ours set off.

    Where there is room for it, with its difference to each published one.

    Parameters
    ----------
    comparison : Comparison
        The table.

    Returns
    -------
    str
        A ``<table>``; each value also stands unrounded in ``data-value``.
    """
    ours = comparison.best
    others = [column for column in comparison.ours if column != ours]
    signed = comparison.published if len(comparison.ours) <= _FEW else ()
    groups = "<th></th><th></th>"
    if comparison.published:
        groups += f'<th colspan="{len(comparison.published)}">published</th>'
    groups += f'<th colspan="{1 + len(others)}">computed here</th>'
    if signed:
        groups += f'<th colspan="{len(signed)}">{escape(ours)} against published</th>'
    heads = '<th class="text">Quantity</th><th class="text">Axis</th>'
    heads += "".join(f"<th>{escape(column_title(c))}</th>" for c in comparison.columns)
    heads += "".join(f"<th>{escape(column_title(c))}</th>" for c in signed)
    lines = []
    before = ""
    for row in comparison.rows:
        cells = _label_cells(row)
        for column in comparison.columns:
            kind = "ours" if column == ours else "variant" if column in others else ""
            cells.append(_value_cell(row, column, kind))
        cells += [f"<td>{percent(row.difference_percent(ours, c))}</td>" for c in signed]
        opening = '<tr class="next">' if row.quantity != before else "<tr>"
        lines.append(f"{opening}{''.join(cells)}</tr>")
        before = row.quantity
    return _table(f'<tr class="groups">{groups}</tr><tr>{heads}</tr>', lines)


def differences_table(comparison: Comparison) -> str:
    """Write by how much each of our models differs from each published origin.

    Parameters
    ----------
    comparison : Comparison
        The table.

    Returns
    -------
    str
        A ``<table>``; empty where nothing was published, or where `characteristics_table` has room
        for it.
    """
    if not comparison.published or len(comparison.ours) <= _FEW:
        return ""
    models = comparison.models
    groups = "<th></th><th></th>" + "".join(
        f'<th colspan="{len(models)}">against {column_title(c)}</th>' for c in comparison.published
    )
    heads = '<th class="text">Quantity</th><th class="text">Axis</th>'
    # the longest name may be broken, or the last column stands outside the page
    names = [escape(m).replace("superelement", "super&shy;element") for m in models]
    heads += "".join(f"<th>{name}</th>" for name in names) * len(comparison.published)
    lines = []
    for row in comparison.rows:
        signed = [
            percent(row.difference_percent(m, c)).removesuffix(" %")
            for c in comparison.published
            for m in models
        ]
        if any(signed):
            cells = [*_label_cells(row), *(f"<td>{text}</td>" for text in signed)]
            lines.append(f"<tr>{''.join(cells)}</tr>")
    return _table(f'<tr class="groups">{groups}</tr><tr>{heads}</tr>', lines) if lines else ""


def published_table(comparison: Comparison) -> str:
    """Write what was published alone, with the differences between its own columns.

    Parameters
    ----------
    comparison : Comparison
        The table.

    Returns
    -------
    str
        A ``<table>``; empty where fewer than two origins were published.
    """
    pairs = [p for p in _PAIRS if set(p) <= set(comparison.published)]
    if not pairs:
        return ""
    heads = '<th class="text">Quantity</th><th class="text">Axis</th>'
    heads += "".join(f"<th>{column_title(c)}</th>" for c in comparison.published)
    heads += "".join(f"<th>{column_title(a)} against {column_title(b)}</th>" for a, b in pairs)
    lines = []
    for row in comparison.rows:
        if not any(column in row.cells for column in comparison.published):
            continue
        cells = _label_cells(row)
        shown = display(row.quantity)
        cells += [f"<td>{shown.text(row.value(c))}</td>" for c in comparison.published]
        cells += [f"<td>{percent(row.difference_percent(a, b))}</td>" for a, b in pairs]
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return _table(f"<tr>{heads}</tr>", lines)


def hinge_table(stage: Stage, *, method: str = "wedge", plane: str = "auto") -> str:
    """Write the stiffness of every kind of hinge of a stage.

    Parameters
    ----------
    stage : Stage
        The stage.
    method : str
        How the stiffness is found.
    plane : str
        ``stress``, ``strain`` or ``auto``.

    Returns
    -------
    str
        A ``<table>``; hinges that are alike in notch and roots share a row.
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
    return _table(f"<tr>{heads}</tr>", lines)


def _profile_text(profile: Profile) -> str:
    sizes = [
        f"{f.name.replace('_', ' ')} {getattr(profile, f.name) * 1e3:.4g} mm"
        for f in fields(profile)
        if f.name != "neck_thickness"
        and DIMENSIONS["length"] in getattr(f.type, "__metadata__", ())
    ]
    side = ", one-sided" if profile.one_sided else ""
    return f"{profile.kind}{side}" + "".join(f", {size}" for size in sizes)


def _label_cells(row: ComparisonRow) -> list[str]:
    shown = display(row.quantity)
    unit = f" [{shown.unit}]" if shown.unit else ""
    remark = f"<br><small>{escape(row.remark)}</small>" if row.remark else ""
    return [
        f'<td class="text">{escape(shown.label + unit)}{remark}</td>',
        f'<td class="text">{escape(row.axis)}</td>',
    ]


def _value_cell(row: ComparisonRow, column: str, kind: str) -> str:
    cell: Characteristic | None = row.cells.get(column)
    if cell is None:
        return f'<td class="{kind}">–</td>'
    title = f' title="{escape(cell.note, quote=True)}"' if cell.note else ""
    names = {"quantity": row.quantity, "axis": row.axis, "column": column, "value": cell.value}
    data = "".join(f' data-{k}="{escape(str(v), quote=True)}"' for k, v in names.items())
    return f'<td class="{kind}"{data}{title}>{display(row.quantity).text(cell.value)}</td>'


def _table(head: str, lines: list[str]) -> str:
    return (
        f'<div class="scroll"><table><thead>{head}</thead><tbody>{"".join(lines)}</tbody>'
        "</table></div>"
    )
