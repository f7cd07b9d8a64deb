"""The step that evaluates records as the tests that they are."""

import math
from collections.abc import Iterator

from flexstage.characteristic import MeasuredCharacteristic
from flexstage.errors import PlanError
from flexstage.estimate import Component
from flexstage.experiments.campaign.evaluate import evaluate
from flexstage.experiments.campaign.plan import Campaign, Columns, Test
from flexstage.experiments.campaign.results import Characterisation, figure_of
from flexstage.experiments.excite import Blows, Chirp, Multisine
from flexstage.experiments.measure_step import RESPONSE, corner_visits
from flexstage.experiments.results import CharacterisedStep
from flexstage.experiments.run_context import RunContext
from flexstage.experiments.verbs import Characterise, Measure
from flexstage.records import Record

#: Roles that a kind of test reads.
_ROLES: dict[str, tuple[str, ...]] = {
    "motion": ("along", "across", "vertical", "roll", "pitch", "yaw"),
    "positioning": ("along",),
    "staircase": ("along",),
    "hold": ("along",),
    "workspace": ("x", "y"),
    "response": (),
}
_SIMULATED = ("the instrument is a simulation: nothing was measured",)
_COMMANDED = ("motion", "positioning", "staircase")


def characterised(context: RunContext, name: str, action: Characterise) -> CharacterisedStep:
    """Evaluate the records of earlier steps."""
    tests = tuple(_test(context, step) for step in action.of)
    campaign = Campaign(
        stage=context.plan.stage,
        origin=context.origin,
        instruments=tuple(sensor.instrument for sensor in context.plan.sensors),
        tests=tests,
        notes=(
            *(_SIMULATED if context.origin == "virtual" else ()),
            *context.plan.notes,
        ),
    )

    def load(test: Test) -> list[Record]:
        measured = context.measured(test.name)
        if test.kind == "workspace":
            return [corner_visits(measured.evaluated, test.columns.x or "", test.columns.y or "")]
        return [measured.evaluated]

    found = evaluate(campaign, load)
    return CharacterisedStep(name=name, found=found, ratios=tuple(_ratios(context, found)))


def _ratios(context: RunContext, found: Characterisation) -> Iterator[MeasuredCharacteristic]:
    """Give the ratio of each axis that a screw drives."""
    for result in found.results:
        stroke = result.details.get("stroke")
        record = context.measured(result.test.name).record
        if stroke is None or record.channel("command").unit != "m":
            continue
        sensor = found.campaign.instrument(result.test.along)
        gain = stroke.gain.times(math.copysign(1.0, stroke.gain.value), "1")
        if sensor is not None:
            # what a sensor is off by is a share of the stroke, and so of the ratio
            share = math.hypot(sensor.calibration, 0.5 * sensor.alignment**2)
            part = Component(name="sensitivity", uncertainty=share * gain.value, kind="B")
            gain = gain.plus(part)
        note = "slope of the platform's motion over that of the drive"
        yield figure_of(found.campaign, result.test, "transmission_ratio", gain, note)


def _test(context: RunContext, name: str) -> Test:
    """Return the description of a test that a step has measured."""
    action = context.plan.step(name).action
    assert isinstance(action, Measure)
    kind = action.test or ""
    source = context.plan.step(action.of).action
    axis = context.plan.axis_of(name)
    roles = {r: s for r, s in action.roles.items() if r in _ROLES[kind]}
    if kind != "response" and not roles:
        raise PlanError(
            f"step '{name}' is a test of kind {kind} and names no sensor: give "
            f"{' and '.join(_ROLES[kind][:2]) if kind == 'workspace' else 'along'}"
        )
    given: dict[str, object] = dict(roles)
    if kind in _COMMANDED:
        given["command"] = "command"
    if kind == "workspace":
        given["corner"] = "corner"
    excitation = "auto"
    if kind == "response":
        struck = isinstance(source, Blows)
        outputs = action.output or ((axis,) if struck else ())
        given["input"] = "force" if struck else "voltage"
        given["output"] = tuple(RESPONSE.format(a) for a in outputs) if struck else outputs
        excitation = "hammer" if struck else excitation
        excitation = "periodic" if isinstance(source, Multisine | Chirp) else excitation
    return Test(
        name=name,
        kind=kind,
        axis=axis,
        records=(context.measured(name).file.name,),
        columns=Columns(**given),  # type: ignore[arg-type]
        along=action.along or action.x,
        transverse=action.across or action.vertical,
        angle=action.yaw or action.pitch or action.roll,
        excitation=excitation,
        modes=action.modes,
        band=action.band,
        confidence=action.confidence,
        smallest_steps=action.smallest_steps,
        smallest_step=action.smallest_step,
    )
