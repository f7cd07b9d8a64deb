"""`flexstage run`: modes with the drives in place, and notes, in table, report and results."""

import json
import re

import pytest

from flexstage.cli import main
from flexstage.experiments.runner import RunState, write_state
from flexstage.instruments.protocol import Identity

TWIN = "twin://?seed=7&model=lumped"
PLAN = """\
plan: 1
stage: vgtu-piezo
sensors: {x: {channel: 1}}
steps:
  - {name: blows, excite: {kind: hammer-impacts, axis: x, impacts: 3}}
  - {name: blow, measure: {of: blows, test: response, sample_rate: 10 kHz, band: [200 Hz, 800 Hz]}}
  - name: sines
    excite:
      {kind: multisine, axis: x, band: [500 Hz, 1400 Hz], amplitude: 1 V, period: 0.2 s, periods: 3}
  - name: place
    measure: {of: sines, test: response, output: [x], sample_rate: 10 kHz, band: [500 Hz, 1400 Hz]}
  - {name: free, characterise: {of: [blow]}}
  - {name: in-place, characterise: {of: [place]}}
  - {name: again, characterise: {of: [place]}}
  - {name: falls, excite: {kind: descending-loops, axis: x, rate: 2 Hz, full: 2, descending: 3}}
  - {name: memory, measure: {of: falls, along: x}}
  - {name: model, identify: {of: [memory], output: x, model: [preisach]}}
  - name: held
    verify:
      {model: model, along: x, control_modes: [feedback],
       reference: {rate: 5 Hz, settle: 1, cycles: 2}}
"""


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """Folder of a run, and what it printed."""
    folder = tmp_path_factory.mktemp("figures")
    (folder / "modes.yaml").write_text(PLAN)
    return folder


def run(capsys, folder, *words):
    out = str(folder / "run")
    words = ["run", str(folder / "modes.yaml"), "--instrument", TWIN, "--folder", out,
             "--catalogue", "none", *words]  # fmt: skip
    with pytest.raises(SystemExit) as ended:
        main(words)
    said = capsys.readouterr()
    assert (ended.value.code, said.err) == (0, "")
    return said.out


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_modes_with_the_drives_in_place_are_told_apart(capsys, done):
    said = run(capsys, done)
    lines = [line for line in said.splitlines() if line.lstrip().startswith("natural frequency")]
    assert len(lines) == 2
    free, place = lines
    # published with the drives taken out; as many decimals as the uncertainty has
    value, spread, unit, step, published = free.split()[3:]
    assert (unit, step, published) == ("Hz", "blow", "337.0")
    assert len(value.partition(".")[2]) == len(spread.partition(".")[2])
    assert "drives in place" in place
    assert place.split()[-1] == "place"  # and nothing was published of it
    assert "note: held, feedback: the controller kept its present control settings" in said

    result = json.loads((done / "run" / "results.json").read_text())
    assert result["plan"] == "modes"
    (own,) = (f for f in result["figures"] if f["quantity"] == "natural_frequency_hz")
    (other,) = (f for f in result["further_figures"] if f["quantity"] == "natural_frequency_hz")
    assert (own["step"], len(own["published"])) == ("blow", 3)
    assert (other["step"], other["published"]) == ("place", [])
    assert other["note"].endswith("drives in place")
    # a stack adds its stiffness: the mode is far higher with the drives in place
    assert other["value"] > 2.0 * own["value"]

    page = (done / "run" / "report.html").read_text()
    row = re.search(r"Natural frequency, drives in place.*?</tr>", page)
    assert row is not None
    assert ">place<" in row[0]
    assert f">{int(other['value'])}." in row[0]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_run_that_is_taken_up_again_tells_the_same_notes_and_units(capsys, done):
    result = json.loads(run(capsys, done, "--resume", "--json"))
    held = next(s for s in result["steps"] if s["name"] == "held")
    (way,) = held["runs"]
    assert "the model has no natural frequency for the tuning" in way["notes"][0]
    assert held["units"]["tracking_rms"] == held["units"]["tracking_max"] == "m"
    assert set(held["units"]) <= set(way)
    assert way["tracking_rms_percent"] == pytest.approx(
        100.0 * way["tracking_rms"] / held["stroke"], rel=1e-12
    )


def test_a_folder_of_another_stage_is_refused(capsys, done):
    place = done / "other"
    place.mkdir()
    identity = Identity(vendor="v", model="m", simulated=True)
    begun = RunState(stage="vgtu-mechanical", instrument=identity, steps={})
    write_state(place, begun)
    words = ["run", str(done / "modes.yaml"), "--instrument", TWIN, "--only", "blow",
             "--folder", str(place), "--catalogue", "none", "--resume"]  # fmt: skip
    with pytest.raises(SystemExit) as ended:
        main(words)
    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert "contains a run on the stage 'vgtu-mechanical', and this is 'vgtu-piezo'" in said
    assert "complete steps are kept" not in said


@pytest.mark.parametrize("address", ["mysql://host/name", "no-database://host", "", "sqlite://"])
def test_an_address_that_no_catalogue_has_is_refused_before_anything_moves(
    capsys, done, tmp_path, address
):
    out = str(tmp_path / "run")
    words = ["run", str(done / "modes.yaml"), "--instrument", TWIN, "--folder", out,
             "--catalogue", address]  # fmt: skip
    with pytest.raises(SystemExit) as ended:
        main(words)
    said = capsys.readouterr()
    assert (ended.value.code, said.out) == (2, "")
    assert "catalogue" in said.err
    assert not (tmp_path / "run").exists()


def test_a_simulated_card_says_so_beside_the_results(capsys, tmp_path):
    words = ["run", "centring", "--instrument", "ni://Dev1?simulated=1", "--catalogue", "none",
             "--folder", str(tmp_path / "run"), "--json"]  # fmt: skip
    with pytest.raises(SystemExit) as ended:
        main(words)
    said = capsys.readouterr()
    assert ended.value.code == 0
    assert json.loads(said.out)["origin"] == "virtual"
    assert said.err == "flexstage: simulated card, as requested: not measured data\n"
