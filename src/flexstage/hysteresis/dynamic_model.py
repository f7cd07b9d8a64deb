"""Dynamic model of a stage: its drives and modes, from commands to readings."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.choose import has_no
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.chain.element import (
    checked_state,
    forcing,
    positive_step,
    values_at_samples,
)
from flexstage.hysteresis.chain.lag import lags_through_segments
from flexstage.hysteresis.chain.modal import (
    modes_along_lines,
    modes_through_segments,
    unit_step,
)
from flexstage.hysteresis.chain.sensor import Sensor
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, HysteresisModel, samples
from flexstage.system import MechanicalSystem, drive_stiffness


def _empty() -> Array:
    return np.zeros(0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelDrive:
    """Input of a stage, and its effect on the readings.

    The command passes the amplifier, then the hysteresis or a gain, whose output is the free
    displacement w of the drive (the force, for a pure force), then creep. Each mode i follows w by
    ``z'' + 2 zeta omega z' + omega^2 z = omega^2 (w + t_i w')``, of unit static
    gain; each lag of the creep by ``tau l' + l = w``. The contribution of this drive to the probes
    is ``mode_weights @ [z, z'] + lag_weights @ l + feedthrough w``. `assembled_model` sets the
    weights and the other data of the stage.
    """

    name: str
    """Name of the drive."""
    hysteresis: HysteresisModel | None = None
    """From voltage [V] to free displacement [m]; None for the gain alone."""
    amplifier: Amplifier | None = None
    """From command to voltage; None where the command is the voltage."""
    creep: Creep | None = None
    """Creep of the free displacement; None for none."""
    input_range: tuple[float, float] | None = None
    """Lowest and highest voltage of the stack [V]; None if unknown."""
    kind: str = "piezo"
    """``piezo``, ``screw`` or ``force``."""
    unit: str = "V"
    """Unit of the command: V, m or N."""
    gain: float = 1.0
    """Free displacement or force over voltage, without hysteresis [m/V, 1]."""
    stiffness: float | None = None
    """Stiffness of the drive [N/m]; None for a rigid drive, 0 for a pure force."""
    mode_weights: Array = field(default_factory=_empty)
    """Weights of the deflections in the first k columns [1] and of their rates in the others [s],
    one row a probe, shape (p, 2 k).
    """
    lag_weights: Array = field(default_factory=_empty)
    """Weights of the lags of the creep [1], shape (p, m)."""
    feedthrough: Array = field(default_factory=_empty)
    """Weights of w itself [1], shape (p,): of an imposed displacement, and of omitted modes."""
    rate_time: Array = field(default_factory=_empty)
    """Times t_i [s], shape (k,): 2 zeta/omega for an imposed displacement, else 0."""
    modal_gain: Array = field(default_factory=_empty)
    """Deflection of each mode, of unit modal mass, for a unit of w at rest, shape (k,): without
    creep and with `DynamicModel.probe_shapes`, the weights of the deflections are ``probe_shapes
    * modal_gain``.
    """


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelProbe:
    """Output of a stage."""

    name: str
    """Name of the probe."""
    unit: str
    """Unit of the reading."""
    sensor: Sensor | None = None
    """The sensor; None for the true motion."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelState:
    """State of a dynamic model."""

    time: float = 0.0
    """Time of the last sample [s]."""
    amplifiers: dict[str, Array] = field(default_factory=dict)
    """State of the amplifier by drive, or the command without an amplifier [V]."""
    hysteresis: dict[str, Array] = field(default_factory=dict)
    """State of the hysteresis by drive."""
    lags: dict[str, Array] = field(default_factory=dict)
    """Lags of the creep by drive [m]."""
    deflections: dict[str, Array] = field(default_factory=dict)
    """Deflections of the modes by drive [m]."""
    rates: dict[str, Array] = field(default_factory=dict)
    """Rates of the modes by drive [m/s]."""
    sensors: dict[str, Array] = field(default_factory=dict)
    """State of the sensor by probe."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelResponse:
    """Response of a stage to sequences of commands."""

    time: Array
    """Times [s], shape (n,)."""
    voltage: dict[str, Array]
    """Output of the amplifier of each drive [V], or the command without one, shape (n,)."""
    free_displacement: dict[str, Array]
    """Free displacement of each drive, with creep [m], or its force [N], shape (n,)."""
    motion: dict[str, Array]
    """True motion at each probe [m], shape (n,)."""
    readings: dict[str, Array]
    """Reading of the sensor of each probe, or the true motion without a sensor, shape (n,)."""
    state: ModelState
    """State at the last sample."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DynamicModel:
    r"""Dynamic model of a stage: amplifiers, hysteresis, creep, modes, sensors.

    .. math:: M\ddot q + C\dot q + (K + \sum_d k_d b_d b_d^T) q = \sum_d k_d b_d w_d(t),
              \qquad y = P q

    with the free displacement :math:`w_d` of each drive. The modes include the stiffness of the
    drives, so that a stack works against the stage: at rest its elongation is the share
    `load_factor` of its free displacement.

    Voltages are straight lines between the samples. For these the readings are exact: the
    hysteresis is known between the samples, in closed form or else within 1e-10 of its output, and
    the modes are stepped through it. Creep is linear and its product with a mode is a sum of both
    (partial fractions), so that both are stepped in parallel without an additional error.

    Validity: that of the mechanical system and of the hysteresis models; small motion, one
    temperature; the hysteresis depends on the voltage and not on the force of the stack; output of
    an amplifier and input of a sensor are straight lines between samples.
    """

    name: str
    """Name of the stage."""
    title: str
    """Title, one line."""
    step: float
    """Step between samples [s]."""
    omega: Array
    """Angular frequencies of the modes, drives in place [rad/s], shape (k,)."""
    damping_ratio: Array
    """Damping ratios [1], shape (k,)."""
    drives: tuple[ModelDrive, ...]
    """The inputs."""
    probes: tuple[ModelProbe, ...]
    """The outputs."""
    probe_shapes: Array
    """Reading of each probe for the modes of unit modal mass, shape (p, k)."""
    system: MechanicalSystem
    """Mechanical system of the modes and weights."""
    notes: tuple[str, ...] = ()
    """Limits of validity, and assumptions."""

    __repr__ = short_repr

    def drive(self, name: str) -> ModelDrive:
        """Return a drive by name."""
        for drive in self.drives:
            if drive.name == name:
                return drive
        raise ModelError(has_no("the model", "drive", name, (d.name for d in self.drives)))

    def row(self, probe: str) -> int:
        """Return the number of a probe, from 0."""
        return [p.name for p in self.probes].index(self.system.probe(probe).name)

    def as_exported(self) -> "DynamicModel":
        """Return the model for other programs: without noise, and without limits of the voltage."""
        return replace(
            self,
            drives=tuple(replace(d, input_range=None) for d in self.drives),
            probes=tuple(
                replace(p, sensor=p.sensor and replace(p.sensor, noise_rms=0.0))
                for p in self.probes
            ),
        )

    def load_factor(self, drive: str) -> float:
        r"""Return the elongation of a drive in the stage over its free displacement, at rest.

        .. math:: \frac{k_s}{k_s + k_{in}}

        Parameters
        ----------
        drive : str
            The drive.

        Returns
        -------
        float
            Elongation over free displacement at rest [1].
        """
        k = required_stiffness(self.system, drive)
        return k / (k + drive_stiffness(self.system, drive, others="in place"))

    def static_gain(self, drive: str, probe: str) -> float:
        """Return the reading over the free displacement of a drive at rest.

        Parameters
        ----------
        drive : str
            A drive.
        probe : str
            A probe.

        Returns
        -------
        float
            The ratio [m/m]; creep is part of the free displacement.
        """
        d, row = self.drive(drive), self.row(probe)
        return float(self.probe_shapes[row] @ d.modal_gain + d.feedthrough[row])

    def settled(self, commands: Mapping[str, float] | None = None) -> ModelState:
        """Return the state at rest after a movement from zero to constant commands.

        Commands are by drive [V, m or N], zero by default. The next sample is at time zero.
        """
        values = dict(commands or {})
        for name in values:
            self.drive(name)
        k = self.omega.size
        state_at_rest = ModelState(time=-positive_step(self.step))
        reading = np.zeros(len(self.probes))
        for d in self.drives:
            amplifier = np.array([float(values.get(d.name, 0.0))])
            if d.amplifier is not None:
                amplifier = d.amplifier.settled(float(amplifier[0]), self.step)
            voltage = amplifier[-1:]
            if d.hysteresis is None:
                state, w = voltage.copy(), d.gain * float(voltage[0])
            else:
                response = d.hysteresis.simulate(voltage, d.hysteresis.initial_state())
                state, w = response.state, float(response.values[0])
            state_at_rest.amplifiers[d.name] = amplifier
            state_at_rest.hysteresis[d.name] = state
            state_at_rest.lags[d.name] = np.full(d.lag_weights.shape[1], w)
            state_at_rest.deflections[d.name] = np.full(k, w)
            state_at_rest.rates[d.name] = np.zeros(k)
            weights = np.ascontiguousarray(d.mode_weights[:, :k])
            _read_at_rest(w, weights, d.lag_weights, d.feedthrough, reading)
        for probe, value in zip(self.probes, reading.tolist(), strict=True):
            if probe.sensor is not None:
                state_at_rest.sensors[probe.name] = probe.sensor.settled(value, self.step)
        return state_at_rest

    def simulate(
        self, commands: Mapping[str, ArrayLike], state: ModelState | None = None
    ) -> ModelResponse:
        """Return the motion under sequences of commands, or under one sample of each.

        Parameters
        ----------
        commands : Mapping
            Command of each drive [V, m or N], shape (n,); other drives keep theirs.
        state : ModelState, optional
            State one step before the first sample; settled at the first where not given.

        Returns
        -------
        ModelResponse
            The motion, and the state at the last sample.

        Raises
        ------
        ModelError
            A drive does not exist, sequences differ in length or are not finite, a voltage is
            outside the range of its stack, or the state does not belong to this model.
        """
        h = positive_step(self.step)
        inputs = {
            self.drive(n).name: samples(u, f"command of drive '{n}'") for n, u in commands.items()
        }
        sizes = {u.size for u in inputs.values()}
        if len(sizes) != 1:
            raise ModelError(
                f"a model needs at least one command, all of the same length, got {sizes or 0}"
            )
        n = sizes.pop()
        if state is None:
            state = self.settled({name: float(u[0]) for name, u in inputs.items()})
        self._refuse_state(state)
        # the last row is for the free displacement of each drive in turn
        y = np.zeros((len(self.probes) + 1, n))
        time = state.time + h * np.arange(1, n + 1, dtype=np.float64)
        after = ModelState(time=float(time[-1]))
        voltage, free = {}, {}
        for d in self.drives:
            u = inputs[d.name] if d.name in inputs else np.full(n, state.amplifiers[d.name][0])
            voltage[d.name], free[d.name] = self._drive(d, u, state, after, y)
        motion = dict(zip((p.name for p in self.probes), y, strict=False))
        readings = dict(motion)
        for probe in self.probes:
            if probe.sensor is not None:
                sensor_state = state.sensors[probe.name]
                reading = probe.sensor.simulate(motion[probe.name], h, sensor_state)
                readings[probe.name], after.sensors[probe.name] = reading.values, reading.state
        return ModelResponse(
            time=time,
            voltage=voltage,
            free_displacement=free,
            motion=motion,
            readings=readings,
            state=after,
        )

    def _refuse_state(self, state: ModelState) -> None:
        drives = {d.name for d in self.drives}
        sensors = {p.name for p in self.probes if p.sensor is not None}
        if set(state.deflections) != drives or set(state.sensors) != sensors:
            raise ModelError(
                f"the state has the drives {sorted(state.deflections)} and sensors "
                f"{sorted(state.sensors)}, the model {sorted(drives)} and "
                f"{sorted(sensors)}: use a state that the model returned"
            )

    def _drive(
        self, d: ModelDrive, u: Array, before: ModelState, after: ModelState, y: Array
    ) -> tuple[Array, Array]:
        """Add the contribution of one drive to y; return its voltage and free displacement."""
        h, k, name = self.step, self.omega.size, d.name
        voltage, amplifier = u, u[-1:].copy()
        if d.amplifier is not None:
            response = d.amplifier.simulate(u, h, before.amplifiers[name])
            amplifier, voltage = response.state, response.values
        _refuse_voltage(d, voltage)
        state = before.hysteresis[name]
        z = checked_state(before.deflections[name], k, f"drive '{name}'")
        v = checked_state(before.rates[name], k, f"drive '{name}'") * h
        lags = checked_state(
            before.lags[name], d.lag_weights.shape[1], f"the creep of drive '{name}'"
        )
        reader = d.mode_weights * np.concatenate((np.ones(k), np.full(k, 1.0 / h)))
        inputs = np.concatenate((state[:1], voltage))
        step = unit_step(self.omega * h, self.damping_ratio)
        if d.hysteresis is None:
            w, state = d.gain * inputs, voltage[-1:].copy()
            modes_along_lines(w, step, z, v, reader, y[:-1], d.rate_time / h)
            y[-1] = w[1:]
        else:
            force = forcing(d.hysteresis, inputs, state)
            w, state = values_at_samples(force), force.state
            y[-1] = w[1:]
            modes_through_segments(force, step, z, v, reader, y[:-1])
            if d.creep is not None:
                weights = np.vstack((d.lag_weights, d.creep.lag_gains))
                lags_through_segments(force, h / d.creep.time_constants, lags, weights, y)
        y[:-1] += np.outer(d.feedthrough, w[1:])
        after.amplifiers[name], after.hysteresis[name] = amplifier, state
        after.lags[name] = lags
        after.deflections[name], after.rates[name] = z, v / h
        return voltage, y[-1].copy()


def required_stiffness(system: MechanicalSystem, drive: str) -> float:
    """Return the stiffness of a drive after checking that it has one [N/m]."""
    k = system.drive(drive).stiffness
    if not k:
        kind = "is rigid" if k is None else "has no stiffness"
        raise ModelError(
            f"drive '{drive}' {kind}: a model needs the stiffness of a stack, by which its free "
            "displacement is a force"
        )
    return k


def _refuse_voltage(d: ModelDrive, voltage: Array) -> None:
    if d.input_range is None:
        return
    low, high = d.input_range
    bad = np.flatnonzero((voltage < low) | (voltage > high))
    if bad.size:
        raise ModelError(
            f"the voltage of drive '{d.name}' is {voltage[bad[0]]:g} V at sample {bad[0]}, outside "
            f"the range of its stack, {low:g} to {high:g} V"
        )


@compiled
def _read_at_rest(w: float, reader: Array, lags: Array, feedthrough: Array, y: Array) -> None:
    """Add the readings of a drive at rest, in the order of the sums of a step."""
    for p in range(y.size):
        total = y[p]
        for i in range(reader.shape[1]):
            total += reader[p, i] * w
        for i in range(lags.shape[1]):
            total += lags[p, i] * w
        y[p] = total + feedthrough[p] * w
