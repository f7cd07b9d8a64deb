"""Tests of axes: linear by sensors or spheres, of rotation, corners of a workspace, vibration."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.centring.asynchronous_motion import AxisErrorMotion, Direction, error_motion
from flexstage.experiments.campaign.loading import column, only, optional_column, sphere_columns
from flexstage.experiments.campaign.plan import Campaign, Test
from flexstage.experiments.campaign.results import TestResult, figure_of
from flexstage.measure.modal.fit import fit_modes
from flexstage.measure.modal.result import ModalFit, Mode
from flexstage.measure.modal.ring_down import DecayMode, RingDown, ring_down
from flexstage.measure.motion.curve_fit import fit_motion_curve
from flexstage.measure.motion.cycles import MotionCycles, cycles_by_range
from flexstage.measure.motion.motion_curve import MotionCurve, curve_range
from flexstage.measure.motion.reach import rigid_motion, stroke, travel_frame, workspace
from flexstage.measure.noise.staircase import screw_resolution
from flexstage.measure.spectra.estimate import estimate_response
from flexstage.measure.spectra.response import response_from_record
from flexstage.measure.uncertainty.sensor import Role, measured
from flexstage.quantities.characteristic import MeasuredCharacteristic
from flexstage.quantities.estimate import Estimate
from flexstage.quantities.quantity import QUANTITIES
from flexstage.quantities.sensor import SensorSpecification
from flexstage.records import Record
from flexstage.records.quality import require_live

_ROTATIONS = {"roll": "roll", "pitch": "pitch", "yaw": "parasitic_rotation"}
_REVERSED = "the reading falls as the command rises: the stroke is its absolute value"
_NOTES = {
    "output_displacement": "from end to end of the command, mean of both directions and all cycles",
    "resolution": "smallest step of the drive times the measured ratio",
    "linearity": "largest less smallest distance of the position from its least-squares line over "
    "the command, mean of both directions",
    "hysteresis_loop_width": "largest difference of the two directions at equal command",
    "repeatability": "standard deviation of the upper end from cycle to cycle, drift removed",
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

    Straightness, coupling and rotations are evaluated where their sensors were read.
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

    The command is in V or m, all motions in m or rad, shape (n,) each. `time` is in s, or the
    number of the station where not `timed`; then there is no rate of drift.
    """
    groups = cycles_by_range(command, least=3, unit=command_unit)
    strokes = [
        stroke(command, along, time, cycles=group, command_unit=command_unit, drift=group.count > 2)
        for group in groups
    ]
    travel, cycles = strokes[0], groups[0]
    sensor, side, angle = (
        campaign.instrument(n) for n in (test.along, test.transverse, test.angle)
    )
    duration = _half_cycle(cycles, time) if timed else 0.0
    figures: list[MeasuredCharacteristic] = []

    def add(
        quantity: str,
        raw: Estimate,
        instrument: SensorSpecification | None,
        role: Role,
        pitch: Estimate | None = None,
    ) -> None:
        total = measured(raw, instrument, role=role, duration=duration, pitch=pitch)
        note = _NOTES[quantity]
        remark = f"{note}; {total.note}" if total.note else note
        total = total.times(1.0, QUANTITIES[quantity].unit)
        figures.append(figure_of(campaign, test, quantity, total, remark))

    # a reversed sensor reads the same stroke
    sign = math.copysign(1.0, travel.stroke.value)
    pitch_readings = motions.get("pitch")
    pitches = [
        None
        if pitch_readings is None
        else _over_stroke(along, pitch_readings, time, group).times(sign)
        for group in groups
    ]
    add("output_displacement", travel.stroke.times(sign), sensor, "length", pitches[0])
    ranges = [
        replace(
            one,
            stroke=measured(
                one.stroke.times(sign), sensor, role="length", duration=duration, pitch=p
            ),
        )
        for one, p in zip(strokes, pitches, strict=True)
    ]
    nonlinearity = curve_range(travel.curve, line="least_squares")
    add("linearity", nonlinearity, sensor, "transverse range")
    add("hysteresis_loop_width", travel.loop_width, sensor, "transverse range")
    if timed:
        # with few stations, the noise of the machine would dominate
        add("repeatability", travel.end_repeatability[1], sensor, "noise")
    if travel.drift_rate is not None and timed:
        add("drift", travel.drift_rate, sensor, "drift")
    if test.smallest_step is not None:
        if command_unit != "m":
            raise RecordError(
                f"test '{test.name}': smallest_step needs a command in m, got a command in "
                f"'{command_unit}': omit it"
            )
        step = Estimate(value=test.smallest_step, unit="m")
        ratio = travel.gain.times(math.copysign(1.0, travel.gain.value), "1")
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
        details={"stroke": travel, "ranges": ranges, "curves": curves},
        notes=(*cycles.notes, *travel.curve.notes, *([] if sign > 0.0 else [_REVERSED])),
    )


def _over_stroke(along: Array, pitch: Array, time: Array, cycles: MotionCycles) -> Estimate:
    """Return the pitch over the stroke, which causes the Abbe error [rad]."""
    curve = fit_motion_curve(along, pitch, time, cycles=cycles, unit="rad")
    return curve.functional([-1.0, 1.0], [curve.basis.low, curve.basis.high])


def _half_cycle(cycles: MotionCycles, time: Array) -> float:
    """Return the time of one run, over which uncorrected drift accumulates [s]."""
    first, last = int(cycles.runs[0, 0, 0]), int(cycles.runs[-1, -1, 1])
    return float(time[last] - time[first]) / (2 * cycles.count)


def evaluate_spheres(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate spheres probed at stations over repeated cycles.

    The motion is that of the point at the origin of the machine's coordinates, the point of
    interest. The axis is the machine's X or Y, whichever the spheres move along more. The record
    has one row for each station; the figures are those of `evaluate_motion`, without drift.
    """
    record = only(test, records)
    if len(test.columns.spheres) < 3:
        raise RecordError(
            f"test '{test.name}' names {len(test.columns.spheres)} spheres: a rigid motion needs "
            "at least three"
        )
    points = np.stack([_centres(record, sphere) for sphere in test.columns.spheres], axis=1)
    command, unit = _command(test, record)
    number = int(np.argmax(np.ptp(points.mean(axis=1), axis=0)))
    if number == 2:
        raise RecordError(
            f"test '{test.name}': the spheres move most along the machine's Z, but an axis must be "
            "along X or Y: check the order of their columns"
        )
    frame = travel_frame(np.eye(3)[number])
    points = points @ frame.T
    # the reference is the first station, averaged over its visits
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
            # across is positive towards the other axis
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
    """Return the command at each station, and its unit."""
    if not test.commands:
        command = column(test, record, "command")
        return command, record.channel(test.columns.command or 0).unit
    if len(test.commands) != record.size:
        raise RecordError(
            f"test '{test.name}' gives {len(test.commands)} commands for {record.size} stations: "
            "give one command for each station"
        )
    return np.array(test.commands), "m"


def _centres(record: Record, sphere: str) -> Array:
    coordinates = []
    for name in sphere_columns(sphere):
        channel = record.channel(name)
        if channel.unit != "m":
            got = f"is in {channel.unit}" if channel.unit else "does not give its unit"
            raise RecordError(
                f"column '{name}' {got}, and a sphere needs a unit of length: add it to the "
                f'sphere, such as spheres="{sphere} mm"'
            )
        coordinates.append(channel.values)
    require_live(record, [sphere_columns(sphere)[0]])
    return np.stack(coordinates, axis=1)


def _rigidity(residuals: Array) -> str:
    rms = float(np.sqrt(np.mean(residuals**2)))
    return f"the spheres deviate from a rigid body by {rms * 1e6:.3g} um rms"


def evaluate_workspace(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate repeated visits of the corners of a workspace.

    The record has one row for each visit: the number of the corner, ``x`` and ``y``; each corner at
    least twice.
    """
    record = only(test, records)
    corner = column(test, record, "corner")
    points = np.stack((column(test, record, "x"), column(test, record, "y")), axis=1)
    visits = [np.flatnonzero(corner == k) for k in range(4)]
    if not set(np.unique(corner)) == {0.0, 1.0, 2.0, 3.0} or min(v.size for v in visits) < 2:
        raise RecordError(
            f"test '{test.name}': corners are numbered 0 to 3, anticlockwise from low x and low y, "
            "each visited at least twice; got "
            f"{', '.join(f'{c:g}' for c in np.unique(corner)[:8])}"
        )
    rounds = min(v.size for v in visits)
    corners = workspace(np.stack([points[v[:rounds]] for v in visits], axis=1))
    sensor = campaign.instrument(test.along)
    # two sensors with independent directions
    pair = None if sensor is None else replace(sensor, alignment=2.0**0.5 * sensor.alignment)
    notes = []
    if any(v.size > rounds for v in visits):
        notes.append(f"{rounds} complete rounds are evaluated; further visits are ignored")
    area = measured(corners.area, sensor, role="area")
    square = measured(corners.squareness, pair, role="squareness")
    remark = "angle from the path of x to that of y, less a right angle"
    return TestResult(
        test=test,
        figures=(
            figure_of(campaign, test, "workspace_area", area, "between the mean corners"),
            figure_of(campaign, test, "squareness", square, remark),
        ),
        details={"workspace": corners},
        notes=tuple(notes),
    )


def evaluate_axis(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate indicators over turns of an axis of rotation, in the manner of ISO 230-7.

    The columns are ``angle`` and one or more of ``radial``, ``axial`` and ``tilt``; with
    ``radial_90`` as well as ``radial`` also the sensitive direction that turns with the axis.
    """
    record = only(test, records)
    angle = column(test, record, "angle")
    fixed: tuple[Direction, ...] = ("radial", "axial", "tilt")
    readings: dict[Direction, Array] = {}
    for role in fixed:
        if getattr(test.columns, role) is not None:
            readings[role] = column(test, record, role)
    second = optional_column(test, record, "radial_90")
    if not readings or (second is not None and "radial" not in readings):
        raise RecordError(
            f"test '{test.name}' of kind {test.test} needs the column of 'radial', 'axial' or "
            "'tilt', and that of 'radial' with 'radial_90': name it"
        )
    if second is not None:
        readings["rotating"] = readings["radial"] * np.cos(angle) + second * np.sin(angle)
    figures: list[MeasuredCharacteristic] = []
    motions: dict[str, AxisErrorMotion] = {}
    for role, reading in readings.items():
        motion = motions[role] = error_motion(angle, reading, direction=role)
        sensor = campaign.instrument(test.angle if role == "tilt" else test.transverse)
        amounts = {
            f"{role}_synchronous": motion.synchronous,
            f"{role}_asynchronous": motion.asynchronous,
        }
        if role == "radial":
            amounts["eccentricity"] = motion.once_per_turn
        elif role != "rotating":
            amounts[f"{role}_once_per_turn"] = motion.once_per_turn.times(2.0)
        for quantity, amount in amounts.items():
            total = measured(amount, sensor, role="transverse range")
            figures.append(figure_of(campaign, test, quantity, total, f"{motion.turns} turns"))
    return TestResult(
        test=test,
        figures=tuple(figures),
        details={"error_motions": motions},
        notes=tuple(_axis_notes(motions)),
    )


def _axis_notes(motions: Mapping[str, AxisErrorMotion]) -> Iterator[str]:
    """Yield remarks on the error motions of an axis of rotation, by direction."""
    turns = next(iter(motions.values())).turns
    yield (
        f"{turns} turns: asynchronous motion is the largest range at any angle, and grows with "
        "their number; the form of the artefact is in synchronous motion until reversal parts them"
    )
    if "axial" in motions or "tilt" in motions:
        yield (
            "order 1 of axial motion and tilt is no eccentricity and stays in the synchronous "
            "part; its range is given apart: off the axis it contains the run-out of the face"
        )
    if "rotating" in motions:
        motion = motions["rotating"]
        order_2 = 2.0 * abs(np.mean(motion.mean * np.exp(-2j * motion.angle)))
        yield (
            f"rotating direction: order 2 has {1e6 * order_2:.3g} um; before it is taken for "
            "motion, compare the gains of both indicators, as a difference g of them turns the "
            f"eccentricity of {1e6 * motions['radial'].once_per_turn.value:.4g} um into g/2 of it, "
            "and a second indicator 90 deg the other way into all of it"
        )


def evaluate_response(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate a forced response, from records over time or as an estimated frequency response.

    Records over time are averaged; a record over frequency is an estimated response. The figures
    are those of the mode that dominates the motion of the axis.
    """
    notes: tuple[str, ...] = ()
    added = 0.0
    if records[0].over == "frequency":
        responses = [response_from_record(record) for record in records]
        estimate = None
    else:
        if test.columns.input is None or not test.columns.output:
            raise RecordError(
                f"test '{test.name}' of kind response needs the columns of 'input' and 'output': "
                "name both"
            )
        estimate = estimate_response(
            records,
            test.columns.input,
            list(test.columns.output),
            excitation=test.excitation,
        )
        responses, added = [estimate.response], estimate.added_damping_rate
        notes = estimate.notes
    fit = fit_modes(
        responses,
        band=test.band,
        count="auto" if test.modes is None else test.modes,
        added_damping_rate=added,
    )
    return TestResult(
        test=test,
        figures=_figures(test, campaign, _mode(test, fit)),
        details={"estimate": estimate, "response": responses[0], "fit": fit},
        notes=(*notes, *fit.notes),
    )


def evaluate_ring_down(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate a free decay.

    The figures are those of the strongest mode.
    """
    if len(records) != 1 or not test.columns.output:
        raise RecordError(
            f"test '{test.name}' of kind ring-down needs one record and the columns of 'output'"
        )
    fit = ring_down(
        records[0],
        list(test.columns.output),
        count=None if test.modes is None else test.modes,
    )
    return TestResult(
        test=test,
        figures=_figures(test, campaign, _strongest(test, fit)),
        details={"decay": fit},
        notes=fit.notes,
    )


def mode_of_axis(modes: tuple[Mode, ...]) -> Mode:
    """Return the mode with the largest part of the static response to the first input."""
    return max(modes, key=lambda m: float(np.nanmax(np.abs(m.residues[:, 0]))) / abs(m.pole))


def _strongest(test: Test, fit: RingDown) -> DecayMode:
    if not fit.modes:
        raise RecordError(
            f"test '{test.name}': no mode exceeds the noise: give a record that starts with the "
            "decay"
        )
    return max(fit.modes, key=lambda m: float(np.abs(m.amplitudes).max()))


def _mode(test: Test, fit: ModalFit) -> Mode:
    if not fit.modes:
        raise RecordError(f"test '{test.name}': {fit.notes[0]}; widen the band, or average more")
    return mode_of_axis(fit.modes)


def _figures(
    test: Test, campaign: Campaign, mode: Mode | DecayMode
) -> tuple[MeasuredCharacteristic, ...]:
    frequency = measured(mode.frequency_hz, campaign.instrument(test.along), role="frequency")
    return (
        figure_of(campaign, test, "natural_frequency_hz", frequency, "undamped, by modal fit"),
        figure_of(campaign, test, "damping_ratio", mode.damping_ratio, "share of the critical"),
    )
