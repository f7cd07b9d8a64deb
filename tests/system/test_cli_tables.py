"""What is printed for people: tables at 80 columns in whole numbers, equal findings once."""

import io
import json
import math
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from rich.cells import cell_len
from rich.console import Console

from flexstage.cli import app, main, tables
from flexstage.cli.output import console, display_table, print_text
from flexstage.quantities.characteristic import Characteristic, shown_units
from flexstage.quantities.comparison import compare
from flexstage.quantities.quantity import display, value_and_uncertainty
from flexstage.quantities.table import Cell, Column, Table, table
from flexstage.report.page import table_html
from flexstage.report.run import runs_table
from flexstage.report.tables import characteristics_table
from flexstage.studies.results import characteristic_row

EXAMPLE = Path(__file__).parents[1] / "spelled_out_parallelogram.yaml"


def test_a_name_is_beside_the_first_line_of_its_text() -> None:
    row = ("Thermal drift", "2.75", "drives in place, and a text that has to be broken")
    shown = table("drift", ("quantity", "published\nFEM", "<condition"), [row])
    written = io.StringIO()
    display_table(Console(width=48, file=written), shown)
    lines = written.getvalue().splitlines()
    first = next(line for line in lines if "Thermal drift" in line)
    assert "2.75" in first
    assert "drives in place" in first
    head = next(line for line in lines if "quantity" in line)
    assert "FEM" in head, "a heading is just above its column"


def checked(capsys: pytest.CaptureFixture[str], path: Path, *words: str) -> tuple[list[str], str]:
    with pytest.raises(SystemExit) as end:
        main(["check", str(path), *words])
    assert end.value.code == 2
    printed = capsys.readouterr()
    return printed.err.splitlines(), printed.out


def test_one_slip_in_every_hinge_is_told_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    path = tmp_path / "wide.yaml"
    path.write_text(text.replace("radius: 1.5}", "radius: 4.5}"), encoding="utf-8")
    lines, _ = checked(capsys, path)
    assert [line.split(maxsplit=2)[:2] for line in lines] == [["error:", "hinge"], ["the", "same"]]
    assert lines[1].startswith(
        "  the same for 7 more: left foot at left leg; left head at left leg"
    )
    _, printed = checked(capsys, path, "--json")
    assert len(json.loads(printed)["findings"]) == 8


def test_what_is_wrong_in_two_ways_is_told_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = EXAMPLE.read_text(encoding="utf-8").replace("radius: 1.5}", "radius: 4.5}", 1)
    path = tmp_path / "two.yaml"
    path.write_text(re.sub(r"at: \[81, 53\]", "at: [181, 53]", text), encoding="utf-8")
    lines, _ = checked(capsys, path)
    assert sum(line.startswith("error: hinge") for line in lines) == 1
    assert sum(line.startswith("error: probe") for line in lines) == 1


def test_a_figure_that_fails_its_criterion_is_marked_by_a_word_and_a_colour() -> None:
    rows = [
        Characteristic(quantity="fatigue_safety", axis=a, origin="lumped", value=v, unit="1")
        for a, v in (("x", 0.5132), ("y", 1.31))
    ]
    assert [row.failing for row in rows] == ["at least 1 is required", ""]
    assert characteristic_row(rows[0])["failing"] == "at least 1 is required"
    made = characteristics_table(compare(rows), ("fatigue_safety",), "safety")
    assert made is not None
    low, high = re.findall(r"<td[^>]*data-value.*?</td>", table_html(made), flags=re.DOTALL)
    assert 'class="ours fails"' in low
    assert "<small>fails: at least 1 is required</small>" in low
    assert "fails" not in high


def printed(shown: Table, width: int) -> list[str]:
    written = io.StringIO()
    display_table(Console(width=width, file=written), shown)
    return [line.rstrip() for line in written.getvalue().splitlines()]


def broken(shown: Table, said: str) -> list[str]:
    """The figures and words of a table that do not stand whole in what was printed of it."""
    told = [" ".join(line.split()) for line in said.splitlines()]
    words, left_out = set(said.split()), " ".join(said.split()).partition("not shown: ")[2]
    found = []
    for row in shown.rows:
        for column, cell in zip(shown.columns, row, strict=True):
            if column.spare and column.heading in left_out:
                continue
            if column.kind == "figures":
                text = " ".join(cell.text.split())
                found += [text] * (not any(text in line for line in told))
            else:
                found += [w for w in cell.text.split() if w not in words and f"{w};" not in words]
    return found


def test_a_number_stays_with_its_spread_and_its_unit() -> None:
    text = "a stroke of 63.65 ± 0.07 µm, and of 9.2 N m/rad at 95 % [3] of them"
    for width in range(16, 60):
        told = tables.wrapped(text, width)
        whole = "|".join(told)
        for atom in ("63.65 ± 0.07 µm,", "9.2 N m/rad", "95 %", "[3] of"):
            assert atom in whole
        assert " ".join(told) == text
        assert max(map(len, told)) <= width


@pytest.mark.parametrize("width", [40, 48, 56, 64, 80, 100, 140])
def test_no_width_breaks_a_number_or_a_word(width: int) -> None:
    heads = ("figure", "<step", Column("value", group="measured here"), "± (95 %)", "<unit",
             "~<remark", "<allowed")  # fmt: skip
    rows = [
        ("output displacement", "cycles-x", "63.646", "0.065", "µm", "as drawn", "0 to 120 V"),
        ("natural frequency, drives in place", "place-x", "1.596e+04", "1844", "Hz", "", ""),
        ("input stiffness", "cycles-y", Cell("-8.71e-06", note="held"), "", "N", "", "0 to 120 V"),
    ]
    shown = table("Figures.", heads, rows, notes=["all at 20 °C"])
    lines = printed(shown, width)
    assert max(map(cell_len, lines)) <= width
    assert not broken(shown, "\n".join(lines))
    assert "held" in "\n".join(lines)


def test_a_table_says_once_what_is_alike_then_leaves_out_what_can_be_spared() -> None:
    rows = [(f"design-{i}", f"title {i} of some words", i, "0 to 120 V") for i in range(3)]
    shown = table("Designs", ("design", "<title", "~bodies", "<allowed"), rows)
    wide, narrow = "\n".join(printed(shown, 80)), "\n".join(printed(shown, 22))
    assert wide.count("0 to 120 V") == 3
    assert "allowed: 0 to 120 V" in " ".join(narrow.split())
    assert narrow.count("120 V") == 1
    assert "not shown: bodies" in " ".join(narrow.split())


def test_what_has_no_room_at_all_is_a_block_for_each_row() -> None:
    heads = ("record", *(f"figure {i}" for i in range(8)))
    rows = [(name, *(f"{k + i:.4f}" for i in range(8))) for name, k in (("one", 10), ("two", 1e3))]
    lines = printed(table("Many", heads, rows), 60)
    at = lines.index("two")
    assert lines[at + 1].split() == ["figure", "0", "1000.0000"]
    assert len(lines) == 1 + 2 * 9 + 1


def test_conditions_are_numbered_notes() -> None:
    drift = "uniform temperature change, drives removed, base without expansion"
    rows = [(f"q{i}", Cell("1.5", note=drift if i else "probe")) for i in range(3)]
    said = " ".join(" ".join(printed(table("t", ("quantity", "value"), rows), 60)).split())
    assert said.count(drift) == 1
    assert "q0 1.5 [1] q1 1.5 [2] q2 1.5 [2]" in said


def data(folder: Path) -> None:
    """Files that the commands below read."""
    t = np.arange(6000) / 1000.0
    drive = 50.0 - 50.0 * np.cos(2.0 * math.pi * t)
    across = 0.01 * np.sin(2.0 * math.pi * t)
    cycles = np.column_stack([t, drive, 0.4 * drive, across])
    np.savetxt(folder / "cycles.csv", cycles, delimiter=",", comments="",
               header="t [s],u [V],x [um],y [um]")  # fmt: skip
    theta = np.radians(np.arange(720) / 2.0)
    error = np.column_stack([np.degrees(theta), 0.05 * np.cos(theta - 0.9)])
    np.savetxt(folder / "scale.csv", error, delimiter=",", comments="", header="angle,h1")
    rng = np.random.default_rng(1)
    force = rng.normal(size=8192)
    ring = np.exp(-6.0 * t[:2000]) * np.sin(2.0 * math.pi * 120.0 * t[:2000])
    noise = 1e-3 * rng.normal(size=8192)
    shaker = np.column_stack([force, np.convolve(force, ring)[:8192] + noise])
    np.savetxt(folder / "shaker.csv", shaker, delimiter=",", comments="", header="F [N],x [um]")
    (folder / "budget.yaml").write_text(
        "quantity: stroke\nunit: um\nequation: reading * (1 + gain) / cos(tilt)\ninfluences:\n"
        "  - {name: reading, value: 63.12 um, uncertainty: 12 nm, dof: 9}\n"
        "  - {name: gain, value: 0, half_width: 0.1 %}\n"
        "  - {name: tilt, value: 0 mrad, uncertainty: 5 mrad}\n",
        "utf-8",
    )


#: Those that take less than a second.
QUICK = (
    "new",
    "analyse vgtu-mechanical --model lumped",
    "hinges --profile leaf --length '2 mm' --depth '1 mm'",
    "run vgtu-piezo --dry-run",
    "export parallelogram --to dxf --folder made",
    "uncertainty budget.yaml --trials 2000",
    "records cycles.csv",
    "centre scale.csv --angle angle --error h1 --unit deg --radius '50 mm' --kind disc",
    "calibrate scale.csv --angle angle --error h1 --unit deg",
)
COMMANDS = (
    "analyse three-rrr",
    "study parallelogram --model lumped,superelement --parts identification --folder made",
    "hinges",
    "run vgtu-mechanical --dry-run",
    "excite vgtu-piezo --axis x --amplifier 'slew=2000 V/s,current=50 mA'",
    "sweep vgtu-piezo --over 'x.lever_neck=0.35..0.75 mm' --samples 5",
    "sweep vgtu-piezo --over 'x.lever_neck=10 %' --over 'x.leg_neck=10 %' --samples 9",
    "tolerance parallelogram --require 'natural_frequency.x >= 190 Hz' --samples 64 --workers 1",
    "sensitivity vgtu-piezo",
    "export parallelogram --to dxf,step --folder made",
    "import made/dxf/parallelogram.dxf --thickness '8 mm' --material 'Al 7075-T6' --force",
    "part made/step/parallelogram.step --order 0",
    "characterise cycles.csv --column command=u --column along=x --column across=y",
    "frf shaker.csv --input F --output x --sample-rate 1000",
    "identify cycles.csv --input u --output x --model dahl --out model.yaml",
    "predict model.yaml cycles.csv --input u --output x",
)


@pytest.mark.parametrize("lines", [QUICK, pytest.param(COMMANDS, marks=pytest.mark.slow)])
def test_every_command_prints_whole_numbers_at_80_columns(
    lines: tuple[str, ...],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    data(tmp_path)
    shown: list[Table] = []
    render = tables.TableLayout.__rich_console__

    def seen(self: tables.TableLayout, *given: Any) -> Any:
        shown.append(self.table)
        return render(self, *given)

    monkeypatch.setattr(tables.TableLayout, "__rich_console__", seen)
    for line in lines:
        shown.clear()
        with pytest.raises(SystemExit) as end:
            main([*shlex.split(line), "-q"])
        said = capsys.readouterr().out
        assert end.value.code in (0, None), f"{line}: {said}"
        assert shown, line
        for one in shown:
            assert not broken(one, said), f"{line}\n{said}"
        wide = [text for text in said.splitlines() if cell_len(text) > 80]
        assert all(text.startswith("wrote ") for text in wide), f"{line}: {wide}"
        folded = [text for text in said.splitlines() if re.fullmatch(r" *[\d.]+|[a-z]", text)]
        assert not folded, f"{line}: {folded}"


def test_a_path_stays_whole_and_what_tells_runs_apart_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    where = f"sqlite:///{tmp_path}/{'deep' * 20}/catalogue.sqlite"
    words = (
        "b2b2b2b2|2021-03-04 05:06:07|vgtu-mechanical|B-2|hysteresis|x|17|failed|virtual|noise",
        "b3b3b3b3|2021-03-05 05:06:07|parallelogram|C-1|hold|y|1800|complete|measured|loop of x",
    )
    both = [line.split("|") for line in words]
    columns = runs_table([], "").columns
    screen = console()
    display_table(screen, table(f"2 runs in {where}", columns, both, notes=(where,)))
    print_text(screen, f"kept {where}")
    said = capsys.readouterr().out
    assert said.count(where) == 3
    assert "not shown: serial, samples, step" in " ".join(said.split())
    [failed, complete] = [line for line in said.splitlines() if line.startswith("b")]
    assert {"failed", "virtual"} <= {*failed.split()}
    assert {"complete", "measured"} <= {*complete.split()}


def test_a_dry_run_is_read_on_three_screens(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main(["run", "vgtu-piezo", "--dry-run"])
    said = capsys.readouterr().out
    assert len(said.splitlines()) < 120
    assert "allowed: 0 to 120 V, 40000 V/s" in " ".join(said.split())


def figure(axis: str, value: float, spread: float | None = None, origin: str = "plane") -> Any:
    return Characteristic(
        quantity="straightness", axis=axis, origin=origin, value=value, unit="m", uncertainty=spread
    )


def test_an_uncertainty_has_the_digits_of_its_value() -> None:
    shown = display("straightness")
    texts = [
        (row.text(shown), row.spread_text(shown))
        for row in (
            figure("x", 97.5e-6, 6.2e-11),
            figure("x", 353.24e-6, 0.3712e-6),
            figure("x", 97.5e-6, 0.0),
            figure("x", 1e-18, 1e-9),
            figure("x", 338.9104e-6, 2.43e-9, "measured"),
        )
    ]
    assert texts == [
        ("97.50", "< 0.01"), ("353.2", "0.4"), ("97.50", "< 0.01"), ("≈ 0", ""),
        ("338.9104", "0.0024"),
    ]  # fmt: skip
    assert value_and_uncertainty(63.65, 6e-9) == ("63.65000", "< 0.00001")
    assert value_and_uncertainty(2284.1234, 0.0034) == ("2284.123", "0.003")


def test_one_quantity_has_one_unit_on_every_axis() -> None:
    pair = [figure("x", 0.3945e-6), figure("y", 95.5e-9)]
    assert shown_units(pair)["straightness"].shown_unit == "µm"
    assert shown_units(pair[1:])["straightness"].shown_unit == "nm"
    printed_so = figure("y", 9e-8, origin="published-measured")
    assert shown_units([pair[1], printed_so])["straightness"].shown_unit == "µm"
    made = characteristics_table(compare(pair), ("straightness",), "")
    assert made is not None
    assert len({row[0].text for row in made.rows}) == 1


def test_what_others_published_is_no_note_of_an_export(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ("--to", "c", "--model", "lumped", "--hysteresis", "none", "--folder", "made", "-q")
    for command in (("export", "vgtu-piezo", *words), ("analyse", "vgtu-piezo", *words[2:4])):
        with pytest.raises(SystemExit):
            main([*command])
        said = " ".join(capsys.readouterr().out.split())
        assert "The geometry is a reconstruction" in said
        assert "Published" not in said
        assert "93.9 %" not in said


def test_every_command_can_be_told_to_print_no_progress() -> None:
    def leaves(command: Any) -> Any:
        for name, below in getattr(command, "commands", {"": command}).items():
            yield from leaves(below) if hasattr(below, "commands") else [(name, below)]

    found = dict(leaves(typer.main.get_command(app)))
    assert len(found) > 25
    assert not [n for n, c in found.items() if not any("-q" in p.opts for p in c.params)]


def test_rest_of_a_scale_is_told_in_the_unit_of_its_harmonics(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data(tmp_path)
    words = ("--angle", "angle", "--error", "h1", "--unit", "deg", "--orders", "2:4")
    for more, unit in (((), "arcsec"), (("--radius", "50 mm"), "arcsec")):
        with pytest.raises(SystemExit):
            main(["centre", str(tmp_path / "scale.csv"), *words, *more])
        said = capsys.readouterr().out
        assert re.search(rf"residual [\d.]+ {unit} rms", said), said


def test_noise_of_a_load_is_no_figure(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        main(["analyse", "vgtu-piezo", "--model", "lumped", "-q"])
    said = capsys.readouterr().out
    assert re.search(r"gravity x +g +2\.36 +≈ 0", said)
    assert "e-19" not in said
