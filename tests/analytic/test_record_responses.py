"""Measured responses as other programs write them: every form gives the same complex values."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from flexstage.base.errors import RecordError
from flexstage.measure.spectra.response import response_from_record
from flexstage.records import Record, read_record, responses_in_columns

F = np.array([110.0, 127.5, 140.0, 163.0, 181.5])
H = 2.3e-6 / (1.0 - (F / 137.0) ** 2 + 0.043j * F / 137.0)
DB, DEG = 20.0 * np.log10(np.abs(H)), np.degrees(np.angle(H))


def rows(*columns: np.ndarray, between: str = ",") -> str:
    return "".join(
        between.join(f"{v:.17g}" for v in row) + "\n" for row in zip(*columns, strict=True)
    )


def table(folder: Path, content: str, name: str = "frf.csv") -> Record:
    file = folder / name
    file.write_text(content)
    return read_record(file, over="point", columns=[])


LAYOUTS = {
    "parts": "frequency (Hz),H real,H imaginary\n" + rows(F, H.real, H.imag),
    "kilohertz": "Freq [kHz];Re(H);Im(H)\n" + rows(F / 1e3, H.real, H.imag, between=";"),
    "megahertz in the name": "freq_MHz\tRe\tIm\n" + rows(F / 1e6, H.real, H.imag, between="\t"),
    "angular": "omega,real,imag\n" + rows(2.0 * np.pi * F, H.real, H.imag),
    "joined words": "Frequency\t Zre\t Zimg\n" + rows(F, H.real, H.imag, between="\t"),
    "minus imaginary": "freq/Hz,Re(Z)/Ohm,-Im(Z)/Ohm\n" + rows(F, H.real, -H.imag),
    "bode": "Frequency (Hz),Magnitude (dB),Phase (deg)\n" + rows(F, DB, DEG),
    "linear and radians": "f,|H|,phase (rad)\n" + rows(F, np.abs(H), np.radians(DEG)),
    "degrees in the name": "freq,gain_dB,phase_deg\n" + rows(F, DB, DEG - 360.0),
    "unwrapped sign": "Hz,abs,arg [°]\n" + rows(F, np.abs(H), DEG),
    "analyser": 'BEGIN CH1\nFreq(Hz),"A,1"(REAL),"A,1"(IMAG)\n' + rows(F, H.real, H.imag) + "END\n",
    "falling": "freq,re,im\n" + rows(F[::-1], H.real[::-1], H.imag[::-1]),
    "twice": "Frequency [Hz],Magnitude [dB],Phase [deg],complex number\n"
    + "".join(
        f"{f},{a},{p},{h.real:.17g}{h.imag:+.17g}j\n"
        for f, a, p, h in zip(F, DB, DEG, H, strict=True)
    ),
    "text": "f,H\n"
    + "".join(f"{f},({h.real:.17g}{h.imag:+.17g}j)\n" for f, h in zip(F, H, strict=True)),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_headings_say_the_form(tmp_path: Path, layout: str) -> None:
    found = response_from_record(responses_in_columns(table(tmp_path, LAYOUTS[layout])))
    assert found.frequency_hz == pytest.approx(F, rel=1e-14)
    assert found.response[:, 0, 0] == pytest.approx(H, rel=1e-12)


@pytest.mark.parametrize(
    ("heading", "values", "columns"),
    [
        ("a,b,c\n", rows(F, H.real, H.imag), ["0", "1", "2"]),
        ("a,b,c\n", rows(F / 1e3, DB, DEG), ["a kHz", "b dB", "c deg"]),
        ("a,b,c\n", rows(DEG, np.abs(H), F), ["2", "1", "0 deg"]),
        ("f,mag,phase\n", rows(F, np.abs(H), np.radians(DEG)), ["f", "mag", "phase rad"]),
        ("f,|H|,other\n", rows(F, np.abs(H), DEG), ["f", "|H|", "other deg"]),
    ],
)
def test_columns_are_named_where_headings_say_nothing(
    tmp_path: Path, heading: str, values: str, columns: list[str]
) -> None:
    record = responses_in_columns(table(tmp_path, heading + values), columns)
    assert record.time == pytest.approx(F)
    assert response_from_record(record).response[:, 0, 0] == pytest.approx(H, rel=1e-12)


@pytest.mark.parametrize("kind", ["mat", "npz", "h5"])
@pytest.mark.parametrize("columns", [None, ["f", "H"]])
def test_complex_arrays(tmp_path: Path, kind: str, columns: list[str] | None) -> None:
    file = tmp_path / f"frf.{kind}"
    both = np.stack([H, -3.0 * H], axis=1)
    if kind == "mat":
        savemat(file, {"f": F, "H": both if columns is None else H})
    elif kind == "npz":
        np.savez(file, f=F, H=both if columns is None else H)
    else:
        with h5py.File(file, "w") as store:
            # as MATLAB 7.3 writes complex numbers
            pairs = np.zeros(F.size, dtype=[("real", "f8"), ("imag", "f8")])
            pairs["real"], pairs["imag"] = H.real, H.imag
            store["f"], store["H"] = F, pairs
    found = response_from_record(
        responses_in_columns(read_record(file, over="point", columns=[]), columns)
    )
    assert found.response[:, 0, 0] == pytest.approx(H, rel=1e-15)
    assert found.outputs[0] == ("H" if columns or kind == "h5" else "H 0")


def test_the_words_round_that_of_the_part_are_the_name(tmp_path: Path) -> None:
    """Whether the word of the part stands first, in the middle, or last."""
    heads = ("Re of stage x", "Im of stage x", "stage real y", "stage imag y", "lever RealZ2",
             "lever ImagZ2")  # fmt: skip
    parts = [p for k in (1.0, -2.0, 0.3) for p in (k * H.real, k * H.imag)]
    record = responses_in_columns(table(tmp_path, f"f,{','.join(heads)}\n" + rows(F, *parts)))
    found = response_from_record(record)
    assert found.outputs == ("of stage x", "stage y", "lever Z2")
    for o, k in enumerate((1.0, -2.0, 0.3)):
        assert found.response[:, o, 0] == pytest.approx(k * H, rel=1e-14)


@pytest.mark.parametrize(
    ("form", "first", "second", "columns"),
    [
        ("RI", H.real, H.imag, ["0 kHz", "1", "2"]),
        ("MA", np.abs(H), DEG, ["0 kHz", "1", "2 deg"]),
        ("DB", DB, DEG, ["0 kHz", "1 dB", "2 deg"]),
    ],
)
def test_touchstone_is_read_as_columns_that_are_named(
    tmp_path: Path, form: str, first: np.ndarray, second: np.ndarray, columns: list[str]
) -> None:
    head = f"! shaker table\n# kHz S {form} R 50\n"
    record = table(tmp_path, head + rows(F / 1e3, first, second, between="  "), "a.s1p")
    with pytest.raises(RecordError, match=r"no column of frequencies .*--response"):
        responses_in_columns(record)
    found = response_from_record(responses_in_columns(record, columns))
    assert found.frequency_hz == pytest.approx(F, rel=1e-14)
    assert found.response[:, 0, 0] == pytest.approx(H, rel=1e-12)


def test_units_are_those_of_the_heading_or_of_options(tmp_path: Path) -> None:
    said = table(tmp_path, "f,H real (g/N),H imag (g/N)\n" + rows(F, H.real, H.imag))
    found = response_from_record(responses_in_columns(said))
    assert (found.output_units, found.input_units) == (("m/s^2",), ("N",))
    assert found.response[:, 0, 0] == pytest.approx(9.80665 * H, rel=1e-14)
    bare = table(tmp_path, "f,real,imag\n" + rows(F, H.real, H.imag))
    given = responses_in_columns(bare, ["f", "real um/V", "imag um/V"])
    found = response_from_record(given)
    assert (found.output_units, found.input_units) == (("m",), ("V",))
    assert found.response[:, 0, 0] == pytest.approx(1e-6 * H, rel=1e-14)
    with pytest.raises(RecordError, match="has the unit m/s"):
        responses_in_columns(said, ["f", "H real um/V", "H imag"])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("time (s),u,y\n0,1,2\n1,2,3\n", "records over time need --input and --output"),
        ("f,g,real,imag,freq\n" + rows(F, F, F, F, F), "2 columns of frequencies"),
        ("f,real\n" + rows(F, F), "only real of a response"),
        ("f,a,b\n" + rows(F, F, F), "no response in a known form .* --response"),
        ("f,mag,phase\n" + rows(F, F, F), 'has no unit, deg or rad: .*"0,1 dB,2 deg"'),
        ("f,mag,phase (deg)\n" + rows(F, DB, DEG), "is negative: if it is in decibels"),
        ("f,re,im\n" + rows(F[[0, 2, 1]], F[:3], F[:3]), "must rise, .* at row 2"),
        ("f,re,im\n1,2,3\n2,,4\n", "'re' is missing"),
    ],
)
def test_what_cannot_be_read_says_the_next_step(tmp_path: Path, content: str, said: str) -> None:
    with pytest.raises(RecordError, match=said):
        responses_in_columns(table(tmp_path, content))


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (["0", "1"], "has 2 columns"),
        (["0", "1", "9"], "there is no column '9'"),
        (["freq Hz", "re", "im"], "has a unit in the file: omit 'Hz'"),
    ],
)
def test_bad_choices_of_columns(tmp_path: Path, columns: list[str], said: str) -> None:
    record = table(tmp_path, "freq (Hz),re,im\n" + rows(F, H.real, H.imag))
    with pytest.raises(RecordError, match=said):
        responses_in_columns(record, columns)
