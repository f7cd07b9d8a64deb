"""Universal files, arrays of controllers and reports of measuring machines, and what is read.

Evidence (Measuring and centring): universal files (pyuff): exact
"""

import re
from pathlib import Path

import numpy as np
import pytest
import pyuff

from flexstage.base.errors import RecordError
from flexstage.records import FORMATS, Channel, Record, read_record, write_record
from flexstage.records.cmm import decimal_sign, printed_number
from flexstage.records.columns import measured_unit
from flexstage.records.quality import require_live, require_unclipped
from flexstage.records.universal_sets import ValueLayout, decoded_values
from flexstage.records.write import record_bytes
from tests.measuring_files import function_58, gcs_array, report, units_164

H = np.array([0.3 - 1.7j, 2.9 + 0.4j, -1.1 + 0.2j, 5.3 - 2.25j, 7.5 + 0.0625j])
A = np.array([0.3125, -1.75, 2.90625, 0.4375, -1.125, 0.25, 5.5])


def saved(folder: Path, content: str | bytes, name: str = "file.dat") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def values(record: Record, *columns: str | int) -> list[list[float]]:
    return [record.channel(c).values.tolist() for c in columns]


# ------------------------------------------------------------------ universal file


@pytest.mark.parametrize("newline", [b"\n", b"\r\n"])
@pytest.mark.parametrize("binary", ["", "<", ">"])
@pytest.mark.parametrize("double", [True, False])
@pytest.mark.parametrize("uneven", [True, False])
def test_functions_by_hand(
    tmp_path: Path, newline: bytes, binary: str, double: bool, uneven: bool
) -> None:
    x = [1.5, 2.25, 4.0, 7.5, 15.0] if uneven else None
    # numbers that single precision and the printed digits hold
    h = np.array([0.375 - 1.75j, 2.5 + 0.5j, -1.125 + 0.25j, 5.25 - 2.25j, 7.5 + 0.0625j])
    content = function_58(
        h, x=x, start=3.0, step=0.25, double=double, binary=binary, newline=newline
    ) + function_58(
        h.real,
        x=x,
        start=3.0,
        step=0.25,
        double=double,
        binary=binary,
        response=(7, -5),
        kind=6,
        newline=newline,
    )
    record = read_record(saved(tmp_path, content, "frf.uff"))
    assert record.over == "frequency"
    assert record.time.tolist() == (x or [3.0, 3.25, 3.5, 3.75, 4.0])
    name = "12:+z/3:-x"
    assert [(c.name, c.unit) for c in record.channels] == [
        (f"{name} real", "m/s^2/N"),
        (f"{name} imaginary", "m/s^2/N"),
        ("coherence 7:-ry/3:-x", "1"),
    ]
    assert values(record, 0, 1, 2) == [h.real.tolist(), h.imag.tolist(), h.real.tolist()]
    said = {
        key.removesuffix(f" of {name}"): v for key, v in record.attributes.items() if name in key
    }
    assert said == {
        "kind": "frequency response function",
        "output": "12:+z",
        "input": "3:-x",
        "output unit": "m/s^2",
        "input unit": "N",
        "title": "hammer on the frame",
        "date": "04-Mar-21 10:00:00",
    }


def test_numbers_of_text_may_touch() -> None:
    """Columns of fixed width part numbers where a sign takes the last space between them."""
    layout = ValueLayout(count=3, double=True, is_complex=False, uneven=True)
    content = b""
    for k, (x, v) in enumerate([(1.5, -1.125), (2.25, -2.5), (4.0, -7.0)]):
        content += f"{x:13.5E}{v:20.13E}".encode() + (b"\n" if k % 2 else b"")
    assert decoded_values(content, layout).tolist() == [[1.5, -1.125], [2.25, -2.5], [4.0, -7.0]]


def test_uneven_double_binary_with_either_abscissa(tmp_path: Path) -> None:
    x = [1.5, 2.25, 4.0, 7.5, 15.0]
    for single in (True, False):
        content = function_58(H, x=x, binary="<", single_x=single)
        record = read_record(saved(tmp_path, content, "a.ufb"))
        assert record.time.tolist() == x
        assert values(record, 0, 1) == [H.real.tolist(), H.imag.tolist()]


# the other library leaves the files open that it writes binary
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("even", [0, 1])
@pytest.mark.parametrize("of_complex", [True, False])
def test_functions_by_another_library(
    tmp_path: Path, binary: int, even: int, of_complex: bool
) -> None:
    path = tmp_path / "a.unv"
    data = H if of_complex else H.real
    written = []
    for node in (12, 7):
        written.append(
            pyuff.prepare_58(
                binary=binary, func_type=4, rsp_node=node, rsp_dir=3, ref_node=3, ref_dir=1,
                data=node * data, x=2.5 + 0.125 * np.arange(5), id1="sweep", rsp_ent_name="NONE",
                ref_ent_name="NONE", abscissa_spacing=even, abscissa_spec_data_type=18,
                ordinate_spec_data_type=8, orddenom_spec_data_type=13,
                ordinate_axis_units_lab="um", orddenom_axis_units_lab="N",
            )
        )  # fmt: skip
    pyuff.UFF(str(path)).write_sets(written)
    record = read_record(path)
    peers = pyuff.UFF(str(path)).read_sets()
    for node, peer in zip((12, 7), peers, strict=True):
        parts = [f"{node}:+z/3:+x"]
        parts = [f"{parts[0]} real", f"{parts[0]} imaginary"] if of_complex else parts
        for part, wanted in zip(parts, (peer["data"].real, peer["data"].imag), strict=False):
            assert record.channel(part).unit == "m/N"
            np.testing.assert_array_equal(record.channel(part).values, wanted / 1e6)
        np.testing.assert_array_equal(record.time, peer["x"])


def test_time_data_even_and_uneven(tmp_path: Path) -> None:
    kind = {"kind": 1, "abscissa": (17, "s"), "denominator": (0, ""), "reference": (0, 0)}
    content = function_58(A, start=-0.5, step=0.004, ordinate=(8, "mm"), **kind)
    content += function_58(
        2 * A, start=-0.5, step=0.004, ordinate=(12, "g"), response=(4, -1), **kind
    )
    record = read_record(saved(tmp_path, content, "t.uff"))
    assert record.over == "time"
    assert record.sample_rate_hz == pytest.approx(250.0, rel=1e-12)
    np.testing.assert_allclose(record.time, -0.5 + 0.004 * np.arange(7), atol=1e-15)
    assert [(c.name, c.unit) for c in record.channels] == [("12:+z", "m"), ("4:-x", "m/s^2")]
    np.testing.assert_allclose(record.channel(0).values, A * 1e-3, rtol=1e-15)
    # the acceleration of gravity, and no gram
    np.testing.assert_allclose(record.channel(1).values, 2 * A * 9.80665, rtol=1e-15)
    part = read_record(tmp_path / "t.uff", rows=(2, 5))
    np.testing.assert_allclose(part.time, [-0.492, -0.488, -0.484], atol=1e-15)
    x = [0.0, 1.0, 2.5, 3.0, 4.5, 5.0, 6.5]
    content = function_58(A, x=x, ordinate=(8, ""), **{**kind, "abscissa": (17, "ms")})
    record = read_record(saved(tmp_path, content, "u.uff"), units={"12:+z": "um"})
    np.testing.assert_allclose(record.time, np.array(x) * 1e-3, rtol=1e-15)
    assert record.channel("12:+z").unit == "m"


@pytest.mark.parametrize(
    ("ordinate", "denominator", "unit", "factor"),
    [
        ((12, "m/s^2"), (13, "N"), "m/s^2/N", 1.0),
        ((12, "mm/s^2"), (13, "mN"), "m/s^2/N", 1.0),
        ((12, "g"), (13, "kN"), "m/s^2/N", 9.80665e-3),
        ((8, "um"), (0, "V"), "m/V", 1e-6),
        ((8, "um/N"), (0, ""), "m/N", 1e-6),
        ((12, "(m/s^2)/N"), (0, ""), "m/s^2/N", 1.0),
        ((12, "(m/s^2)/N"), (13, "N"), "m/s^2/N", 1.0),
        ((8, "nm"), (12, "m/s^2"), "m/(m/s^2)", 1e-9),
        ((11, "m/s"), (0, ""), "", 1.0),
        ((12, ""), (13, ""), "", 1.0),
        ((12, "EU"), (13, "N"), "", 1.0),
        ((0, "g"), (13, "N"), "", 1.0),
        ((8, "um"), (8, "mm"), "1", 1e-3),
    ],
)
def test_units_of_a_response(
    tmp_path: Path, ordinate: tuple, denominator: tuple, unit: str, factor: float
) -> None:
    content = function_58(H, ordinate=ordinate, denominator=denominator)
    record = read_record(saved(tmp_path, content, "a.uff"))
    assert {c.unit for c in record.channels} == {unit}
    np.testing.assert_allclose(record.channel(0).values, H.real * factor, rtol=1e-15)
    given = read_record(tmp_path / "a.uff", units={"12:+z/3:-x": "um/N"})
    assert {c.unit for c in given.channels} == {"m/N"}
    np.testing.assert_allclose(given.channel(1).values, H.imag * 1e-6, rtol=1e-15)


def test_the_units_of_the_file_stand_in_for_labels(tmp_path: Path) -> None:
    content = units_164(1000.0, 0.5)
    content += function_58(H, ordinate=(12, ""), denominator=(13, ""))
    content += function_58(H, ordinate=(8, ""), denominator=(13, "N"), response=(4, 5))
    content += function_58(H, ordinate=(11, "um/s"), denominator=(13, ""), reference=(4, 6))
    record = read_record(saved(tmp_path, content, "a.uff"))
    wanted = {
        # accelerations in mm/s^2, forces in units of 2 N
        "12:+z/3:-x": ("m/s^2/N", 1e-3 / 2.0),
        "4:+ry/3:-x": ("rad/N", 1.0),
        # a moment of force and length
        "12:+z/4:+rz": ("m/s/(N*m)", 1e-6 / 2e-3),
    }
    assert wanted["12:+z/4:+rz"]
    for name, (unit, factor) in wanted.items():
        channel = record.channel(f"{name} real")
        assert channel.unit.replace("(", "").replace(")", "") == unit.replace("(", "").replace(
            ")", ""
        )
        np.testing.assert_allclose(channel.values, H.real * factor, rtol=1e-14)


def test_spectra_of_power_are_left_without_a_unit(tmp_path: Path) -> None:
    for kind, name in ((2, "auto spectrum"), (9, "power spectral density")):
        content = function_58(A, kind=kind, denominator=(0, ""), reference=(0, 0))
        record = read_record(saved(tmp_path, content, "a.uff"))
        assert record.over == "frequency"
        assert [(c.name, c.unit) for c in record.channels] == [(f"{name} 12:+z", "")]


def test_the_abscissa_of_known_kinds_need_not_be_said(tmp_path: Path) -> None:
    content = function_58(A, kind=1, abscissa=(0, ""), denominator=(0, ""), reference=(0, 0))
    assert read_record(saved(tmp_path, content, "a.uff")).over == "time"
    content = function_58(H, abscissa=(0, ""))
    assert read_record(saved(tmp_path, content, "a.uff")).over == "frequency"
    content = function_58(H, step=0.25, abscissa=(18, "kHz"))
    assert read_record(saved(tmp_path, content, "a.uff")).time.tolist() == [0, 250, 500, 750, 1000]


def test_functions_are_chosen(tmp_path: Path) -> None:
    content = b"".join(
        function_58(k * H, response=(k, 1), step=0.5 if k < 4 else 0.75) for k in (1, 2, 3, 4, 5)
    )
    content += function_58(7 * H, response=(5, 1), step=0.75)
    path = saved(tmp_path, content, "a.uff")
    with pytest.raises(RecordError) as caught:
        read_record(path)
    for said in (
        "0: 1:+x/3:-x (5 samples from 0 to 2 Hz) and 3: 4:+x/3:-x (5 samples from 0 to 3 Hz)",
        "option dataset, of 0: 1:+x/3:-x, 1: 2:+x/3:-x",
        "5: 5:+x/3:-x #5",
    ):
        assert said in str(caught.value)
    for dataset, first in (
        ("0-2", [1, 2, 3]),
        ("4:+x/3:-x", [4]),
        ("3,5", [4, 7]),
        ("5, 4", [7, 5]),
    ):
        record = read_record(path, dataset=dataset)
        found = [c.values[0] / H.real[0] for c in record.channels[::2]]
        np.testing.assert_allclose(found, first, rtol=1e-12)
    for dataset in ("6", "7:+x/3:-x", "0-9", "", "2-1", "-1"):
        with pytest.raises(RecordError, match=r"(is no function|selects no function).*0: 1:\+x"):
            read_record(path, dataset=dataset)


def test_a_function_of_minus_ones_and_of_closing_lines(tmp_path: Path) -> None:
    # what closes a data set, within its title and within its binary numbers
    trap = np.frombuffer(b"\n    -1\n\n    -1\n", dtype="<f8")[:1]
    data = np.concatenate([[-1.0], trap, [-1.0, 2.5]])
    content = function_58(data, binary="<", title="    -1", kind=12, denominator=(0, ""))
    content += function_58(A[:4], kind=6)
    record = read_record(saved(tmp_path, content, "a.uff"))
    assert record.channel(0).values.tobytes() == data.tobytes()
    assert record.channel(1).values.tolist() == A[:4].tolist()


def test_text_of_other_writers(tmp_path: Path) -> None:
    plain = function_58(A, kind=6, step=0.5)
    for change in (
        lambda c: c.replace(b"E+00", b"D+00").replace(b"E-01", b"D-01"),
        # lines filled up with spaces
        lambda c: b"\n".join(line.ljust(80) for line in c.split(b"\n")[:-1]) + b"\n",
        # other data sets around it, and blank lines
        lambda c: (
            b"\n    -1\n   151\nmodel\nnone\n    -1\n" + c + b"\n    -1\n  2411\n 1 2\n    -1\n"
        ),
        # numbers with spaces between, in lines of another length
        lambda c: (
            c[: c.index(b"  3.125")]
            + b"\n".join(f"{v!r} ".encode() for v in A.tolist())
            + b"\n    -1\n"
        ),
    ):
        content = change(plain)
        assert content != plain
        record = read_record(saved(tmp_path, content, "a.uff"))
        assert values(record, 0) == [A.tolist()]


def test_a_universal_file_is_known_by_its_content(tmp_path: Path) -> None:
    content = function_58(H)
    for name in ("a.txt", "a.dat", "a", "a.uff", "a.UNV"):
        assert read_record(saved(tmp_path, content, name)).over == "frequency"
    with pytest.raises(RecordError, match="is over frequency, without times"):
        read_record(tmp_path / "a.uff", sample_rate=200.0)
    with pytest.raises(RecordError, match="not a text file"):
        read_record(tmp_path / "a.uff", text="decimal=,")
    assert read_record(tmp_path / "a.uff", over="point").over == "frequency"
    assert set(FORMATS) >= {"universal", "gcs", "cmm"}


# ------------------------------------------------------------------ arrays of GCS controllers


ROWS = [[0.25, 100.5], [0.5, 101.25], [0.75, -3.125], [1.125, 17.0]]
NAMES = ["Target Position of axis X", "Current Position of axis X"]


@pytest.mark.parametrize("code", [32, 9, 44, 59])
@pytest.mark.parametrize("name", ["a.gcs", "a.dat", "a.txt", "a"])
def test_an_array_of_a_controller(tmp_path: Path, code: int, name: str) -> None:
    path = saved(tmp_path, gcs_array(ROWS, NAMES, 0.0004, SEPARATOR=code), name)
    record = read_record(path, units={"1": "um"})
    assert record.over == "time"
    assert record.sample_rate_hz == pytest.approx(2500.0, rel=1e-12)
    assert [(c.name, c.unit) for c in record.channels] == [(NAMES[0], ""), (NAMES[1], "m")]
    assert values(record, 0) == [[row[0] for row in ROWS]]
    np.testing.assert_allclose(record.channel(1).values, [r[1] * 1e-6 for r in ROWS], rtol=1e-15)
    assert record.attributes["TYPE"] == "1"
    assert any("SAMPLE_TIME" in note for note in record.notes)


def test_keys_that_may_be_missing(tmp_path: Path) -> None:
    path = saved(tmp_path, gcs_array(ROWS, NAMES, 0.1, SAMPLE_TIME=None, NDATA=None))
    with pytest.raises(RecordError, match="has no times of its samples"):
        read_record(path)
    record = read_record(path, sample_rate=50.0)
    assert record.sample_rate_hz == 50.0
    assert "the heading has no number of rows" in record.notes
    assert read_record(path, over="point").time.tolist() == [0.0, 1.0, 2.0, 3.0]
    # a rate of its own is kept
    path = saved(tmp_path, gcs_array(ROWS, NAMES, 0.1))
    assert read_record(path, over="point").over == "time"


def test_comments_are_no_array(tmp_path: Path) -> None:
    record = read_record(saved(tmp_path, "# DIM = 2\n# t (s), u (V)\n0 1\n1 2\n"))
    assert [c.name for c in record.channels] == ["t", "u"]


# ------------------------------------------------------------------ measuring machines

POINTS = [
    [
        ("SPH1", [("X", 10.0, 10.0012), ("Y", -25.5, -25.5031), ("Z", 1204.25, 1204.2493)]),
        ("SPH2", [("X", 70.5, 70.5007), ("Y", -25.5, -25.4986)]),
    ],
    [
        ("SPH1", [("X", 10.5, 10.5019), ("Y", -25.5, -25.5044), ("Z", 1204.25, 1204.2471)]),
        ("SPH2", [("X", 71.0, 71.0018), ("Y", -25.5, -25.4979)]),
    ],
    [
        ("SPH1", [("X", 11.0, 11.0003), ("Y", -25.5, -25.5058), ("Z", 1204.25, 1204.2466)]),
        ("SPH2", [("X", 71.5, 71.5027), ("Y", -25.5, -25.4995)]),
    ],
]
SERIES = {
    "SPH1.X": [10.0012, 10.5019, 11.0003],
    "SPH1.X nominal": [10.0, 10.5, 11.0],
    "SPH1.Y": [-25.5031, -25.5044, -25.5058],
    "SPH1.Y nominal": [-25.5] * 3,
    "SPH1.Z": [1204.2493, 1204.2471, 1204.2466],
    "SPH1.Z nominal": [1204.25] * 3,
    "SPH2.X": [70.5007, 71.0018, 71.5027],
    "SPH2.X nominal": [70.5, 71.0, 71.5],
    "SPH2.Y": [-25.4986, -25.4979, -25.4995],
    "SPH2.Y nominal": [-25.5] * 3,
}


def same_series(record: Record, factor: float = 1000.0) -> None:
    assert record.over == "point"
    assert record.time.tolist() == [0.0, 1.0, 2.0]
    assert [c.name for c in record.channels] == list(SERIES)
    for name, wanted in SERIES.items():
        channel = record.channel(name)
        assert channel.unit == ("m" if factor else "")
        assert channel.values.tolist() == [w / factor if factor else w for w in wanted]


@pytest.mark.parametrize(
    "layout",
    [
        {},
        {"order": ["MEAS", "NOMINAL", "+TOL", "-TOL", "DEV", "OUTTOL"]},
        {"order": ["NOMINAL", "MEAS"]},
        {"order": ["+TOL", "DEV", "MEAS", "-TOL", "NOMINAL"]},
        {"width": 1 + 10, "digits": 5},
        {"opening": "DIM #2LOC{number}= LOCATION OF SPHERE {feature}  UNITS={unit}"},
        {"opening": "DIM LOC{number}= LOCATION OF SPHERE {feature}  UNITS={unit},$\nGRAPH=OFF"},
        {"opening": "DIM LOC{number}= LOCATION OF SPHERE {feature} ,$\n  UNITS={unit}  TEXT=OFF"},
        {"opening": "#3 FCFLOC{number} = POSITION OF {feature}    FIT TO DATUMS=ON  UNITS={unit}"},
        {"opening": "DIM L{number}= POSITION OF SPHERE {feature} USE AXIS=AVERAGE UNITS={unit}"},
        {"decimal": ","},
    ],
)
@pytest.mark.parametrize("wide", [True, False])
def test_a_text_report(tmp_path: Path, layout: dict, wide: bool) -> None:
    content = report(POINTS, **layout)
    if not wide:
        # spaces lost, as by copying from a window
        opening = re.compile(r"(?m)^(?!DIM|#).*$")
        content = opening.sub(lambda line: re.sub(" +", " ", line[0]), content)
    same_series(read_record(saved(tmp_path, content, "report.txt")))
    same_series(read_record(saved(tmp_path, content.encode("utf-16"), "report.TXT")))
    same_series(read_record(saved(tmp_path, content.encode("latin-1"), "report")))
    assert read_record(tmp_path / "report", dataset="SPH2").channel(0).name == "SPH2.X"


def test_inches_and_a_unit_that_is_not_said(tmp_path: Path) -> None:
    path = saved(tmp_path, report(POINTS, unit="IN"))
    np.testing.assert_allclose(
        read_record(path).channel("SPH1.X").values, np.array(SERIES["SPH1.X"]) * 0.0254, rtol=1e-15
    )
    path = saved(tmp_path, report(POINTS, opening="DIM LOC{number}= LOCATION OF SPHERE {feature}"))
    same_series(read_record(path), 0.0)
    same_series(read_record(path, units={"length": "mm"}))
    same_series(read_record(path, units={"length": "mm"}, columns=["length"], over="point"))
    with pytest.raises(RecordError, match="has two units"):
        read_record(path, units={"length": "mm", "SPH1.X": "um"})
    with pytest.raises(RecordError, match="its rows are points, without times"):
        read_record(path, sample_rate=2.0)
    below = len(report(POINTS[:1]).splitlines()) - 1
    assert read_record(path, text={"skip": below}).channel("SPH1.X").values.tolist() == [
        10.5019, 11.0003,
    ]  # fmt: skip
    with pytest.raises(RecordError, match="there is no feature 'SPH3': the report has SPH1, SPH2"):
        read_record(path, dataset="SPH1, SPH3")


BLANKS = """
PART NAME  : PLATE
DIM #4 LOC1= LOCATION OF CYLINDER CYL5  USE AXIS=AVERAGE  REF LENGTH=0.000  UNITS=MM
AX    NOMINAL       +TOL       -TOL      BONUS       MEAS        DEV     OUTTOL
X    -117.000                                    -117.0{0}     -0.0{0}
PART NUMBER=PLATE    DATE=17-Sep-21     TIME=10:09:15 AM           PAGE#=4
Y     -12.000                                     -11.980      0.020
DF     12.500      0.200      0.200      0.220     12.520      0.020      0.000 ----#----
D1     12.000      0.250      0.250                12.065 CIRCLE CIR8 AT RFS
TP        RFS      0.400                 0.000      0.083       0.083      0.000 -#-------
DIM FLAT1= FLATNESS OF PLANE PLN2  UNITS=MM
AX    NOMINAL       +TOL       -TOL       MEAS        DEV     OUTTOL
M        0.000      0.500      0.000      0.0{0}      0.0{0}      0.000 #--------
Page 1 of 2
DIM LOC2= LOCATION OF CIRCLE CIR3  UNITS=MM
AX    NOMINAL       +TOL       -TOL       MEAS        DEV     OUTTOL
R       25.000      0.500      0.000     25.0{0}      0.0{0}      0.000 #--------
A      -30.000      0.500      0.000    -30.0{0}      0.0{0}      0.000 #--------
D        6.000      0.500      0.000      6.0{0}      0.0{0}      0.000 #--------
END OF DIMENSION LOC2
"""


def test_empty_cells_other_rows_and_angles(tmp_path: Path) -> None:
    path = saved(tmp_path, BLANKS.format(12) + BLANKS.format(14))
    record = read_record(path)
    assert [c.name for c in record.channels[::2]] == [
        "CYL5.X",
        "CYL5.Y",
        "FLAT1.M",
        "CIR3.R",
        "CIR3.A",
        "CIR3.D",
    ]
    assert values(record, "CYL5.X", "CYL5.Y", "FLAT1.M") == [
        [-117.012 / 1000, -117.014 / 1000],
        [-11.98 / 1000] * 2,
        [0.012 / 1000, 0.014 / 1000],
    ]
    assert record.channel("CIR3.A").unit == "rad"
    np.testing.assert_allclose(
        record.channel("CIR3.A").values, np.radians([-30.012, -30.014]), rtol=1e-15
    )
    assert record.channel("CIR3.D").unit == "m"
    assert "skipped rows that are no coordinates: D1, DF, TP" in record.notes


@pytest.mark.parametrize(
    ("words", "axis_word", "opening"),
    [
        (
            {"NOMINAL": "SOLL", "MEAS": "IST", "DEV": "ABW", "OUTTOL": "AUSTOL"},
            "ACHSE",
            "DIM LAG{number}= LAGE VON KUGEL {feature}  EINHEIT={unit}",
        ),
        (
            {"NOMINAL": "THEO", "MEAS": "REEL", "DEV": "ECART", "OUTTOL": "HORSTOL"},
            "AXE",
            "DIM LOC{number}= LOCALISATION DE SPHERE {feature}  UNITE={unit}",
        ),
    ],
)
def test_a_report_in_another_language_is_refused(
    tmp_path: Path, words: dict, axis_word: str, opening: str
) -> None:
    """Its numbers stand between words, and are never read as columns of a table."""
    content = report(POINTS, words=words, axis_word=axis_word, opening=opening, decimal=",")
    path = saved(tmp_path, content, "report.txt")
    with pytest.raises(RecordError, match=r"'L[AO][GC]2=' is not a number"):
        read_record(path)
    with pytest.raises(RecordError, match=r"of PC-DMIS in English, .* export a table"):
        read_record(path, format="cmm")


@pytest.mark.parametrize(
    ("numbers", "sign"),
    [
        (["10.000", "0.012"], "."),
        (["10.000", "-25.500"], "."),
        (["10,000", "0,012"], ","),
        (["10,0012"], ","),
        (["1,234.5"], "."),
        (["1.234,5", "12,0012"], ","),
        (["1.234.567", "10,5"], ","),
        (["1,234,567"], "."),
        (["1'234,5"], ","),
        (["17", "-3"], "."),
    ],
)
def test_the_decimal_sign(numbers: list[str], sign: str) -> None:
    assert decimal_sign(enumerate(numbers, start=1)) == sign


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        (
            ["10,000", "12,500"],
            "line 1: the comma in '10,000' may be a decimal sign or a thousands separator",
        ),
        (["10,0012", "0.05"], "'0.05' in line 2 has a decimal point, '10,0012' in line 1"),
        (["10,0012", "1.234"], "line 2: '1.234' has a thousands separator"),
        (["1,234", "0.05"], "line 1: '1,234' has a thousands separator"),
        (["1.234", "1,234"], "the comma in '1,234' may be a decimal sign or a thousands separator"),
    ],
)
def test_a_decimal_sign_that_is_not_clear(numbers: list[str], said: str) -> None:
    with pytest.raises(RecordError, match=re.escape(said)):
        decimal_sign(enumerate(numbers, start=1))


def test_printed_numbers() -> None:
    for text, sign, wanted in (
        ("-1.234,5", ",", -1234.5),
        ("1,234", ".", 1234.0),
        ("+.5", ".", 0.5),
        ("7.", ".", 7.0),
        ("1'234.25", ".", 1234.25),
        ("1\u202f234,25", ",", 1234.25),
        ("2,5E-3", ",", 0.0025),
        ("-0.0", ".", 0.0),
    ):
        assert printed_number(text, sign, "line 1") == wanted
    for text, sign in (
        ("0,025", "."), ("1,23", "."), ("1.2.3", "."), ("12,3456,7", "."), ("", "."), (".", "."),
        ("nan", "."), ("0x1", "."), ("1_0", "."), ("--", "."),
        ("1.2345", ","), ("1,5", "."),
    ):  # fmt: skip
        with pytest.raises(RecordError, match=r"line 1: .* is not a number"):
            printed_number(text, sign, "line 1")


# ------------------------------------------------------------------ points, units, checks


def test_rows_of_any_text_are_points_if_asked(tmp_path: Path) -> None:
    path = saved(tmp_path, "time (s),x (um)\n0.5,3.25\n0.25,4.5\n0.75,7\n", "a.csv")
    record = read_record(path, over="point", rows=(1, None))
    assert record.over == "point"
    assert record.time.tolist() == [0.0, 1.0]
    np.testing.assert_allclose(record.channel("x").values, [4.5e-6, 7e-6], rtol=1e-15)
    with pytest.raises(RecordError, match="goes back"):
        read_record(path)
    with pytest.raises(RecordError, match="its rows are points, without times"):
        read_record(path, over="point", time="time")
    with pytest.raises(RecordError, match="over time or point, got 'order'"):
        read_record(path, over="order")  # type: ignore[arg-type]
    back = tmp_path / "b.csv"
    write_record(record, back)
    again = read_record(back, over="point")
    assert [c.name for c in again.channels] == ["time", "x"]
    assert values(again, "x") == values(record, "x")
    assert record_bytes(again, "npz") == record_bytes(record, "npz")


def test_a_record_over_frequency_is_not_written_as_one_over_time(tmp_path: Path) -> None:
    record = read_record(saved(tmp_path, function_58(H), "a.uff"))
    with pytest.raises(RecordError, match="over frequency cannot be written"):
        record_bytes(record, "csv")


@pytest.mark.parametrize(
    ("text", "factor", "unit"),
    [
        ("um", 1e-6, "m"),
        ("um/N", 1e-6, "m/N"),
        ("(mm/s^2)/N", 1e-3, "m/s^2/N"),
        ("m/(m/s^2)", 1.0, "m/(m/s^2)"),
        ("V/V", 1.0, "1"),
        ("um/V", 1e-6, "m/V"),
    ],
)
def test_units_of_quotients(text: str, factor: float, unit: str) -> None:
    found = measured_unit(text)
    assert found == (pytest.approx(factor, rel=1e-15), unit)
    # what it returns is understood again
    assert measured_unit(unit) == (1.0, unit)


def make(**columns: tuple[np.ndarray, str]) -> Record:
    channels = tuple(Channel(name=n, values=v, unit=u) for n, (v, u) in columns.items())
    return Record(channels=channels, time=np.arange(channels[0].values.size) / 100.0)


def test_clipped_and_dead() -> None:
    t = np.arange(400) / 57.0
    sine = 1.37 * np.sin(t)
    record = make(
        good=(sine, "m"),
        high=(np.minimum(sine, 0.9), "m"),
        low=(np.maximum(sine, -0.7), ""),
        dead=(np.full(400, 0.125), "V"),
    )
    require_unclipped(record, ["good", "dead"])
    require_live(record, ["good", 1, 2])
    with pytest.raises(
        RecordError, match=r"column 'high' is clipped at 0.9 m \(\d+ of 400 samples\)"
    ):
        require_unclipped(record, ["good", "high"])
    with pytest.raises(RecordError, match=r"column 'low' is clipped at -0.7 \("):
        require_unclipped(record, [2])
    with pytest.raises(RecordError, match=r"column 'dead' is 0.125 V in all of its 400 samples"):
        require_live(record, ["good", "dead"])
    with pytest.raises(RecordError, match="no column 'none'"):
        require_live(record, ["none"])
