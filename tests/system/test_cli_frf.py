"""`flexstage frf`: records of every excitation, its JSON, its files, and bad input."""

import json
import re

import numpy as np
import pytest

from flexstage.cli import main
from flexstage.records import Channel, Record, read_record, write_record
from tests.computed_once import computed_once

RATE = 2048.0
#: Natural frequency [Hz], damping ratio, and participation in both outputs [1/kg].
MODES = ((137.3, 0.011, (0.83, 0.31)), (251.9, 0.017, (0.57, -0.71)))


def accelerances(f):
    """Acceleration of both outputs over force, shape (k, 2)."""
    w = 2.0 * np.pi * np.asarray(f, dtype=float)[:, None]
    h = np.zeros((w.size, 2), dtype=complex)
    for f0, zeta, shape in MODES:
        w0 = 2.0 * np.pi * f0
        h -= w**2 * np.array(shape) / (w0**2 - w**2 + 2j * zeta * w0 * w)
    return h


def answered(force, delay=0.0, lag=0.0):
    """Accelerations under a force, as of the continuous system, at rest before."""
    size = 2 * force.size
    f = np.fft.rfftfreq(size, 1.0 / RATE)
    s = 2j * np.pi * f[:, None]
    h = accelerances(f) * np.exp(-s * delay) / (1.0 + s * lag)
    return np.fft.irfft(np.fft.rfft(force, n=size)[:, None] * h, n=size, axis=0)[: force.size]


def hammer(rng, hits=5, block=4096):
    force = np.zeros(hits * block + 512)
    for k in range(hits):
        first = k * block + 200 + int(rng.integers(0, 60))
        width = 2
        force[first : first + width + 1] = rng.uniform(4.0, 9.0) * np.array((0.5, 1.0, 0.45))
    return force


def noisy(values, share, rng):
    return values + share * np.sqrt(np.mean(values**2, axis=0)) * rng.standard_normal(values.shape)


def table(path, force, outputs, head="time (s),force (N),a (m/s^2),b (m/s^2)"):
    t = np.arange(force.size) / RATE
    columns = np.column_stack((t, force, outputs))
    np.savetxt(path, columns, delimiter=",", header=head, comments="")
    return path


@pytest.fixture(scope="module", autouse=True)
def _the_same_is_fitted_once():
    with computed_once("flexstage.measure.modal.fit", "fit_modes"):
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("frf")


@pytest.fixture(scope="module")
def struck(folder):
    rng = np.random.default_rng(31)
    force = hammer(rng)
    return table(folder / "hammer.csv", force, noisy(answered(force), 0.01, rng))


@pytest.fixture(scope="module")
def shaken(folder):
    rng = np.random.default_rng(32)
    force = 2.3 * rng.standard_normal(40 * 2048)
    answer = noisy(answered(force), 0.02, rng)
    channels = (
        Channel(name="force", values=force, unit="N"),
        Channel(name="a", values=answer[:, 0], unit="m/s^2"),
        Channel(name="b", values=answer[:, 1], unit="m/s^2"),
    )
    # a text as long as this takes longer to read than to evaluate
    record = Record(channels=channels, time=np.arange(force.size) / RATE)
    return write_record(record, folder / "random.npz")


@pytest.fixture(scope="module")
def universal(folder):
    pyuff = pytest.importorskip("pyuff", reason="pyuff is not installed")
    f = np.arange(0.0, 500.5, 0.5)
    h = accelerances(f)
    rng = np.random.default_rng(33)
    white = rng.standard_normal(h.shape) + 1j * rng.standard_normal(h.shape)
    h = h + 1e-3 * np.abs(h).max() * white
    path = folder / "response.uff"
    file = pyuff.UFF(str(path))
    sets = [
        pyuff.prepare_58(
            binary=0, func_type=4, rsp_node=12 + o, rsp_dir=3, ref_node=5, ref_dir=-3,
            abscissa_min=0.0, abscissa_inc=0.5, abscissa_spacing=1, data=h[:, o], x=f,
            id1=f"response {o}", rsp_ent_name="NONE", ref_ent_name="NONE",
            abscissa_spec_data_type=18, abscissa_axis_units_lab="Hz",
            ordinate_spec_data_type=12, ordinate_axis_units_lab="m/s^2",
            orddenom_spec_data_type=13, orddenom_axis_units_lab="N",
        )
        for o in range(2)
    ]  # fmt: skip
    file.write_sets(sets, mode="overwrite")
    return path


def run(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["frf", *(str(word) for word in words)])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


def found(capsys, *words):
    status, out, err = run(capsys, *words, "--json")
    assert (status, err) == (0, ""), err
    return json.loads(out)


def check_modes(result, *, frequency=5e-4, damping=0.03):
    assert len(result["modes"]) == len(MODES)
    for mode, (f0, zeta, _) in zip(result["modes"], MODES, strict=True):
        for name, truth, worst in (
            ("frequency_hz", f0, frequency),
            ("damping_ratio", zeta, damping),
        ):
            one = mode[name]
            assert one["value"] == pytest.approx(truth, rel=worst)
            # one of four values in twenty is out of its interval, but none by this much
            assert abs(one["value"] - truth) < 3.3 * one["uncertainty"], (name, truth)
            assert one["interval"][0] < one["value"] < one["interval"][1]
            assert one["uncertainty"] < worst * truth


def check_shapes(result, tolerance=0.02):
    for mode, (_, _, shape) in zip(result["modes"], MODES, strict=True):
        real = np.array([s["real"] for s in mode["shape"]])
        wanted = np.array(shape) / max(shape, key=abs)
        assert real == pytest.approx(wanted, abs=tolerance)
        assert [s["output"] for s in mode["shape"]] == ["a", "b"]


def test_hammer(capsys, struck):
    result = found(
        capsys, struck, "--input", "force", "--output", "a,b", "--excitation", "hammer",
        "--band", "80:350",
    )  # fmt: skip
    check_modes(result)
    check_shapes(result)
    assert (result["excitation"], result["averages"]) == ("hammer", 5)
    assert result["modes"][0]["frequency_hz"]["unit"] == "Hz"


def test_an_exponential_window_adds_no_damping(capsys, struck):
    words = (
        struck,
        "--input",
        "1",
        "--output",
        "2,3",
        "--excitation",
        "hammer",
        "--band",
        "80:350",
        "--fit-modes",
        "2",
    )
    plain = found(capsys, *words)
    windowed = found(capsys, *words, "--window", "exponential 2 %")
    for mode, (f0, _, _) in zip(windowed["modes"], MODES, strict=True):
        assert mode["frequency_hz"]["value"] == pytest.approx(f0, rel=5e-5)
    ratio = [
        b["damping_ratio"]["value"] / a["damping_ratio"]["value"]
        for a, b in zip(plain["modes"], windowed["modes"], strict=True)
    ]
    # what the window itself would add: 1.96 1/s, of 9.5 and 26.9 1/s
    assert ratio == pytest.approx([1.0, 1.0], abs=0.02)


def test_random(capsys, shaken):
    result = found(
        capsys, shaken, "--input", "force", "--output", "a,b", "--resolution", "0.5 Hz",
        "--band", "80:350",
    )  # fmt: skip
    # segments of 2 s, windowed: what leaks is some percent of the peak of the first mode
    check_modes(result, damping=0.06)
    check_shapes(result)
    assert result["excitation"] == "random"
    assert result["band_hz"] == pytest.approx([80.0, 350.0], abs=0.5)


def test_the_excitation_is_recognised(capsys, struck):
    result = found(capsys, struck, "--input", "force", "--output", "a", "--fit-modes", "0")
    assert result["excitation"] == "hammer"
    assert result["modes"] == []
    assert "reduced_chi_squared" not in result


def test_universal_file_of_another_library(capsys, universal):
    result = found(capsys, universal, "--band", "80:350", "--fit-modes", "2")
    check_modes(result)
    assert len(result["outputs"]) == 2
    assert len(result["inputs"]) == 1
    assert result["excitation"] == ""
    real = [[s["real"] for s in mode["shape"]] for mode in result["modes"]]
    for got, (_, _, shape) in zip(real, MODES, strict=True):
        assert got == pytest.approx(np.array(shape) / max(shape, key=abs), abs=0.02)


def decaying(folder, name="decay.csv"):
    rng = np.random.default_rng(34)
    t = np.arange(3000) / RATE
    since = t - 0.1
    x = np.zeros((t.size, 2))
    for f0, zeta, shape in MODES:
        w0 = 2.0 * np.pi * f0
        free = np.exp(-zeta * w0 * since) * np.cos(w0 * np.sqrt(1.0 - zeta**2) * since)
        x += 1e-6 * np.array(shape) * np.where(since < 0.0, 1.0, free)[:, None]
    x += 4e-9 * rng.standard_normal(x.shape)
    np.savetxt(
        folder / name, np.column_stack((t, x * 1e6)), delimiter=",",
        header="time (s),a (um),b (um)", comments="",
    )  # fmt: skip
    return folder / name


def test_ring_down(capsys, folder, tmp_path):
    path = decaying(folder)
    picture = tmp_path / "decay.png"
    result = found(
        capsys, path, "--excitation", "ring-down", "--output", "a,b", "--figure", picture
    )
    check_modes(result)
    check_shapes(result)
    assert result["files"] == [str(picture)]
    assert picture.read_bytes()[:4] == b"\x89PNG"
    # columns by number give shapes under their names
    assert (
        found(capsys, path, "--excitation", "ring-down", "--output", "1,2")["modes"]
        == result["modes"]
    )


@pytest.mark.slow
def test_delay_and_lag_of_a_sensor(capsys, folder):
    rng = np.random.default_rng(35)
    delay, lag = 3.1e-3, 0.29e-3
    force = hammer(rng, hits=8)
    path = table(folder / "late.csv", force, noisy(answered(force, delay, lag), 0.005, rng))
    words = (
        path, "--input", "force", "--output", "a,b", "--excitation", "hammer", "--band", "60:420",
        "--fit-modes", "2",
    )  # fmt: skip
    late = found(capsys, *words, "--fit", "delay")
    assert late["delay"]["unit"] == "s"
    assert late["delay"]["value"] > delay + 0.5 * lag
    both = found(capsys, *words, "--fit", "delay,lag")
    assert abs(both["lag"]["value"] - lag) < 3.3 * both["lag"]["uncertainty"]
    assert both["lag"]["value"] == pytest.approx(lag, rel=0.1)
    # residual terms, which are free, can stand for a part of a sample
    assert both["delay"]["value"] == pytest.approx(delay, abs=0.25 / RATE)
    assert both["reduced_chi_squared"] < late["reduced_chi_squared"]
    assert "lag" not in late
    # one mode on a few lines, for what the table says of it
    few = (*words[:-3], "220:290", "--fit-modes", "1")
    status, out, _ = run(capsys, *few, "--fit", "delay,lag")
    assert status == 0
    assert re.search(r"delay 0\.003\d* s", out)


def test_guesses_weights_and_complex_modes(capsys, universal):
    near = found(capsys, universal, "--band", "80:350", "--near", "136,250")
    check_modes(near)
    (alone,) = found(capsys, universal, "--band", "80:350", "--near", "250")["modes"]
    assert alone["frequency_hz"]["value"] == pytest.approx(251.9, rel=1e-3)
    words = (universal, "--band", "80:350", "--weight", "relative")
    got = [m["frequency_hz"]["value"] for m in found(capsys, *words)["modes"]]
    assert got == pytest.approx([f for f, _, _ in MODES], rel=2e-3)
    late = found(capsys, universal, "--band", "80:350", "--fit", "delay,complex")
    check_modes(late, frequency=1e-3, damping=0.1)
    # modes of any phase leave little to tell the delay by
    assert abs(late["delay"]["value"]) < 0.5 / RATE
    # those in phase with each other tell more
    real = found(capsys, universal, "--band", "80:350", "--fit", "delay")
    assert real["delay"]["uncertainty"] < 0.5 * late["delay"]["uncertainty"]


def test_a_step_of_few_digits_widens_the_interval(capsys, folder):
    rng = np.random.default_rng(38)
    force = hammer(rng)
    t = 0.000488 * np.arange(force.size)
    path = folder / "coarse.csv"
    np.savetxt(
        path, np.column_stack((t, force, answered(force))), delimiter=",",
        header="time (s),force (N),a (m/s^2),b (m/s^2)", comments="", fmt="%.9g",
    )  # fmt: skip
    words = (path, "--input", "force", "--output", "a,b", "--band", "80:350", "--fit-modes", "2")
    coarse = found(capsys, *words)
    (note,) = [note for note in coarse["notes"] if "sample-rate" in note]
    assert "between 2047.08 and 2051.28 Hz" in note
    assert "0.1 %" in note
    for mode, (f0, _, _) in zip(coarse["modes"], MODES, strict=True):
        low, high = mode["frequency_hz"]["interval"]
        assert low < f0 < high
        assert high - low == pytest.approx(2.0 * 1.96 * 0.5 / 488.0 / 3.0**0.5 * f0, rel=0.1)
    exact = found(capsys, *words, "--sample-rate", str(RATE))
    assert not any("sample-rate" in note for note in exact["notes"])
    check_modes(exact)


def test_the_response_is_written_and_read_back(capsys, struck, tmp_path):
    for suffix in ("csv", "npz", "h5", "mat"):
        out = tmp_path / f"response.{suffix}"
        result = found(
            capsys, struck, "--input", "force", "--output", "a,b", "--fit-modes", "0", "--out", out
        )
        assert result["files"] == [str(out)]
        back = read_record(out, over="point")
        f = back.channel("frequency").values
        assert f.size == result["lines"]
        h = back.channel("b/force real").values + 1j * back.channel("b/force imaginary").values
        near = np.abs(f - MODES[1][0]).argmin()
        assert h[near] == pytest.approx(accelerances(f[[near]])[0, 1], rel=0.02)
        assert 0.99 < back.channel("b coherence").values[near] <= 1.0
        assert back.channel("a/force variance").values[near] > 0.0


@pytest.mark.parametrize("modes", ["2", "0"])
def test_figures(capsys, request, struck, tmp_path, modes):
    if modes == "0":  # fewer lines of the same picture
        request.getfixturevalue("undrawn")
    out, picture = tmp_path / "r.csv", tmp_path / "r.svg"
    result = found(
        capsys, struck, "--input", "force", "--output", "a,b", "--fit-modes", modes,
        "--band", "80:350", "--figure", picture, "--out", out,
    )  # fmt: skip
    diagram = [tmp_path / "r-stabilisation.svg"] if modes == "2" else []
    assert result["files"] == [str(path) for path in (out, picture, *diagram)]
    assert all(b"<svg" in path.read_bytes() for path in (picture, *diagram))


def test_table(capsys, struck):
    status, out, err = run(
        capsys, struck, "--input", "force", "--output", "a,b", "--band", "80:350"
    )
    assert (status, err) == (0, "")
    assert "137.3" in out
    assert "5 averages" in out


def test_several_records_are_averaged(capsys, folder):
    files = []
    for k in range(3):
        rng = np.random.default_rng(40 + k)
        force = hammer(rng, hits=1)
        answer = noisy(answered(force), 0.01, rng)
        files.append(table(folder / f"hit{k}.csv", force, answer))
    result = found(capsys, *files, "--input", "force", "--output", "a,b", "--band", "80:350")
    assert result["averages"] == 3
    assert result["records"] == [str(file) for file in files]
    check_modes(result)


def spoiled(folder, struck, name, change):
    data = np.loadtxt(struck, delimiter=",", skiprows=1)
    change(data)
    path = folder / name
    np.savetxt(
        path, data, delimiter=",", header="time (s),force (N),a (m/s^2),b (m/s^2)", comments=""
    )
    return path


def _nan(data):
    data[4711, 2] = np.nan


def _clip(data):
    data[:, 2] = np.minimum(data[:, 2], 0.3 * data[:, 2].max())


def _dead(data):
    data[:, 3] = 0.125


def _uneven(data):
    data[3000:, 0] += 0.4 / RATE


BAD_DATA = [
    (_nan, "column 'a'"),
    (_clip, "'a' is clipped"),
    (_dead, "column 'b' of .* is constant"),
    (_uneven, "gap|even|step"),
]


@pytest.mark.parametrize(("change", "said"), BAD_DATA, ids=[c.__name__ for c, _ in BAD_DATA])
def test_bad_records(capsys, folder, struck, tmp_path, change, said):
    path = spoiled(folder, struck, f"bad{change.__name__}.csv", change)
    refused(
        capsys, said, tmp_path, path, "--input", "force", "--output", "a,b",
        "--excitation", "hammer", "--out", tmp_path / "out.csv", "--figure", tmp_path / "f.svg",
    )  # fmt: skip


def refused(capsys, said, tmp_path, *words):
    status, out, err = run(capsys, *words)
    assert (status, out) == (2, ""), err
    assert err.startswith("flexstage: ")
    assert err.count("\n") == 1, "more than one line"
    assert "Traceback" not in err
    assert re.search(said, err), err
    assert list(tmp_path.iterdir()) == []


def test_bad_options(capsys, struck, tmp_path):
    named = (struck, "--input", "force", "--output", "a")
    for said, words in (
        ("must rise", (*named, "--band", "800:200")),
        ("such as .10 Hz:20 Hz.", (*named, "--band", "800")),
        ("Hz", (*named, "--band", "2 m:5 m")),
        ("'--fit-modes': must be", (*named, "--fit-modes", "many")),
        ("must end", (*named, "--figure", tmp_path / "a.txt")),
        ("--out must end", (*named, "--out", tmp_path / "a.xyz")),
        ("no column 'c'", (struck, "--input", "force", "--output", "c")),
        ("given twice", (struck, "--input", "force", "--output", "a,a")),
        ("H1", (*named, "--estimator", "H7")),
        ("excitation", (*named, "--excitation", "jackhammer")),
        ("window", (*named, "--excitation", "random", "--window", "shutter")),
        ("window 'exponental 5 %' is unknown", (*named, "--window", "exponental 5 %")),
        ("'--near': must be", (*named, "--near", "300,-2")),
        ("contradicts", (*named, "--near", "137,250", "--fit-modes", "3")),
        ("be in the band", (*named, "--near", "1900")),
        ("'--weight': must be noise, relative or uniform", (*named, "--weight", "inv")),
        ("--fit complex needs delay or lag", (*named, "--fit", "complex")),
        ("no file", (tmp_path / "nothing.csv", "--input", "force", "--output", "a")),
        ("--output", (struck, "--excitation", "ring-down")),
        (
            "--out cannot be used with --excitation ring-down",
            (struck, "--excitation", "ring-down", "--output", "a", "--out", tmp_path / "a.csv"),
        ),
        (
            "--band.*does not apply",
            (struck, "--excitation", "ring-down", "--output", "a", "--band", "8:20"),
        ),
        (
            "--fit-modes 0",
            (struck, "--excitation", "ring-down", "--output", "a", "--fit-modes", "0"),
        ),
        ("'--resolution': must be above 0", (*named, "--resolution", "-2 Hz")),
        ("exponential", (*named, "--excitation", "hammer", "--window", "exponential 1.7")),
    ):
        refused(capsys, said, tmp_path, *words)


def test_swapped_columns_are_said_first(capsys, shaken):
    """A fit that leaves all of the response is none, however small its intervals."""
    coarse = ("--resolution", "4 Hz")
    words = (shaken, "--input", "a", "--output", "force", "--fit-modes", "1", *coarse)
    status, out, _ = run(capsys, *words)
    assert status == 0
    assert re.match(r"warning: the residual is \d+ % of a response", out)
    assert "not swapped" in " ".join(out.split())
    result = found(capsys, *words)
    assert len(result["warnings"]) == 1
    assert not any("the residual is" in n and "of a response" in n for n in result["notes"])
    right = found(capsys, shaken, "--input", "force", "--output", "a", "--fit-modes", "2", *coarse)
    assert right["warnings"] == []


def test_a_record_over_frequency_is_no_decay(capsys, universal, tmp_path):
    refused(
        capsys, "over frequency", tmp_path, universal, "--excitation", "ring-down", "--output", "0"
    )


def test_times_and_frequencies_do_not_mix(capsys, universal, struck, tmp_path):
    refused(capsys, "over time", tmp_path, universal, struck)
    refused(capsys, "over frequency", tmp_path, struck, universal, "--input", "1", "--output", "2")


def test_a_figure_that_cannot_be_written_leaves_no_response(capsys, struck, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    status, _, err = run(
        capsys, struck, "--input", "force", "--output", "a", "--fit-modes", "0",
        "--out", tmp_path / "r.csv", "--figure", blocked / "f.svg",
    )  # fmt: skip
    assert status == 1
    assert "cannot read or write" in err
    assert list(tmp_path.iterdir()) == [blocked]


@pytest.fixture(scope="module")
def estimated():
    """What a record of random motion gave, to be found again in each file of its response."""
    return {}


@pytest.mark.parametrize("suffix", ["csv", "npz", "h5", "mat"])
def test_a_response_that_was_written_gives_the_same_modes(
    capsys, shaken, estimated, tmp_path, suffix
):
    out = tmp_path / f"response.{suffix}"
    band = ("--band", "80:350", "--fit-modes", "2")
    words = (shaken, "--input", "force", "--output", "a,b", "--resolution", "2 Hz")
    first = estimated or found(capsys, *words, *band, "--out", out)
    if estimated:
        # the modes are those of the first file: only the response is written anew
        found(capsys, *words, "--band", "80:350", "--fit-modes", "0", "--out", out)
    estimated.update(first)
    again = found(capsys, out, *band)
    assert again["outputs"] == ["a", "b"]
    for one, other in zip(first["modes"], again["modes"], strict=True):
        for figure in ("frequency_hz", "damping_ratio"):
            assert other[figure]["value"] == pytest.approx(one[figure]["value"], rel=1e-9)
            assert other[figure]["uncertainty"] == pytest.approx(
                one[figure]["uncertainty"], rel=1e-6
            )


def test_a_table_of_an_analyser(capsys, folder, tmp_path):
    f = np.arange(80.0, 350.25, 0.25)
    h = accelerances(f)[:, 0]
    file = folder / "bode.csv"
    columns = np.column_stack((f, 20.0 * np.log10(np.abs(h)), np.degrees(np.angle(h))))
    np.savetxt(file, columns, delimiter=",", header="Frequency (Hz),Gain (dB),P", comments="")
    refused(capsys, "--response", tmp_path, file)
    result = found(capsys, file, "--response", "0,1,2 deg", "--fit-modes", "2")
    for mode, (f0, zeta, _) in zip(result["modes"], MODES, strict=True):
        assert mode["frequency_hz"]["value"] == pytest.approx(f0, rel=1e-5)
        assert mode["damping_ratio"]["value"] == pytest.approx(zeta, rel=1e-3)


def test_force_and_accelerations_of_a_record_are_taken(capsys, shaken):
    asked = ("--near", "137,250", "--resolution", "2 Hz", "-q")
    plain, named = (
        found(capsys, shaken, *asked),
        found(capsys, shaken, *asked, "--input", "force", "--output", "a,b"),
    )
    said = "input 1: force [N]; output 2: a [m/s^2], 3: b [m/s^2]: selected by units and names"
    assert plain["notes"][0] == said
    assert [m["frequency_hz"] for m in plain["modes"]] == [
        m["frequency_hz"] for m in named["modes"]
    ]


def test_options_of_existing_responses(capsys, shaken, universal, tmp_path):
    driven = ("--input", "force", "--output", "a")
    refused(capsys, "one or the other", tmp_path, shaken, *driven, "--response", "0,1,2")
    refused(capsys, "omit --response", tmp_path, universal, "--response", "0,1,2")
    refused(capsys, "which column is the output", tmp_path, universal, "--input", "b")
