"""Computations of the view Design; some run in a worker process."""

import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from flexstage.base.errors import FlexstageError, StageError
from flexstage.files.write import write_whole
from flexstage.quantities.characteristic import WHOLE_STAGE, Characteristic
from flexstage.quantities.comparison import compare, difference_percent, title_of
from flexstage.quantities.table import Cell, Table, table
from flexstage.report.figures.drawn_stage import draw_checked
from flexstage.report.tables import percent
from flexstage.stage import Issue
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.family import Family
from flexstage.studies.explore.figures import DEFAULT_QUANTITIES, Figure
from flexstage.studies.explore.sensitivity import Sensitivities, sensitivities
from flexstage.studies.explore.variables import every_variable
from flexstage.studies.models import analyse_model, stage_export
from flexstage.web.design.state import SHARE, Variant
from flexstage.web.pictures import inline
from flexstage.web.sessions import Preferences

if TYPE_CHECKING:
    from flexstage.stage.drawing.drawn_stage import DrawingOptions, DrawnStage

#: Figures of the table, of every axis and of the whole stage.
TABLE_FIGURES = (
    *DEFAULT_QUANTITIES, "natural_frequency_with_stack_hz", "safety_factor", "resolution",
    "parasitic_rotation", "mass", "smallest_neck",
)  # fmt: skip
#: Figures next to the sliders, with the headings of their columns.
SLIDER_FIGURES = {
    "transmission_ratio": "ratio",
    "output_displacement": "stroke",
    "rotation_stroke": "stroke",
    "max_stress": "stress",
    "natural_frequency_hz": "freq.",
}


def characteristics_of(variant: Variant, model: str) -> tuple[Characteristic, ...]:
    """Return the characteristics of a variant by a model."""
    return tuple(analyse_model(variant.stage(), model).characteristics)


def slopes_of(variant: Variant, rows: Sequence[Characteristic]) -> Sensitivities:
    """Return the sensitivities of the figures next to the sliders, by the lumped model."""
    values = dict(variant.values)
    variables = tuple(
        replace(v, usual=values.get(v.name, v.usual))
        for v in every_variable(variant.template, SHARE)
    )
    figures = [
        Figure(quantity=row.quantity, axis=row.axis)
        for row in rows
        if row.quantity in SLIDER_FIGURES
    ]
    return sensitivities(Family(template=variant.template, variables=variables), figures)


@dataclass(frozen=True, slots=True)
class CheckedDrawing:
    """A drawing of a variant, and its issues."""

    svg: str
    """The drawing, for a page."""
    issues: tuple[Issue, ...]
    """The issues, errors first."""


def draw_with_issues(variant: Variant, key: str) -> CheckedDrawing:
    """Return the drawing of a variant with its issues; ids in it begin with `key`."""
    from flexstage.stage import check

    stage = variant.stage()
    issues = check(stage)
    svg = inline(lambda: draw_checked(stage, issues), key, f"Drawing of {stage.name}")
    return CheckedDrawing(svg, issues)


def figures_table(
    preferences: Preferences,
    lumped: Sequence[Characteristic],
    corrected: Sequence[Characteristic] | None,
    pinned: Sequence[Characteristic] | None,
) -> Table:
    """Return the figures by both models side by side, with those of the pinned variant."""
    sets = {"lumped": lumped, "superelement": corrected or (), "pinned": pinned or ()}
    by_model = {name: {(r.quantity, r.axis): r for r in rows} for name, rows in sets.items()}
    headings = ["figure", "<axis", title_of("lumped"), title_of("superelement")]
    headings += ["pinned", "change"] if pinned is not None else []
    rows = []
    for row in compare(lumped).rows:
        if row.quantity not in TABLE_FIGURES and not any(c.failing for c in row.cells.values()):
            continue
        key = (row.quantity, row.axis)
        quantity = preferences.displayed(row.quantity)
        values = [
            Cell("…" if name == "superelement" and corrected is None else "–")
            if (characteristic := by_model[name].get(key)) is None
            else Cell(
                characteristic.text(quantity),
                characteristic.value,
                characteristic.note,
                failing=characteristic.failing,
            )
            for name in by_model
        ]
        cells = [quantity.heading, "" if row.axis == WHOLE_STAGE else row.axis, *values[:2]]
        if pinned is not None:
            reference = by_model["pinned"].get(key)
            change = difference_percent(row.value("lumped"), reference.value if reference else None)
            cells += [values[2], percent(change) or "–"]
        rows.append(cells)
    return table("", headings, rows)


def stage_file(variant: Variant, name: str) -> str:
    """Return the stage file of a variant under another name."""
    return variant.template.text(dict(variant.values), name)


def export_to_folder(
    folder: Path, variant: Variant, formats: Sequence[str]
) -> tuple[Path, tuple[str, ...]]:
    """Write a variant in several formats into a folder; return the file and remarks.

    The file remains there if the page was closed.
    """
    name, content, remarks = export_variant(variant, formats)
    write_whole(folder / name, content)
    return folder / name, remarks


def export_variant(variant: Variant, formats: Sequence[str]) -> tuple[str, bytes, tuple[str, ...]]:
    """Export a variant in several formats; return the name of a file, its content, and remarks.

    Several files form an archive (ZIP).
    """
    from flexstage.export.request import ExportRequest, in_folders

    export = stage_export(variant.stage(), ExportRequest(to=tuple(formats)))
    files = in_folders(export.files(skip_unsuitable=len(formats) > 1))
    if len(files) == 1:
        ((name, content),) = files.items()
        return Path(name).name, content, export.notes
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for file, content in files.items():
            archive.writestr(zipfile.ZipInfo(file), content, zipfile.ZIP_DEFLATED)
    return f"{export.name}.zip", buffer.getvalue(), export.notes


def recognise_drawing(
    path: str, options: "DrawingOptions", key: str
) -> tuple["DrawnStage", str, str]:
    """Recognise the stage in a drawing; return it, its picture for a page, and its stage file."""
    from flexstage.report.figures.drawn_stage import draw_recognised
    from flexstage.stage.drawing.drawn_stage import read_drawing, stage_file_text

    recognised = read_drawing(path, options)
    picture = inline(
        lambda: draw_recognised(recognised), key, f"Bodies and necks found in {Path(path).name}"
    )
    return recognised, picture, stage_file_text(recognised)


def template_of(source: str | Path) -> StageTemplate:
    """Return the template of a design or stage file that the lumped model can analyse."""
    template = StageTemplate.of(source)
    try:
        analyse_model(template.stage(), "lumped")
    except FlexstageError as error:
        raise StageError(f"{Path(template.source).name}: {error}") from error
    return template
