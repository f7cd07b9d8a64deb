"""What each verb does, and what is made of the files that it wrote."""

from pathlib import Path

import numpy as np

from flexstage.plans.centre_step import centre_scale, centred_from
from flexstage.plans.characterise_step import characterised
from flexstage.plans.command import Strike
from flexstage.plans.compensate_step import compensated
from flexstage.plans.design import design_command
from flexstage.plans.dry_run import settings_of
from flexstage.plans.excite import Excite
from flexstage.plans.identify_step import identified_from, identify_model
from flexstage.plans.measure_step import measure, measured_from
from flexstage.plans.plan import Step
from flexstage.plans.results import CommandedStep, StepResult
from flexstage.plans.verbs import Centre, Characterise, Compensate, Identify, Measure, Verify
from flexstage.plans.verify_step import verified_from, verify
from flexstage.plans.work import Work


def carry_out(work: Work, step: Step) -> list[Path]:
    """Do what a step asks for, and write what it gives."""
    action = step.action
    if isinstance(action, Measure):
        return [measure(work, step.name, action)]
    if isinstance(action, Identify):
        return [identify_model(work, step.name, action)]
    if isinstance(action, Verify):
        return verify(work, step.name, action)
    if isinstance(action, Centre):
        return [centre_scale(work, step.name, action)]
    return []


def result_of(work: Work, step: Step, files: list[Path], *, now: bool) -> StepResult:
    """Return the result of a step from what it wrote, now or in an earlier run."""
    action, name = step.action, step.name
    if isinstance(action, Excite):
        return _commanded(work, name, action)
    if isinstance(action, Measure):
        return measured_from(work, name, action, files[0], now=now)
    if isinstance(action, Characterise):
        return characterised(work, name, action)
    if isinstance(action, Identify):
        return identified_from(work, name, action, files[0])
    if isinstance(action, Compensate):
        result, work.commands[name] = compensated(work, name, action)
        return result
    if isinstance(action, Verify):
        return verified_from(work, name, action, files)
    return centred_from(work, name, action, files[0])


def _commanded(work: Work, name: str, action: Excite) -> CommandedStep:
    limits = {axis: own.limits for axis, own in work.instrument.axes.items()}
    settings = settings_of(action, work.stage, limits=limits, natural_frequency_hz=work.frequency)
    made = design_command(
        action, settings, work.plan.defaults.command_rate, base_rate_hz=work.base_rate_hz
    )
    work.commands[name] = made
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
