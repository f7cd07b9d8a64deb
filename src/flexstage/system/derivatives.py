r"""Analytic derivatives of the characteristics of a stage, by any number of parameters at once.

With derivatives of M, K and the vectors of drives and probes marked by a dot, statics are

.. math:: K\dot q = \dot f - \dot K q,

a reading of unit forces, :math:`c = p^T K^{-1} d`, needs no other solution than c itself,

.. math:: \dot c = \dot p^T q_d + q_p^T\dot d - q_p^T\dot K q_d,\quad q_d = K^{-1}d,\ q_p = K^{-1}p,

a natural frequency is, with :math:`\phi^T M\phi = 1` (R. L. Fox, M. P. Kapoor, AIAA J. 6 (1968)
2426),

.. math:: \dot{(\omega^2)} = \phi^T(\dot K - \omega^2\dot M)\phi,

and the shape of a mode follows in the basis of all of them (the same; R. B. Nelson, AIAA J. 14
(1976) 1201, avoids that basis, which pays for large systems: here n is small).

*Modes of one frequency.* Where several modes share :math:`\omega^2`, to rounding, those that the
change separates are the eigenvectors of :math:`\Phi^T(\dot K - \omega^2\dot M)\Phi`, and its
eigenvalues are the derivatives; that of the mode that moves the axis is used, as by the figure
itself. An effective mass is that of all modes of one frequency: their projector :math:`\Phi\Phi^T
M` is smooth even where they cross.

A largest of several values has the derivative of the active one; of equal largest stresses, the
mean of the derivatives to either side.
"""

from collections.abc import Collection
from functools import cached_property

import numpy as np
from scipy.linalg import eigh

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.system.batch import SystemBatch, samples_last
from flexstage.system.batch_analysis import FieldSource, require_known
from flexstage.system.batch_figures import StageFigures, decisions
from flexstage.system.characteristics import MODES_SEARCHED, SAME_FREQUENCY, strongest
from flexstage.system.figure_source import Key, added
from flexstage.system.forward_mode import Dual
from flexstage.system.statics import solve_stiffness

# Squared frequencies closer than this are one but for rounding, of which stiff directions that
# cancel in a soft mode leave some.
_ONE = 1e-8


def characteristic_derivatives(
    batch: SystemBatch, slopes: SystemBatch, keys: Collection[Key] | None = None
) -> dict[Key, Array]:
    r"""Return the derivatives of the characteristics of a stage by parameters.

    Parameters
    ----------
    batch : SystemBatch
        The stage: one sample.
    slopes : SystemBatch
        Derivatives of its fields, with a leading axis of p parameters; of 1 where they are zero.
    keys : Collection of tuple, optional
        Figures as quantity and axis; all those of `flexstage.system.batch_characteristics` where
        not given.

    Returns
    -------
    dict
        By quantity and axis the derivatives, in the unit of the figure over that of the parameter,
        shape (p,).

    Raises
    ------
    ModelError
        There are several samples, the stage is a mechanism, or a figure is not available.

    Notes
    -----
    Validity: as the model; exact to rounding. Where several largest stresses are equal, a figure
    has a kink, and this is the mean of its two sides; where two modes of one frequency move an axis
    equally, it is that of one of them.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import parameter_tangents, system_tangents
    >>> stage = design("parallelogram")
    >>> modulus = stage.material.youngs_modulus
    >>> tangents = parameter_tangents(
    ...     lambda e: replace(stage, material=replace(stage.material, youngs_modulus=e)), modulus
    ... )
    >>> key = ("natural_frequency_hz", "x")
    >>> found = characteristic_derivatives(*system_tangents(tangents), [key])[key]
    >>> print(f"{2.0 * found[0] * modulus:.2f} Hz")
    193.66 Hz
    """
    if batch.samples != 1:
        raise ModelError(f"derivatives are those of one stage, got {batch.samples} samples")
    source = _Slopes(batch, slopes)
    figures = StageFigures(decisions(batch.stage, batch.nominal), source)
    source.figures = figures
    selected = list(figures.rows) if keys is None else list(keys)
    require_known(batch, selected, figures.rows)
    count = max(getattr(slopes, name).shape[0] for name in ("stiffness", "mass", "stroke", "size"))
    return {key: np.broadcast_to(figures.rows[key]().tangent, (count,)).copy() for key in selected}


class _Slopes(FieldSource):
    """Ingredients of figures, with derivatives."""

    figures: StageFigures

    def __init__(self, batch: SystemBatch, slopes: SystemBatch) -> None:
        self.batch, self.slopes = batch, slopes
        self.order = batch.mass.shape[1]
        self._drive = [self._vector("drive", j) for j in range(len(batch.drive_bodies))]
        self._probe = [self._vector("probe", p) for p in range(len(batch.probe_bodies))]

    def last(self, name: str) -> Dual:
        return Dual(*(samples_last(np, getattr(b, name)) for b in (self.batch, self.slopes)))

    def _vector(self, kind: str, which: int) -> tuple[Array, Array]:
        """A drive or a probe as a vector of all coordinates, and its derivatives."""
        bodies = getattr(self.batch, f"{kind}_bodies")[which]
        return self._spread(getattr(self.batch, kind)[:, which], bodies)[0], self._spread(
            getattr(self.slopes, kind)[:, which], bodies
        )

    def _spread(self, rows: Array, bodies: tuple[int, int]) -> Array:
        """Rows of two bodies, (p, 2, 3), in all coordinates, (p, n)."""
        out = np.zeros((rows.shape[0], self.order))
        for side, body in enumerate(bodies):
            if body >= 0:
                out[:, 3 * body : 3 * body + 3] += rows[:, side]
        return out

    def _full_matrices(self, blocks: Array) -> Array:
        """Full matrices of blocks."""
        out = np.zeros((blocks.shape[0], self.order, self.order))
        for i, (row, column) in enumerate(self.batch.blocks):
            a, b = slice(3 * row, 3 * row + 3), slice(3 * column, 3 * column + 3)
            out[:, a, b] = blocks[:, i]
            if row != column:
                out[:, b, a] = np.swapaxes(blocks[:, i], 1, 2)
        return out

    @cached_property
    def stiffness(self) -> Array:
        """K."""
        k = self._full_matrices(self.batch.stiffness)[0]
        return 0.5 * (k + k.T)

    @cached_property
    def stiffness_slope(self) -> Array:
        """Derivatives of K."""
        return self._full_matrices(self.slopes.stiffness)

    @cached_property
    def _loads(self) -> tuple[Array, dict[tuple[str, int], int]]:
        """Shapes for all unit forces, one a column, and where each is; weights after them."""
        columns, where = [], {}
        for kind, vectors in (("drive", self._drive), ("probe", self._probe)):
            for i, (vector, _) in enumerate(vectors):
                where[kind, i] = len(columns)
                columns.append(vector)
        for i in range(len(self._probe)):
            where["weight", i] = len(columns)
            columns.append(self._weight(i)[0])
        no_constraints = np.zeros((self.order, 0))
        return solve_stiffness(self.stiffness, np.array(columns).T, no_constraints)[0], where

    def _shape(self, kind: str, which: int) -> Array:
        shapes, where = self._loads
        return shapes[:, where[kind, which]]

    def _weight(self, probe: int) -> tuple[Array, Array]:
        """Weight along the direction of a probe, and its derivatives."""
        along, along_slope = (b.weight_direction[:, probe] for b in (self.batch, self.slopes))
        weight, weight_slope = self.batch.weight, self.slopes.weight

        def spread(w: Array, direction: Array) -> Array:
            product = w[:, :, None] * direction[:, None, :]
            turn = np.zeros((*product.shape[:2], 1))
            return np.concatenate((product, turn), axis=2).reshape(product.shape[0], -1)

        slope = spread(weight_slope, along) + spread(weight, along_slope)
        return spread(weight, along)[0], slope

    def _pair(self, kind: str, which: int) -> tuple[Array, Array]:
        if kind == "weight":
            return self._weight(which)
        return (self._drive if kind == "drive" else self._probe)[which]

    def _compliance(self, a: tuple[str, int], b: tuple[str, int]) -> Dual:
        """Reading of one vector of the shape for another one, with its derivatives."""
        (u, u_slope), (_, v_slope) = self._pair(*a), self._pair(*b)
        q_u, q_v = self._shape(*a), self._shape(*b)
        slope = (
            u_slope @ q_v
            + v_slope @ q_u
            - np.einsum("i,pij,j->p", q_u, self.stiffness_slope, q_v, optimize=True)
        )
        return Dual(np.array([u @ q_v]), slope)

    def gram(self, i: int, j: int) -> Dual:
        return self._compliance(("drive", i), ("drive", j))

    def reach(self, probe: int, drive: int) -> Dual:
        return self._compliance(("probe", probe), ("drive", drive))

    def self_response(self, probe: int) -> Dual:
        return self._compliance(("probe", probe), ("probe", probe))

    def sag(self, probe: int) -> Dual:
        return self._compliance(("probe", probe), ("weight", probe))

    def sag_drive(self, probe: int, drive: int) -> Dual:
        return self._compliance(("drive", drive), ("weight", probe))

    def _drive_shape(self, drive: int) -> tuple[Array, Array]:
        """Shape for a unit force of a drive, and its derivatives."""
        q, (_, slope) = self._shape("drive", drive), self._drive[drive]
        right = slope - self.stiffness_slope @ q
        no_constraints = np.zeros((self.order, 0))
        return q, solve_stiffness(self.stiffness, right.T, no_constraints)[0].T

    def stress(self, drive: int) -> Dual:
        q, slope = self._drive_shape(drive)
        rows, rows_slope = self.batch.stress[0], self.slopes.stress
        value = np.zeros((rows.shape[0], 1))
        tangent = np.zeros((rows.shape[0], max(slope.shape[0], rows_slope.shape[0])))
        for r, bodies in enumerate(self.batch.stress_bodies):
            for side, body in enumerate(bodies):
                if body >= 0:
                    at = slice(3 * body, 3 * body + 3)
                    value[r] += rows[r, side] @ q[at]
                    tangent[r] += rows_slope[:, r, side] @ q[at] + slope[:, at] @ rows[r, side]
        return Dual(value, tangent)

    def rotation(self, probe: int, drive: int) -> Dual:
        body = self.batch.probe_bodies[probe][0]
        if body < 0:
            return Dual(np.zeros(1), np.zeros(1))
        q, slope = self._drive_shape(drive)
        return Dual(q[3 * body + 2 : 3 * body + 3], slope[:, 3 * body + 2])

    @cached_property
    def _modes(self) -> tuple[Array, Array]:
        """Squared frequencies and shapes of all modes."""
        return eigh(self.stiffness, np.diag(self.batch.mass[0]), driver="gvd")

    def mode(self, axis: int) -> tuple[Dual, Dual]:
        value, shapes = self._modes
        figure = self.figures.axes[axis]
        p, p_slope = self._probe[figure.probe]
        d = added([f.value * self._drive[j][0] for j, f in figure.motion[1].items()])
        last = min(MODES_SEARCHED, value.size)
        share = np.abs((p @ shapes) * (d @ shapes))[:last] / value[:last]
        selected = strongest(share)
        squared, mass_slope = value[selected], self.slopes.mass

        def between(left: Array, right: Array) -> tuple[Array, Array]:
            """Derivatives of K and of M between shapes, (p, a, b)."""
            k = np.einsum("ia,pij,jb->pab", left, self.stiffness_slope, right, optimize=True)
            return k, np.einsum("ia,pi,ib->pab", left, mass_slope, right, optimize=True)

        one = np.flatnonzero(np.abs(value / squared - 1.0) < _ONE)
        k, m = between(shapes[:, one], shapes[:, one])
        slope = self._of_one(k - squared * m, p @ shapes[:, one], d @ shapes[:, one])
        same_frequency = np.zeros(value.size, dtype=bool)
        same_frequency[:last] = np.abs(np.sqrt(value[:last] / squared) - 1.0) < SAME_FREQUENCY
        read = p @ shapes
        reading_squares = float(np.sum(read[same_frequency] ** 2))
        k, m = between(shapes[:, same_frequency], shapes)
        change = k - value[same_frequency][:, None] * m
        # among modes of one frequency only M counts, that of the projector on all of them
        apart = value[same_frequency][:, None] - value
        with np.errstate(divide="ignore"):
            gap = np.where(same_frequency, 0.0, 1.0 / apart)
        turned = 2.0 * np.einsum(
            "a,pab,ab,b->p", read[same_frequency], change, gap, read, optimize=True
        )
        inside = np.einsum(
            "a,pab,b->p", read[same_frequency], m[:, :, same_frequency], read[same_frequency]
        )
        moved = 2.0 * (p_slope @ shapes[:, same_frequency]) @ read[same_frequency]
        return Dual(np.array([squared]), slope), Dual(
            np.array([reading_squares]), turned - inside + moved
        )

    @staticmethod
    def _of_one(change: Array, p: Array, d: Array) -> Array:
        """Derivative of a squared frequency that several modes share, of the one that is active."""
        values, vectors = np.linalg.eigh(0.5 * (change + np.swapaxes(change, 1, 2)))
        share = np.abs(np.einsum("a,pab->pb", p, vectors) * np.einsum("a,pab->pb", d, vectors))
        return np.take_along_axis(values, np.argmax(share, axis=1)[:, None], axis=1)[:, 0]

    def fine(self) -> None:
        return None
