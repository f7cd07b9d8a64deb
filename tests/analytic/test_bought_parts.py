"""Bought parts: consistency of the makers' tables, and the key that names one."""

import math
from dataclasses import fields
from pathlib import Path

import jsonschema
import pytest

from flexstage.base.errors import StageError
from flexstage.cli import main
from flexstage.experiments.campaign.plan import read_campaign
from flexstage.stage import read_stage, write_stage
from flexstage.stage.bought_parts import bought_parts
from flexstage.stage.designs import design, find_stage
from flexstage.stage.drive import StackActuator
from flexstage.stage.file import stage_from_text, stage_schema, stage_to_text

PARTS = bought_parts()
STACKS = {n: p.drive for n, p in PARTS.drives.items() if isinstance(p.drive, StackActuator)}


@pytest.mark.parametrize("name", STACKS)
def test_blocking_force_is_stiffness_times_stroke(name: str) -> None:
    stack = STACKS[name]
    assert stack.blocking_force == pytest.approx(stack.stiffness * stack.free_stroke, rel=0.2)


@pytest.mark.parametrize("name", STACKS)
def test_capacitance_stores_more_than_the_work(name: str) -> None:
    """The square of the coupling factor, elastic over electric energy, is below 1."""
    stack = STACKS[name]
    low, high = stack.voltage_range
    coupling = stack.blocking_force * stack.free_stroke / (stack.capacitance * (high - low) ** 2)
    assert 0.3 < coupling < 1.0


@pytest.mark.parametrize(
    "name", [n for n, d in STACKS.items() if d.mass and PARTS.drives[n].free_resonance]
)
def test_resonance_is_that_of_a_free_bar(name: str) -> None:
    """Within a factor of 2: the printed mass has leads and coating."""
    part, stack = PARTS.drives[name], STACKS[name]
    bar = 0.5 * math.sqrt(stack.stiffness / stack.mass)
    assert 0.5 < bar / part.free_resonance < 2.0


def test_every_part_has_its_source() -> None:
    assert all(p.source and p.maker for p in (*PARTS.drives.values(), *PARTS.sensors.values()))


def test_the_stack_of_the_study_is_in_the_catalogue() -> None:
    drive, part = design("vgtu-piezo").drives[0], STACKS["P-887.91"]
    same = [f.name for f in fields(part) if f.name != "largest_slew"]
    assert [getattr(drive, n) for n in same] == [getattr(part, n) for n in same]


STAGE = stage_to_text(design("vgtu-piezo"))


def with_part(name: str, *keys: str) -> str:
    """Return the piezo stage with a bought part as its drive in x."""
    before, drive = STAGE.split("drives:\n  x:\n    kind: piezo\n")
    place, after = drive.split("    free_stroke:", 1)
    rest = after.split("\n  y:\n", 1)[1]
    lines = "".join(f"    {line}\n" for line in (f"as: {name}", *keys))
    return f"{before}drives:\n  x:\n{lines}{place}  y:\n{rest}"


def test_a_stage_file_names_a_part_and_is_read_back(tmp_path: Path) -> None:
    text = with_part("SA050520")
    stage = stage_from_text(text)
    drive = stage.drive("x")
    assert isinstance(drive, StackActuator)
    assert {f.name: getattr(drive, f.name) for f in fields(STACKS["SA050520"])} == {
        f.name: getattr(STACKS["SA050520"], f.name) for f in fields(STACKS["SA050520"])
    }
    write_stage(stage, tmp_path / "stage.yaml")
    assert read_stage(tmp_path / "stage.yaml") == stage


def test_keys_beside_the_part_replace_its_own() -> None:
    drive = stage_from_text(with_part("SA050520", "free_stroke: 20 um")).drive("x")
    assert drive.stroke == 20e-6
    assert drive.spring == 41e6
    stage_from_text(with_part("SA050520", "kind: piezo"))


@pytest.mark.parametrize(
    ("name", "keys", "message"),
    [
        ("SA050521", (), r"drives\.x\.as: unknown bought part 'SA050521'.*mean 'SA050520'\?"),
        ("SA050520", ("kind: screw",), r"'SA050520' is of kind 'piezo', not 'screw'"),
        ("[1]", (), r"drives\.x\.as: expected a text"),
        ("SA050520", ("stiffnss: 3 N/um",), r"unknown key 'stiffnss'.*did you mean 'stiffness'"),
    ],
)
def test_a_wrong_part_is_refused(name: str, keys: tuple[str, ...], message: str) -> None:
    with pytest.raises(StageError, match=message):
        stage_from_text(with_part(name, *keys))


def test_the_schema_knows_the_key() -> None:
    from flexstage.files.nodes import parse_yaml, plain
    from flexstage.stage.file import STAGE_FILE

    validator = jsonschema.Draft202012Validator(stage_schema())

    def faults(text: str) -> list[str]:
        node = parse_yaml(text, "text", "stage file", StageError)
        return [e.message for e in validator.iter_errors(plain(node))]

    assert STAGE_FILE.bought
    assert not faults(STAGE)
    assert not faults(with_part("SA050520"))
    assert not faults(with_part("SA050520", "kind: piezo", "mass: 1 g"))
    assert faults(with_part("SA050521"))
    assert faults(with_part("SA050520").replace("as: SA050520", "kind: piezo"))


def test_a_design_takes_a_part_whole(capsys) -> None:
    stage = find_stage("vgtu-piezo", {"x.actuator.as": "SR080418"})
    assert stage.drive("x").free_stroke == 21e-6
    # nothing of the stack that stood there is left
    assert stage.drive("x").largest_slew is None
    assert stage.drive("y") == design("vgtu-piezo").drive("y")
    with pytest.raises(SystemExit):
        main(["check", "vgtu-piezo", "--set", "x.actuator.as=P-88791"])
    assert "did you mean 'P-887.91'?" in capsys.readouterr().err


def test_an_instrument_may_be_a_bought_sensor(tmp_path: Path) -> None:
    file = tmp_path / "tests.yaml"
    file.write_text(
        "campaign: 1\ninstruments:\n  probe: {as: RESOLUTE, alignment: 1 mrad}\ntests:\n"
        "  t: {test: positioning, axis: x, along: probe, records: [a.csv]}\n",
        encoding="utf-8",
    )
    (sensor,) = read_campaign(file).instruments
    assert (sensor.name, sensor.resolution_step, sensor.alignment) == ("probe", 1e-9, 1e-3)
