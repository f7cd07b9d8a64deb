"""Tests of an axis that stands: small steps, and noise."""

import numpy as np

from flexstage.errors import RecordError
from flexstage.experiments.campaign.loading import column, only
from flexstage.experiments.campaign.plan import Campaign, Test
from flexstage.experiments.campaign.results import TestResult, figure_of
from flexstage.measure.noise.hold import allan_deviation, hold_noise
from flexstage.measure.noise.staircase import levels_of_command, staircase
from flexstage.measure.uncertainty.sensor import measured
from flexstage.records import Record
from flexstage.records.sampling import require_uniform


def evaluate_staircase(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate a staircase of small steps.

    The resolution is what the noise lets one tell apart, or the mean step where the steps are the
    smallest that the drive can make: then they must not drown in the noise.
    """
    record = only(test, records)
    require_uniform(record)
    command = column(test, record, "command")
    along = column(test, record, "along")
    found = staircase(
        along,
        record.sample_rate_hz,
        levels_of_command(command, shortest=4),
        command=command,
        probability=test.confidence,
    )
    raw = found.resolution
    note = raw.note
    if test.smallest_steps:
        if found.smallest_told is None:
            raise RecordError(
                f"test '{test.name}': no step size is resolved from the noise at "
                f"{100.0 * test.confidence:g} % confidence: average more samples on each level"
            )
        raw, note = found.smallest_told, f"mean of the smallest steps; {found.smallest_told.note}"
    whole = measured(raw, campaign.instrument(test.along), role="noise")
    return TestResult(
        test=test,
        figures=(figure_of(campaign, test, "resolution", whole, note),),
        details={"staircase": found, "along": along, "time": record.time},
        notes=found.notes,
    )


def evaluate_hold(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate a record of an axis that is held.

    The figures are noise and drift, with spectrum and Allan deviation.
    """
    record = only(test, records)
    require_uniform(record)
    along = column(test, record, "along")
    found = hold_noise(along, record.sample_rate_hz)
    sensor = campaign.instrument(test.along)
    noise = measured(found.rms, sensor, role="noise")
    drift = measured(found.drift, sensor, role="drift")
    return TestResult(
        test=test,
        figures=(
            figure_of(campaign, test, "noise", noise, "rms about a straight line"),
            figure_of(campaign, test, "drift", drift, "while the stage is held"),
        ),
        details={
            "hold": found,
            "allan": allan_deviation(along, record.sample_rate_hz),
            "values": np.asarray(along),
            "time": record.time,
        },
        notes=found.notes,
    )
