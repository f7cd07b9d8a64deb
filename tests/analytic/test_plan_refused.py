"""Plans that cannot be carried out are refused before anything moves, in one sentence."""

import pytest

from flexstage.base.errors import PlanError
from flexstage.experiments import dry_run
from flexstage.experiments.plan import plan_from_text
from flexstage.stage.designs import design

HEAD = """\
plan: 1
stage: vgtu-piezo
sensors: {x: {channel: 1}, y: {channel: 2}}
steps:
"""
LOOPS = "  - {name: a, excite: {kind: cycles, axis: x, rate: 0.7 Hz}}\n"
MOTION = "  - {name: m, measure: {of: a, along: x, test: motion}}\n"
MODEL = LOOPS + MOTION + "  - {name: model, identify: {of: [m], output: x}}\n"


def refused(steps: str) -> str:
    """Say why a plan is refused when it is read, or else when it is tried."""
    try:
        plan = plan_from_text(HEAD + steps)
    except PlanError as error:
        return str(error)
    return "; ".join(dry_run(plan, design("vgtu-piezo")).problems)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            "test: motion, along: x, confidence: 5",
            "a number between 0.5 and 1, got '5'",
        ),
        (
            "test: motion, along: x, smallest_step: -3 nm",
            "expected a length above 0 m",
        ),
        (
            "test: response, output: [x], modes: 2.5",
            "whole number from 1 to 100 (default: automatic), got '2.5'",
        ),
        ("test: response, output: [x], band: [70 Hz, 3 Hz]", "must rise from 0 Hz or more, got 70"),
        ("test: response", "name its sensors as 'output'"),
        ("test: motion", "name the sensor of along"),
        ("test: workspace, x: x", "name the sensor of y"),
        ("test: workspace, x: x, y: y", "needs a step of excite with kind workspace-corners"),
        ("along: x, sample_rate: 1e300 Hz", "from 0.001 to 1e+07 Hz, got '1e300 Hz'"),
        ("along: x, sample_rate: 1e-9 Hz", "from 0.001 to 1e+07 Hz, got '1e-9 Hz'"),
    ],
)
def test_a_record_that_could_not_be_evaluated_is_not_taken(options: str, said: str) -> None:
    assert said in refused(LOOPS + f"  - {{name: m, measure: {{of: a, {options}}}}}\n")


@pytest.mark.parametrize(
    ("step", "said"),
    [
        ("characterise: {of: [m, m]}", "characterise names 'm' twice"),
        (
            "identify: {of: [m], output: y}",
            "the output of sensor 'y', which step 'm' does not record",
        ),
        ("centre: {axes: [x, x]}", "centre needs two axes, got 'x' twice"),
        ("centre: {axes: [x, q]}", "has no axis 'q': its axes are x, y"),
        ("centre: {moves: 1000}", "from 1 to 100, got '1000'"),
        ("centre: {eccentricity: [1 m, 0 m]}", "smaller than its radius of 0.05 m, got 1 and 0"),
    ],
)
def test_a_step_that_could_not_use_what_was_measured_is_refused(step: str, said: str) -> None:
    assert said in refused(LOOPS + MOTION + f"  - {{name: s, {step}}}\n")


def test_a_motion_of_two_cycles_is_refused_before_it_is_measured() -> None:
    few = LOOPS.replace("0.7 Hz", "0.7 Hz, cycles: 2")
    assert refused(few + MOTION) == ""
    said = refused(few + MOTION + "  - {name: f, characterise: {of: [m]}}\n")
    assert "evaluates the motion 'm', which needs at least 3 cycles, got 2" in said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("reference: {rate: 333 Hz}", "the reference at 333 Hz needs an integer number of samples"),
        ("reference: {rate: 1e-9 Hz}", "the limit is 5000000"),
        ("reference: {cycles: 999999}", "the limit is 5000000"),
        # commands of 1 kHz have whole cycles, and records of 333 Hz have not
        ("sample_rate: 333 Hz, reference: {rate: 5 Hz}", "333 Hz gives 66.6"),
    ],
)
def test_references_without_whole_cycles_are_refused(options: str, said: str) -> None:
    assert said in refused(
        MODEL + f"  - {{name: v, verify: {{model: model, along: x, {options}}}}}"
    )


def test_an_instrument_of_another_rate_allows_other_references() -> None:
    plan = plan_from_text(
        HEAD + MODEL + "  - {name: v, compensate: {model: model, reference: {rate: 16 Hz}}}\n"
    )
    stage = design("vgtu-piezo")
    assert "the reference at 16 Hz needs an integer number" in dry_run(plan, stage).problems[0]
    # a quarter of it is 3.2 kHz, which are 200 samples a cycle
    assert dry_run(plan, stage, base_rate_hz=12800.0).problems == ()


@pytest.mark.parametrize(
    ("excitation", "said"),
    [
        ("chirp, axis: x, band: [10 Hz, 90 Hz], amplitude: 1 V, period: 0.1 ms", "has 0 samples"),
        ("staircase, axis: x, step: 2 mV, levels: 7, settle: 1e6 s", "the limit is 5000000"),
        ("positioning, axis: x, targets: 1e6, rounds: 1e6", "'positioning' would have 4000004"),
    ],
)
def test_commands_of_no_size_and_of_any_size_are_refused(excitation: str, said: str) -> None:
    assert said in refused(f"  - {{name: a, excite: {{kind: {excitation}}}}}\n")


@pytest.mark.parametrize("name", ["a*b", "what?", "a|b", '"a"', "<a>"])
def test_a_name_that_no_file_can_have_is_refused(name: str) -> None:
    said = refused(f"  - {{name: '{name}', excite: {{kind: hammer-impacts, axis: x}}}}\n")
    assert "files are named after their step" in said


def test_names_that_some_disks_cannot_tell_apart_are_refused() -> None:
    said = refused(LOOPS + "  - {name: A, excite: {kind: hammer-impacts, axis: x}}\n")
    assert "'a' and 'A' differ only in case" in said
