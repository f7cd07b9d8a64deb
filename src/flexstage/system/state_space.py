"""The first-order form of a system, for control."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.lazy import require_extra
from flexstage.short_repr import short_repr
from flexstage.system.mechanical import DriveCondition, MechanicalSystem
from flexstage.system.modes import modes
from flexstage.system.statics import imposed_shape

if TYPE_CHECKING:
    import control


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateSpace:
    """x' = A x + B u, y = C x + D u in modal coordinates."""

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

        made: Any = control.ss(
            self.A, self.B, self.C, self.D, inputs=list(self.inputs), outputs=list(self.outputs)
        )
        return made


def state_space(
    system: MechanicalSystem, *, drives: DriveCondition = "in place", count: int | None = None
) -> StateSpace:
    r"""Return the first-order form of a system.

    Each mode follows :math:`\eta'' + 2\zeta\omega\eta' + \omega^2\eta = \omega^2 g w`. A rigid
    drive in place imposes its displacement w, and :math:`2\zeta\omega g w'` is added; with
    :math:`x_2 = \eta' - 2\zeta\omega g w` no rate of the input is left:

    .. math:: \eta' = x_2 + 2\zeta\omega g w, \quad
              x_2' = -\omega^2\eta - 2\zeta\omega x_2 + (1 - 4\zeta^2)\,\omega^2 g w

    and what the static shape holds beyond the kept modes is feedthrough.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    drives : str
        ``removed``: inputs are forces [N]; ``in place``: inputs are free displacements [m] of the
        drives that have a stiffness, imposed displacements [m] of those that are rigid, and forces
        [N] of those that are pure forces.
    count : int, optional
        Number of modes that are kept, all where not given; what the others would add statically is
        kept as feedthrough.

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
            gain = every.shapes[:, :k].T @ (system.M @ shape)
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
