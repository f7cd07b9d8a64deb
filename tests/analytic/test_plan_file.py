"""What a plan file may say, and what is said of one that is wrong."""

from dataclasses import fields, replace
from typing import Any

import pytest

from flexstage.base.errors import PlanError, RecordError
from flexstage.experiments import dry_run, find_plan, plan_stage, read_plan, ready_plans
from flexstage.experiments.excitations import EXCITATIONS, EqualCycles, Multisine
from flexstage.experiments.plan import plan_from_text
from flexstage.experiments.verb import SensorEntry, Verb
from flexstage.experiments.verbs import VERBS, Identify, Measure, Verify
from flexstage.instruments.protocol import Identity
from flexstage.instruments.recording.metadata import RunMetadata

HEAD = """\
plan: 1
stage: vgtu-piezo
sensors:
  x: {channel: 1, calibration: 0.0005, alignment: 1 mrad}
  tilt: {channel: 5, unit: rad}
steps:
"""
LOOPS = "  - {name: loops, excite: {kind: cycles, axis: x, rate: 500 mHz, cycles: 4}}\n"
MOTION = "  - {name: motion, measure: {of: loops, test: motion, along: x, yaw: tilt}}\n"


def test_units_are_read_and_what_is_left_out_is_as_usual():
    plan = plan_from_text(
        HEAD
        + LOOPS
        + MOTION
        + "  - {name: sines, excite: {kind: multisine, axis: x, band: [0.4 kHz, 900 Hz], "
        "amplitude: 250 mV, period: 500 ms}}\n"
    )
    loops = plan.step("loops").action
    assert isinstance(loops, EqualCycles)
    assert (loops.rate, loops.cycles, loops.condition, loops.shape) == (0.5, 4.0, 1.0, "triangle")
    sines = plan.step("sines").action
    assert isinstance(sines, Multisine)
    assert (sines.band, sines.amplitude, sines.period) == ((400.0, 900.0), 0.25, 0.5)
    assert plan.sensor("x").alignment == pytest.approx(1e-3, rel=1e-15)
    assert plan.sensor("tilt").unit == "rad"
    assert plan.axis_of("motion") == "x"


def test_a_whole_number_may_be_written_as_people_do_and_not_in_what_programs_write():
    for text in ("3.0", "0.3e1", "3"):
        assert (
            plan_from_text(HEAD.replace("channel: 1", f"channel: {text}") + LOOPS)
            .sensor("x")
            .channel
            == 3
        )
    with pytest.raises(PlanError, match="expected a whole number"):
        plan_from_text(HEAD.replace("channel: 1", "channel: 1.5") + LOOPS)
    about = RunMetadata(stage="guide", instrument=Identity(vendor="v", model="m"), seed=3).plain()
    assert RunMetadata.from_plain(about).seed == 3
    with pytest.raises(RecordError, match=r"expected a whole number.*got 3\.0"):
        RunMetadata.from_plain({**about, "seed": 3.0})


def test_a_sensor_is_an_instrument_of_a_campaign_without_its_channel():
    own = plan_from_text(HEAD + LOOPS + MOTION).sensor("x")
    assert own.instrument.name == "x"
    assert own.instrument.calibration == own.calibration == 0.0005
    assert not hasattr(own.instrument, "channel")


def test_whole_numbers_may_be_given_as_floats():
    floats: dict[str, Any] = {"periods": 4.0, "seed": 3.0}
    sines = Multisine(axis="x", band=(2.0, 9.0), amplitude=0.5, **floats)
    # a sine is repeated, and a channel is asked for, by a number that counts
    assert repr(sines) == repr(replace(sines, periods=4, seed=3))
    own: dict[str, Any] = {"channel": 2.0}
    assert str(SensorEntry(name="x", **own).channel) == "2"
    options: dict[str, Any] = {"modes": 3.0}
    assert repr(Measure(of="m", test="response", **options).modes) == "3"


def test_steps_that_are_wanted_bring_those_that_they_use():
    plan = read_plan(find_plan("vgtu-piezo"))
    names = [step.name for step in plan.selected(("bouc-wen-y",))]
    assert names == ["usual-y", "loops-y", "bouc-wen-y"]
    assert plan.selected(None) == plan.steps


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("stage: vgtu-piezo\n", 1, "begins with 'plan: 1'"),
        ("plan: 2\nstage: vgtu-piezo\nsteps: []\n", 1, "version 2 is not known"),
        ("plan: 1\nnotes: []\n", 1, "'stage' is missing"),
        ("plan: 1\nstage: s\nsteps: []\n", 3, "list of steps"),
        ("plan: 1\nstage: s\nstep: []\n", 3, "did you mean 'steps'?"),
        (HEAD + "  - {excite: {kind: dwell, axis: x}}\n", 7, "'name' is missing"),
        (HEAD + "  - {name: a}\n", 7, "needs exactly one verb"),
        (HEAD + "  - {name: a, excite: {kind: dwell, axis: x}, measure: {of: b}}\n", 7, "one verb"),
        (
            HEAD + "  - {name: a.b, excite: {kind: dwell, axis: x}}\n",
            7,
            "must not contain a space, dot",
        ),
        (HEAD + "  - {name: a, excites: {kind: dwell}}\n", 7, "did you mean 'excite'?"),
        (HEAD + "  - {name: a, excite: {axis: x}}\n", 7, "'kind' is missing"),
        (HEAD + "  - {name: a, excite: {kind: cycle, axis: x}}\n", 7, "did you mean 'cycles'?"),
        (HEAD + "  - {name: a, excite: {kind: cycles, axis: x}}\n", 7, "'rate' is missing"),
        (HEAD + "  - {name: a, excite: {kind: cycles, axis: x, rate: 3}}\n", 7, "Hz"),
        (HEAD + "  - {name: a, excite: {kind: cycles, axis: x, rate: 3 um}}\n", 7, "um"),
        (
            HEAD + "  - {name: a, excite: {kind: cycles, axis: x, rate: -3 Hz}}\n",
            7,
            "excite.rate: expected a frequency from",
        ),
        (
            HEAD + "  - {name: a, excite: {kind: cycles, axis: x, rate: 3 Hz, cycles: 2.5}}\n",
            7,
            "a whole number from 1 to 1000000, got '2.5'",
        ),
        (
            HEAD
            + "  - {name: a, excite: {kind: cycles, axis: x, rate: 3 Hz, low: 0.7, high: 0.2}}\n",
            7,
            "rising fractions from 0 to 1",
        ),
        (
            HEAD + "  - {name: a, excite: {kind: multisine, axis: x, amplitude: 1 V, "
            "band: [900 Hz, 400 Hz]}}\n",
            7,
            "must rise",
        ),
        (HEAD + MOTION, 7, "uses 'loops', which is not an earlier step"),
        (HEAD + LOOPS + LOOPS, 8, "two steps are called 'loops'"),
        (
            HEAD + LOOPS + "  - {name: m, measure: {of: loops, test: motion, along: z}}\n",
            8,
            "the sensor 'z', which is not described (described: x, tilt)",
        ),
        (
            HEAD + LOOPS + "  - {name: m, measure: {of: loops, test: spheres, along: x}}\n",
            8,
            "'spheres' is not possible in a plan",
        ),
        (
            HEAD + LOOPS + "  - {name: c, characterise: {of: [loops]}}\n",
            8,
            "which is a step of excite: name a step of measure",
        ),
        (
            HEAD + LOOPS + "  - {name: m, measure: {of: loops, along: x}}\n"
            "  - {name: c, characterise: {of: [m]}}\n",
            9,
            "which has no kind of test",
        ),
        (
            HEAD + LOOPS + MOTION + "  - {name: i, identify: {of: [motion], output: x, "
            "model: [preisac]}}\n",
            9,
            "the model 'preisac' is not known",
        ),
        (
            HEAD + LOOPS + MOTION + "  - {name: i, identify: {of: [motion], output: x}}\n"
            "  - {name: v, verify: {model: i, along: x, control_modes: [inverse, thinking]}}\n",
            10,
            "unknown control mode 'thinking'",
        ),
        (
            HEAD + LOOPS + MOTION + "  - {name: i, identify: {of: [motion], output: x, "
            "characterised_by: motion}}\n",
            9,
            "from a step of characterise",
        ),
        (
            HEAD.replace("channel: 5", "channel: 0") + LOOPS,
            5,
            "channel: expected a whole number from 1, got '0'",
        ),
        (
            HEAD.replace("unit: rad", "unit: deg") + LOOPS,
            5,
            "unit: expected one of m, rad, got 'deg'",
        ),
        (HEAD.replace("alignment", "alignments") + LOOPS, 4, "did you mean 'alignment'?"),
        ("plan: 1\nstage: &a s\n", 2, "not used in a plan"),
        ("plan: 1\n  stage: s\n", 2, "this is not YAML"),
    ],
)
def test_a_wrong_plan_is_refused_in_one_sentence_with_its_line(text: str, line: int, words: str):
    with pytest.raises(PlanError) as caught:
        plan_from_text(text, source="mine.yaml")
    said = str(caught.value)
    assert said.startswith(f"mine.yaml, line {line}")
    assert words in said
    assert "\n" not in said


def test_a_file_that_is_not_there_is_named_with_what_is():
    with pytest.raises(PlanError, match="did you mean 'vgtu-piezo'"):
        find_plan("vgtu-pieso")
    with pytest.raises(PlanError, match="'' is neither a built-in plan nor a file"):
        find_plan("")
    with pytest.raises(PlanError, match="give the path of a plan"):
        read_plan("/nowhere/plan.yaml")


def test_a_stage_that_is_not_there_is_named(tmp_path):
    plan = plan_from_text(HEAD.replace("vgtu-piezo", "mine.yaml") + LOOPS)
    with pytest.raises(PlanError, match=r"'mine.yaml' is neither a built-in design nor a file"):
        plan_stage(plan, tmp_path)


def test_ready_plans_can_be_carried_out_and_say_how_long_they_take():
    made = {name: read_plan(path) for name, path in ready_plans().items()}
    assert set(made) >= {"vgtu-piezo", "vgtu-mechanical", "centring"}
    found = {name: dry_run(plan, plan_stage(plan)) for name, plan in made.items()}
    assert all(not run.problems for run in found.values())
    # three minutes of the stage's time: somebody stands beside it
    assert 60.0 < found["vgtu-piezo"].duration < 180.0
    assert 60.0 < found["vgtu-mechanical"].duration < 180.0


def test_the_piezo_plan_holds_what_the_study_did():
    plan = read_plan(find_plan("vgtu-piezo"))
    tests = {s.action.test for s in plan.steps if isinstance(s.action, Measure)}
    assert tests >= {"motion", "staircase", "hold", "response", "workspace"}
    models = {m for s in plan.steps if isinstance(s.action, Identify) for m in s.action.model}
    assert models >= {"bouc-wen", "preisach"}
    modes = {m for s in plan.steps if isinstance(s.action, Verify) for m in s.action.control_modes}
    assert modes == {"open loop", "inverse", "feedback", "both", "learning"}


def test_a_dry_run_says_which_limit_a_command_leaves():
    fast = LOOPS.replace("500 mHz", "90 Hz").replace("cycles: 4", "cycles: 4, shape: cosine")
    plan = plan_from_text(HEAD.replace("steps:", "defaults: {command_rate: 10 kHz}\nsteps:") + fast)
    (only,) = dry_run(plan, plan_stage(plan)).steps
    assert only.problem == ""
    # the slope of a cosine is pi f times its range, 33.9 kV/s of the 40 kV/s that are allowed
    assert only.motions[0].largest_rate == pytest.approx(3.14159 * 90.0 * 120.0, rel=1e-2)
    assert only.motions[0].rate_limit == 40e3
    faster = plan_from_text(
        HEAD.replace("steps:", "defaults: {command_rate: 10 kHz}\nsteps:")
        + fast.replace("90 Hz", "125 Hz")
    )
    found = dry_run(faster, plan_stage(faster))
    assert "its limit is 40000 V/s" in found.problems[0]


def test_a_dry_run_needs_positions_of_a_piezo_axis_only_about():
    text = HEAD + "  - {name: t, excite: {kind: positioning, axis: x, targets: 5, rounds: 2}}\n"
    plan = plan_from_text(text)
    (only,) = dry_run(plan, plan_stage(plan)).steps
    (motion,) = only.motions
    assert motion.estimated
    assert motion.unit == "m"
    # of the published 63.12 um
    assert 0.0 < motion.low < motion.high < 63.12e-6


def test_a_stage_without_such_an_axis_is_told_in_the_dry_run():
    plan = plan_from_text(HEAD + LOOPS.replace("axis: x", "axis: z") + MOTION)
    found = dry_run(plan, plan_stage(plan))
    assert "has no axis 'z': its axes are x, y" in found.problems[0]
    assert "'loops' has no command" in found.problems[1]


@pytest.mark.parametrize("kind", [*VERBS.values(), *EXCITATIONS.values()])
def test_no_key_of_a_verb_hides_what_every_verb_says_of_itself(kind: type[Verb]) -> None:
    assert not {field.name for field in fields(kind)} & set(dir(Verb))
