"""Tables of characteristics in every format at once; those with commas between are written here."""

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields

import flexstage
from flexstage.characteristic import Characteristic
from flexstage.comparison import Comparison, compare
from flexstage.errors import ModelError, StageError
from flexstage.export.request import ExportRequest
from flexstage.export.tables.latex import latex
from flexstage.export.tables.workbook import workbook
from flexstage.files.names import file_name
from flexstage.provenance import Provenance
from flexstage.quantities import QUANTITIES, Quantity, display


def table_files(
    characteristics: Iterable[Characteristic],
    *,
    name: str,
    title: str = "",
    display: Callable[[str], Quantity] = display,
    provenance: Provenance | Sequence[Provenance] = (),
    notes: Sequence[str] = (),
) -> dict[str, bytes]:
    """Return characteristics as tables for spreadsheets, scripts and papers.

    ``NAME-values.csv``: one line for each value, SI, all digits, with unit, standard uncertainty,
    origin and note. ``NAME-comparison.csv``: the same with a column for each origin.
    ``NAME-tables.xlsx``: both, in the units that people use and in SI, and a sheet of provenance.
    ``NAME-table.tex``: side by side, four digits, for ``booktabs``.

    Rows are of any origin: what was published of a stage, what models say, what was measured.
    `display` says how a quantity is shown in Excel and LaTeX (name, unit and factor); as in
    `flexstage.quantities.QUANTITIES` where not given. Notes say where values stop being
    valid.

    Notes
    -----
    Validity: CSV holds notes as they are: a spreadsheet that opens it may take one that begins with
    ``=`` for a formula, which the workbook never does. Excel cannot hold infinity, which is text
    there.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> stage = design("vgtu-piezo")
    >>> files = table_files(stage.published, name=stage.name)
    >>> print(files["vgtu-piezo-values.csv"].decode().splitlines()[7])
    natural_frequency_hz,x,published-analytic,339.0,Hz,,,
    """
    rows = tuple(characteristics)
    if not rows:
        raise ModelError(f"there are no characteristics of '{name}' to write: give one at least")
    told = title or name
    sources = (provenance,) if isinstance(provenance, Provenance) else tuple(provenance)
    about = {"stage": name, "written by": f"flexstage {flexstage.__version__}"}
    for k, source in enumerate(sources, start=1):
        mark = f" {k}" if len(sources) > 1 else ""
        about[f"computed by{mark}"] = f"flexstage {source.version}, Python {source.python}"
        about[f"on{mark}"] = f"{source.created}, {source.machine}"
        about[f"from the description{mark}"] = source.input_hash
        about |= {f"{key}{mark}": value for key, value in source.settings.items()}
    table, plain = compare(rows), file_name(name)
    notes = tuple(dict.fromkeys(notes))
    return {
        f"{plain}-values.csv": _values_csv(rows),
        f"{plain}-comparison.csv": _comparison_csv(table),
        f"{plain}-tables.xlsx": workbook(told, rows, table, display, about, notes),
        f"{plain}-table.tex": latex(name, told, table, display, about, notes),
    }


def _values_csv(characteristics: Iterable[Characteristic]) -> bytes:
    """Write one line for each value, with all the digits that give back the same bits."""
    names = [f.name for f in fields(Characteristic)]
    return _csv(names, ([getattr(c, n) for n in names] for c in characteristics))


def _comparison_csv(table: Comparison) -> bytes:
    """Write one line for each quantity and axis, with a column of values for each origin.

    An origin of which an uncertainty is known has a column for it as well.
    """
    head = ["quantity", "axis", "unit", "condition"]
    for origin in table.columns:
        head += [origin, f"{origin} uncertainty"] if origin in table.uncertain else [origin]
    lines = []
    for row in table.rows:
        line: list[object] = [row.quantity, row.axis, QUANTITIES[row.quantity].unit, row.remark]
        for origin in table.columns:
            cell = row.cells.get(origin)
            line.append(None if cell is None else cell.value)
            if origin in table.uncertain:
                line.append(None if cell is None else cell.uncertainty)
        lines.append(line)
    return _csv(head, lines)


def _csv(head: list[str], lines: Iterable[list[object]]) -> bytes:
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\r\n")
    rows.writerow(head)
    for line in lines:
        # repr gives back the same bits
        rows.writerow(
            ["" if v is None else repr(float(v)) if isinstance(v, float) else v for v in line]
        )
    return text.getvalue().encode()


def export_csv(request: ExportRequest) -> dict[str, bytes]:
    """Write the tables for scripts."""
    return _of_request(request, ".csv")


def export_excel(request: ExportRequest) -> dict[str, bytes]:
    """Write the workbook."""
    return _of_request(request, ".xlsx")


def export_latex(request: ExportRequest) -> dict[str, bytes]:
    """Write the table for papers."""
    return _of_request(request, ".tex")


def _of_request(request: ExportRequest, suffix: str) -> dict[str, bytes]:
    figures = (*request.stage.published, *request.analysis.characteristics)
    if not figures:
        raise StageError(
            f"stage '{request.stage.name}' has no axis and so no characteristics: name a drive "
            "and a probe under 'axes' in the stage file"
        )
    files = table_files(
        figures,
        name=request.name,
        title=request.stage.title,
        provenance=request.analysis.provenance,
        notes=request.analysis.validity,
    )
    return {name: content for name, content in files.items() if name.endswith(suffix)}
