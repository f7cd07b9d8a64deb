"""A simulated stage with piezo stacks and position control."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.choose import has_no
from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.modal import unit_step
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive
from flexstage.stage import Stage
from flexstage.stage.assumptions import LOOP_CONVERTER_BITS
from flexstage.stage.limits import AxisLimits
from flexstage.system import modes
from flexstage.system.environment import (
    BodyForce,
    DriveVoltage,
    GroundMotion,
    NoiseSource,
    SensorNoise,
)
from flexstage.system.servo import ServoSettings
from flexstage.virtual.imperfections import GuideErrors
from flexstage.virtual.laboratory import HammerImpact
from flexstage.virtual.piezo_loop import (
    DriveArrays,
    LoopSignals,
    LoopState,
    ModeArrays,
    SensorArrays,
    ServoArrays,
    ServoState,
    amplifier_of,
    run_loop,
)
from flexstage.virtual.sensors import (
    error_motion_sources,
    neighbour,
    polynomial,
    read_error_motions,
)
from flexstage.virtual.stack import ChargeDrive, VirtualStack, relaxed_stacks, stack_arrays
from flexstage.virtual.stage import Conditions, StageSamples, VirtualStage, commands


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PiezoAxis:
    """One axis of a manufactured piezo stage."""

    name: str
    """Name of the axis."""
    drive: str
    """Name of its drive in the system."""
    probe: str
    """Name of its probe in the system."""
    limits: AxisLimits
    """Limits of the commands; the voltage range is that of the converter."""
    guide: GuideErrors | None = None
    """Error motions of its guide; None for none."""
    low: float = 0.0
    """Position of the low end of its stroke [m], where the curves of the guide begin."""
    settings: ServoSettings = field(default_factory=ServoSettings)
    """Default settings of its servo."""


def _drive_arrays(model: DynamicModel, parts: Sequence[PiezoAxis], *, quiet: bool) -> DriveArrays:
    """Return converters and amplifiers as arrays for the loop."""
    rows = []
    for part in parts:
        if part.limits.voltage is None:
            raise ModelError(f"axis '{part.name}' needs a voltage range in its limits")
        low, high = part.limits.voltage
        resolution = 0.0 if quiet else (high - low) / (2**LOOP_CONVERTER_BITS - 1)
        amplifier = amplifier_of(model.drive(part.drive))
        tau = amplifier.time_constant
        rows.append((low, high, resolution, model.step / tau, amplifier.largest_rate * tau))
    return DriveArrays(*np.array(rows).T.copy())


def _mode_arrays(
    model: DynamicModel, parts: Sequence[PiezoAxis], sources: Sequence[NoiseSource]
) -> ModeArrays:
    """Return the modes as arrays for the loop, padded to a multiple of 4."""
    gains = [model.drive(p.drive).modal_gain for p in parts]
    if sources:
        shapes = modes(model.system, drives="in place", count=None).shapes
        gains += [source.force(model.system) @ shapes / model.omega**2 for source in sources]
    step = unit_step(model.omega * model.step, model.damping_ratio)
    # the loop adds them up by fours
    padding = ((0, 0), (0, -model.omega.size % 4))
    return ModeArrays(
        force=np.pad(np.array(gains), padding),
        transition=np.pad(step.transition, padding),
        moments=np.pad(step.moments[:3], padding),
        reader=np.pad(model.probe_shapes[[model.row(p.probe) for p in parts]], padding),
    )


def stack_of(drive: ModelDrive) -> VirtualStack:
    """Return the virtual stack of a drive after checking that it has one."""
    if not isinstance(drive.hysteresis, VirtualStack):
        raise ModelError(f"drive '{drive.name}' needs a virtual stack to run in a loop")
    return drive.hysteresis


#: Sources that move the stage itself.
_FORCES = (GroundMotion, BodyForce)
#: Largest number of filters of a servo.
_FILTERS = 8


class PiezoStage(VirtualStage):
    """A piezo stage sample by sample, a `VirtualStage`: its `DynamicModel` in a loop.

    Each command goes through a converter, which holds it (20 bit over the voltage range), and an
    amplifier of one pole and limited current, to a stack with hysteresis and creep, and to all
    modes of the stage with its stacks in place. Sensors add their errors.

    Notes
    -----
    Validity: small motion; voltage and free displacement are straight between samples, an error
    below 1e-4 of the stroke up to 50 Hz at 10 kHz. Hysteresis does not depend on the force of the
    stack, and its capacitance is constant. Guide errors depend on the position alone. The sensors
    across an axis read the motion along the other axis; those out of the plane and of rotations
    read the error motions of their own axis. The ground moves the base as a rigid body; sensors
    stand on the base.
    """

    kind = "piezo"

    def __init__(
        self,
        *,
        stage: Stage,
        model: DynamicModel,
        axes: Sequence[PiezoAxis],
        charge: ChargeDrive | None = None,
        conditions: Conditions,
    ) -> None:
        super().__init__(stage, {a.name: a.limits for a in axes}, conditions)
        #: The axes, and the dynamic model at the loop rate.
        self.parts, self.model = tuple(axes), replace(model, step=1.0 / self.sample_rate_hz)
        drives = [model.drive(part.drive) for part in self.parts]
        self._shaken_by = () if conditions.environment is None else conditions.environment.sources
        self._require_sources()
        self._moved = [k for k, s in enumerate(self._shaken_by) if isinstance(s, _FORCES)]
        self._modes = _mode_arrays(
            self.model, self.parts, [self._shaken_by[k] for k in self._moved]
        )
        self._stacks = stack_arrays(
            [stack_of(d) for d in drives], self.sample_rate_hz, creep=[d.creep for d in drives],
            charge=charge,
        )  # fmt: skip
        self._drives = _drive_arrays(self.model, self.parts, quiet=conditions.quiet)
        guides = {a.name: a.guide or GuideErrors(stroke=1.0, coefficients={}) for a in self.parts}
        self._source, self._rows = error_motion_sources(
            self.axes, guides, {a.name: a.low for a in self.parts}
        )
        self._guide_motion = self._guide_polynomials(guides)
        self._servo = ServoArrays(
            on=np.zeros(len(axes), dtype=np.bool_),
            begins=np.zeros(len(axes), dtype=np.bool_),
            gains=np.zeros((len(axes), 2)),
            filters=np.zeros(len(axes), dtype=np.int64),
            sections=np.zeros((len(axes), _FILTERS, 5)),
        )
        self._settings: dict[str, ServoSettings] = {}
        self.reset()

    def servo_settings(self, axis: str) -> ServoSettings:
        self._number(axis)
        return self._settings[axis]

    def set_servo_settings(self, axis: str, settings: ServoSettings) -> None:
        a = self._number(axis)
        sections = settings.sections(self.sample_rate_hz)
        if len(sections) > _FILTERS:
            raise ModelError(
                f"the servo of an axis has at most {_FILTERS} filters, got {len(sections)}"
            )
        if len(sections) != self._servo.filters[a]:
            self._state.servo.filters[a] = 0.0
        self._servo.filters[a] = len(sections)
        self._servo.sections[a, : len(sections)] = sections
        self._servo.gains[a] = settings.proportional, settings.integral / self.sample_rate_hz
        self._settings[axis] = settings

    def run(
        self, command: Array, servo: Sequence[bool], feedforward: Array | None = None
    ) -> StageSamples:
        axes = len(self.parts)
        command = commands(command, axes)
        n = command.shape[1]
        forward = np.full((axes, n), np.nan)
        if feedforward is not None:
            forward = np.array(feedforward, dtype=np.float64, order="C")
        on = np.array(servo, dtype=np.bool_)
        if forward.shape != command.shape or on.shape != (axes,):
            raise ModelError(
                f"a run of {axes} axes and {n} samples needs a feedforward of the same shape and "
                f"{axes} flags, got {forward.shape} and {on.shape}"
            )
        self._servo.begins[:] = self._servo.begins & on | on & ~self._servo.on
        self._servo.on[:] = on
        drift, noise = self._disturbances.take(self._count, n)
        hum, forced = self._source_signals(noise, n)
        reading = np.empty((len(self.channels), n))
        position, voltage, requested = (np.empty((axes, n)) for _ in range(3))
        run_loop(
            self._drives, self._stacks, self._stack_state, self._modes, self._sensors, self._servo,
            self._state,
            LoopSignals(
                command, forward, drift, noise, hum, forced, reading, position, voltage, requested
            ),
        )  # fmt: skip
        read_error_motions(
            self._source, self._rows, position, drift, noise, self._disturbances.gain,
            self._disturbances.step, reading,
        )  # fmt: skip
        time = (self._count + np.arange(n)) / self.sample_rate_hz
        self._count += n
        return StageSamples(
            time=time, reading=reading, position=position, voltage=voltage, command=requested
        )

    def _source_signals(self, noise: Array, count: int) -> tuple[Array, Array]:
        """Add noise of sensors; return noise of voltages, and sources that move the stage."""
        hum = np.zeros((len(self.parts), count))
        if self._shaking is None:
            return hum, np.zeros((0, count))
        for k, source in enumerate(self._shaken_by):
            for a, part in enumerate(self.parts):
                # every sensor has its own noise
                if isinstance(source, SensorNoise):
                    noise[a] += self._shaking.take(k, self._count, count, stream=a)
                elif isinstance(source, DriveVoltage) and source.drive == part.drive:
                    hum[a] += self._shaking.take(k, self._count, count)
        rows = [self._shaking.take(k, self._count, count) for k in self._moved]
        return hum, np.array(rows).reshape(-1, count)

    def _require_sources(self) -> None:
        for source in self._shaken_by:
            drives = [part.drive for part in self.parts]
            if isinstance(source, DriveVoltage) and source.drive not in drives:
                raise ModelError(has_no("the twin", "drive", source.drive, drives))
            if isinstance(source, SensorNoise) and source.spectrum.unit != "m":
                raise ModelError(
                    f"source '{source.name}' is noise in {source.spectrum.unit}, but the sensors "
                    "of the axes of a twin read m: convert it"
                )

    def strike(self, axis: str) -> HammerImpact:
        self._number(axis)
        return super().strike(axis)

    def reset(self) -> None:
        """Relax the stage: time 0, no history, default settings."""
        axes = len(self.parts)
        self._count = 0
        self._disturbances = self.conditions.disturbances(self.channels)
        self._sensors = SensorArrays(
            guide=self._guide_motion,
            gain=self._disturbances.gain[:axes].copy(),
            resolution=float(self._disturbances.step[0]),
        )
        self._stack_state = relaxed_stacks(self._stacks)
        self._shaking = self.conditions.shaking()
        self._state = LoopState(
            *np.zeros((4, axes)),
            free=np.zeros(axes + len(self._moved)),
            modes=np.zeros((3, self._modes.force.shape[1])),
            servo=ServoState(
                integral=np.zeros(axes),
                feedforward=np.full(axes, np.nan),
                filters=np.zeros((axes, _FILTERS, 2)),
            ),
        )
        self._servo.on[:] = False
        self._servo.begins[:] = False
        for part in self.parts:
            self.set_servo_settings(part.name, part.settings)
        if self.conditions.hammer is not None:
            self.conditions.hammer.reset()

    def _part(self, axis: str) -> PiezoAxis:
        return self.parts[self._number(axis)]

    def _number(self, axis: str) -> int:
        if axis not in self.axes:
            raise ModelError(has_no("the stage", "axis", axis, self.axes))
        return self.axes.index(axis)

    def _guide_polynomials(self, guides: Mapping[str, GuideErrors]) -> Array:
        """Motion that the guide of one axis adds along another, less that of the model."""
        names = self.axes
        curves = np.zeros((len(names), len(names), 6))
        for s, part in enumerate(self.parts):
            other = neighbour(names, part.name)
            if other is None or part.guide is None:
                continue
            a = names.index(other)
            curves[a, s] = polynomial(guides[part.name], "across", part.low)
            along, across = (
                self.model.static_gain(part.drive, p.probe) for p in (part, self.parts[a])
            )
            curves[a, s, 1] -= across / along
        return curves
