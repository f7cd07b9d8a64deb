"""Tests of an axis that stands: small steps, and noise."""

import numpy as np

from flexstage.errors import RecordError
from flexstage.estimate import Estimate
from flexstage.experiment.campaign.loading import column
from flexstage.experiment.campaign.motion import only
from flexstage.experiment.campaign.plan import Campaign, Test
from flexstage.experiment.campaign.results import Figure, TestResult
from flexstage.experiment.noise import (
    allan_deviation,
    hold_noise,
    levels_of_command,
    staircase,
)
from flexstage.experiment.uncertainty import SensorSetup, measured
from flexstage.experiment.uncertainty.sensor import Role
from flexstage.records import Record, require_uniform

__all__ = ["evaluate_hold", "evaluate_staircase"]


def evaluate_staircase(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate a staircase of small steps.

    Parameters
    ----------
    test : Test
        The test, whose columns are the command and ``along``.
    records : list of Record
        One record.
    campaign : Campaign
        The campaign, for the instruments.

    Returns
    -------
    TestResult
        The resolution: what the noise lets one tell apart, or the mean step where the steps are
        the smallest that the drive can make.

    Raises
    ------
    RecordError
        The record cannot be evaluated, or its steps drown in the noise although they are to be the
        resolution.
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
    return TestResult(
        test=test,
        figures=(_figure(test, "resolution", raw, campaign.setup(test.along), "noise", note),),
        details={"staircase": found, "along": along, "time": record.time},
        notes=found.notes,
    )


def evaluate_hold(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate a record of an axis that is held.

    Parameters
    ----------
    test : Test
        The test, whose column is ``along``.
    records : list of Record
        One record.
    campaign : Campaign
        The campaign, for the instruments.

    Returns
    -------
    TestResult
        Noise and drift, with spectrum and Allan deviation.

    Raises
    ------
    RecordError
        The record cannot be evaluated.
    """
    record = only(test, records)
    require_uniform(record)
    along = column(test, record, "along")
    found = hold_noise(along, record.sample_rate_hz)
    setup = campaign.setup(test.along)
    return TestResult(
        test=test,
        figures=(
            _figure(test, "noise", found.rms, setup, "noise", "rms about a straight line"),
            _figure(test, "drift", found.drift, setup, "drift", "while the stage is held"),
        ),
        details={
            "hold": found,
            "allan": allan_deviation(along, record.sample_rate_hz),
            "values": np.asarray(along),
            "time": record.time,
        },
        notes=found.notes,
    )


def _figure(
    test: Test, quantity: str, raw: Estimate, setup: SensorSetup | None, role: Role, note: str
) -> Figure:
    from dataclasses import replace

    whole = raw if setup is None else measured(raw, setup, role=role)
    return Figure(
        quantity=quantity, axis=test.axis, estimate=replace(whole, note=note), test=test.name
    )
