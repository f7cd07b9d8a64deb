"""The first-order form of a system, for control."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import ModelError
from flexstage.system.mechanical import DriveCondition, MechanicalSystem
from flexstage.system.modes import modes

if TYPE_CHECKING:
    import control

__all__ = ["StateSpace", "state_space"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateSpace:
    """x' = A x + B u, y = C x + D u in modal coordinates.

    Parameters
    ----------
    A : numpy.ndarray
        State matrix, shape (2k, 2k): modal coordinates, then their rates.
    B : numpy.ndarray
        Input matrix, shape (2k, m).
    C : numpy.ndarray
        Output matrix, shape (p, 2k).
    D : numpy.ndarray
        Feedthrough, shape (p, m).
    inputs : tuple of str
        Name and unit of each input.
    outputs : tuple of str
        Name and unit of each output.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

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
        try:
            import control  # optional, and slow to import
        except ImportError as error:
            raise ModelError(
                "python-control is not installed: pip install 'flexstage[control]'"
            ) from error
        made: Any = control.ss(
            self.A, self.B, self.C, self.D, inputs=list(self.inputs), outputs=list(self.outputs)
        )
        return made


def state_space(
    system: MechanicalSystem, *, drives: DriveCondition = "in place", count: int | None = None
) -> StateSpace:
    """Return the first-order form of a system.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    drives : str
        ``removed``: inputs are forces [N]; ``in place``: inputs are free displacements [m] of the
        drives that have a stiffness, and forces [N] of those that are pure forces.
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
        The drives are locked, or one in place is rigid.
    """
    if drives == "locked":
        raise ModelError("a state space needs the drives removed or in place, got 'locked'")
    every = modes(system, drives=drives, count=None)
    k = every.omega.size if count is None else min(count, every.omega.size)
    columns, names = [], []
    for d in system.drives:
        gain, unit = 1.0, "N"
        if drives == "in place" and d.stiffness != 0.0:
            if d.stiffness is None:
                raise ModelError(f"drive '{d.name}' is rigid: give it a stiffness to command it")
            gain, unit = d.stiffness, "m"
        columns.append(gain * d.vector)
        names.append(f"{d.name} [{unit}]")
    b = every.shapes.T @ np.array(columns).reshape(len(columns), system.order).T
    c = np.array([p.vector for p in system.probes]).reshape(-1, system.order) @ every.shapes
    omega, zeta = every.omega[:k], every.damping_ratio[:k]
    feed = c[:, k:] @ (b[k:] / every.omega[k:, None] ** 2)
    zero, one = np.zeros((k, k)), np.eye(k)
    return StateSpace(
        A=np.block([[zero, one], [-np.diag(omega**2), -np.diag(2.0 * zeta * omega)]]),
        B=np.vstack((np.zeros((k, b.shape[1])), b[:k])),
        C=np.hstack((c[:, :k], np.zeros((c.shape[0], k)))),
        D=feed,
        inputs=tuple(names),
        outputs=tuple(f"{p.name} [{p.unit}]" for p in system.probes),
    )
