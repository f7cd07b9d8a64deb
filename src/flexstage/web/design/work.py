"""What the view Design has computed: by the library, some of it in a process of its own."""

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
from flexstage.web.preferences import Preferences

if TYPE_CHECKING:
    from flexstage.stage.drawing.drawn_stage import DrawingOptions, DrawnStage

#: What is shown of every axis and of the whole, as far as a stage has it.
SHOWN = (
    *DEFAULT_QUANTITIES, "natural_frequency_with_stack_hz", "safety_factor", "resolution",
    "parasitic_rotation", "mass", "smallest_neck",
)  # fmt: skip
#: The figures beside the sliders, and what the columns are called.
BESIDE = {
    "transmission_ratio": "ratio",
    "output_displacement": "stroke",
    "rotation_stroke": "stroke",
    "max_stress": "stress",
    "natural_frequency_hz": "freq.",
}


def rows_of(variant: Variant, model: str) -> tuple[Characteristic, ...]:
    """Return the characteristics of a variant by a model."""
    return tuple(analyse_model(variant.stage(), model).characteristics)


def slopes_of(variant: Variant, rows: Sequence[Characteristic]) -> Sensitivities:
    """Return what each parameter does to the figures beside the sliders, by the lumped model."""
    values = dict(variant.values)
    variables = tuple(
        replace(v, usual=values.get(v.name, v.usual))
        for v in every_variable(variant.template, SHARE)
    )
    figures = [
        Figure(quantity=row.quantity, axis=row.axis) for row in rows if row.quantity in BESIDE
    ]
    return sensitivities(Family(template=variant.template, variables=variables), figures)


@dataclass(frozen=True, slots=True)
class Checked:
    """A drawing of a variant, and what is wrong with it."""

    svg: str
    """The drawing, for a page."""
    issues: tuple[Issue, ...]
    """What is wrong, errors first."""


def checked(variant: Variant, key: str) -> Checked:
    """Return the drawing of a variant with what is wrong; `key` makes its ids its own in a page."""
    from flexstage.stage import check

    stage = variant.stage()
    issues = check(stage)
    svg = inline(lambda: draw_checked(stage, issues), key, f"Drawing of {stage.name}")
    return Checked(svg, issues)


def figures_table(
    preferences: Preferences,
    lumped: Sequence[Characteristic],
    corrected: Sequence[Characteristic] | None,
    kept: Sequence[Characteristic] | None,
) -> Table:
    """Set the figures by both models side by side, beside those of the variant that was kept."""
    sets = {"lumped": lumped, "superelement": corrected or (), "kept": kept or ()}
    known = {name: {(r.quantity, r.axis): r for r in rows} for name, rows in sets.items()}
    headings = ["figure", "<axis", title_of("lumped"), title_of("superelement")]
    headings += ["kept", "to kept"] if kept is not None else []
    rows = []
    for row in compare(lumped).rows:
        if row.quantity not in SHOWN and not any(c.failing for c in row.cells.values()):
            continue
        key = (row.quantity, row.axis)
        shown = preferences.shown(row.quantity)
        texts = [
            Cell("…" if name == "superelement" and corrected is None else "–")
            if (found := known[name].get(key)) is None
            else Cell(found.text(shown), found.value, found.note, failing=found.failing)
            for name in known
        ]
        cells = [shown.heading, "" if row.axis == WHOLE_STAGE else row.axis, *texts[:2]]
        if kept is not None:
            other = known["kept"].get(key)
            change = difference_percent(row.value("lumped"), other.value if other else None)
            cells += [texts[2], percent(change) or "–"]
        rows.append(cells)
    return table("", headings, rows)


def stage_file(variant: Variant, name: str) -> str:
    """Return the stage file of a variant under another name."""
    return variant.template.text(dict(variant.values), name)


def exported_into(
    folder: Path, variant: Variant, formats: Sequence[str]
) -> tuple[Path, tuple[str, ...]]:
    """Write a variant in some formats into a folder; return the file and remarks.

    It is kept there whether or not the page that asked for it is still open.
    """
    name, content, remarks = exported(variant, formats)
    write_whole(folder / name, content)
    return folder / name, remarks


def exported(variant: Variant, formats: Sequence[str]) -> tuple[str, bytes, tuple[str, ...]]:
    """Write a variant in some formats; return the name of a file, its content, and remarks.

    Several files are one archive (ZIP).
    """
    from flexstage.export.request import ExportRequest, in_folders

    given = stage_export(variant.stage(), ExportRequest(to=tuple(formats)))
    files = in_folders(given.files(leave_out=len(formats) > 1))
    if len(files) == 1:
        ((only, content),) = files.items()
        return Path(only).name, content, given.notes
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for file, content in files.items():
            archive.writestr(zipfile.ZipInfo(file), content, zipfile.ZIP_DEFLATED)
    return f"{given.name}.zip", packed.getvalue(), given.notes


def drawing_found(path: str, options: "DrawingOptions", key: str) -> tuple["DrawnStage", str, str]:
    """Find the stage in a drawing; return it, its picture for a page, and its stage file."""
    from flexstage.report.figures.drawn_stage import draw_found
    from flexstage.stage.drawing.drawn_stage import read_drawing, stage_file_text

    drawn = read_drawing(path, options)
    picture = inline(lambda: draw_found(drawn), key, f"What was found in {Path(path).name}")
    return drawn, picture, stage_file_text(drawn)


def template_of(source: str | Path) -> StageTemplate:
    """Return a design or a stage file as one to vary; what no model can take is refused."""
    template = StageTemplate.of(source)
    try:
        analyse_model(template.stage(), "lumped")
    except FlexstageError as error:
        raise StageError(f"{Path(template.source).name}: {error}") from error
    return template
