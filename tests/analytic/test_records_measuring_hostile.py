"""Broken files of test systems, controllers and measuring machines: one clear sentence each."""

import contextlib
import re
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import RecordError
from flexstage.records import Record, read_record
from tests.measuring_files import function_58, gcs_array, report, units_164

H = np.array([0.375 - 1.75j, 2.5 + 0.5j, -1.125 + 0.25j, 5.25 - 2.25j])
TEXT = function_58(H)
BINARY = function_58(H, binary="<")
UNEVEN = function_58(H, x=[1.0, 2.0, 4.0, 8.0], double=False)
ARRAY = gcs_array([[0.25, 100.5], [0.5, 101.25], [0.75, 17.5]], ["command", "position"], 0.004)
POINT = [("SPH1", [("X", 10.0, 10.0012), ("Y", -25.5, -25.5031)]), ("SPH2", [("X", 7.5, 7.4963)])]
REPORT = report([POINT, POINT])


def replaced(content: str | bytes, old: str, new: str, count: int = 1) -> bytes:
    data = content if isinstance(content, bytes) else content.encode()
    assert old.encode("latin-1") in data, old
    return data.replace(old.encode("latin-1"), new.encode("latin-1"), count)


FILES: dict[str, tuple[str, bytes, str]] = {
    # universal files: name, content, what is said
    "uff empty": ("a.uff", b"", "opens a data set"),
    "uff junk": ("a.uff", bytes(range(256)) * 9, "no line '    -1' opens a data set"),
    "uff text": ("a.uff", b"1 2\n3 4\n", "no line '    -1' opens a data set"),
    "uff tag alone": ("a.uff", b"    -1\n", "must begin with its number"),
    "uff no number": ("a.uff", replaced(TEXT, "    58", "  what"), "got 'what'"),
    "uff no functions": ("a.uff", b"    -1\n   151\nmodel\n    -1\n", "no function (data set 58)"),
    "uff heading cut": ("a.uff", TEXT[:400], "data set 1 (58): its heading is truncated"),
    "uff values cut": ("a.uff", TEXT[: TEXT.rindex(b"    -1") - 30], "no line '    -1' closes it"),
    "uff unclosed": ("a.uff", TEXT[: TEXT.rindex(b"    -1")], "no line '    -1' closes it"),
    "uff too few values": (
        "a.uff",
        replaced(TEXT, f"{4:10d}{1:10d}", f"{5:10d}{1:10d}"),
        "announces 10 numbers in lines of 4, but the data set has 8",
    ),
    "uff too many values": (
        "a.uff",
        replaced(TEXT, f"{4:10d}{1:10d}", f"{3:10d}{1:10d}"),
        "its heading announces 6 numbers in lines of 4, but the data set has 8",
    ),
    "uff huge count": (
        "a.uff",
        replaced(TEXT, f"{4:10d}{1:10d}", f"2000000000{1:10d}"),
        "4000000000 numbers",
    ),
    "uff beyond count": (
        "a.uff",
        replaced(TEXT, f"{4:10d}{1:10d}", f"9999999999{1:10d}"),
        "at least two",
    ),
    "uff one value": ("a.uff", function_58([0.5 + 1j]), "at least two values"),
    "uff unknown type": (
        "a.uff",
        replaced(TEXT, f"{6:10d}{4:10d}", f"{7:10d}{4:10d}"),
        "of type 7",
    ),
    "uff unknown spacing": (
        "a.uff",
        replaced(TEXT, f"{4:10d}{1:10d}", f"{4:10d}{3:10d}"),
        "spacing 3",
    ),
    "uff count of letters": (
        "a.uff",
        replaced(TEXT, f"{4:10d}{1:10d}", f"{'four':10s}{1:10d}"),
        "is invalid",
    ),
    "uff no step": ("a.uff", function_58(H, step=0.0), "must have a positive step"),
    "uff step back": ("a.uff", function_58(H, step=-0.5), "must have a positive step"),
    "uff step of letters": (
        "a.uff",
        replaced(TEXT, "  5.00000E-01", "  five-Hertz!"),
        "positive step",
    ),
    "uff letters": ("a.uff", replaced(TEXT, "3.75000", "3.x5000"), "letters of no number"),
    "uff hexadecimal": ("a.uff", replaced(TEXT, "3.7500000000", "0x1500000000"), "letters"),
    "uff two points": ("a.uff", replaced(TEXT, "3.7500000000", "3.75.0000000"), "not in columns"),
    "uff a blank value": (
        "a.uff",
        replaced(TEXT, "  3.750000000000E-01", " " * 20),
        "not in columns of the width",
    ),
    "uff NaN": (
        "a.uff",
        replaced(TEXT, "  3.750000000000E-01", f"{'NaN':>20s}"),
        "missing or not a number",
    ),
    "uff direction": (
        "a.uff",
        function_58(H, response=(12, 9)),
        "a direction must be -6 to 6, got 9",
    ),
    "uff points": (
        "a.uff",
        replaced(TEXT, "        12   3", "    twelve   3"),
        "points and directions",
    ),
    "uff axis": ("a.uff", replaced(TEXT, f"{18:10d}", f"{'Hz':10s}"), "line of an axis"),
    "uff frequencies fall": ("a.uff", function_58(H, x=[1.0, 2.0, 2.0, 8.0]), "must rise"),
    "uff frequency infinite": (
        "a.uff",
        function_58(H, x=[1.0, 2.0, 3.0, np.inf], binary="<"),
        "frequency of function '12:+z/3:-x' is not finite",
    ),
    "uff over order": (
        "a.uff",
        function_58(H, abscissa=(20, "")),
        "neither time nor frequency (kind 20)",
    ),
    "uff unit of frequency": (
        "a.uff",
        function_58(H, abscissa=(18, "rpm")),
        "'rpm', which is no unit of frequency",
    ),
    "uff unknown frequency": ("a.uff", function_58(H, abscissa=(18, "lines")), "export it in Hz"),
    "uff time goes back": (
        "a.uff",
        function_58(H.real, x=[0.0, 2.0, 1.0, 3.0], kind=1, abscissa=(17, "s")),
        "goes back",
    ),
    "uff units": ("a.uff", units_164(-1.0, 1.0) + TEXT, "data set 1 (164): the units of the file"),
    "uff second set": ("a.uff", TEXT + TEXT[:-40], "data set 2 (58)"),
    # a set that nothing opens was left out without a word
    "uff second unopened": (
        "a.uff",
        TEXT + TEXT.removeprefix(b"    -1\n") + b"    -1\n     0\n    -1\n",
        "'58?hammer on the frame?NONE?04' is outside of all data sets",
    ),
    "uff first unopened": (
        "a.uff",
        TEXT.removeprefix(b"    -1\n").removesuffix(b"    -1\n") + TEXT,
        "is outside of all data sets",
    ),
    "uff byte order": (
        "a.uff",
        replaced(function_58(0.7 * H.real, binary="<"), "58b     1", "58b     2"),
        "the byte order in the file",
    ),
    "uff end cut off": ("a.uff", TEXT + TEXT[7:90], "is outside of all data sets"),
    "uff two domains": (
        "a.uff",
        TEXT + function_58(H.real, kind=1, abscissa=(17, "s")),
        "have different abscissas",
    ),
    "uff binary cut": ("a.uff", BINARY[:-20], "have 64 bytes, but no line"),
    "uff binary short": (
        "a.uff",
        BINARY[:-16] + b"\n    -1\n",
        "have 64 bytes, but no line",
    ),
    "uff binary count": (
        "a.uff",
        replaced(BINARY, f"{4:10d}{1:10d}", f"{5:10d}{1:10d}"),
        "have 80 bytes",
    ),
    "uff binary single": (
        "a.uff",
        replaced(BINARY, f"{6:10d}{4:10d}", f"{5:10d}{4:10d}"),
        "have 32 bytes",
    ),
    "uff binary uneven": (
        "a.uff",
        replaced(BINARY, f"{4:10d}{1:10d}", f"{4:10d}{0:10d}"),
        "have 80 or 96 bytes",
    ),
    "uff binary of another maker": (
        "a.uff",
        replaced(BINARY, f"{2:6d}{11:12d}", f"{1:6d}{11:12d}"),
        "IEEE 754",
    ),
    "uff binary order": ("a.uff", replaced(BINARY, "58b     1", "58b     3"), "byte order 1 or 2"),
    "uff binary lines": ("a.uff", replaced(BINARY, f"{11:12d}", f"{12:12d}"), "below 11 lines"),
    # arrays of controllers
    "gcs empty": ("a.gcs", b"", "is empty"),
    "gcs heading alone": ("a.gcs", ARRAY[: ARRAY.index("0.25")].encode(), "no numeric rows"),
    "gcs heading cut": ("a.dat", ARRAY[: ARRAY.index("# NAME1")].encode(), "no '# END_HEADER'"),
    "gcs heading unclosed": ("a.dat", replaced(ARRAY, "# END_HEADER \n", ""), "no '# END_HEADER'"),
    "gcs rows cut": (
        "a.dat",
        ARRAY[: ARRAY.index("0.75")].encode(),
        "2 rows of numbers, but the heading has NDATA = 3",
    ),
    "gcs rows more": (
        "a.dat",
        (ARRAY + "1.5 2.5\n").encode(),
        "4 rows of numbers, but the heading",
    ),
    "gcs row cut": (
        "a.dat",
        replaced(ARRAY, " 17.5", ""),
        "line 15 has 1 columns, but the heading has DIM = 2",
    ),
    "gcs row long": ("a.dat", replaced(ARRAY, " 17.5", " 17.5 1"), "line 15 has 3 columns"),
    "gcs narrow": ("a.dat", replaced(ARRAY, "# DIM = 2", "# DIM = 1"), "has DIM = 1"),
    "gcs no width": ("a.dat", replaced(ARRAY, "# DIM = 2 \n", ""), "has no '# DIM = ...'"),
    "gcs width zero": ("a.dat", replaced(ARRAY, "# DIM = 2", "# DIM = 0"), "DIM in the heading"),
    "gcs width word": (
        "a.dat",
        replaced(ARRAY, "# DIM = 2", "# DIM = two"),
        "whole number from 1, got 'two'",
    ),
    "gcs count negative": (
        "a.dat",
        replaced(ARRAY, "NDATA = 3", "NDATA = -3"),
        "NDATA in the heading",
    ),
    "gcs two counts": (
        "a.dat",
        replaced(ARRAY, "# NAME0", "# NDATA = 7\n# NAME0"),
        "has NDATA = 7, but a line above NDATA = 3",
    ),
    "gcs separator": (
        "a.dat",
        replaced(ARRAY, "SEPARATOR = 32", "SEPARATOR = 120"),
        "code of space",
    ),
    "gcs other separator": (
        "a.dat",
        replaced(ARRAY, "SEPARATOR = 32", "SEPARATOR = 44"),
        "has 1 columns",
    ),
    "gcs no time": (
        "a.dat",
        replaced(ARRAY, "0.004000", "0.000000"),
        "positive number of seconds, got '0.000000'",
    ),
    "gcs time word": ("a.dat", replaced(ARRAY, "0.004000", "fast"), "positive number of seconds"),
    "gcs word": ("a.dat", replaced(ARRAY, "101.25", "1O1.25"), "line 14: '1O1.25' is not a number"),
    "gcs underscore": ("a.dat", replaced(ARRAY, "101.25", "101_25"), "'101_25' is not a number"),
    "gcs comma": (
        "a.dat",
        replaced(ARRAY, "101.25", "101,25"),
        "line 14: '101,25' is not a number",
    ),
    "gcs NaN": (
        "a.dat",
        replaced(ARRAY, "101.25", "nan"),
        "'position' is missing or not a number (NaN)",
    ),
    # reports of measuring machines
    "cmm no rows": ("a.txt", REPORT[: REPORT.index("\nX ")].encode(), "no row of an axis"),
    "cmm cut": (
        "a.txt",
        REPORT[: REPORT.rindex("DIM LOC4")].encode(),
        "is measured 2 times and SPH2.X 1 times",
    ),
    "cmm an axis missing": (
        "a.txt",
        (REPORT[: (at := REPORT.rindex("\nY "))] + REPORT[REPORT.index("\n", at + 1) :]).encode(),
        "SPH1.X is measured 2 times and SPH1.Y 1 times",
    ),
    "cmm once": ("a.txt", report([POINT]).encode(), "each feature is measured once"),
    "cmm unknown axis": ("a.txt", replaced(REPORT, "\nY ", "\nQ "), "the axis 'Q' is unknown"),
    "cmm row cut": ("a.txt", REPORT[: REPORT.rindex("7.4963") + 2].encode(), "no deviation value"),
    "cmm no measured": (
        "a.txt",
        REPORT[: REPORT.rindex("7.4963")].encode(),
        "the row of X has no measured value",
    ),
    "cmm word": (
        "a.txt",
        replaced(REPORT, "10.0012", "missing"),
        "'missing' in the row of X is not a number",
    ),
    "cmm unit": ("a.txt", replaced(REPORT, "UNITS=MM", "UNITS=FT"), "the unit 'FT' is unknown"),
    "cmm two units": (
        "a.txt",
        replaced(REPORT, "UNITS=MM", "UNITS=IN"),
        "SPH1.X is in inch and in mm",
    ),
    "cmm no dimension": (
        "a.txt",
        re.sub("DIM.*\n", "", REPORT).encode(),
        "without a dimension above it",
    ),
    "cmm wrong heading": (
        "a.txt",
        replaced(REPORT, "-TOL        MEAS", "MEAS        -TOL"),
        "not measured minus nominal",
    ),
    "cmm digit": (
        "a.txt",
        replaced(REPORT, "10.0012", "10.0021"),
        "the deviation 0.0012 of X is not measured",
    ),
    "cmm two signs": ("a.txt", replaced(REPORT, "10.0012", "10,0012"), "a decimal comma"),
    "cmm thousands": (
        "a.txt",
        report([POINT, POINT], order=["NOMINAL", "MEAS"], digits=3).replace(".", ",").encode(),
        "may be a decimal sign or a thousands separator",
    ),
    "cmm whose feature": (
        "a.txt",
        report([POINT, POINT], opening="DIM L{number}= A=B  UNITS={unit}").encode(),
        "the feature of dimension 'L1' is unclear",
    ),
    "cmm between columns": (
        "a.txt",
        replaced(
            report([POINT, POINT], order=["NOMINAL", "+TOL", "MEAS"], width=20),
            f"{10.0:20.4f}{0.05:20.4f}{10.0012:20.4f}",
            f"{10.0:20.4f}{10.0012:30.4f}",
        ),
        "its 2 numbers are not aligned with the 3 headings",
    ),
    "cmm one column twice": (
        "a.txt",
        replaced(
            report([POINT, POINT], order=["NOMINAL", "+TOL", "MEAS"], width=20),
            f"{10.0:20.4f}{0.05:20.4f}{10.0012:20.4f}",
            f"{1.5:17.1f}{2.5:4.1f}",
        ),
        "its 2 numbers are not aligned with the 3 headings",
    ),
    "cmm row without spaces": ("a.txt", replaced(REPORT, "    -25.5000", "-25.5000"), ""),
}
READ = {"cmm row without spaces"}


@pytest.mark.parametrize("name", [name for name in FILES if name not in READ])
def test_a_broken_file_is_refused_in_one_sentence(
    tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    file, content, said = FILES[name]
    path = tmp_path / file
    path.write_bytes(content)
    with pytest.raises(RecordError, match=re.escape(said)) as caught:
        read_record(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    assert 20 < len(message.replace(str(tmp_path), "")) < 400
    assert capfd.readouterr() == ("", "")


def test_what_looks_broken_and_is_read(tmp_path: Path) -> None:
    def read(name: str) -> Record:
        path = tmp_path / FILES[name][0]
        path.write_bytes(FILES[name][1])
        return read_record(path)

    # a row that is shifted to the left is as wide as the heading
    assert read("cmm row without spaces").channel("SPH1.Y").values[0] == -25.5031 / 1000.0


WHOLE: dict[str, tuple[str, bytes]] = {
    "uff": ("a.uff", TEXT + function_58(2 * H, response=(4, 2))),
    "uff binary": ("a.uff", BINARY + function_58(2 * H, response=(4, 2), binary=">")),
    "uff uneven": ("a.uff", UNEVEN),
    "gcs": ("a.gcs", ARRAY.encode()),
    "report": ("a.txt", REPORT.encode()),
}


@pytest.mark.parametrize("name", WHOLE)
def test_every_cut_is_refused_or_leaves_all_numbers(tmp_path: Path, name: str) -> None:
    file, whole = WHOLE[name]
    path = tmp_path / file
    path.write_bytes(whole)
    wanted = [c.values.tolist() for c in read_record(path).channels]
    random = np.random.default_rng(23)
    for length in sorted(random.choice(len(whole), min(160, len(whole)), replace=False)):
        path.write_bytes(whole[:length])
        try:
            found = [c.values.tolist() for c in read_record(path).channels]
        except RecordError:
            continue
        if name == "gcs":
            # nothing in such a text tells that its very last number has lost digits
            assert len(whole) - length < 8, length
            assert [c[:-1] for c in found] == [c[:-1] for c in wanted]
            continue
        # whole functions before the cut, and never a part of one
        assert found in (wanted, wanted[: len(found)]), length


@pytest.mark.parametrize("name", WHOLE)
@pytest.mark.parametrize("seed", [29, 31])
def test_damaged_bytes_raise_nothing_else(tmp_path: Path, name: str, seed: int) -> None:
    file, whole = WHOLE[name]
    path = tmp_path / file
    random = np.random.default_rng(seed)
    for _ in range(60):
        damaged = bytearray(whole)
        for at in random.integers(0, len(damaged), 4):
            damaged[at] = random.choice([*b" -1.,;=#\n\r\t0989EXYZ\x00\xff\xe9", *range(256)])
        path.write_bytes(damaged)
        with contextlib.suppress(RecordError):
            read_record(path)


def test_long_files_that_lie_are_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "a.uff"
    # a line of many numbers, many closing lines, and a heading as long as the file
    path.write_bytes(TEXT[: TEXT.index(b"  3.75")] + b"1 " * 300_000 + b"\n    -1\n")
    with pytest.raises(RecordError, match="the data set has 300000"):
        read_record(path)
    path.write_bytes(b"    -1\n" * 100_000)
    with pytest.raises(RecordError, match="must begin with its number"):
        read_record(path)
    path.write_bytes(b"    -1\n    58\n" + b"x" * 3_000_000)
    with pytest.raises(RecordError, match="heading is truncated"):
        read_record(path)
    path = tmp_path / "a.txt"
    path.write_text(REPORT + "X " + "1.5 " * 50_000)
    with pytest.raises(RecordError, match="are not aligned with"):
        read_record(path)
    path.write_text("# DIM = 2\n# NDATA = 2\n" + "#\n" * 50_000)
    with pytest.raises(RecordError, match="END_HEADER"):
        read_record(path)
    # long runs of one sign, where a search must not begin anew at each of them
    for content in (
        f"{REPORT}AX NOMINAL MEAS{' ' * 40_000}x\nX 1 2\n",
        f"{REPORT}AX NOMINAL MEAS{' (' * 20_000}\nX 1 2\n",
        f"# DIM = 2\n# NDATA = 2\n# NAME0 = a{' ' * 40_000}b\n1 2\n",
        f"{REPORT}{'a' * 40_000}\nDIM {'=' * 40_000}\n",
    ):
        path.write_text(content)
        with contextlib.suppress(RecordError):
            read_record(path, format="gcs" if content.startswith("#") else "cmm")
