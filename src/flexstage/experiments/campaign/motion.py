"""Tests of motion: an axis by sensors or by spheres, and the corners that two axes reach."""

import math
from dataclasses import replace

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.experiments.campaign.loading import column, only, optional_column, sphere_columns
from flexstage.experiments.campaign.plan import Campaign, Test
from flexstage.experiments.campaign.results import TestResult, figure_of
from flexstage.measure.motion.curve_fit import fit_motion_curve
from flexstage.measure.motion.cycles import MotionCycles, cycles_by_range
from flexstage.measure.motion.motion_curve import MotionCurve, curve_range
from flexstage.measure.motion.reach import rigid_motion, stroke, travel_frame, workspace
from flexstage.measure.noise.staircase import screw_resolution
from flexstage.measure.uncertainty.sensor import Role, measured
from flexstage.quantities.characteristic import MeasuredCharacteristic
from flexstage.quantities.estimate import Estimate
from flexstage.quantities.quantity import QUANTITIES
from flexstage.quantities.sensor import SensorSpecification
from flexstage.records import Record
from flexstage.records.quality import require_live

_ROTATIONS = {"roll": "roll", "pitch": "pitch", "yaw": "parasitic_rotation"}
_REVERSED = "the reading falls as the command rises: the stroke is given as a length"
_NOTES = {
    "output_displacement": "from end to end of the command, mean of both directions and all cycles",
    "resolution": "smallest step of the drive times the measured ratio",
    "linearity": "largest less smallest distance of the position from its least-squares line over "
    "the command, mean of both directions",
    "hysteresis_loop_width": "largest distance of the two directions at equal command",
    "repeatability": "standard deviation of the upper end from cycle to cycle, drift taken off",
    "straightness": "largest less smallest distance from the least-squares line, in the plane",
    "straightness_out_of_plane": "largest less smallest distance from the least-squares line, out "
    "of the plane",
    "cross_coupling": "slope of the least-squares line of the motion across over that along",
    "roll": "largest less smallest rotation about the axis of travel",
    "pitch": "largest less smallest rotation about the direction across",
    "parasitic_rotation": "largest less smallest rotation in the plane",
    "drift": "linear drift of the position over all cycles",
}


def evaluate_motion(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate cycles over the stroke.

    Straightness, coupling and rotations are there where they were read beside ``along``.
    """
    record = only(test, records)
    motions = {
        name: values
        for name in ("across", "vertical", "roll", "pitch", "yaw")
        if (values := optional_column(test, record, name)) is not None
    }
    command = column(test, record, "command")
    unit = record.channel(test.columns.command or 0).unit
    return motion_figures(
        test, campaign, command, unit, column(test, record, "along"), record.time, motions
    )


def motion_figures(
    test: Test,
    campaign: Campaign,
    command: Array,
    command_unit: str,
    along: Array,
    time: Array,
    motions: dict[str, Array],
    *,
    timed: bool = True,
) -> TestResult:
    """Return the figures of an axis from its motions over repeated cycles.

    The command is in V or m, all motions in m or rad, shape (n,) each; `time` in s, or where not
    `timed`, so that a drift has no rate, numbers of stations.
    """
    groups = cycles_by_range(command, least=3, unit=command_unit)
    strokes = [
        stroke(command, along, time, cycles=own, command_unit=command_unit, drift=own.count > 2)
        for own in groups
    ]
    found, cycles = strokes[0], groups[0]
    sensor, side, angle = (
        campaign.instrument(n) for n in (test.along, test.transverse, test.angle)
    )
    lasting = _half_cycle(cycles, time) if timed else 0.0
    figures: list[MeasuredCharacteristic] = []

    def add(
        quantity: str,
        raw: Estimate,
        instrument: SensorSpecification | None,
        role: Role,
        pitch: Estimate | None = None,
    ) -> None:
        whole = measured(raw, instrument, role=role, duration=lasting, pitch=pitch)
        note = _NOTES[quantity]
        said = f"{note}; {whole.note}" if whole.note else note
        whole = whole.times(1.0, QUANTITIES[quantity].unit)
        figures.append(figure_of(campaign, test, quantity, whole, said))

    # a sensor that counts the other way reads the same stroke
    way = math.copysign(1.0, found.stroke.value)
    pitching = motions.get("pitch")
    pitches = [
        None if pitching is None else _over_stroke(along, pitching, time, own).times(way)
        for own in groups
    ]
    add("output_displacement", found.stroke.times(way), sensor, "length", pitches[0])
    ranges = [
        replace(
            one,
            stroke=measured(
                one.stroke.times(way), sensor, role="length", duration=lasting, pitch=p
            ),
        )
        for one, p in zip(strokes, pitches, strict=True)
    ]
    apart = curve_range(found.curve, line="least_squares")
    add("linearity", apart, sensor, "transverse range")
    add("hysteresis_loop_width", found.loop_width, sensor, "transverse range")
    if timed:
        # of few stations the noise of the machine would be taken for it
        add("repeatability", found.end_repeatability[1], sensor, "noise")
    if found.drift_rate is not None and timed:
        add("drift", found.drift_rate, sensor, "drift")
    if test.smallest_step is not None:
        if command_unit != "m":
            raise RecordError(
                f"test '{test.name}': smallest_step belongs to a command in m, got one in "
                f"'{command_unit}': leave it out"
            )
        step = Estimate(value=test.smallest_step, unit="m")
        ratio = found.gain.times(math.copysign(1.0, found.gain.value), "1")
        add("resolution", screw_resolution(step, ratio), sensor, "transverse range")
    curves: dict[str, MotionCurve] = {}
    for name, values in motions.items():
        turning = name in _ROTATIONS
        curve = fit_motion_curve(along, values, time, cycles=cycles, unit="rad" if turning else "m")
        curves[name] = curve
        if turning:
            add(_ROTATIONS[name], curve_range(curve), angle, "angle")
        elif name == "vertical":
            add(
                "straightness_out_of_plane",
                curve_range(curve, line="least_squares"),
                side,
                "transverse range",
            )
        else:
            add("straightness", curve_range(curve, line="least_squares"), side, "transverse range")
            add("cross_coupling", curve.slope(), side, "coupling")
    return TestResult(
        test=test,
        figures=tuple(figures),
        details={"stroke": found, "ranges": ranges, "curves": curves},
        notes=(*cycles.notes, *found.curve.notes, *([] if way > 0.0 else [_REVERSED])),
    )


def _over_stroke(along: Array, pitch: Array, time: Array, cycles: MotionCycles) -> Estimate:
    """Pitch from the lower to the upper end of the stroke, by which an Abbe offset counts [rad]."""
    curve = fit_motion_curve(along, pitch, time, cycles=cycles, unit="rad")
    return curve.functional([-1.0, 1.0], [curve.basis.low, curve.basis.high])


def _half_cycle(cycles: MotionCycles, time: Array) -> float:
    """Time of one run, over which drift that is not taken off adds up [s]."""
    first, last = int(cycles.runs[0, 0, 0]), int(cycles.runs[-1, -1, 1])
    return float(time[last] - time[first]) / (2 * cycles.count)


def evaluate_spheres(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate spheres probed at stations over repeated cycles.

    The motion is that of the point at the origin of the machine's coordinates, which is the point
    of interest; the axis runs along the machine's X or Y, that along which the spheres move more.
    The record has a row for each station; the figures are those of `evaluate_motion`, without
    drift.
    """
    record = only(test, records)
    if len(test.columns.spheres) < 3:
        raise RecordError(
            f"test '{test.name}' names {len(test.columns.spheres)} spheres: a rigid motion needs "
            "three at least"
        )
    points = np.stack([_centres(record, sphere) for sphere in test.columns.spheres], axis=1)
    command, unit = _command(test, record)
    number = int(np.argmax(np.ptp(points.mean(axis=1), axis=0)))
    if number == 2:
        raise RecordError(
            f"test '{test.name}': the spheres move most along the machine's Z, and an axis is "
            "evaluated along X or Y: check the order of their columns"
        )
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
                f"column '{name}' {got}, and a sphere needs a unit of length: give it behind "
                f'the sphere, such as spheres="{sphere} mm"'
            )
        found.append(channel.values)
    require_live(record, [sphere_columns(sphere)[0]])
    return np.stack(found, axis=1)


def _rigidity(residuals: Array) -> str:
    rms = float(np.sqrt(np.mean(residuals**2)))
    return f"the spheres differ from a rigid body by {rms * 1e6:.3g} um rms"


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
    area = measured(found.area, sensor, role="area")
    square = measured(found.squareness, pair, role="squareness")
    said = "angle from the path of x to that of y, less a right angle"
    return TestResult(
        test=test,
        figures=(
            figure_of(campaign, test, "workspace_area", area, "between the mean corners"),
            figure_of(campaign, test, "squareness", square, said),
        ),
        details={"workspace": found},
        notes=tuple(notes),
    )
