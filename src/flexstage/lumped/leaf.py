r"""Leaves that bend far: the geometrically exact beam in the plane, by modes of its moment.

A leaf is a beam between two elastic roots. Its bending moment M is a polynomial of the arc length
s, its axial force N and shear force V are constant along it. The sections turn by
:math:`\theta(s) = \alpha_a + \int_0^s M/EI\,ds`, and the place of end b in axes of body a follows
from them without an approximation of the geometry,

.. math::

    \mathbf h(p) = \mathbf u_a + \int_0^l R(\theta)\,(1 + N/EA,\ V/GA_s)^T ds
                   + R(\vartheta)\,\mathbf u_b,\qquad
    \vartheta(p) = \theta(l) + \alpha_b,

with the deformations :math:`(\mathbf u, \alpha)` of the roots (E. Reissner, J. Appl. Math. Phys. 23
(1972) 795; J. C. Simo, Comput. Methods Appl. Mech. Eng. 49 (1985) 55; modes of strain: D. Zupan,
M. Saje, ibid. 192 (2003) 5209). The unknowns p, of shape (m,), are scaled so that the energy is
:math:`\tfrac12 p^T p`. The force :math:`\mathbf f` on end b is an unknown of its own: a leaf is
thousands of times stiffer along than across, and Newton's method on p alone would not converge.

.. math:: p = J^T\mathbf f,\qquad \mathbf h(p) = \mathbf x,\qquad J = d\mathbf h/dp

A step of it has the tangent :math:`k = (J H^{-1} J^T)^{-1}` with :math:`H = I -
\mathbf f\cdot d^2\mathbf h/dp^2`. The roots have the compliance of the hinge that the beam does
not have: steps or fillets, the bodies behind them. So k at rest is the stiffness of the hinge.

Validity: in the plane; any rotation and deflection of a linear elastic leaf. Its width is what the
stiffness of the hinge takes it for: that the section flattens as it bends is not in the model, up
to 2 % of the stiffness where width squared times curvature is four times the thickness.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError
from flexstage.hinges.profile import Profile

# Cubic moments suffice between ends that move: a column between parallel ends is right to 2e-5.
# Between ends at rest one with large fillets needs the sixth order.
_MOMENTS = 7
_AXIAL, _SHEAR = _MOMENTS, _MOMENTS + 1
_ROOT_A, _ROOT_B = slice(_MOMENTS + 2, _MOMENTS + 5), slice(_MOMENTS + 5, _MOMENTS + 8)
_UNKNOWNS = _MOMENTS + 8
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_ITERATIONS = 25
# part of the energy that a last correction may still carry, and where they no longer shrink
_TOLERANCE, _ROUNDING = 1e-26, 1e-16
# what rounding may leave of a compliance, against the total
_ROUNDED = 1e-13
# a step of this part of its length, or of this rotation [rad]
_REACH = 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LeafBeam:
    """A leaf as a beam: quadrature points along its arc length, and its sections."""

    length: float
    """Length between the roots [m]."""
    flat_length: float
    """Length of the part of constant thickness, at whose ends the stress is largest [m]."""
    weight: Array
    """Arc length of each point [m], shape (g,)."""
    up_to: Array
    """Integrals from end a to each point, for unit values at the points [m], shape (g, g)."""
    bending: Array
    """Curvature for a unit moment, 1/EI [1/(N m^2)], shape (g,)."""
    extension: Array
    """Strain for a unit axial force, 1/EA [1/N], shape (g,)."""
    shear: Array
    """Shear strain for a unit force across, 6/5GA [1/N], shape (g,)."""


def leaf_beam(profile: Profile, modulus: float, poisson: float, width: float) -> LeafBeam:
    """Return the beam between the roots of a leaf or of a notch with a flat part.

    `modulus` [Pa] and `poisson` are those of the plane state, `width` is the thickness of the plate
    [m].
    """
    weight, up_to, height = _quadrature(profile)
    return LeafBeam(
        length=profile.length,
        flat_length=profile.flat_length,
        weight=weight,
        up_to=up_to,
        bending=12.0 / (modulus * width * height**3),
        extension=1.0 / (modulus * width * height),
        shear=2.4 * (1.0 + poisson) / (modulus * width * height),
    )


@lru_cache(maxsize=1024)
def _quadrature(profile: Profile) -> tuple[Array, Array, Array]:
    """Return weights, integrals up to each point and heights, from end a to end b."""
    u = 0.5 * (_POINTS + 1.0)
    powers = np.arange(u.size)
    # integrals of Lagrange's polynomials from 0 to each point
    within = (u[:, None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(u[:, None] ** powers)
    speeds, depths = [], []
    for piece in profile.pieces():
        _, depth, angle, speed = piece(u)
        speeds.append(np.cos(angle) * speed)
        depths.append(depth)
    # the half of a before that of b, from its root to the neck
    speed = np.array([s[::-1] for s in speeds[::-1]] + speeds)
    depth = np.array([d[::-1] for d in depths[::-1]] + depths)
    count, size = speed.shape
    up_to = np.zeros((count, size, count, size))
    for k in range(count):
        up_to[k, :, k] = within * speed[k]
        up_to[k, :, :k] = 0.5 * _WEIGHTS * speed[:k]
    height = profile.neck_thickness + profile.sides * depth.ravel()
    return (0.5 * _WEIGHTS * speed).ravel(), up_to.reshape(2 * (speed.size,)), height


class LeafState(NamedTuple):
    """State of some leaves."""

    p: Array
    """Whitened unknowns, shape (..., h, m)."""
    force: Array
    """Force and moment on end b, in axes of body a [N, N, N m], shape (..., h, 3)."""


class LeafTangent(NamedTuple):
    """Linear relation of a step from a state: f = force + stiffness dx."""

    stiffness: Array
    """Stiffness k, shape (..., h, 3, 3)."""
    force: Array
    """Force for the deformation that was asked for, shape (..., h, 3)."""
    flexible: Array
    """H^-1 (J^T, p), by which the unknowns follow, shape (..., h, m, 4)."""
    p: Array
    """Unknowns before the step, shape (..., h, m)."""

    def after(self, change: Array) -> LeafState:
        """Return the state after a change of the deformation, shape (..., h, 3)."""
        force = self.force + (self.stiffness @ change[..., None])[..., 0]
        p = self.p + (self.flexible[..., :3] @ force[..., None])[..., 0] - self.flexible[..., 3]
        return LeafState(p, force)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Leaves:
    """The leaves of a mechanism, all evaluated at once.

    The deformation of a leaf is the displacement of its end b, in axes of body a, from where it is
    without load, and its rotation against body a.
    """

    turn: Array
    """Rotation of the sections for the unknowns, shape (h, g, m)."""
    turned: Array
    """Rotation of body b, shape (h, m)."""
    step: Array
    """Arc length of each section [m], shape (h, g)."""
    stretch: Array
    """What the unknowns add to it, along and across the section [m], shape (h, g, 2, m)."""
    moment: Array
    """Bending moment at both ends of the flat part [N m], shape (h, 2, m)."""

    @property
    def count(self) -> int:
        """Number of leaves h."""
        return len(self.turned)

    def at_rest(self, shape: tuple[int, ...] = ()) -> LeafState:
        """Return the state without load, of several at once."""
        return LeafState(np.zeros((*shape, *self.turned.shape)), np.zeros((*shape, self.count, 3)))

    def deformation(self, p: Array) -> Array:
        """Return the deformation for the unknowns, shape (..., h, 3)."""
        return self._moved(p)[0]

    def rates(self, p: Array) -> Array:
        """Return the derivative J of the deformation by the unknowns, shape (..., h, 3, m)."""
        return self._rates(*self._moved(p)[1:])[0]

    def curvature(self, p: Array, force: Array) -> Array:
        """Contract the second derivatives of the deformation with forces, shape (..., h, m, m)."""
        _, rotated, axes = self._moved(p)
        return self._curvature(rotated, self._rates(rotated, axes)[1], force)

    def tangent(self, state: LeafState, x: Array) -> LeafTangent:
        """Linearise at a state, with the deformation that the leaves are to have."""
        if not self.count:
            still = np.zeros((*x.shape, 3))
            return LeafTangent(
                still, still[..., 0], np.zeros((*x.shape[:-1], _UNKNOWNS, 4)), state.p
            )
        deformation, rotated, axes = self._moved(state.p)
        rates, moved = self._rates(rotated, axes)
        h = -self._curvature(rotated, moved, state.force)
        diagonal = np.arange(h.shape[-1])
        h[..., diagonal, diagonal] += 1.0
        right = np.concatenate((np.swapaxes(rates, -1, -2), state.p[..., None]), axis=-1)
        flexible: Array = np.linalg.solve(h, right).astype(np.float64, copy=False)
        condensed = rates @ flexible
        stiffness = np.linalg.inv(condensed[..., :3])
        stiffness = 0.5 * (stiffness + np.swapaxes(stiffness, -1, -2))
        gap = x - deformation + condensed[..., 3]
        force = (stiffness @ gap[..., None])[..., 0]
        return LeafTangent(stiffness, force, flexible, state.p)

    def solve(self, x: Array, start: LeafState | None = None) -> LeafState:
        """Return the state with a deformation, shape (..., h, 3), from one near it or from rest.

        Raises
        ------
        ConvergenceError
            A leaf cannot be followed to its deformation.
        """
        still = self.at_rest(x.shape[:-2])
        if not self.count:
            return still
        if start is not None and (state := self._newton(start, x)) is not None:
            return state
        length = np.sum(self.step, axis=-1)
        reach = np.abs(x) / np.stack((length, length, np.ones_like(length)), axis=-1)
        least = max(1, math.ceil(float(np.max(reach)) / _REACH))
        for count in (least, 4 * least, 16 * least):
            state = still
            for part in np.arange(1, count + 1) / count:
                # what bends by a part is shorter by its square: pressed, it would buckle on the way
                nearer = self._newton(state, x * [part**2, part, part])
                if nearer is None:
                    break
                state = nearer
            else:
                return state
        raise ConvergenceError(
            "a leaf cannot be bent so far, or buckles on the way there: approach it in smaller "
            "steps"
        )

    def energy(self, state: LeafState) -> Array:
        """Return the energy of all leaves [J], shape (...)."""
        return 0.5 * np.sum(state.p**2, axis=(-2, -1))

    def section_forces(self, state: LeafState) -> Array:
        """Return the axial force and moment at both ends of the flat parts, shape (..., h, 2, 2).

        The axial forces are those in axes of the bodies.
        """
        out = np.empty((*state.force.shape[:-1], 2, 2))
        angle = np.sum(self.turned * state.p, axis=-1)
        out[..., 0, 0] = state.force[..., 0]
        out[..., 1, 0] = np.cos(angle) * state.force[..., 0] + np.sin(angle) * state.force[..., 1]
        out[..., 1] = (self.moment @ state.p[..., None])[..., 0]
        return out

    def _newton(self, state: LeafState, x: Array) -> LeafState | None:
        previous = np.full(x.shape[:-1], np.inf)
        settled = np.zeros(x.shape[:-1], dtype=bool)
        for _ in range(_ITERATIONS):
            step = self.tangent(state, x)
            after = step.after(np.zeros_like(x))
            size = np.sum((after.p - state.p) ** 2, axis=-1)
            energy = np.maximum(np.sum(after.p**2, axis=-1), np.sum(state.p**2, axis=-1))
            if not np.all(np.isfinite(size)):
                return None
            state = after
            # each converges in a step of its own: the corrections of rounding after it do not count
            settled |= (size <= _TOLERANCE * energy) | (
                (size <= _ROUNDING * energy) & (size >= 0.25 * previous)
            )
            if np.all(settled):
                return state
            previous = size
        return None

    def _moved(self, p: Array) -> tuple[Array, Array, tuple[Array, Array]]:
        """Return the deformation, and each section's part of it with the axes that it has."""
        column = p[..., None, :, None]
        angle = (self.turn @ p[..., None])[..., 0]
        cos, sin = np.cos(angle), np.sin(angle)
        strained = (self.stretch @ column)[..., 0]
        along, across = self.step + strained[..., 0], strained[..., 1]
        rotated = np.stack((cos * along - sin * across, sin * along + cos * across), axis=-2)
        out = np.empty((*p.shape[:-1], 3))
        out[..., :2] = np.sum(rotated, axis=-1)
        # of sections that hardly turn, without cancellation
        versine = 2.0 * np.sin(0.5 * angle) ** 2
        out[..., 0] = np.sum(strained[..., 0] - versine * along - sin * across, axis=-1)
        out[..., 2] = np.sum(self.turned * p, axis=-1)
        return out, rotated, (cos, sin)

    def _rates(self, rotated: Array, axes: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return J, and what stretch of the sections adds to it at each, (..., h, 2, g, m)."""
        cos, sin = (a[..., None] for a in axes)
        own_x, own_y = self.stretch[..., 0, :], self.stretch[..., 1, :]
        moved = np.stack((cos * own_x - sin * own_y, sin * own_x + cos * own_y), axis=-3)
        quarter = np.stack((-rotated[..., 1, :], rotated[..., 0, :]), axis=-2)
        j = np.empty((*rotated.shape[:-2], 3, self.turned.shape[-1]))
        j[..., :2, :] = np.sum(moved, axis=-2) + quarter @ self.turn
        j[..., 2, :] = self.turned
        return j, moved

    def _curvature(self, rotated: Array, moved: Array, force: Array) -> Array:
        fx, fy = force[..., 0, None], force[..., 1, None]
        toward = fx * rotated[..., 0, :] + fy * rotated[..., 1, :]
        inner = fy[..., None] * moved[..., 0, :, :] - fx[..., None] * moved[..., 1, :, :]
        inner = inner - 0.5 * toward[..., None] * self.turn
        half = np.swapaxes(np.broadcast_to(self.turn, inner.shape), -1, -2) @ inner
        return half + np.swapaxes(half, -1, -2)


def leaves(beams: Sequence[LeafBeam], stiffness: Array) -> Leaves:
    """Prepare leaves with the stiffness about the neck that they have at rest, shape (h, 3, 3)."""
    parts = [_element(beam, k) for beam, k in zip(beams, stiffness, strict=True)]
    size = max((part["step"].size for part in parts), default=0)

    def stacked(name: str, shape: tuple[int, ...]) -> Array:
        out = np.zeros((len(parts), *shape))
        for i, part in enumerate(parts):
            # points that a leaf does not have are without length
            out[i, : len(part[name])] = part[name]
        return out

    return Leaves(
        turn=stacked("turn", (size, _UNKNOWNS)),
        turned=stacked("turned", (_UNKNOWNS,)),
        step=stacked("step", (size,)),
        stretch=stacked("stretch", (size, 2, _UNKNOWNS)),
        moment=stacked("moment", (2, _UNKNOWNS)),
    )


def _element(beam: LeafBeam, stiffness: Array) -> dict[str, Array]:
    """Return the arrays of one leaf by name."""
    half, weight = 0.5 * beam.length, beam.weight
    # moments whose energies are 1 and do not couple
    place = 2.0 * np.sum(beam.up_to, axis=1) / beam.length - 1.0
    moments = np.polynomial.legendre.legvander(place, _MOMENTS - 1)
    energy = moments.T @ ((weight * beam.bending)[:, None] * moments)
    white = np.linalg.inv(np.linalg.cholesky(energy)).T
    curvature = beam.bending[:, None] * (moments @ white)

    turn, turned = np.zeros((weight.size + 2, _UNKNOWNS)), np.zeros(_UNKNOWNS)
    stretch = np.zeros((weight.size + 2, 2, _UNKNOWNS))
    turn[1:-1, :_MOMENTS], turn[-1, :_MOMENTS] = beam.up_to @ curvature, weight @ curvature
    turned[:_MOMENTS] = turn[-1, :_MOMENTS]
    stretch[1:-1, 0, _AXIAL] = _whitened(weight * beam.extension)
    across = weight @ turn[1:-1] - half * turned
    at_neck = np.stack((np.sum(stretch[:, 0], axis=0), across, turned))
    of_beam = at_neck @ at_neck.T
    # The roots have the rest of the compliance about the neck. Where a beam alone has more in some
    # direction, as one of the quadrature of large fillets can by 1e-4, it is stiffened to what is.
    triangle = np.linalg.cholesky(stiffness)
    most = np.linalg.eigvalsh(triangle.T @ of_beam @ triangle)[-1]
    share = 1.0 / max(1.0, most)
    total = np.linalg.inv(stiffness)
    rest = total - share * of_beam
    rest[np.abs(rest) < _ROUNDED * np.sqrt(np.outer(np.diag(total), np.diag(total)))] = 0.0
    turn, turned, stretch = (np.sqrt(share) * part for part in (turn, turned, stretch))
    # shear, if the hinge has it: it takes part in what the leaf is stretched by
    slip = weight * beam.shear
    slip *= min(1.0, _alone(rest) / np.sum(slip))
    rest[1, 1] -= np.sum(slip)
    stretch[1:-1, 1, _SHEAR] = _whitened(slip)
    root_a, root_b = _roots(rest, half)
    stretch[0, :, _ROOT_A], stretch[-1, :, _ROOT_B] = root_a[:2], root_b[:2]
    turn[1:, _ROOT_A], turn[-1, _ROOT_B] = root_a[2], root_b[2]
    turned[_ROOT_A], turned[_ROOT_B] = root_a[2], root_b[2]
    moment = np.zeros((2, _UNKNOWNS))
    ends = np.array([-1.0, 1.0]) * beam.flat_length / beam.length
    moment[:, :_MOMENTS] = np.polynomial.legendre.legvander(ends, _MOMENTS - 1) @ white
    return {
        "turn": turn,
        "turned": turned,
        "step": np.concatenate(([0.0], weight, [0.0])),
        "stretch": stretch,
        "moment": moment / np.sqrt(share),
    }


def _whitened(compliance: Array) -> Array:
    """Return the deformations of sections with these compliances for a force of energy 1/2."""
    total = np.sum(compliance)
    return compliance / np.sqrt(total) if total > 0.0 else compliance


def _alone(compliance: Array) -> float:
    """Return the compliance across that is not coupled with the others."""
    others = np.ix_([0, 2], [0, 2])
    coupled = compliance[1, [0, 2]]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(compliance)[[0, 2]], np.finfo(float).tiny))
    inverse = np.linalg.pinv(compliance[others] * np.outer(scale, scale), rcond=1e-9)
    return max(float(compliance[1, 1] - (coupled * scale) @ inverse @ (coupled * scale)), 0.0)


def _roots(rest: Array, half: float) -> tuple[Array, Array]:
    """Return motions of the ends for the unknowns of the roots at a and b, each of shape (3, 3).

    They share a compliance about the neck: each turns about a point on the axis, which may lie
    within its body, and is compliant along at its end. It is compliant across only where neither
    turns: a spring across, which turns with its body, makes a leaf in tension buckle.
    """
    u, v, m = np.maximum(np.diag(rest), 0.0)
    centre = half if m == 0.0 else np.sqrt(v / m)
    apart = np.array([-1.0, 1.0]) / centre if centre > 0.0 else np.zeros(2)
    turns = np.maximum(0.5 * (m - apart * rest[1, 2]), 0.0)
    coupled = 0.5 * (rest[0, 2] - apart * rest[0, 1])
    leans = np.divide(coupled, turns, out=np.zeros(2), where=turns > 0.0)
    along = np.sqrt(max(0.5 * (u - np.sum(turns * leans**2)), 0.0))
    across = np.sqrt(0.5 * v) if m == 0.0 else 0.0
    offset = (half - centre, centre - half)
    a, b = (
        np.array([[along, 0.0, lean * size], [0.0, across, -arm * size], [0.0, 0.0, size]])
        for size, lean, arm in zip(np.sqrt(turns), leans, offset, strict=True)
    )
    return a, b
