"""Verb *centre*: the centring of an encoder scale with the stage, by records or simulated."""

import json
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import count, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.choose import has_no
from flexstage.base.errors import PlanError
from flexstage.centring.geometry import ScaleKind
from flexstage.centring.move import Positioner, PositionerAxis
from flexstage.centring.requests import (
    CalibrateRequest,
    CentreRequest,
    HeadAngles,
    MountingAngle,
    ScaleRadius,
)
from flexstage.experiments.axis_limits import AxisSetting, axis_setting, estimated_stroke
from flexstage.experiments.command import prepare_loops
from flexstage.experiments.verb import (
    PlanContext,
    PlanLookup,
    PlannedStep,
    ResultLookup,
    RunContext,
    StepResult,
    Verb,
)
from flexstage.files.decoder import read_json
from flexstage.files.format import Format
from flexstage.files.ranges import POSITIVE, Range, Seed, require_ranges
from flexstage.files.write import write_whole
from flexstage.instruments.protocol import Capability, Instrument
from flexstage.instruments.ramp import lead_to
from flexstage.instruments.record_run import record_now
from flexstage.instruments.recording.writer import RunWriter
from flexstage.quantities.table import Section, table
from flexstage.quantities.units import DIMENSIONS, Angle, Frequency, Length, Time
from flexstage.stage import Stage

if TYPE_CHECKING:
    from flexstage.centring.procedure import CentreReading
    from flexstage.centring.setup import Setup
    from flexstage.quantities.table import Content
    from flexstage.virtual.table import VirtualTable


_SIZE = Range(low=0.0, high=1e3, above=True)
_RESULT = Format(
    noun="result of centring",
    error=PlanError,
    finite=False,
    exact=True,
    mend="remove the file, and continue the run with --resume, which repeats the step",
)
_SIMULATED = "simulated table and heads"
_NOTES = (f"{_SIMULATED}; the position of the scale follows from the stage's sensors",)
#: Radius [m] and angles of heads [rad] of a simulated table.
_RADIUS, _HEADS = 50e-3, (0.0, 1.6, 3.1, 4.8)
#: Seconds between two looks for a record, and for which a whole file no longer grows.
_POLL, _QUIET = 0.2, 1.0
_UM = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedTurns:
    """Records of the heads, one for each position of the stage: by the instrument, or files."""

    folder: str | None = None
    """Folder in which files appear, as STEP-0.csv, STEP-1.csv and so on: turns, or, with a column
    of faces and no columns named here, readings of a polygon by an autocollimator (default: the
    instrument records the columns, which are sensors of the plan).
    """
    angle: str | None = None
    """Column of the true angle of the table."""
    error: tuple[str, ...] = ()
    """Columns of the errors of the heads, or of indicators on the rim."""
    reading: tuple[str, ...] = ()
    """Instead of error: columns of the angles that the heads read, wrapped at a turn or not."""
    duration: Annotated[Time, POSITIVE] | None = None
    """Duration of a record by the instrument, two turns or more [s]."""
    sample_rate: Annotated[Frequency, Range(low=1e-3, high=1e7)] = 100.0
    """Sample rate of a record by the instrument [Hz]."""
    unit: str | None = None
    """Unit of angle and errors, where the files do not state it."""
    kind: ScaleKind = "disc"
    """Kind of scale."""
    wait: Annotated[Time, POSITIVE] = 3600.0
    """Longest time to wait for a file [s]."""

    def __post_init__(self) -> None:
        if self.folder is not None:
            return
        if self.angle is None or bool(self.error) == bool(self.reading) or self.duration is None:
            raise PlanError(
                "records of centre without a folder are read from the instrument: give the sensors "
                "of angle and of error or reading, and the duration of two turns"
            )

    def require_heads(self, heads: int) -> None:
        """Refuse columns that are not those of a number of heads."""
        if self.error and self.reading:
            raise PlanError("records of centre have columns of error or of reading: leave one out")
        named = len(self.error) + len(self.reading)
        if named and named != heads:
            raise PlanError(
                f"centre has {heads} angles of heads and {named} columns of them in its records: "
                "give one column for each"
            )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns: of the angle, if there is one, and of the heads."""
        return (*(() if self.angle is None else (self.angle,)), *self.error, *self.reading)

    def request(self, heads: tuple[float, ...], radius: float | None) -> CentreRequest:
        """Return the request for the evaluation of a record."""
        return CentreRequest(
            angle=self.angle,
            error=self.error,
            reading=self.reading,
            unit=self.unit,
            heads=heads,
            radius=radius,
            kind=self.kind,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Centre(Verb):
    """Centre an encoder scale on a rotary table, by records of its heads or simulated."""

    verb: ClassVar[str] = "centre"
    moving: ClassVar[bool] = True

    axes: tuple[str, str] = ("x", "y")
    """The two axes that carry the scale."""
    records: RecordedTurns | None = None
    """Records of the heads; without them the step simulates table and heads."""
    sensors: tuple[str, str] = ("x", "y")
    """The sensors of their positions."""
    radius: ScaleRadius | None = None
    """Radius of the scale at the heads [m]; 50 mm if they are simulated."""
    eccentricity: Annotated[tuple[float, float], DIMENSIONS["length"]] = (14e-6, -11e-6)
    """Centre of the scale on the table with both axes at mid-range [m]."""
    heads: HeadAngles = ()
    """Angular positions of the heads [rad]; four of them if they are simulated."""
    mounting_angle: MountingAngle = 0.4
    """Angle of the stage on the table [rad]."""
    noise: Annotated[Angle, _SIZE] = 4.8e-6
    """Standard deviation of a head's reading [rad]."""
    target: Annotated[Length, _SIZE] = 0.1e-6
    """Target eccentricity [m]."""
    moves: Annotated[int, Range(low=1, high=100)] = 3
    """Largest number of moves towards the centre."""
    closed_loop: bool = True
    """Move the axes under position control where possible."""
    seed: Seed = 0
    """Random seed of the errors of the scale and of the noise."""

    def __post_init__(self) -> None:
        require_ranges(self, PlanError, self.verb)
        if self.records is not None and (self.radius is None or not self.heads):
            raise PlanError(
                "centre by records needs the radius at which the scale is read and the angles "
                "of its heads: give radius and heads"
            )
        if self.records is not None:
            self.records.require_heads(len(self.heads))
        radius = self.radius or _RADIUS
        if not max(abs(e) for e in self.eccentricity) < radius:
            raise PlanError(
                f"the eccentricity of centre must be smaller than its radius of {radius:g} m, "
                f"got {self.eccentricity[0]:g} and {self.eccentricity[1]:g} m"
            )
        for what, two in (("axes", self.axes), ("sensors", self.sensors)):
            if two[0] == two[1]:
                raise PlanError(f"centre needs two {what}, got '{two[0]}' twice")

    def axis_of(self, plan: PlanLookup) -> str:
        del plan
        return "".join(self.axes)

    def reads(self, before: Mapping[str, Verb]) -> tuple[str, ...]:
        del before
        records = self.records
        if records is None or records.folder is not None:
            return self.sensors
        return (*self.sensors, *records.columns)

    def preview(self, context: PlanContext, name: str) -> PlannedStep:
        for axis in self.axes:
            axis_setting(context.stage, axis, closed_loop=True)
        records = self.records
        source, duration = _SIMULATED, 0.0
        if records is not None:
            source = f"turns read from {records.folder or ', '.join(records.columns)}"
            if records.folder is None:
                for sensor in (records.angle, *records.reading):
                    if sensor is not None and context.plan.sensor(sensor).unit != "rad":
                        raise PlanError(f"sensor '{sensor}' reads an angle: give it 'unit: rad'")
                duration = (self.moves + 3) * (records.duration or 0.0)
        what = f"up to {self.moves + 2} moves of {', '.join(self.axes)}; {source}"
        return PlannedStep(name=name, verb=self.verb, what=what, duration=duration)

    def table(self) -> "VirtualTable":
        """Return the simulated table, whose scale has no graduation errors."""
        from flexstage.virtual.table import VirtualTable

        return VirtualTable(
            radius=self.radius or _RADIUS,
            heads=self.heads or _HEADS,
            eccentricity=self.eccentricity,
            noise=self.noise,
            seed=self.seed,
        )

    def run(self, context: RunContext, name: str) -> list[Path]:
        from flexstage.centring.harmonic_fit import distinct_notes
        from flexstage.centring.procedure import centre
        from flexstage.experiments.command import move_to_rest
        from flexstage.virtual.table import VirtualBench

        turns: list[Path] = []
        remarks: list[str] = []
        measure = None
        # files of an earlier run, and sensors that cannot be recorded, are refused before any move
        if self.records is not None and self.records.folder is not None:
            measure = self._measure_files(name, Path(self.records.folder), self.records, remarks)
        elif self.records is not None:
            measure = self._measure_sensors(context, name, self.records, turns, remarks)
        move_to_rest(context.instrument, self.axes)
        first, second = (context.plan.sensor(s).channel for s in self.sensors)
        positioner = InstrumentPositioner(
            context.instrument,
            context.stage,
            self.axes,
            (first, second),
            closed_loop=self.closed_loop,
            angle=self.mounting_angle,
        )
        positioner.to_middle()
        true_lengths: Iterable[float | None] = repeat(None)
        if measure is None:
            bench = VirtualBench(self.table(), positioner)
            measure, true_lengths = bench.measure, bench.true_lengths
        centring = centre(measure, positioner, target=self.target, moves=self.moves)
        moves = []
        for step, true in zip(centring.steps, true_lengths, strict=False):
            length = step.reading.length
            moves.append(
                CentredMove(
                    kind=step.kind,
                    command=(float(step.command[0]), float(step.command[1])),
                    eccentricity=(float(step.reading.vector[0]), float(step.reading.vector[1])),
                    length=length.value,
                    uncertainty=length.expanded,
                    predicted=None if step.predicted is None else step.predicted.value,
                    true_length=true,
                )
            )
        result = CentredStep(
            name=name,
            axes=self.axes,
            target=self.target,
            reached=centring.reached,
            reason=centring.reason,
            moves=tuple(moves),
            notes=_NOTES if self.records is None else distinct_notes(remarks),
        )
        target = context.folder / "records" / f"{name}.json"
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, json.dumps(asdict(result), indent=1) + "\n")
        return [target, *turns]

    def _measure_files(
        self, name: str, folder: Path, records: RecordedTurns, notes: list[str]
    ) -> Callable[[], "CentreReading"]:
        """Return the function that waits for the next file and returns its eccentricity."""
        from flexstage.centring.calibrate import at_faces
        from flexstage.centring.from_records import centre_files
        from flexstage.records.contents import read_whole

        earlier = sorted(folder.glob(f"{name}-*.csv"))
        if earlier:
            raise PlanError(
                f"{earlier[0]} is of an earlier run: move the files of step '{name}' out of "
                f"{records.folder}"
            )
        request = records.request(self.heads, self.radius)
        numbers = count()

        def measure() -> "CentreReading":
            file = folder / f"{name}-{next(numbers)}.csv"
            _await(file, records.wait)
            if not records.columns and at_faces(read_whole(file)[0]):
                return _at_polygon(file, request, notes)
            return _eccentricity(centre_files([file], request).setups, file, notes)

        return measure

    def _measure_sensors(
        self,
        context: RunContext,
        name: str,
        records: RecordedTurns,
        files: list[Path],
        notes: list[str],
    ) -> Callable[[], "CentreReading"]:
        """Return the function that records turns, adds the file, and returns the eccentricity."""
        from flexstage.centring.from_records import centre_records

        request = records.request(self.heads, self.radius)
        signals = [context.signal(sensor) for sensor in records.columns]
        duration = records.duration or 0.0
        samples = max(round(duration * records.sample_rate), 2)
        rate = context.instrument.recorder.configure(signals, records.sample_rate, samples)
        samples = max(round(duration * rate), 2)
        numbers = count()

        def measure() -> "CentreReading":
            stream = context.folder / "records" / f"{name}.turn-{next(numbers)}.stream"
            about = context.metadata(name, "turn", "".join(self.axes))
            with RunWriter(stream, [(s.name, s.unit) for s in signals], rate, about) as writer:
                record = record_now(context.instrument, signals, rate, samples, writer)
            files.append(stream.with_suffix(".h5"))
            _require_turn(record.channels[0].values, records)
            return _eccentricity(centre_records([record], request).setups, files[-1], notes)

        return measure

    def result(
        self, context: RunContext, name: str, files: list[Path], *, now: bool
    ) -> "CentredStep":
        del context, now
        file = files[0]
        return read_json(
            CentredStep, file.read_bytes(), f"the result of step '{name}' in {file}", _RESULT
        )

    @staticmethod
    def section(steps: "Sequence[CentredStep]", result: ResultLookup) -> Section:
        del result
        heads = (
            "move", "kind", "x [µm]", "y [µm]", "eccentricity [µm]", "± (95 %)",
            "expected [µm]", "true [µm]",
        )  # fmt: skip
        content: list[Content] = []
        for step in steps:
            rows = []
            for i, m in enumerate(step.moves):
                lengths = (*m.command, m.length, m.uncertainty, m.predicted, m.true_length)
                cells = ("" if length is None else f"{length * _UM:.3f}" for length in lengths)
                rows.append((i, m.kind, *cells))
            words = f"Step {step.name}: target {step.target * _UM:.3g} µm; {step.reason}."
            if step.simulated:
                words += (
                    " The scale and its heads are simulated, so the true eccentricity is known."
                )
            content += [words, table("", heads, rows, notes=step.notes)]
        return Section(title="Centring", key="centring", content=tuple(content))


@dataclass(frozen=True, slots=True, kw_only=True)
class CentredMove:
    """One measurement of the eccentricity, with the move before it."""

    kind: str
    """``start``, ``trial`` or ``move``."""
    command: tuple[float, float]
    """Commands of the axes, from mid-range [m]."""
    eccentricity: tuple[float, float]
    """Measured centre of the scale after the move, x and y on the table [m]."""
    length: float
    """Measured eccentricity [m]."""
    uncertainty: float
    """Its expanded uncertainty at 95 % [m]."""
    predicted: float | None
    """Expected eccentricity after the move [m]; None before the calibration of the moves."""
    true_length: float | None
    """True eccentricity of a simulated scale [m]; None for a measured one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentredStep(StepResult):
    """Result of a step of centre."""

    axes: tuple[str, str]
    """The axes that moved the scale."""
    target: float
    """Target eccentricity [m]."""
    reached: bool
    """Whether the upper end of the 95 % interval of the last measurement is below the target."""
    reason: str
    """Reason why the centring ended."""
    moves: tuple[CentredMove, ...]
    """All measurements and moves."""
    notes: tuple[str, ...] = ()
    """Notes for the report."""

    def plain(self, result: ResultLookup) -> dict[str, Any]:
        del result
        fields = asdict(self)
        return {
            "axis": "".join(fields.pop("axes")),
            **{k: fields[k] for k in fields if k != "name"},
        }

    @property
    def simulated(self) -> bool:
        """Whether table and heads are simulated."""
        return self.moves[0].true_length is not None

    @property
    def line(self) -> str:
        first, last = self.moves[0].length, self.moves[-1].length
        source = f", {_SIMULATED}" if self.simulated else ""
        return (
            f"{self.name}{source}: eccentricity {_UM * first:.2f} um reduced to "
            f"{_UM * last:.3f} um: {self.reason}"
        )


def _eccentricity(setups: "list[Setup]", file: Path, notes: list[str]) -> "CentreReading":
    """Return the eccentricity of a record, and add the notes on it."""
    from flexstage.centring.procedure import centre_reading

    (setup,) = setups
    notes += setup.notes
    if setup.centre is None:
        raise PlanError(f"{file} shows no eccentricity: {'; '.join(setup.notes)}")
    return centre_reading(setup.centre)


def _at_polygon(file: Path, request: CentreRequest, notes: list[str]) -> "CentreReading":
    r"""Return the eccentricity by an autocollimator that reads the faces of a polygon on the table.

    The table stands where a head at alpha reads the nominal angle theta of each face, and is off it
    by b. One column of readings is -b for a polygon without errors; several are a rosette, which
    separates the two (`dual_closure`). At the radius R, to first order in e/R,

    .. math:: b = -\frac{e}{R} \sin(\theta + \alpha - \varphi), \qquad
        e_x + j e_y = \frac{2 R}{n} \sum b\, j\, e^{j (\theta + \alpha)}.
    """
    from flexstage.centring.calibrate import calibrate_files, face_readings
    from flexstage.centring.eccentricity import HeadReadings
    from flexstage.centring.procedure import CentreReading
    from flexstage.centring.setup import fit_setup
    from flexstage.records.contents import read_whole

    if len(request.heads) != 1 or request.radius is None:
        raise PlanError(
            f"{file} has readings of a polygon, at which the table is set by one head: give the "
            f"angle of this head alone, got {len(request.heads)} angles"
        )
    (alpha,) = request.heads
    polygon = CalibrateRequest(unit=request.unit)
    readings, names, remarks = face_readings([read_whole(file)[0]], polygon)
    notes += remarks
    theta = 2.0 * math.pi * np.arange(len(readings)) / len(readings)
    if len(names) == 1:
        read = np.isfinite(readings[:, 0])
        head = HeadReadings(
            angle=theta[read], error=readings[read, 0], head_angle=alpha, name=names[0]
        )
        notes.append(
            "errors of the polygon's faces of order 1 count as eccentricity: read it in several "
            "settings on the table"
        )
        setup = fit_setup([head], False, request.radius, request.kind, None, request.outliers)
        return _eccentricity([setup], file, notes)
    if any(name.startswith("round") or not name[-1].isdigit() for name in names):
        raise PlanError(
            f"{file} has the columns {', '.join(names)}: end the name of each with the number of "
            "faces by which the polygon is turned on the table, such as s0 and s1"
        )
    table = calibrate_files([file], replace(polygon, method="rosette")).divisions[1]
    if 1 in table.blind:
        raise PlanError(
            f"the settings of {file} do not show order 1: choose others, such as 0 and 1"
        )
    wave = (2.0j * request.radius / theta.size) * np.exp(1j * (theta + alpha))
    weights = np.array([wave.real, wave.imag])
    return CentreReading(
        vector=weights @ table.error,
        covariance=weights @ table.covariance @ weights.T,
        degrees_of_freedom=table.contributions[0].degrees_of_freedom,
    )


def _require_turn(angle: Array, records: RecordedTurns) -> None:
    """Refuse a record in which the table stands still, or turns less than once."""
    turns = float(np.ptp(np.unwrap(angle))) / (2.0 * math.pi)
    if turns < 1.0:
        raise PlanError(
            f"the table turned {turns:.3f} times by '{records.angle}' in {records.duration:g} s, "
            "and a record needs a turn or more: let it turn, or increase the duration"
        )


def _await(file: Path, longest: float) -> None:
    """Wait until a file is there and no longer grows [s]."""
    began = changed = time.monotonic()
    size = -1
    progress.update(f"turn the table and write {file}")
    while size <= 0 or time.monotonic() < changed + _QUIET:
        before, size = size, file.stat().st_size if file.exists() else -1
        if size != before:
            changed = time.monotonic()
        if size <= 0 and time.monotonic() > began + longest:
            raise PlanError(
                f"no record {file} was written within {longest:g} s: increase wait, move the files "
                "of this step out of the folder, and repeat the step by --resume"
            )
        time.sleep(_POLL)


#: Relative uncertainty of a move in open loop, and under position control [1].
_OPEN, _CLOSED = 0.05, 1e-4


class InstrumentPositioner(Positioner):
    """Two axes of an instrument, commanded in metres from mid-range.

    `angle` is the mounting angle on the table [rad]. Every command is approached from below, so
    that there is no backlash.

    Notes
    -----
    Validity: in open loop a command in metres is a fraction of the estimated stroke, and hysteresis
    is part of the uncertainty of a move.
    """

    def __init__(
        self,
        instrument: Instrument,
        stage: Stage,
        axes: tuple[str, str],
        channels: tuple[int, int],
        *,
        closed_loop: bool,
        angle: float,
    ) -> None:
        self._instrument, self._channels = instrument, channels
        self._axes = [_instrument_axis(instrument, stage, a, closed_loop) for a in axes]
        super().__init__(self._axes)
        c, s = math.cos(angle), math.sin(angle)
        self._turn = np.array([[c, -s], [s, c]])
        self._middle = np.zeros(2)

    def _go(self, command: tuple[float, float]) -> None:
        for axis, value in zip(self._axes, command, strict=True):
            axis.go(value)

    def to_middle(self) -> None:
        """Move to the middle of both ranges, and zero the readings there."""
        self.move_to(*(-a.half for a in self._axes))
        self.move_to(0.0, 0.0)
        self._middle = self._reading()

    def _reading(self) -> Array:
        """Return the mean position by the sensors [m], shape (2,)."""
        # averaged readings, a millisecond apart: one period of the mains
        readings = 20
        total = np.zeros(2)
        for _ in range(readings):
            total += [self._instrument.channel(number) for number in self._channels]
            self._instrument.pause(1e-3)
        return total / readings

    @property
    def true_position(self) -> Array:
        """Position by the sensors, from mid-range, in coordinates of the table [m], shape (2,)."""
        return self._turn @ (self._reading() - self._middle)


@dataclass(kw_only=True)
class _InstrumentAxis(PositionerAxis):
    """One axis: commands in metres from mid-range, sent as positions or voltages."""

    instrument: Instrument
    setting: AxisSetting
    scale: float
    """Units of the command per metre."""

    def go(self, command: float) -> None:
        low, high = self.setting.low, self.setting.high
        value = min(max(0.5 * (low + high) + self.scale * command, low), high)
        if self.setting.quantity == "position":
            self.instrument.axes[self.name].move_to(value)
        else:
            lead_to(self.instrument, {self.name: value}, "voltage", time=0.2)


def _instrument_axis(
    instrument: Instrument, stage: Stage, name: str, closed_loop: bool
) -> _InstrumentAxis:
    # resolution of an axis with a piezo stack [m]
    resolution = 5e-9
    if name not in instrument.axes:
        raise PlanError(has_no("the instrument", "axis", name, instrument.axes))
    axis = instrument.axes[name]
    controllable = Capability.CLOSED_LOOP in axis.capabilities
    setting = axis_setting(
        stage, name, closed_loop=closed_loop and controllable, limits=axis.limits
    )
    prepare_loops(instrument, [name], setting.quantity)
    by_position = setting.quantity == "position"
    span, step = setting.high - setting.low, setting.smallest_step
    scale = 1.0 if by_position else span / estimated_stroke(stage, name)
    return _InstrumentAxis(
        name=name,
        half=0.5 * span / scale,
        quantum=step or 0.0,
        resolution=0.5 * step if step else resolution,
        hysteresis=_CLOSED if by_position or axis.limits.voltage is None else _OPEN,
        instrument=instrument,
        setting=setting,
        scale=scale,
    )
