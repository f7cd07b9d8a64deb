"""A model of several drives that soften with their level, stepped sample by sample."""

from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.coupled_drives.softening import (
    MEMORY_CORNERS_HZ,
    VOLTAGE_EXPONENT,
    Softening,
    mode_poles,
    straight_gains,
)
from flexstage.hysteresis.coupled_drives.state_space import ModalSystem
from flexstage.system import StateSpace

#: Time constant of the levels [s]: on the records of a steering mirror, errors fall up to 0.4 s.
LEVEL_TIME_CONSTANT = 0.4
#: A level may exceed the largest of the records by this factor: levels of one setting scatter.
LEVEL_MARGIN = 1.2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoupledDriveState:
    """State of the model at its last sample.

    All are arrays: ``np.savez(file, **asdict(state))`` saves a state, and
    ``CoupledDriveState(**np.load(file))`` continues from it.
    """

    system: Complex
    """States of the linear system, complex, shape (n,)."""
    modes: Complex
    """States of the modes in the loop, complex, shape (M,)."""
    total: Array
    """Voltage and additional voltage at the last sample, shape (m,)."""
    lags: Array
    """States of the lags of the voltage, shape (2, m)."""
    lagged: Array
    """Their inputs at the last sample, shape (m,)."""
    force_square: Array
    """Slow mean square of w, shape (m,)."""
    voltage_square: Array
    """Slow mean square of the voltages, shape (m,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoupledDriveModel:
    """Several drives and sensors of a stage whose resonances soften with the level.

    Validity: commands with the level, the band and the operating point of the records. Records
    vary the level of broad-band signals; that a sine of the same level softens the stage equally is
    an assumption. Voltages are deviations from the operating point.
    """

    drives: Softening
    """Drives and the modes in their loop."""
    system: ModalSystem
    """The linear system from voltages to readings at the mean level."""
    sample_rate_hz: float
    """Sample rate [Hz]."""
    inputs: tuple[str, ...]
    """Names of the inputs."""
    outputs: tuple[str, ...]
    """Names of the outputs."""
    input_unit: str
    """Unit of the inputs."""
    output_unit: str
    """Unit of the outputs."""
    level_range: tuple[tuple[float, float], ...]
    """Smallest and largest rms of each input in the records."""
    band_hz: tuple[float, float]
    """Lowest and highest frequency of the records [Hz]."""
    largest_input: tuple[float, ...]
    """Largest deviation of each input from the operating point in the records."""

    __repr__ = short_repr

    def rest(self) -> CoupledDriveState:
        """Return the state after a long rest at the operating point."""
        m, k = len(self.inputs), self.drives.compliance.size
        return CoupledDriveState(
            system=np.zeros(self.system.poles.size, complex),
            modes=np.zeros(k, complex),
            total=np.zeros(m),
            lags=np.zeros((len(MEMORY_CORNERS_HZ), m)),
            lagged=np.zeros(m),
            force_square=np.zeros(m),
            voltage_square=np.zeros(m),
        )

    def simulate(
        self,
        voltages: ArrayLike,
        state: CoupledDriveState | None = None,
        *,
        time_constant: float = LEVEL_TIME_CONSTANT,
    ) -> tuple[Array, CoupledDriveState]:
        """Return the readings under sequences of voltages, and the state at the last sample.

        Parameters
        ----------
        voltages : array_like
            Deviations of the voltages from the operating point, shape (n, m).
        state : CoupledDriveState, optional
            State before the first sample; after a long rest where not given.
        time_constant : float
            Time constant of the levels [s]; infinite keeps those of the state.

        Returns
        -------
        tuple
            Readings, deviations from those at the operating point, shape (n, p), and the state.

        Raises
        ------
        ModelError
            The voltages have another shape, are not finite, or reach a level that no record had.

        Notes
        -----
        Modes and lags are exact for inputs that are straight between samples. The loop through the
        modes is solved at each sample, with the levels of the sample before.
        """
        u = columns(voltages, len(self.inputs), "voltages")
        return self._stepped(u, None, state, time_constant)

    def voltages(
        self,
        totals: ArrayLike,
        state: CoupledDriveState | None = None,
        *,
        limits: tuple[float, float] = (-np.inf, np.inf),
        largest_rate: float = np.inf,
    ) -> tuple[Array, CoupledDriveState]:
        """Return the voltages that, with what the drives add, are sequences u + s.

        This is the exact inverse of the drives that soften, sample by sample; between limits, the
        voltages are the nearest ones. The inverse of the linear system is that of `compensate`.

        Parameters
        ----------
        totals : array_like
            Voltages and additional voltages, shape (n, m).
        state : CoupledDriveState, optional
            State before the first sample; after a long rest where not given.
        limits : tuple of float
            Lowest and highest voltage, deviations from the operating point.
        largest_rate : float
            Largest rate of a voltage [unit of the inputs per second].

        Returns
        -------
        tuple
            Voltages, shape (n, m), and the state at the last sample.

        Raises
        ------
        ModelError
            The sequences have another shape, are not finite, or need a level that no record had; or
            there is a largest rate after a state, which has no last voltage.
        """
        if state is not None and np.isfinite(largest_rate):
            raise ModelError("a largest rate needs all samples in one sequence: omit the state")
        target = columns(totals, len(self.inputs), "sequences")
        u = np.empty_like(target)
        bounds = (*limits, largest_rate / self.sample_rate_hz)
        return u, self._stepped(u, (target, bounds), state, LEVEL_TIME_CONSTANT)[1]

    def linear(self, level: float | None = None) -> StateSpace:
        """Return the linear system of a constant level, from voltages to readings.

        Parameters
        ----------
        level : float, optional
            Rms of the inputs, for signals of the spectrum of the records; their mean level where
            not given.

        Returns
        -------
        StateSpace
            The system between samples, for voltages that are straight between them.

        Raises
        ------
        ModelError
            No record had this level.
        """
        mean = self.drives.voltage_reference ** (1.0 / VOLTAGE_EXPONENT)
        factor = 1.0 if level is None else level / float(np.mean(mean))
        # w is proportional to the voltages, but for the small change of the gains
        force = factor * self.drives.force_reference ** (1.0 / self.drives.exponent)
        levels = {"force_square": force**2, "voltage_square": (factor * mean) ** 2}
        rest = replace(self.rest(), **levels)
        parts = [(f.name, getattr(rest, f.name)) for f in fields(rest) if f.name not in levels]
        ends = np.cumsum([part.view(float).size for _, part in parts])
        m, n = len(self.inputs), int(ends[-1])
        columns_of = np.empty((n + m, n + len(self.outputs)))
        # a step is linear in state and voltages: each unit gives a column
        for k, unit in enumerate(np.eye(n + m)):
            split = zip(parts, np.split(unit[:n], ends[:-1]), strict=True)
            state = {name: x.view(part.dtype).reshape(part.shape) for (name, part), x in split}
            y, after = self._stepped(unit[None, n:], None, replace(rest, **state), np.inf)
            following = [getattr(after, name).view(float).ravel() for name, _ in parts]
            columns_of[k] = np.concatenate((*following, y[0]))
        return StateSpace(
            A=columns_of[:n, :n].T,
            B=columns_of[n:, :n].T,
            C=columns_of[:n, n:].T,
            D=columns_of[n:, n:].T,
            inputs=tuple(f"{name} [{self.input_unit}]" for name in self.inputs),
            outputs=tuple(f"{name} [{self.output_unit}]" for name in self.outputs),
            step=1.0 / self.sample_rate_hz,
        )

    def _stepped(
        self,
        u: Array,
        target: tuple[Array, tuple[float, float, float]] | None,
        state: CoupledDriveState | None,
        time_constant: float,
    ) -> tuple[Array, CoupledDriveState]:
        """Return readings and state after voltages, which a target of their totals replaces."""
        before = self.rest() if state is None else state
        after = CoupledDriveState(
            **{f.name: getattr(before, f.name).copy() for f in fields(before)}
        )
        readings = np.empty((u.shape[0], len(self.outputs)))
        largest, c = after.voltage_square.copy(), step_constants(self, time_constant)
        totals, bounds = target or (np.empty((0, u.shape[1])), (-np.inf, np.inf, np.inf))
        _step_drives(
            u,
            totals,
            bounds,
            (c.drives, c.levels, c.modes, c.lags, c.system),
            (after.system, after.modes, after.total, after.lags, after.lagged),
            (after.force_square, after.voltage_square, largest),
            readings,
        )
        self._require_level(np.sqrt(largest))
        return readings, after

    def _require_level(self, reached: Array) -> None:
        for name, (low, high), level in zip(
            self.inputs, self.level_range, reached.tolist(), strict=True
        ):
            if level > LEVEL_MARGIN * high:
                raise ModelError(
                    f"input '{name}' reaches a level of {level:.3g} {self.input_unit} rms, and "
                    f"the records had {low:.3g} to {high:.3g}: how the stage softens beyond is not "
                    "known: reduce the signal"
                )


def columns(values: ArrayLike, count: int, what: str) -> Array:
    """Return finite sequences in a number of columns, shape (n, count)."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != count or not np.isfinite(array).all():
        raise ModelError(f"{what} must be finite, in {count} columns, got shape {array.shape}")
    return array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepConstants:
    """Numbers of the steps of a model."""

    drives: tuple[Array, Array, Array, Array]
    """Gains A, strengths, references of the levels of w and of the voltages."""
    levels: tuple[float, float, float]
    """Powers of the mean squares of w and of the voltages; share of a new square in them."""
    modes: tuple[Complex, Complex, Complex, Complex, Array, Array]
    """Gains to elongation, factors e, b, d (`straight_gains`), input vectors, and the elongation at
    once of a unit of voltage at the end of a step.
    """
    lags: tuple[Array, Array, Array, Array, float]
    """Gains of the lags, factors e, b, d, and the gain at once, of direct part and lags."""
    system: tuple[Complex, Complex, Complex, Array]
    """Poles, output vectors (twice those of pairs), input vectors and feedthrough."""


@lru_cache(maxsize=8)  # a model that is stepped sample by sample needs them at each
def step_constants(
    model: CoupledDriveModel, time_constant: float = LEVEL_TIME_CONSTANT
) -> StepConstants:
    """Return the numbers of the steps of a model."""
    step, d, system = 1.0 / model.sample_rate_hz, model.drives, model.system
    pole, residue = mode_poles(d.frequency_hz, d.damping_ratio)
    e, before, after = straight_gains(pole, step)
    gains, b = 2.0 * d.compliance * residue, d.input_shapes
    lag_pole = -2.0 * np.pi * np.array(MEMORY_CORNERS_HZ)
    lag_e, lag_before, lag_after = straight_gains(lag_pole, step)
    lag_gains = -lag_pole * d.memory_gains[1:]
    # a pair of poles counts twice its real part
    twice = np.where(system.poles.imag > 0.0, 2.0, 1.0)
    share = 1.0 - float(np.exp(-step / time_constant))
    at_once = float(d.memory_gains[0] + lag_gains @ lag_after)
    return StepConstants(
        drives=(d.force_gains, d.strength, d.force_reference, d.voltage_reference),
        levels=(0.5 * d.exponent, 0.5 * VOLTAGE_EXPONENT, share),
        modes=(gains, e, before, after, b, b.T @ ((gains * after).real[:, None] * b)),
        lags=(lag_gains, lag_e, lag_before, lag_after, at_once),
        system=(
            system.poles,
            system.output_shapes * twice,
            system.input_shapes,
            system.feedthrough,
        ),
    )


@compiled
def _step_drives(  # type: ignore[no-untyped-def]
    u, target, bounds, constants, state, squares, readings
):
    """Step drives, modes in the loop and the linear system; states are changed in place.

    A target of the voltage and the additional voltage, of as many samples, replaces u.
    """
    lowest, highest, largest_step = bounds
    drives, levels, modes, lags, system = constants
    force_gains, strength, force_reference, voltage_reference = drives
    power, voltage_power, share = levels
    gain, e, before, after, b, direct = modes
    lag_gain, lag_e, lag_before, lag_after, at_once = lags
    poles, out, into, through = system
    linear, modal, total, lagging, lagged = state
    force_square, voltage_square, largest = squares
    m, k, p, n = u.shape[1], e.size, readings.shape[1], poles.size
    driven, force, softening, level = np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    loop = np.empty((m, m))
    for t in range(u.shape[0]):
        for a in range(m):
            softening[a] = strength[a] * (force_square[a] ** power - force_reference[a])
            level[a] = voltage_square[a] ** voltage_power - voltage_reference[a]
            force[a] = 0.0
            driven[a] = 0.0
            for q in range(lag_e.size):
                lagging[q, a] = lag_e[q] * lagging[q, a] + lag_before[q] * lagged[a]
                driven[a] += lag_gain[q] * lagging[q, a]
        for i in range(k):
            projected = 0.0
            for a in range(m):
                projected += b[i, a] * total[a]
            modal[i] = e[i] * modal[i] + before[i] * projected
            free = (gain[i] * modal[i]).real
            for a in range(m):
                force[a] += free * b[i, a]
        if target.shape[0] > 0:
            for a in range(m):
                value = force[a]
                for c in range(m):
                    value += direct[a, c] * target[t, c]
                    loop[a, c] = softening[a] * force_gains[a, c]
                loop[a, a] += 1.0 + at_once * level[a]
                u[t, a] = target[t, a] - driven[a] - softening[a] * value
            _solve_in_place(loop, u[t])
            for a in range(m):
                if t > 0:
                    u[t, a] = min(
                        max(u[t, a], u[t - 1, a] - largest_step), u[t - 1, a] + largest_step
                    )
                u[t, a] = min(max(u[t, a], lowest), highest)
        for a in range(m):
            lagged[a] = level[a] * u[t, a]
            driven[a] += u[t, a] + at_once * lagged[a]
            for q in range(lag_e.size):
                lagging[q, a] += lag_after[q] * lagged[a]
        for a in range(m):
            for c in range(m):
                force[a] += force_gains[a, c] * u[t, c] + direct[a, c] * driven[c]
                loop[a, c] = (1.0 if a == c else 0.0) - direct[a, c] * softening[c]
        _solve_in_place(loop, force)
        for a in range(m):
            total[a] = driven[a] + softening[a] * force[a]
            force_square[a] += share * (force[a] ** 2 - force_square[a])
            voltage_square[a] += share * (u[t, a] ** 2 - voltage_square[a])
            largest[a] = max(largest[a], voltage_square[a])
        for i in range(k):
            projected = 0.0
            for a in range(m):
                projected += b[i, a] * total[a]
            modal[i] += after[i] * projected
        for a in range(p):
            value = 0.0
            for c in range(m):
                value += through[a, c] * total[c]
            for i in range(n):
                value += (out[a, i] * linear[i]).real
            readings[t, a] = value
        for i in range(n):
            following = poles[i] * linear[i]
            for c in range(m):
                following += into[i, c] * total[c]
            linear[i] = following


@compiled
def _solve_in_place(matrix, values):  # type: ignore[no-untyped-def]
    """Solve a linear system that is near the identity, without pivots."""
    m = values.size
    for i in range(m):
        for row in range(i + 1, m):
            factor = matrix[row, i] / matrix[i, i]
            for c in range(i, m):
                matrix[row, c] -= factor * matrix[i, c]
            values[row] -= factor * values[i]
    for i in range(m - 1, -1, -1):
        for c in range(i + 1, m):
            values[i] -= matrix[i, c] * values[c]
        values[i] /= matrix[i, i]
