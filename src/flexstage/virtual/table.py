"""A virtual rotary table: axis motion, scale errors, noisy heads, and the stage on it."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.centring.calibration import (
    ScaleReadings,
    against_reference,
    self_calibration,
)
from flexstage.centring.eccentricity import HeadReadings, eccentricity
from flexstage.centring.geometry import ScaleKind, exact_error
from flexstage.centring.move import Positioner, PositionerAxis
from flexstage.centring.procedure import CentreReading, centre_reading, table_reading
from flexstage.centring.table_file import RotaryTable
from flexstage.centring.turns import whole_orders
from flexstage.records import Channel, Record
from flexstage.stage import PiezoStack, Screw, Stage
from flexstage.stage.assumptions import (
    ASYNCHRONOUS_ORDERS,
    CONVERTER_BITS,
    POSITION_NOISE,
    SETTLING,
    VOLTAGE_RANGE,
)
from flexstage.system.servo import ServoSettings
from flexstage.virtual.as_built import loop_share, platform_stroke
from flexstage.virtual.imperfections import require_size
from flexstage.virtual.sensors import (
    ChannelDescription,
    Disturbances,
    SensorBench,
    SimulatedSensor,
)
from flexstage.virtual.stack import virtual_stack
from flexstage.virtual.stage import StageSamples, VirtualStage

if TYPE_CHECKING:
    from flexstage.hysteresis import HysteresisModel


#: Deviation of the slope of a move from that of the full loop, over the loop width [1].
_SLOPE_SPREAD = 1.6


class VirtualAxis(PositionerAxis):
    """A simulated axis, moved from command to command.

    The motion of a piezo axis is proportional to the free displacement of its `stack` over the
    range of `voltage`; without a stack the axis follows its commands.
    """

    def __init__(
        self,
        name: str,
        stroke: float,
        quantum: float,
        resolution: float,
        *,
        stack: "HysteresisModel | None" = None,
        voltage: tuple[float, float] = VOLTAGE_RANGE,
        backlash: float = 0.0,
        hysteresis: float = 0.0,
    ) -> None:
        if not 0.0 < stroke < math.inf:
            raise ModelError(f"the stroke of axis '{name}' must be positive, got {stroke!r} m")
        if not (0.0 <= quantum < stroke and 0.0 <= backlash < stroke):
            raise ModelError(
                f"step and backlash of axis '{name}' must be 0 or more and less than its stroke, "
                f"got {quantum!r} and {backlash!r} m"
            )
        super().__init__(
            name=name,
            half=0.5 * stroke,
            quantum=quantum,
            resolution=resolution,
            hysteresis=hysteresis,
            backlash=backlash,
        )
        self._stack = stack
        self._voltage = voltage
        self._play = 0.0
        if stack is not None:
            low, high = voltage
            # conditioned by two full cycles; it comes to rest at the low end
            before = stack.simulate([high, low, high, low])
            self._state = before.state
            ends = before.values[2:]
            self._zero, self._gain = float(ends.mean()), stroke / float(ends[0] - ends[1])

    def move(self, command: float) -> float:
        """Move to a command within range on a straight ramp; return the displacement [m]."""
        if self._stack is None:
            half = 0.5 * self.backlash
            self._play = max(command - half, min(command + half, self._play))
            return self._play
        low, high = self._voltage
        volts = 0.5 * (low + high) + 0.5 * (high - low) * command / self.half
        self._state, free = self._stack.step(self._state, volts)
        return self._gain * (free - self._zero)


def _open_loop_axis(
    stage: Stage, axis: str, quantum: float | None, backlash: float, noise: float
) -> VirtualAxis:
    """Return an axis in open loop: commanded by its drive, without a sensor."""
    drive = stage.drive_of(axis)
    stroke = _stroke(stage, axis)
    if isinstance(drive, Screw):
        step = drive.smallest_step * stroke / drive.travel if quantum is None else quantum
        return VirtualAxis(axis, stroke, step, noise, backlash=backlash)
    if not isinstance(drive, PiezoStack):
        raise ModelError(
            f"axis '{axis}' of {stage.name} must be driven by a screw or a piezo stack to be "
            f"simulated, got {drive.kind}"
        )
    if backlash:
        raise ModelError("a piezo stack has no backlash: omit the backlash")
    share = loop_share(stage, axis, stroke)
    voltage = VOLTAGE_RANGE if drive.voltage_range is None else drive.voltage_range
    return VirtualAxis(
        axis,
        stroke,
        stroke / 2**CONVERTER_BITS if quantum is None else quantum,
        noise,
        stack=virtual_stack(voltage, drive.free_stroke, share),
        voltage=voltage,
        hysteresis=_SLOPE_SPREAD * share,
    )


def _stroke(stage: Stage, axis: str) -> float:
    stroke = platform_stroke(stage, axis)
    if stroke is None:
        raise ModelError(
            f"the drive of axis '{axis}' of {stage.name} has no stroke: give one to simulate it"
        )
    return stroke


@dataclass(frozen=True, slots=True, kw_only=True)
class TableMounting:
    """Mounting of a stage on the table, and squareness of its axes."""

    angle: float = 0.0
    """Angle of the stage on the table, mu [rad]."""
    mirrored: bool = False
    """With its y axis reversed."""
    squareness: float = 0.0
    """Squareness error: 90 degrees less the angle between the axes, sigma [rad]."""
    cross_coupling: tuple[float, float] = (0.0, 0.0)
    """Motion in y per motion of the x drive, c_yx, and in x per motion of the y drive, c_xy [1]."""

    @property
    def matrix(self) -> Array:
        """Motion of the scale for that of the axes, shape (2, 2)."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        axes = np.array(
            [
                [1.0, math.sin(self.squareness) + self.cross_coupling[1]],
                [self.cross_coupling[0], math.cos(self.squareness)],
            ]
        )
        sign = np.diag([1.0, -1.0 if self.mirrored else 1.0])
        return np.array([[c, -s], [s, c]]) @ sign @ axes


class VirtualPositioner(Positioner):
    r"""A simulated stage on the table: stroke, hysteresis, steps and mounting.

    A command is in metres from the middle of the stroke. The axes answer one by one,
    (a, b) = (f_x(x), f_y(y)), and carry the scale by

    .. math:: p = R(\mu) \begin{pmatrix} 1 & 0 \\ 0 & \pm 1 \end{pmatrix}
              \left(\begin{pmatrix} 1 & \sin\sigma \\ 0 & \cos\sigma \end{pmatrix}
              + \begin{pmatrix} 0 & c_{xy} \\ c_{yx} & 0 \end{pmatrix}\right)
              \begin{pmatrix} a \\ b \end{pmatrix}

    in the frame that turns with the table.

    Parameters
    ----------
    stage : Stage
        The stage, with two axes. Strokes and loop widths are published measured values where there
        are any, else strokes of the lumped model and usual widths.
    mode : {"open loop", "closed loop"}
        Without or with position control of each axis.
    start : tuple of float
        First position of the axes, as shares of half the stroke from -1 to 1.
    mounting : TableMounting
        Mounting on the table, and squareness of the axes.
    noise : float
        Standard deviation of the position after settling [m].
    sensor_noise : float
        Standard deviation of a sensor reading after settling [m], in closed loop.
    quantum : float, optional
        Step of the commands [m]; by default that of a 16-bit converter over the stroke, or the
        smallest step of a screw times the ratio.
    backlash : float
        Backlash of a screw, at the scale [m].
    seed : int
        Seed of the noise.

    Validity
    --------
    Quasi-static: each command is held until creep and drift have decayed. Hysteresis of the axes is
    independent, and a sensor of the closed loop is linear. This is a simulation, not a measurement.

    Raises
    ------
    ModelError
        The stage does not have two axes, an axis has no stroke, or a value is out of range.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> stage = VirtualPositioner(design("vgtu-piezo"), mounting=TableMounting(angle=0.4))
    >>> low, high = stage.limits[0]
    >>> print(f"{1e6 * (high - low):.2f} um")
    63.12 um
    >>> before = stage.true_position
    >>> _ = stage.move_to(10e-6, 0.0)
    >>> print(f"{1e6 * np.hypot(*(stage.true_position - before)):.1f} um")
    10.9 um
    """

    def __init__(
        self,
        stage: Stage,
        *,
        mode: Literal["open loop", "closed loop"] = "open loop",
        start: tuple[float, float] = (0.0, 0.0),
        mounting: TableMounting = TableMounting(),
        noise: float = SETTLING,
        sensor_noise: float = POSITION_NOISE,
        quantum: float | None = None,
        backlash: float = 0.0,
        seed: int = 0,
    ) -> None:
        if mode not in ("open loop", "closed loop"):
            raise ModelError(f"the mode must be 'open loop' or 'closed loop', got '{mode}'")
        if len(stage.axes) != 2:
            raise ModelError(
                f"stage '{stage.name}' must have two axes to centre a scale, got {len(stage.axes)}"
            )
        for what, value in (("noise", noise), ("sensor noise", sensor_noise)):
            require_size(f"the {what}", value)
        if any(not -1.0 <= share <= 1.0 for share in start):
            raise ModelError(f"the start must be shares of the stroke from -1 to 1, got {start!r}")
        if mode == "open loop":
            self._axes = [
                _open_loop_axis(stage, a.name, quantum, backlash, noise) for a in stage.axes
            ]
        else:
            # under position control the axes follow their commands
            self._axes = []
            for axis in stage.axes:
                stroke = _stroke(stage, axis.name)
                step = stroke / 2**CONVERTER_BITS if quantum is None else quantum
                spread = math.hypot(noise, sensor_noise)
                self._axes.append(VirtualAxis(axis.name, stroke, step, spread))
        super().__init__(self._axes)
        self._matrix = mounting.matrix
        self._random = np.random.default_rng(seed)
        self.name = f"virtual {stage.name}, {mode}"
        self.move_to(*(share * axis.half for share, axis in zip(start, self._axes, strict=True)))

    @property
    def matrix(self) -> Array:
        """True motion of the scale for that of the axes, unknown to the centring, shape (2, 2)."""
        return self._matrix.copy()

    @property
    def true_position(self) -> Array:
        """True position of the scale, unknown to the centring: x, y on table [m], shape (2,)."""
        return self._true.copy()

    def move_to(self, x: float, y: float) -> tuple[float, float]:
        for axis, u in zip(self._axes, (x, y), strict=True):
            if not abs(u) <= axis.half * (1.0 + 1e-9):
                raise ModelError(
                    f"the command of axis '{axis.name}' must be within {-axis.half:.4g} and "
                    f"{axis.half:.4g} m, got {u!r}"
                )
        return super().move_to(x, y)

    def _go(self, command: tuple[float, float]) -> None:
        reached = [
            axis.move(u) + axis.resolution * self._random.standard_normal()
            for axis, u in zip(self._axes, command, strict=True)
        ]
        self._true: Array = self._matrix @ np.asarray(reached)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScaleErrors:
    r"""Graduation errors of a scale, :math:`g(s) = \sum_n a_n \cos n s + b_n \sin n s`."""

    orders: tuple[int, ...] = ()
    """Orders n."""
    cosine: Array = field(default_factory=lambda: np.zeros(0))
    """Amplitudes a of the cosines [rad], shape (n,)."""
    sine: Array = field(default_factory=lambda: np.zeros(0))
    """Amplitudes b of the sines [rad], shape (n,)."""

    def __post_init__(self) -> None:
        if not self.cosine.shape == self.sine.shape == (len(self.orders),):
            raise ModelError(
                f"the errors of a scale need a cosine and a sine for each of {len(self.orders)} "
                f"orders, got {self.cosine.size} and {self.sine.size}"
            )

    def at(self, angle: ArrayLike) -> Array:
        """Return the errors at lines of the scale [rad]: reading minus angle."""
        s = np.asarray(angle, dtype=np.float64)
        out = np.zeros_like(s)
        for n, a, b in zip(self.orders, self.cosine, self.sine, strict=True):
            out += a * np.cos(n * s) + b * np.sin(n * s)
        return out


def scale_errors(orders: Iterable[int], rms: float, *, seed: int = 0) -> ScaleErrors:
    """Return random graduation errors of a scale, smaller at higher orders.

    Parameters
    ----------
    orders : iterable of int
        Orders of the errors.
    rms : float
        Root mean square over a turn [rad].
    seed : int
        Seed of amplitudes and phases.

    Returns
    -------
    ScaleErrors
        The errors.

    Validity
    --------
    Synthetic: normal amplitudes that fall as one over the order.

    Raises
    ------
    ModelError
        The rms is negative or not finite.

    Examples
    --------
    >>> errors = scale_errors(range(2, 30), 5e-6, seed=3)
    >>> s = 2.0 * np.pi * np.arange(1000) / 1000
    >>> print(f"{1e6 * np.std(errors.at(s)):.3f} urad")
    5.000 urad
    """
    require_size("the errors of a scale", rms)
    numbers = whole_orders(orders)
    random = np.random.default_rng(seed)
    parts = random.standard_normal((2, len(numbers))) / np.asarray(numbers, dtype=np.float64)
    parts *= rms / math.sqrt(0.5 * float(np.sum(parts**2)))
    return ScaleErrors(orders=numbers, cosine=parts[0], sine=parts[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VirtualTable:
    r"""A rotary table with a scale and heads on it, simulated by its exact geometry.

    Head j at the angle alpha_j reads the line s = theta + alpha_j + d_j, where d_j is the exact
    error of the eccentric scale. Its error is d_j + g(s) plus noise.

    Raises
    ------
    ModelError
        Values do not fit one another, or one is out of range.

    Examples
    --------
    >>> table = VirtualTable(radius=50e-3, heads=(0.0,), eccentricity=(50e-6, 0.0), noise=0.0)
    >>> error = table.record().channel("head 1").values
    >>> print(f"{np.degrees(np.ptp(error)) * 1800.0:.2f} arcsec")
    206.26 arcsec
    """

    radius: float
    """Reading radius of the scale [m]."""
    heads: tuple[float, ...] = (0.0,)
    """Nominal angles of the heads [rad]."""
    eccentricity: tuple[float, float] = (0.0, 0.0)
    """Centre of the scale with the stage in the middle of its stroke, x and y in the frame that
    turns with the table [m].
    """
    noise: float = 0.0
    """Standard deviation of each reading [rad]."""
    head_angle_errors: tuple[float, ...] = ()
    """Angle error of each head [rad]; empty for none."""
    head_radius_errors: tuple[float, ...] = ()
    """Radius error of each head [m]; empty for none."""
    scale: ScaleErrors = field(default_factory=ScaleErrors)
    """Graduation errors of the scale."""
    kind: ScaleKind = "disc"
    """Kind of scale."""
    ellipticity: float = 0.0
    """Relative elongation of the scale in one direction, and contraction across it [1]."""
    ellipticity_direction: float = 0.0
    """Direction of the elongation in the scale [rad]."""
    axis_orders: tuple[int, ...] = ()
    """Orders of the synchronous motion of the axis, 1 or more."""
    axis_motion: Array = field(default_factory=lambda: np.zeros((0, 4)))
    """Amplitudes of the synchronous motion: cosine and sine in x, then in y [m], shape (n, 4)."""
    asynchronous: float = 0.0
    """Root mean square of the asynchronous motion of the axis, in each direction [m]."""
    reference_noise: float = 0.0
    """Standard deviation of the angle reference, or of the table position without a reference;
    common to all heads [rad].
    """
    samples: int = 360
    """Samples per turn."""
    turns: int = 1
    """Number of turns."""
    start: float = 0.0
    """Angle of the first sample [rad]."""
    seed: int = 0
    """Seed of all random numbers."""

    def __post_init__(self) -> None:
        if not self.heads:
            raise ModelError("a table needs at least one head")
        for name in ("head_angle_errors", "head_radius_errors"):
            values = getattr(self, name)
            if values and len(values) != len(self.heads):
                raise ModelError(
                    f"{name} must have one value for each of {len(self.heads)} heads, "
                    f"got {len(values)}"
                )
        for name in ("noise", "asynchronous", "reference_noise"):
            require_size(name, getattr(self, name))
        if self.axis_motion.shape != (len(self.axis_orders), 4):
            raise ModelError(
                f"the motion of the axis needs four amplitudes for each of {len(self.axis_orders)} "
                f"orders, got shape {self.axis_motion.shape}"
            )
        if self.samples < 3 or self.turns < 1:
            raise ModelError(
                f"a record needs at least 3 samples per turn and 1 turn, got {self.samples} and "
                f"{self.turns}"
            )

    @classmethod
    def described(cls, table: RotaryTable, *, direction: float = 0.0, seed: int = 0) -> Self:
        """Return a described table with its largest eccentricity in a direction [rad].

        The angles of the heads are off by their uncertainty, and errors of the lines have phases,
        by the seed. The synchronous motion is along x, twice per turn. Tilt of scale and axis, and
        the error within a period of the signal, are not simulated.
        """
        scale, heads, axis = table.scale, table.heads, table.axis
        rng = np.random.default_rng(seed)
        phases = rng.uniform(0.0, 2.0 * np.pi, len(scale.graduation))
        amplitudes = np.array([line.amplitude for line in scale.graduation])
        off = rng.normal(0.0, heads.angle_uncertainty, len(heads.angles))
        return cls(
            radius=scale.radius,
            heads=heads.angles,
            eccentricity=(
                scale.eccentricity * math.cos(direction),
                scale.eccentricity * math.sin(direction),
            ),
            noise=heads.noise,
            head_angle_errors=tuple(off),
            scale=ScaleErrors(
                orders=tuple(line.order for line in scale.graduation),
                cosine=amplitudes * np.cos(phases),
                sine=amplitudes * np.sin(phases),
            ),
            kind=scale.kind,
            ellipticity=scale.ellipticity / scale.radius,
            axis_orders=(2,),
            axis_motion=np.array([[0.5 * axis.radial_synchronous, 0.0, 0.0, 0.0]]),
            # anywhere within its range
            asynchronous=0.5 * axis.radial_asynchronous / math.sqrt(3.0),
            turns=2,
            seed=seed,
        )

    @property
    def apparent_eccentricity(self) -> Array:
        """Eccentricity with the scale errors of order 1, x and y [m], shape (2,).

        To first order heads cannot separate the two: b sin s and a cos s act like an eccentricity
        of R b in x and -R a in y.
        """
        e = np.array(self.eccentricity, dtype=np.float64)
        for n, a, b in zip(self.scale.orders, self.scale.cosine, self.scale.sine, strict=True):
            if n == 1:
                e += self.radius * np.array([b, -a])
        return e

    def moved(self, x: float, y: float) -> "VirtualTable":
        """Return the same table with the scale moved.

        Parameters
        ----------
        x, y : float
            Displacement of the scale [m].

        Returns
        -------
        VirtualTable
            The table.
        """
        return replace(self, eccentricity=(self.eccentricity[0] + x, self.eccentricity[1] + y))

    def record(self, *, index: int = 0) -> Record:
        """Turn the table and return the readings of the heads.

        Parameters
        ----------
        index : int
            Number of the measurement; each has different noise.

        Returns
        -------
        Record
            Columns ``angle`` of the reference [rad] and ``head 1``..., reading minus angle [rad],
            over points.
        """
        random = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(index,)))
        count = self.samples * self.turns
        nominal = self.start + 2.0 * np.pi * np.arange(count) / self.samples
        offset = self.reference_noise * random.standard_normal(count)
        theta = nominal + offset
        motion = self._motion(theta, random)
        columns = [Channel(name="angle", values=nominal, unit="rad")]
        for j, error in enumerate(self._errors(theta, self.eccentricity, motion), start=1):
            noise = self.noise * random.standard_normal(count)
            columns.append(Channel(name=f"head {j}", values=error + offset + noise, unit="rad"))
        return Record(
            channels=tuple(columns),
            time=np.arange(count, dtype=np.float64),
            source="virtual table",
            notes=("simulated with the exact geometry of a table with a scale, not measured",),
            attributes={"seed": str(self.seed), "index": str(index)},
            over="point",
        )

    def _errors(self, theta: Array, eccentricity: ArrayLike, motion: Array) -> Iterator[Array]:
        """Yield the error of each head without noise [rad], shape (k,)."""
        for j, alpha in enumerate(self.heads):
            at = alpha + (self.head_angle_errors[j] if self.head_angle_errors else 0.0)
            out = self.head_radius_errors[j] if self.head_radius_errors else 0.0
            d = exact_error(
                theta,
                eccentricity,
                self.radius + out,
                head_angle=at,
                kind=self.kind,
                axis_motion=motion,
                ellipticity=(self.ellipticity, self.ellipticity_direction),
            )
            yield d + self.scale.at(theta + at + d)

    def _motion(self, theta: Array, random: np.random.Generator) -> Array:
        """Return the motion of the axis [m], shape (k, 2)."""
        motion = np.zeros((theta.size, 2))
        for n, (cx, sx, cy, sy) in zip(self.axis_orders, self.axis_motion, strict=True):
            c, s = np.cos(n * theta), np.sin(n * theta)
            motion += np.stack((cx * c + sx * s, cy * c + sy * s), axis=1)
        if self.asynchronous:
            share = self.asynchronous * math.sqrt(2.0 / len(ASYNCHRONOUS_ORDERS))
            for n in ASYNCHRONOUS_ORDERS:
                phase = random.uniform(0.0, 2.0 * np.pi, 2)
                motion += share * np.sin(n * theta[:, np.newaxis] + phase)
        return motion


#: Keys of the random streams of a turning table: direction of its scale, motion, noise.
_DIRECTION, _MOTION, _NOISE = 0, 1, 2


class StageOnTable(VirtualStage):
    """A virtual stage with the described scale on it, on a rotary table that turns.

    Its further sensors are ``angle``, that of the table, and ``head 1`` and so on, the angle that
    each head reads; all from 0 to a turn. The platform carries the scale: its position from the
    middle of its range is added to the eccentricity of the mounting, which has the described size
    and a random direction.

    Notes
    -----
    Validity: that of `VirtualTable.described`; the table turns at its highest speed from time 0,
    without variation, and its angle is known without error.
    """

    def __init__(self, stage: VirtualStage, table: RotaryTable) -> None:
        super().__init__(stage.stage, stage.limits, stage.conditions)
        if len(stage.axes) != 2:
            raise ModelError(
                f"stage '{stage.stage.name}' must have two axes to carry the scale of a table, "
                f"got {len(stage.axes)}"
            )
        self.kind, self.platform_ratio, self._carrier = stage.kind, stage.platform_ratio, stage
        self._speed = table.axis.speed
        self._matrix = TableMounting(angle=table.mounting_angle).matrix
        direction = float(self._stream(_DIRECTION).uniform(-math.pi, math.pi))
        self._table = VirtualTable.described(table, direction=direction, seed=self.conditions.seed)
        ends = np.array([stage.limits[axis].position or (0.0, 0.0) for axis in stage.axes])
        #: Middle of the range of the platform [m], shape (2, 1).
        self._middle = (ends.mean(axis=1) * stage.platform_ratio)[:, None]
        names = ("angle", *(f"head {j}" for j in range(1, len(self._table.heads) + 1)))
        self.channels = (
            *self.channels,
            *(
                ChannelDescription(number=i, name=name, unit="rad")
                for i, name in enumerate(names, start=len(self.channels) + 1)
            ),
        )
        self._reset_heads()

    def servo_settings(self, axis: str) -> ServoSettings:
        return self._carrier.servo_settings(axis)

    def set_servo_settings(self, axis: str, settings: ServoSettings) -> None:
        self._carrier.set_servo_settings(axis, settings)

    def run(
        self, command: Array, servo: Sequence[bool], feedforward: Array | None = None
    ) -> StageSamples:
        block = self._carrier.run(command, servo, feedforward)
        size = block.time.size
        theta = self._speed * block.time
        carried = self._matrix @ (block.position - self._middle)
        centre = np.array(self._table.eccentricity) + carried.T
        motion = self._table._motion(theta, self._stream(_MOTION))
        noise = self._noise.take(self._count, size)[1]
        self._count += size
        errors = np.stack(list(self._table._errors(theta, centre, motion))) + noise
        angles = np.concatenate((theta[None], theta + errors)) % (2.0 * math.pi)
        return replace(block, reading=np.concatenate((block.reading, angles)))

    def reset(self) -> None:
        """Relax the stage, and start the table again."""
        self._carrier.reset()
        self._reset_heads()

    def _reset_heads(self) -> None:
        self._count = 0
        head = SimulatedSensor(noise_rms=self._table.noise, unit="rad")
        bench = SensorBench(angle=head, drift_rate=0.0)
        seed = int(self._stream(_NOISE).integers(2**63))
        self._noise = Disturbances(
            ["angle"] * len(self._table.heads), bench, self.sample_rate_hz, seed,
            quiet=self.conditions.quiet,
        )  # fmt: skip

    def _stream(self, key: int) -> np.random.Generator:
        seed = np.random.SeedSequence(self.conditions.seed, spawn_key=(10, key))
        return np.random.default_rng(seed)


class Carrier(Protocol):
    """A simulated or real stage on a virtual table that carries the scale."""

    @property
    def true_position(self) -> Array:
        """Displacement of the scale, x and y on the table [m], shape (2,)."""
        ...


class VirtualBench:
    """A simulated table with a stage on it that carries the scale.

    Parameters
    ----------
    table : VirtualTable
        The table, with the eccentricity of the scale for the stage in the middle of its stroke.
    stage : Carrier
        The stage, such as a `flexstage.virtual.VirtualPositioner`.
    method : {"reference", "heads alone", "eccentricity"}
        Evaluation of the readings: against the angle reference, by
        `flexstage.centring.calibration.against_reference`; against one another, with two heads or
        more; or by `flexstage.centring.eccentricity.eccentricity`, which also looks for outliers
        and correlated noise and takes longer.
    orders : iterable of int
        Orders of the errors that are solved for in addition to the eccentricity.

    Raises
    ------
    RecordError
        Method "heads alone" with one head, or an unknown method.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.virtual import VirtualPositioner
    >>> stage = VirtualPositioner(design("vgtu-mechanical"))
    >>> table = VirtualTable(radius=50e-3, eccentricity=(30e-6, 40e-6), noise=5e-6)
    >>> print(f"{1e6 * VirtualBench(table, stage).measure().length.value:.2f} um")
    49.98 um
    """

    def __init__(
        self,
        table: VirtualTable,
        stage: Carrier,
        *,
        method: Literal["reference", "heads alone", "eccentricity"] = "reference",
        orders: Iterable[int] = range(1, 25),
    ) -> None:
        if method not in ("reference", "heads alone", "eccentricity"):
            raise RecordError(
                f"the method must be 'reference', 'heads alone' or 'eccentricity', got '{method}'"
            )
        if method == "heads alone" and len(table.heads) < 2:
            raise RecordError("method 'heads alone' needs two heads or more, got 1")
        self._table, self._stage = table, stage
        self._orders = tuple(orders)
        self._method = method
        #: Length of the true eccentricity at each measurement [m].
        self.true_lengths: list[float] = []

    @property
    def true_eccentricity(self) -> Array:
        """True apparent eccentricity [m], shape (2,), with the scale errors of order 1."""
        return self._table.apparent_eccentricity + self._stage.true_position

    def measure(self) -> CentreReading:
        """Turn the table and return the eccentricity of the scale."""
        x, y = self._stage.true_position
        table = self._table.moved(float(x), float(y))
        record = table.record(index=len(self.true_lengths))
        self.true_lengths.append(float(np.hypot(*table.apparent_eccentricity)))
        angle, *errors = (channel.values for channel in record.channels)
        heads = self._table.heads
        if self._method != "eccentricity":
            separate = against_reference if self._method == "reference" else self_calibration
            scale_readings = ScaleReadings(
                angle=angle, errors=np.stack(errors), heads=np.array(heads)
            )
            return table_reading(separate(scale_readings, self._orders), self._table.radius)
        readings = [
            HeadReadings(angle=angle, error=error, head_angle=alpha)
            for alpha, error in zip(heads, errors, strict=True)
        ]
        return centre_reading(
            eccentricity(
                readings, radius=self._table.radius, kind=self._table.kind, orders=self._orders
            )
        )
