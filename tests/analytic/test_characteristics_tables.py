"""Tables of characteristics, read back by other libraries: every number, unit and word."""

import csv
import io
import math
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from flexstage.characteristic import ORIGINS, Characteristic
from flexstage.designs import design
from flexstage.errors import ModelError
from flexstage.export.tables.files import table_files
from flexstage.export.tables.latex import escaped
from flexstage.lumped import lumped_system
from flexstage.quantities import QUANTITIES, Quantity, beside, display
from flexstage.studies import compare
from flexstage.system import analyse

openpyxl = pytest.importorskip("openpyxl")

STAGE = design("vgtu-piezo")
NASTY = '=SUM(A1:A9), "quoted" & 50 % of $x_1$ {~^\\#}\nsecond line, µ'


def row(quantity: str, axis: str, origin: str, value: float, unit: str, **more: Any) -> Any:
    return Characteristic(
        quantity=quantity, axis=axis, origin=origin, value=value, unit=unit, **more
    )


ROWS = (
    row("output_displacement", "x", "published-fem", 64.6e-6, "m", note="printed"),
    row("output_displacement", "x", "lumped", 1.0 / 3.0 * 2e-4, "m", note=NASTY),
    row(
        "output_displacement", "x", "measured", 63.1234567e-6, "m", uncertainty=0.0671e-6,
        degrees_of_freedom=7.5,
    ),
    row("natural_frequency_hz", "y", "measured", 338.9104, "Hz", uncertainty=0.243),
    row("natural_frequency_hz", "y", "solid", 341.0, "Hz"),
    row("cross_coupling", "x", "lumped", -2.8e-15, "1"),
    row("safety_factor", "x", "lumped", math.inf, "1"),
    row("input_stiffness", "x", "lumped", 5520153.068222156, "N/m", note="drives removed"),
    row("input_stiffness", "x", "lumped", 6520153.0, "N/m", note="drives in place"),
)  # fmt: skip


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    return table_files(ROWS, name="my stage", title="A stage & more", notes=("a", "b_1", "a"))


def test_csv_gives_back_every_value_to_the_bit(files: dict[str, bytes]) -> None:
    text = files["my-stage-values.csv"].decode()
    lines = list(csv.DictReader(io.StringIO(text, newline="")))
    assert len(lines) == len(ROWS)
    for line, c in zip(lines, ROWS, strict=True):
        assert float(line["value"]) == c.value
        known = line["uncertainty"], line["degrees_of_freedom"]
        assert tuple(float(w) if w else None for w in known) == (
            c.uncertainty,
            c.degrees_of_freedom,
        )
        words = [line[k] for k in ("quantity", "axis", "origin", "unit", "note")]
        assert words == [c.quantity, c.axis, c.origin, c.unit, c.note]


def test_csv_is_as_rfc_4180_has_it(files: dict[str, bytes]) -> None:
    for name in ("my-stage-values.csv", "my-stage-comparison.csv"):
        text = files[name].decode()
        assert text.endswith("\r\n")
        # outside quotes lines end with both characters, and there are no bare ones
        plain = re.sub(r'"(?:[^"]|"")*"', "quoted", text)
        assert plain.count("\r") == plain.count("\n") == plain.count("\r\n")
        assert '"' not in plain
        (width,) = {line.count(",") for line in plain.strip().split("\r\n")}
        assert width == text.split("\r\n", 1)[0].count(",")


def test_comparison_has_a_column_for_each_origin(files: dict[str, bytes]) -> None:
    lines = list(csv.DictReader(io.StringIO(files["my-stage-comparison.csv"].decode())))
    head = list(lines[0])
    assert head[4:] == [
        "published-fem", "lumped", "solid", "measured", "measured uncertainty",
    ]  # fmt: skip
    first = lines[0]
    assert (first["quantity"], first["unit"]) == ("output_displacement", "m")
    assert [float(first[o]) for o in head[4:6]] == [64.6e-6, 1.0 / 3.0 * 2e-4]
    assert first["solid"] == ""
    assert float(first["measured uncertainty"]) == 0.0671e-6
    # two values of one origin stand below each other, told apart by their notes
    stiff = [line for line in lines if line["quantity"] == "input_stiffness"]
    assert [line["condition"] for line in stiff] == ["drives removed", "drives in place"]


def test_columns_and_rows_are_those_of_the_report() -> None:
    """The report's own comparison, in another room, of a stage with published figures."""
    analysis = analyse(STAGE, lumped_system(STAGE))
    rows = (*STAGE.published, *analysis.characteristics)
    theirs = compare(rows)
    files = table_files(rows, name=STAGE.name, display=display)
    lines = list(csv.DictReader(io.StringIO(files["vgtu-piezo-comparison.csv"].decode())))
    assert len(lines) == len(theirs.rows)
    for line, expected in zip(lines, theirs.rows, strict=True):
        assert (line["quantity"], line["axis"]) == (expected.quantity, expected.axis)
        found = {o: float(line[o]) for o in ORIGINS if line.get(o)}
        assert found == {o: c.value for o, c in expected.cells.items()}
    book = openpyxl.load_workbook(io.BytesIO(files["vgtu-piezo-tables.xlsx"]))
    sheet = book["Figures"]
    head = [c.value for c in sheet[3]]
    column = head.index("rigid bodies against published, FEM [%]")
    for cells, expected in zip(sheet.iter_rows(min_row=4), theirs.rows, strict=True):
        difference = expected.difference_percent("lumped", "published-fem")
        assert cells[0].value == display(expected.quantity).label
        value = cells[column].value
        assert value is None if difference is None else value == pytest.approx(difference)


def test_excel_holds_numbers_and_text_and_never_a_formula(files: dict[str, bytes]) -> None:
    book = openpyxl.load_workbook(io.BytesIO(files["my-stage-tables.xlsx"]))
    assert book.sheetnames == ["Figures", "Values", "Provenance"]
    values = book["Values"]
    assert values.freeze_panes == "A2"
    assert values.auto_filter.ref == f"A1:H{len(ROWS) + 1}"
    head = [c.value for c in values[1]]
    assert head[3:6] == ["value", "unit", "uncertainty"]
    for cells, c in zip(values.iter_rows(min_row=2), ROWS, strict=True):
        found = [cell.value for cell in cells]
        if math.isfinite(c.value):
            # the file has 16 digits
            assert found[3] == pytest.approx(c.value, rel=2e-16)
            assert cells[3].data_type == "n"
        else:
            assert (found[3], cells[3].data_type) == ("inf", "s")
        assert found[4] == c.unit
        assert found[5] == c.uncertainty
        assert (found[7] or "") == c.note
    for sheet in book:
        for cells in sheet.iter_rows():
            assert all(cell.data_type in ("n", "s") for cell in cells)
            assert all(cell.hyperlink is None for cell in cells)


def test_excel_shows_figures_as_people_read_them(files: dict[str, bytes]) -> None:
    sheet = openpyxl.load_workbook(io.BytesIO(files["my-stage-tables.xlsx"]))["Figures"]
    assert sheet["A1"].value == "A stage & more"
    assert sheet.freeze_panes == "C4"
    head = {c.value: i for i, c in enumerate(sheet[3])}
    first = sheet[4]
    assert [first[i].value for i in range(3)] == ["Output displacement", "x", "µm"]
    measured, spread = first[head["measured"]], first[head["± measured (standard)"]]
    assert measured.value == pytest.approx(63.1234567, rel=1e-14)
    assert measured.number_format == "0.00"  # four digits
    assert (spread.value, spread.number_format) == (pytest.approx(0.0671), "0.000")
    assert first[head["rigid bodies"]].comment.text == NASTY
    more = first[head["measured against published, FEM [%]"]]
    assert more.value == pytest.approx(100.0 * (63.1234567 / 64.6 - 1.0), rel=1e-12)
    told = openpyxl.load_workbook(io.BytesIO(files["my-stage-tables.xlsx"]))["Provenance"]
    texts = [c.value for c in told["B"] if c.value]
    assert texts[0] == "my stage"
    assert texts[-2:] == ["a", "b_1"]


def test_titles_of_the_workbook_are_read_whole(files: dict[str, bytes]) -> None:
    """The row is as high as the longest title needs: no program but Excel does that by itself."""
    sheet = openpyxl.load_workbook(io.BytesIO(files["my-stage-tables.xlsx"]))["Figures"]
    titles = [str(c.value) for c in sheet[3][4:] if c.value]
    width = sheet.column_dimensions["E"].width
    lines = max(-(-len(t) // width) for t in titles)
    assert lines > 1
    assert sheet.row_dimensions[3].height >= 15.0 * lines


def cells_of(tex: str) -> list[list[str]]:
    """Cells of each row of the table."""
    # the head that later pages repeat stands first in the file
    body = tex.split(r"\endfirsthead", 1)[1].split(r"\end{longtable}", maxsplit=1)[0]
    rows = [line.strip() for line in body.split("\n") if line.strip().endswith(r"\\")]
    return [re.split(r"(?<!\\) ?& ?", line.removesuffix(r"\\")) for line in rows]


def test_latex_is_a_table_of_equal_rows_and_known_words(files: dict[str, bytes]) -> None:
    tex = files["my-stage-table.tex"].decode()
    plain = "\n".join(line for line in tex.split("\n") if not line.startswith("%"))
    assert plain.isascii()
    bare = re.sub(r"\\[{}\\]", "", plain)
    assert bare.count("{") == bare.count("}")
    assert len(re.findall(r"(?<!\\)\$", plain)) % 2 == 0
    words = set(re.findall(r"\\([A-Za-z]+)", plain))
    assert words <= {
        "addlinespace", "approx", "arraybackslash", "begin", "bottomrule", "caption", "cmidrule",
        "dimexpr", "end", "endfirsthead", "endhead", "endlastfoot", "footnotesize", "infty",
        "label", "linewidth", "midrule", "mu", "multicolumn", "pm", "raggedleft", "raggedright",
        "relax", "setlength", "tabcolsep", "times", "toprule",
        "textasciicircum", "textasciitilde", "textbackslash", "textquotedbl", "textsuperscript",
    }  # fmt: skip
    assert re.findall(r"\\(?:begin|end)\{(\w+)\}", plain) == ["longtable", "longtable"]
    columns = 2 + int(re.findall(r"l\*\{(\d)\}", plain)[0])
    above, head, *rows = cells_of(plain)
    assert above[2].strip() == r"\multicolumn{1}{c}{published}"
    assert columns == len(head) == 2 + 4
    assert all(len(cells) == columns for cells in rows)
    assert len(above) == columns  # one published column is spanned
    table = {(c[0].strip() or "", c[1].strip()): [w.strip() for w in c[2:]] for c in rows}
    moved = table[r"Output displacement [$\mu$m]", "x"]
    assert moved == ["64.6", "66.67", "--", r"63.123 $\pm$ 0.067"]
    assert table["Safety factor (yield)", "x"][1] == r"$\infty$"
    assert table[r"Cross-coupling [\%]", "x"][1] == r"$\approx 0$"
    assert r"Characteristics of A stage \& more." in plain


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="LaTeX is not installed here")
@pytest.mark.parametrize("paper", ["{article}", "[twoside,a4paper]{report}"])
def test_latex_fits_its_page(files: dict[str, bytes], tmp_path: Path, paper: str) -> None:
    """LaTeX finds no line that is too long, and no table too high, between other text."""
    (tmp_path / "table.tex").write_bytes(files["my-stage-table.tex"])
    (tmp_path / "paper.tex").write_text(
        rf"\documentclass{paper}\usepackage{{array,booktabs,longtable}}"
        r"\begin{document}Before.\input{table}After.\end{document}"
    )
    for _ in range(2):  # widths are known in the second run
        done = subprocess.run(
            ["pdflatex", "-interaction=nonstopmode", "paper.tex"], cwd=tmp_path,
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert not re.search(r"Overfull|too large|^!", done.stdout, re.MULTILINE), done.stdout


def test_text_for_latex_is_printed_as_it_is() -> None:
    assert escaped("50 % of $x_1$ {~^\\#} & µ²") == (
        r"50 \% of \$x\_1\$ \{\textasciitilde{}\textasciicircum{}\textbackslash{}\#\} \& "
        r"$\mu$\textsuperscript{2}"
    )
    assert escaped("a\nb") == "a b"


def test_value_and_uncertainty_share_their_decimals() -> None:
    assert beside(338.9104, 0.243) == ("338.91", "0.24")
    assert beside(63.1234, 0.0996) == ("63.12", "0.10")
    assert beside(-729.23, 2814.0) == ("-729", "2814")
    assert beside(1.25, math.inf) == ("1.250", "inf")


def test_same_figures_give_the_same_bytes_and_the_callers_units_are_taken() -> None:
    def mine(name: str) -> Quantity:
        return Quantity(name, "m", name.upper(), "nm", 1e9, zero=1e-7)

    rows = (
        row("resolution", "x", "measured", 2e-8, "m"),
        row("reversal", "x", "lumped", 2e-7, "m"),
        row("noise", "x", "lumped", -8.4e-3, "m"),
    )
    first = table_files(rows, name="s", display=mine)
    assert first == table_files(rows, name="s", display=mine)
    sheet = openpyxl.load_workbook(io.BytesIO(first["s-tables.xlsx"]))["Figures"]
    assert [c.value for c in sheet[4]][:3] == ["RESOLUTION", "x", "nm"]
    found = [[c.value for c in line[4:6]] for line in (sheet[4], sheet[5])]
    assert found == [[None, "≈ 0"], [200.0, None]]
    assert r"$\approx 0$" in first["s-table.tex"].decode()
    assert r"$-8.400 \times 10^{6}$" in first["s-table.tex"].decode()


def test_every_quantity_has_a_label_and_a_unit_that_people_use() -> None:
    for quantity in QUANTITIES.values():
        assert quantity.factor > 0.0
        assert quantity.label[0].isupper()
        # what has a unit is shown in one
        assert quantity.shown_unit or quantity.unit == "1"
    assert (display("max_stress").shown_unit, display("max_stress").factor) == ("MPa", 1e-6)
    assert (display("thermal_drift").shown_unit, display("thermal_drift").factor) == ("nm/K", 1e9)


def test_nothing_to_write_is_refused() -> None:
    with pytest.raises(ModelError, match="no characteristics of 's'"):
        table_files((), name="s")
