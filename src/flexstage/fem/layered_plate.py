"""A part of a plate in space on a mesh of its plane: stiffness, mass, loads, readings."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.elasticity.shapes import METRE
from flexstage.fem.constrained import plane_pins
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.material import Material

_ROUNDING = 1e-12  # of two functions' integral, in parts of what it could be


class PlaneIntegrals:
    """Integrals over the plane of a part, which all motions of the plate share."""

    def __init__(self, mesh: ng.Mesh, *, order: int, held: str) -> None:
        self.mesh, self.order = mesh, order
        self.scalar = ng.H1(mesh, order=order, dirichlet=held)
        self.width = int(self.scalar.ndof)
        # at once, as the mesh is used by one thread at a time
        #: Rows, columns and values of the integrals of derivatives of shape functions.
        self.pattern = self._pattern()
        #: Factors of the shape functions that make up 1, x and y [m], shape (n, 3).
        self.places = self._places()

    def _pattern(self) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
        """Return integrals of derivatives of shape functions: rows, columns, values.

        Values 3 m + n are of derivative m of the test function and n of the trial function, in
        metres; the third is no derivative. Shapes (k,), (k,) and (k, 9), row by row.
        """
        p, q = self.scalar.TnT()
        tests = (ng.Grad(q)[0], ng.Grad(q)[1], q)
        trials = (ng.Grad(p)[0], ng.Grad(p)[1], p)
        shape = (self.width, self.width)
        found: list[Array] = [np.zeros(0)] * 9
        matrix = sp.csr_matrix(shape)
        for m in range(3):
            for n in range(m, 3):
                form = ng.BilinearForm(self.scalar)
                form += tests[m] * trials[n] * ng.dx
                form.Assemble()
                rows, columns, values = (np.asarray(a) for a in form.mat.COO())
                scale = METRE ** -((m == 2) + (n == 2))
                matrix = sp.csr_matrix((scale * values, (rows, columns)), shape=shape)
                matrix.sort_indices()
                found[3 * m + n] = np.asarray(matrix.data, dtype=float)
                if n != m:  # the pattern is that of its transpose
                    turned = matrix.T.tocsr()
                    turned.sort_indices()
                    found[3 * n + m] = np.asarray(turned.data, dtype=float)
        rows = np.repeat(np.arange(self.width), np.diff(matrix.indptr))
        return rows, matrix.indices.astype(np.int64), np.column_stack(found)

    def _places(self) -> Array:
        one = np.zeros(self.width)
        one[: self.mesh.nv] = 1.0  # the shape functions of the vertices make up a constant
        place = ng.GridFunction(ng.H1(self.mesh, order=self.order, dim=2))
        place.Set(ng.CoefficientFunction((ng.x / METRE, ng.y / METRE)))
        return np.column_stack((one, place.vec.FV().NumPy().reshape(-1, 2)))

    def inside(
        self, notches: Sequence[tuple[str, tuple[float, float], float]]
    ) -> NDArray[np.bool_]:
        """Tell which unknowns lie in notches alone: all elements that share them do.

        Of each notch its region, its centre [m], and how far from there it reaches [m].
        """
        elements = list(self.mesh.Elements(ng.VOL))
        corners = [[self.mesh[v].point for v in e.vertices] for e in elements]
        middles = np.mean(corners, axis=1) / METRE
        index = np.array([e.index for e in elements])
        near = np.zeros(len(elements), dtype=bool)
        for region, (x, y), reach in notches:
            near |= np.hypot(middles[:, 0] - x, middles[:, 1] - y) <= reach
            near |= np.array(self.mesh.Materials(region).Mask(), dtype=bool)[index]
        found = np.ones(self.width, dtype=bool)
        for e in (e for e, within in zip(elements, near, strict=True) if not within):
            found[list(self.scalar.GetDofNrs(ng.ElementId(e)))] = False
        return found

    def linear(self, integrand: Callable[[Any], Any], region: str = ".*") -> Array:
        """Assemble an integral over regions of the plane [mm^2] with the scalar test function."""
        form = ng.LinearForm(self.scalar)
        form += integrand(self.scalar.TestFunction()) * ng.dx(region, bonus_intorder=2)
        form.Assemble()
        return form.vec.FV().NumPy().copy()


class LayeredPlate:
    """A part of a plate on a mesh of its plane, with functions through its thickness.

    Its fields are those of `ThroughThickness.components`, on the scalar space of the mesh. Fields
    of notches alone vanish in the bodies, which begin some way from the mouths of the notches; of
    each notch `notches` gives the region, the centre [m] and how far from there they reach [m].
    Unknowns are what nothing holds: of the fields that bodies have, side by side for each unknown
    of the scalar space, then of the others (see `gathered`).
    """

    def __init__(
        self,
        plane: PlaneIntegrals,
        material: Material,
        through: ThroughThickness,
        notches: Sequence[tuple[str, tuple[float, float], float]],
    ) -> None:
        self.plane, self.material, self.through = plane, material, through
        loose = np.array(plane.scalar.FreeDofs(), dtype=bool)
        in_bodies = np.array(
            [k < through.functions[kind].in_bodies for _, kind, k in through.components]
        )
        # fields that bodies have, then those of notches alone; their unknowns on the scalar space
        self._groups = tuple(
            (np.flatnonzero(fields), np.flatnonzero(where))
            for fields, where in ((in_bodies, loose), (~in_bodies, loose & plane.inside(notches)))
        )
        #: Number of unknowns.
        self.size = sum(fields.size * where.size for fields, where in self._groups)
        #: Which of them nothing holds: what is held is no unknown.
        self.free = np.ones(self.size, dtype=bool)

    def gathered(self, fields: Array) -> Array:
        """Return the unknowns of fields on the scalar space, shape (..., f, w) to (..., n)."""
        lead = fields.shape[:-2]
        parts = [
            fields[..., own[:, None], where].swapaxes(-1, -2).reshape(*lead, -1)
            for own, where in self._groups
        ]
        return np.concatenate(parts, axis=-1)

    def numbers(self, where: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the unknowns of fields at some places of the scalar space, shape (f, len(where)).

        Of what is no unknown it is -1.
        """
        found = np.full((len(self.through.components), where.size), -1)
        at = 0
        for own, places in self._groups:
            number = np.searchsorted(places, where)
            there = number < places.size
            there[there] = places[number[there]] == where[there]
            found[np.ix_(own, there)] = at + own.size * number[there] + np.arange(own.size)[:, None]
            at += own.size * places.size
        return found

    def expanded(self, u: Array) -> Array:
        """Return the fields of displacements, shape (n, k) to (f, w, k)."""
        found = np.zeros((len(self.through.components), self.plane.width, u.shape[1]))
        at = 0
        for own, where in self._groups:
            part = u[at : at + own.size * where.size]
            found[own[:, None], where] = part.reshape(where.size, own.size, u.shape[1]).swapaxes(
                0, 1
            )
            at += len(part)
        return found

    # ------------------------------------------------------------------ matrices

    @property
    def _through(self) -> Array:
        """Factors of the integrals over the plane between two fields, shape (f, f, 9)."""
        modulus, poisson = self.material.youngs_modulus, self.material.poissons_ratio
        shear = modulus / (2.0 * (1.0 + poisson))
        lame = modulus * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
        _, weights = self.through.rule
        parts = self.through.components
        functions = self.through.functions
        derived = np.array(
            [
                [functions[kind].values[k], functions[kind].values[k], functions[kind].slopes[k]]
                for _, kind, k in parts
            ]
        )
        through = np.einsum("amq,bnq,q->abmn", derived, derived, weights)
        factors = np.zeros((len(parts), len(parts), 3, 3))
        for i, (a, _, _) in enumerate(parts):
            for j, (b, _, _) in enumerate(parts):
                factors[i, j, a, b] += lame
                factors[i, j, b, a] += shear
                if a == b:
                    factors[i, j] += shear * np.eye(3)
        # functions that are orthogonal leave rounding, which would fill the matrix
        size = np.sqrt(np.einsum("aamm->am", through))
        largest = size[:, None, :, None] * size[None, :, None, :]
        found = np.where(np.abs(through) > _ROUNDING * largest, factors * through, 0.0)
        return found.reshape(len(parts), len(parts), 9)

    @property
    def stiffness(self) -> sp.csc_matrix:
        r"""Stiffness [N/m].

        .. math:: \int \lambda\,\partial_k u_k\,\partial_l v_l
                  + G\,(\partial_l u_k\,\partial_l v_k + \partial_l u_k\,\partial_k v_l)
        """
        through = self._through
        blocks = [
            [
                self._block(through[np.ix_(own, other)], where, there)
                for other, there in self._groups
            ]
            for own, where in self._groups
        ]
        matrix = sp.csr_matrix(sp.bmat(blocks))
        matrix.eliminate_zeros()
        # it is symmetric: its rows are its columns
        return sp.csc_matrix((matrix.data, matrix.indices, matrix.indptr), shape=matrix.shape)

    def _block(self, through: Array, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Any:
        """Return the stiffness between unknowns of two groups of fields."""
        of_row, of_column, planes = self.plane.pattern
        number = np.full((2, self.plane.width), -1)
        number[0, rows], number[1, columns] = np.arange(rows.size), np.arange(columns.size)
        kept = np.flatnonzero((number[0, of_row] >= 0) & (number[1, of_column] >= 0))
        a, b, _ = through.shape
        count = np.bincount(number[0, of_row[kept]], minlength=rows.size)
        shape = (a * rows.size, b * columns.size)
        if not kept.size * a * b:
            return sp.csr_matrix(shape)
        values = (planes[kept] @ through.reshape(a * b, 9).T).reshape(-1, a, b)
        ends = np.concatenate(([0], np.cumsum(count)))
        return sp.bsr_matrix((values, number[1, of_column[kept]], ends), shape=shape).tocsr()

    @cached_property
    def _masses(self) -> tuple[Any, ...]:
        """Mass matrix of one field of each group [kg]; functions are orthonormal."""
        rows, columns, planes = self.plane.pattern
        values = self.material.density * planes[:, 8]
        whole: Any = sp.csr_matrix((values, (rows, columns)), shape=(self.plane.width,) * 2)
        return tuple(sp.csr_matrix(whole[where][:, where]) for _, where in self._groups)

    def mass_times(self, u: Array) -> Array:
        """Multiply displacements, shape (n,) or (n, k), by the mass matrix [kg]."""
        found, at = [], 0
        for (own, where), mass in zip(self._groups, self._masses, strict=True):
            part = u[at : at + own.size * where.size]
            found.append(
                (mass @ part.reshape(where.size, part.size // max(where.size, 1))).reshape(
                    part.shape
                )
            )
            at += len(part)
        return np.concatenate(found)

    # ------------------------------------------------------------------ loads and readings

    def spread(self, direction: int, row: Array, through: Callable[[Array], Array]) -> Array:
        r"""Return :math:`\int r(x, y)\,f(z)\,u_i`, of a row on the scalar space, shape (n,).

        The row is one of means over the plane or a line of it; f is a function of the distance from
        the middle plane [m], even or odd as the displacement is.
        """
        z, weights = self.through.rule
        found = np.zeros((len(self.through.components), self.plane.width))
        for i, (d, kind, k) in enumerate(self.through.components):
            if d == direction:
                own = self.through.functions[kind].values[k]
                found[i] = np.sum(own * through(z) * weights) * row
        return self.gathered(found)

    def mean(self, row: Array) -> Array:
        """Return the mean through the thickness of a row of a plane continuum, shape (n,)."""
        h = self.through.thickness
        x, y = row.reshape(2, -1)
        return self.spread(0, x, lambda z: np.ones_like(z) / h) + self.spread(
            1, y, lambda z: np.ones_like(z) / h
        )

    def middle(self, row: Array) -> Array:
        """Return what a row of a plane continuum says of the middle plane, shape (n,)."""
        found = np.zeros((len(self.through.components), self.plane.width))
        values = self.through.values_at(np.zeros(1))
        for i, (d, kind, k) in enumerate(self.through.components):
            if d < 2:
                found[i] = values[kind][0][k, 0] * row.reshape(2, -1)[d]
        return self.gathered(found)

    @property
    def _motions(self) -> tuple[tuple[tuple[int, tuple[float, float, float], int], ...], ...]:
        """The three rigid motions about the origin as sums of fields.

        Each is of a direction, of factors of 1, x and y, and of a power of z.
        """
        one, x, y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
        less_x, less_y, less = (0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0)
        if self.through.out_of_plane:
            return ((2, one, 0),), ((2, y, 0), (1, less, 1)), ((2, less_x, 0), (0, one, 1))
        return ((0, one, 0),), ((1, one, 0),), ((0, less_y, 0), (1, x, 0))

    @property
    def rigid(self) -> Array:
        """Displacements of its rigid motions about the origin, shape (n, 3).

        In the plane those along x and y and the rotation, out of it that along z and the rotations
        about x and y.
        """
        basis = self.plane.places
        return np.column_stack(
            [
                sum(
                    self.spread(d, basis @ np.array(plane), lambda z, p=p: z**p)
                    for d, plane, p in motion
                )
                for motion in self._motions
            ]
        )

    @property
    def pins(self) -> NDArray[np.intp]:
        """Three unknowns that hold it if nothing else does."""
        x, y = self.plane.places[: self.plane.mesh.nv, 1:].T
        fields, _ = self._groups[0]
        first = [self.through.components[k][0] for k in fields].index
        if not self.through.out_of_plane:
            vertex, along = np.divmod(plane_pins(x, y, x.size), x.size)[::-1]
            return fields.size * vertex + np.array([first(0), first(1)])[along]
        far = int(np.argmax(np.hypot(x - x[0], y - y[0])))
        aside = (x - x[0]) * (y[far] - y[0]) - (y - y[0]) * (x[far] - x[0])
        return fields.size * np.array([0, far, int(np.argmax(np.abs(aside)))]) + first(2)

    def motion(self, region: str, at: tuple[float, float]) -> Array:
        """Return the rigid motion of regions about a point nearest to theirs in mean square.

        As `rigid` orders them, [m] and [rad], shape (3, n).
        """
        x, y = ng.x / METRE - at[0], ng.y / METRE - at[1]
        plane = (ng.CoefficientFunction(1.0), x, y)
        rows = np.array([self.plane.linear(lambda v, c=c: c * v, region) for c in plane]) / METRE**2
        where = self.plane.mesh.Materials(region)
        gram = np.zeros((3, 3))
        for i in range(3):
            for j in range(3):
                gram[i, j] = ng.Integrate(
                    plane[i] * plane[j],
                    self.plane.mesh,
                    definedon=where,
                    order=4 * self.plane.order,
                )
        gram /= METRE**2
        h = self.through.thickness
        powers = {0: h, 2: h**3 / 12.0}
        square = np.zeros((3, 3))
        means = []
        for i, a in enumerate(self._motions):
            means.append(
                sum(self.spread(d, np.array(c) @ rows, lambda z, p=p: z**p) for d, c, p in a)
            )
            for j, b in enumerate(self._motions):
                square[i, j] = sum(
                    np.array(c) @ gram @ np.array(e) * powers[p + q]
                    for d, c, p in a
                    for f, e, q in b
                    if d == f
                )
        return np.asarray(np.linalg.solve(square, np.array(means)), dtype=float)

    def thermal(self, plane: ng.CoefficientFunction | float, power: int) -> Array:
        r"""Return the load :math:`\int\alpha T (3\lambda + 2G)\nabla\cdot v` of T(x, y) z^p."""
        modulus, poisson = self.material.youngs_modulus, self.material.poissons_ratio
        pressure = modulus / (1.0 - 2.0 * poisson) * (self.material.thermal_expansion or 0.0)
        z, weights = self.through.rule
        slopes = [
            self.plane.linear(lambda v, d=d: plane * ng.Grad(v)[d]) / METRE for d in (0, 1)
        ]  # of mm^2 over mm
        whole = self.plane.linear(lambda v: plane * v) / METRE**2
        along = sum(self.spread(d, slopes[d], lambda s: s**power) for d in (0, 1))
        across = np.zeros((len(self.through.components), self.plane.width))
        for i, (d, kind, k) in enumerate(self.through.components):
            if d == 2:
                slope = self.through.functions[kind].slopes[k]
                across[i] = np.sum(slope * z**power * weights) * whole
        return pressure * (along + self.gathered(across))
