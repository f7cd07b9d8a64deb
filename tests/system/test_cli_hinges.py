"""`flexstage hinges`: its table, its JSON, and what it says about bad input."""

import json

import pytest

from flexstage.cli import main
from flexstage.hinges import RightCircular, compliance
from flexstage.quantities.material import material


def run(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["hinges", *words])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


CIRCULAR = ("--profile", "circular", "--neck", "0.4 mm", "--radius", "1.3 mm")


def test_json_is_one_object_with_every_method(capsys):
    status, out, err = run(
        capsys, *CIRCULAR, "--width", "8 mm", "--material", "Ti-6Al-4V", "--json"
    )
    assert (status, err) == (0, "")
    result = json.loads(out)
    what = material("Ti-6Al-4V")
    notch = RightCircular(neck_thickness=0.4e-3, radius=1.3e-3)
    spring = compliance(notch, what.youngs_modulus, what.poissons_ratio, 8e-3)
    rotation = [r for r in result["stiffness"] if r["quantity"] == "rotation"]
    assert [r["method"] for r in rotation[:3]] == ["wedge", "timoshenko", "euler-bernoulli"]
    assert rotation[0]["stiffness"] == pytest.approx(1.0 / spring.matrix[2, 2], rel=1e-12)
    assert "Schotborgh et al. 2005" in {r["method"] for r in rotation}
    # beam theory is too stiff
    assert rotation[1]["difference_percent"] > 5.0
    turn = result["largest_rotation"]
    assert turn["before_yield"] > turn["before_fatigue"] > 0.0


@pytest.mark.parametrize(
    "sizes",
    [
        ("circular", "--radius", "1 mm"),
        ("elliptical", "--length", "4 mm", "--depth", "1 mm"),
        ("corner-filleted", "--length", "6 mm", "--radius", "1 mm"),
        ("leaf", "--length", "6 mm", "--depth", "1 mm"),
        ("parabolic", "--length", "4 mm", "--depth", "1 mm"),
        ("hyperbolic", "--length", "4 mm", "--depth", "1 mm"),
        ("v", "--depth", "2 mm", "--half-angle", "30 deg", "--radius", "0.5 mm"),
        ("power", "--length", "4 mm", "--depth", "1 mm", "--exponent", "4"),
    ],
    ids=lambda s: s[0],
)
@pytest.mark.parametrize("cut", [(), ("--one-sided",)])
def test_every_profile_has_a_table(capsys, sizes, cut):
    status, out, err = run(capsys, "--profile", *sizes, *cut)
    assert (status, err) == (0, "")
    for part in ("wedge", "timoshenko", "concentration", "source:", "yield", "fatigue"):
        assert part in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--profile", "circle", "--radius", "1 mm"), "did you mean 'circular'"),
        (("--profile", "leaf"), "needs --length and --depth"),
        ((*CIRCULAR, "--depth", "1 mm"), "has no --depth"),
        (("--radius", "1"), "has no unit"),
        (("--radius", "1 kg"), "not a unit of length"),
        (("--radius", "1 mm", "--neck", "-1 mm"), "'--neck': must be from 1e-12 to 100 m"),
        (("--radius", "1 mm", "--neck", "1e-30 mm"), "must be from 1e-12 to 100 m"),
        (("--radius", "1e300 mm"), "must be from 1e-12 to 100 m"),
        ((*CIRCULAR, "--width", "0 mm"), "'--width': must be from 1e-12 to 100 m"),
        ((*CIRCULAR, "--plane", "straim"), "did you mean 'strain'"),
        ((*CIRCULAR, "--material", "Al 7075"), "did you mean 'Al 7075-T6'"),
        ((*CIRCULAR, "--exponent", "x"), "--exponent"),
        ((*CIRCULAR, "--lengthy", "1 mm"), "--lengthy"),
    ],
)
def test_bad_input_gets_one_sentence_and_status_2(capsys, words, said):
    status, out, err = run(capsys, *words)
    assert (status, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1
    assert "Traceback" not in err


def test_without_any_size_it_shows_a_circular_notch(capsys):
    status, out, _ = run(capsys, "--json")
    assert status == 0
    assert out == run(capsys, "--json", "--profile", "circular", "--radius", "1 mm")[1]
