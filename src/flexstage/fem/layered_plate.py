"""A part of a plate in space on a mesh of its plane: stiffness, mass, loads, readings."""

import math
from collections.abc import Callable, Sequence
from functools import cached_property

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.elasticity.shapes import METRE
from flexstage.fem.constrained import plane_pins
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.material import Material


class PlaneIntegrals:
    """Integrals over the plane of a part, which all motions of the plate share."""

    def __init__(self, mesh: ng.Mesh, *, order: int, held: str) -> None:
        self.mesh, self.order = mesh, order
        self.scalar = ng.H1(mesh, order=order, dirichlet=held)
        self.width = int(self.scalar.ndof)

    @cached_property
    def pattern(self) -> tuple[NDArray[np.int64], NDArray[np.int64], list[list[Array]]]:
        """Rows and columns of the integrals of derivatives of shape functions, and their values.

        Values (m, n) are of derivative m of the test function and n of the trial function, in
        metres; the third is no derivative.
        """
        p, q = self.scalar.TnT()
        tests = (ng.Grad(q)[0], ng.Grad(q)[1], q)
        trials = (ng.Grad(p)[0], ng.Grad(p)[1], p)
        shape = (self.width, self.width)
        found: list[list[Array]] = [[np.zeros(0)] * 3 for _ in range(3)]
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
                found[m][n] = matrix.data
                if n != m:  # the pattern is that of its transpose
                    turned = matrix.T.tocsr()
                    turned.sort_indices()
                    found[n][m] = turned.data
        rows = np.repeat(np.arange(self.width), np.diff(matrix.indptr))
        return rows, matrix.indices.astype(np.int64), found

    @cached_property
    def places(self) -> Array:
        """Factors of the shape functions that make up 1, x and y [m], shape (n, 3)."""
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

    def linear(self, integrand: Callable[[object], object], region: str = ".*") -> Array:
        """Assemble an integral over regions of the plane [mm^2] with the scalar test function."""
        form = ng.LinearForm(self.scalar)
        form += integrand(self.scalar.TestFunction()) * ng.dx(region, bonus_intorder=2)
        form.Assemble()
        return form.vec.FV().NumPy().copy()


class LayeredPlate:
    """A part of a plate on a mesh of its plane, with functions through its thickness.

    Unknowns are the fields of `ThroughThickness.components` one after the other, each on the scalar
    space of the mesh; fields of notches alone vanish in the bodies, which begin some way from the
    mouths of the notches. Of each notch `notches` gives the region, the centre [m] and how far from
    there its fields reach [m].
    """

    def __init__(
        self,
        plane: PlaneIntegrals,
        material: Material,
        through: ThroughThickness,
        notches: Sequence[tuple[str, tuple[float, float], float]],
    ) -> None:
        self.plane, self.material, self.through = plane, material, through
        self.width = plane.width
        self.size = self.width * len(through.components)
        anywhere = plane.inside(notches)
        loose = np.array(self.plane.scalar.FreeDofs(), dtype=bool)
        #: Which unknowns there are, shape (n,).
        self.free = np.concatenate(
            [
                loose if k < through.functions[kind].in_bodies else loose & anywhere
                for _, kind, k in through.components
            ]
        )

    # ------------------------------------------------------------------ matrices

    @cached_property
    def stiffness(self) -> sp.csc_matrix:
        r"""Stiffness of the unknowns that are free [N/m].

        .. math:: \int \lambda\,\partial_k u_k\,\partial_l v_l
                  + G\,(\partial_l u_k\,\partial_l v_k + \partial_l u_k\,\partial_k v_l)
        """
        modulus, poisson = self.material.youngs_modulus, self.material.poissons_ratio
        shear = modulus / (2.0 * (1.0 + poisson))
        lame = modulus * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
        _, weights = self.through.rule
        parts = self.through.components
        rows, columns, planes = self.plane.pattern
        number = np.cumsum(self.free) - 1
        entries: list[tuple[Array, Array, Array]] = []

        def across(m: int, a: tuple[int, str, int]) -> Array:
            own = self.through.functions[a[1]]
            return own.slopes[a[2]] if m == 2 else own.values[a[2]]

        for i, a in enumerate(parts):
            for j, b in enumerate(parts):
                factors = np.zeros((3, 3))
                factors[a[0], b[0]] += lame
                factors[b[0], a[0]] += shear
                if a[0] == b[0]:
                    factors += shear * np.eye(3)
                at, to = i * self.width + rows, j * self.width + columns
                kept = np.flatnonzero(self.free[at] & self.free[to])
                values = np.zeros(kept.size)
                for m, n in zip(*np.nonzero(factors), strict=True):
                    through = factors[m, n] * np.sum(across(m, a) * across(n, b) * weights)
                    if through:
                        values += through * planes[m][n][kept]
                if values.any():
                    entries.append((number[at[kept]], number[to[kept]], values))
        at, to, values = (np.concatenate(c) for c in zip(*entries, strict=True))
        count = int(self.free.sum())
        return sp.csc_matrix((values, (at, to)), shape=(count, count))

    @cached_property
    def _mass(self) -> sp.csr_matrix:
        """Mass matrix of one field [kg]; all share it, as the functions are orthonormal."""
        rows, columns, planes = self.plane.pattern
        values = self.material.density * planes[2][2]
        return sp.csr_matrix((values, (rows, columns)), shape=(self.width, self.width))

    def mass_times(self, u: Array) -> Array:
        """Multiply displacements, shape (n,) or (n, k), by the mass matrix [kg]."""
        fields = len(self.through.components)
        by_unknown = u.reshape(fields, self.width, -1).transpose(1, 0, 2).reshape(self.width, -1)
        found = (self._mass @ by_unknown).reshape(self.width, fields, -1)
        return found.transpose(1, 0, 2).reshape(u.shape)

    # ------------------------------------------------------------------ loads and readings

    def spread(self, direction: int, row: Array, through: Callable[[Array], Array]) -> Array:
        r"""Return :math:`\int r(x, y)\,f(z)\,u_i`, of a row on the scalar space, shape (n,).

        The row is one of means over the plane or a line of it; f is a function of the distance from
        the middle plane [m], even or odd as the displacement is.
        """
        z, weights = self.through.rule
        found = np.zeros((len(self.through.components), self.width))
        for i, (d, kind, k) in enumerate(self.through.components):
            if d == direction:
                own = self.through.functions[kind].values[k]
                found[i] = np.sum(own * through(z) * weights) * row
        return found.reshape(-1)

    def mean(self, row: Array) -> Array:
        """Return the mean through the thickness of a row of a plane continuum, shape (n,)."""
        h = self.through.thickness
        x, y = row.reshape(2, -1)
        return sum(
            self.spread(d, part, lambda z: np.ones_like(z) / h) for d, part in ((0, x), (1, y))
        )

    def middle(self, row: Array) -> Array:
        """Return what a row of a plane continuum says of the middle plane, shape (n,)."""
        found = np.zeros((len(self.through.components), self.width))
        values = self.through.values_at(np.zeros(1))
        for i, (d, kind, k) in enumerate(self.through.components):
            if d < 2:
                found[i] = values[kind][0][k, 0] * row.reshape(2, -1)[d]
        return found.reshape(-1)

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

    @cached_property
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
        vertices = slice(0, self.plane.mesh.nv)
        if not self.through.out_of_plane:
            second = self.width * [d for d, _, _ in self.through.components].index(1)
            root = math.sqrt(self.through.thickness)  # of the constant among the functions
            x = self.rigid[second:][vertices, 2] / root
            return plane_pins(x, -self.rigid[vertices, 2] / root, second)
        first = self.width * [d for d, _, _ in self.through.components].index(2)
        y, x = self.rigid[first:][vertices, 1:].T * ((1.0,), (-1.0,))
        far = int(np.argmax(np.hypot(x - x[0], y - y[0])))
        aside = (x - x[0]) * (y[far] - y[0]) - (y - y[0]) * (x[far] - x[0])
        return first + np.array([0, far, int(np.argmax(np.abs(aside)))])

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
        return np.linalg.solve(square, np.array(means))

    def thermal(self, plane: ng.CoefficientFunction | float, power: int) -> Array:
        r"""Return the load of a temperature T(x, y) z^p, :math:`\int\alpha T (3\lambda + 2G)\nabla\cdot v`."""
        modulus, poisson = self.material.youngs_modulus, self.material.poissons_ratio
        pressure = modulus / (1.0 - 2.0 * poisson) * (self.material.thermal_expansion or 0.0)
        z, weights = self.through.rule
        slopes = [
            self.plane.linear(lambda v, d=d: plane * ng.Grad(v)[d]) / METRE for d in (0, 1)
        ]  # of mm^2 over mm
        whole = self.plane.linear(lambda v: plane * v) / METRE**2
        found = sum(self.spread(d, slopes[d], lambda s: s**power) for d in (0, 1))
        found = found.reshape(-1, self.width)
        for i, (d, kind, k) in enumerate(self.through.components):
            if d == 2:
                slope = self.through.functions[kind].slopes[k]
                found[i] += np.sum(slope * z**power * weights) * whole
        return pressure * found.reshape(-1)
