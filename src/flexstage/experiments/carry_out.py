"""What each verb does, and what is made of the files that it wrote."""

from pathlib import Path

import numpy as np

from flexstage.experiments.centre_step import centre_scale, centred_from
from flexstage.experiments.characterise_step import characterised
from flexstage.experiments.command import Strike
from flexstage.experiments.compensate_step import compensated
from flexstage.experiments.design import design_command
from flexstage.experiments.dry_run import settings_of
from flexstage.experiments.excite import Excite
from flexstage.experiments.identify_step import identified_from, identify_model
from flexstage.experiments.measure_step import measure, measured_from
from flexstage.experiments.plan import Step
from flexstage.experiments.results import CommandedStep, StepResult
from flexstage.experiments.run_context import RunContext
from flexstage.experiments.verbs import Centre, Characterise, Compensate, Identify, Measure, Verify
from flexstage.experiments.verify_step import verified_from, verify


def carry_out(context: RunContext, step: Step) -> list[Path]:
    """Do what a step asks for, and write what it gives."""
    action = step.action
    if isinstance(action, Measure):
        return [measure(context, step.name, action)]
    if isinstance(action, Identify):
        return [identify_model(context, step.name, action)]
    if isinstance(action, Verify):
        return verify(context, step.name, action)
    if isinstance(action, Centre):
        return [centre_scale(context, step.name, action)]
    return []


def result_of(context: RunContext, step: Step, files: list[Path], *, now: bool) -> StepResult:
    """Return the result of a step from what it wrote, now or in an earlier run."""
    action, name = step.action, step.name
    if isinstance(action, Excite):
        return _commanded(context, name, action)
    if isinstance(action, Measure):
        return measured_from(context, name, action, files[0], now=now)
    if isinstance(action, Characterise):
        return characterised(context, name, action)
    if isinstance(action, Identify):
        return identified_from(context, name, action, files[0])
    if isinstance(action, Compensate):
        result, context.commands[name] = compensated(context, name, action)
        return result
    if isinstance(action, Verify):
        return verified_from(context, name, action, files)
    return centred_from(context, name, action, files[0])


def _commanded(context: RunContext, name: str, action: Excite) -> CommandedStep:
    limits = {axis: own.limits for axis, own in context.instrument.axes.items()}
    settings = settings_of(
        action, context.stage, limits=limits, natural_frequency_hz=context.frequency
    )
    made = design_command(
        action, settings, context.plan.defaults.command_rate, base_rate_hz=context.base_rate_hz
    )
    context.commands[name] = made
    axis = "".join(action.moved)
    if isinstance(made, Strike):
        return CommandedStep(
            name=name, axis=axis, kind=action.kind, time=np.empty(0), values={}, unit="N"
        )
    waveform = made.waveform
    return CommandedStep(
        name=name,
        axis=axis,
        kind=action.kind,
        time=np.arange(waveform.size) / waveform.sample_rate_hz,
        values=waveform.values,
        unit="V" if waveform.quantity == "voltage" else "m",
        notes=made.notes,
    )
