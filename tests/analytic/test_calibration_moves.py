"""Trial moves: the field of a dipole read by probes, and lines that are read at a radius."""

import json

import numpy as np
import pytest

import flexstage.cli
from flexstage.base.errors import RecordError
from flexstage.centring import ARCSEC, exact_error, fit_harmonics, response_to_moves
from tests.dipole import CENTRE, STOOD, THETA, dipole_at


def responses(error_at, noise, seed=1):
    rng = np.random.default_rng(seed)
    fits = [
        fit_harmonics(THETA, error_at(p) + rng.normal(0.0, noise, THETA.size), orders=6)
        for p in STOOD
    ]
    return {n: response_to_moves(STOOD, [f.harmonic(n) for f in fits]) for n in range(1, 7)}


@pytest.mark.parametrize(
    ("joined", "moved", "relations"),
    [
        ("at a point", "magnet", {1: "linear"}),
        ("at a point", "probes", {1: "linear", 2: "quadratic"}),
        ("four", "magnet", {1: "linear", 3: "linear", 4: "quadratic"}),
        ("four", "probes", {1: "linear", 3: "linear"}),
        ("two", "magnet", {1: "linear", 3: "linear", 4: "quadratic"}),
    ],
)
def test_a_dipole_says_by_its_own_orders_where_the_axis_is(joined, moved, relations):
    """The field is that of a point dipole, and no model of the scale is in what is found of it."""

    found = responses(lambda p: dipole_at(p, joined, moved), np.radians(0.005))
    for order, relation in relations.items():
        r = found[order]
        assert r.relation == relation, order
        at = np.array([r.x.value, r.y.value])
        # terms beyond linear and quadratic pull it by some hundredths of the moves
        np.testing.assert_allclose(at, CENTRE, atol=6e-6, err_msg=str(order))
        assert 0.0 < r.x.uncertainty < 6e-6


def test_lines_at_a_radius_respond_linearly_with_their_gain():
    own = 5.0 * ARCSEC
    turned = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])

    def error_at(p):
        lines = own * np.cos(3.0 * THETA)
        return exact_error(THETA, tuple(turned @ (p - CENTRE)), 20e-3) + lines

    found = responses(error_at, 0.5 * ARCSEC)
    assert found[1].relation == "linear"
    assert found[1].gain == pytest.approx(1.0 / 20e-3, rel=2e-3)
    for value, true in ((found[1].x, CENTRE[0]), (found[1].y, CENTRE[1])):
        assert abs(value.value - true) < 4.0 * value.uncertainty + 0.1e-6
    # eccentricity has an order 2 of its own, half the square of e / R
    assert found[2].relation == "quadratic"
    assert found[2].gain == pytest.approx(0.5 / 20e-3**2, rel=0.02)
    # what does not follow the moves, however large, gives no place
    assert found[3].relation is None
    assert found[3].x is None


@pytest.mark.parametrize(
    ("stood", "message"),
    [
        ([[0.0, 0.0], [1e-5, 0.0]], "three positions"),
        ([[0.0, 0.0], [1e-5, 0.0], [2e-5, 1e-9]], "lie on a line"),
        ([[0.0, 0.0], [1e-5, 0.0], [np.nan, 0.0]], "finite"),
        ([0.0, 1.0, 2.0], "a position x, y for each record"),
    ],
)
def test_moves_that_tell_nothing_are_refused(stood, message):
    fit = fit_harmonics(THETA, np.cos(THETA), orders=2)
    with pytest.raises(RecordError, match=message):
        response_to_moves(stood, [fit.harmonic(1)] * len(stood))


@pytest.fixture
def bench(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(4)
    for i, p in enumerate(STOOD):
        error = dipole_at(p, "four", "magnet") + rng.normal(0.0, np.radians(0.01), THETA.size)
        table = np.degrees([THETA, error]).T
        np.savetxt(f"r{i}.csv", table, delimiter=",", header="angle,error", comments="")


def run(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        flexstage.cli.main(
            ["centre", *words, "--angle", "angle", "--error", "error", "--unit", "deg"]
        )
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


FILES = tuple(f"r{i}.csv" for i in range(5))
AT = "0,0; 100,0; 0,100; 100,100; -100 um,-0.05 mm"


def test_a_magnet_is_centred_from_records_at_known_positions(capsys, bench):
    status, out, err = run(capsys, *FILES, "--kind", "magnet", "--stage-at", AT, "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)
    assert "eccentricity" not in found
    centre = found["trial"]["centre"]
    assert (centre["x"], centre["y"]) == pytest.approx(tuple(CENTRE), abs=1.5e-6)
    last = found["trial"]["positions"][-1]
    assert centre["move_from_last"] == [centre["x"] - last[0], centre["y"] - last[1]]
    status, out, _ = run(capsys, *FILES, "--kind", "magnet", "--stage-at", AT)
    assert status == 0
    assert "centre by order 4: x +59." in out
    assert "one record gives no move" not in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((*FILES, "--stage-at", "0,0; 1,0"), "a position for each setup"),
        ((*FILES[:3], "--stage-at", "0,0; 1,0; 2"), "x,y for each setup"),
        ((*FILES[:3], "--stage-at", "0,0; 9,0; 0,9", "--kind", "magnet"), "four positions"),
        ((*FILES[:3], "--stage-at", "0,0; 9,0; 18,0"), "lie on a line"),
        ((*FILES[:3], "--stage-at", "0,0; 9,0; 0,9 K"), "not a unit of length"),
    ],
)
def test_positions_that_do_not_fit_are_refused(capsys, bench, words, message):
    status, _, err = run(capsys, *words)
    assert status == 2
    assert message in err
    assert "Traceback" not in err
