"""`flexstage calibrate`: records of heads and of a polygon, files, choice of method, bad input."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexstage.centring import ScaleReadings, self_calibration
from flexstage.cli import main
from flexstage.records import read_record

ARCSEC = np.pi / 648_000
HEADS = (0, 20, 210, 320)
FACES = np.array([21, -34, 10, 42, -15, -8, 31, -27, 5, -19, 12, -18]) / 100.0
TABLE = np.array([-5, 3, 14, 8, -12, 2, -7, 1, -15, 3, 1, 7]) / 10.0
SELF = ("--angle", "angle", "--error", "h1,h2,h3,h4", "--heads", "0,20,210,320", "--method", "self")


@pytest.fixture(autouse=True)
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A scale under four heads on a table with errors, two scales, and a polygon of 12 faces."""
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(4)
    t = 2.0 * np.pi * np.arange(720) / 720

    def scale(s):
        return 3.0 * np.cos(2.0 * s - 0.5) + 0.7 * np.sin(9.0 * s)

    wander = 20.0 * np.sin(3.0 * t + 0.2)
    heads = [scale(t + np.radians(a)) + wander + random.normal(0.0, 0.5, 720) for a in HEADS]
    write("scale.csv", "angle (deg)," + ",".join(f"h{k} (arcsec)" for k in (1, 2, 3, 4)),
          np.degrees(t), *heads)  # fmt: skip
    even = [scale(t + 2.0 * np.pi * k / 5) + wander for k in range(5)]
    write("even.csv", "angle (deg)," + ",".join(f"h{k} (arcsec)" for k in range(5)),
          np.degrees(t), *(y + random.normal(0.0, 0.5, 720) for y in even))  # fmt: skip
    apart = [scale(t) - 2.0 * np.sin(5.0 * (t + p)) for p in np.radians([0.0, 30.0, 95.0])]
    write("two.csv", "angle (deg),d1 (arcsec),d2 (arcsec),d3 (arcsec)",
          np.degrees(t), *(d + random.normal(0.0, 0.2, 720) for d in apart))  # fmt: skip
    face = np.arange(1, 13)
    turned = [FACES - np.roll(TABLE, -s) + 3.0 * s + random.normal(0.0, 0.05, 12)
              for s in (0, 1, 4, 6)]  # fmt: skip
    write("polygon.csv", "face,s0,s1,s4,s6", face, *turned)
    long = [(f, s, y[f - 1]) for s, y in zip((0, 1, 4, 6), turned, strict=True)
            for f in random.permutation(face)]  # fmt: skip
    write("long.csv", "face,setting,reading", *np.array(long).T)
    segment = np.roll(FACES, -1) - FACES
    write("rounds.csv", "face,r1,r2,r3", face,
          *(segment + 7.0 * r + random.normal(0.0, 0.05, 12) for r in range(3)))  # fmt: skip


def write(name: str, heading: str, *columns: Any) -> None:
    np.savetxt(name, np.column_stack(columns), delimiter=",", header=heading, comments="")


Run = Callable[..., str]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*words: str, status: int = 0) -> str:
        with pytest.raises(SystemExit) as ended:
            main(["calibrate", *words])
        said = capsys.readouterr()
        assert ended.value.code == status, said
        return said.err if status else said.out

    return call


def of(rows: list[dict[str, Any]], name: str, key: str) -> np.ndarray:
    return np.array([row[key] for row in rows if row["of"] == name])


def test_a_scale_by_the_differences_of_its_heads(run: Run) -> None:
    found = json.loads(run("scale.csv", *SELF, "--orders", "1:16", "--json"))
    amplitude = of(found["harmonics"], "scale", "amplitude") / ARCSEC
    uncertainty = of(found["harmonics"], "scale", "uncertainty") / ARCSEC
    true = np.zeros(16)
    true[[1, 8]] = 3.0, 0.7
    assert np.all(np.abs(amplitude - true) < 4.0 * uncertainty)
    assert uncertainty.max() < 0.03
    assert found["noise"] / ARCSEC == pytest.approx(0.5, rel=0.05)
    assert found["blind"] == {"scale": []}
    covariance = np.array(found["covariance"]["scale"])
    u = of(found["points"], "scale", "uncertainty")
    assert np.allclose(np.sqrt(np.diag(covariance)), u)
    step = np.roll(np.eye(u.size), 1, axis=1) - np.eye(u.size)
    assert np.allclose(
        np.sqrt(np.diag(step @ covariance @ step.T)),
        of(found["points"], "scale", "step_uncertainty"),
    )


def test_the_reference_has_the_errors_of_the_table(run: Run) -> None:
    words = (*SELF[:-1], "reference", "--orders", "1:4", "--json")
    found = json.loads(run("scale.csv", *words))
    third = found["harmonics"][2]
    # 20 arcsec of the table, and a share of them by the mean of the turned heads
    share = abs(np.mean(np.exp(-3j * np.radians(HEADS))))
    assert third["amplitude"] / ARCSEC == pytest.approx(20.0 * share, rel=0.02)


@pytest.mark.parametrize(
    ("words", "first"),
    [
        (("scale.csv", "--angle", "angle", "--error", "h1"), "reference (one head"),
        (("scale.csv", "--turns", "1", *SELF[2:-2]), "self (4 heads without a true angle"),
        (("two.csv", "--angle", "angle", "--error", "d1,d2,d3", "--positions", "0,30,95"),
         "cross (two scales in several --positions"),
        (("even.csv", "--angle", "angle", "--error", "h0,h1,h2,h3,h4", "--heads",
          "0,72,144,216,288", "--method", "equal-division"), "equal-division (by --method"),
        (("long.csv",), "rosette (the polygon was turned on the table"),
        (("polygon.csv", "--settings", "0,1,4,6"), "rosette (the polygon was turned"),
        (("rounds.csv", "--error", "r1", "--noise", "0.05"), "closure (one column"),
    ],
    ids=lambda words: words[0] if isinstance(words, tuple) else "",
)  # fmt: skip
def test_the_first_line_names_the_method_and_why(
    run: Run, words: tuple[str, ...], first: str
) -> None:
    said = run(*words)
    assert said.startswith(f"method: {first}")
    assert "noise of a reading: 0." in said


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("scale.csv", *SELF[:-2]), "allow two methods: give --method self"),
        (("polygon.csv",), "columns of readings of a polygon (s0, s1, s4, s6) allow two methods"),
        (("polygon.csv", "--settings", "0,1"), "a number for each of 4 columns"),
        (("rounds.csv", "--error", "r1"), "give it by --noise"),
        (("two.csv", "--angle", "angle", "--error", "d1,d2,d3", "--positions", "0,30"),
         "an angle for each of 3 columns"),
        (("long.csv", "--unit", "um"), "must be an angle"),
        (("scale.csv", "--best-heads", "3"), "need no records"),
        (("long.csv", "--span", "3"), "--span is for closure, not for rosette: omit it"),
        (("scale.csv", *SELF, "--positions", "0,1"), "--positions is for cross, not for self"),
        ((), "give the records"),
        (("--best-heads", "4", "--step", "7"), "whole part of 360 degrees, got 7 degrees"),
        (("--best-heads", "4", "--axis-motion"), "the best misses 1"),
        (("--best-heads", "9"), "have 23535820 arrangements, at most 500000"),
        (("--best-heads", "3", "--step", "120", "--orders", "1:4"), "the best misses 3"),
    ],
)  # fmt: skip
def test_what_is_missing_is_said(run: Run, words: tuple[str, ...], sentence: str) -> None:
    assert sentence in run(*words, status=2)


def test_an_order_that_even_heads_cannot_see_is_named(run: Run) -> None:
    words = ("even.csv", "--turns", "1", "--error", "h0,h1,h2,h3,h4", "--heads", "0,72,144,216,288")
    said = run(*words, "--orders", "1:10", "--blind-allowance", "0.2")
    assert "orders that cannot be seen, and are missing: 5, 10" in said
    assert "blind orders 0.2" in said


def test_a_polygon_and_its_table(run: Run) -> None:
    found = json.loads(run("polygon.csv", "--settings", "0,1,4,6", "--json"))
    for name, truth in (("faces", FACES), ("table", TABLE)):
        error = of(found["points"], name, "error") / ARCSEC
        u = of(found["points"], name, "uncertainty") / ARCSEC
        assert np.all(np.abs(error - truth + truth.mean()) < 3.5 * u)
        # a difference set of 12 faces: 0.28 of the variance of a reading
        assert u == pytest.approx(np.sqrt(0.2817) * found["noise"] / ARCSEC, rel=1e-3)
        assert of(found["points"], name, "expanded")[0] / ARCSEC == pytest.approx(
            2.0739 * u[0], rel=1e-4
        )
    assert found["degrees_of_freedom"] == 22
    assert any("arcsec" in note for note in found["notes"])


def test_rows_and_columns_say_the_same(run: Run) -> None:
    by_columns = json.loads(run("polygon.csv", "--method", "rosette", "--json"))
    by_rows = json.loads(run("long.csv", "--json"))
    for key in ("error", "uncertainty"):
        first, second = (of(f["points"], "faces", key) for f in (by_columns, by_rows))
        assert np.allclose(first, second, rtol=1e-9)
    # a repeat is a setting of its own, in a file of its own
    twice = json.loads(run("long.csv", "long.csv", "--json"))
    assert np.allclose(of(twice["points"], "faces", "error"), faces_error(by_rows))
    assert twice["degrees_of_freedom"] == 8 * 12 - 22 - 8


def faces_error(found: dict[str, Any]) -> np.ndarray:
    return of(found["points"], "faces", "error")


def test_rounds_of_two_autocollimators(run: Run) -> None:
    found = json.loads(
        run("rounds.csv", "--method", "closure", "--gain-uncertainty", "1%", "--json")
    )
    error = of(found["points"], "faces", "error") / ARCSEC
    assert np.max(np.abs(error - FACES)) < 0.12
    sources = {c["source"]: c for c in found["contributions"]}
    assert sources["gain of the autocollimator"]["kind"] == "B"
    rms = np.sqrt(np.mean(error**2))
    assert sources["gain of the autocollimator"]["uncertainty"] / ARCSEC == pytest.approx(
        0.01 * rms
    )


def test_files_of_a_calibration_read_back(run: Run) -> None:
    said = run("long.csv", "--folder", "out", "--figure", "out.svg")
    assert "wrote out.svg" in said
    assert sorted(p.name for p in Path("out").iterdir()) == [
        "calibration.json", "faces-covariance.csv", "faces.csv", "table-covariance.csv",
        "table.csv",
    ]  # fmt: skip
    whole = json.loads(Path("out/calibration.json").read_text("utf-8"))
    record = read_record("out/faces.csv", over="point")
    assert np.allclose(record.channel("error").values, faces_error(whole), rtol=1e-12)
    matrix = np.loadtxt("out/faces-covariance.csv", delimiter=",", skiprows=1)
    assert np.allclose(matrix * ARCSEC**2, whole["covariance"]["faces"], rtol=1e-12)


def test_the_best_heads(run: Run) -> None:
    said = run("--best-heads", "4", "--orders", "1:16", "--step", "10", "--figure", "gain.svg")
    assert "heads at 0, 20, 210, 320 deg: largest gain 0.640 (bound 0.500)" in said
    found = json.loads(run("--best-heads", "3", "--orders", "1:16", "--step", "5", "--json"))
    assert found["heads_deg"] == [0.0, 65.0, 255.0]
    assert found["largest_gain"] == pytest.approx(1.034, abs=5e-4)
    assert found["examined"] == 71 * 70 // 2


def test_true_angle_minus_reading_changes_the_sign(run: Run) -> None:
    words = ("scale.csv", *SELF, "--orders", "1:4", "--json")
    first, second = (json.loads(run(*words, *more)) for more in ((), ("--sign", "-1")))
    error, reverse = (of(found["points"], "scale", "error") for found in (first, second))
    assert np.allclose(error, -reverse, rtol=1e-12)
    polygon = ("polygon.csv", "--settings", "0,1,4,6", "--json")
    first, second = (json.loads(run(*polygon, *more)) for more in ((), ("--sign", "-1")))
    assert np.allclose(faces_error(first), -faces_error(second), rtol=1e-12)


def test_options_are_those_of_the_functions(run: Run) -> None:
    record = read_record("scale.csv", over="point")
    names = [f"h{k}" for k in (1, 2, 3, 4)]
    readings = ScaleReadings(
        angle=record.channel("angle").values,
        errors=np.array([record.channel(name).values for name in names]),
        heads=np.radians(HEADS),
        noise=0.5 * ARCSEC,
        head_uncertainty=60.0 * ARCSEC,
    )
    expected = self_calibration(readings, range(2, 17), axis_motion=True, points=72)
    more = ("--orders", "2:16", "--axis-motion", "--noise", "0.5", "--head-uncertainty", "1 arcmin")
    found = json.loads(run("scale.csv", *SELF, *more, "--json"))
    orders, blind = list(expected.orders), list(expected.blind)
    assert [h["order"] for h in found["harmonics"]] == orders
    assert found["blind"] == {"scale": blind}
    assert np.allclose(of(found["points"], "scale", "error"), expected.error, rtol=1e-9)
    assert np.allclose(of(found["points"], "scale", "uncertainty"), expected.uncertainty, rtol=1e-9)
    assert found["degrees_of_freedom"] is None
    assert [c["source"] for c in found["contributions"]] == [
        "noise of the readings", "angles of the heads",
    ]  # fmt: skip


def test_two_scales_with_noise_that_is_known(run: Run) -> None:
    words = ("two.csv", "--angle", "angle", "--error", "d1,d2,d3", "--positions", "0,30,95")
    found = json.loads(run(*words, "--noise", "0.2", "--json"))
    assert found["noise"] / ARCSEC == pytest.approx(0.2)
    amplitude = {(h["of"], h["order"]): h["amplitude"] / ARCSEC for h in found["harmonics"]}
    for key, size in ((("scale", 2), 3.0), (("scale", 9), 0.7), (("second scale", 5), 2.0)):
        assert amplitude[key] == pytest.approx(size, abs=0.06)


def test_a_span_of_several_faces_and_the_angle_to_the_next(run: Run) -> None:
    write("span.csv", "face,reading", np.arange(12), np.roll(FACES, -5) - FACES + 60.0)
    found = json.loads(run("span.csv", "--span", "5", "--noise", "0.01", "--json"))
    error = faces_error(found) / ARCSEC
    assert np.allclose(error, FACES, atol=1e-9)
    step = of(found["points"], "faces", "step_error") / ARCSEC
    assert np.allclose(step, np.roll(FACES, -1) - FACES, atol=1e-9)


def test_a_certificate_states_object_records_and_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = np.column_stack([np.arange(12), 3.0 * np.sin(np.arange(12.0))])
    np.savetxt("faces.csv", rows, delimiter=",", comments="", header="face,reading")
    stated = ["--certificate", "c.html", "--traceability", "closed circle <360>"]
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", "faces.csv", "--noise", "0.1", *stated])
    assert ended.value.code == 2
    assert "give --item" in capsys.readouterr().err
    assert not Path("c.html").exists()
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", "faces.csv", "--noise", "0.1", *stated, "--item", "prism no. 12"])
    assert not ended.value.code
    for path, message in (("c.pdf", "must end in .html"), ("no/c.html", "Not a directory")):
        words = ["calibrate", "faces.csv", "--certificate", path, "--item", "x"]
        if "/" in path:
            Path("no").write_text("a file, no folder")
        with pytest.raises(SystemExit) as ended:
            main([*words, "--folder", "made"])
        assert ended.value.code
        assert message in capsys.readouterr().err
        # refused before the work
        assert not Path("made").exists()
    page = Path("c.html").read_text("utf-8")
    assert "prism no. 12" in page
    assert "closed circle &lt;360&gt;" in page
    assert hashlib.sha256(Path("faces.csv").read_bytes()).hexdigest() in page
    # from face to face by the readings less their mean, which closes the circle
    error = np.cumsum(np.roll(rows[:, 1] - rows[:, 1].mean(), 1))
    error -= error.mean()
    for value in (error[1], error[7]):
        assert f"{value:.4f}".replace("-", "−") in page
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", "faces.csv", "--item", "prism"])
    assert ended.value.code == 2
    assert "for --certificate FILE" in capsys.readouterr().err


def long_form(path: str, group: str, numbers: tuple[int, ...], apart: int = 1) -> None:
    """Write readings of the polygon in rows of face, group and reading, in arcsec."""
    rows = [
        (apart * face, s, value)
        for s in numbers
        for face, value in enumerate(FACES - np.roll(TABLE, -s))
    ]
    np.savetxt(path, rows, delimiter=",", comments="", header=f"face,{group},reading")


def test_a_setting_keeps_its_sign(capsys: pytest.CaptureFixture[str]) -> None:
    long_form("long.csv", "setting", (-1, 0, 1, 4))
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", "long.csv", "--noise", "0.01", "--json"])
    assert not ended.value.code
    printed = json.loads(capsys.readouterr().out)
    faces = [p["error"] / ARCSEC for p in printed["points"] if p["of"] == "faces"]
    assert faces == pytest.approx(FACES - FACES.mean(), abs=1e-6)
    assert any("12 faces in the full circle" in note for note in printed["notes"])


def test_rounds_are_no_settings_and_faces_are_numbered_one_by_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    long_form("rounds.csv", "round", (1, 2))
    long_form("degrees.csv", "setting", (0, 1, 4, 6), apart=30)
    for file, message in (
        ("rounds.csv", "--method closure if they are rounds"),
        ("degrees.csv", "have numbers 30 apart: number them one by one"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["calibrate", file])
        assert ended.value.code == 2
        assert message in " ".join(capsys.readouterr().err.split())
