"""A virtual laboratory: its sensors, its hammer, and the records of a stage that it writes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.choose import has_no
from flexstage.base.errors import ModelError
from flexstage.records import Channel, Record
from flexstage.system import modes
from flexstage.virtual.as_built import AsBuilt, AsBuiltAxis
from flexstage.virtual.imperfections import ANGLES, MOTIONS
from flexstage.virtual.sensors import LABORATORY_SENSORS, SimulatedSensor, drawn

#: Steps of a staircase over the noise of the sensor.
_STEP_OVER_NOISE = 6.0
#: Spheres of the plate on the platform, and where they are from its reading point [m].
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
    room, and no one's own. Of what a sensor picks up of the mains, these records hold nothing.
    """

    position: SimulatedSensor = LABORATORY_SENSORS["along"]
    """Reads along the axis."""
    transverse: SimulatedSensor = LABORATORY_SENSORS["beside"]
    """Read across it, in the plane and out of it."""
    angle: SimulatedSensor = LABORATORY_SENSORS["angle"]
    """Reads roll, pitch and yaw [rad]."""
    cycles: int = 8
    """Cycles over the whole stroke."""
    samples: int = 400
    """Samples of a cycle."""
    sample_rate_hz: float = 50.0
    """Rate of those samples [Hz]."""
    hold: int = 4096
    """Samples of a record with the stage held."""
    levels: int = 20
    """Levels of a staircase."""
    per_level: int = 80
    """Samples of each."""
    hits: int = 6
    """Blows of a hammer."""
    blow: float = 0.5e-3
    """Length of a blow, which is half a sine [s]."""
    blow_force: float = 8.0
    """About its height [N]."""
    hammer_rate_hz: float = 8192.0
    """Samples in a second of force and response [Hz]."""
    hammer_time: float = 0.8
    """Time from blow to blow [s]."""
    pre_trigger: float = 0.02
    """About how long before a blow its samples begin [s]."""
    signal_to_noise: float = 100.0
    """Rms of the response to a blow over the rms of the noise [1]."""
    repeats: int = 10
    """How often each corner of the workspace is gone to."""


def stream(seed: int, what: int) -> np.random.Generator:
    """Return the generator of one kind of record."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2, what)))


def virtual_record(
    built: AsBuilt, channels: Mapping[str, tuple[Array, str]], time: Array, *, over: str = "time"
) -> Record:
    """Return a record that says of itself that it is virtual."""
    return Record(
        channels=tuple(Channel(name=n, values=v, unit=u) for n, (v, u) in channels.items()),
        time=time,
        source=f"virtual {built.stage.name}",
        notes=("virtual record: simulated, not measured", *built.notes),
        attributes={"origin": "virtual"},
        over="point" if over == "point" else "time",
    )


def motion_record(built: AsBuilt, laboratory: Laboratory, axis: str, *, seed: int = 0) -> Record:
    """Run an axis over its whole stroke in cycles, and read all six motions.

    The seed is that of what the sensors are off by, of their noise, and of the approaches.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.virtual.as_built import as_built
    >>> built = as_built(design("vgtu-piezo"), seed=1)
    >>> record = motion_record(built, Laboratory(), "x")
    >>> print(f"{np.ptp(record.channel('along').values) * 1e6:.1f} um")
    63.1 um
    """
    own = built.axis(axis)
    rng = stream(seed, 10 + [a.name for a in built.axes].index(axis))
    lab = laboratory
    size = lab.cycles * lab.samples + 1
    time = np.arange(size) / lab.sample_rate_hz
    command = np.append(np.tile(own.cycle(lab.samples), lab.cycles), own.command_range[0])
    position = own.position(command)
    cycle = np.minimum(np.arange(size) // lab.samples, lab.cycles - 1)
    approach = own.repeatability * rng.standard_normal(lab.cycles)
    position = position + approach[cycle]
    channels = {
        "command": (command, own.command_unit),
        "along": (_read(lab.position, position, 0.0, time, rng), "m"),
    }
    for motion in MOTIONS:
        sensor = lab.angle if motion in ANGLES else lab.transverse
        beside = 0.0 if motion in ANGLES else position
        truth = own.guide.at(position, motion)
        channels[motion] = (_read(sensor, truth, beside, time, rng), sensor.unit)
    return virtual_record(built, channels, time)


def _read(
    sensor: SimulatedSensor,
    truth: Array,
    along: Array | float,
    time: Array,
    rng: np.random.Generator,
) -> Array:
    clean = drawn(sensor, rng).read(truth, along, time)
    return clean + sensor.noise_rms * rng.standard_normal(clean.size)


def hold_record(built: AsBuilt, laboratory: Laboratory, axis: str, *, seed: int = 0) -> Record:
    """Hold an axis in the middle of its stroke, and read it."""
    own = built.axis(axis)
    rng = stream(seed, 20 + [a.name for a in built.axes].index(axis))
    time = np.arange(laboratory.hold) / laboratory.sample_rate_hz
    held = np.full(time.size, 0.5 * own.stroke)
    reading = _read(laboratory.position, held, 0.0, time, rng)
    return virtual_record(built, {"along": (reading, "m")}, time)


def staircase_record(built: AsBuilt, laboratory: Laboratory, axis: str, *, seed: int = 0) -> Record:
    """Climb a staircase of small steps from the middle of the stroke, and read the position.

    The steps are some times the noise, or the smallest step of the drive.
    """
    own = built.axis(axis)
    lab = laboratory
    rng = stream(seed, 30 + [a.name for a in built.axes].index(axis))
    low, high = own.command_range
    step = own.smallest_step or _STEP_OVER_NOISE * lab.position.noise_rms
    level = np.repeat(np.arange(lab.levels, dtype=np.float64), lab.per_level)
    time = np.arange(level.size) / lab.sample_rate_hz
    rise = step / own.stroke * (high - low)
    command = 0.5 * (low + high) + rise * level
    # from the low end up, so that every step goes on in the same direction
    position = own.position(np.concatenate((np.linspace(low, command[0], 50), command)))[50:]
    reading = _read(lab.position, position, 0.0, time, rng)
    return virtual_record(
        built, {"command": (command, own.command_unit), "along": (reading, "m")}, time
    )


def workspace_record(
    built: AsBuilt, laboratory: Laboratory, axes: str = "", *, seed: int = 0
) -> Record:
    """Go to the four corners of the workspace again and again, and read x and y.

    Corners are numbered from 0 and anticlockwise; there is one workspace, whatever it is called.
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
    # corners are gone to in turn: drift of the sensors counts by the point
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
    """Probe the spheres of a plate on the platform at stations along the stroke, there and back.

    The columns are the command, and ``SPH1.X`` to ``SPH5.Z``, a row for each station; `noise` is
    the standard deviation of each coordinate of a centre [m]. Of the laboratory, the number of
    cycles and the calibration of the machine's scales count.
    """
    own = built.axis(axis)
    names = [a.name for a in built.axes]
    rng = stream(seed, 50 + names.index(axis))
    low, high = own.command_range
    run = np.linspace(low, high, stations)
    command = np.tile(np.concatenate((run, run[::-1])), laboratory.cycles)
    approach = own.repeatability * rng.standard_normal(laboratory.cycles)
    position = own.position(command) + np.repeat(approach, 2 * stations)
    # the second axis of a stage is clamped along the machine's Y, every other along its X
    x, y, z, roll, pitch, yaw = _pose(own, position, along_x=names.index(axis) != 1)
    gain = 1.0 + laboratory.position.calibration * rng.standard_normal(3)
    # the plate lies a little askew, which the rigid motion does not see
    spheres = _SPHERE_AT @ _rotation(*(2e-3 * rng.standard_normal(3))).T
    channels: dict[str, tuple[Array, str]] = {"command": (command, own.command_unit)}
    centres = np.empty((command.size, len(spheres), 3))
    for k in range(command.size):
        turned = spheres @ _rotation(roll[k], pitch[k], yaw[k]).T
        centres[k] = gain * (turned + np.array((x[k], y[k], z[k])))
    centres += noise * rng.standard_normal(centres.shape)
    for i, name in enumerate(SPHERES):
        for j, letter in enumerate("XYZ"):
            channels[f"{name}.{letter}"] = (centres[:, i, j], "m")
    return virtual_record(built, channels, np.arange(command.size, dtype=np.float64), over="point")


def _pose(own: AsBuiltAxis, position: Array, *, along_x: bool) -> tuple[Array, ...]:
    """Displacement x, y, z and rotations about x, y, z."""
    e = {motion: own.guide.at(position, motion) for motion in MOTIONS}
    if along_x:
        return position, e["across"], e["vertical"], e["roll"], e["pitch"], e["yaw"]
    return e["across"], position, e["vertical"], e["pitch"], e["roll"], e["yaw"]


def _rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation by a vector of angles about x, y, z."""
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
    """Return the record that a kind of test gives of an axis, or of both for a workspace."""
    return _RECORDS[kind](built, laboratory, axis, seed=seed)


class HammerBench:
    """A virtual stage struck by a hammer at its platform, drives removed.

    Force and acceleration belong together as of the continuous system: the response is that of all
    its modes, up to half the sample rate.
    """

    def __init__(self, built: AsBuilt, laboratory: Laboratory) -> None:
        self._built = built
        self._laboratory = laboratory
        self._block = int(laboratory.hammer_rate_hz * laboratory.hammer_time)
        found = modes(built.system, drives="removed", count=None)
        f = np.fft.rfftfreq(self._block, 1.0 / laboratory.hammer_rate_hz)
        omega = 2.0 * np.pi * f[:, None]
        own = found.omega[None, :]
        dynamic = own**2 - omega**2 + 2j * found.damping_ratio[None, :] * own * omega
        self._response: dict[tuple[str, str], NDArray[np.complex128]] = {}
        for struck in built.system.axes:
            for read in built.system.axes:
                weight = (built.system.probe(struck.probe).vector @ found.shapes) * (
                    built.system.probe(read.probe).vector @ found.shapes
                )
                value = np.sum(weight / dynamic, axis=1) * -(omega[:, 0] ** 2)
                self._response[struck.name, read.name] = value

    def record(self, axis: str, *, seed: int = 0) -> Record:
        """Strike along an axis; returned are force, and acceleration along every axis."""
        lab = self._laboratory
        names = [a.name for a in self._built.axes]
        rng = stream(seed, 60 + names.index(axis))
        rest = np.zeros(1024)  # after the last blow has decayed
        time = np.arange(lab.hits * self._block + rest.size) / lab.hammer_rate_hz
        force = np.zeros((lab.hits, self._block))
        local = np.arange(self._block) / lab.hammer_rate_hz
        for k in range(lab.hits):
            height = lab.blow_force * (1.0 + 0.2 * rng.standard_normal())
            since = local - lab.pre_trigger * (1.0 + 0.3 * rng.random())
            inside = (since > 0.0) & (since < lab.blow)
            force[k, inside] = height * np.sin(np.pi * since[inside] / lab.blow)
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
        pressed = np.append(force, rest)
        pressed = pressed + 1e-4 * lab.blow_force * rng.standard_normal(pressed.size)
        channels["force"] = (pressed, "N")
        for name in names:
            reading = clean[name] + noise * rng.standard_normal(time.size)
            channels[f"acceleration {name}"] = (reading, "m/s^2")
        return virtual_record(self._built, channels, time)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Blow:
    """One blow of a hammer on the platform, the drives taken out."""

    time: Array
    """Times [s], shape (n,)."""
    force: Array
    """Force of the hammer [N], shape (n,)."""
    response: Array
    """Acceleration of the platform along the axis that was struck [m/s^2], shape (n,)."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""


class Hammer:
    """A hammer with a force sensor, and an accelerometer on the platform."""

    def __init__(self, built: AsBuilt, seed: int) -> None:
        self._bench = HammerBench(built, Laboratory(hits=1))
        self._axes = [a.name for a in built.axes]
        self._seed, self._struck = seed, 0

    def strike(self, axis: str) -> Blow:
        """Strike once along an axis; the next blow differs from it."""
        if axis not in self._axes:
            raise ModelError(has_no("the stage", "axis", axis, self._axes))
        # each blow has a seed of its own, far from those of other stages
        record = self._bench.record(axis, seed=1_000_003 * (self._seed + 1) + self._struck)
        self._struck += 1
        time = record.time
        return Blow(
            time=time,
            force=record.channel("force").values,
            response=record.channel(f"acceleration {axis}").values,
            sample_rate_hz=float(1.0 / (time[1] - time[0])),
        )

    def reset(self) -> None:
        """Begin with the first blow again."""
        self._struck = 0
