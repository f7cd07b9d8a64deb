"""A virtual laboratory: sensors, hammer, and records of a stage."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.choose import has_no
from flexstage.base.errors import ModelError
from flexstage.records import Channel, Record
from flexstage.system import modes
from flexstage.system.response import sum_of_modes
from flexstage.virtual.as_built import AsBuilt, AsBuiltAxis
from flexstage.virtual.imperfections import ANGLES, MOTIONS
from flexstage.virtual.sensors import LABORATORY_SENSORS, SimulatedSensor, sensor_errors

#: Step of a staircase over the sensor noise [1].
_STEP_OVER_NOISE = 6.0
#: Spheres of the plate on the platform, and their positions from the reading point [m].
SPHERES = tuple(f"SPH{i}" for i in range(1, 6))
_SPHERE_AT = np.array(
    [
        (-22e-3, -18e-3, 14e-3),
        (21e-3, -19e-3, 14e-3),
        (20e-3, 18e-3, 14e-3),
        (-19e-3, 21e-3, 14e-3),
        (1e-3, 2e-3, 26e-3),
    ]
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Laboratory:
    """Sensors and procedures of a virtual laboratory.

    Notes
    -----
    Validity: the usual values are those of capacitive sensors and an autocollimator in a quiet
    room, not of one instrument. The records have no mains pick-up.
    """

    position: SimulatedSensor = LABORATORY_SENSORS["along"]
    """Sensor along the axis."""
    transverse: SimulatedSensor = LABORATORY_SENSORS["transverse"]
    """Sensors across the axis, in the plane and out of it."""
    angle: SimulatedSensor = LABORATORY_SENSORS["angle"]
    """Sensors of roll, pitch and yaw [rad]."""
    cycles: int = 8
    """Number of cycles over the full stroke."""
    samples: int = 400
    """Samples per cycle."""
    sample_rate_hz: float = 50.0
    """Sample rate of the cycles [Hz]."""
    hold: int = 4096
    """Samples of a record of the stage at rest."""
    levels: int = 20
    """Levels of a staircase."""
    per_level: int = 80
    """Samples per level."""
    hits: int = 6
    """Number of hammer impacts."""
    impact_time: float = 0.5e-3
    """Duration of an impact, half a sine [s]."""
    impact_force: float = 8.0
    """Mean peak force of an impact [N]."""
    hammer_rate_hz: float = 8192.0
    """Sample rate of force and response [Hz]."""
    hammer_time: float = 0.8
    """Time between impacts [s]."""
    pre_trigger: float = 0.02
    """Mean pre-trigger time [s]."""
    signal_to_noise: float = 100.0
    """Rms of the response to an impact over the rms of the noise [1]."""
    repeats: int = 10
    """Number of visits to each corner of the workspace."""


def stream(seed: int, what: int) -> np.random.Generator:
    """Return the random generator of one kind of record."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2, what)))


def virtual_record(
    built: AsBuilt, channels: Mapping[str, tuple[Array, str]], time: Array, *, over: str = "time"
) -> Record:
    """Return a record that is marked as virtual."""
    return Record(
        channels=tuple(Channel(name=n, values=v, unit=u) for n, (v, u) in channels.items()),
        time=time,
        source=f"virtual {built.stage.name}",
        notes=("virtual record: simulated, not measured", *built.notes),
        attributes={"origin": "virtual"},
        over="point" if over == "point" else "time",
    )


def motion_record(built: AsBuilt, laboratory: Laboratory, axis: str, *, seed: int = 0) -> Record:
    """Cycle an axis over its full stroke and read all six motions.

    The seed determines sensor errors, noise and repeatability.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.virtual.as_built import as_built
    >>> built = as_built(design("vgtu-piezo"), seed=1)
    >>> record = motion_record(built, Laboratory(), "x")
    >>> print(f"{np.ptp(record.channel('along').values) * 1e6:.1f} um")
    63.1 um
    """
    built_axis = built.axis(axis)
    rng = stream(seed, 10 + [a.name for a in built.axes].index(axis))
    lab = laboratory
    size = lab.cycles * lab.samples + 1
    time = np.arange(size) / lab.sample_rate_hz
    command = np.append(
        np.tile(built_axis.cycle(lab.samples), lab.cycles), built_axis.command_range[0]
    )
    position = built_axis.position(command)
    cycle = np.minimum(np.arange(size) // lab.samples, lab.cycles - 1)
    approach = built_axis.repeatability * rng.standard_normal(lab.cycles)
    position = position + approach[cycle]
    channels = {
        "command": (command, built_axis.command_unit),
        "along": (_read(lab.position, position, 0.0, time, rng), "m"),
    }
    for motion in MOTIONS:
        sensor = lab.angle if motion in ANGLES else lab.transverse
        along = 0.0 if motion in ANGLES else position
        truth = built_axis.guide.at(position, motion)
        channels[motion] = (_read(sensor, truth, along, time, rng), sensor.unit)
    return virtual_record(built, channels, time)


def _read(
    sensor: SimulatedSensor,
    truth: Array,
    along: Array | float,
    time: Array,
    rng: np.random.Generator,
) -> Array:
    clean = sensor_errors(sensor, rng).read(truth, along, time)
    return clean + sensor.noise_rms * rng.standard_normal(clean.size)


def hold_record(built: AsBuilt, laboratory: Laboratory, axis: str, *, seed: int = 0) -> Record:
    """Read an axis at rest in the middle of its stroke."""
    built_axis = built.axis(axis)
    rng = stream(seed, 20 + [a.name for a in built.axes].index(axis))
    time = np.arange(laboratory.hold) / laboratory.sample_rate_hz
    position = np.full(time.size, 0.5 * built_axis.stroke)
    reading = _read(laboratory.position, position, 0.0, time, rng)
    return virtual_record(built, {"along": (reading, "m")}, time)


def staircase_record(built: AsBuilt, laboratory: Laboratory, axis: str, *, seed: int = 0) -> Record:
    """Read the position over a staircase of small steps from the middle of the stroke.

    The step is six times the noise, or the smallest step of the drive.
    """
    built_axis = built.axis(axis)
    lab = laboratory
    rng = stream(seed, 30 + [a.name for a in built.axes].index(axis))
    low, high = built_axis.command_range
    step = built_axis.smallest_step or _STEP_OVER_NOISE * lab.position.noise_rms
    level = np.repeat(np.arange(lab.levels, dtype=np.float64), lab.per_level)
    time = np.arange(level.size) / lab.sample_rate_hz
    rise = step / built_axis.stroke * (high - low)
    command = 0.5 * (low + high) + rise * level
    # from the low end up, so that all steps have one direction
    position = built_axis.position(np.concatenate((np.linspace(low, command[0], 50), command)))[50:]
    reading = _read(lab.position, position, 0.0, time, rng)
    return virtual_record(
        built, {"command": (command, built_axis.command_unit), "along": (reading, "m")}, time
    )


def workspace_record(
    built: AsBuilt, laboratory: Laboratory, axes: str = "", *, seed: int = 0
) -> Record:
    """Visit the four corners of the workspace repeatedly and read x and y.

    Corners are numbered anticlockwise from 0. A stage has one workspace: `axes` is not used.
    """
    del axes
    first, second = built.axes[:2]
    rng = stream(seed, 40)
    corner = np.tile(np.arange(4.0), laboratory.repeats)
    a = np.where((corner == 1) | (corner == 2), 1.0, 0.0) * first.stroke
    b = np.where(corner >= 2, 1.0, 0.0) * second.stroke
    a = a + first.repeatability * rng.standard_normal(a.size)
    b = b + second.repeatability * rng.standard_normal(b.size)
    x = a + second.guide.at(b, "across")
    y = b + first.guide.at(a, "across")
    time = np.arange(corner.size, dtype=np.float64)
    # one visit per unit of time: sensor drift counts by the point
    channels = {
        "corner": (corner, "1"),
        first.name: (_read(laboratory.position, x, y, time, rng), "m"),
        second.name: (_read(laboratory.position, y, x, time, rng), "m"),
    }
    return virtual_record(built, channels, time, over="point")


def sphere_record(
    built: AsBuilt,
    laboratory: Laboratory,
    axis: str,
    *,
    stations: int = 21,
    noise: float = 1e-7,
    seed: int = 0,
) -> Record:
    """Probe the spheres of a plate on the platform at stations along the stroke, forward and back.

    The columns are the command, and ``SPH1.X`` to ``SPH5.Z``, a row for each station; `noise` is
    the standard deviation of each coordinate of a centre [m]. The laboratory gives the number of
    cycles and the calibration of the scales of the machine.
    """
    built_axis = built.axis(axis)
    names = [a.name for a in built.axes]
    rng = stream(seed, 50 + names.index(axis))
    low, high = built_axis.command_range
    run = np.linspace(low, high, stations)
    command = np.tile(np.concatenate((run, run[::-1])), laboratory.cycles)
    approach = built_axis.repeatability * rng.standard_normal(laboratory.cycles)
    position = built_axis.position(command) + np.repeat(approach, 2 * stations)
    # the second axis of a stage is clamped along the machine's Y, every other along its X
    x, y, z, roll, pitch, yaw = _pose(built_axis, position, along_x=names.index(axis) != 1)
    gain = 1.0 + laboratory.position.calibration * rng.standard_normal(3)
    # small misalignment of the plate, without effect on its rigid motion
    spheres = _SPHERE_AT @ _rotation(*(2e-3 * rng.standard_normal(3))).T
    channels: dict[str, tuple[Array, str]] = {"command": (command, built_axis.command_unit)}
    centres = np.empty((command.size, len(spheres), 3))
    for k in range(command.size):
        turned = spheres @ _rotation(roll[k], pitch[k], yaw[k]).T
        centres[k] = gain * (turned + np.array((x[k], y[k], z[k])))
    centres += noise * rng.standard_normal(centres.shape)
    for i, name in enumerate(SPHERES):
        for j, letter in enumerate("XYZ"):
            channels[f"{name}.{letter}"] = (centres[:, i, j], "m")
    return virtual_record(built, channels, np.arange(command.size, dtype=np.float64), over="point")


def _pose(axis: AsBuiltAxis, position: Array, *, along_x: bool) -> tuple[Array, ...]:
    """Return displacement x, y, z and rotations about x, y, z."""
    errors = {motion: axis.guide.at(position, motion) for motion in MOTIONS}
    if along_x:
        return (
            position,
            errors["across"],
            errors["vertical"],
            errors["roll"],
            errors["pitch"],
            errors["yaw"],
        )
    return (
        errors["across"],
        position,
        errors["vertical"],
        errors["pitch"],
        errors["roll"],
        errors["yaw"],
    )


def _rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Return the rotation matrix of a rotation vector [rad]."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec((roll, pitch, yaw)).as_matrix()


_RECORDS: Mapping[str, Callable[..., Record]] = {
    "motion": motion_record,
    "spheres": sphere_record,
    "staircase": staircase_record,
    "hold": hold_record,
    "workspace": workspace_record,
}


def record_of(
    kind: str, built: AsBuilt, laboratory: Laboratory, axis: str, *, seed: int = 0
) -> Record:
    """Return the record of a kind of test of an axis, or of both axes for a workspace."""
    return _RECORDS[kind](built, laboratory, axis, seed=seed)


class HammerBench:
    """Impact test of a virtual stage: hammer at the platform, drives removed.

    The acceleration is the response of the continuous system with all its modes, up to half the
    sample rate.
    """

    def __init__(self, built: AsBuilt, laboratory: Laboratory) -> None:
        self._stage = built
        self._laboratory = laboratory
        self._block = int(laboratory.hammer_rate_hz * laboratory.hammer_time)
        bare = modes(built.system, drives="removed", count=None)
        f = np.fft.rfftfreq(self._block, 1.0 / laboratory.hammer_rate_hz).astype(np.float64)
        weights = {
            axis.name: built.system.probe(axis.probe).vector @ bare.shapes
            for axis in built.system.axes
        }
        self._response = {
            (struck, read): sum_of_modes(bare, weights[struck] * weights[read], f)
            * -((2.0 * np.pi * f) ** 2)
            for struck in weights
            for read in weights
        }

    def record(self, axis: str, *, seed: int = 0) -> Record:
        """Strike along an axis; return force, and acceleration along every axis."""
        lab = self._laboratory
        names = [a.name for a in self._stage.axes]
        rng = stream(seed, 60 + names.index(axis))
        rest = np.zeros(1024)  # after the decay of the last response
        time = np.arange(lab.hits * self._block + rest.size) / lab.hammer_rate_hz
        force = np.zeros((lab.hits, self._block))
        local = np.arange(self._block) / lab.hammer_rate_hz
        for k in range(lab.hits):
            height = lab.impact_force * (1.0 + 0.2 * rng.standard_normal())
            since = local - lab.pre_trigger * (1.0 + 0.3 * rng.random())
            inside = (since > 0.0) & (since < lab.impact_time)
            force[k, inside] = height * np.sin(np.pi * since[inside] / lab.impact_time)
        spectrum = np.fft.rfft(force, axis=1)
        channels: dict[str, tuple[Array, str]] = {}
        clean = {
            name: np.append(
                np.fft.irfft(spectrum * self._response[axis, name], n=self._block, axis=1),
                rest,
            )
            for name in names
        }
        noise = float(np.sqrt(np.mean(clean[axis] ** 2))) / lab.signal_to_noise
        measured_force = np.append(force, rest)
        measured_force = measured_force + 1e-4 * lab.impact_force * rng.standard_normal(
            measured_force.size
        )
        channels["force"] = (measured_force, "N")
        for name in names:
            reading = clean[name] + noise * rng.standard_normal(time.size)
            channels[f"acceleration {name}"] = (reading, "m/s^2")
        return virtual_record(self._stage, channels, time)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HammerImpact:
    """One impact of a hammer on the platform, drives removed."""

    time: Array
    """Times [s], shape (n,)."""
    force: Array
    """Force of the hammer [N], shape (n,)."""
    response: Array
    """Acceleration of the platform along the axis of the impact [m/s^2], shape (n,)."""
    sample_rate_hz: float
    """Sample rate [Hz]."""


class Hammer:
    """A hammer with a force sensor, and an accelerometer on the platform."""

    def __init__(self, built: AsBuilt, seed: int) -> None:
        self._bench = HammerBench(built, Laboratory(hits=1))
        self._axes = [a.name for a in built.axes]
        self._seed, self._count = seed, 0

    def strike(self, axis: str) -> HammerImpact:
        """Strike once along an axis; each impact is different."""
        if axis not in self._axes:
            raise ModelError(has_no("the stage", "axis", axis, self._axes))
        # a seed for each impact, far from those of other stages
        record = self._bench.record(axis, seed=1_000_003 * (self._seed + 1) + self._count)
        self._count += 1
        time = record.time
        return HammerImpact(
            time=time,
            force=record.channel("force").values,
            response=record.channel(f"acceleration {axis}").values,
            sample_rate_hz=float(1.0 / (time[1] - time[0])),
        )

    def reset(self) -> None:
        """Begin with the first impact again."""
        self._count = 0
