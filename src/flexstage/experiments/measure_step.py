"""The step that measures: a command is run, and a record is written."""

from pathlib import Path

import numpy as np

from flexstage.errors import PlanError
from flexstage.experiments.command import CommandWaveform, Strike, record_command, record_strikes
from flexstage.experiments.results import MeasuredStep
from flexstage.experiments.run_context import RunContext
from flexstage.experiments.verbs import Measure
from flexstage.instruments.protocol import Signal
from flexstage.records import Record, read_record
from flexstage.stage import PiezoStack

#: What the acceleration at a blow is called.
RESPONSE = "acceleration {}"


def measure(context: RunContext, name: str, action: Measure) -> Path:
    """Run the command of a step and record it."""
    command = context.commands[action.of]
    axis = context.plan.axis_of(name)
    about = context.metadata(name, action.test or "identification", axis)
    rate = action.rate or context.plan.defaults.rate
    stream = context.folder / "records" / f"{name}.stream"
    if isinstance(command, Strike):
        outputs = action.output or (command.axis,)
        signals = [Signal(kind="force", source=command.axis, name="force", unit="N")]
        signals += [
            Signal(kind="response", source=a, name=RESPONSE.format(a), unit="m/s^2")
            for a in outputs
        ]
        return record_strikes(context.instrument, command, signals, rate, stream, about)
    sensors = dict.fromkeys((*action.roles.values(), *action.output, *action.also))
    signals = [context.signal(sensor) for sensor in sensors]
    signals += _drives(context, command)
    if not signals:
        raise PlanError(f"step '{name}' records nothing: name a sensor")
    return record_command(context.instrument, command, signals, rate, stream, about)


def _drives(context: RunContext, command: CommandWaveform) -> list[Signal]:
    """The voltages of the drives that move, as far as they have one."""
    found = []
    for axis in command.axes:
        if isinstance(context.stage.drive(context.stage.axis(axis).drive), PiezoStack):
            column = "voltage" if len(command.axes) == 1 else f"voltage {axis}"
            found.append(Signal(kind="voltage", source=axis, name=column, unit="V"))
    return found


def measured_from(
    context: RunContext, name: str, action: Measure, file: Path, *, now: bool
) -> MeasuredStep:
    """Return the result of a step from its file."""
    record = read_record(file)
    command = context.commands[action.of]
    first = period = 0
    if isinstance(command, CommandWaveform):
        rate = record.sample_rate_hz / command.waveform.sample_rate_hz
        # a record that was taken at places has no samples between them
        whole = abs(record.size - command.waveform.size * rate) < 3.0 * max(rate, 1.0)
        first = round(command.first * rate) if whole else 0
        period = round(command.period * rate) if whole else 0
    return MeasuredStep(
        name=name,
        axis=context.plan.axis_of(name),
        test=action.test or "",
        record=record,
        first=first,
        period=period,
        file=file,
        repeated=now,
        notes=record.notes,
    )


def corner_visits(record: Record, x: str, y: str) -> Record:
    """Average the readings of two sensors over each rest at a corner: a row for each visit."""
    from flexstage.records import Channel

    number = record.channel("corner").values
    edges = np.flatnonzero(np.diff(number) != 0.0) + 1
    parts = [p for p in np.split(np.arange(number.size), edges) if p.size and number[p[0]] >= 0.0]
    if len(parts) < 2:
        raise PlanError("the record shows no rest at a corner")
    return Record(
        channels=(
            Channel(name="corner", values=np.array([number[p[0]] for p in parts]), unit="1"),
            *(
                Channel(
                    name=s,
                    values=np.array([record.channel(s).values[p].mean() for p in parts]),
                    unit="m",
                )
                for s in (x, y)
            ),
        ),
        time=np.arange(float(len(parts))),
        source=record.source,
        notes=record.notes,
        over="point",
    )
