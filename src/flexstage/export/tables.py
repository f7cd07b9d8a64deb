"""Tables of characteristics, for spreadsheets and scripts."""

from collections.abc import Iterable

from flexstage.base.errors import ModelError, StageError
from flexstage.export.request import StageExport
from flexstage.files.names import file_name
from flexstage.files.plain import csv_text
from flexstage.quantities.characteristic import Characteristic, Characteristics
from flexstage.quantities.comparison import compare


def table_files(characteristics: Iterable[Characteristic], *, name: str) -> dict[str, bytes]:
    """Return characteristics as CSV tables, for spreadsheets and scripts.

    ``NAME-values.csv``: one line for each value in SI units, with all digits, unit, standard
    uncertainty, origin and note. ``NAME-comparison.csv``: a column for each origin.

    Rows may be published, modelled or measured.

    Notes
    -----
    Validity: notes are not changed; a spreadsheet may read one that begins with ``=`` as a
    formula.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> stage = design("vgtu-piezo")
    >>> files = table_files(stage.published, name=stage.name)
    >>> print(files["vgtu-piezo-values.csv"].decode().splitlines()[7])
    natural_frequency_hz,x,published-analytic,339.0,Hz,,,
    """
    rows = Characteristics(characteristics)
    if not rows:
        raise ModelError(f"there are no characteristics of '{name}' to write: give one at least")
    plain = file_name(name)
    return {
        f"{plain}-values.csv": _csv(rows.columns()),
        f"{plain}-comparison.csv": _csv(compare(rows).si_columns()),
    }


def _csv(columns: dict[str, list[object]]) -> bytes:
    """Return columns as CSV with the digits that restore the same bits."""
    rows = (
        ["" if v is None else repr(float(v)) if isinstance(v, float) else v for v in line]
        for line in zip(*columns.values(), strict=True)
    )
    return csv_text([columns, *rows], "\r\n").encode()


def export(stage_export: StageExport) -> dict[str, bytes]:
    """Return the files of the format, with published values."""
    figures = (*stage_export.stage.published, *stage_export.analysis.characteristics)
    if not figures:
        raise StageError(
            f"stage '{stage_export.stage.name}' has no axis and so no characteristics: name a "
            "drive and a probe under 'axes' in the stage file"
        )
    return table_files(figures, name=stage_export.name)
