"""What a step depends on, as a hash: equal where it need not be repeated."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace

from flexstage.instruments.protocol import Identity
from flexstage.plans.command import Command, Strike
from flexstage.plans.plan import Plan, SensorEntry, Step
from flexstage.plans.verbs import Characterise, Measure
from flexstage.provenance import content_hash
from flexstage.stage import Stage

#: Verbs that move the stage.
MOVING = ("measure", "verify", "centre")


def fingerprint(
    step: Step, plan: Plan, stage: Stage, instrument: Identity, upstream: Mapping[str, str]
) -> str:
    """Return the hash of everything that the result of a step depends on."""
    words = [step.name, content_hash(step.action), content_hash(stage), content_hash(plan.defaults)]
    words += [f"{name}={upstream[name]}" for name in step.needs]
    if step.verb in MOVING:
        # which sensor is read where, but not how well it is known
        sensors = tuple(SensorEntry(name=s.name, channel=s.channel, unit=s.unit)
                        for s in plan.sensors)  # fmt: skip
        words += [content_hash(sensors), content_hash(replace(instrument, firmware=""))]
    if isinstance(step.action, Characterise):
        tests = [plan.step(name).action for name in step.action.of]
        words += [content_hash(plan.sensors)]
        words += [content_hash(test) for test in tests if isinstance(test, Measure)]
    return hashlib.sha256("\n".join(words).encode()).hexdigest()


def command_hash(command: Command | Strike) -> str:
    """Return the hash of the samples of a command."""
    if isinstance(command, Strike):
        return content_hash(command)
    found = hashlib.sha256(f"{command.quantity} {command.waveform.sample_rate_hz!r}".encode())
    for axis, values in command.waveform.values.items():
        found.update(axis.encode())
        found.update(values.tobytes())
    return found.hexdigest()


def files_hash(files: Mapping[str, str]) -> str:
    """Return the hash of files from the hashes of each."""
    words = "\n".join(f"{name} {files[name]}" for name in sorted(files))
    return hashlib.sha256(words.encode()).hexdigest()
