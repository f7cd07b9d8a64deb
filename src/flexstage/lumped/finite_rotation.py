r"""The lumped model with finite rotations: energy, forces and tangent stiffness.

Every hinge stores :math:`\tfrac12\mathbf x^T k\,\mathbf x` in the deformation
:math:`\mathbf x = (u + s, v, \vartheta)` in a frame turning with the *mean* rotation of
its two bodies (`Connections`). A leaf shortens as it bends, by :math:`s = \tfrac12(c_v v^2 +
c_\vartheta\vartheta^2)` of the slopes of its deflection (`flexstage.hinges.deflection`): between
parallel ends by 3/5 v^2/l (S. Awtar, A. H. Slocum, E. Sevincer, J. Mech. Des. 129 (2007) 625).
Large rigid motion of the whole costs no energy, forces are the exact gradient and the tangent the
exact Hessian of one energy, and at rest the tangent is the linear K. Masses are constant in these
coordinates: T is quadratic with the linear M.

Validity: finite rotations of bodies, hinge stiffness constant; shortening to second order in the
deformation, without what axial forces change of the deflection. That of notches is far below their
elongation and excluded.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.lumped.rigid_bodies import Mechanism, Sight


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Connections:
    r"""Connections of a mechanism under finite motion, all evaluated at once.

    Bodies a and b carry the points a and b. With the displacement :math:`\mathbf u` of each centre
    of mass, its rotation :math:`\theta` and the lever arm :math:`\mathbf r` from it to the point,

    .. math::

        \mathbf d = \mathbf d_0 + \mathbf u_b - \mathbf u_a + (R(\theta_b) - I)\mathbf r_b
                  - (R(\theta_a) - I)\mathbf r_a,\qquad
        \mathbf e = R(\varphi + w_a\theta_a + w_b\theta_b)^T \mathbf d,\qquad
        \vartheta = \theta_b - \theta_a .

    The deformation is seen in a frame that turns with the bodies (:math:`w_a + w_b = 1`), so a
    rigid motion of both, however large, leaves it unchanged. Hinges use the *mean* rotation,
    :math:`w_a = w_b = 1/2`: it is the only choice that does not depend on which body is called a.
    Drives and probes use :math:`w_a = 1`: their direction is fixed in the body they react on.
    """

    gather: Array
    """Maps the n coordinates to (x, y, theta) of a and of b for each connection, shape (6 h, n)."""
    arm_a: Array
    """Lever arms from the centres of mass to the points a [m], shape (h, 2)."""
    arm_b: Array
    """Lever arms from the centres of mass to the points b [m], shape (h, 2)."""
    gap: Array
    """Point b from point a, undeformed [m], shape (h, 2)."""
    direction: Array
    """Direction of the connection, undeformed [rad], shape (h,)."""
    share_a: float
    """Share w_a of the rotation of a in that of the frame [1]; b has the rest."""

    @property
    def count(self) -> int:
        """Number of connections h."""
        return self.direction.size

    def deformation(self, q: Array) -> Array:
        """Return along, across and rotation of each connection [m, m, rad], shape (..., h, 3)."""
        return self._state(q)[0]

    def rates(self, q: Array) -> tuple[Array, Array]:
        """Return the reading of each connection and its derivatives.

        The readings have shape (..., h, 3), the derivatives with respect to the six coordinates of
        a and b (..., h, 3, 6).
        """
        x, _, (cos, sin), (turned_a, turned_b), rotated = self._state(q)
        shares = (self.share_a, 1.0 - self.share_a)
        # R^T S r and the part of the frame's own turning, -w S e
        b = np.zeros((*x.shape, 6))
        rotation_t = np.stack((np.stack((cos, sin), -1), np.stack((-sin, cos), -1)), -2)
        b[..., :2, 0:2] = -rotation_t
        b[..., :2, 3:5] = rotation_t
        b[..., :2, 2] = -_quarter(turned_a) - shares[0] * _quarter(rotated)
        b[..., :2, 5] = _quarter(turned_b) - shares[1] * _quarter(rotated)
        b[..., 2, 2], b[..., 2, 5] = -1.0, 1.0
        return x, b

    def curvature(self, q: Array, force: Array) -> Array:
        """Contract the second derivatives of the deformation with forces.

        Of forces (N, V, M), shape (..., h, 3), the geometric stiffness for the six coordinates of a
        and b, shape (..., h, 6, 6).
        """
        x, _, (cos, sin), (turned_a, turned_b), rotated = self._state(q)
        wa, wb = self.share_a, 1.0 - self.share_a
        f = force[..., :2]

        def dot(v: Array) -> Array:
            return np.sum(f * v, axis=-1)

        out = np.zeros((*x.shape[:-1], 6, 6))
        # f . (S R^T) as a row: the derivative of e by a translation and a rotation
        row = np.stack(
            (-sin * f[..., 0] - cos * f[..., 1], cos * f[..., 0] - sin * f[..., 1]), axis=-1
        )
        # (S R^T) = [[s, -c], [c, s]]; a translates with +w S R^T, b with -w S R^T
        for start, sign in ((0, -1.0), (3, 1.0)):
            for column, share in ((2, wa), (5, wb)):
                out[..., start : start + 2, column] = sign * share * row
                out[..., column, start : start + 2] = sign * share * row
        out[..., 2, 2] = dot((1.0 - 2.0 * wa) * turned_a - wa**2 * rotated)
        out[..., 5, 5] = dot((2.0 * wb - 1.0) * turned_b - wb**2 * rotated)
        out[..., 2, 5] = dot(wa * turned_b - wb * turned_a - wa * wb * rotated)
        out[..., 5, 2] = out[..., 2, 5]
        return out

    def _state(
        self, q: Array
    ) -> tuple[Array, Array, tuple[Array, Array], tuple[Array, Array], Array]:
        local = (q @ self.gather.T).reshape(*q.shape[:-1], self.count, 6)
        theta_a, theta_b = local[..., 2], local[..., 5]
        moved_a, moved_b = _turn_change(theta_a, self.arm_a), _turn_change(theta_b, self.arm_b)
        d = local[..., 3:5] - local[..., 0:2] + moved_b - moved_a + self.gap
        angle = self.direction + self.share_a * theta_a + (1.0 - self.share_a) * theta_b
        cos, sin = np.cos(angle), np.sin(angle)
        rotated = _into(cos, sin, d)
        cos0, sin0 = np.cos(self.direction), np.sin(self.direction)
        x = np.empty((*local.shape[:-1], 3))
        x[..., :2] = rotated - _into(cos0, sin0, self.gap)
        x[..., 2] = theta_b - theta_a
        turned = (
            _into(cos, sin, self.arm_a + moved_a),
            _into(cos, sin, self.arm_b + moved_b),
        )
        return x, d, (cos, sin), turned, rotated


def connections(
    mechanism: Mechanism,
    bodies: Sequence[tuple[int, int]],
    points: Sequence[tuple[tuple[float, float], tuple[float, float]]],
    direction: Sequence[float],
    *,
    share_a: float,
) -> Connections:
    """Prepare connections of a mechanism.

    `bodies` are indices of a and b, -1 for the ground, `points` those on a and b [m], and
    `direction` is in rad.
    """
    column = {body: 3 * k for k, body in enumerate(mechanism.free)}
    h = len(direction)
    gather = np.zeros((h, 6, mechanism.order))
    arms = np.zeros((2, h, 2))
    for i, (pair, ends) in enumerate(zip(bodies, points, strict=True)):
        for side in (0, 1):
            # the ground and held bodies do not move: their lever arms never matter
            if pair[side] in column:
                k = column[pair[side]]
                gather[i, 3 * side : 3 * side + 3, k : k + 3] = np.eye(3)
                arms[side, i] = np.subtract(ends[side], mechanism.bodies[pair[side]].centre)
    ends_array = np.array(points, dtype=float).reshape(h, 2, 2)
    return Connections(
        gather=gather.reshape(6 * h, mechanism.order),
        arm_a=arms[0],
        arm_b=arms[1],
        gap=ends_array[:, 1] - ends_array[:, 0],
        direction=np.array(direction, dtype=float),
        share_a=share_a,
    )


def _into(cos: Array, sin: Array, v: Array) -> Array:
    """Return R^T v."""
    return np.stack((cos * v[..., 0] + sin * v[..., 1], cos * v[..., 1] - sin * v[..., 0]), -1)


def _quarter(v: Array) -> Array:
    """Return v turned left by a quarter."""
    return np.stack((-v[..., 1], v[..., 0]), axis=-1)


def _turn_change(theta: Array, r: Array) -> Array:
    """Return (R(theta) - I) r without cancellation for small angles."""
    versine, sin = 2.0 * np.sin(0.5 * theta) ** 2, np.sin(theta)
    x, y = r[..., 0], r[..., 1]
    return np.stack((-versine * x - sin * y, sin * x - versine * y), axis=-1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NonlinearMechanism:
    """A mechanism with finite rotations.

    Coordinates are those of `flexstage.lumped.lumped_system`: for each free body the displacement
    x, y of its centre of mass [m] and its rotation [rad].

    `q` may have leading axes, shape (..., n), where not one state alone, shape (n,), is asked for.
    """

    mechanism: Mechanism
    """Bodies and springs."""
    mass: Array
    """Diagonal of M [kg, kg m^2], shape (n,)."""
    stiffness: Array
    """Stiffness of each hinge, shape (h, 3, 3)."""
    shortening: Array
    """Shortening of each hinge over half the square of its deformation across [1/m] and in rotation
    [m], shape (h, 2).
    """
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

    def _strained(self, q: Array) -> tuple[Array, Array]:
        """Return the deformation of each hinge, elongated by its bending, and its derivatives."""
        x, b = self.hinges.rates(np.asarray(q, dtype=float))
        bent = self.shortening * x[..., 1:]
        x[..., 0] += 0.5 * np.sum(bent * x[..., 1:], axis=-1)
        b[..., 0, :] += (bent[..., None, :] @ b[..., 1:, :])[..., 0, :]
        return x, b

    def potential_energy(self, q: Array) -> Array:
        """Return the energy V stored in the hinges [J], shape (...)."""
        x, _ = self._strained(q)
        return 0.5 * np.einsum("...hi,hij,...hj->...", x, self.stiffness, x)

    def kinetic_energy(self, velocity: Array) -> Array:
        """Return the kinetic energy T [J], shape (...)."""
        return 0.5 * np.sum(self.mass * np.asarray(velocity) ** 2, axis=-1)

    def force(self, q: Array) -> Array:
        """Return the internal forces dV/dq [N, N m], shape (..., n)."""
        x, b = self._strained(q)
        spring = (self.stiffness @ x[..., None])[..., 0]
        local = (spring[..., None, :] @ b)[..., 0, :]
        return local.reshape(*local.shape[:-2], -1) @ self.hinges.gather

    def geometric_stiffness(self, q: Array, spring: Array) -> Array:
        """Return the geometric stiffness by forces of the hinges at a state.

        The forces are (N, V, M), shape (h, 3), the stiffness has shape (n, n).
        """
        return _assembled(self.hinges, self.hinges.curvature(np.asarray(q, dtype=float), spring))

    def deformation_rates(self, q: Array) -> Array:
        """Return the derivatives of each hinge's deformation at one state, shape (h, 3, n)."""
        _, b = self.hinges.rates(np.asarray(q, dtype=float))
        return b @ self.hinges.gather.reshape(self.hinges.count, 6, self.order)

    def tangent(self, q: Array) -> Array:
        """Return the tangent stiffness d2V/dq2 at one state, shape (n, n)."""
        q = np.asarray(q, dtype=float)
        x, b = self._strained(q)
        spring = (self.stiffness @ x[..., None])[..., 0]
        bending, tension = b[..., 1:, :], spring[..., :1] * self.shortening
        local = np.swapaxes(b, -1, -2) @ self.stiffness @ b
        local += np.swapaxes(bending, -1, -2) @ (tension[..., None] * bending)
        spring[..., 1:] += tension * x[..., 1:]
        return _assembled(self.hinges, local + self.hinges.curvature(q, spring))

    def elongation(self, drive: str, q: Array) -> tuple[float, Array, Array]:
        """Return the elongation of a drive and its first and second derivatives.

        Along the drive's direction, which turns with the body it reacts on [m]; of one state, with
        gradient, shape (n,), and Hessian, shape (n, n).
        """
        i = self.mechanism.drives.index(self.mechanism.drive(drive))
        x, b = self.drives.rates(q)
        unit = np.zeros((self.drives.count, 3))
        unit[i, 0] = 1.0
        local = (unit[:, None, :] @ b)[:, 0, :]
        gradient = local.reshape(-1) @ self.drives.gather
        return float(x[i, 0]), gradient, _assembled(self.drives, self.drives.curvature(q, unit))

    def reading(self, probe: str, q: Array) -> Array:
        """Return the motion at a probe.

        Displacement along and across its direction [m] and rotation of the body [rad], against the
        body it is read from, shape (..., 3).
        """
        i = self.mechanism.probes.index(self.mechanism.probe(probe))
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
        shortening=np.array([h.shortening for h in mechanism.hinges]).reshape(-1, 2),
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
        [s.direction or 0.0 for s in sights],
        share_a=1.0,
    )


def _assembled(which: Connections, local: Array) -> Array:
    """Sum 6 x 6 blocks into an n x n matrix."""
    n = which.gather.shape[1]
    spread = which.gather.reshape(which.count, 6, n)
    total = which.gather.T @ (local @ spread).reshape(-1, n)
    return 0.5 * (total + total.T)
