"""Measured files of each format, written by hand or by another library, and what is read."""

import hashlib
import re
import struct
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter
from scipy.io import savemat

from flexstage.base.errors import RecordError, UnitError
from flexstage.quantities.units import si_unit
from flexstage.records import (
    Channel,
    Record,
    read_record,
    resample_uniform,
    resampled,
    saturation,
    write_record,
)
from flexstage.records.quality import difference_noise, quantisation_step
from flexstage.records.record import column_number
from flexstage.records.responses import responses_in_columns
from flexstage.records.sampling import LARGEST_UNEVEN_STEP, require_uniform, time_jitter
from flexstage.records.write import record_bytes

U = np.array([0.3, 1.7, 2.9, 0.4, -1.1])
Y = np.array([11.5, -3.25, 7.0, 8.125, 2.75])
T = np.array([0.02, 0.025, 0.03, 0.035, 0.04])


def text(folder: Path, content: str | bytes, name: str = "loop.csv") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def values(record: Record, *columns: str | int) -> list[list[float]]:
    return [record.channel(c).values.tolist() for c in columns]


# ------------------------------------------------------------------ text


@pytest.mark.parametrize(
    "content",
    [
        "drive (V),pos (um)\n0.5,1.25\n0.75,-1.5\n",
        "drive [V];pos [µm]\r\n0.5;1.25\r\n0.75;-1.5\r\n",
        "drive (V);pos (um)\n0,5;1,25\n0,75;-1,5\n",
        "drive / V\tpos / um\n0,5\t1,25\n0,75\t-1,5\n",
        "drive (Volts) pos (micron)\n  0.5   1.25\n  0.75 -1.5\n",
        "# sampled in the morning\n# drive (V), pos (um)\n0.5, 1.25\n0.75, -1.5\n",
        "% drive (V) pos (um)\n5e-1 1.25E0\n.75 -1.5\n",
        "; a remark\n; drive (V), pos (um)\n0.5,1.25,\n0.75,-1.5,\n",
        "Operator: N. N.\n\ndrive\tpos\nV\tum\n0.5\t1.25\n0.75\t-1.5\n",
        "drive\tpos\n(V)\t[um]\n0.5\t1.25\t\n0.75\t-1.5\t\n\n\n",
        '"drive (V)","pos (um)"\n"0.5","1.25"\n"0.75","-1.5"\n',
        '"drive (V)","pos (um)"\n"0,5","1,25"\n"0,75","-1,5"\n',
        "drive (V),pos (um)\n0.5,1.25\n# paused\n\n0.75,-1.5\n",
        "2\ndrive (V),pos (um)\n0.5,1.25\n0.75,-1.5\n",
        "drive (V),pos (um)\r0.5,1.25\r0.75,-1.5\r",
    ],
)
def test_text_in_many_hands(tmp_path: Path, content: str) -> None:
    for number, encoding in enumerate(("utf-8", "utf-8-sig", "utf-16", "latin-1")):
        path = text(tmp_path, content.encode(encoding), f"a{number}.txt")
        record = read_record(path, sample_rate=210.0)
        assert [c.name for c in record.channels] == ["drive", "pos"]
        assert [c.unit for c in record.channels] == ["V", "m"]
        np.testing.assert_allclose(record.channel(0).values, [0.5, 0.75], rtol=1e-15)
        np.testing.assert_allclose(record.channel("1").values, [1.25e-6, -1.5e-6], rtol=1e-15)
        np.testing.assert_array_equal(record.time, np.array([0, 1]) / 210.0)
        assert record.source == str(path)
        assert record.source_hash == hashlib.sha256(path.read_bytes()).hexdigest()


def test_text_without_heading_or_units(tmp_path: Path) -> None:
    record = read_record(text(tmp_path, "1 2\n3 4\n5 7\n", "a.dat"), sample_rate=3.0)
    assert [(c.name, c.unit) for c in record.channels] == [("column 0", ""), ("column 1", "")]
    assert values(record, 0, 1) == [[1.0, 3.0, 5.0], [2.0, 4.0, 7.0]]
    named = read_record(
        text(tmp_path, "1 2\n3 4\n"), sample_rate=3.0, names=["u (kV)", "y"], units={"y": "nm"}
    )
    assert [(c.name, c.unit) for c in named.channels] == [("u", "V"), ("y", "m")]
    np.testing.assert_allclose(named.channel("u").values, [1e3, 3e3])
    np.testing.assert_allclose(named.channel("y").values, [2e-9, 4e-9])


def test_one_column_of_decimal_commas_or_two_of_integers(tmp_path: Path) -> None:
    one = read_record(text(tmp_path, "pos (um)\n1,25\n2,5\n"), sample_rate=3.0)
    assert values(one, "pos") == [[1.25e-6, 2.5e-6]]
    two = read_record(text(tmp_path, "a,b\n1,25\n2,5\n"), sample_rate=3.0)
    assert values(two, "a", "b") == [[1.0, 2.0], [25.0, 5.0]]
    told = read_record(text(tmp_path, "1,25\n2,5\n"), sample_rate=3.0, text="decimal=,,delimiter=;")
    assert values(told, 0) == [[1.25, 2.5]]
    for delimiter in ("space", " "):
        told = read_record(
            text(tmp_path, "1,25 2\n2,5 7\n"), sample_rate=3.0, text={"delimiter": delimiter}
        )
        assert values(told, 0, 1) == [[1.25, 2.5], [2.0, 7.0]]
    bars = read_record(text(tmp_path, "u|y\n1.5|2\n3|4\n"), sample_rate=3.0, text="delimiter=|")
    assert values(bars, "u", "y") == [[1.5, 3.0], [2.0, 4.0]]
    single = read_record(text(tmp_path, "pos\n1.25\n2.5\n"), sample_rate=3.0)
    assert values(single, "pos") == [[1.25, 2.5]]


def test_regular_text_takes_the_fast_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(*_: object) -> None:
        raise AssertionError("row by row")

    monkeypatch.setattr("flexstage.records.text._numbers_slowly", slow)
    for content in ("u,y\n1.5,2\n3,4.5\n", "u;y\n1,5;2;\n3;4,5;\n", " 1,5  2\n 3  4,5\n"):
        record = read_record(text(tmp_path, content), sample_rate=2.0)
        assert values(record, 0, 1) == [[1.5, 3.0], [2.0, 4.5]]


def test_skipped_lines_and_chosen_rows(tmp_path: Path) -> None:
    path = text(tmp_path, "1,2\n3,4\nu,y\n5,6\n7,8\n9,nan\n11,12\n13,14\n")
    record = read_record(path, sample_rate=4.0, text="skip=2", rows=(0, 2))
    assert values(record, "u", "y") == [[5.0, 7.0], [6.0, 8.0]]
    record = read_record(path, sample_rate=4.0, text="skip=2", columns=["u"])
    assert values(record, "u") == [[5.0, 7.0, 9.0, 11.0, 13.0]]
    assert any("not used: y" in note for note in record.notes)
    record = read_record(path, sample_rate=4.0, text="skip=2", rows=(3, None))
    assert values(record, "u") == [[11.0, 13.0]]


def test_brackets_that_are_no_unit_stay_in_the_name(tmp_path: Path) -> None:
    record = read_record(text(tmp_path, "drive (ch1),pos (axis X)\n1,2\n3,4\n"), sample_rate=2.0)
    assert [(c.name, c.unit) for c in record.channels] == [
        ("drive (ch1)", ""),
        ("pos (axis X)", ""),
    ]


def test_columns_of_one_name(tmp_path: Path) -> None:
    record = read_record(text(tmp_path, "V,x,V\n1,2,3\n4,5,6\n"), sample_rate=2.0)
    assert [c.name for c in record.channels] == ["V #0", "x", "V #2"]
    assert values(record, "V #2") == [[3.0, 6.0]]


LVM = """LabVIEW Measurement
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t{sign}
Multi_Headings\tNo
X_Columns\t{columns}
Time_Pref\tAbsolute
***End_of_Header***

Channels\t2
Samples\t3\t3
Date\t2020/03/04\t2020/03/04
Y_Unit_Label\tVolts\tum
X_Dimension\tTime\tTime
X0\t0.0000000000000000E+0\t0.0000000000000000E+0
Delta_X\t0.004000\t0.004000
***End_of_Header***
X_Value\tdrive\tpos\tComment
"""


def test_labview_with_times(tmp_path: Path) -> None:
    content = LVM.format(sign=".", columns="One")
    content += "0.000000\t1.25\t30.5\n0.004000\t1.5\t31.5\n0.008000\t1.75\t33.5\n"
    record = read_record(text(tmp_path, content, "a.lvm"))
    assert [(c.name, c.unit) for c in record.channels] == [
        ("X_Value", "s"),
        ("drive", "V"),
        ("pos", "m"),
    ]
    assert record.sample_rate_hz == pytest.approx(250.0, rel=1e-12)
    assert values(record, "drive") == [[1.25, 1.5, 1.75]]
    np.testing.assert_allclose(record.channel("pos").values, [30.5e-6, 31.5e-6, 33.5e-6])


def test_labview_without_times(tmp_path: Path) -> None:
    content = LVM.format(sign=",", columns="No").replace("0.004000\t", "0,004000\t")
    content += "\t1,25\t30,5\n\t1,5\t31,5\n\t1,75\t33,5\n"
    record = read_record(text(tmp_path, content, "a.lvm"))
    assert [c.name for c in record.channels] == ["drive", "pos"]
    np.testing.assert_allclose(record.time, [0.0, 0.004, 0.008], rtol=1e-14)
    assert any("Delta_X" in note for note in record.notes)
    np.testing.assert_allclose(record.channel("pos").values, [30.5e-6, 31.5e-6, 33.5e-6])


def test_dates_count_from_the_first(tmp_path: Path) -> None:
    rows = ["2021-12-31 23:59:59.9990,1.5", "2022-01-01 00:00:00.0005,2.5"]
    record = read_record(text(tmp_path, "\n".join(["time,u", *rows, "2022-01-01T00:00:00.002,3"])))
    np.testing.assert_allclose(record.time, [0.0, 0.0015, 0.003], atol=1e-10)
    assert record.channel("time").unit == "s"
    clock = read_record(text(tmp_path, "t;u\n9:59:59,75;1,5\n10:00:00,00;2,5\n"))
    np.testing.assert_allclose(clock.time, [0.0, 0.25])


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("31.12.2026 23:59:59.750", "1.1.2027 0:00:00.000"),
        ("31.12.2026 23:59:59,750", "01.01.2027 00:00:00,000"),
        ("12/31/2026 23:59:59.750", "1/1/2027 0:00:00.000"),
        ("12/31/2026 11:59:59.750 PM", "1/1/2027 12:00:00.000 AM"),
        ("31/12/2026 23:59:59.750", "01/01/2027 00:00:00.000"),
        # all of one day: which number is the month makes no difference
        ("05/06/2026 11:59:59.750", "05/06/2026 12:00:00.000"),
        ("05/06/2026 11:59:59.750 AM", "05/06/2026 12:00:00.000 PM"),
    ],
)
def test_dates_as_countries_write_them(tmp_path: Path, first: str, second: str) -> None:
    record = read_record(text(tmp_path, f"Time;u [V]\n{first};1,5\n{second};2,5\n"))
    np.testing.assert_allclose(record.time, [0.0, 0.25], atol=1e-10)


def test_dates_that_leave_the_month_open_are_not_guessed(tmp_path: Path) -> None:
    rows = "Time,u\n05/06/2026 23:59:59,1.5\n05/07/2026 00:00:00,2.5\n"
    path = text(tmp_path, rows)
    said = r"'05/06/2026 23:59:59' may begin with the month or the day.* write them as 2026-05-31"
    for time in (None, "Time"):
        with pytest.raises(RecordError, match=said):
            read_record(path, time=time)
    assert values(read_record(path, sample_rate=2.0), "u") == [[1.5, 2.5]]
    # a date further below tells
    told = read_record(text(tmp_path, rows + "05/13/2026 00:00:01,3.5\n"), largest_step=1e9)
    np.testing.assert_allclose(told.time, [0.0, 1.0, 6 * 86400.0 + 2.0])


@pytest.mark.parametrize("sign", [";", ",", "\t"])
def test_a_row_of_units_may_begin_with_an_empty_cell(tmp_path: Path, sign: str) -> None:
    lines = ["t;u;y", ";V;µm", "0;1.5;11.5", "0.25;2.5;7.25"]
    path = text(tmp_path, "\n".join(lines).replace(";", sign) + "\n")
    record = read_record(path, time="t")
    assert [(c.name, c.unit) for c in record.channels] == [("t", "s"), ("u", "V"), ("y", "m")]
    assert values(record, "u", "y") == [[1.5, 2.5], [11.5e-6, 7.25e-6]]


# ------------------------------------------------------------------ other formats


def test_matlab_vectors_structures_and_cells(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    for orient in ("row", "column"):
        savemat(path, {"u": U, "y": Y, "fs": 350.0, "who": "N. N."}, oned_as=orient)
        record = read_record(path, units={"y": "um"})
        assert values(record, "u") == [U.tolist()]
        np.testing.assert_allclose(record.channel("y").values, Y * 1e-6)
        assert record.sample_rate_hz == pytest.approx(350.0)
        assert record.attributes["who"] == "N. N."
    savemat(path, {"data": {"t": T, "u": U, "y": Y, "gain": np.array([3.0, 4.0])}})
    record = read_record(path, time="t")
    assert [c.name for c in record.channels] == ["t", "u", "y"]
    np.testing.assert_array_equal(record.time, T)
    assert any("data/gain" in note for note in record.notes)
    assert any("assumed in seconds" in note for note in record.notes)
    cells = np.empty((1, 2), dtype=object)
    cells[0, 0], cells[0, 1] = {"u": U, "y": Y}, {"u": Y, "y": U}
    savemat(path, {"runs": cells})
    with pytest.raises(RecordError, match=r"runs\{2\}/y"):
        read_record(path, sample_rate=5.0)
    record = read_record(path, sample_rate=5.0, dataset="runs{2}")
    assert values(record, "u", "y") == [Y.tolist(), U.tolist()]


@pytest.mark.parametrize("version", ["4", "5"])
def test_matlab_matrix_either_way(tmp_path: Path, version: str) -> None:
    path = tmp_path / "a.mat"
    for matrix in (np.column_stack([U, Y]), np.vstack([U, Y])):
        savemat(path, {"data": matrix}, format=version)
        record = read_record(path, sample_rate=5.0)
        assert [c.name for c in record.channels] == ["data 0", "data 1"]
        assert values(record, 0, 1) == [U.tolist(), Y.tolist()]


def test_matlab_ascii(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    np.savetxt(path, np.column_stack([U, Y]), fmt=" %.7e")
    np.testing.assert_allclose(read_record(path, sample_rate=5.0).channel(1).values, Y)


def matlab_73(path: Path) -> None:
    """Write what MATLAB writes since version 7.3: arrays transposed, classes as attributes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("data")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, array in {"u": U, "y": Y}.items():
            group.create_dataset(name, data=array.reshape(1, -1))
        square = file.create_dataset("square", data=np.array([[1.0, 2.0], [3.0, 5.0]]))
        square.attrs["MATLAB_class"] = np.bytes_("double")
        word = file.create_dataset("word", data=np.array([[65], [66]], dtype=np.uint16))
        word.attrs["MATLAB_class"] = np.bytes_("char")
        rate = file.create_dataset("Fs", data=np.array([[640.0]]))
        rate.attrs["MATLAB_class"] = np.bytes_("double")
        empty = file.create_dataset("none", data=np.array([0, 0], dtype=np.uint64))
        empty.attrs["MATLAB_class"] = np.bytes_("double")
        empty.attrs["MATLAB_empty"] = np.uint8(1)
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + struct.pack("<H", 0x0200) + b"IM"
    with path.open("r+b") as stream:
        stream.write(head)


def test_matlab_73(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    matlab_73(path)
    record = read_record(path, dataset="data.u,data.y")
    assert values(record, "u", "y") == [U.tolist(), Y.tolist()]
    assert record.sample_rate_hz == pytest.approx(640.0)
    assert record.attributes["word"] == "AB"
    with pytest.raises(RecordError, match="choice of columns is ambiguous") as caught:
        read_record(path)
    assert "none" not in str(caught.value), "an empty array is stored as its dimensions"
    # its columns are what MATLAB shows as columns
    square = read_record(path, dataset="square")
    assert values(square, 0, 1) == [[1.0, 2.0], [3.0, 5.0]]


def test_hdf5_groups_units_and_compound(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        run = file.create_group("run")
        run.attrs["sample_rate"] = 47.0
        run.attrs["operator"] = "N. N."
        run["u"] = U.astype(np.float32)
        run["y"] = (1000.0 * Y).astype(np.int32)
        run["y"].attrs["units"] = "nm"
        file["loop"] = h5py.SoftLink("/")
    record = read_record(path)
    np.testing.assert_array_equal(record.channel("u").values, U.astype(np.float32))
    np.testing.assert_allclose(record.channel("y").values, 1000.0 * Y * 1e-9)
    assert record.channel("y").unit == "m"
    assert record.sample_rate_hz == pytest.approx(47.0)
    assert record.attributes["run/operator"] == "N. N."
    table = np.zeros(5, dtype=[("t", "f8"), ("y", "f4"), ("flag", "?")])
    table["t"], table["y"] = T, Y
    with h5py.File(path, "w") as file:
        file["table"] = table
    record = read_record(path, time="t", units={"t": "ms"})
    np.testing.assert_allclose(record.time, T * 1e-3)
    assert [c.name for c in record.channels] == ["t", "y", "flag"]


def test_a_step_beside_the_data_is_a_hint(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"u": U, "y": Y, "Ts": 0.004})
    with pytest.raises(RecordError, match=r"'Ts' = 0\.004 .* the sample rate is 250 Hz"):
        read_record(tmp_path / "a.mat")


def tdms(path: Path, *channels: ChannelObject) -> Path:
    with TdmsWriter(path) as writer:
        writer.write_segment([RootObject({"author": "N. N."}), GroupObject("run"), *channels])
    return path


def wave(name: str, data: np.ndarray, increment: float | None = 0.008, **more: object):
    properties = {} if increment is None else {"wf_increment": increment, "wf_start_offset": 0.5}
    return ChannelObject("run", name, data, properties | more)


def test_tdms(tmp_path: Path) -> None:
    path = tdms(
        tmp_path / "a.tdms",
        wave("drive", U, unit_string="V"),
        wave("pos (x/y)", Y.astype(np.float32), unit_string="um"),
    )
    record = read_record(path)
    np.testing.assert_allclose(record.time, 0.5 + 0.008 * np.arange(5), rtol=1e-14)
    assert [(c.name, c.unit) for c in record.channels] == [("drive", "V"), ("pos (x/y)", "m")]
    np.testing.assert_allclose(record.channel(1).values, Y * 1e-6)
    assert record.attributes["author"] == "N. N."
    assert read_record(path, rows=(2, None)).time[0] == pytest.approx(0.516)
    stamps = np.datetime64("2024-05-06T07:08:09") + np.arange(5) * np.timedelta64(2500, "us")
    record = read_record(tdms(path, wave("clock", stamps, None), wave("u", U, None)), time="clock")
    np.testing.assert_allclose(record.time, 0.0025 * np.arange(5), atol=1e-9)


def test_without_the_library_of_labview_a_sentence_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.tdms"
    path.write_bytes(b"TDSm")
    monkeypatch.setitem(sys.modules, "nptdms", None)
    with pytest.raises(RecordError, match=r'a TDMS file .* pip install "flexstage\[labview\]"'):
        read_record(path)


def test_tdms_of_two_rates(tmp_path: Path) -> None:
    path = tdms(tmp_path / "a.tdms", wave("u", U), wave("y", Y, 0.016))
    with pytest.raises(RecordError, match="sampled at different times"):
        read_record(path)


def test_numpy_files(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.vstack([U, Y]))
    record = read_record(tmp_path / "a.npy", sample_rate=9.0, names=["u", "y (um)"])
    np.testing.assert_allclose(record.channel("y").values, Y * 1e-6)
    np.save(tmp_path / "b.npy", U)
    assert values(read_record(tmp_path / "b.npy", sample_rate=9.0), 0) == [U.tolist()]
    np.savez(tmp_path / "c.npz", time=T, u=U, y=Y, fs=200.0)
    record = read_record(tmp_path / "c.npz")
    assert record.sample_rate_hz == pytest.approx(200.0)
    assert [c.name for c in record.channels] == ["time", "u", "y"]
    table = np.zeros(5, dtype=[("u", "f8"), ("y", "f4")])
    np.save(tmp_path / "d.npy", table)
    assert read_record(tmp_path / "d.npy", sample_rate=2.0).channel("y").values.size == 5


def test_content_goes_before_the_suffix(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", u=U, y=Y)
    path = text(tmp_path, (tmp_path / "a.npz").read_bytes(), "log.001")
    assert values(read_record(path, sample_rate=9.0), "y") == [Y.tolist()]
    tdms(tmp_path / "b.tdms", wave("u", U))
    path = text(tmp_path, (tmp_path / "b.tdms").read_bytes(), "b.dat")
    assert values(read_record(path), "u") == [U.tolist()]
    path = text(tmp_path, "1 2\n3 4\n", "log.002")
    assert values(read_record(path, sample_rate=9.0), 1) == [[2.0, 4.0]]
    assert read_record(path, format="csv", sample_rate=9.0).size == 2


# ------------------------------------------------------------------ units and time


@pytest.mark.parametrize(
    ("unit", "factor", "si"),
    [
        ("um", 1e-6, "m"),
        ("µm", 1e-6, "m"),
        ("\N{GREEK SMALL LETTER MU}m", 1e-6, "m"),
        ("Microns", 1e-6, "m"),
        ("inch", 0.0254, "m"),
        ("mV", 1e-3, "V"),
        ("Volts", 1.0, "V"),
        ("msec", 1e-3, "s"),
        ("min", 60.0, "s"),
        ("N/um", 1e6, "N/m"),
        ("m/s²", 1.0, "m/s^2"),
        ("um/V", 1e-6, "m/V"),
        ("%", 0.01, "1"),
        ("ustrain", 1e-6, "1"),
        ("µε", 1e-6, "1"),
        ("counts", 1.0, "count"),
        ("°C", 1.0, "degC"),
        ("C", 1.0, "C"),
        ("°", np.pi / 180.0, "rad"),
        ("rpm", np.pi / 30.0, "rad/s"),
        ("kHz", 1e3, "Hz"),
        ("mA", 1e-3, "A"),
        ("kΩ", 1e3, "ohm"),
    ],
)
def test_units_of_columns(unit: str, factor: float, si: str) -> None:
    found = si_unit(unit)
    assert found == (pytest.approx(factor, rel=1e-14), si)


@pytest.mark.parametrize(
    "unit", ["", "ch", "ch1", "A1", "d", "c", "dB", "t", "MPA", "m*m*m", "x/y"]
)
def test_what_is_no_unit_of_a_column(unit: str) -> None:
    with pytest.raises(UnitError, match="unknown unit"):
        si_unit(unit)


def test_reading_loads_no_library_before_it_needs_it() -> None:
    script = "import flexstage.records, sys; print(*sys.modules)"
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert {"scipy", "h5py", "nptdms", "pint"}.isdisjoint(out.stdout.split())


def test_the_option_goes_before_the_file(tmp_path: Path) -> None:
    path = text(tmp_path, "u (V),y (mm)\n1,2\n3,4\n")
    record = read_record(path, sample_rate=2.0, units={"1": "um"})
    np.testing.assert_allclose(record.channel("y").values, [2e-6, 4e-6])
    assert any("'mm'" in note and "'um'" in note for note in record.notes)
    assert any("u in V" in note for note in record.notes)


def test_times_of_a_column(tmp_path: Path) -> None:
    path = text(tmp_path, "time (ms),u\n20,1\n25,2\n30,4\n")
    record = read_record(path)
    np.testing.assert_allclose(record.time, [0.02, 0.025, 0.03])
    assert record.sample_rate_hz == pytest.approx(200.0)
    # printed with too few digits, the rate is better; it must still be the same
    assert read_record(path, sample_rate=200.5).sample_rate_hz == pytest.approx(200.5)
    with pytest.raises(RecordError, match="conflict"):
        read_record(path, sample_rate=190.0)
    with pytest.raises(RecordError, match="conflict"):
        read_record(path, sample_rate=190.0, time=0)
    path = text(tmp_path, "t,u\n20,1\n25,2\n30,4\n")
    with pytest.raises(RecordError, match=r"give the sample rate.*'t' may be the time"):
        read_record(path)
    assert read_record(path, time="t").sample_rate_hz == pytest.approx(0.2)
    assert read_record(path, time=0, units={"t": "ms"}).sample_rate_hz == pytest.approx(200.0)
    assert read_record(path, time="0", sample_rate=0.2).time[0] == 20.0


def test_uneven_times_are_kept_and_said(tmp_path: Path) -> None:
    path = text(tmp_path, "time (s),u\n0.0,1\n0.9,2\n2.1,4\n3.0,5\n")
    record = read_record(path)
    assert time_jitter(record.time) == pytest.approx(0.2)
    assert any("20 %" in note for note in record.notes)
    with pytest.raises(RecordError, match=r"up to 20 %.*resampled"):
        require_uniform(record)
    require_uniform(resampled(record))


# ------------------------------------------------------------------ refusals of sampling


def refuse(path: Path, match: str, **options: object) -> None:
    with pytest.raises(RecordError, match=match) as caught:
        read_record(path, **options)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_samples_that_are_no_numbers(tmp_path: Path) -> None:
    path = text(tmp_path, "u,y\n1,2\n3,NaN\n5,\n7,8\n")
    refuse(path, r"'y' is missing .* at sample 1, and 2 of its 4", sample_rate=2.0)
    refuse(text(tmp_path, "1 1e999\n2 3\n"), "'column 1' is infinite", sample_rate=2.0)
    refuse(text(tmp_path, "time (s),u\n0,1\nnan,2\n2,3\n"), "'time' is missing")


def test_times_that_do_not_rise(tmp_path: Path) -> None:
    refuse(
        text(tmp_path, "time (s),u\n0,1\n0.5,2\n0.5,3\n1,4\n"),
        r"repeated: samples 1 and 2 are both at 0\.5 s \(1 such",
    )
    refuse(
        text(tmp_path, "time (s),u\n0,1\n0.5,2\n1,3\n0.25,4\n"),
        r"goes back from 1 s to 0\.25 s after sample 2",
    )
    refuse(
        text(tmp_path, "time (s),u\n0,1\n0.5,2\n1,3\n1.9,4\n2.4,5\n"),
        r"gap of 0\.9 s after sample 2 \(t = 1 s\)",
    )
    # half a step more is no gap yet
    steps = "time (s),u\n0,1\n0.5,2\n1,3\n1.7,4\n2.2,5\n"
    assert read_record(text(tmp_path, steps)).size == 5


def test_wrong_options(tmp_path: Path) -> None:
    path = text(tmp_path, "u (V),y\n1,2\n3,4\n")
    refuse(path, "there is no column 'z': the record has 0: u, 1: y", time="z")
    refuse(path, "there is no column '2'", units={"2": "V"}, sample_rate=2.0)
    refuse(path, "has two units", units={"0": "V", "u": "V"}, sample_rate=2.0)
    refuse(path, "'y': unknown unit 'parsec'", units={"y": "parsec"}, sample_rate=2.0)
    refuse(path, "sample_rate must be above 0, got -3", sample_rate=-3.0)
    refuse(path, "sample_rate must be above 0, got inf", sample_rate=np.inf)
    refuse(path, "is in V, and cannot be the time", time="u")
    refuse(path, "has 2 columns, got 1 names", names=["u"], sample_rate=2.0)
    refuse(path, "the format must be one of text", format="xml", sample_rate=2.0)
    refuse(path, "without datasets", dataset="run", sample_rate=2.0)
    refuse(path, "decimal must be one of", text={"decimal": "'"}, sample_rate=2.0)
    refuse(path, "delimiter must be one character", text={"delimiter": ", "}, sample_rate=2.0)
    refuse(path, "delimiter must be one character", text="delimiter=.", sample_rate=2.0)
    refuse(path, "skip must be a whole number from 0", text={"skip": -1}, sample_rate=2.0)
    refuse(path, "no column 'z'", columns=["z"], sample_rate=2.0)
    refuse(path, "at least two samples", rows=(1, 2), sample_rate=2.0)
    np.save(tmp_path / "a.npy", U)
    refuse(tmp_path / "a.npy", "not a text file", text="skip=2", sample_rate=2.0)
    savemat(tmp_path / "a.mat", {"u": U, "fs": 350.0})
    refuse(tmp_path / "a.mat", "340 Hz, conflicts with 'fs' of the file, 350 Hz", sample_rate=340.0)


def test_columns_are_found_by_name_and_number() -> None:
    names = ["U", "y", "1"]
    assert [column_number(names, s) for s in ("U", "u", " y ", "1", "0", 1)] == [0, 0, 1, 2, 0, 1]
    for wrong in ("z", -1, 3, "3", True, ""):
        with pytest.raises(RecordError, match="there is no column"):
            column_number(names, wrong)
    with pytest.raises(RecordError, match="there are 2 columns 'a'"):
        column_number(["a", "a"], "a")


# ------------------------------------------------------------------ quality and parts


def record_of(**columns: np.ndarray) -> Record:
    count = next(iter(columns.values())).size
    channels = tuple(Channel(name=n, values=v) for n, v in columns.items())
    return Record(channels=channels, time=0.4 + 0.013 * np.arange(count))


def test_saturation_counts() -> None:
    x = np.array([0.1, 0.9, 1.2, 1.2, 1.2, 1.2, 1.2, 0.7, -0.4, -0.4, 0.3, 1.2])
    found = saturation(x)
    assert (found.high, found.at_high, found.clipped_high) == (1.2, 6, True)
    assert (found.low, found.at_low, found.clipped_low) == (-0.4, 2, False)
    assert found.clipped
    assert not saturation(np.full(7, 0.2)).clipped
    # a peak that comes back to the same number in every period is no limit
    assert not saturation(np.array([0.1, 1.2, 0.3, 1.2, 0.7, 1.2, 0.9, 1.2, 0.4, 1.2])).clipped


def test_steps_of_a_converter() -> None:
    random = np.random.default_rng(8)
    counts = random.integers(-3000, 3000, 500)
    assert quantisation_step(counts * 3.7e-4 + 0.11) == pytest.approx(3.7e-4, rel=1e-9)
    assert quantisation_step(2 * counts[:4] + 3 * counts[4:8]) == 1.0
    assert quantisation_step(random.standard_normal(500)) == 0.0
    assert quantisation_step(np.full(4, 0.7)) == 0.0


@pytest.mark.parametrize("order", range(1, 9))
def test_noise_of_every_order(order: int) -> None:
    noise = 0.37 * np.random.default_rng(5).standard_normal(40_000)
    assert difference_noise(noise, order) == pytest.approx(0.37, rel=0.03)


def test_a_sine_between_its_samples() -> None:
    time = np.cumsum(np.random.default_rng(3).uniform(0.7, 1.3, 400)) * 1e-3
    omega = 2.0 * np.pi * 31.0
    record = Record(channels=(Channel(name="x", values=np.sin(omega * time)),), time=time)
    errors = {
        kind: np.abs(
            resampled(record, 900.0, kind=kind).channel("x").values
            - np.sin(omega * resampled(record, 900.0).time)
        ).max()
        for kind in ("linear", "cubic")
    }
    # the documented bound for a line, at the longest step; the spline is of fourth order
    assert 0.3 < errors["linear"] / ((omega * 1.3e-3) ** 2 / 8.0) <= 1.0
    assert errors["cubic"] < 0.02 * errors["linear"]


def test_resampling_and_quality_refuse() -> None:
    record = record_of(x=U)
    for wrong in (0.0, -1.0, np.nan, 1e-3, 1e30):
        with pytest.raises(RecordError):
            resampled(record, wrong)
    with pytest.raises(RecordError, match="linear, cubic or mean"):
        resampled(record, kind="nearest")  # type: ignore[arg-type]
    for bad in (U[:1], np.array([0.1, np.nan, 0.3]), np.zeros((3, 3))):
        for estimate in (saturation, quantisation_step):
            with pytest.raises(RecordError, match="samples are needed"):
                estimate(bad)


# ------------------------------------------------------------------ writing


def test_a_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    record = record_of(x=U)
    path = write_record(record, tmp_path / "a.csv")
    assert path.read_bytes() == record_bytes(record, "csv")
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]
    (tmp_path / "b.csv").mkdir()
    for target, match in (
        ("b.csv", "cannot be written"),
        ("none/a.csv", "cannot be written"),
        ("a.xlsx", r"must end in one of \.csv"),
    ):
        with pytest.raises(RecordError, match=match):
            write_record(record, tmp_path / target)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.csv", "b.csv"]
    with pytest.raises(RecordError, match="must be one of csv"):
        record_bytes(record, "xml")
    wrong = Record(channels=(Channel(name="time", values=U, unit="s"),), time=T)
    with pytest.raises(RecordError, match="rename it"):
        record_bytes(wrong, "csv")


# ------------------------------------------------------------------ text beside numbers

ROWS = [(0.5, 1.25), (0.625, 1.5), (0.75, -2.0), (0.875, 3.125)]


@pytest.mark.parametrize(
    ("heading", "rows", "left_out"),
    [
        ("u,y,status", ["{},{},OK"] * 4, "status ('OK')"),
        ("u,y,status", ["{},{},OK", "{},{},", "{},{},ERR 7", "{},{},OK"], "status ('OK')"),
        ("u,y,status", ["{},{},"] * 3 + ["{},{},late"], "status ('late')"),
        ("u,y,status", ["{},{},OK", "{},{},OK", "{},{},7", "{},{},ERR"], "status ('OK')"),
        ("u,y,status", ['{},{},"a, b"', '{},{},"c"'] * 2, "status ('a, b')"),
        ("u;y;Datum", ["{};{};06.05.2024"] * 4, "Datum ('06.05.2024')"),
        ("u\ty\twhen", ["{}\t{}\t05/06/2024 noon"] * 4, "when ('05/06/2024 noon')"),
        ("u y note", ["{} {} OK", "{} {}", "{} {} no", "{} {} OK"], "note ('OK')"),
        ("u,y,load", ["{},{},12 %"] * 4, "load ('12 %')"),
        ("u,y", ["{},{}", "{},{} # paused, then on", "{},{}", "{},{}"], "'# paused, then on'"),
        ("u y", ["{} {}", "{} {}  % on", "{} {}", "{} {} jumps here"], "2 rows, such as '% on'"),
        ("rate,200,Hz\ngain,3,x\nu,y,s", ["{},{},a"] * 4, "s ('a')"),
    ],
)
def test_text_beside_numbers_is_left_out(
    tmp_path: Path, heading: str, rows: list[str], left_out: str
) -> None:
    lines = [heading, *(row.format(*pair) for row, pair in zip(rows, ROWS, strict=True))]
    record = read_record(
        text(tmp_path, "\n".join(lines) + "\n"), sample_rate=10.0, columns=["u", "y"]
    )
    assert list(zip(*values(record, "u", "y"), strict=True)) == ROWS
    assert any(note.startswith("skipped") and left_out in note for note in record.notes)


def test_text_in_a_column_that_is_used(tmp_path: Path) -> None:
    path = text(tmp_path, "t (s),u,y,s\n0,1,2,a\n# \n1,1.5,over,b\n2,2,5,c\nlost,3,7,d\n5,6,7,e\n")
    said = r"line 4, column 2: 'over' is not a number, and 1 of 5 rows of column 'y' contain text"
    with pytest.raises(RecordError, match=said):
        read_record(path, sample_rate=2.0, columns=["u", "y"])
    with pytest.raises(RecordError, match="is not a number"):
        read_record(path, sample_rate=2.0)
    assert values(read_record(path, sample_rate=2.0, columns=["u"]), "u") == [[1, 1.5, 2, 3, 6]]
    for time in ("t", None):
        with pytest.raises(RecordError, match="line 6, column 0: 'lost' is not a number"):
            read_record(path, columns=["u"], time=time)
    cut = read_record(path, columns=["u", "y"], rows=(2, None), sample_rate=2.0)
    assert values(cut, "y") == [[5, 7, 7]]
    # numbers that cannot be read are no text, also where nobody has said which columns are used
    with pytest.raises(RecordError, match=r"'1\.234,5' is not a number"):
        read_record(text(tmp_path, "u;y\n1.234,5;2\n1.235,5;3\n"), sample_rate=2.0)


def test_rows_with_text_are_told_from_a_heading(tmp_path: Path) -> None:
    numbers = "".join(f"{u},{y}\n" for u, y in ROWS)
    for heading in ("rate,200\ngain,3\nu,y\n", "rate,200\ngain,3\nmode,1\nrange,7\n"):
        record = read_record(text(tmp_path, heading + numbers), sample_rate=2.0)
        assert list(zip(*values(record, 0, 1), strict=True)) == ROWS
    # a state that is a word for long and a number at last
    many = "u,y,s\n" + "1.5,2.5,OK\n" * 40 + "1.5,2.5,0\n" * 3
    assert read_record(text(tmp_path, many), sample_rate=2.0, columns=["u", "y"]).size == 43


def test_many_rows_with_text_are_read_fast(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(*_: object) -> None:
        raise AssertionError("row by row")

    monkeypatch.setattr("flexstage.records.text._numbers_slowly", slow)
    rows = "".join(f"{u};x;{y};OK\n".replace(".", ",") for u, y in ROWS)
    record = read_record(text(tmp_path, "u;none;y;s\n" + rows), sample_rate=2.0, columns=["u", "y"])
    assert list(zip(*values(record, "u", "y"), strict=True)) == ROWS


# ------------------------------------------------------------------ uneven times


def uneven(share: float, seed: int = 8, rate: float = 10.4, size: int = 3000) -> np.ndarray:
    """Times of a logger whose steps differ by up to a share of their mean."""
    return np.cumsum(1.0 + np.random.default_rng(seed).uniform(-share, share, size)) / rate


def test_uneven_samples_of_a_line_and_their_means() -> None:
    time = uneven(0.3)
    line = Channel(name="x", values=0.7 * time - 3.0)
    bent = Channel(name="y", values=np.sin(0.9 * time) + 0.2 * np.sin(31.0 * time))
    record = Record(channels=(line, bent), time=time)
    for rate in (None, 10.0, 3.3):
        made = resample_uniform(record, rate)
        require_uniform(made)
        np.testing.assert_allclose(made.channel("x").values, 0.7 * made.time - 3.0, atol=1e-11)
        assert made.numbers is not None
        np.testing.assert_allclose(np.interp(made.time, time, np.arange(time.size)), made.numbers)
    # means are those of the straight lines between the samples, on a grid that holds their ends
    made = resampled(record, 3.3, kind="mean")
    k = 57
    ends = made.time[k] + np.array([-0.5, 0.5]) / 3.3
    inside = time[(time > ends[0]) & (time < ends[1])]
    corners = np.concatenate((ends[:1], inside, ends[1:]))
    y = np.interp(corners, time, bent.values)
    assert made.channel("y").values[k] == pytest.approx(np.trapezoid(y, corners) * 3.3, rel=1e-12)


@pytest.mark.parametrize("rate", [10.4, 3.1])
def test_what_resampling_says_is_lost(rate: float) -> None:
    time = uneven(0.2)
    note = resample_uniform(
        Record(channels=(Channel(name="x", values=time),), time=time), rate
    ).notes[-1]
    said = re.search(r"by ([\d.]+) % rms .* motion above ([\d.]+) Hz is attenuated by more", note)
    assert said is not None
    # uniform steps of +-20 %
    assert float(said[1]) == pytest.approx(20.0 / np.sqrt(3.0), rel=0.05)
    slow, late = float(said[2]), 0.0213
    channels = tuple(
        Channel(name=n, values=np.sin(2.0 * np.pi * slow * (time - d)))
        for n, d in (("u", 0.0), ("y", late))
    )
    made = resample_uniform(Record(channels=channels, time=time), rate)
    wave = np.exp(-2j * np.pi * slow * made.time)
    whole = np.arange(made.size) < int(np.floor(made.time[-1] * slow - 1) / slow * rate)
    u, y = (2.0 * np.mean((c.values * wave)[whole]) for c in made.channels)
    assert 0.989 < abs(u) < 0.999
    # times that are right, however uneven, leave the delay between two columns as it is
    assert -np.angle(y / u) / (2.0 * np.pi * slow) == pytest.approx(late, abs=2e-4)


def test_times_that_are_only_rounded(tmp_path: Path) -> None:
    rows = [f"{k / 300.0:.3f},{k % 7}" for k in range(60)]
    record = read_record(text(tmp_path, "\n".join(["time (s),u", *rows])))
    with pytest.raises(
        RecordError, match=r"uniform except for the rounding .* sample rate .*(299|300)\.\d+ Hz"
    ):
        require_uniform(record)
    time = uneven(0.2)
    with pytest.raises(RecordError, match="use the option resample"):
        require_uniform(Record(channels=(Channel(name="x", values=time),), time=time))


def test_rates_and_gaps_that_cannot_be_evened(tmp_path: Path) -> None:
    time = uneven(0.2)
    record = Record(channels=(Channel(name="x", values=time),), time=time)
    with pytest.raises(RecordError, match=r"at 12 Hz, as its sample rate is 10\.\d+ Hz"):
        resample_uniform(record, 12.0)
    for wrong in (0.0, -1.0, np.nan, 1e-9):
        with pytest.raises(RecordError):
            resample_uniform(record, wrong)
    lost = "time (s),u\n0,1\n0.5,2\n1,3\n2.0,4\n2.5,5\n"
    refuse(text(tmp_path, lost), "use the option resample")
    assert read_record(text(tmp_path, lost), largest_step=LARGEST_UNEVEN_STEP).size == 5
    far = "time (s),u\n0,1\n0.5,2\n1,3\n2.5,4\n3.0,5\n"
    refuse(text(tmp_path, far), "gap of 1.5 s.*option rows$", largest_step=LARGEST_UNEVEN_STEP)


def test_numbers_of_samples_are_kept(tmp_path: Path) -> None:
    path = text(tmp_path, "u\n" + "\n".join(str(i * i % 11) for i in range(40)))
    whole = read_record(path, sample_rate=5.0)
    assert whole.numbers is None
    part = read_record(path, sample_rate=5.0, rows=(7, 30))
    assert part.numbers is not None
    assert part.numbers.tolist() == list(range(7, 30))
    with pytest.raises(RecordError, match="needs a number"):
        Record(channels=part.channels, time=part.time, numbers=part.numbers[1:])


def test_a_unit_stands_behind_a_column(tmp_path: Path) -> None:
    path = text(tmp_path, "pos um,pos,t\n1,2,0\n3,4,5\n6,8,10\n")
    record = read_record(path, columns=["pos um", "1 mm"], time="t ms")
    assert [c.unit for c in record.channels] == ["", "m", "s"]  # a name goes before a unit
    assert values(record, "pos um", "pos") == [[1.0, 3.0, 6.0], [2e-3, 4e-3, 8e-3]]
    assert record.channel("1 mm") is record.channel("pos")
    assert record.time.tolist() == [0.0, 5e-3, 10e-3]
    plain = text(tmp_path, "pos,t\n2,0\n4,5\n8,10\n")
    assert values(read_record(plain, columns=["pos um"], time="t ms"), 0) == [[2e-6, 4e-6, 8e-6]]
    refuse(plain, "'pos': unknown unit 'parsec'", columns=["pos parsec"], sample_rate=2.0)
    refuse(plain, "no column 'posn um'", columns=["posn um"], sample_rate=2.0)
    refuse(plain, "no column 'pos 7'", columns=["pos 7"], sample_rate=2.0)
    refuse(plain, "has two units", columns=["pos um", "0 mm"], sample_rate=2.0)


def test_a_word_behind_a_column_is_its_unit_or_no_such_column(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("voltage [V],position [um]\n0,1\n1,2\n")
    record = read_record(tmp_path / "r.csv", over="point")
    assert record.channel("position um") is record.channel("position")
    (tmp_path / "a.csv").write_text("force,acceleration\n0,1\n1,2\n")
    shaken = read_record(tmp_path / "a.csv", columns=["force N", "acceleration g"], over="point")
    assert shaken.channel("acceleration g").values == pytest.approx([9.80665, 19.6133])
    for wrong in ("position filtered", "voltage as sent"):
        with pytest.raises(RecordError, match=f"no column '{wrong}'"):
            record.channel(wrong)


def test_a_complex_column_whose_name_ends_in_a_unit_is_taken_whole(tmp_path: Path) -> None:
    rows = "\n".join(f"{f},{1 / f},{-f}" for f in (10.0, 20.0, 30.0))
    (tmp_path / "h.csv").write_text(f"frequency,sensor A real,sensor A imaginary\n{rows}\n")
    table = read_record(tmp_path / "h.csv", over="point")
    parts = responses_in_columns(table, ["frequency", "sensor A"])
    assert [c.name for c in parts.channels] == ["sensor A real", "sensor A imaginary"]
    assert parts.channels[0].values == pytest.approx([0.1, 0.05, 1 / 30])
