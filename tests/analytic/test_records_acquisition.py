"""Files of acquisitions: the unit g, LabVIEW's columns of times, remarks and empty channels."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from flexstage.base.errors import RecordError
from flexstage.records import Record, read_record

GRAVITY = 9.80665
LVM = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t.
X_Columns\t{x}
***End_of_Header***\t
\t
Channels\t2
{cells}
***End_of_Header***
{names}
{rows}
"""


def lvm(folder: Path, x: str, cells: str, names: str, rows: list[str]) -> Path:
    file = folder / "shaker.lvm"
    file.write_text(LVM.format(x=x, cells=cells, names=names, rows="\n".join(rows)))
    return file


def table(folder: Path, content: str, name: str = "loop.csv", **options: Any) -> Record:
    file = folder / name
    file.write_text(content)
    return read_record(file, sample_rate=100.0, **options)


@pytest.mark.parametrize(
    ("heading", "factor", "unit"),
    [
        ("Acceleration (g)", GRAVITY, "m/s^2"),
        ("acc_x [g]", GRAVITY, "m/s^2"),
        ("Accel Z (mg)", GRAVITY / 1000.0, "m/s^2"),
        ("ay [G]", GRAVITY, "m/s^2"),
        ("Beschleunigung [g]", GRAVITY, "m/s^2"),
        ("H (g/N)", GRAVITY, "m/s^2/N"),
        ("load (g)", 1e-3, "kg"),
        ("accuracy (g)", 1e-3, "kg"),
        ("dose (mg)", 1e-6, "kg"),
    ],
)
def test_g_of_an_acceleration_is_no_gram(
    tmp_path: Path, heading: str, factor: float, unit: str
) -> None:
    record = table(tmp_path, f"drive (V),{heading}\n0.5,1.25\n0.75,-2.5\n")
    assert record.channels[1].values == pytest.approx([1.25 * factor, -2.5 * factor], rel=1e-15)
    assert record.channels[1].unit == unit


def test_what_stands_beside_tells_g_from_gram_and_is_said(tmp_path: Path) -> None:
    mass = table(tmp_path, "drive (V),1 [g]\n0.5,1.25\n0.75,-2.5\n")
    assert mass.channels[1].unit == "kg"
    assert any("give the unit g_n" in note for note in mass.notes)
    beside = table(tmp_path, "accel 1 (m/s^2),2 [g]\n0.5,1.25\n0.75,-2.5\n")
    named = table(tmp_path, "1 [g],2 [g]\n0.5,1.25\n0.75,-2.5\n", "accel_03.csv")
    for record in (beside, named):
        assert record.channels[1].unit == "m/s^2"
        assert any("for a mass, give the unit gram" in note for note in record.notes)


@pytest.mark.parametrize(("unit", "si"), [("g_n", "m/s^2"), ("gn", "m/s^2"), ("G", "")])
def test_a_unit_that_leaves_no_doubt_is_not_said_to_be_a_mass(
    tmp_path: Path, unit: str, si: str
) -> None:
    record = table(tmp_path, f"drive (V),b [{unit}]\n0.5,1.25\n0.75,-2.5\n")
    assert record.channels[1].unit == si
    assert not any("taken as" in note for note in record.notes)


def test_an_option_says_what_a_column_in_g_is(tmp_path: Path) -> None:
    content = "a [g],b [g]\n0.5,1.25\n0.75,-2.5\n"
    record = table(tmp_path, content, "accel.csv", units={"a": "gram", "b": "g_n"})
    assert [c.unit for c in record.channels] == ["kg", "m/s^2"]
    assert record.channels[1].values[0] == 1.25 * GRAVITY


def test_times_before_each_channel(tmp_path: Path) -> None:
    names = "X_Value\tdrive\tX_Value\tsensor\tComment"
    cells = "Y_Unit_Label\tVolts\t\tg\t\nX_Dimension\tTime\t\tTime\t"
    rows = [f"{0.01 * i:.6f}\t{i}\t{0.01 * i:.6f}\t{0.5 * i}\t" for i in range(4)]
    record = read_record(lvm(tmp_path, "Multi", cells, names, rows))
    assert [(c.name, c.unit) for c in record.channels] == [
        ("X_Value", "s"), ("drive", "V"), ("X_Value of sensor", "s"), ("sensor", "m/s^2"),
    ]  # fmt: skip
    assert record.sample_rate_hz == pytest.approx(100.0)
    assert record.channel("sensor").values.tolist() == [0.5 * i * GRAVITY for i in range(4)]


def test_channels_at_different_times_ask_for_one(tmp_path: Path) -> None:
    names = "X_Value\tdrive\tX_Value\tsensor\tComment"
    cells = "Y_Unit_Label\tVolts\t\tVolts\t\nX_Dimension\tTime\t\tTime\t"
    rows = [f"{0.01 * i:.6f}\t{i}\t{0.02 * i:.6f}\t{0.5 * i}\t" for i in range(4)]
    file = lvm(tmp_path, "Multi", cells, names, rows)
    with pytest.raises(RecordError, match="by the option time, such as 'X_Value of drive'"):
        read_record(file)
    assert read_record(file, time="X_Value of sensor").sample_rate_hz == pytest.approx(50.0)


def test_remarks_and_empty_channels(tmp_path: Path) -> None:
    names = "X_Value\tdrive\tspare\tsensor\tComment"
    cells = "Y_Unit_Label\tVolts\t\tm/s^2\t\nX_Dimension\tTime\tTime\tTime\t"
    rows = [f"{0.01 * i:.6f}\t{i}\t\t{0.5 * i}\t{'LOST' if i == 0 else 'OK'}" for i in range(5)]
    record = read_record(lvm(tmp_path, "One", cells, names, rows))
    assert [c.unit for c in record.channels[:4]] == ["s", "V", "", "m/s^2"]
    assert record.channel("sensor").values.tolist() == [0.5 * i for i in range(5)]
    assert np.isnan(record.channel("spare").values).all()
    assert "skipped columns with text: Comment ('LOST')" in record.notes
    assert "incomplete columns that are not used: spare" in record.notes


@pytest.mark.parametrize("ending", ["", "\t"])
def test_a_comment_in_the_first_row_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    monkeypatch.delattr("flexstage.records.text._numbers_slowly")
    names = "X_Value\tdrive\tComment"
    cells = "Y_Unit_Label\tVolts\t\nX_Dimension\tTime\tTime\t"
    rows = ["0.000000\t0.5\tbegin", *(f"{0.01 * i:.6f}\t{0.5 + i}{ending}" for i in range(1, 30))]
    record = read_record(lvm(tmp_path, "One", cells, names, rows))
    assert [(c.name, c.unit) for c in record.channels[:2]] == [("X_Value", "s"), ("drive", "V")]
    assert record.channel("drive").values.tolist() == [0.5 + i for i in range(30)]
    assert any("begin" in note for note in record.notes)


LONG = {
    "quoted.csv": ('"t [s]","u [V]"', lambda i, u: f'"{i / 128}","{u}"'),
    "quoted commas.csv": ("t [s];u [V]", lambda i, u: f'{i / 128};"{u}"'.replace(".", ",")),
    "empty.csv": ("t [s];u [V];spare;w", lambda i, u: f"{i / 128};{u};;{i}"),
    "stamped.csv": ("t,u [V]", lambda i, u: f"2026-02-28 23:59:{i / 128:010.7f},{u}"),
    "german.csv": ("t;u [V]", lambda i, u: f"23:59:{i / 128:010.7f};{u}".replace(".", ",")),
}


@pytest.mark.parametrize("name", LONG)
def test_long_files_are_not_read_number_by_number(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A million rows take seconds by numpy.loadtxt, ten times as many number by number."""
    monkeypatch.delattr("flexstage.records.text._numbers_slowly")
    heading, row = LONG[name]
    u = [(-1) ** i * (0.25 + i) for i in range(1000)]
    file = tmp_path / name
    file.write_text("\n".join([heading, *(row(i, v) for i, v in enumerate(u))]) + "\n")
    record = read_record(file, columns=["u"])
    assert record.channel("u").values.tolist() == u
    assert record.sample_rate_hz == pytest.approx(128.0, rel=1e-9)


def test_an_empty_field_of_a_column_alone_is_a_row(tmp_path: Path) -> None:
    file, u = tmp_path / "one.csv", [0.5 + i for i in range(20)]
    u[11] = np.nan
    file.write_text("u\n" + "".join(";\n" if np.isnan(x) else f"{x};\n" for x in u))
    record = read_record(file, sample_rate=10.0, columns=[])
    np.testing.assert_array_equal(record.channels[0].values, u)


def test_labview_without_times_is_not_read_number_by_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("flexstage.records.text._numbers_slowly")
    cells = "Y_Unit_Label\tVolts\tVolts\t\nX_Dimension\tTime\tTime\t\nDelta_X\t0.01\t0.01\t"
    rows = [f"\t{0.5 * i}\t{-i}" for i in range(100)]
    record = read_record(lvm(tmp_path, "No", cells, "X_Value\tdrive\tsensor\tComment", rows))
    assert record.channel("drive").values.tolist() == [0.5 * i for i in range(100)]
    assert record.channel("sensor").values.tolist() == [float(-i) for i in range(100)]
    assert record.sample_rate_hz == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("above", "below", "first"),
    [
        ("", "\n", ""),
        ("", "\t\t\n", ""),
        ("\t\t\n", "", ""),
        ("\t\t\n", "\n", "begin"),
        ("", "", "# begin"),
    ],
)
@pytest.mark.parametrize("x", ["One", "No"])
def test_blank_lines_around_the_names_of_labview(
    tmp_path: Path, x: str, above: str, below: str, first: str
) -> None:
    names = f"{above}X_Value\tdrive\tComment\n{below}".removesuffix("\n")
    cells = "Y_Unit_Label\tVolts\t\nX_Dimension\tTime\tTime\t\nDelta_X\t0.01\t0.01"
    times = [f"{0.01 * i:.2f}" if x == "One" else "" for i in range(9)]
    rows = [f"{t}\t{0.5 + i}" for i, t in enumerate(times)]
    rows[0] += f"\t{first}" if first else ""
    record = read_record(lvm(tmp_path, x, cells, names, rows))
    assert [c.name for c in record.channels] == ["X_Value", "drive"][x == "No" :]
    assert record.channel("drive").values.tolist() == [0.5 + i for i in range(9)]
    assert record.sample_rate_hz == pytest.approx(100.0)
    assert any("'begin'" in note or "'# begin'" in note for note in record.notes) == bool(first)


@pytest.mark.parametrize("first", ["", "\tbegin"])
def test_units_below_the_names_of_labview_are_no_sample(tmp_path: Path, first: str) -> None:
    cells = "Y_Unit_Label\tVolts\t\nX_Dimension\tTime\tTime\t"
    rows = ["s\tV\t", f"0.00\t0.5{first}", *(f"{0.01 * i:.2f}\t{0.5 + i}" for i in range(1, 9))]
    file = lvm(tmp_path, "One", cells, "X_Value\tdrive\tComment", rows)
    drive = read_record(file, time=0, units={"0": "s"}).channels[1]
    assert drive.values.tolist() == [0.5 + i for i in range(9)]


@pytest.mark.parametrize("excess", [" 7", '"7"', "7"])
def test_an_excess_number_in_the_first_row_is_refused(tmp_path: Path, excess: str) -> None:
    rows = [f"0.00\t0.5\t{excess}", *(f"{0.01 * i:.2f}\t{0.5 + i}" for i in range(1, 9))]
    said = "has 3 columns where the first row has 2"
    with pytest.raises(RecordError, match=f"line 2 {said}"):
        table(tmp_path, "\n".join(["t\tu", *rows]) + "\n")
    cells = "Y_Unit_Label\tVolts\t\nX_Dimension\tTime\tTime\t"
    with pytest.raises(RecordError, match=said):
        read_record(lvm(tmp_path, "One", cells, "X_Value\tdrive\tComment", rows))


def test_quotes_are_no_part_of_a_text(tmp_path: Path) -> None:
    quoted = "".join(f'{i},"{i}.5+2.0j"\n' for i in range(1, 6))
    record = table(tmp_path, "f [Hz],H [m/N]\n" + quoted)
    assert [c.name for c in record.channels] == ["f", "H real", "H imaginary"]
    assert record.channels[1].values.tolist() == [i + 0.5 for i in range(1, 6)]
    assert record.channels[2].values.tolist() == [2.0] * 5
    record = table(tmp_path, "u,state\n" + '0.5,"moving"\n' * 5, columns=["u"])
    assert "skipped columns with text: state ('moving')" in record.notes


@pytest.mark.parametrize(
    ("heading", "row", "odd", "said"),
    [
        ("t,a,b", "{},2,3", '5,"1,234"', "line 7 has 2 columns where the first row has 3"),
        ("t,a", "{},2", '6.5",6"', "'6.5\"' is not a number"),
        ("t,a", "{},2", '6,6"5"', "'6\"5\"' is not a number"),
        ("t,a", "{},2", '6,"5""6"', "'5\"6' is not a number"),
        ("t,a", "10:00:0{},2", '"10:00:05,2', "line 7 has 1 columns where the first row has 2"),
    ],
)
def test_quotes_are_taken_off_whole_fields_alone(
    tmp_path: Path, heading: str, row: str, odd: str, said: str
) -> None:
    lines = [heading, *(odd if i == 5 else row.format(i) for i in range(9))]
    with pytest.raises(RecordError, match=said):
        table(tmp_path, "\n".join(lines) + "\n")


H = np.array([0.3 - 1.7j, 2.9e-5 + 0.4j, -1.1 + 1.234567890123456e-7j])


def complex_files(folder: Path) -> dict[str, Path]:
    files = {n: folder / f"h.{n}" for n in ("mat", "h5", "npz", "csv", "txt")}
    f = np.array([10.0, 12.5, 15.0])
    savemat(files["mat"], {"f": f, "H": H})
    np.savez(files["npz"], f=f, H=H)
    with h5py.File(files["h5"], "w") as file:
        file["f"], file["H"] = f, H
    pairs = list(zip(f.tolist(), H.tolist(), strict=True))
    files["csv"].write_text("f (Hz),H\n" + "".join(f"{a},{b}\n" for a, b in pairs))
    spelled = "".join(f"{a}\t{b.real:.17g} {b.imag:+.17g}i\n" for a, b in pairs)
    files["txt"].write_text("f (Hz)\tH\n" + spelled)
    return files


@pytest.mark.parametrize("kind", ["mat", "h5", "npz", "csv", "txt"])
def test_complex_values_are_two_columns(tmp_path: Path, kind: str) -> None:
    record = read_record(complex_files(tmp_path)[kind], over="point")
    assert [c.name for c in record.channels] == ["H real", "H imaginary", "f"] or [
        c.name for c in record.channels
    ] == ["f", "H real", "H imaginary"]
    assert record.channel("H real").values.tolist() == H.real.tolist()
    assert record.channel("H imaginary").values.tolist() == H.imag.tolist()


def test_oscilloscopes(tmp_path: Path) -> None:
    numbered = (
        "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-3.5e-03,5e-06,\n0,2.5,8,\n1,8,-1.6,\n"
    )
    file = tmp_path / "numbered.csv"
    file.write_text(numbered)
    record = read_record(file)
    assert [(c.name, c.unit) for c in record.channels] == [("X", ""), ("CH1", "V"), ("CH2", "V")]
    assert record.time.tolist() == pytest.approx([-3.5e-3, -3.495e-3])
    unnamed = ",CH1,CH2\nSecond,Volt,Volt\n-3.2e-02,3.5,9.4\n-3.1e-02,3.0,9.25\n,,\n"
    file.write_text(unnamed)
    record = read_record(file)
    assert record.time.tolist() == [-3.2e-2, -3.1e-2]
    assert record.channel("CH2").values.tolist() == [9.4, 9.25]
