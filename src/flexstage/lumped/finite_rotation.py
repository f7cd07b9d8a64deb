r"""The lumped model with finite rotations: energy, forces and tangent stiffness.

A notch stores :math:`\tfrac12\mathbf x^T k\,\mathbf x` in the deformation
:math:`\mathbf x = (u, v, \vartheta)` in a frame turning with the *mean* rotation of its two bodies
(`Connections`). A leaf, which is a notch with a part of constant thickness, is a geometrically
exact beam (`flexstage.lumped.leaf`). Large rigid motion of the whole costs no energy, forces are
the exact gradient and the tangent the exact Hessian of one energy, and at rest the tangent is the
linear K. Masses are constant in these coordinates: T is quadratic with the linear M.

Validity: finite rotations of rigid bodies. The stiffness of a notch is constant, and its shortening
by bending, far below its elongation, is excluded; of leaves see there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.lumped.leaf import LeafState, LeafTangent, Leaves, leaves
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
    rigid motion of both, however large, leaves it unchanged. Notches use the *mean* rotation,
    :math:`w_a = w_b = 1/2`: it is the only choice that does not depend on which body is called a.
    Leaves, drives and probes use :math:`w_a = 1`: their direction is fixed in body a.
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

    @property
    def spread(self) -> Array:
        """The same as `gather` for each connection, shape (h, 6, n)."""
        return self.gather.reshape(self.count, 6, self.gather.shape[1])

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

    def deformation_rate(self, rates: Array, velocity: Array) -> Array:
        """Return the rate of each deformation for rates of the coordinates, shape (..., h, 3)."""
        local = (velocity @ self.gather.T).reshape(*velocity.shape[:-1], self.count, 6, 1)
        return (rates @ local)[..., 0]

    def gathered(self, force: Array, rates: Array) -> Array:
        """Return the forces on the coordinates of forces (N, V, M), shape (..., h, 3)."""
        local = (force[..., None, :] @ rates)[..., 0, :]
        return local.reshape(*local.shape[:-2], -1) @ self.gather

    def _state(
        self, q: Array
    ) -> tuple[Array, Array, tuple[Array, Array], tuple[Array, Array], Array]:
        local = (q @ self.gather.T).reshape(*q.shape[:-1], self.count, 6)
        theta_a, theta_b = local[..., 2], local[..., 5]
        moved_a, moved_b = _turn_change(theta_a, self.arm_a), _turn_change(theta_b, self.arm_b)
        moved = local[..., 3:5] - local[..., 0:2] + moved_b - moved_a
        d = moved + self.gap
        turn = self.share_a * theta_a + (1.0 - self.share_a) * theta_b
        angle = self.direction + turn
        cos, sin = np.cos(angle), np.sin(angle)
        rotated = _into(cos, sin, d)
        cos0, sin0 = np.cos(self.direction), np.sin(self.direction)
        x = np.empty((*local.shape[:-1], 3))
        # the gap is much longer than what it changes by: a difference of both would leave 1e-17 m,
        # which times the axial stiffness of a leaf is more than small loads are
        x[..., :2] = _into(cos, sin, moved) + _turn_change(-turn, _into(cos0, sin0, self.gap))
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


class LeafStep(NamedTuple):
    """Relation by which leaves follow a step of the bodies, to first order."""

    tangent: LeafTangent
    """Relation of their deformations."""
    rates: Array
    """Derivatives of the deformations by the coordinates of their bodies, shape (..., h, 3, 6)."""
    ends: Connections
    """Their ends."""

    def after(self, step: Array) -> LeafState:
        """Return the states of the leaves after a step of the bodies, shape (..., n)."""
        return self.tangent.after(self.ends.deformation_rate(self.rates, step))


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
    """Stiffness of each notch, shape (h, 3, 3)."""
    notches: Connections
    """The notches."""
    leaves: Leaves
    """The leaves, as beams."""
    leaf_ends: Connections
    """The ends of the leaves, in axes that turn with their bodies a."""
    drives: Connections
    """The drives, in the order of the mechanism."""
    probes: Connections
    """The probes, in the order of the mechanism."""

    @property
    def order(self) -> int:
        """Number of coordinates n."""
        return self.mass.size

    def leaf_states(self, q: Array) -> LeafState:
        """Return the states of the leaves.

        Raises
        ------
        ConvergenceError
            A leaf cannot be followed to its deformation.
        """
        return self.leaves.solve(self.leaf_ends.deformation(np.asarray(q, dtype=float)))

    def potential_energy(self, q: Array) -> Array:
        """Return the energy V stored in the hinges [J], shape (...)."""
        q = np.asarray(q, dtype=float)
        x = self.notches.deformation(q)
        energy = 0.5 * np.einsum("...hi,hij,...hj->...", x, self.stiffness, x)
        if self.leaves.count:
            energy = energy + self.leaves.energy(self.leaf_states(q))
        return energy

    def kinetic_energy(self, velocity: Array) -> Array:
        """Return the kinetic energy T [J], shape (...)."""
        return 0.5 * np.sum(self.mass * np.asarray(velocity) ** 2, axis=-1)

    def force(self, q: Array) -> Array:
        """Return the internal forces dV/dq [N, N m], shape (..., n)."""
        q = np.asarray(q, dtype=float)
        return self.damped_force(q, np.zeros_like(q), 0.0, self.leaf_states(q))[0]

    def damped_force(
        self, q: Array, velocity: Array, beta: float, state: LeafState
    ) -> tuple[Array, "LeafStep"]:
        """Return the forces of hinges with dampers of beta [s] times their tangent stiffness.

        The forces are those when the leaves have followed the bodies from their states. The dampers
        act on the rates of the deformations, so that rigid motion is not damped.
        """
        x, b = self.notches.rates(q)
        if beta:
            x = x + beta * self.notches.deformation_rate(b, velocity)
        force = self.notches.gathered((self.stiffness @ x[..., None])[..., 0], b)
        leaf = self.leaf_step(q, state)
        if self.leaves.count:
            spring = leaf.tangent.force
            if beta:
                rate = beta * self.leaf_ends.deformation_rate(leaf.rates, velocity)
                spring = spring + (leaf.tangent.stiffness @ rate[..., None])[..., 0]
            force = force + self.leaf_ends.gathered(spring, leaf.rates)
        return force, leaf

    def leaf_step(self, q: Array, state: LeafState) -> "LeafStep":
        """Linearise the leaves at their states and those of the bodies."""
        x, b = self.leaf_ends.rates(q)
        return LeafStep(self.leaves.tangent(state, x), b, self.leaf_ends)

    def tangent(self, q: Array) -> Array:
        """Return the tangent stiffness d2V/dq2 at one state, shape (n, n)."""
        q = np.asarray(q, dtype=float)
        return self.linearised(q, self.leaf_states(q))[0]

    def linearised(self, q: Array, state: LeafState) -> tuple[Array, Array, "LeafStep"]:
        """Linearise at one state of bodies and leaves.

        Returns the stiffness, shape (n, n), and the forces when the leaves have followed the
        bodies, shape (n,).
        """
        stiffness, force = np.zeros((self.order, self.order)), np.zeros(self.order)
        if self.notches.count:
            x, b = self.notches.rates(q)
            spring = (self.stiffness @ x[..., None])[..., 0]
            force += self.notches.gathered(spring, b)
            local = np.swapaxes(b, -1, -2) @ self.stiffness @ b + self.notches.curvature(q, spring)
            stiffness += _assembled(self.notches, local)
        leaf = self.leaf_step(q, state)
        if self.leaves.count:
            b = leaf.rates
            force += self.leaf_ends.gathered(leaf.tangent.force, b)
            local = np.swapaxes(b, -1, -2) @ leaf.tangent.stiffness @ b
            local += self.leaf_ends.curvature(q, state.force)
            stiffness += _assembled(self.leaf_ends, local)
        return stiffness, force, leaf

    def geometric_stiffness(self, q: Array, spring: Array, leaf: Array) -> Array:
        """Return the geometric stiffness by forces of notches and leaves as bodies turn.

        The forces are (N, V, M), shape (h, 3), the stiffness has shape (n, n).
        """
        return _assembled(self.notches, self.notches.curvature(q, spring)) + _assembled(
            self.leaf_ends, self.leaf_ends.curvature(q, leaf)
        )

    def hinge_stress(self, q: Array, state: LeafState) -> dict[str, Array]:
        """Return the largest equivalent stress in every hinge [Pa], each of shape (...).

        Of states of bodies and leaves; without the hinges whose rows of stress are not known.
        """
        x = self.notches.deformation(q)
        springs = np.moveaxis((self.stiffness @ x[..., None])[..., 0], -2, 0)
        sections = np.moveaxis(self.leaves.section_forces(state), -3, 0)
        notch, leaf = iter(springs), iter(sections)
        stress: dict[str, Array] = {}
        for hinge in self.mechanism.hinges:
            force = next(notch) if hinge.leaf is None else next(leaf)
            if hinge.stress is None:
                continue
            if hinge.leaf is None:
                values = force @ hinge.stress.T
            else:
                # two surfaces at each end, where the moment is that of the end
                axial, moment = (hinge.stress[:, i].reshape(2, 2) for i in (0, 2))
                values = force[..., 0, None] * axial + force[..., 1, None] * moment
                values = values.reshape(*values.shape[:-2], 4)
            stress[hinge.name] = np.max(np.abs(values), axis=-1)
        return stress

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
    notches = [h for h in mechanism.hinges if h.leaf is None]
    bent = [h for h in mechanism.hinges if h.leaf is not None]
    return NonlinearMechanism(
        mechanism=mechanism,
        mass=np.array([v for b in free for v in (b.mass, b.mass, b.inertia)]),
        stiffness=np.array([h.stiffness for h in notches]).reshape(-1, 3, 3),
        notches=connections(
            mechanism,
            [h.bodies for h in notches],
            [(h.at, h.at) for h in notches],
            [h.direction for h in notches],
            share_a=0.5,
        ),
        leaves=leaves(
            [h.leaf for h in bent if h.leaf is not None],
            np.array([h.stiffness for h in bent]).reshape(-1, 3, 3),
        ),
        leaf_ends=connections(
            mechanism,
            [h.bodies for h in bent],
            [h.ends for h in bent],
            [h.direction for h in bent],
            share_a=1.0,
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
    total = which.gather.T @ (local @ which.spread).reshape(which.gather.shape)
    return 0.5 * (total + total.T)
