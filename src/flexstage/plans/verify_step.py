"""The step that follows a reference in several ways, and compares what is left of the loop."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from flexstage.estimate import Component, Estimate
from flexstage.experiment.campaign.results import Figure
from flexstage.experiment.uncertainty.sensor import measured
from flexstage.hysteresis import loop_width, tracking
from flexstage.instruments.recording.attributes import read_metadata
from flexstage.plans.following import LEARNING, NOTES, follow, following
from flexstage.plans.reference import require_whole_cycles
from flexstage.plans.results import VerifiedStep
from flexstage.plans.results_models import FollowedRun
from flexstage.plans.verbs import Verify
from flexstage.plans.work import Work
from flexstage.records import Record, read_record

_OPEN = "open loop"


def verify(work: Work, name: str, action: Verify) -> list[Path]:
    """Follow a reference in several ways, and record each."""
    require_whole_cycles(name, action, work.plan.defaults.rate)
    own = following(work, action)
    files = []
    for way in action.ways:
        stream = work.folder / "records" / f"{name}.{way.replace(' ', '-')}.stream"
        files.append(follow(work, name, action, way, own, stream))
    return files


def verified_from(work: Work, name: str, action: Verify, files: list[Path]) -> VerifiedStep:
    """Return the result of a step from its records."""
    model = work.identified(action.model)
    runs = [
        _run(way, read_record(file), file, action)
        for way, file in zip(action.ways, files, strict=True)
    ]
    still = next((run.tracking.loop_width for run in runs if run.way == _OPEN), None)
    if still is not None:
        runs = [
            replace(run, reduction_percent=100.0 * (1.0 - run.tracking.loop_width / still))
            for run in runs
        ]
    figures = tuple(
        Figure(
            quantity="hysteresis_loop_width" if run.way == _OPEN else "compensated_loop_width",
            axis=model.axis,
            estimate=_estimate(work, run, action),
            test=name,
        )
        for run in runs
    )
    return VerifiedStep(
        name=name,
        axis=model.axis,
        model=action.model,
        kind=model.kind,
        stroke=float(np.ptp(runs[0].reference)),
        rate_hz=action.reference.rate,
        runs=tuple(runs),
        figures=figures,
    )


def _run(way: str, record: Record, file: Path, action: Verify) -> FollowedRun:
    period = round(record.sample_rate_hz / action.reference.rate)
    cycles = int(action.reference.cycles)
    # the compared cycles are the last ones, whatever was run before them; the sample that ends the
    # last one is there where the whole command ran once
    end = record.size - 1 if record.size % period == 1 or way in (_OPEN, "inverse") else record.size
    first = max(end - period * cycles, 0)
    kept = slice(first, end + 1)
    reference = record.channel("reference").values[kept]
    output = record.channel(action.along).values[kept]
    bounds = np.minimum(np.arange(cycles + 1) * period, reference.size - 1)
    if way == _OPEN:
        # what a constant gain, and the best offset, would have given
        output = output - float(np.mean(output) - np.mean(reference))
    settings = read_metadata(record.attributes).settings
    return FollowedRun(
        way=way,
        time=record.time[kept] - record.time[first],
        reference=reference,
        output=output,
        voltage=record.channel("voltage").values[kept],
        tracking=tracking(reference, output, bounds),
        widths=tuple(
            loop_width(reference, output, bounds[k : k + 2]) for k in range(bounds.size - 1)
        ),
        reduction_percent=None,
        errors=tuple(float(e) for e in settings.get(LEARNING, "").split()),
        file=file,
        notes=tuple(line for line in settings.get(NOTES, "").split("\n") if line),
    )


def _estimate(work: Work, run: FollowedRun, action: Verify) -> Estimate:
    """Width of the loop of the mean cycle, with the spread of the cycles and the sensor."""
    n = len(run.widths)
    parts: tuple[Component, ...] = ()
    if n > 1:
        spread = float(np.std(run.widths, ddof=1)) / n**0.5
        parts = (Component(name="cycle to cycle", uncertainty=spread, degrees_of_freedom=n - 1.0),)
    raw = Estimate(value=run.tracking.loop_width, unit="m", components=parts)
    whole = measured(raw, work.plan.sensor(action.along).setup, role="transverse range")
    note = (
        f"{run.way}, {action.reference.rate:g} Hz, {100.0 * action.reference.share:g} % of the "
        "stroke, mean cycle"
    )
    return replace(whole, note=note)
