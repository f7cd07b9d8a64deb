"""A stage file as a new user writes it, and what they are told when it is wrong."""

import json
import os
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import jsonschema
import pytest
import yaml

from flexstage.base.errors import FlexstageError
from flexstage.cli import main
from flexstage.stage import Stage
from flexstage.stage.checks import check
from flexstage.stage.designs import DESIGNS, build, design
from flexstage.stage.file import (
    SCHEMA_PATH,
    read_stage,
    stage_from_text,
    stage_schema,
    stage_to_text,
)

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "parallelogram.yaml"
#: The same without parameters, shared profiles and mirror images: tests break it in its places.
SPELLED_OUT = ROOT / "tests" / "spelled_out_parallelogram.yaml"
TEXT = SPELLED_OUT.read_text(encoding="utf-8")


def without_entry(text: str, name: str) -> str:
    """Take an entry of two blanks' indent out of the text."""
    out, n = re.subn(rf"^  {name}:.*\n(?:    .*\n)*", "", text, flags=re.M)
    assert n == 1
    return out


@dataclass(frozen=True)
class Broken:
    """An edit of the example, and what the one sentence must say.

    `by_schema`: whether the JSON Schema refuses it as well; the rest needs geometry or look-ups.
    """

    name: str
    old: str
    new: str
    says: tuple[str, ...]
    by_schema: bool = False


FILE_FAULTS = [
    Broken("missing key", "thickness: 10 mm\n", "", ("'thickness' is missing",), True),
    Broken(
        "missing key inside",
        "    at: [31.5, 15.5] # the middle of the neck\n",
        "",
        ("hinges.left foot", "'at' is missing"),
        True,
    ),
    Broken(
        "unknown key",
        "    fixed: true",
        "    fixd: true",
        ("bodies.base", "'fixd'", "did you mean 'fixed'"),
        True,
    ),
    Broken("wrong unit", "thickness: 10 mm", "thickness: 10 N", ("thickness", "'N'", "length")),
    Broken(
        "unknown unit",
        "stiffness: 40 N/um",
        "stiffness: 40 N/micron_",
        ("drives.stack.stiffness", "N/micron_"),
    ),
    Broken(
        "missing unit",
        "free_stroke: 15 um",
        "free_stroke: [15]",
        ("drives.stack.free_stroke", "a list"),
        True,
    ),
    Broken("angle without unit", "90 deg", "90", ("direction", "no unit", "deg"), True),
    Broken(
        "length without unit",
        "length_unit: mm",
        "#",
        ("no unit", "length_unit"),
    ),
    Broken(
        "unknown body",
        "bodies: [base, left leg]",
        "bodies: [base, left log]",
        ("hinges.left foot", "'left log'", "did you mean 'left leg'"),
    ),
    Broken(
        "unknown drive of an axis",
        "drive: stack",
        "drive: stuck",
        ("axes.x", "'stuck'", "did you mean 'stack'"),
    ),
    Broken(
        "unknown profile",
        "kind: circular",
        "kind: circlar",
        ("hinges.left foot.profile.kind", "'circlar'", "did you mean 'circular'"),
        True,
    ),
    Broken(
        "unknown kind of drive",
        "kind: piezo",
        "kind: motor",
        ("drives.stack.kind", "'motor'", "piezo", "screw"),
        True,
    ),
    Broken(
        "key of another profile",
        "neck_thickness: 0.5, radius: 1.5}",
        "neck_thickness: 0.5, half_length: 1.5}",
        ("hinges.left foot.profile", "unknown key 'half_length'"),
        True,
    ),
    Broken(
        "unknown material",
        "material: Al 7075-T6",
        "material: Al 7057-T6",
        ("material", "did you mean 'Al 7075-T6'"),
        True,
    ),
    Broken(
        "negative neck",
        "neck_thickness: 0.5,",
        "neck_thickness: -0.5,",
        ("hinges.left foot.profile", "neck_thickness must be positive"),
    ),
    Broken(
        "outline of two points",
        "outline: [[29, 17], [34, 17], [34, 41], [29, 41]]",
        "outline: [[29, 17], [34, 17]]",
        ("bodies.left leg.outline", "at least 3 points"),
    ),
    Broken(
        "point of three coordinates",
        "[34, 17], [34, 41]",
        "[34, 17, 0], [34, 41]",
        ("bodies.left leg.outline[1]", "2 coordinates"),
        True,
    ),
    Broken(
        "truth by another word", "fixed: true", "fixed: yes", ("bodies.base.fixed", "'yes'"), True
    ),
    Broken("falling voltage", "[0 V, 120 V]", "[120 V, 0 V]", ("drives.stack", "must rise")),
    Broken(
        "bulge without end",
        "[34, 17], [34, 41]",
        "[34, 17], {to: [34, 41], bulge: 1e9}",
        ("bodies.left leg.outline", "-1000 and 1000"),
    ),
    Broken(
        "far corner", "[0, 0], [81, 0]", "[0, 0], [1e300, 0]", ("bodies.base", "longer than 100 m")
    ),
    Broken(
        "mounting hole without end",
        "radius: 2.75",
        "radius: 1e12",
        ("mounting_holes[0]", "longer than 100 m"),
    ),
    Broken(
        "no mounting hole", "radius: 2.75", "radius: 0", ("mounting_holes[0]", "positive radius")
    ),
    Broken(
        "endless thickness",
        "thickness: 10 mm",
        "thickness: 1e300 m",
        ("thickness", "longer than 100 m"),
    ),
    Broken(
        "no thickness to speak of",
        "thickness: 10 mm",
        "thickness: 1e-150 mm",
        ("thickness", "shorter than 1e-12 m"),
    ),
    Broken(
        "neck of nothing",
        "neck_thickness: 0.5,",
        "neck_thickness: 1e-150,",
        ("hinges.left foot", "shorter than 1e-12 m"),
    ),
    Broken("negative mass", "mass: 35 g", "mass: -35 g", ("extra_masses[0]", "not below 0 kg")),
    Broken("negative inertia", "inertia: 4200", "inertia: -4200", ("extra_masses[0]", "inertia")),
    Broken("negative wire", "wire_width: 0.35", "wire_width: -1", ("manufacture", "not below 0 m")),
    Broken("negative patch", "half_width: 2", "half_width: -2", ("drives.stack", "patch")),
    Broken(
        "negative uncertainty",
        "thickness: 10 mm",
        "published: [{quantity: natural_frequency_hz, axis: x, origin: measured, value: 300 Hz, "
        "uncertainty: -1 Hz}]\nthickness: 10 mm",
        ("published[0]", "uncertainty"),
    ),
    Broken(
        "name of two lines",
        "name: parallelogram-example",
        'name: "a\\nb"',
        ("name: a name must be 1 to 80 printable",),
    ),
    Broken(
        "angle in a list",
        "direction: 0 deg\n    patch",
        "direction: [0, 1]\n    patch",
        ("expected an angle",),
        True,
    ),
    Broken("wrong version", "flexstage: 1", "flexstage: 2", ("version 1", "version 2"), True),
    Broken("no version", "flexstage: 1\n", "", ("'flexstage: 1', which is missing",), True),
    Broken("not YAML", "bodies:\n  base:", "bodies:\n  base: [", ("not YAML",)),
    Broken("tab", "  base:\n", "\tbase:\n", ("not YAML",)),
    Broken(
        "duplicate key", "thickness: 10 mm", "name: b\nthickness: 10 mm", ("'name' is given twice",)
    ),
    Broken(
        "alias",
        "bodies: [base, left leg]",
        "bodies: [&a base, *a ]",
        ("anchors", "'&a'"),
    ),
    Broken(
        "Python tag",
        "title: Para",
        "title: !!python/object/apply:os.system Para",
        ("tags", "python/object"),
    ),
    Broken("not a number", "mass: 35 g", "mass: .nan", ("not a finite number",)),
    Broken("two documents", "drives:\n", "---\ndrives:\n", ("second document",)),
    Broken("deep nesting", "notes_", "", ("nested more than 30",)),
    Broken(
        "design not there",
        "name: para",
        "design: {name: nested-xy}\nname: para",
        ("unknown key",),
        True,
    ),
]

STAGE_FAULTS = [
    Broken(
        "thin neck",
        "neck_thickness: 0.5,",
        "neck_thickness: 0.2,",
        ("minimum neck", "left foot", "0.2 mm"),
    ),
    Broken(
        "overlapping bodies",
        "[81, 0], [81, 14],",
        "[84, 0], [84, 50], [80, 50], [80, 48], [82, 48], [82, 14],",
        ("'base'", "'platform'", "overlap"),
    ),
    Broken(
        "slot too narrow",
        "[20, 14], [20, 62]",
        "[20, 14], [20, 48], [25.8, 48], [25.8, 50], [20, 50], [20, 62]",
        ("'base' and body 'platform'", "0.2 mm", "0.35 mm"),
    ),
    Broken(
        "slot too narrow in one body",
        "[0, 0], [81, 0]",
        "[0, 0], [40, 0], [40, 9], [40.3, 9], [40.3, 0], [81, 0]",
        ("body 'base'", "0.3 mm wide", "0.35 mm"),
    ),
    Broken(
        "root off its body",
        "at: [72.5, 15.5]",
        "at: [74.5, 15.5]",
        ("'right foot' is not attached to body 'right leg'",),
    ),
    Broken(
        "hinge turned round",
        "at: [72.5, 15.5]\n    direction: 90 deg",
        "at: [72.5, 15.5]\n    direction: 270 deg",
        ("'right foot' points from body", "reverse its direction (180 deg)"),
    ),
    Broken(
        "drive off its body",
        "at: [[26, 53], [20, 53]]",
        "at: [[25.9, 53], [20, 53]]",
        ("drive 'stack' pushes body 'platform'", "0.1 mm away"),
    ),
    Broken("probe off its body", "at: [81, 53]", "at: [82, 53]", ("probe 'gauge'", "1 mm outside")),
    Broken("no fixed body", "    fixed: true\n", "", ("no body is fixed",)),
    Broken(
        "crossed outline",
        "[[29, 17], [34, 17], [34, 41], [29, 41]]",
        "[[29, 17], [34, 17], [29, 41], [34, 41]]",
        ("outline of body 'left leg' crosses",),
    ),
    Broken(
        "hole outside",
        "centre: [71, 7], radius: 2.75",
        "centre: [71, 7], radius: 8",
        ("mounting_holes[1] of body 'base' reaches beyond",),
    ),
    Broken(
        "hinge twice",
        "  left head:",
        "  again:\n    bodies: [base, left leg]\n    at: [31.5, 15.5]\n    direction: 90 deg\n"
        "    profile: {kind: circular, neck_thickness: 0.4, radius: 1.5}\n  left head:",
        ("'left foot'", "'again'", "overlap"),
    ),
]


def broken_text(fault: Broken) -> str:
    if fault.name == "deep nesting":
        return TEXT + "notes: " + "[" * 40 + "]" * 40 + "\n"
    assert fault.old in TEXT, "the edit must still fit the example"
    return TEXT.replace(fault.old, fault.new, 1)


def one_sentence(text: str) -> bool:
    return "\n" not in text and 10 < len(text) < 700


def errors(stage: Stage) -> list[str]:
    return [f.message for f in check(stage) if f.severity == "error"]


def test_the_example_reads_and_checks_clean() -> None:
    stage = read_stage(EXAMPLE)
    assert check(stage) == ()
    assert stage.hinge("left head").at == (0.0315, 0.0425)
    assert stage.drive("stack").stroke == 15e-6
    # a quarter circle: tan(90 deg / 4)
    assert stage.body("platform").outline.bulges[1] == pytest.approx(2**0.5 - 1, abs=1e-8)


@pytest.mark.parametrize("fault", FILE_FAULTS, ids=lambda f: f.name)
def test_a_broken_file_is_refused_in_one_sentence(fault: Broken) -> None:
    with pytest.raises(FlexstageError) as caught:
        stage_from_text(broken_text(fault), source="my.yaml")
    message = str(caught.value)
    assert one_sentence(message)
    assert re.match(r"my\.yaml, line \d+", message)
    for part in fault.says:
        assert part in message


def test_the_line_is_the_one_with_the_fault() -> None:
    for name, old in (("unknown key", "fixed: true"), ("unknown profile", "kind: circular")):
        fault = next(f for f in FILE_FAULTS if f.name == name)
        line = TEXT[: TEXT.index(old)].count("\n") + 1
        with pytest.raises(FlexstageError, match=rf"line {line},"):
            stage_from_text(broken_text(fault))


@pytest.mark.parametrize("fault", STAGE_FAULTS, ids=lambda f: f.name)
def test_a_stage_that_cannot_be_is_found(fault: Broken) -> None:
    found = errors(stage_from_text(broken_text(fault)))
    assert len(found) == 1, found
    assert one_sentence(found[0])
    for part in fault.says:
        assert part in found[0]


def test_an_unconnected_body_is_named() -> None:
    text = without_entry(without_entry(TEXT, "left foot"), "left head")
    assert ["'left leg'" in e and "connects" in e for e in errors(stage_from_text(text))] == [True]


@pytest.mark.parametrize("hinge", ["left foot", "right head"])
def test_a_missing_hinge_leaves_a_free_motion(hinge: str) -> None:
    found = errors(stage_from_text(without_entry(TEXT, hinge)))
    assert len(found) == 1
    assert "keeps 2 degrees of freedom" in found[0]
    assert "hangs by a single hinge" in found[0]
    assert f"'{hinge.split(maxsplit=1)[0]} leg'" in found[0]


def test_a_drive_that_would_have_to_pull_is_a_warning() -> None:
    text = TEXT.replace("direction: 0 deg\n    patch", "direction: 180 deg\n    patch")
    findings = check(stage_from_text(text))
    assert [(f.severity, f.code) for f in findings] == [("warning", "drive-pulls")]


def test_what_is_no_stage_file_is_refused(tmp_path: Path) -> None:
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(TEXT.replace("Parallelogram", "Führung").encode("latin-1"))
    huge = tmp_path / "huge.yaml"
    huge.write_text(TEXT + "#" * 1_000_001, encoding="utf-8")
    pipe = tmp_path / "pipe.yaml"
    os.mkfifo(pipe)
    empty = tmp_path / "empty.yaml"
    empty.write_text("")
    cases = {
        tmp_path: "is a directory",
        tmp_path / "none.yaml": "there is no file",
        latin: "not UTF-8",
        huge: "larger than 1 MB",
        pipe: "not a regular file",
        empty: "empty",
        tmp_path / "n\0ul": "cannot be read",
    }
    for path, says in cases.items():
        with pytest.raises(FlexstageError, match=says) as caught:
            read_stage(path)
        assert one_sentence(str(caught.value))
        assert str(caught.value).count(str(path)) == 1


def test_the_length_unit_is_not_asked_for_where_it_is_given() -> None:
    with pytest.raises(FlexstageError) as caught:
        stage_from_text(TEXT.replace("half_width: 2", f"half_width: {'9' * 50}"))
    assert "length_unit" not in str(caught.value)


BOMBS = {
    "aliases": "a: &a [x, x]\n"
    + "".join(
        f"{chr(98 + k)}: &{chr(98 + k)} [{', '.join(['*' + chr(97 + k)] * 9)}]\n" for k in range(9)
    ),
    "open brackets": "a: " + "[" * 900_000,
    "open braces": "{a: " * 240_000,
    "question marks": "? " * 450_000,
    "dashes": "- " * 450_000,
    "commas": "a: [" + "1," * 490_000 + "]",
    "keys": "".join(f"k{k}: 1\n" for k in range(100_000)),
    "one long number": "flexstage: " + "9" * 990_000,
    "one long line": "flexstage: 1\nname: " + "x " * 490_000,
    "one long name": "flexstage: 1\n" + "k" * 900 + ": 1\n",
    "tags": "!!python/object/apply:os.system ['true']",
    "anchors": "".join(f"- &a{k} 1\n" for k in range(60_000)),
    "quotes": "a: '" + "'" * 900_000,
    "control characters": "a: \x07",
}


@pytest.mark.parametrize("name", BOMBS)
def test_hostile_files_end_early(name: str) -> None:
    # the largest of them take about 0.3 s; a reader that follows aliases or builds the tree first
    # takes minutes, or all memory
    start = time.process_time()
    with pytest.raises(FlexstageError) as caught:
        stage_from_text(BOMBS[name])
    assert time.process_time() - start < 20.0
    assert one_sentence(str(caught.value))
    if name in ("commas", "keys"):
        assert "more than 100000 values" in str(caught.value)


def test_the_schema_accepts_the_built_in_stages() -> None:
    validator = jsonschema.Draft202012Validator(stage_schema())
    for name in DESIGNS:
        text = stage_to_text(design(name))
        assert not list(validator.iter_errors(core_schema(text)))
        assert stage_from_text(text) == design(name)
    assert validator.is_valid({"flexstage": 1, "design": {"name": "nested-xy"}})
    # beside a design a stage has a name and a title of its own, and nothing else
    named = {"flexstage": 1, "design": {"name": "nested-xy"}, "name": "b", "title": "B"}
    assert validator.is_valid(named)
    assert not validator.is_valid({**named, "thickness": 0.01})


def test_the_built_in_stages_check_clean() -> None:
    for name in DESIGNS:
        assert not errors(design(name))


def test_a_design_is_built_by_whoever_reads() -> None:
    text = "flexstage: 1\ndesign:\n  name: some\n  arm: 3 mm\n  inner: {legs: [4, true]}\n"
    asked = []

    def builder(name: str, parameters: Mapping[str, object]) -> Stage:
        asked.append((name, parameters))
        return design("vgtu-piezo")

    assert stage_from_text(text, builder).name == "vgtu-piezo"
    assert asked == [("some", {"arm": "3 mm", "inner": {"legs": [4, True]}})]
    with pytest.raises(FlexstageError, match=r"line 3, design: .*not available"):
        stage_from_text(text)
    with pytest.raises(FlexstageError, match=r"line \d, design: .*some"):
        stage_from_text(text, build)


def test_the_schema_accepts_the_example_and_refuses_what_it_can() -> None:
    validator = jsonschema.Draft202012Validator(json.loads(SCHEMA_PATH.read_text(encoding="utf-8")))
    assert not list(validator.iter_errors(core_schema(TEXT)))
    missed = [
        f.name
        for f in FILE_FAULTS
        if f.by_schema and validator.is_valid(core_schema(broken_text(f)))
    ]
    assert not missed


def core_schema(text: str) -> object:
    """Load YAML as 1.2 has it, like the editors do: 'yes' is text."""

    class Loader(yaml.SafeLoader):
        pass

    Loader.yaml_implicit_resolvers = {
        first: [
            (tag, regexp) for tag, regexp in pairs if not tag.endswith(":bool") or first in "tTfF"
        ]
        for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }
    return yaml.load(text, Loader=Loader)


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Status, output and errors of the command in this process."""
    with pytest.raises(SystemExit) as ended:
        main(["check", *arguments])
    said = capsys.readouterr()
    return int(ended.value.code or 0), said.out, said.err


def test_the_command_prints_findings_and_exits_with_their_status(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = told(capsys, str(EXAMPLE))
    assert (status, err) == (0, "")
    assert "no problems found" in out

    thin = tmp_path / "thin.yaml"
    thin.write_text(TEXT.replace("neck_thickness: 0.5", "neck_thickness: 0.2"), encoding="utf-8")
    status, out, err = told(capsys, str(thin))
    assert (status, out) == (2, "")
    lines = err.splitlines()
    assert lines[0].startswith("error: the neck of hinge 'left foot' is 0.2 mm thick")
    assert lines[1:] == ["  the same for 3 more: left head; right foot; right head"]

    status, out, err = told(capsys, str(thin), "--json")
    assert (status, err) == (2, "")
    found = json.loads(out)
    assert found["ok"] is False
    assert {f["code"] for f in found["findings"]} == {"thin-neck"}
    assert found["findings"][0]["what"] == ["left foot"]

    unreadable = tmp_path / "unreadable.yaml"
    unreadable.write_text("a: [", encoding="utf-8")
    status, out, err = told(capsys, str(unreadable))
    assert (status, out) == (2, "")
    assert len(err.splitlines()) == 1


def test_an_outline_of_too_many_points_is_refused() -> None:
    corners = ", ".join(f"[{k % 7}, {k}]" for k in range(10_001))
    text = TEXT.replace(
        "outline: [[29, 17], [34, 17], [34, 41], [29, 41]]", f"outline: [{corners}]"
    )
    assert text != TEXT
    with pytest.raises(FlexstageError, match="at most 10000 points, got 10001"):
        stage_from_text(text)
