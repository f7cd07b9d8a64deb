"""Tests of an axis that runs in cycles over its stroke, read by sensors or by spheres."""

import math

from flexstage.arrays import Array
from flexstage.characteristic import MeasuredCharacteristic
from flexstage.errors import RecordError
from flexstage.estimate import Estimate
from flexstage.experiment.campaign.loading import column, optional_column
from flexstage.experiment.campaign.plan import Campaign, Test
from flexstage.experiment.campaign.results import TestResult, figure_of
from flexstage.experiment.motion.curve_extremes import curve_range
from flexstage.experiment.motion.curve_fit import fit_motion_curve
from flexstage.experiment.motion.cycles import MotionCycles, motion_cycles
from flexstage.experiment.motion.motion_curve import MotionCurve
from flexstage.experiment.motion.stroke import linearity, stroke
from flexstage.experiment.noise.staircase import screw_resolution
from flexstage.experiment.uncertainty.sensor import Role, measured
from flexstage.quantities import QUANTITIES
from flexstage.records import Record
from flexstage.sensor import SensorSpecification

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


def only(test: Test, records: list[Record]) -> Record:
    """Return the record of a test that has one."""
    if len(records) != 1:
        raise RecordError(
            f"test '{test.name}' of kind {test.kind} is evaluated from one file, got "
            f"{len(records)}: describe a test for each"
        )
    return records[0]


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
    cycles = motion_cycles(command)
    found = stroke(command, along, time, cycles=cycles, command_unit=command_unit)
    straight = linearity(found.curve)
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
        whole = (
            raw
            if instrument is None
            else measured(raw, instrument, role=role, duration=lasting, pitch=pitch)
        )
        note = _NOTES[quantity]
        said = f"{note}; {whole.note}" if whole.note else note
        whole = whole.times(1.0, QUANTITIES[quantity].unit)
        figures.append(figure_of(campaign, test, quantity, whole, said))

    # a sensor that counts the other way reads the same stroke
    way = math.copysign(1.0, found.stroke.value)
    pitching = motions.get("pitch")
    add(
        "output_displacement",
        found.stroke.times(way),
        sensor,
        "length",
        None if pitching is None else _over_stroke(along, pitching, time, cycles).times(way),
    )
    add("linearity", straight.range, sensor, "transverse range")
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
        details={"stroke": found, "linearity": straight, "curves": curves},
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
