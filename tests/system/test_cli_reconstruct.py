"""`flexstage reconstruct`: tables, JSON, files that other commands take, and bad input."""

import json

import pytest

from flexstage.cli import main

WORDS = (
    *("reconstruct", "parallelogram", "--model", "lumped", "--workers", "1", "--quiet"),
    *("--free", "leg.notch.neck_thickness=20 %", "--free", "thickness=20 %"),
    *("--match", "natural_frequency.x = 200 Hz +- 2 Hz"),
)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def run(capsys):
    """Run a command; return its exit status, and what it printed on both outputs."""

    def call(*words):
        with pytest.raises(SystemExit) as end:
            main(words)
        return (int(end.value.code or 0), *capsys.readouterr())

    return call


@pytest.mark.usefixtures("undrawn")
def test_members_are_stages_of_other_commands(run, tmp_path):
    status, out, _ = run(*WORDS, "--members", "3", "--folder", "out")
    assert status == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    members = {f"member-{k:03}.yaml" for k in (1, 2, 3)}
    assert names == {*members, "best.yaml", "reconstruct.json", "ranges.svg"}
    assert "wrote out/member-001.yaml to out/member-003.yaml" in out
    result = json.loads((tmp_path / "out" / "reconstruct.json").read_text())
    words = "analyse", "out/member-002.yaml", "--model", "lumped", "--json", "--quiet"
    rows = json.loads(run(*words)[1])["characteristics"]
    single = {(row["quantity"], row["axis"]): row["value"] for row in rows}
    promised = result["members"][1]["figures"]["natural_frequency.x"]
    assert single["natural_frequency_hz", "x"] == pytest.approx(promised, rel=1e-9)
    assert run("check", "out/best.yaml")[0] == 0
    few = ("--samples", "20", "--model", "lumped", "--quiet", "--workers", "1")
    assert run("tolerance", "out/member-003.yaml", *few)[0] == 0
    # a new run removes the members of this one, and no other file
    for name in ("member-0007.yaml", "member-mine.yaml"):
        (tmp_path / "out" / name).write_text("")
    assert run(*WORDS, "--members", "1", "--folder", "out")[0] == 0
    names = {path.name for path in (tmp_path / "out").glob("*.yaml")}
    assert names == {"member-001.yaml", "member-mine.yaml", "best.yaml"}


def test_tables_say_what_is_given_predicted_and_worth_a_measurement(run):
    status, out, _ = run(*WORDS, "--members", "0")
    assert status == 0
    assert "parallelogram: given figures" in out
    lines = out.splitlines()
    frequency = next(
        line for line in lines if line.startswith("Natural frequency") and "200" in line
    )
    # 2 Hz and 0.5 % of the model
    assert "2.2" in frequency.split()
    assert "spread left" in " ".join(out.split())
    mass = next(line for line in lines if line.startswith("Mass without drives"))
    assert "100 %" in mass
    assert "predicted" in mass
    assert "thickness to" in mass
    assert "1 given figures inform" not in out
    assert "1 given figure informs 1.0 of 2 dimensions" in out
    assert "no members (--members 0)" in out


def test_json_is_one_object_with_kinds(run):
    status, out, _ = run(*WORDS, "--members", "2", "--json")
    assert status == 0
    found = json.loads(out)
    kinds = {row["figure"]: row["kind"] for row in found["figures"]}
    assert kinds["natural_frequency.x"] == "given"
    assert kinds["mass"] == "predicted"
    assert len(found["members"]) == 2
    assert found["request"]["match"] == ["natural_frequency.x = 200 Hz +- 2 Hz"]
    assert found["dimensions"][0]["name"] == "leg.notch.neck_thickness"
    assert found["files"] == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "no published finite-element values of parallelogram"),
        (("--match", "mass >= 1 g"), "--match needs a figure and its value"),
        (("--match", "frequenzy.x = 2 Hz"), "there is no figure 'frequenzy.x'"),
        (("--match", "mass = 50 g", "--free", "leg_spacing"), "is not a range of a parameter"),
        (("--match", "mass = 50 g", "--time-limit", "0 s"), "above 0"),
    ],
)
def test_bad_input_is_one_sentence(run, words, said):
    status, _, err = run("reconstruct", "parallelogram", "--model", "lumped", "-q", *words)
    assert status == 2
    assert said in err
    assert len(err.strip().splitlines()) == 1
