"""Frequency response and time response of a system, by its modes, and its first-order form."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.lazy import require_extra
from flexstage.base.short_repr import short_repr
from flexstage.system.mechanical import DriveCondition, DrivePort, MechanicalSystem
from flexstage.system.modes import Modes, modes
from flexstage.system.statics import imposed_shape

if TYPE_CHECKING:
    import control


# Above this damping ratio, and below this angle of a mode in one step [rad], the closed form of a
# step loses digits or does not exist.
_NEARLY_CRITICAL = 0.999
_SHORT = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrequencyResponse:
    """Response of one probe to one drive over frequency."""

    frequency_hz: Array
    """Frequencies [Hz], shape (k,)."""
    value: NDArray[np.complex128]
    """Complex response in `unit`, shape (k,)."""
    drive: str
    """The drive."""
    probe: str
    """The probe."""
    drives: DriveCondition
    """Condition of the drives."""
    input_kind: str
    """``force``, or ``free displacement`` of a drive in place."""
    unit: str
    """Unit of `value`."""

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimeResponse:
    """Response over time."""

    time: Array
    """Times [s], shape (k,)."""
    q: Array
    """Coordinates, shape (k, n)."""
    velocity: Array
    """Their rates, shape (k, n)."""
    readings: dict[str, Array]
    """Reading of each probe [m], shape (k,)."""

    __repr__ = short_repr


# Frequencies that are spread evenly in the logarithm, and modes that are to be seen.
_SPREAD, _MODES_SHOWN = 600, 6


def default_frequencies_hz(result: Modes) -> Array:
    """Return frequencies that resolve the lowest modes, denser at each resonance."""
    resonances = result.frequency_hz[:_MODES_SHOWN]
    resonances = resonances[resonances > 0.0]
    if resonances.size == 0:
        return np.geomspace(1.0, 1e4, _SPREAD)
    spread = np.geomspace(resonances[0] / 30.0, resonances[-1] * 1.5, _SPREAD)
    width = np.maximum(result.damping_ratio[: resonances.size], 1e-4)[:, None]
    near = resonances[:, None] * (1.0 + width * np.linspace(-6.0, 6.0, 61))
    return np.unique(np.concatenate((spread, near[near > 0.0].ravel())))


def frequency_response(
    system: MechanicalSystem,
    frequency_hz: ArrayLike,
    drive: str,
    probe: str,
    *,
    drives: DriveCondition = "removed",
) -> FrequencyResponse:
    r"""Return the response of a probe to a drive.

    With the drives removed the input is a force. With the drives in place it is the free
    displacement of the drive, which acts through the drive's own stiffness.

    .. math:: H(\omega) = \sum_i \frac{(p^T\phi_i)(\phi_i^T b)}
              {\omega_i^2 - \omega^2 + 2 i\zeta_i\omega_i\omega}

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    frequency_hz : array_like
        Frequencies [Hz], shape (k,).
    drive : str
        The drive that is excited.
    probe : str
        The probe that is read.
    drives : str
        ``removed`` or ``in place``.

    Returns
    -------
    FrequencyResponse
        The response.

    Raises
    ------
    ModelError
        The drives are locked; a rigid drive in place imposes its displacement, whose response is
        found with ``drives="in place"``.
    """
    f = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    if drives not in ("removed", "in place"):
        raise ModelError(
            f"a frequency response needs the drives removed or in place, got '{drives}'"
        )
    return response_of_modes(system, modes(system, drives=drives, count=None), f, drive, probe)


def response_of_modes(
    system: MechanicalSystem, result: Modes, f: Array, drive: str, probe: str
) -> FrequencyResponse:
    """Return the response of a probe to a drive by all modes, drives removed or in place."""
    port, reader, drives = system.drive(drive), system.probe(probe), result.drives
    if drives == "in place" and port.stiffness is None:
        value = _imposed(system, port, reader.vector, f, result)
        kind, unit = "free displacement", f"{reader.unit}/m"
    else:
        gain = 1.0
        kind, unit = "force", f"{reader.unit}/N"
        if drives == "in place" and port.stiffness:
            gain, kind, unit = port.stiffness, "free displacement", f"{reader.unit}/m"
        weight = gain * (reader.vector @ result.shapes) * (port.vector @ result.shapes)
        value = sum_of_modes(result, weight, f)
    return FrequencyResponse(
        frequency_hz=f,
        value=value,
        drive=drive,
        probe=probe,
        drives=drives,
        input_kind=kind,
        unit=unit,
    )


def modal_response(
    result: Modes, readers: Array, forces: Array, frequency_hz: Array
) -> NDArray[np.complex128]:
    r"""Return the response of readings to forces by all modes of a result.

    .. math:: H(\omega) = \sum_i \frac{(p^T\phi_i)(\phi_i^T b)}
              {\omega_i^2 - \omega^2 + 2 i\zeta_i\omega_i\omega}

    Parameters
    ----------
    result : Modes
        The modes.
    readers : numpy.ndarray
        Reading of each coordinate, one reading a row, shape (p, n).
    forces : numpy.ndarray
        Force on each coordinate for a unit input, one input a row, shape (s, n).
    frequency_hz : numpy.ndarray
        Frequencies [Hz], shape (k,).

    Returns
    -------
    numpy.ndarray
        The response of each reading to each input, shape (p, s, k).
    """
    omega = 2.0 * np.pi * frequency_hz
    natural = result.omega[:, None]
    dynamic = natural**2 - omega**2 + 2j * result.damping_ratio[:, None] * natural * omega
    weight = (readers @ result.shapes)[:, None, :] * (forces @ result.shapes)
    return weight @ (1.0 / dynamic)


def sum_of_modes(result: Modes, weight: Array, f: Array) -> NDArray[np.complex128]:
    """Return the response of all modes at frequencies [Hz], shape (k,), by their weights (n,)."""
    omega = 2.0 * np.pi * f[:, None]
    natural = result.omega[None, :]
    dynamic = natural**2 - omega**2 + 2j * result.damping_ratio[None, :] * natural * omega
    return np.sum(weight / dynamic, axis=1)


def _imposed(
    system: MechanicalSystem, drive: DrivePort, probe: Array, f: Array, constraints: Modes
) -> NDArray[np.complex128]:
    """Response to an imposed elongation: its static shape, and modes that hold the drive."""
    shape = imposed_shape(system, drive)
    omega = 2.0 * np.pi * f
    weight = (probe @ constraints.shapes) * (
        constraints.shapes.T @ (system.mass_matrix("in place") @ shape)
    )
    return probe @ shape + omega**2 * sum_of_modes(constraints, weight, f)


def time_response(
    system: MechanicalSystem,
    time: ArrayLike,
    inputs: Mapping[str, ArrayLike],
    *,
    drives: DriveCondition = "in place",
    q0: ArrayLike | None = None,
    velocity0: ArrayLike | None = None,
) -> TimeResponse:
    """Return the motion under inputs that are straight lines between the given times.

    Each mode is stepped by its exact solution, so the step size adds no error.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    time : array_like
        Times, rising [s], shape (k,).
    inputs : Mapping
        For each drive its force [N] (drives removed) or free displacement [m] (drives in place),
        shape (k,).
    drives : str
        ``removed`` or ``in place``; a rigid drive cannot be in place here.
    q0 : array_like, optional
        Coordinates at the first time, shape (n,); zero where not given.
    velocity0 : array_like, optional
        Their rates at the first time, shape (n,); zero where not given.

    Returns
    -------
    TimeResponse
        The motion at the given times.

    Raises
    ------
    ModelError
        The times do not increase, a shape does not fit, or a rigid drive is in place.
    """
    t = np.asarray(time, dtype=np.float64)
    if t.ndim != 1 or t.size < 2 or not np.all(np.diff(t) > 0.0):
        raise ModelError("a time response needs at least two times, in increasing order")
    if drives == "locked":
        raise ModelError("a time response needs the drives removed or in place, got 'locked'")
    result = modes(system, drives=drives, count=None)
    force = np.zeros((t.size, result.omega.size))
    for name, values in inputs.items():
        port = system.drive(name)
        u = np.asarray(values, dtype=np.float64)
        if u.shape != t.shape:
            raise ModelError(f"the input of '{name}' must have shape {t.shape}, got {u.shape}")
        gain: float | None = 1.0
        if drives == "in place" and port.stiffness != 0.0:
            gain = port.stiffness
        if gain is None:
            raise ModelError(
                f"drive '{name}' is rigid: give it a stiffness to command its displacement in time"
            )
        force += np.outer(u, gain * (port.vector @ result.shapes))
    modal = system.mass_matrix(drives) @ result.shapes
    z = np.zeros((t.size, result.omega.size))
    v = np.zeros_like(z)
    if q0 is not None:
        z[0] = np.asarray(q0, dtype=np.float64) @ modal
    if velocity0 is not None:
        v[0] = np.asarray(velocity0, dtype=np.float64) @ modal
    _step_modes(t, result, force, z, v)
    q = z @ result.shapes.T
    return TimeResponse(
        time=t,
        q=q,
        velocity=v @ result.shapes.T,
        readings={p.name: q @ p.vector for p in system.probes},
    )


def _step_modes(t: Array, result: Modes, force: Array, z: Array, v: Array) -> None:
    """Fill z and v by the exact solution of each mode for a force that is linear in each step."""
    steps = np.diff(t)
    # equal steps share their coefficients; differences below rounding of the times are equal
    key = np.round(steps / (np.finfo(float).eps * 4.0 * max(abs(t[-1]), abs(t[0]))))
    previous, c = None, None
    for k, h in enumerate(steps):
        if c is None or key[k] != previous:
            c, previous = _coefficients(result.omega, result.damping_ratio, float(h)), key[k]
        rate = (force[k + 1] - force[k]) / h
        z[k + 1] = c[0] * z[k] + c[1] * v[k] + c[2] * force[k] + c[3] * rate
        v[k + 1] = c[4] * z[k] + c[5] * v[k] + c[1] * force[k] + c[2] * rate


def _coefficients(omega: Array, zeta: Array, h: float) -> tuple[Array, ...]:
    """Exact step of z'' + 2 zeta omega z' + omega^2 z = f0 + rate t.

    With g the impulse response, z = (g' + 2 zeta omega g) z0 + g v0 + G1 f0 + G2 rate, where G1 and
    G2 are the first and second integral of g.
    """
    hard = (zeta > _NEARLY_CRITICAL) | (omega * h < _SHORT)
    out = np.empty((6, omega.size))
    out[:, ~hard] = _oscillating(omega[~hard], zeta[~hard], h)
    if hard.any():
        out[:, hard] = _by_exponential(omega[hard], zeta[hard], h)
    return tuple(out)


def _oscillating(omega: Array, zeta: Array, h: float) -> Array:
    a = zeta * omega
    damped = omega * np.sqrt(1.0 - zeta**2)
    decay = np.exp(-a * h)
    g = h * decay * np.sinc(damped * h / np.pi)
    cos = decay * np.cos(damped * h)
    dg = cos - a * g
    g1 = (1.0 - cos - a * g) / omega**2
    g2 = (h - 2.0 * a * g1 - g) / omega**2
    return np.array((dg + 2.0 * a * g, g, g1, g2, -(omega**2) * g, dg))


def _by_exponential(omega: Array, damping_ratio: Array, h: float) -> Array:
    """The same from the exponential of the matrix of (z, h z', h^2 f, h^3 rate).

    C. F. Van Loan, IEEE Trans. Autom. Control 23 (1978) 395.
    """
    from scipy.linalg import expm

    matrix = np.zeros((omega.size, 4, 4))
    matrix[:, 0, 1] = matrix[:, 1, 2] = matrix[:, 2, 3] = 1.0
    matrix[:, 1, 0] = -((omega * h) ** 2)
    matrix[:, 1, 1] = -2.0 * damping_ratio * omega * h
    e: Array = np.asarray(expm(matrix), dtype=np.float64)
    return np.array(
        (
            e[:, 0, 0],
            h * e[:, 0, 1],
            h**2 * e[:, 0, 2],
            h**3 * e[:, 0, 3],
            e[:, 1, 0] / h,
            e[:, 1, 1],
        )
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateSpace:
    """x' = A x + B u, y = C x + D u in modal coordinates, or its form between samples."""

    A: Array
    """State matrix, shape (2k, 2k): modal coordinates, then their rates; where a displacement g w
    of a mode is imposed, its rate less ``2 zeta omega g w``.
    """
    B: Array
    """Input matrix, shape (2k, m)."""
    C: Array
    """Output matrix, shape (p, 2k)."""
    D: Array
    """Feedthrough, shape (p, m)."""
    inputs: tuple[str, ...]
    """Name and unit of each input."""
    outputs: tuple[str, ...]
    """Name and unit of each output."""
    step: float = 0.0
    """Step between samples [s], where x' is the state after it; 0 for the derivative."""

    __repr__ = short_repr

    def to_control(self) -> "control.StateSpace":
        """Return it as an object of the python-control library.

        Returns
        -------
        control.StateSpace
            The same system with named inputs and outputs.

        Raises
        ------
        ModelError
            python-control is not installed.
        """
        require_extra("control", "control", "a state space of python-control", ModelError)
        import control  # slow to import

        names = {"inputs": list(self.inputs), "outputs": list(self.outputs)}
        system: Any = control.ss(self.A, self.B, self.C, self.D, self.step, **names)
        return system


def state_space(
    system: MechanicalSystem, *, drives: DriveCondition = "in place", count: int | None = None
) -> StateSpace:
    r"""Return the first-order form of a system.

    Each mode follows :math:`\eta'' + 2\zeta\omega\eta' + \omega^2\eta = \omega^2 g w`. A rigid
    drive in place imposes its displacement w, and :math:`2\zeta\omega g w'` is added; with
    :math:`x_2 = \eta' - 2\zeta\omega g w` no rate of the input is left:

    .. math:: \eta' = x_2 + 2\zeta\omega g w, \quad
              x_2' = -\omega^2\eta - 2\zeta\omega x_2 + (1 - 4\zeta^2)\,\omega^2 g w

    and the static shape beyond the retained modes is feedthrough.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    drives : str
        ``removed``: inputs are forces [N]; ``in place``: inputs are free displacements [m] of the
        drives that have a stiffness, imposed displacements [m] of those that are rigid, and forces
        [N] of those that are pure forces.
    count : int, optional
        Number of retained modes, all where not given; the static contribution of the others is
        feedthrough.

    Returns
    -------
    StateSpace
        The form.

    Raises
    ------
    ModelError
        The drives are locked.
    """
    if drives == "locked":
        raise ModelError("a state space needs the drives removed or in place, got 'locked'")
    every = modes(system, drives=drives, count=None)
    k = every.omega.size if count is None else min(count, every.omega.size)
    omega, zeta = every.omega[:k], every.damping_ratio[:k]
    c = np.array([p.vector for p in system.probes]).reshape(-1, system.order) @ every.shapes
    lower = np.zeros((k, len(system.drives)))
    upper, feed = np.zeros_like(lower), np.zeros((c.shape[0], len(system.drives)))
    names = []
    for i, d in enumerate(system.drives):
        if drives == "in place" and d.stiffness is None:
            shape = imposed_shape(system, d)
            gain = every.shapes[:, :k].T @ (system.mass_matrix(drives) @ shape)
            upper[:, i] = 2.0 * zeta * omega * gain
            lower[:, i] = (1.0 - 4.0 * zeta**2) * omega**2 * gain
            feed[:, i] = [p.vector @ shape for p in system.probes] - c[:, :k] @ gain
            names.append(f"{d.name} [m]")
            continue
        # a pure force acts as it is, and so does every drive that is removed
        stiffness = d.stiffness if drives == "in place" else None
        force = (stiffness or 1.0) * (d.vector @ every.shapes)
        lower[:, i] = force[:k]
        feed[:, i] = c[:, k:] @ (force[k:] / every.omega[k:] ** 2)
        names.append(f"{d.name} [{'m' if stiffness else 'N'}]")
    zero, one = np.zeros((k, k)), np.eye(k)
    return StateSpace(
        A=np.block([[zero, one], [-np.diag(omega**2), -np.diag(2.0 * zeta * omega)]]),
        B=np.vstack((upper, lower)),
        C=np.hstack((c[:, :k], np.zeros((c.shape[0], k)))),
        D=feed,
        inputs=tuple(names),
        outputs=tuple(f"{p.name} [{p.unit}]" for p in system.probes),
    )
