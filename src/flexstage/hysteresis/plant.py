"""The entire dynamic model of a piezo stage: from command voltages to readings of its platform."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from flexstage.errors import ModelError
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.chain.coupled_stepping import (
    forcing,
    lags_through,
    modes_through,
    values_of,
)
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.chain.element import checked_state, positive_step
from flexstage.hysteresis.chain.sensor import Sensor
from flexstage.hysteresis.model import Array, HysteresisModel, samples
from flexstage.short_repr import short_repr
from flexstage.system import MechanicalSystem, drive_stiffness, modes

# A lag and a mode that fall together this closely cannot be told apart.
_APART = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveChain:
    """What lies between the command of one drive and the free displacement of its stack."""

    model: HysteresisModel
    """From voltage [V] to free displacement [m]."""
    amplifier: Amplifier | None = None
    """From command to voltage; the command is the voltage where not given."""
    creep: Creep | None = None
    """Creep of the free displacement; none where not given."""
    voltage_range: tuple[float, float] | None = None
    """Lowest and highest voltage that the stack allows [V]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveState:
    """What one drive remembers, and the motion that it causes."""

    amplifier: Array
    """State of the amplifier, or the voltage alone where there is none."""
    hysteresis: Array
    """State of the hysteresis model."""
    lags: Array
    """Lags of the creep [m], shape (m,)."""
    deflections: Array
    """Each mode's answer to the displacement without creep [m], shape (k,)."""
    rates: Array
    """Their rates [m/s], shape (k,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantState:
    """What the plant remembers."""

    time: float
    """Time of the last sample [s]."""
    drives: Mapping[str, DriveState]
    """State of each drive."""
    sensors: Mapping[str, Array]
    """State of each sensor."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantResponse:
    """What the plant does under a sequence of commands."""

    time: Array
    """Times [s], shape (n,)."""
    voltage: dict[str, Array]
    """Voltage at each drive [V], shape (n,)."""
    free_displacement: dict[str, Array]
    """Free displacement of each stack, with creep [m], shape (n,)."""
    readings: dict[str, Array]
    """True motion at each probe [m], shape (n,)."""
    measured: dict[str, Array]
    """What the sensor of each probe that has one says, shape (n,)."""
    state: PlantState
    """State at the last sample."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Reader:
    """How the readings of all probes follow from the modes and lags that one drive moves."""

    modes: Array  # (p, 2 k): deflections, then rates [s]
    lags: Array  # (p, m)
    ratio: Array  # 1 / time constant of the lags [1/s], (m,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plant:
    r"""A mechanical system whose drives are piezo stacks with hysteresis, creep and amplifiers.

    .. math:: M\ddot q + C\dot q + (K + \sum_d k_d b_d b_d^T) q = \sum_d k_d b_d w_d(t),
              \qquad y = P q

    with the free displacement :math:`w_d` of each stack behind its voltage. The stiffness of the
    stacks is in the modes, so a stack works against the stage as it does in reality: at rest it
    gives the part `load_factor` of its free displacement. All modes are kept.

    The voltage moves on straight lines between the samples. For these the readings are exact: the
    hysteresis is known between the samples, in closed form where the model has one and to rounding
    where not, and the modes are stepped through it. Creep is linear and its product with a mode is
    a sum of both (partial fractions), so that both are stepped side by side and neither adds an
    error.

    Validity: small motion, one temperature; the hysteresis depends on the voltage and not on the
    force of the stack; the sensor sees straight lines between the samples.

    Raises
    ------
    ModelError
        A drive or probe does not exist, a driven drive has no stiffness or is rigid, or the stage
        moves without resistance.

    Examples
    --------
    >>> import numpy as np
    >>> from flexstage.hysteresis.models.bouc_wen.law import BoucWen
    >>> from flexstage.system.mechanical import DrivePort, ProbePort
    >>> stage = MechanicalSystem(
    ...     name="a mass on a spring",
    ...     model="lumped",
    ...     M=np.array([[0.31]]),
    ...     K=np.array([[2.4e6]]),
    ...     coordinates=("u [m]",),
    ...     drives=(DrivePort(name="x", vector=np.ones(1), stiffness=4.1e7),),
    ...     probes=(ProbePort(name="x", vector=np.ones(1)),),
    ... )
    >>> stack = BoucWen(gain=3.8e-7, hysteresis_gain=1.1e-7, beta=0.05, gamma=0.03)
    >>> plant = Plant(system=stage, drives={"x": DriveChain(model=stack)})
    >>> round(plant.load_factor("x"), 4)
    0.9447
    >>> u = 60.0 - 60.0 * np.cos(2.0 * np.pi * 5.0 * np.arange(2000) * 1e-4)
    >>> round(float(plant.simulate({"x": u}, 1e-4).readings["x"].max()) * 1e6, 3)
    41.78
    """

    system: MechanicalSystem
    """The stage; its driven drives must have a stiffness."""
    drives: Mapping[str, DriveChain]
    """The chain of each drive that is commanded; others stand still, with their stiffness."""
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    """Sensors by probe."""
    _omega: Array = field(init=False, repr=False)
    _damping: Array = field(init=False, repr=False)
    _readers: Mapping[str, _Reader] = field(init=False, repr=False)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not self.drives:
            raise ModelError("a plant needs at least one drive: give its chain by its name")
        for name in self.sensors:
            self.system.probe(name)
        for name in self.drives:
            _stiffness(self.system, name)
        result = modes(self.system, drives="in place", count=None)
        if not np.all(result.omega > 0.0):
            raise ModelError(
                f"stage '{self.system.name}' has a motion without stiffness: a plant needs a stage "
                "that is held"
            )
        object.__setattr__(self, "_omega", result.omega)
        object.__setattr__(self, "_damping", np.asarray(result.damping_ratio, dtype=np.float64))
        probes = np.array([probe.vector for probe in self.system.probes]).reshape(
            len(self.system.probes), self.system.order
        )
        readers = {}
        for name, chain in self.drives.items():
            k = _stiffness(self.system, name)
            port = self.system.drive(name)
            gain = k * (port.vector @ result.shapes) / result.omega**2
            readers[name] = _reader(
                probes @ result.shapes * gain, result.omega, self._damping, chain.creep
            )
        object.__setattr__(self, "_readers", readers)

    def load_factor(self, drive: str) -> float:
        r"""Return the part of the free displacement of a stack that the stage lets it have.

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
        k = _stiffness(self.system, drive)
        return k / (k + drive_stiffness(self.system, drive, others="in place"))

    def static_gain(self, drive: str, probe: str) -> float:
        """Return the reading over the free displacement of a stack at rest.

        Parameters
        ----------
        drive : str
            A drive that is commanded.
        probe : str
            A probe.

        Returns
        -------
        float
            The ratio [m/m]; creep is part of the free displacement.
        """
        row = [port.name for port in self.system.probes].index(self.system.probe(probe).name)
        chain, reader = self._chain(drive), self._readers[drive]
        total = reader.modes[row, : self._omega.size].sum() + reader.lags[row].sum()
        return float(total) / (1.0 if chain.creep is None else chain.creep.static_gain)

    def settled(self, voltages: Mapping[str, float], dt: float) -> PlantState:
        """Return the state after the voltages went from zero to a value and stayed there.

        Parameters
        ----------
        voltages : Mapping
            Command of drives [V]; zero for those that are not named.
        dt : float
            Step between samples [s].

        Returns
        -------
        PlantState
            The state; the next sample is at time zero.
        """
        h = positive_step(dt)
        for name in voltages:
            self._chain(name)
        states = {
            name: self._settled_drive(chain, float(voltages.get(name, 0.0)), h)
            for name, chain in self.drives.items()
        }
        readings = np.zeros(len(self.system.probes))
        for name, state in states.items():
            readings += self._read(name, state)
        found = dict(zip((p.name for p in self.system.probes), readings.tolist(), strict=True))
        sensors = {name: s.settled(found[name], h) for name, s in self.sensors.items()}
        return PlantState(time=-h, drives=states, sensors=sensors)

    def simulate(
        self, voltages: Mapping[str, ArrayLike], dt: float, state: PlantState | None = None
    ) -> PlantResponse:
        """Return the motion under sequences of commands.

        Parameters
        ----------
        voltages : Mapping
            Command of each drive [V], shape (n,); drives that are not named keep their voltage.
        dt : float
            Step between samples [s].
        state : PlantState, optional
            State one step before the first sample; settled at the first where not given.

        Returns
        -------
        PlantResponse
            The motion, and the state at the last sample.

        Raises
        ------
        ModelError
            A drive does not exist, sequences differ in length or are not finite, a voltage is
            outside the range of its stack, or the state is not one of this plant.
        """
        h = positive_step(dt)
        given = {name: samples(u, f"command of drive '{name}'") for name, u in voltages.items()}
        sizes = {u.size for u in given.values()}
        if len(sizes) != 1:
            raise ModelError(
                f"the commands of a plant must be at least one and equally long, got {sizes or 0}"
            )
        n = sizes.pop()
        if state is None:
            state = self.settled({name: float(u[0]) for name, u in given.items()}, h)
        elif set(state.drives) != set(self.drives) or set(state.sensors) != set(self.sensors):
            raise ModelError(
                f"the state has the drives {sorted(state.drives)} and sensors "
                f"{sorted(state.sensors)}, the plant {sorted(self.drives)} and "
                f"{sorted(self.sensors)}: take the state that the plant returned"
            )
        for name in given:
            self._chain(name)
        y = np.zeros((len(self.system.probes), n))
        voltage, free, after = {}, {}, {}
        for name, chain in self.drives.items():
            before = state.drives[name]
            u = given[name] if name in given else np.full(n, before.amplifier[0])
            voltage[name], free[name], after[name] = self._drive(name, chain, u, h, before, y)
        readings = dict(zip((p.name for p in self.system.probes), y, strict=True))
        seen = {
            name: s.simulate(readings[name], h, state.sensors[name])
            for name, s in self.sensors.items()
        }
        time = state.time + h * np.arange(1, n + 1, dtype=np.float64)
        return PlantResponse(
            time=time,
            voltage=voltage,
            free_displacement=free,
            readings=readings,
            measured={name: found.values for name, found in seen.items()},
            state=PlantState(
                time=float(time[-1]),
                drives=after,
                sensors={name: found.state for name, found in seen.items()},
            ),
        )

    def _chain(self, drive: str) -> DriveChain:
        if drive not in self.drives:
            raise ModelError(
                f"drive '{drive}' has no chain: the plant has {', '.join(self.drives)}"
            )
        return self.drives[drive]

    def _settled_drive(self, chain: DriveChain, command: float, h: float) -> DriveState:
        amplifier = np.array([command])
        if chain.amplifier is not None:
            amplifier = chain.amplifier.settled(command, h)
        response = chain.model.simulate(amplifier[-1:], chain.model.initial_state())
        w, k = float(response.values[0]), self._omega.size
        return DriveState(
            amplifier=amplifier,
            hysteresis=response.state,
            lags=np.full(0 if chain.creep is None else chain.creep.time_constants.size, w),
            deflections=np.full(k, w),
            rates=np.zeros(k),
        )

    def _read(self, drive: str, state: DriveState) -> Array:
        reader = self._readers[drive]
        moved = np.concatenate((state.deflections, state.rates))
        return reader.modes @ moved + reader.lags @ state.lags

    def _drive(
        self, name: str, chain: DriveChain, u: Array, h: float, before: DriveState, y: Array
    ) -> tuple[Array, Array, DriveState]:
        """Add to y what one drive does; return its voltage, free displacement, and state."""
        k, reader = self._omega.size, self._readers[name]
        amplifier, voltage = u[-1:].copy(), u
        if chain.amplifier is not None:
            response = chain.amplifier.simulate(u, h, before.amplifier)
            amplifier, voltage = response.state, response.values
        _refuse_voltage(name, chain, voltage)
        start = np.concatenate((before.hysteresis[:1], voltage))
        force = forcing(chain.model, start, before.hysteresis)
        free = values_of(force)[1:].copy()
        z = checked_state(before.deflections, k, f"drive '{name}'")
        v = checked_state(before.rates, k, f"drive '{name}'") * h
        by_rate = np.concatenate((np.ones(k), np.full(k, 1.0 / h)))
        modes_through(force, self._omega * h, self._damping, z, v, reader.modes * by_rate, y)
        lags = checked_state(before.lags, reader.ratio.size, f"the creep of drive '{name}'")
        if chain.creep is not None:
            weights = np.vstack((reader.lags, chain.creep.lag_gains))
            added = np.zeros((y.shape[0] + 1, y.shape[1]))
            lags_through(force, reader.ratio * h, lags, weights, added)
            y += added[:-1]
            free += added[-1]
        state = DriveState(
            amplifier=amplifier, hysteresis=force.state, lags=lags, deflections=z, rates=v / h
        )
        return voltage, free, state


def _stiffness(system: MechanicalSystem, drive: str) -> float:
    k = system.drive(drive).stiffness
    if not k:
        kind = "is rigid" if k is None else "has no stiffness"
        raise ModelError(
            f"drive '{drive}' {kind}: a plant needs the stiffness of a stack, which turns its free "
            "displacement into a force"
        )
    return k


def _refuse_voltage(name: str, chain: DriveChain, voltage: Array) -> None:
    if chain.voltage_range is None:
        return
    low, high = chain.voltage_range
    bad = np.flatnonzero((voltage < low) | (voltage > high))
    if bad.size:
        raise ModelError(
            f"drive '{name}' gets {voltage[bad[0]]:g} V at sample {bad[0]}, and its stack allows "
            f"{low:g} to {high:g} V"
        )


def _reader(gain: Array, omega: Array, zeta: Array, creep: Creep | None) -> _Reader:
    r"""Return what the probes read of modes and lags that are driven side by side.

    With :math:`x = 1/(\tau\omega)` and :math:`c = 1/(1 - 2\zeta x + x^2)`, a mode behind a lag is
    :math:`(1 - c) z - c \dot z/(\tau\omega^2) + c\, l`, z and l the mode and the lag by themselves.
    """
    if creep is None:
        none = np.zeros((gain.shape[0], 0))
        return _Reader(modes=np.hstack((gain, np.zeros_like(gain))), lags=none, ratio=np.zeros(0))
    rate = 1.0 / creep.time_constants
    x = rate[:, None] / omega
    below = 1.0 - 2.0 * zeta * x + x**2
    if np.any(np.abs(below) < _APART):
        raise ModelError(
            "a mode that does not swing falls together with a lag of the creep: change the number "
            "of lags in a decade"
        )
    c = 1.0 / below
    a = creep.lag_gains
    by_z = 1.0 + a @ (1.0 - c)
    by_v = -(a * rate) @ c / omega**2
    return _Reader(modes=np.hstack((gain * by_z, gain * by_v)), lags=a * (gain @ c.T), ratio=rate)
