r"""Motion in time with finite rotations, by energy-conserving collocation.

Gauss's methods with s stages have order 2 s, are stable for any step (stiff modes that are not
followed do no harm) and conserve a *quadratic* energy exactly. Here the force at a stage is
replaced by its weighted mean along the step,

.. math::

    M\mathbf a_j = \frac1{b_j}\int_0^1 \ell_j(\tau)\,\mathbf f(\mathbf q(\tau))\,d\tau ,

with the Lagrange polynomials of the stages: the same order, and *any* energy is conserved as far as
the quadrature of the mean is exact (E. Hairer, J. Numer. Anal. Ind. Appl. Math. 5 (2010) 73;
L. Brugnano, F. Iavernaro, D. Trigiante, ibid. 17: the methods HBVM(k, s)).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lu_factor, lu_solve

from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.lumped.finite_rotation import LeafStep, NonlinearMechanism
from flexstage.lumped.leaf import LeafState

_ITERATIONS = 25
_REFRESH_AFTER = 8
# points for the mean force beyond the stages: the error of its quadrature is far below rounding
_MORE_POINTS = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """A motion in time."""

    time: Array
    """Times [s], shape (k,)."""
    q: Array
    """Coordinates, shape (k, n)."""
    velocity: Array
    """Their rates, shape (k, n)."""
    kinetic_energy: Array
    """T [J], shape (k,)."""
    potential_energy: Array
    """Energy V in the hinges [J], shape (k,)."""

    @property
    def energy(self) -> Array:
        """T + V [J], shape (k,)."""
        return self.kinetic_energy + self.potential_energy


def motion(
    model: NonlinearMechanism,
    time: ArrayLike,
    q0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    *,
    drive_force: Mapping[str, Callable[[float], float]] | None = None,
    rayleigh: tuple[float, float] = (0.0, 0.0),
    stages: int = 3,
    substeps: int = 1,
) -> Motion:
    """Integrate the equations of motion with finite rotations.

    Parameters
    ----------
    model : NonlinearMechanism
        The model.
    time : ArrayLike
        Equally spaced times [s], shape (k,).
    q0 : ArrayLike, optional
        Coordinates at the first time, shape (n,); rest where not given.
    v0 : ArrayLike, optional
        Rates at the first time, shape (n,).
    drive_force : Mapping, optional
        Force of each drive as a function of time [N].
    rayleigh : tuple of float
        alpha [1/s] and beta [s] of Rayleigh damping; the part beta acts as dampers in the hinges,
        in their turning frames, so that rigid motion is not damped by it.
    stages : int
        Stages s of the method, 1 to 5; its order is 2 s, and the mean force is taken from s + 4
        points.
    substeps : int
        Steps between two times.

    Returns
    -------
    Motion
        The states at `time`.

    Raises
    ------
    ModelError
        Times are not equally spaced, or a drive does not exist.
    ConvergenceError
        The step is too long for the motion.

    Notes
    -----
    Validity: as `flexstage.lumped.finite_rotation`. About 20 steps in a period of the fastest
    relevant mode follow it closely; energy and the momentum of a free mechanism are conserved
    whatever the step, its angular momentum to the order of the method.
    """
    t = np.asarray(time, dtype=float)
    if t.ndim != 1 or t.size < 2 or not np.allclose(np.diff(t), t[1] - t[0], rtol=1e-6, atol=0.0):
        raise ModelError("times must be at least two and equally spaced")
    if not 1 <= stages <= 5 or substeps < 1:
        raise ModelError(
            f"stages must lie from 1 to 5 and substeps be positive, got {stages}, {substeps}"
        )
    n = model.order
    q = np.zeros(n) if q0 is None else np.array(q0, dtype=float)
    v = np.zeros(n) if v0 is None else np.array(v0, dtype=float)
    stepper = _Stepper(
        model, q, (t[1] - t[0]) / substeps, stages, rayleigh, dict(drive_force or {})
    )
    qs, vs = np.zeros((t.size, n)), np.zeros((t.size, n))
    qs[0], vs[0] = q, v
    for k in range(1, t.size):
        for j in range(substeps):
            q, v = stepper.step(t[k - 1] + j * stepper.h, q, v)
        qs[k], vs[k] = q, v
    return Motion(
        time=t,
        q=qs,
        velocity=vs,
        kinetic_energy=model.kinetic_energy(vs),
        potential_energy=model.potential_energy(qs),
    )


class _Rule(NamedTuple):
    """Coefficients of the method: s stages, k points for the mean force."""

    a: Array  # stage integrals of the Lagrange polynomials, (s, s)
    b: Array  # weights, (s,)
    points: Array  # where the force is evaluated, (k,)
    reach: Array  # integrals of the Lagrange polynomials up to the points, (k, s)
    mean: Array  # weights of the mean force, (s, k)
    ahead: Array  # values of the stage polynomial at the stages of the next step, (s, s)


@lru_cache(maxsize=8)
def _rule(stages: int) -> _Rule:
    c, b = _gauss(stages)
    d, w = _gauss(stages + _MORE_POINTS)
    powers = np.arange(stages)
    lagrange = np.linalg.inv(c[:, None] ** powers)

    def integrals(x: Array) -> Array:
        return (x[:, None] ** (powers + 1) / (powers + 1)) @ lagrange

    values = d[:, None] ** powers @ lagrange
    return _Rule(
        a=integrals(c),
        b=b,
        points=d,
        reach=integrals(d),
        mean=(w[:, None] * values / b).T,
        ahead=(c[:, None] + 1.0) ** powers @ lagrange,
    )


def _gauss(count: int) -> tuple[Array, Array]:
    x, w = np.polynomial.legendre.leggauss(count)
    return 0.5 * (x + 1.0), 0.5 * w


class _Stepper:
    """One step of the method, with a Newton matrix that is reused while it converges."""

    def __init__(
        self,
        model: NonlinearMechanism,
        q: Array,
        h: float,
        stages: int,
        rayleigh: tuple[float, float],
        forces: dict[str, Callable[[float], float]],
    ) -> None:
        self.model, self.h, self.forces = model, h, forces
        self.alpha, self.beta = rayleigh
        self.rule = _rule(stages)
        self.acceleration = np.zeros((stages, model.order))
        self.factor: Any = None
        self.lost = np.zeros((2, model.order))
        # at the points of the step, for the next one too
        still = model.leaf_states(q)
        self.leaves = LeafState(*(np.repeat(x[None], self.rule.points.size, axis=0) for x in still))

    def step(self, time: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Advance by h."""
        h, rule = self.h, self.rule
        guess = rule.ahead @ self.acceleration
        previous = np.inf
        for iteration in range(_ITERATIONS):
            stage_v = v + h * (rule.a @ guess)
            at_q = q + h * (rule.reach @ stage_v)
            if self.factor is None or (iteration and iteration % _REFRESH_AFTER == 0):
                self.factor = self._newton_matrix(at_q, len(at_q) // 2)
            at_v = v + h * (rule.reach @ guess)
            force, leaf = self._force(time, at_q, at_v)
            right = rule.mean @ force - self.model.mass * guess
            change = lu_solve(self.factor, right.reshape(-1), check_finite=False)
            guess = guess + change.reshape(guess.shape)
            step = h**2 * (rule.reach @ (rule.a @ change.reshape(guess.shape)))
            self.leaves = leaf.after(step)
            size = float(np.sum(self.model.mass * change.reshape(guess.shape) ** 2))
            kinetic = float(np.sum(self.model.mass * guess**2))
            # down to rounding: until the correction is negligible, or small and no longer shrinks
            if size <= 1e-30 * kinetic or (size <= 1e-20 * kinetic and size >= 0.25 * previous):
                self.acceleration = guess
                dq = h * (rule.b @ (v + h * (rule.a @ guess)))
                return self._add(0, q, dq), self._add(1, v, h * (rule.b @ guess))
            if not np.isfinite(size):
                break
            previous = size
        raise ConvergenceError(
            f"the motion does not converge at t = {time:.6g} s: take shorter steps"
        )

    def _add(self, which: int, value: Array, change: Array) -> Array:
        """Add with W. Kahan's compensation, so that rounding does not drift."""
        change = change - self.lost[which]
        total = value + change
        self.lost[which] = (total - value) - change
        return total

    def _newton_matrix(self, q: Array, point: int) -> Any:
        h, a = self.h, self.rule.a
        state = LeafState(*(x[point] for x in self.leaves))
        tangent, _, _ = self.model.linearised(q[point], state)
        m = np.diag(self.model.mass)
        damping = self.alpha * m + self.beta * tangent
        return lu_factor(
            np.kron(np.eye(len(a)), m) + h**2 * np.kron(a @ a, tangent) + h * np.kron(a, damping),
            check_finite=False,
        )

    def _force(self, time: float, q: Array, v: Array) -> tuple[Array, LeafStep]:
        """Forces of hinges, dampers and drives at the points of the step, shape (k, n)."""
        force, leaf = self.model.damped_force(q, v, self.beta, self.leaves)
        force = -force
        if self.alpha:
            force -= self.alpha * self.model.mass * v
        for name, push in self.forces.items():
            for i, point in enumerate(self.rule.points):
                _, gradient, _ = self.model.elongation(name, q[i])
                force[i] += push(time + point * self.h) * gradient
        return force, leaf
