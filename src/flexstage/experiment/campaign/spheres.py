"""A test by spheres of a plate on the platform, probed at stations along the stroke."""

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import RecordError
from flexstage.experiment.campaign.loading import column, sphere_columns
from flexstage.experiment.campaign.motion import motion_figures, only
from flexstage.experiment.campaign.plan import Campaign, Test
from flexstage.experiment.campaign.results import TestResult
from flexstage.experiment.motion.rigid_body import rigid_motion, travel_frame
from flexstage.records import Record
from flexstage.records.quality import require_live

_DIRECTIONS = {"x": 0, "y": 1}


def evaluate_spheres(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate spheres probed at stations over repeated cycles.

    The motion is that of the point at the origin of the machine's coordinates, which is the point
    of interest; axis ``x`` runs along the machine's X, and ``y`` along its Y. The record has a row
    for each station; the figures are those of `evaluate_motion`, without drift.
    """
    record = only(test, records)
    if test.axis not in _DIRECTIONS:
        raise RecordError(
            f"test '{test.name}': spheres are evaluated along axis x or y, got '{test.axis}'"
        )
    if len(test.columns.spheres) < 3:
        raise RecordError(
            f"test '{test.name}' names {len(test.columns.spheres)} spheres: a rigid motion needs "
            "three at least"
        )
    points = np.stack([_centres(record, sphere) for sphere in test.columns.spheres], axis=1)
    command, unit = _command(test, record)
    number = _DIRECTIONS[test.axis]
    frame = travel_frame(np.eye(3)[number])
    points = points @ frame.T
    # the first station, over all of its visits, is what the others are compared with
    first = np.isclose(command, command[0], rtol=0.0, atol=1e-6 * float(np.ptp(command)))
    motion = rigid_motion(points[first].mean(axis=0), points, about=(0.0, 0.0, 0.0))
    along, across, vertical = motion.translation.T
    roll, pitch, yaw = motion.angles.T
    result = motion_figures(
        test,
        campaign,
        command,
        unit,
        along,
        record.time,
        {
            # sideways is towards the other axis, on either of them
            "across": across if number == 0 else -across,
            "vertical": vertical,
            "roll": roll,
            "pitch": pitch,
            "yaw": yaw,
        },
        timed=False,
    )
    return TestResult(
        test=test,
        figures=result.figures,
        details={**result.details, "rigid": motion},
        notes=(*result.notes, _rigidity(motion.residuals)),
    )


def _command(test: Test, record: Record) -> tuple[Array, str]:
    """What the drive was told at each station, and its unit."""
    if not test.commands:
        command = column(test, record, "command")
        return command, record.channel(test.columns.command or 0).unit
    if len(test.commands) != record.size:
        raise RecordError(
            f"test '{test.name}' gives {len(test.commands)} commands for {record.size} stations: "
            "give one for each"
        )
    return np.array(test.commands), "m"


def _centres(record: Record, sphere: str) -> Array:
    found = []
    for name in sphere_columns(sphere):
        channel = record.channel(name)
        if channel.unit != "m":
            got = f"is in {channel.unit}" if channel.unit else "does not give its unit"
            raise RecordError(
                f"column '{name}' {got}, and a sphere needs a unit of length: give it, such as "
                "spheres=mm"
            )
        found.append(channel.values)
    require_live(record, [sphere_columns(sphere)[0]])
    return np.stack(found, axis=1)


def _rigidity(residuals: Array) -> str:
    rms = float(np.sqrt(np.mean(residuals**2)))
    return f"the spheres differ from a rigid body by {rms * 1e6:.3g} um rms"
