"""Tests of two axes together: the corners of what they reach, and targets along one."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import RecordError
from flexstage.estimate import Estimate
from flexstage.experiment.campaign.loading import column
from flexstage.experiment.campaign.motion import only
from flexstage.experiment.campaign.plan import Campaign, Test
from flexstage.experiment.campaign.results import Figure, TestResult
from flexstage.experiment.motion import positioning, staircase_dwells, workspace
from flexstage.experiment.uncertainty import measured
from flexstage.experiment.uncertainty.sensor import Role
from flexstage.records import Record

__all__ = ["evaluate_positioning", "evaluate_workspace"]

Array = NDArray[np.float64]


def evaluate_workspace(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate corners that were gone to again and again.

    Parameters
    ----------
    test : Test
        The test, whose columns are the number of the corner, ``x`` and ``y``.
    records : list of Record
        One record, a row for each visit.
    campaign : Campaign
        The campaign, for the instruments.

    Returns
    -------
    TestResult
        Area and squareness.

    Raises
    ------
    RecordError
        A corner is missing, or was not gone to twice.
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
    sensor = campaign.setup(test.along)
    # two sensors, each with a direction of its own
    pair = None if sensor is None else replace(sensor, alignment=2.0**0.5 * sensor.alignment)
    notes = []
    if any(v.size > rounds for v in visits):
        notes.append(f"{rounds} whole rounds are used, visits beyond them are left out")

    def figure(quantity: str, raw: Estimate, role: Role, note: str) -> Figure:
        setup = pair if role == "squareness" else sensor
        whole = raw if setup is None else measured(raw, setup, role=role)
        return Figure(
            quantity=quantity,
            axis=test.axis,
            estimate=replace(whole, note=note),
            test=test.name,
        )

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


def evaluate_positioning(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate targets that were gone to from both sides, in the manner of ISO 230-2.

    Parameters
    ----------
    test : Test
        The test, whose columns are the command in metres, staying on each target for some samples
        or a row for each visit, and ``along``.
    records : list of Record
        One record.
    campaign : Campaign
        The campaign, for the instruments.

    Returns
    -------
    TestResult
        Accuracy and reversal.

    Raises
    ------
    RecordError
        The command is no length, or targets were not gone to from both sides.
    """
    record = only(test, records)
    command = column(test, record, "command")
    along = column(test, record, "along")
    unit = record.channel(test.columns.command or 0).unit
    if unit != "m":
        raise RecordError(
            f"test '{test.name}': targets are positions in m, and the command is in "
            f"'{unit or 'no unit'}': give command=um, or the column of the wanted position"
        )
    target, upward, downward = _approaches(test, command, along)
    notes = _left_out(command, target)
    # the first target is where the two scales are set alike
    start = float(np.mean([upward[0].mean(), downward[0].mean()])) - target[0]
    found = positioning(target, upward - start, downward - start)
    sensor = campaign.setup(test.along)

    def figure(quantity: str, raw: Estimate, role: Role, note: str) -> Figure:
        whole = raw if sensor is None else measured(raw, sensor, role=role)
        return Figure(
            quantity=quantity, axis=test.axis, estimate=replace(whole, note=note), test=test.name
        )

    return TestResult(
        test=test,
        figures=(
            figure(
                "positioning_accuracy",
                found.accuracy,
                "length",
                "bidirectional accuracy A of ISO 230-2, readings set to the first target",
            ),
            figure("reversal", found.reversal, "transverse range", "reversal value B of ISO 230-2"),
        ),
        details={"positioning": found},
        notes=notes,
    )


def _left_out(command: Array, target: Array) -> tuple[str, ...]:
    """Say which targets do not count."""
    near = 1e-3 * float(np.ptp(command))
    alone = [c for c in np.unique(command) if float(np.min(np.abs(target - c))) > near]
    if not alone:
        return ()
    listed = ", ".join(f"{1e6 * c:.6g}" for c in alone[:6])
    return (
        f"positions that were gone to from one side only are left out: {listed} um"
        + (f" and {len(alone) - 6} more" if len(alone) > 6 else ""),
    )


def _approaches(test: Test, command: Array, along: Array) -> tuple[Array, Array, Array]:
    """Targets, and what was reached of them from below and from above."""
    dwells = staircase_dwells(command) if command.size >= 8 else None
    if dwells is not None:
        upward, downward, which = dwells.approaches(along)
        return dwells.levels[which], upward, downward
    change = np.sign(np.diff(command, prepend=command[0]))
    step = 1e-9 * float(np.ptp(command))
    levels = np.unique(np.round(command / step) * step)
    up, down, kept = [], [], []
    for level in levels:
        here = np.abs(command - level) <= step
        from_below, from_above = along[here & (change > 0)], along[here & (change < 0)]
        if from_below.size and from_above.size:
            kept.append(level)
            up.append(from_below)
            down.append(from_above)
    if len(kept) < 2:
        raise RecordError(
            f"test '{test.name}': fewer than two targets were gone to from both sides: let the "
            "command rise and fall over the same targets"
        )
    runs = min(min(len(u), len(d)) for u, d in zip(up, down, strict=True))
    return (
        np.array(kept),
        np.array([u[:runs] for u in up]),
        np.array([d[:runs] for d in down]),
    )
