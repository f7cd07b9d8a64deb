"""What is wrong with the steps of a plan, before anything moves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from flexstage.plans.excite import Blows, Corners, Cycles
from flexstage.plans.verbs import Centre, Characterise, Identify, Measure, Verify

if TYPE_CHECKING:
    from flexstage.plans.plan import SensorEntry, Step


def problems(
    steps: tuple[Step, ...], sensors: tuple[SensorEntry, ...]
) -> Iterator[tuple[int, str]]:
    """Say what steps use that is not there."""
    before: dict[str, Step] = {}
    known = [s.name for s in sensors]
    # files are named after steps, and some systems do not tell large letters from small ones
    taken: dict[str, str] = {}
    for k, step in enumerate(steps):
        other = taken.setdefault(step.name.casefold(), step.name)
        if step.name in before:
            yield k, f"two steps are called '{step.name}': give each its own name"
        elif other != step.name:
            yield k, f"the steps '{other}' and '{step.name}' differ in capitals only: rename one"
        for name in step.needs:
            if name not in before:
                listed = ", ".join(before) or "none"
                yield (
                    k,
                    f"step '{step.name}' uses '{name}', which is no earlier step (there are: "
                    f"{listed})",
                )
                return
            if said := _wrong(step, before[name]):
                yield k, said
        for sensor in _sensors_of(step, before):
            if sensor not in known:
                listed = ", ".join(known) or "none"
                yield (
                    k,
                    f"step '{step.name}' reads the sensor '{sensor}', which is not described "
                    f"(there are: {listed}): list it under 'sensors'",
                )
        if said := _unread(step, before):
            yield k, said
        before[step.name] = step


#: Cycles without which a motion and its drift cannot be told apart.
_FEWEST_CYCLES = 3
#: Sensors without which a test cannot be evaluated.
_NEEDED: dict[str, tuple[str, ...]] = {
    "motion": ("along",),
    "positioning": ("along",),
    "staircase": ("along",),
    "hold": ("along",),
    "workspace": ("x", "y"),
}


def _unread(step: Step, before: Mapping[str, Step]) -> str:
    """Say what a step needs that no sensor will have read."""
    own = step.action
    if isinstance(own, Measure) and own.test is not None:
        source = before[own.of].action
        if missing := [r for r in _NEEDED.get(own.test, ()) if r not in own.roles]:
            return (
                f"step '{step.name}' is a test of kind {own.test} and does not say which sensor "
                f"reads {' and '.join(missing)}"
            )
        if own.test == "workspace" and not isinstance(source, Corners):
            return f"step '{step.name}' is a test of kind workspace: it needs a step of corners"
        if own.test == "response" and not own.output and not isinstance(source, Blows):
            return f"step '{step.name}' is a test of kind response: name its sensors as 'output'"
    if isinstance(own, Characterise):
        for name in own.of:
            record = before[name].action
            if not isinstance(record, Measure) or record.test != "motion":
                continue
            source = before[record.of].action
            if isinstance(source, Cycles) and source.cycles < _FEWEST_CYCLES:
                return (
                    f"step '{step.name}' evaluates the motion '{name}', which needs "
                    f"{_FEWEST_CYCLES} cycles at least, got {source.cycles:g}"
                )
    if isinstance(own, Identify):
        for name in own.of:
            record = before[name].action
            if isinstance(record, Measure) and own.output not in _sensors_of(before[name], before):
                return (
                    f"step '{step.name}' identifies by the sensor '{own.output}', which step "
                    f"'{name}' does not record: add it there under 'also'"
                )
    return ""


#: Verbs of the steps that a step can use.
_USES: dict[str, tuple[str, ...]] = {
    "measure": ("excite", "compensate"),
    "characterise": ("measure",),
    "identify": ("measure", "characterise"),
    "compensate": ("identify",),
    "verify": ("identify",),
}


def _wrong(step: Step, used: Step) -> str:
    """Say why a step cannot use another."""
    if used.verb not in _USES[step.verb]:
        allowed = " or ".join(_USES[step.verb])
        return (
            f"step '{step.name}' of {step.verb} uses '{used.name}', which is a step of "
            f"{used.verb}: name one of {allowed}"
        )
    action, own = used.action, step.action
    if isinstance(own, Identify) and (used.verb == "characterise") != (used.name == own.resonance):
        return (
            f"step '{step.name}' of identify takes records from steps of measure and its resonance "
            f"from one of characterise, got '{used.name}' of {used.verb}"
        )
    if step.verb == "characterise" and isinstance(action, Measure) and action.test is None:
        return (
            f"step '{step.name}' evaluates '{used.name}', which does not say what kind of test it "
            "is: give it 'test'"
        )
    return ""


def _sensors_of(step: Step, before: Mapping[str, Step]) -> tuple[str, ...]:
    action = step.action
    if isinstance(action, Measure):
        source = before.get(action.of)
        struck = source is not None and isinstance(source.action, Blows)
        # the accelerations of a blow are not the sensors of the plan
        return (*action.roles.values(), *(() if struck else action.output), *action.also)
    if isinstance(action, Identify):
        return (action.output,)
    if isinstance(action, Verify):
        return (action.along,)
    if isinstance(action, Centre):
        return action.sensors
    return ()
