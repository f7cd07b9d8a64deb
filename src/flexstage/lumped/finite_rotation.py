r"""The lumped model with finite rotations: energy, forces and tangent stiffness.

Every hinge stores :math:`\tfrac12\mathbf x^T k\,\mathbf x` in the deformation
:math:`\mathbf x = (u, v, \vartheta)` that is seen from a frame turning with the *mean* rotation of
its two bodies (`flexstage.lumped.joint_kinematics`). Large rigid motion of the whole costs no
energy, forces are the exact gradient and the tangent the exact Hessian of one energy, and at rest
the tangent is the linear K. Masses are constant in these coordinates: T is quadratic with the
linear M.

Validity: finite rotations of bodies, hinge stiffness constant. The shortening of a long leaf that
bends into an S is not in a spring at its middle; for notches it is far below their elongation.
"""

from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.lumped.joint_kinematics import Connections, connections
from flexstage.lumped.rigid_bodies import Mechanism, Sight


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NonlinearMechanism:
    """A mechanism with finite rotations.

    Coordinates are those of `flexstage.lumped.lumped_system`: for each free body the displacement
    x, y of its centre of mass [m] and its rotation [rad].

    `q` may have leading axes, shape (..., n), where not one state alone, shape (n,), is asked for.
    """

    mechanism: Mechanism
    """Its bodies and springs."""
    mass: Array
    """Diagonal of M [kg, kg m^2], shape (n,)."""
    stiffness: Array
    """Stiffness of each hinge, shape (h, 3, 3)."""
    hinges: Connections
    """The hinges."""
    drives: Connections
    """The drives, in the order of the mechanism."""
    probes: Connections
    """The probes, in the order of the mechanism."""

    @property
    def order(self) -> int:
        """Number of coordinates n."""
        return self.mass.size

    def potential_energy(self, q: Array) -> Array:
        """Return the energy V stored in the hinges [J], shape (...)."""
        x = self.hinges.deformation(np.asarray(q, dtype=float))
        return 0.5 * np.einsum("...hi,hij,...hj->...", x, self.stiffness, x)

    def kinetic_energy(self, velocity: Array) -> Array:
        """Return the kinetic energy T [J], shape (...)."""
        return 0.5 * np.sum(self.mass * np.asarray(velocity) ** 2, axis=-1)

    def force(self, q: Array) -> Array:
        """Return the internal forces dV/dq [N, N m], shape (..., n)."""
        x, b = self.hinges.rates(np.asarray(q, dtype=float))
        spring = (self.stiffness @ x[..., None])[..., 0]
        local = (spring[..., None, :] @ b)[..., 0, :]
        return local.reshape(*local.shape[:-2], -1) @ self.hinges.gather

    def tangent(self, q: Array) -> Array:
        """Return the tangent stiffness d2V/dq2 at one state, shape (n, n)."""
        q = np.asarray(q, dtype=float)
        x, b = self.hinges.rates(q)
        spring = (self.stiffness @ x[..., None])[..., 0]
        local = np.swapaxes(b, -1, -2) @ self.stiffness @ b + self.hinges.curvature(q, spring)
        return _assembled(self.hinges, local)

    def elongation(self, drive: str, q: Array) -> tuple[float, Array, Array]:
        """Return the elongation of a drive and its first and second derivatives.

        Along the drive's direction, which turns with the body it stands on [m]; of one state, with
        gradient, shape (n,), and Hessian, shape (n, n).
        """
        i = _index("drive", drive, self.mechanism.drives)
        x, b = self.drives.rates(q)
        unit = np.zeros((self.drives.count, 3))
        unit[i, 0] = 1.0
        local = (unit[:, None, :] @ b)[:, 0, :]
        gradient = local.reshape(-1) @ self.drives.gather
        return float(x[i, 0]), gradient, _assembled(self.drives, self.drives.curvature(q, unit))

    def reading(self, probe: str, q: Array) -> Array:
        """Return what a probe sees.

        Displacement along and across its direction [m] and rotation of the body [rad], against the
        body it is read from, shape (..., 3).
        """
        i = _index("probe", probe, self.mechanism.probes)
        return self.probes.deformation(np.asarray(q, dtype=float))[..., i, :]


def nonlinear(mechanism: Mechanism) -> NonlinearMechanism:
    """Prepare a mechanism for finite rotations.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism, for instance from `flexstage.lumped.mechanism`.

    Returns
    -------
    NonlinearMechanism
        The model.

    Raises
    ------
    ModelError
        Every body is fixed.
    """
    free = [mechanism.bodies[i] for i in mechanism.free]
    if not free:
        raise ModelError(f"every body of '{mechanism.name}' is fixed: nothing can move")
    return NonlinearMechanism(
        mechanism=mechanism,
        mass=np.array([v for b in free for v in (b.mass, b.mass, b.inertia)]),
        stiffness=np.array([h.stiffness for h in mechanism.hinges]).reshape(-1, 3, 3),
        hinges=connections(
            mechanism,
            [h.bodies for h in mechanism.hinges],
            [(h.at, h.at) for h in mechanism.hinges],
            [h.direction for h in mechanism.hinges],
            share_a=0.5,
        ),
        drives=_sights(mechanism, mechanism.drives),
        probes=_sights(mechanism, mechanism.probes),
    )


def _sights(mechanism: Mechanism, sights: tuple[Sight, ...]) -> Connections:
    return connections(
        mechanism,
        [s.bodies for s in sights],
        [s.points for s in sights],
        [s.direction for s in sights],
        share_a=1.0,
    )


def _assembled(which: Connections, local: Array) -> Array:
    """Sum 6 x 6 blocks into an n x n matrix."""
    n = which.gather.shape[1]
    spread = which.gather.reshape(which.count, 6, n)
    total = which.gather.T @ (local @ spread).reshape(-1, n)
    return 0.5 * (total + total.T)


def _index(noun: str, name: str, sights: tuple[Sight, ...]) -> int:
    for i, sight in enumerate(sights):
        if sight.name == name:
            return i
    have = ", ".join(s.name for s in sights) or "none"
    raise ModelError(f"there is no {noun} '{name}': the mechanism has {have}")
