"""The step that identifies the model of a drive."""

from pathlib import Path

import numpy as np

from flexstage.errors import PlanError
from flexstage.experiments.results import CharacterisedStep, IdentifiedStep
from flexstage.experiments.run_context import RunContext
from flexstage.experiments.verbs import Identify
from flexstage.files.write import write_whole
from flexstage.hysteresis import ModelFile, identify, model_text, read_model_file
from flexstage.provenance import provenance

#: Share of a record, from its start, that the largest deviation leaves out: it remembers what was
#: before the record.
SETTLED = 0.1


def identify_model(context: RunContext, name: str, action: Identify) -> Path:
    """Identify a model from the records of earlier steps, and write it."""
    steps = [context.measured(step) for step in action.of]
    found = identify(
        [step.evaluated for step in steps],
        "command",
        action.output,
        model=action.models,
        resonance=_resonance(context, name, action),
    )
    errors = {"rms": found.rms_percent, "max": found.max_percent}
    if found.heldout_rms_percent is not None:
        errors["held-out rms"] = found.heldout_rms_percent
    if found.heldout_max_percent is not None:
        errors["held-out max"] = found.heldout_max_percent
    made = provenance(found.model, {"plan": context.title, "step": name})
    file = ModelFile(
        model=found.model,
        errors=errors,
        warnings=found.warnings,
        provenance={
            "version": made.version,
            "created": made.created,
            "stage": context.stage.name,
            "serial_number": context.serial_number,
            "axis": context.plan.axis_of(name),
            "records": [step.file.name for step in steps],
            "plan": context.title,
            "step": name,
            "simulated": context.instrument.identity.simulated,
        },
    )
    target = context.folder / "models" / f"{name}.yaml"
    target.parent.mkdir(parents=True, exist_ok=True)
    write_whole(target, model_text(file))
    return target


def _resonance(context: RunContext, name: str, action: Identify) -> tuple[float, float] | None:
    """Return frequency [Hz] and damping ratio of the mode that was measured in place."""
    if action.resonance is None:
        return None
    found = context.results[action.resonance]
    if not isinstance(found, CharacterisedStep):
        raise PlanError(f"step '{action.resonance}' has found no resonance")
    axis = context.plan.axis_of(name)
    frequency = found.found.figure("natural_frequency_hz", axis).value
    return frequency, found.found.figure("damping_ratio", axis).value


def identified_from(context: RunContext, name: str, action: Identify, file: Path) -> IdentifiedStep:
    """Return the result of a step from its model file."""
    read = read_model_file(file)
    record = context.measured(action.of[-1]).evaluated
    voltage = record.channel("command").values
    measured = record.channel(action.output).values
    dt = 1.0 / record.sample_rate_hz
    # what was before the record is taken to be cycles over the whole range
    modelled = read.model.simulate(voltage, dt, read.model.conditioned())
    late = slice(int(SETTLED * voltage.size), None)
    modelled = modelled + float(np.mean(measured[late] - modelled[late]))
    return IdentifiedStep(
        name=name,
        axis=context.plan.axis_of(name),
        model=read.model,
        kind=read.model.hysteresis.kind,
        file=file,
        errors_percent={k: v for k, v in read.errors.items() if v is not None},
        time=record.time,
        voltage=voltage,
        measured=measured,
        modelled=modelled,
        deviation=float(np.max(np.abs(measured[late] - modelled[late]))),
        warnings=read.warnings,
    )
