"""`flexstage centre`: records of someone else's bench, its JSON, its figure, and bad input."""

import json

import numpy as np
import pytest
import typer

import flexstage.cli
from flexstage.centring import ARCSEC, exact_error
from flexstage.centring.geometry import exact_run_out
from flexstage.cli.centre import centre

E = np.array([41e-6, -29e-6])
R = 50e-3


@pytest.fixture
def run(capsys, monkeypatch):
    """Run the command; it joins the others where it is not among them."""
    app = flexstage.cli.app
    if not any(c.callback is centre for c in app.registered_commands):
        app = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)
        app.command("centre")(centre)
        app.callback()(lambda: None)
        monkeypatch.setattr(flexstage.cli, "app", app)

    def call(*words):
        with pytest.raises(SystemExit) as ended:
            flexstage.cli.main(["centre", *(str(word) for word in words)])
        said = capsys.readouterr()
        return ended.value.code, said.out, said.err

    return call


def turned(size=720, turns=1.0, start=0.0):
    return start + np.arange(size) * 2.0 * np.pi * turns / size


def write(path, *columns, header="angle,error"):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="")
    return path


@pytest.fixture
def bench(tmp_path):
    """One error value for each sample over a turn: degrees, as a magnetic encoder's record."""
    theta = turned(start=0.4)
    rng = np.random.default_rng(1)
    error = exact_error(theta, E, R) + 3.0 * ARCSEC * np.cos(2.0 * theta - 0.5)
    error += rng.normal(0.0, 0.3 * ARCSEC, theta.size) + np.radians(0.02)
    return write(tmp_path / "bench.csv", np.degrees(theta) % 360.0, np.degrees(error))


def test_harmonics_of_a_record(run, bench):
    status, out, err = run(bench, "--angle", "angle", "--error", "error", "--unit", "deg", "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)
    orders = [h["order"] for h in found["harmonics"]]
    assert orders == list(range(1, 13))
    second = found["harmonics"][1]
    assert second["unit"] == "deg"
    assert second["amplitude"] == pytest.approx(3.0 / 3600.0, rel=0.05)
    assert second["amplitude_arcsec"] == pytest.approx(3600.0 * second["amplitude"])
    assert second["phase_deg"] == pytest.approx(np.degrees(0.5), abs=2.0)
    assert np.hypot(second["cosine"], second["sine"]) == pytest.approx(second["amplitude"])
    assert found["offset"] == pytest.approx(0.02, abs=1e-4)
    assert found["residual_rms"] == pytest.approx(0.3 / 3600.0, rel=0.1)
    assert found["turns"] == pytest.approx(1.0, abs=0.01)
    assert found["samples"] == 720
    assert found["outliers"] == []
    assert "eccentricity" not in found
    assert any("--radius" in note for note in found["notes"])


@pytest.mark.parametrize("option", [("--radius", "50 mm"), ("--radius", "0.05 m")])
def test_eccentricity_and_move(run, bench, option):
    status, out, _ = run(
        bench,
        "--angle",
        "0",
        "--error",
        "1",
        "--unit",
        "deg",
        *option,
        "--mounting-angle",
        "30",
        "--json",
    )
    assert status == 0
    found = json.loads(out)
    e = found["eccentricity"]
    assert e["unit"] == "m"
    assert (e["x"], e["y"]) == pytest.approx(tuple(E), abs=4.0 * e["uncertainty_x"])
    assert e["value"] == pytest.approx(np.hypot(*E), abs=4.0 * e["uncertainty"])
    assert e["uncertainty"] < 0.01e-6
    assert e["phase_deg"] == pytest.approx(np.degrees(np.arctan2(*E[::-1])), abs=0.05)
    c, s = np.cos(np.pi / 6.0), np.sin(np.pi / 6.0)
    moved = [found["move"]["x"], found["move"]["y"]]
    assert moved == pytest.approx(-np.array([[c, s], [-s, c]]) @ [e["x"], e["y"]])


def test_sign_and_direction(run, bench):
    words = (bench, "--angle", "0", "--error", "1", "--unit", "deg", "--radius", "50 mm", "--json")
    plain = json.loads(run(*words)[1])["eccentricity"]
    other = json.loads(run(*words, "--sign", "-1")[1])["eccentricity"]
    assert (other["x"], other["y"]) == pytest.approx((-plain["x"], -plain["y"]))
    mirrored = json.loads(run(*words, "--head-direction", "cw")[1])["eccentricity"]
    assert (mirrored["x"], mirrored["y"]) == pytest.approx((plain["x"], -plain["y"]))


def test_the_sign_is_that_of_table_and_eccentricity(run, tmp_path):
    theta = turned()
    error = exact_error(theta, E, R)
    plain, opposite = (
        write(tmp_path / f"{n}.csv", theta, s * error) for n, s in (("p", 1), ("o", -1))
    )
    words = ("--angle", "0", "--error", "1", "--unit", "rad", "--radius", "50 mm", "--json")
    first = json.loads(run(plain, *words)[1])
    second = json.loads(run(opposite, *words, "--sign", "-1")[1])
    assert "error = reading - true angle" in first["convention"]
    for key in ("cosine", "sine", "phase_deg"):
        assert second["harmonics"][0][key] == pytest.approx(first["harmonics"][0][key])
    assert second["eccentricity"]["x"] == pytest.approx(first["eccentricity"]["x"])


@pytest.mark.parametrize("unit", ["deg", "count"])
def test_a_reading_beside_the_angle(run, tmp_path, unit):
    """A calibration file: true angle and what the encoder reads, each with its own wrap."""
    theta = turned(1000, turns=2.0, start=0.3)
    read = theta + exact_error(theta, E, R) + 2.0
    shown = np.degrees(read) % 360.0 if unit == "deg" else read / (2.0 * np.pi) * 65536 % 65536
    path = write(tmp_path / "c.csv", np.degrees(theta) % 360.0, shown, header="reference,encoder")
    words = ("--angle", "reference deg", "--reading", f"encoder {unit}")
    own = ("--counts", "65536", "--radius", "50 mm", "--kind", "disc")
    status, out, err = run(path, *words, *own, "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)["eccentricity"]
    assert (found["x"], found["y"]) == pytest.approx(tuple(E), abs=1e-11)


def test_a_reading_that_runs_backwards_is_refused(run, tmp_path):
    theta = np.degrees(turned(200))
    path = write(tmp_path / "b.csv", theta, (5.0 - theta) % 360.0)
    status, _, err = run(path, "--angle", "0", "--reading", "1", "--unit", "deg")
    assert status == 2
    assert "decrease where the angle increases" in err


def test_no_move_of_a_magnet_on_the_axis(run, tmp_path):
    theta = turned(400)
    rng = np.random.default_rng(4)
    error = 0.3 * np.sin(theta) + 0.9 * np.cos(2.0 * theta - 1.0) + rng.normal(0.0, 0.01, 400)
    path = write(tmp_path / "m.csv", np.degrees(theta), error)
    words = (path, "--angle", "0", "--error", "1", "--unit", "deg")
    for more in (("--kind", "magnet"), ("--radius", "5 mm")):
        found = json.loads(run(*words, *more, "--json")[1])
        assert "eccentricity" not in found
        assert any("no move" in note for note in found["notes"])
    assert "eccentricity" in json.loads(
        run(*words, "--radius", "5 mm", "--kind", "disc", "--json")[1]
    )
    status, _, err = run(*words, "--kind", "magnet", "--radius", "5 mm")
    assert status == 2
    assert "no radius" in err


def test_errors_that_are_exactly_zero(run, tmp_path):
    path = write(tmp_path / "z.csv", np.degrees(turned(360)), np.zeros(360))
    words = (path, "--angle", "0", "--error", "1", "--unit", "deg", "--radius", "50 mm")
    image = tmp_path / "z.svg"
    status, out, err = run(*words, "--figure", image)
    assert (status, err) == (0, "")
    assert "eccentricity 0.0000" in out
    assert image.exists()


def test_both_results_where_many_are_set_aside(run, tmp_path):
    theta = turned(500)
    error = exact_error(theta, E, R) + np.random.default_rng(7).normal(0.0, 1e-6, 500)
    error[20:200:9] += 3e-4
    path = write(tmp_path / "many.csv", theta, error)
    words = (path, "--angle", "0", "--error", "1", "--unit", "rad", "--radius", "50 mm")
    found = json.loads(run(*words, "--json")[1])
    plain = json.loads(run(*words, "--json", "--no-outliers")[1])
    assert len(found["outliers"]) == 20
    for own, whole in zip(found["harmonics_with_all"], plain["harmonics"], strict=True):
        assert own["amplitude"] == pytest.approx(whole["amplitude"])
    assert found["eccentricity_with_all"]["x"] == pytest.approx(plain["eccentricity"]["x"])
    for e in (found["eccentricity"]["interval"], plain["eccentricity"]["interval"]):
        assert found["eccentricity"]["interval"][0] <= e[0]
        assert e[1] <= found["eccentricity"]["interval"][1]
    said = run(*words)[1]
    assert "with all samples" in said
    # one line tells of all of them
    assert said.count("outliers: 20 rejected") == 1
    assert "and 14 more angles" in said


def test_clockwise_heads_are_mirrored(run, tmp_path):
    """Heads on a table seen from above, that turns counter-clockwise."""
    theta, alphas = turned(), np.radians([10.0, 95.0, 200.0])
    # in the room the head stands at alpha, the centre of the scale turns by theta
    centre_ = (E[0] + 1j * E[1]) * np.exp(1j * theta)
    columns = []
    for a in alphas:
        seen = np.angle((R * np.exp(1j * a) - centre_) * np.exp(-1j * (a)))
        columns.append(-seen)
    path = write(tmp_path / "heads.csv", theta, *columns, header="t,a,b,c")
    status, out, _ = run(
        path, "--angle", "t", "--error", "a,b,c", "--unit", "rad", "--heads", "10,95,200",
        "--radius", "50 mm", "--head-direction", "cw", "--json",
    )  # fmt: skip
    assert status == 0
    found = json.loads(out)
    assert (found["eccentricity"]["x"], found["eccentricity"]["y"]) == pytest.approx(
        tuple(E), abs=1e-12
    )
    assert [h["angle_deg"] for h in found["heads"]] == pytest.approx([10.0, 95.0, 200.0])
    assert found["reference_error"]["value"] < 1e-9


def test_four_heads_and_wrapped_errors_without_order(run, tmp_path):
    theta = np.random.default_rng(3).permutation(turned(360))
    columns = []
    for i, a in enumerate((0.0, 90.0, 180.0, 270.0)):
        error = exact_error(theta, E, R, head_angle=np.radians(a)) + 2e-4 * np.sin(theta)
        columns.append((np.degrees(error) + (360.0 if i == 2 else 0.0)) % 360.0)
    path = write(tmp_path / "four.csv", np.degrees(theta), *columns, header="angle,h1,h2,h3,h4")
    status, out, _ = run(
        path, "--angle", "angle", "--error", "h1,h2,h3,h4", "--unit", "deg",
        "--heads", "0,90,180,270", "--radius", "50 mm", "--json",
    )  # fmt: skip
    assert status == 0
    found = json.loads(out)
    assert (found["eccentricity"]["x"], found["eccentricity"]["y"]) == pytest.approx(
        tuple(E), abs=1e-10
    )
    assert found["reference_error"]["value"] == pytest.approx(2e-4, rel=1e-4)
    assert len(found["heads"]) == 4


def test_counts_without_an_angle_over_turns(run, tmp_path):
    theta = turned(900, turns=3.0)
    error = exact_error(theta, E, R) * 65536 / (2.0 * np.pi)
    path = write(tmp_path / "counts.csv", error, header="error")
    status, out, _ = run(
        path, "--error", "error", "--unit", "count", "--counts", "65536", "--turns", "3",
        "--radius", "50 mm", "--orders", "1:4", "--json",
    )  # fmt: skip
    assert status == 0
    found = json.loads(out)
    assert found["eccentricity"]["x"] == pytest.approx(E[0], abs=1e-10)
    assert found["turns"] == pytest.approx(3.0)


def test_units_of_the_file_go_before_unit(run, tmp_path):
    theta = turned(200)
    path = write(
        tmp_path / "u.csv", theta / (2.0 * np.pi), 7.0 * np.sin(theta), header="t,error (arcsec)"
    )
    status, out, _ = run(path, "--angle", "t turn", "--error", "1", "--unit", "deg", "--json")
    assert status == 0
    first = json.loads(out)["harmonics"][0]
    assert first["amplitude_arcsec"] == pytest.approx(7.0)
    assert (first["amplitude"], first["unit"]) == (pytest.approx(7.0 / 3600.0), "deg")


def test_outliers_are_named(run, tmp_path):
    theta = turned(400)
    error = np.sin(theta) + np.random.default_rng(5).normal(0.0, 0.01, 400)
    error[123] += 3.0
    path = write(tmp_path / "o.csv", np.degrees(theta), error)
    words = (path, "--angle", "angle", "--error", "error", "--unit", "deg")
    status, out, _ = run(*words, "--json")
    assert status == 0
    named = json.loads(out)["outliers"]
    assert [o["index"] for o in named] == [123]
    assert named[0]["angle_deg"] == pytest.approx(123 * 0.9)
    assert named[0]["residual"] == pytest.approx(3.0, abs=0.05)
    assert "sample 123" in run(*words)[1]
    assert json.loads(run(*words, "--no-outliers", "--json")[1])["outliers"] == []


def test_two_indicators(run, tmp_path):
    theta = turned(300)
    columns = [
        1e6 * exact_run_out(theta, E, R, indicator_angle=a) + 3.0 for a in (0.0, np.pi / 2.0)
    ]
    path = write(tmp_path / "i.csv", np.degrees(theta), *columns, header="angle,x (um),y (um)")
    status, out, _ = run(
        path, "--angle", "angle", "--error", "1,2", "--unit", "deg", "--heads", "0,90", "--json"
    )
    assert status == 0
    found = json.loads(out)
    assert found["eccentricity"]["y"] == pytest.approx(E[1], abs=1e-11)
    assert found["harmonics"][0]["amplitude_um"] == pytest.approx(1e6 * np.hypot(*E))
    assert found["harmonics"][0]["unit"] == "m"


def test_before_and_after_with_a_figure(run, bench, tmp_path):
    theta = turned()
    after = write(
        tmp_path / "after.csv",
        np.degrees(theta),
        np.degrees(exact_error(theta, 0.01 * E, R))
        + np.random.default_rng(8).normal(0.0, 1e-4, theta.size),
    )
    image = tmp_path / "polar.svg"
    status, out, _ = run(
        bench, after, "--angle", "0", "--error", "1", "--unit", "deg", "--radius", "50 mm",
        "--figure", image, "--json",
    )  # fmt: skip
    assert status == 0
    found = json.loads(out)
    assert len(found["setups"]) == 2
    values = [s["eccentricity"]["value"] for s in found["setups"]]
    assert values[1] < 0.02 * values[0]
    assert found["eccentricity"]["value"] == values[1]
    went = found["change"]["eccentricity"]
    assert (went["x"], went["y"]) == pytest.approx(tuple(-0.99 * E), abs=4 * went["uncertainty_x"])
    first = found["change"]["harmonics"][0]
    a, b = (s["harmonics"][0] for s in found["setups"])
    assert first["cosine"] == pytest.approx(b["cosine"] - a["cosine"])
    assert "change" not in found["setups"][0]
    drawn = image.read_text()
    assert drawn.startswith("<?xml")
    assert "before" in drawn
    assert "arcsec" in drawn


def test_files_of_one_head_each_join(run, tmp_path):
    theta = turned(240)
    files = [
        write(
            tmp_path / f"{i}.csv",
            theta,
            exact_error(theta, E, R, head_angle=np.radians(a)) + 1e-4 * np.cos(theta),
        )
        for i, a in enumerate((0.0, 180.0))
    ]
    status, out, _ = run(
        *files, "--angle", "0", "--error", "1", "--unit", "rad", "--heads", "0,180",
        "--radius", "50 mm", "--json",
    )  # fmt: skip
    assert status == 0
    found = json.loads(out)
    assert "setups" not in found
    assert found["eccentricity"]["x"] == pytest.approx(E[0], abs=1e-10)


def test_tables_for_people(run, bench):
    status, out, err = run(
        bench, "--angle", "angle", "--error", "error", "--unit", "deg", "--radius", "50 mm"
    )
    assert (status, err) == (0, "")
    assert "arcsec" in out
    assert "eccentricity 50.2" in out
    assert "µm" in out


def test_angle_and_error_are_taken_where_names_decide(run, tmp_path):
    theta = turned()
    error = np.degrees(exact_error(theta, E, R)) * 3600.0
    columns = (np.degrees(theta), error)
    path = write(tmp_path / "a.csv", *columns, header="Winkel [deg],Fehler [arcsec]")
    named = json.loads(run(path, "--angle", "0", "--error", "1", "--json")[1])
    plain = json.loads(run(path, "--json")[1])
    assert "angle Winkel; error Fehler: selected by their names" in plain["notes"]
    assert plain["harmonics"] == named["harmonics"]
    path = write(tmp_path / "b.csv", *columns, header="Winkel [deg],head [arcsec]")
    status, _, err = run(path)
    assert status == 2
    assert "does not show the angle and its errors: name them" in err
    assert "(columns: 0: Winkel [rad], 1: head [" in err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--error", "1"), "--turns"),
        (("--angle", "0", "--error", "1", "--turns", "1"), "omit --turns"),
        (("--angle", "0", "--error", "1"), "--unit"),
        (("--angle", "0", "--unit", "deg"), "--reading"),
        (("--angle", "0", "--error", "1", "--reading", "1"), "not both"),
        (("--reading", "1", "--turns", "1", "--unit", "deg"), "--angle"),
        (("--angle", "0", "--reading", "1", "--unit", "deg", "--sign", "-1"), "omit --sign"),
        (("--angle", "0", "--error", "nothing", "--unit", "deg"), "no column"),
        (("--angle", "0", "--error", "1", "--unit", "deg", "--rows", "0:300"), "cover"),
        (("--angle", "0", "--error", "1", "--unit", "V"), "must be an angle"),
        (("--angle", "0", "--error", "1", "--unit", "count"), "--counts"),
        (("--angle", "0", "--error", "0,1", "--unit", "deg"), "--heads"),
        (("--angle", "0", "--error", "1", "--unit", "deg", "--heads", "0,90"), "one angle"),
        (("--angle", "0", "--error", "1", "--unit", "deg", "--radius", "-1 mm"), "must be above 0"),
        (("--angle", "0", "--error", "1", "--unit", "deg", "--radius", "50 s"), "length"),
        (("--angle", "0", "--error", "1", "--unit", "deg", "--orders", "5:2"), "--orders"),
        (("--angle", "0", "--error", "1", "--unit", "deg", "--sign", "2"), "--sign"),
        (("--angle", "0", "--error", "1", "--unit", "deg", "--kind", "cone"), "--kind"),
        (("--angle", "0", "--error", "1", "--unit", "deg", "--figure", "a.gif"), "--figure"),
        (("--angle", "0", "--error", "1", "--unit", "deg", "--head-direction", "up"), "ccw or cw"),
    ],
)
def test_bad_input_gets_one_sentence(run, bench, words, said):
    status, out, err = run(bench, *words)
    assert status == 2
    assert out == ""
    assert said in err
    assert err.count("\n") == 1
    assert "Traceback" not in err


def test_a_constant_angle_and_missing_values(run, tmp_path):
    stuck = write(tmp_path / "s.csv", np.full(50, 3.0), np.arange(50.0))
    status, _, err = run(stuck, "--angle", "0", "--error", "1", "--unit", "deg")
    assert status == 2
    assert "did not turn" in err
    holes = np.arange(50.0)
    holes[7] = np.nan
    path = write(tmp_path / "n.csv", np.degrees(turned(50)), holes)
    status, _, err = run(path, "--angle", "0", "--error", "1", "--unit", "deg")
    assert status == 2
    assert err.count("\n") == 1


def test_degrees_that_are_called_radians_raise_a_doubt(run, bench):
    status, out, _ = run(bench, "--angle", "0", "--error", "1", "--unit", "rad", "--json")
    assert status == 0
    assert any("degrees" in note for note in json.loads(out)["notes"])
