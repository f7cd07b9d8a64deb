"""What is handed to other programs: a stage with its drives, from commands to readings."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from flexstage.choose import has_no
from flexstage.errors import ModelError
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.chain.coupled_stepping import (
    forcing,
    lags_through,
    modes_through,
    values_of,
)
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.chain.element import positive_step
from flexstage.hysteresis.chain.modal import unit_step
from flexstage.hysteresis.chain.sensor import Sensor
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, HysteresisModel, samples
from flexstage.short_repr import short_repr
from flexstage.system import MechanicalSystem


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelDrive:
    """One input of a stage, and how the readings follow from it.

    The command passes the amplifier, then the hysteresis or a gain, which gives the free
    displacement w of the drive (the force, of a drive that is a pure force), then creep. Each mode
    i answers w by ``z'' + 2 zeta omega z' + omega^2 z = omega^2 (w + t_i w')``, of unit static
    gain; each lag of the creep by ``tau l' + l = w``. What the probes read of this drive is
    ``mode_weights @ [z, z'] + lag_weights @ l + feedthrough w``.
    """

    name: str
    """Name of the drive."""
    kind: str
    """``piezo``, ``screw`` or ``force``."""
    unit: str
    """Unit of the command: V, m or N."""
    gain: float
    """Free displacement or force over voltage, where there is no hysteresis [m/V, 1]."""
    hysteresis: HysteresisModel | None
    """From voltage [V] to free displacement [m]; None for the gain alone."""
    amplifier: Amplifier | None
    """From command to voltage; None where the command is the voltage."""
    creep: Creep | None
    """Creep of the free displacement; None for none."""
    input_range: tuple[float, float] | None
    """Lowest and highest command [unit]; None where nobody has said."""
    mode_weights: Array
    """Weights of the deflections in the first k columns [1] and of their rates in the others [s],
    one row a probe, shape (p, 2 k).
    """
    lag_weights: Array
    """Weights of the lags of the creep [1], shape (p, m)."""
    feedthrough: Array
    """Weights of w itself [1], shape (p,): of an imposed displacement, and of modes left out."""
    rate_time: Array
    """Times t_i [s], shape (k,): 2 zeta/omega where the displacement is imposed, else 0."""
    stiffness: float | None
    """Stiffness of the drive [N/m]; None where it is rigid, 0 for a pure force."""
    modal_gain: Array
    """Deflection of each mode, of unit modal mass, for a unit of w at rest, shape (k,): without
    creep and with `DynamicModel.probe_shapes`, the weights of the deflections are ``probe_shapes
    * modal_gain``.
    """


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelProbe:
    """One output of a stage."""

    name: str
    """Name of the probe."""
    unit: str
    """Unit of the reading."""
    sensor: Sensor | None = None
    """The sensor, without its noise; None for the true motion."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelMemory:
    """What a dynamic model remembers."""

    amplifiers: dict[str, Array]
    """State of the amplifier by drive [V]."""
    hysteresis: dict[str, Array]
    """State of the hysteresis by drive."""
    lags: dict[str, Array]
    """Lags of the creep by drive [m]."""
    deflections: dict[str, Array]
    """Deflections of the modes by drive [m]."""
    rates: dict[str, Array]
    """Rates of the modes by drive [m/s]."""
    sensors: dict[str, Array] = field(default_factory=dict)
    """State of the sensor by probe."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DynamicModel:
    """A stage with its drives as other programs run it: modes, hysteresis, amplifiers, sensors.

    Commands move on straight lines between samples; for these the readings are exact at the
    samples, but that the output of an amplifier is taken as straight between them.

    Validity: that of the mechanical system and of the hysteresis models; small motion; sensors
    without noise.
    """

    name: str
    """Name of the stage."""
    title: str
    """One line that says what it is."""
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
    """Where modes and weights come from."""
    notes: tuple[str, ...] = ()
    """Where the model stops being valid, and what was chosen for it."""

    __repr__ = short_repr

    def drive(self, name: str) -> ModelDrive:
        """Return a drive by name."""
        for drive in self.drives:
            if drive.name == name:
                return drive
        raise ModelError(has_no("the model", "drive", name, (d.name for d in self.drives)))

    def settled(self, commands: Mapping[str, float] | None = None) -> ModelMemory:
        """Return the memory after commands went from zero to a value and stayed there.

        Commands are by drive [V, m or N]; zero for those that are not named.
        """
        given = dict(commands or {})
        for name in given:
            self.drive(name)
        k = self.omega.size
        made = ModelMemory(amplifiers={}, hysteresis={}, lags={}, deflections={}, rates={})
        reading = np.zeros(len(self.probes))
        for d in self.drives:
            amplifier = np.array([float(given.get(d.name, 0.0))])
            if d.amplifier is not None:
                amplifier = d.amplifier.settled(float(amplifier[0]), self.step)
            voltage = amplifier[-1:]
            if d.hysteresis is None:
                state, w = voltage.copy(), d.gain * float(voltage[0])
            else:
                response = d.hysteresis.simulate(voltage, d.hysteresis.initial_state())
                state, w = response.state, float(response.values[0])
            made.amplifiers[d.name] = amplifier
            made.hysteresis[d.name] = state
            made.lags[d.name] = np.full(d.lag_weights.shape[1], w)
            made.deflections[d.name] = np.full(k, w)
            made.rates[d.name] = np.zeros(k)
            weights = np.ascontiguousarray(d.mode_weights[:, :k])
            read_at_rest(w, weights, d.lag_weights, d.feedthrough, reading)
        for probe, value in zip(self.probes, reading.tolist(), strict=True):
            if probe.sensor is not None:
                made.sensors[probe.name] = probe.sensor.settled(value, self.step)
        return made

    def simulate(
        self, commands: Mapping[str, ArrayLike], memory: ModelMemory | None = None
    ) -> tuple[dict[str, Array], ModelMemory]:
        """Return the readings under sequences of commands.

        Every drive has a command [V, m or N], all of one length. Readings by probe are through the
        sensors of those that have one; the memory is that at the last sample. It begins one step
        before the first sample, settled at the first where not given.
        """
        given = {d.name: self._sequence(d, commands) for d in self.drives}
        if len({u.size for u in given.values()}) != 1:
            raise ModelError("the commands of a model must be equally long")
        if memory is None:
            memory = self.settled({name: float(u[0]) for name, u in given.items()})
        n = next(iter(given.values())).size
        y = np.zeros((len(self.probes), n))
        after = ModelMemory(amplifiers={}, hysteresis={}, lags={}, deflections={}, rates={})
        for d in self.drives:
            self._drive(d, given[d.name], memory, after, y)
        readings = {}
        for probe, values in zip(self.probes, y, strict=True):
            readings[probe.name] = values
            if probe.sensor is not None:
                seen = probe.sensor.simulate(values, self.step, memory.sensors[probe.name])
                readings[probe.name], after.sensors[probe.name] = seen.values, seen.state
        return readings, after

    def _sequence(self, drive: ModelDrive, commands: Mapping[str, ArrayLike]) -> Array:
        if drive.name not in commands:
            raise ModelError(f"drive '{drive.name}' has no command: give a sequence for it")
        return samples(commands[drive.name], f"command of drive '{drive.name}'")

    def _drive(
        self, d: ModelDrive, u: Array, memory: ModelMemory, after: ModelMemory, y: Array
    ) -> None:
        """Add to y what one drive does."""
        h, k = positive_step(self.step), self.omega.size
        voltage, amplifier = u, u[-1:].copy()
        if d.amplifier is not None:
            response = d.amplifier.simulate(u, h, memory.amplifiers[d.name])
            amplifier, voltage = response.state, response.values
        before = memory.hysteresis[d.name]
        z, v = memory.deflections[d.name].copy(), memory.rates[d.name] * h
        lags = memory.lags[d.name].copy()
        reader = d.mode_weights * np.concatenate((np.ones(k), np.full(k, 1.0 / h)))
        if d.hysteresis is None:
            w = d.gain * np.concatenate((before[:1], voltage))
            state = voltage[-1:].copy()
            self._along_lines(d, w, z, v, reader, y)
        else:
            force = forcing(d.hysteresis, np.concatenate((before[:1], voltage)), before)
            w, state = values_of(force), force.state
            modes_through(force, self.omega * h, self.damping_ratio, z, v, reader, y)
            if d.creep is not None:
                lags_through(force, h / d.creep.time_constants, lags, d.lag_weights, y)
        y += np.outer(d.feedthrough, w[1:])
        after.amplifiers[d.name], after.hysteresis[d.name] = amplifier, state
        after.lags[d.name] = lags
        after.deflections[d.name], after.rates[d.name] = z, v / h

    def _along_lines(
        self, d: ModelDrive, w: Array, z: Array, v: Array, reader: Array, y: Array
    ) -> None:
        """Modes behind straight lines of the free displacement, and behind its rate."""
        step = unit_step(self.omega * self.step, self.damping_ratio)
        modes_behind_lines(
            w, step.transition, step.moments, d.rate_time / self.step, z, v, reader, y
        )


@compiled
def modes_behind_lines(
    w: Array,
    transition: Array,
    moments: Array,
    by_rate: Array,
    z: Array,
    v: Array,
    reader: Array,
    y: Array,
) -> None:
    """Step modes along straight lines of a displacement that acts by its rate too.

    Of k modes: w has the n + 1 samples, the modes are at the first of them; `transition` goes from
    (z, z') to (z, z'), shape (4, k); `moments` say what the derivatives of a force do, 3 rows at
    least; `by_rate` is the time by which the rate acts [samples]. z and v [per sample] are moved
    on. Readings are added to y, shape (p, n), with the weights `reader` of z and then of z', shape
    (p, 2 k).
    """
    k = z.size
    for n in range(w.size - 1):
        rise = w[n + 1] - w[n]
        for i in range(k):
            # a rate in the force is a constant within each step
            start = w[n] + by_rate[i] * rise
            at, speed = z[i], v[i]
            z[i] = (transition[0, i] * at + transition[1, i] * speed) + (
                moments[1, i] * start + moments[2, i] * rise
            )
            v[i] = (transition[2, i] * at + transition[3, i] * speed) + (
                moments[0, i] * start + moments[1, i] * rise
            )
        for p in range(y.shape[0]):
            total = y[p, n]
            for i in range(k):
                total += reader[p, i] * z[i] + reader[p, k + i] * v[i]
            y[p, n] = total


@compiled
def read_at_rest(w: float, reader: Array, lags: Array, feedthrough: Array, y: Array) -> None:
    """Add what probes read of a drive that rests, in the order in which a step adds it."""
    for p in range(y.size):
        total = y[p]
        for i in range(reader.shape[1]):
            total += reader[p, i] * w
        for i in range(lags.shape[1]):
            total += lags[p, i] * w
        y[p] = total + feedthrough[p] * w
