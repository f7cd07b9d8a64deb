"""Tests of two axes together: the corners of what they reach."""

from dataclasses import replace

import numpy as np

from flexstage.characteristic import MeasuredCharacteristic
from flexstage.errors import RecordError
from flexstage.estimate import Estimate
from flexstage.experiment.campaign.loading import column
from flexstage.experiment.campaign.motion import only
from flexstage.experiment.campaign.plan import Campaign, Test
from flexstage.experiment.campaign.results import TestResult, figure_of
from flexstage.experiment.motion.workspace import workspace
from flexstage.experiment.uncertainty.sensor import Role, measured
from flexstage.records import Record


def evaluate_workspace(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate corners that were gone to again and again.

    The record has a row for each visit: the number of the corner, ``x`` and ``y``; each corner at
    least twice.
    """
    record = only(test, records)
    corner = column(test, record, "corner")
    points = np.stack((column(test, record, "x"), column(test, record, "y")), axis=1)
    visits = [np.flatnonzero(corner == k) for k in range(4)]
    if not set(np.unique(corner)) == {0.0, 1.0, 2.0, 3.0} or min(v.size for v in visits) < 2:
        raise RecordError(
            f"test '{test.name}': corners are numbered 0 to 3, anticlockwise from low x and low y, "
            f"each gone to twice at least; got {', '.join(f'{c:g}' for c in np.unique(corner)[:8])}"
        )
    rounds = min(v.size for v in visits)
    found = workspace(np.stack([points[v[:rounds]] for v in visits], axis=1))
    sensor = campaign.instrument(test.along)
    # two sensors, each with a direction of its own
    pair = None if sensor is None else replace(sensor, alignment=2.0**0.5 * sensor.alignment)
    notes = []
    if any(v.size > rounds for v in visits):
        notes.append(f"{rounds} whole rounds are used, visits beyond them are left out")

    def figure(quantity: str, raw: Estimate, role: Role, note: str) -> MeasuredCharacteristic:
        own = pair if role == "squareness" else sensor
        whole = raw if own is None else measured(raw, own, role=role)
        return figure_of(campaign, test, quantity, whole, note)

    return TestResult(
        test=test,
        figures=(
            figure("workspace_area", found.area, "area", "between the mean corners"),
            figure(
                "squareness",
                found.squareness,
                "squareness",
                "angle from the path of x to that of y, less a right angle",
            ),
        ),
        details={"workspace": found},
        notes=tuple(notes),
    )
