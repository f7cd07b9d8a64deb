"""Tables of the report of a study, and of the coupling of its drives."""

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Literal

from flexstage.hinges import Profile
from flexstage.quantities.characteristic import Characteristic, kind_of, measured_value
from flexstage.quantities.comparison import (
    PUBLISHED_WORDS,
    Comparison,
    ComparisonRow,
    shared_rows,
)
from flexstage.quantities.quantity import Quantity, display, number, prefixed
from flexstage.quantities.table import Cell, Column, Content, Picture, Table, table
from flexstage.quantities.units import DIMENSIONS, readable_text
from flexstage.stage import Stage
from flexstage.stage.designs.vgtu import PredictedRanges
from flexstage.system import Analysis, AxisAnalysis
from flexstage.system.coupled_axes import CoupledAxes

if TYPE_CHECKING:
    from flexstage.control.dynamic_budget import DynamicBudget, PointBudget
    from flexstage.lumped.assemble import HingeSpring
    from flexstage.stage.drawing.drawn_stage import DrawnStage


def coupling_tables(coupling: CoupledAxes) -> Iterator[Table]:
    """Yield the Jacobian, the decoupling matrix and the workspace of all drives."""
    turns = dict(zip(coupling.names, (unit == "rad" for unit in coupling.units), strict=True))
    yield table(
        "Jacobian: motion of each axis per elongation of each drive, other drives held",
        ("axis", *(f"drive {name}" for name in coupling.drives), "<unit"),
        [
            (axis, *map(_figure, row), "µrad/µm" if turns[axis] else "µm/µm")
            for axis, row in zip(coupling.names, coupling.jacobian.tolist(), strict=True)
        ],
    )
    if coupling.independent:
        yield table(
            "Decoupling matrix: elongation of each drive per unit motion of one axis alone",
            (
                "drive",
                *(f"{axis} [µm/{'µrad' if turns[axis] else 'µm'}]" for axis in coupling.names),
            ),
            [
                (drive, *map(_figure, row))
                for drive, row in zip(coupling.drives, coupling.decoupling.tolist(), strict=True)
            ],
        )
    workspace = coupling.workspace
    if workspace is None:
        return
    rows = [("all drives over their strokes", number(1e12 * workspace.area), "µm²")]
    if len(workspace.axes) > 2:
        rows = [
            ("at the middle rotation", number(1e12 * workspace.area), "µm²"),
            ("at any rotation", number(1e12 * workspace.projected_area), "µm²"),
            ("with the rotations", number(1e18 * workspace.volume), "µm² µrad"),
        ]
    title = f"Workspace of all drives, {' and '.join(workspace.axes[:2])}"
    yield table(title, ("condition", "size", "<unit"), rows)


def coupling_section(coupling: CoupledAxes | None) -> Iterator[Content]:
    """Yield the coupling of the drives, for coupled axes."""
    if coupling is None or not coupling.coupled:
        return
    yield (
        "Each drive moves several axes. The Jacobian applies to one drive at a time, with all "
        "others held at zero elongation. With the decoupling matrix the drives move one axis "
        "alone, as for the figures of each axis here."
    )
    yield from coupling_tables(coupling)
    if (workspace := coupling.workspace) is not None:
        yield Picture(
            result=workspace,
            title="workspace of all drives",
            caption="Workspace of all drives within their strokes. Arrows: the stroke of each "
            "drive alone, from the lower ends of all strokes.",
            size="tiny",
        )


def cause_words(analysis: Analysis) -> str:
    """Return the cause of a load or motion, to precede the name of an axis."""
    separate = all(len(axis.drives) == 1 for axis in analysis.axes)
    return "drive of" if separate else "motion of"


def full_stroke_words(axis: AxisAnalysis) -> str:
    """Return the state of the drives in a picture of an axis at full stroke."""
    if len(axis.drives) == 1:
        return f"drive of {axis.axis} at full stroke, the others removed"
    return f"all drives together over the full stroke of {axis.axis} alone"


def _figure(value: float) -> str:
    return number(value) if abs(value) > 1e-12 else "≈ 0"


#: Accuracy of the lumped model compared with the other commands.
LUMPED_ALONE_NOTE = (
    "figures by the lumped model, a few per cent from the superelement figures of analyse and "
    "tolerance"
)
#: The same for a command with other models.
LUMPED_NOTE = f"{LUMPED_ALONE_NOTE}; --model superelement gives those, but takes longer"

#: Quantities that also depend on manufacture: no model of the ideal geometry is compared with them.
MANUFACTURE = frozenset(("straightness", "straightness_out_of_plane", "linearity"))
_LABELS = (Column("Quantity", "long words"), "<Axis")
_HERE = "computed here, by model"
_KIND = Column("kind", "long words", group=_HERE)
_SPREAD_NOTE = (
    "±: of a model the estimated error of the mesh, or, of a stress without an estimate, the "
    "difference between the elements at its point; of a measurement the standard uncertainty."
)
# before the range of a predicted figure
_RANGE = "95 %:"
# differences that the publication gives: each model to the experiment, and between the models
_PAIRS = (
    ("published-measured", "published-analytic"),
    ("published-measured", "published-fem"),
    ("published-fem", "published-analytic"),
)


def value_text(value: float, dimension: str, digits: int = 5) -> str:
    """Return a value with a readable unit; a plain number has none.

    Examples
    --------
    >>> value_text(0.35 / 3e3, "length"), value_text(0.3, "")
    ('0.11667 mm', '0.3')
    """
    if not dimension:
        return f"{value:.{digits}g}"
    digits_text, _, unit = readable_text(float(f"{value:.{digits}g}"), dimension).partition(" ")
    return f"{float(digits_text):.{digits}g} {unit.replace('um', 'µm')}"


def column_title(column: str) -> str:
    """Return the title of a column of a comparison, an origin or a variant."""
    return PUBLISHED_WORDS.get(column, column)


def column_group(column: str) -> str:
    """Return the title above an origin, with the kind of figures of a publication.

    A measured one has it in its name.
    """
    if column.startswith("published"):
        return "published" if column == "published-measured" else "published, predicted"
    return {"measured": "measured here", "virtual": "simulated"}.get(column, _HERE)


def percent(value: float | None) -> str:
    """Return a difference in percent with its sign and one decimal; empty for none."""
    if value is None:
        return ""
    # a difference that rounds to nothing has no sign
    return "0.0 %" if abs(value) < 0.05 else f"{value:+.1f} %".replace("-", "−")


def published_loop(
    rows: Iterable[Characteristic], axis: str
) -> tuple[float | None, float | None, float | None]:
    """Return the widths of a loop in open loop and compensated [m], and the reduction [%].

    Measured and published values of an axis; None without.
    """
    width, compensated = (
        measured_value(rows, f"{of}_loop_width", axis) for of in ("hysteresis", "compensated")
    )
    if width is None or compensated is None:
        return width, compensated, None
    return width, compensated, 100.0 * (1.0 - compensated / width)


def characteristics_table(
    comparison: Comparison,
    quantities: Collection[str],
    caption: str,
    ranges: PredictedRanges | None = None,
) -> Table | None:
    """Return quantities by all origins side by side, the best column of ours highlighted.

    A row that is the same for all axes is given once. Next to published values each row states the
    kind of its computed figures, a predicted one with its range. None without a value of ours.
    """
    rows = [
        row
        for row in shared_rows(comparison.rows)
        if row.quantity in quantities and any(column in row.cells for column in comparison.ours)
    ]
    if not rows:
        return None
    ours = comparison.best
    others = [column for column in comparison.ours if column != ours]
    heads, marks = [], {}
    published = [c for c in comparison.published if any(c in row.cells for row in rows)]
    for column in comparison.columns:
        if any(column in row.cells for row in rows):
            group = column_group(column)
            heads.append(Column(column_title(column), group=group, spare=column in others))
            marks[column] = "ours" if column == ours else "variant" if column in others else ""
    lines = []
    units = comparison.units
    if published:
        heads.insert(len(published), _KIND)
    for row in rows:
        quantity = units[row.quantity]
        values = [_value(row, column, quantity, mark) for column, mark in marks.items()]
        if published:
            values.insert(len(published), kind_cell(row, quantity, ranges))
        lines.append((*_label(row, quantity), *values))
    cells = [cell for line in lines for cell in line[2:] if isinstance(cell, Cell) and cell.small]
    notes = [_SPREAD_NOTE] if any(c.small.startswith("±") for c in cells) else []
    if ranges and any(c.small.startswith(_RANGE) for c in cells):
        notes.append(ranges.source)
    return table(caption, (*_LABELS, *heads), lines, notes=notes, divided=True)


def kind_cell(row: ComparisonRow, quantity: Quantity, ranges: PredictedRanges | None) -> Cell:
    """Return the kind of the computed figures of a row; of a predicted one with its range."""
    kind = row.computed_kind or "–"
    if ranges is None or kind != "predicted":
        return Cell(kind)
    text = "" if row.remark else ranges.text(row.quantity, row.axis, quantity.factor)
    return Cell("predicted, geometry fitted", small=text and f"{_RANGE} {text}")


def differences_table(
    comparison: Comparison, ranges: PredictedRanges | None = None
) -> Table | None:
    """Return the differences of each model here from each published origin.

    A figure that was fitted to the published one has none. None without any difference.
    """
    rows = [
        row
        for row in shared_rows(comparison.rows)
        if row.quantity not in MANUFACTURE and row.quantity != "input_displacement"
    ]  # the latter is an input of every model
    pairs = [(c, m) for c in comparison.published for m in comparison.models]
    compared = {c for c, m in pairs for row in rows if row.difference_percent(m, c) is not None}
    pairs = [pair for pair in pairs if pair[0] in compared]
    # the longest name may be broken, so that the table fits the page
    heads = [
        Column(
            m.replace("superelement", "super\u00adelement"),
            group=f"to {column_title(c)}",
            spare=m != comparison.best,
        )
        for c, m in pairs
    ]
    lines = []
    for row in rows:
        signed = [percent(row.difference_percent(m, c)).removesuffix(" %") for c, m in pairs]
        if any(signed):
            label = _label(row, replace(display(row.quantity), shown_unit=""))
            kind = kind_cell(row, display(row.quantity), ranges)
            lines.append((*label, kind, *signed))
    caption = (
        "Difference of each model here from each published origin [% of the published value]; to "
        "measured figures it is the error of a prediction. A figure that was fitted to the "
        "published one has no difference from it."
    )
    column = replace(_KIND, group="computed here")
    notes = [ranges.source] if ranges and any(line[2].small for line in lines) else []
    return table(caption, (*_LABELS, column, *heads), lines, notes=notes) if lines else None


def published_table(comparison: Comparison) -> Table | None:
    """Return the published values side by side, with the differences between their columns.

    None without published values.
    """
    if not comparison.published:
        return None
    pairs = [p for p in _PAIRS if set(p) <= set(comparison.published)]
    heads = [
        *_LABELS,
        *(column_title(c) for c in comparison.published),
        *(f"{column_title(a)} to {column_title(b)}" for a, b in pairs),
        Column("remark", "long words"),
    ]
    lines = []
    units = comparison.units
    for row in shared_rows(comparison.rows):
        if any(column in row.cells for column in comparison.published):
            quantity = units[row.quantity]
            cells = [
                *_label(row, quantity),
                *(_value(row, c, quantity) for c in comparison.published),
            ]
            cells += [percent(row.difference_percent(a, b)) for a, b in pairs]
            remarks = (row.cells[c].note for c in comparison.published if c in row.cells)
            lines.append((*cells, "; ".join(dict.fromkeys(filter(None, remarks)))))
    caption = (
        "Published values as printed, and the differences between their columns [% of the second "
        "one]. Analytic and FEM figures are predicted by the publication; input displacements are "
        "given."
    )
    return table(caption, heads, lines)


def hinge_table(stage: Stage, springs: "Iterable[HingeSpring]") -> Table:
    """Return the stiffness of every kind of hinge of a stage.

    Hinges with equal notches and roots share a row.
    """
    most_names = 12  # hinges that a row names
    numbers = {hinge.name: i for i, hinge in enumerate(stage.hinges, start=1)}
    groups = defaultdict(list)
    for spring in springs:
        roots = spring.root_widths
        rounded = roots and tuple(round(w, 9) for w in roots + spring.root_reaches)
        key = (spring.hinge.profile, spring.plane, rounded)
        groups[key].append(spring)
    lines = []
    for (profile, state, _), group in groups.items():
        k = group[0].stiffness
        names = [f"{s.hinge.name} ({numbers[s.hinge.name]})" for s in group]
        if len(names) > most_names:
            names[most_names - 1 :] = [f"and {len(names) - most_names + 1} more"]
        lines.append(
            (
                ", ".join(names),
                _profile_text(profile),
                number(profile.neck_thickness * 1e3, 3),
                number(k[0, 0] * 1e-6),
                number(k[1, 1] * 1e-6),
                number(k[2, 2]),
                f"{group[0].method}, plane {state}",
            )
        )
    heads = (
        Column("Hinges (number in the drawing)", "long words"), "<Profile", "Neck [mm]",
        "Axial [N/µm]", "Shear [N/µm]", "Rotation [N m/rad]", "<Method",
    )  # fmt: skip
    caption = (
        "Stiffness about the neck, lumped model. Hinges with equal notches and adjoining bodies "
        "share a row."
    )
    return table(caption, heads, lines)


def necks_table(recognised: "DrawnStage", caption: str = "") -> Table:
    """Return the necks of a drawing, with the certainty of each."""
    # a smaller deviation from the profile is 0 [m]
    exact = 0.5e-9
    rows = [
        (
            hinge.name,
            " – ".join(hinge.bodies),
            f"{hinge.at[0] * 1e3:.4g}, {hinge.at[1] * 1e3:.4g}",
            f"{hinge.profile.kind}{', one-sided' if hinge.profile.one_sided else ''}",
            Cell(f"{hinge.profile.neck_thickness * 1e3:.6g}"),
            Cell("0" if neck.off < exact else f"{neck.off * 1e6:.2g}"),
            Cell(f"{neck.ratio:.3g}"),
            neck.certainty,
        )
        for hinge, neck in zip(recognised.stage.hinges, recognised.necks, strict=True)
    ]
    headings = (
        *("neck", "~<bodies", "at, mm", "<profile", "thickness, mm"),
        *("deviation, um", "body/neck", "<certainty"),
    )
    return table(caption, headings, rows)


def _profile_text(profile: Profile) -> str:
    sizes = [
        f"{f.name.replace('_', ' ')} {getattr(profile, f.name) * 1e3:.4g} mm"
        for f in fields(profile)
        if f.name != "neck_thickness"
        and DIMENSIONS["length"] in getattr(f.type, "__metadata__", ())
    ]
    side = ", one-sided" if profile.one_sided else ""
    return f"{profile.kind}{side}" + "".join(f", {size}" for size in sizes)


def _label(row: ComparisonRow, quantity: Quantity) -> tuple[Cell, str]:
    return Cell(quantity.heading, small=row.remark), row.axis


def _value(
    row: ComparisonRow, column: str, quantity: Quantity, mark: Literal["", "ours", "variant"] = ""
) -> Cell:
    cell = row.cells.get(column)
    if cell is None:
        return Cell("–", mark=mark)
    return Cell(
        cell.text(quantity),
        value=cell.value * quantity.factor,
        note=cell.note,
        small=f"± {spread}" if (spread := cell.spread_text(quantity)) else "",
        mark=mark,
        failing=cell.failing,
        names={
            "quantity": row.quantity,
            "axis": row.axis,
            "column": column,
            "value": cell.value,
            "kind": kind_of(cell, row.cells.values()),
        },
    )


def rms_unit(budgets: "Sequence[PointBudget]") -> tuple[float, str]:
    """Return factor and unit that suit the rms of some budgets of one unit."""
    factor, prefix = prefixed(max(b.total for b in budgets), 1.0)
    return factor, f"{prefix}{budgets[0].unit}"


def tree_table(
    budgets: "Sequence[PointBudget]",
) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    """Return unit, heads and rows of the trees of errors at a point, with the origin of each error.

    Each loop has a column of standard uncertainties; shares of the variance are those of the last.
    """
    factor, unit = (1e6, "um") if budgets[0].unit == "m" else (math.degrees(3600.0), "arcsec")
    trees = [b.tree for b in budgets if b.tree is not None]
    errors = [{line.name: line for line in tree.lines} for tree in trees]
    rows: list[tuple[str, ...]] = []
    for name in dict.fromkeys(name for lines in errors for name in lines):
        of_loops = [lines.get(name) for lines in errors]
        origin = [line.source for line in of_loops if line is not None][-1]
        sizes = ["" if x is None else number(factor * x.uncertainty, 3) for x in of_loops]
        last = of_loops[-1]
        rows.append((name, origin, *sizes, "" if last is None else f"{100.0 * last.share:.1f}"))
    total = [factor * tree.uncertainty for tree in trees]
    rows.append(("combined", "", *(number(u, 3) for u in total), "100"))
    rows.append(("expanded, k = 2", "", *(number(2.0 * u, 3) for u in total), ""))
    return unit, ("<error", "<origin", *(b.loop for b in budgets), "variance, %"), rows


def loops_table(
    result: "DynamicBudget", point: str
) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    """Return unit, heads and rows of the rms by source at a point, with a column for each loop."""
    budgets = [b for b in result.budgets if b.point == point]
    peaks = ["1" if b.margins is None else number(b.margins.sensitivity_peak, 3) for b in budgets]
    rows = rms_rows(budgets, result.exposure, result.duration)
    rows.append(("largest sensitivity", "1", *peaks))
    return rms_unit(budgets)[1], ("<source", "<acts", *(b.loop for b in budgets)), rows


def rms_rows(
    budgets: "Sequence[PointBudget]", exposure: float | None = None, duration: float | None = None
) -> list[tuple[str, ...]]:
    """Return the rms by source, a column for each budget, and that of all sources.

    With an exposure [s] its moving average and moving standard deviation follow; with a duration
    [s] the largest expected value, and the standard deviation of the rms of a record.
    """
    factor, _ = rms_unit(budgets)

    def row(name: str, values: Iterable[float], kind: str = "") -> tuple[str, ...]:
        return (name, kind, *(number(factor * value, 3) for value in values))

    rows = [
        row(source.name, (b.rms(b.sources[k]) for b in budgets), source.kind)
        for k, source in enumerate(budgets[0].sources)
    ]
    rows.append(row("total", (b.total for b in budgets)))
    if exposure is not None:
        averages, deviations = zip(*(b.exposed(exposure) for b in budgets), strict=True)
        rows.append(row(f"average over {1e3 * exposure:g} ms", averages))
        rows.append(row(f"deviation in {1e3 * exposure:g} ms", deviations))
    if duration is not None:
        rows.append(row(f"largest in {duration:g} s", (b.peak(duration) for b in budgets)))
        scatter = (b.total * b.spread(duration) for b in budgets)
        rows.append(row(f"scatter of rms in {duration:g} s", scatter))
    return rows
