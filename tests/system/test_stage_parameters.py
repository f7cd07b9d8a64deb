"""Parameters, shared profiles, mirror images and patterns in a stage file."""

import json
import math
import time
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from flexstage.base.errors import FlexstageError, PlanError, StageError, UnitError
from flexstage.experiments.plan import plan_from_text
from flexstage.hinges import RightCircular
from flexstage.stage import PlaneMotion, Stage, check, moved, read_stage, stage_from_text
from flexstage.stage.designs import StageTemplate, design, find_stage
from flexstage.stage.drawing.drawn_stage import read_drawing, stage_file_text
from flexstage.stage.drawing.requests import DrawingOptions
from flexstage.stage.file import SCHEMA_PATH
from tests.drawn_stages import dxf_without_hinges
from tests.system.test_stage_file import EXAMPLE, SPELLED_OUT, core_schema

HEAD = "flexstage: 1\nlength_unit: mm\nname: own\nthickness: 8 mm\nmaterial: Al 7075-T6\n"
#: A platform on one leg, to be turned about the origin; the notch is open on one side.
ROTOR = (
    HEAD
    + """\
parameters:
  n: 3
  R: 1.5 mm
  neck: {value: 0.5 mm, description: of every notch}
  ring: 30 mm
profiles:
  notch: {kind: circular, neck_thickness: = neck, radius: = R, one_sided: true}
bodies:
  hub: {outline: {centre: [0, 0], radius: 12}}
"""
)
#: The left half of a stage.
HALF = (
    HEAD
    + """\
parameters: {t: 0.5 mm, R: 1.5 mm, gap: = 2*R}
profiles:
  notch: {kind: circular, neck_thickness: = t, radius: = R, one_sided: true}
  thin: {kind: leaf, neck_thickness: = t, leaf_length: 4, notch_depth: = R}
bodies:
  base: {fixed: true, outline: [[-30, 0], [30, 0], [30, 6], [-30, 6]]}
  leg-left: {outline: [[-22, = 6 mm + gap], [-16, = 6 mm + gap], [-16, 30], [-22, 30]]}
  bar: {outline: [[-25, = 30 mm + gap], [25, = 30 mm + gap], [25, 40], [-25, 40]]}
hinges:
  foot-left: {bodies: [base, leg-left], at: [-18, = 6 mm + R], direction: 90 deg, profile: notch}
  head-left: {bodies: [leg-left, bar], at: [-18, = 30 mm + R], direction: 90 deg, profile: notch}
drives:
  push-left:
    {kind: force, pushes: bar, reacts: base, at: [[-25, 36], [-30, 6]], direction: -20 deg,
     largest_force: 3 N}
probes:
  eye-left: {body: bar, at: [-25, 38], direction: 30 deg, relative_to: leg-left}
axes:
  x: {drive: push-left, probe: eye-right}
"""
)
MIRROR = """\
mirror:
  - line: y
    of: [leg-left, foot-left, head-left, push-left, eye-left]
    rename: {left: right}
"""


def refusal(text: str, **settings: object) -> str:
    with pytest.raises(FlexstageError) as refused:
        stage_from_text(text, source="own.yaml", **settings)  # type: ignore[arg-type]
    said = str(refused.value)
    assert said.isprintable()
    return said


def changed(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, old
    return text.replace(old, new)


def test_the_example_is_what_was_spelled_out() -> None:
    short, long = read_stage(EXAMPLE), read_stage(SPELLED_OUT)
    assert not check(short)
    assert (
        sorted(short.hinges, key=lambda h: h.name)[:2]
        == sorted(long.hinges, key=lambda h: h.name)[:2]
    )
    for group in ("bodies", "hinges", "drives", "probes", "axes"):
        names = [[part.name for part in getattr(stage, group)] for stage in (short, long)]
        assert sorted(names[0]) == sorted(names[1])
    for name in names_of(long, "bodies"):
        there = [stage.body(name).outline.integrals() for stage in (short, long)]
        assert there[0] == pytest.approx(there[1], rel=1e-13)
    for name in names_of(long, "hinges"):
        a, b = short.hinge(name), long.hinge(name)
        assert (a.bodies, a.profile) == (b.bodies, b.profile)
        assert (*a.at, a.direction) == pytest.approx((*b.at, b.direction), rel=1e-13)


def names_of(stage: Stage, group: str) -> list[str]:
    return [part.name for part in getattr(stage, group)]


def test_one_edit_changes_the_neck_of_every_hinge() -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    edited = stage_from_text(changed(text, "t: {value: 0.5 mm,", "t: {value: 0.45 mm,"))
    given = find_stage(EXAMPLE, {"t": "0.45 mm"})
    assert edited == given == stage_from_text(text, set={"t": "0.45 mm"})
    assert {hinge.profile.neck_thickness for hinge in given.hinges} == {0.45e-3}
    assert not check(given)
    wider = find_stage(EXAMPLE, {"R": "2 mm", "leg": "= 20 mm + 2*t"})
    assert wider.hinge("right head").at[1] == 41e-3
    assert not check(wider)


def test_a_field_that_names_a_parameter_has_it_to_the_bit() -> None:
    stage = stage_from_text(HALF + MIRROR)
    assert stage.hinge("foot-left").profile == RightCircular(
        neck_thickness=0.5e-3, radius=1.5e-3, one_sided=True
    )
    assert stage.body("leg-left").outline.points[0] == (-0.022, 0.009)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("t: 0.5 mm,", "t: 30 deg,", "line 8, profiles.notch.neck_thickness: expected a length, "
         "got '= t', which is an angle (t is on line 6)"),
        ("t: 0.5 mm,", "t: -0.5 mm,", "which is -500 um (t is on line 6)"),
        ("gap: = 2*R", "gap: = 2*r", "line 6, parameters.gap: there is no parameter 'r'"),
        ("gap: = 2*R", "gap: = gap", "line 6, parameters.gap: circular reference: "
         "'gap' needs 'gap'"),
        ("R: 1.5 mm", "R: = gap/2", "parameters.R: circular reference: 'R' needs 'gap' needs 'R'"),
        ("gap: = 2*R", "gap: = 2*R + 3", "parameters.gap: a sum needs values of the same "
         "dimension, got a length and a number (R is on line 6)"),
        ("gap: = 2*R", "gap-y: = 2*R", "letters, digits and underscores"),
        ("gap: = 2*R", "max: = 2*R", "'max' is a function of expressions"),
        ("gap: = 2*R", "gap: [1, 2]", "a parameter must be a number, a quantity"),
        ("gap: = 2*R", "gap: true", "a parameter must be a number, a quantity"),
        ("gap: = 2*R", "gap: 1e999 mm", "is too large to be a number"),
        ("gap: = 2*R", "gap: 3 mn", "unknown unit 'mn'"),
        ("= 6 mm + R", "= 6 mm + ", "hinges.foot-left.at[1]: '= 6 mm +' is not "
         "an arithmetic expression"),
        ("direction: -20 deg", "direction: = t/R", "expected an angle, got '= t/R', which is a "
         "number (R is on line 6, t is on line 6)"),
        ("one_sided: true", "one_sided: = 1", "expected true or false"),
    ],
)  # fmt: skip
def test_errors_name_line_key_and_parameter(old: str, new: str, sentence: str) -> None:
    said = refusal(changed(HALF, old, new))
    assert said.startswith("own.yaml, line ")
    assert sentence in said


def test_what_is_set_is_said_to_be() -> None:
    assert "which is -500 um (t is set)" in refusal(HALF + MIRROR, set={"t": "-0.5 mm"})
    said = refusal(HALF + MIRROR, set={"tt": "1 mm"})
    assert said == "own.yaml has no parameter 'tt': did you mean 't'?"
    assert "it has none under 'parameters'" in refusal(HEAD, set={"t": "1 mm"})
    assert "own.yaml, parameters.t: unknown unit" in refusal(HALF, set={"t": "1 mn"})
    assert "own.yaml, parameters.t: '1 +' is no" not in refusal(HALF, set={"t": "1 +"})


def test_counts_are_whole_numbers() -> None:
    pattern = "pattern:\n  - {of: [a], count: = n, step: [= 3*R, 0]}\n"
    row = HEAD + "parameters: {n: 7, R: 2 mm}\nbodies:\n  a: {outline: [[0, 0], [4, 0], [4, 9]]}\n"
    stage = stage_from_text(row + pattern)
    assert names_of(stage, "bodies") == ["a", *(f"a-{k}" for k in range(2, 8))]
    assert stage.body("a-7").outline.points[0] == pytest.approx((36e-3, 0.0), rel=1e-15)
    said = refusal(row + pattern.replace("= n", "= n/2"))
    assert "expected a whole number from 2 to 1000, got '= n/2', which is 3.5" in said
    assert "from 2 to 1000" in refusal(row + pattern.replace("= n", "= n - 6"))


def test_other_kinds_of_files_have_no_parameters() -> None:
    with pytest.raises(PlanError, match="unknown key 'parameters'"):
        plan_from_text("plan: 1\nstage: vgtu-piezo\nparameters: {t: 1 mm}\n")


def test_a_mirror_image_is_the_reflection_of_each_part() -> None:
    stage = stage_from_text(HALF + MIRROR)
    motion = PlaneMotion.reflection(math.pi / 2.0)
    names = {f"{part}-left": f"{part}-right" for part in ("leg", "foot", "head", "push", "eye")}
    for group in ("bodies", "hinges", "drives", "probes"):
        for part in getattr(stage, group):
            if part.name in names:
                image = next(p for p in getattr(stage, group) if p.name == names[part.name])
                assert image == moved(part, motion, names)
    # a notch of one side stays open to its own side, which is the outer one on both legs
    assert stage.hinge("foot-right").bodies == ("leg-right", "base")
    assert stage.probe("eye-right").relative_to == "leg-right"
    assert not [issue for issue in check(stage) if issue.severity == "error"]


@pytest.mark.parametrize(
    ("line", "motion"),
    [
        ("x", PlaneMotion.reflection(0.0)),
        ("{x: -7}", PlaneMotion.reflection(math.pi / 2.0, through=(-7e-3, 0.0))),
        ("{y: = 30 mm + R}", PlaneMotion.reflection(0.0, through=(0.0, 31.5e-3))),
        ("[[1, 2], [4, 6]]", PlaneMotion.reflection(math.atan2(4, 3), through=(1e-3, 2e-3))),
    ],
)
def test_a_line_of_symmetry_may_lie_anywhere(line: str, motion: PlaneMotion) -> None:
    entry = f"mirror:\n  - {{line: {line}, of: [bar], rename: {{bar: image}}}}\n"
    stage = stage_from_text(HALF.replace("eye-right", "eye-left") + entry)
    image = moved(stage.body("bar"), motion, {"bar": "image"})
    flat = [c for point in image.outline.points for c in point]
    found = [c for point in stage.body("image").outline.points for c in point]
    assert found == pytest.approx(flat, abs=1e-15)


ARMS = """\
  arm-a: {outline: [[20, -3], [26, -3], [26, 3], [20, 3]]}
  rim: {fixed: true, outline: {centre: [0, 0], radius: 60}, holes: [{centre: [0, 0], radius: 40}]}
hinges:
  in-a: {bodies: [hub, arm-a], at: [18.5, -2], direction: 0 deg, profile: notch}
"""


def test_a_pattern_is_turned_or_shifted() -> None:
    text = ROTOR.replace("{outline: {centre: [0, 0], radius: 12}}", "{outline: [[-17, -17], "
                         "[17, -17], [17, 17], [-17, 17]]}")  # fmt: skip
    arms = ARMS.replace("{centre: [0, 0], radius: 60}", "[[-60, -60], [60, -60], [60, 60]]")
    turn = "pattern:\n  - of: [arm-a, in-a]\n    count: = n\n    turn: = 360 deg/n\n"
    stage = stage_from_text(text + arms + turn + "    rename: {a: [b, c]}\n")
    assert names_of(stage, "bodies") == ["hub", "arm-a", "rim", "arm-b", "arm-c"]
    third = stage.hinge("in-c")
    assert third.bodies == ("hub", "arm-c")
    assert math.remainder(third.direction - math.radians(240.0), math.tau) == pytest.approx(
        0.0, abs=1e-12
    )
    assert math.hypot(*third.at) == pytest.approx(math.hypot(18.5e-3, 2e-3), rel=1e-14)
    about = stage_from_text(
        text + arms + "pattern:\n  - {of: [arm-a, in-a], count: 2, turn: 90 deg, about: [5, 1]}\n"
    )
    # numbered where no names are given; (20, -3) lies (15, -4) from the point
    assert about.body("arm-a-2").outline.points[0] == pytest.approx((9e-3, 16e-3), abs=1e-15)


def test_copies_of_hinges_alone_join_the_bodies_of_their_new_names() -> None:
    both = changed(
        HALF,
        "  bar: {outline",
        "  leg-right: {outline: [[22, 9], [16, 9], [16, 30], [22, 30]]}\n  bar: {outline",
    )
    entry = MIRROR.replace("leg-left, foot", "foot")
    assert stage_from_text(both + entry).hinge("foot-right").bodies == ("leg-right", "base")


def test_what_stands_first_in_the_file_is_copied_first() -> None:
    row = HEAD + "bodies:\n  a: {outline: [[1, 0], [4, 0], [4, 9]]}\n"
    mirror = "mirror:\n  - {line: y, of: [a, a-2], rename: {a: b}}\n"
    pattern = "pattern:\n  - {of: [a], count: 2, step: [0, 20]}\n"
    assert names_of(stage_from_text(row + pattern + mirror), "bodies") == ["a", "a-2", "b", "b-2"]
    assert "no body, hinge, drive or probe 'a-2'" in refusal(row + mirror + pattern)


def test_whole_words_of_names_are_replaced() -> None:
    plate = "outline: [[1, 0], [4, 0], [4, 9]]"
    rows = "".join(f"  {name}: {{{plate}}}\n" for name in ("leg1-11", "a bar", "Leg-1"))
    entry = (
        "pattern:\n  - {of: [leg1-11, a bar, Leg-1], count: 2, step: [0, 20],"
        " rename: {'1': ['2'], a: [b], leg: [toe], toe: [leg]}}\n"
    )
    said = refusal(HEAD + "bodies:\n" + rows + entry)
    assert "pattern[0].rename: no name in 'of' has the word 'toe'" in said
    made = stage_from_text(HEAD + "bodies:\n" + rows + entry.replace(", toe: [leg]", ""))
    assert names_of(made, "bodies")[3:] == ["toe2-11", "b bar", "Leg-2"]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("foot-left, head-left,", "foot-lft, head-left,", "mirror[0].of: there is no body, "
         "hinge, drive or probe 'foot-lft'; did you mean 'foot-left'?"),
        ("{left: right}", "{lft: right}", "mirror[0].rename: no name in 'of' has the word 'lft'"),
        ("{left: right}", "{foot: toe}", "the copy of body 'leg-left' would be called 'leg-left'"),
        ("line: y", "line: z", "a line of symmetry is x, y"),
        ("line: y", "line: {z: 3}", "a line of symmetry is x, y"),
        ("line: y", "line: [[1, 1], [1, 1]]", "its two points are the same"),
        ("    rename: {left: right}\n", "", "'rename' is missing"),
        ("mirror:", "mirror: 3\nnotes:", "expected a list of mappings"),
        ("{left: right}", "{left: right}\n    turn: 3 deg", "unknown key 'turn'"),
    ],
)  # fmt: skip
def test_mirror_images_that_cannot_be_are_refused(old: str, new: str, sentence: str) -> None:
    said = refusal(changed(HALF + MIRROR, old, new))
    assert sentence in said
    assert said.startswith("own.yaml, line ")


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ("{of: [bar], count: 3}", "a pattern needs either 'turn' or 'step'"),
        ("{of: [bar], count: 3, turn: 3 deg, step: [1, 2]}", "needs either 'turn' or 'step'"),
        ("{of: [bar], count: 1, step: [1, 2]}", "a whole number from 2 to 1000"),
        (
            "{of: [bar], count: 3, step: [1, 2], rename: {bar: [b]}}",
            "renamed in 2 copies, got 1",
        ),
        ("{of: [bar], count: 3, step: [1, 2], rename: {bar: [b, b]}}", "would be called 'b'"),
        ("{of: [bars], count: 3, step: [1, 2]}", "did you mean 'bar'?"),
        ("{count: 3, step: [1, 2]}", "'of' is missing"),
        ("{of: bar, count: 3, step: [1, 2]}", "expected a list of texts"),
    ],
)
def test_patterns_that_cannot_be_are_refused(entry: str, sentence: str) -> None:
    said = refusal(HALF.replace("eye-right", "eye-left") + f"pattern:\n  - {entry}\n")
    assert sentence in said
    assert "pattern[0]" in said


def test_profiles_by_name_are_refused_where_there_are_none() -> None:
    one = changed(HALF, "at: [-18, = 6 mm + R], direction: 90 deg, profile: notch",
                  "at: [-18, = 6 mm + R], direction: 90 deg, profile: ntch")  # fmt: skip
    assert "hinges.foot-left.profile: unknown profile 'ntch'" in refusal(one)
    without = HALF.replace("profiles:", "notes: []\nprofile:").replace("profile:\n", "profiles:\n")
    assert "line 8, profiles.notch.radius: expected a length" in refusal(
        changed(without.replace("notes: []\n", ""), "radius: = R", "radius: deep")
    )
    cut = HALF[: HALF.index("profiles:")] + HALF[HALF.index("bodies:") :]
    assert "the profile 'notch' is not among 'profiles'" in refusal(cut)


def test_an_error_of_a_copy_is_told_where_it_is_made() -> None:
    twisted = HALF.replace("relative_to: leg-left", "relative_to: leg-lft")
    assert "line 22, probes.eye-left: probe 'eye-left' names the body 'leg-lft'" in refusal(
        twisted + MIRROR
    )
    entry = "mirror:\n  - {line: y, of: [foot-left], rename: {left: right}}\n"
    text = HALF.replace("bodies: [base, leg-left]", "bodies: [base, bar]")
    assert stage_from_text(text.replace("eye-right", "eye-left") + entry).hinge("foot-right")


def long(kind: str) -> tuple[str, str]:
    """A file that asks for very much, and what it is told."""
    plate = "bodies:\n  a: {outline: [[0, 0], [1, 0], [0, 1]]}\n"
    row = "bodies:\n  a: {outline: [[0, 0], " + ", ".join(f"[{k}, 1]" for k in range(400)) + "]}\n"
    each = "  - {of: [a], count: 1000, step: [1, 0], rename: {a: [%s]}}\n"
    names = [", ".join(f"b{k}x{i}" for i in range(999)) for k in range(12)]
    root = "= " + "+".join(["sqrt(2)"] * 60)
    chain = [f"  p{k + 1}: = p{k} + 1/{k + 2}\n" for k in range(999)]
    squares = [f"  p{k + 1}: = p{k}*p{k}\n" for k in range(999)]
    images = "".join(f"  - {{line: y, of: [a], rename: {{a: b{k}}}}}\n" for k in range(2000))
    return {
        "points": (row + "pattern:\n  - {of: [a], count: 1000, step: [1, 0]}\n", "100000 points"),
        "copies": (plate + "pattern:\n" + "".join(each % n for n in names), "10000 copies"),
        "images": (plate + "mirror:\n" + images, "'zebra'"),
        "names": (plate + f"mirror:\n  - {{line: y, of: [{'a, ' * 50_000}a], rename: {{a: b}}}}\n",
                  "expected 1 to 1000 names"),
        "roots": ("parameters:\n" + "".join(f"  p{k}: {root}\n" for k in range(300)) + plate,
                  "'zebra'"),
        "chain": ("parameters:\n  p0: 1\n" + "".join(chain) + plate, "'zebra'"),
        "squares": ("parameters:\n  p0: 1.1\n" + "".join(squares) + plate, "is too large"),
        "parameters": ("parameters:\n" + "".join(f"  p{k}: 1\n" for k in range(1001)) + plate,
                       "at most 1000 parameters"),
    }[kind]  # fmt: skip


@pytest.mark.parametrize(
    "kind", ["points", "copies", "images", "names", "roots", "chain", "squares", "parameters"]
)
def test_what_asks_for_very_much_ends_early(kind: str) -> None:
    text, sentence = long(kind)
    text = HEAD + text + "axes: {x: {drive: zebra, probe: b}}\n"
    start = time.process_time()
    assert sentence in refusal(text)
    # some tenths of a second; what grows with the square or worse takes minutes
    assert time.process_time() - start < 20.0


def test_the_schema_knows_all_of_it() -> None:
    schema = jsonschema.Draft202012Validator(json.loads(SCHEMA_PATH.read_text(encoding="utf-8")))
    pattern = "pattern:\n  - {of: [bar], count: = 2 + 1, turn: = 30 deg, rename: {bar: [b, c]}}\n"
    for text in (EXAMPLE.read_text(encoding="utf-8"), HALF + MIRROR, HALF + pattern):
        assert not list(schema.iter_errors(core_schema(text)))
    for old, new in (
        ("line: y", "line: z"),
        ("rename: {left: right}", "rename: [left, right]"),
        ("gap: = 2*R", "gap: [1]"),
        ("thickness: 8 mm", "thickness: R"),
        ("profile: notch}\n  head", "profile: [notch]}\n  head"),
    ):
        assert not schema.is_valid(core_schema(changed(HALF + MIRROR, old, new)))
    design = "flexstage: 1\nparameters: {t: 3 mm}\ndesign: {name: parallelogram, thickness: = t}\n"
    assert schema.is_valid(core_schema(design))


def test_a_design_in_a_file_has_parameters_too(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(
        "flexstage: 1\nparameters: {t: 0.4 mm}\ndesign:\n  name: nested-xy\n"
        "  based_on: vgtu-piezo\n  x: {lever_neck: = t}\n  y: {lever_neck: = t + 0.02 mm}\n"
    )
    assert find_stage(path) == find_stage(
        "vgtu-piezo", {"x.lever_neck": "0.4 mm", "y.lever_neck": "0.42 mm"}
    )
    assert find_stage(path, {"t": "0.45 mm", "slot": "0.9 mm"}) == find_stage(
        "vgtu-piezo", {"x.lever_neck": "0.45 mm", "y.lever_neck": "0.47 mm", "slot": "0.9 mm"}
    )
    with pytest.raises(UnitError, match=r"design.x.lever_neck: expected a length.*t is set"):
        find_stage(path, {"t": "4 s"})


def test_the_file_of_a_drawing_has_its_necks_as_parameters(tmp_path: Path) -> None:
    stage = design("parallelogram")
    path = tmp_path / "part.dxf"
    dxf_without_hinges(stage).saveas(path)
    drawn = read_drawing(path, DrawingOptions(thickness=8e-3, material="Al 7075-T6"))
    text = stage_file_text(drawn)
    assert stage_from_text(text) == drawn.stage
    assert "neck_thickness: 0.5 mm" in text
    thinner = stage_from_text(text, set={"neck_thickness": "0.42 mm"})
    assert {hinge.profile.neck_thickness for hinge in thinner.hinges} == {0.42e-3}
    blank = read_drawing(path, DrawingOptions(thickness=8e-3))
    assert "material" in blank.blanks
    assert "material: expected a text, got nothing" in refusal(stage_file_text(blank))


def test_numbers_from_python_are_in_si_units(tmp_path: Path) -> None:
    told = design_parameter("vgtu-piezo", {"x.lever_neck": "0.5 mm"}, "x.lever_neck")
    for value in (0.0005, np.float64(0.0005)):
        assert design_parameter("vgtu-piezo", {"x.lever_neck": value}, "x.lever_neck") == told
    path = tmp_path / "own.yaml"
    path.write_text(HALF + MIRROR)
    assert find_stage(path, {"t": 0.0006}) == find_stage(path, {"t": "0.6 mm"})
    made = StageTemplate.of(path, {"t": 0.0006}).stage()
    assert made == find_stage(path, {"t": "0.6 mm"}) != find_stage(path)
    # a text has its unit, and no file stands behind it
    with pytest.raises(UnitError, match=r"lever_neck: the length '0.0005' has no unit") as refused:
        find_stage("vgtu-piezo", {"x.lever_neck": "0.0005"})
    assert "length_unit" not in str(refused.value)
    with pytest.raises(StageError, match=r"'leg\.notch\.neck': did you mean 'leg.notch.neck_thick"):
        find_stage("parallelogram", {"leg.notch.neck": 0.0004})


def design_parameter(name: str, settings: dict[str, object], which: str) -> float:
    template = StageTemplate.of(name, settings)
    return next(p.value for p in template.parameters if p.name == which)
