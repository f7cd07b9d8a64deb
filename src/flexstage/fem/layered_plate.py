"""A part of a plate on a mesh of its plane: stiffness, mass, loads, readings."""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from itertools import product

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.elasticity.continuum import first_lame
from flexstage.elasticity.shapes import METRE
from flexstage.fem.plane_integrals import SINGULAR, FrontalFactor, PlaneIntegrals, factorised
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.quantities.material import Material

_AT_ONCE = 1024  # blocks of the stiffness
_ROUNDING = 1e-12  # of two functions' integral, in parts of what it could be

#: Reference material: stiffness and mass are proportional to modulus, density and expansion, so
#: that one condensation serves every material of the same Poisson's ratio.
REFERENCE = Material(
    name="reference",
    youngs_modulus=1e11,
    poissons_ratio=0.0,
    density=1e4,
    thermal_expansion=1e-5,
)


class UncheckedMaterial(Material):
    """A material whose figures may be beyond those of any real one."""

    def __post_init__(self) -> None:
        pass


def _shear(material: Material) -> float:
    return material.youngs_modulus / (2.0 * (1.0 + material.poissons_ratio))


class LayeredPlate:
    """A part of a plate on a mesh of its plane, with functions through its thickness.

    Its fields are those of `ThroughThickness.components`, on the scalar space of the mesh. Fields
    of notches alone vanish in the bodies beyond a radius about each notch; `notches` gives the
    region, the centre [m] and that radius [m] of each. Unknowns are the free ones: the fields of
    each unknown of the scalar space are adjacent, in order of elimination. `other` is the material
    of the regions that the integrals over the plane have as such.
    """

    def __init__(
        self,
        plane: PlaneIntegrals,
        material: Material,
        through: ThroughThickness,
        notches: Sequence[tuple[str, tuple[float, float], float]],
        other: Material | None = None,
    ) -> None:
        self.plane, self.material, self.through = plane, material, through
        self.other = material if other is None else other
        loose = np.array(plane.scalar.FreeDofs(), dtype=bool)
        in_bodies = np.array(
            [k < through.functions[kind].in_bodies for _, kind, k in through.components]
        )
        there = loose & in_bodies[:, None]
        if not in_bodies.all():
            there |= loose & plane.inside(notches)
        # at each place the fields that bodies have come first
        self._fields = np.argsort(~in_bodies, kind="stable")
        order = plane.order_of_elimination
        places, fields = np.nonzero(there[self._fields][:, order].T)
        #: Number of unknowns.
        self.size = places.size
        # of each unknown its field and place, in one number; and back, or -1
        self._field_and_place = self._fields[fields] * plane.width + order[places]
        numbers = np.full(there.size, -1)
        numbers[self._field_and_place] = np.arange(self.size)
        self._numbers = numbers.reshape(there.shape)

    def gathered(self, fields: Array) -> Array:
        """Return the unknowns of fields on the scalar space, shape (..., f, w) to (..., n)."""
        return fields.reshape(*fields.shape[:-2], -1)[..., self._field_and_place]

    def numbers(self, where: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the unknowns of fields at some places of the scalar space, shape (f, len(where)).

        It is -1 where there is no unknown.
        """
        return self._numbers[:, where]

    def expanded(self, u: Array) -> Array:
        """Return the fields of displacements, shape (n, k) to (f, w, k)."""
        fields = np.zeros((self._numbers.size, u.shape[1]))
        fields[self._field_and_place] = u
        return fields.reshape(*self._numbers.shape, u.shape[1])

    # ------------------------------------------------------------------ matrices

    @property
    def shear_modulus(self) -> float:
        """Shear modulus [Pa]."""
        return _shear(self.material)

    @property
    def lame(self) -> tuple[float, float]:
        """First Lamé constant, and its increase in regions in plane strain [Pa].

        Plane stress is three-dimensional elasticity with another one.
        """
        first = first_lame(self.material)
        if self.through.in_space:
            return first, 0.0
        flat = first_lame(self.material, flat=True)
        return flat, first - flat

    @property
    def _increases(self) -> tuple[Array, Array]:
        """First Lamé constant and shear modulus, then their increases by region [Pa]."""
        (lame, more), shear = self.lame, self.shear_modulus
        first, second = [lame], [shear]
        if self.plane.strained is not None:
            first.append(more)
            second.append(0.0)
        if self.plane.other is not None:
            first.append(first_lame(self.other, flat=not self.through.in_space) - lame)
            second.append(_shear(self.other) - shear)
        return np.array(first), np.array(second)

    @property
    def _through(self) -> Array:
        """Factors of the integrals over the plane between two fields, shape (f, f, 9) or more."""
        lame, shear = self._increases
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
        factors = np.zeros((len(lame), len(parts), len(parts), 3, 3))
        for i, (a, _, _) in enumerate(parts):
            for j, (b, _, _) in enumerate(parts):
                factors[:, i, j, a, b] += lame
                factors[:, i, j, b, a] += shear
                if a == b:
                    factors[:, i, j] += shear[:, None, None] * np.eye(3)
        # functions that are orthogonal leave rounding, which would fill the matrix
        size = np.sqrt(np.einsum("aamm->am", through))
        largest = size[:, None, :, None] * size[None, :, None, :]
        products = np.where(np.abs(through) > _ROUNDING * largest, factors * through, 0.0)
        return np.moveaxis(products, 0, 2).reshape(len(parts), len(parts), -1)

    @property
    def stiffness(self) -> sp.csc_matrix:
        r"""Stiffness [N/m].

        .. math:: \int \lambda\,\partial_k u_k\,\partial_l v_l
                  + G\,(\partial_l u_k\,\partial_l v_k + \partial_l u_k\,\partial_k v_l)
        """
        of_row, of_column, _ = self.plane.pattern
        # rows of one place are consecutive and equally long, one block after the other
        height, first = self._heights
        width = height[of_column]
        length = np.bincount(of_row, width, self.plane.width).astype(np.intp)
        order = self.plane.order_of_elimination
        ends = np.concatenate(([0], np.cumsum(np.repeat(length[order], height[order]))))
        before = np.cumsum(width) - width
        start = np.zeros(self.plane.width, dtype=np.intp)
        start[order] = np.cumsum(length[order]) - length[order]
        corner = ends[np.maximum(first[of_row], 0)] + before - start[of_row]
        data, indices = np.zeros(ends[-1]), np.zeros(ends[-1], dtype=np.int32)
        for some, block, rows, columns in self._blocks(np.arange(of_row.size)):
            at = corner[some, None, None] + length[of_row[some], None, None] * rows + columns
            data[at] = block
            indices[at] = first[of_column[some], None, None] + columns
        matrix = sp.csr_matrix((data, indices, ends), shape=(self.size, self.size))
        matrix.eliminate_zeros()
        # it is symmetric: its rows are its columns
        return sp.csc_matrix((matrix.data, matrix.indices, matrix.indptr), shape=matrix.shape)

    @property
    def _heights(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Number of unknowns of each place, and the first of them."""
        return np.count_nonzero(self._numbers >= 0, axis=0), self._numbers[self._fields[0]]

    def _blocks(
        self, entries: NDArray[np.intp]
    ) -> Iterator[tuple[NDArray[np.intp], Array, NDArray[np.intp], NDArray[np.intp]]]:
        """Yield blocks of the stiffness, of two places each, for entries of the pattern.

        They come in groups of one shape, so that intermediate results stay in the processor's
        cache: numbers of the entries, the blocks, and the numbers of their rows and columns.
        """
        through = self._through[np.ix_(self._fields, self._fields)]
        of_row, of_column, planes = self.plane.pattern
        height, _ = self._heights
        high, wide = height[of_row[entries]], height[of_column[entries]]
        for a, b in product(np.unique(height[height > 0]).tolist(), repeat=2):
            every = np.flatnonzero((high == a) & (wide == b))
            factors = through[:a, :b].reshape(a * b, -1).T
            for some in np.split(every, range(_AT_ONCE, every.size, _AT_ONCE)):
                blocks = (planes[:, entries[some]].T @ factors).reshape(-1, a, b)
                yield some, blocks, np.arange(a)[:, None], np.arange(b)

    def factorised(
        self, springs: NDArray[np.intp] | None = None, stiffer: float = 1.0
    ) -> SuperLU | FrontalFactor:
        """Factorise the stiffness, with springs at some unknowns that multiply their stiffness."""
        at = np.zeros(0, dtype=np.intp) if springs is None else springs
        if not self.through.in_space:  # two fields are too few for dense fronts
            stiffness = self.stiffness
            for i in at:
                stiffness[i, i] *= stiffer
            return factorised(stiffness)
        fronts = self.plane.fronts
        height, first = (a[self.plane.order_of_elimination] for a in self._heights)
        turned = np.argsort(fronts.rank)
        factor = FrontalFactor(fronts, first[turned], height[turned])
        for some, block, rows, columns in self._blocks(fronts.entries):
            start, apart = factor.start[some, None, None], factor.apart[some, None, None]
            factor.data[start + apart * rows + columns] = block
        factor.data[factor.diagonal[at]] *= stiffer
        try:
            factor.factorise()
        except np.linalg.LinAlgError:
            raise ModelError(SINGULAR) from None
        return factor

    @cached_property
    def _mass(self) -> sp.csr_matrix:
        """Mass matrix [kg]; functions are orthonormal, so that fields are not coupled."""
        rows, columns, planes = self.plane.pattern
        row, column = self._numbers[:, rows], self._numbers[:, columns]
        free = (row >= 0) & (column >= 0)
        values = self.material.density * planes[8]
        if self.plane.other is not None:
            values = values + (self.other.density - self.material.density) * planes[-1]
        values = np.broadcast_to(values, free.shape)
        shape = (self.size, self.size)
        return sp.csr_matrix((values[free], (row[free], column[free])), shape=shape)

    def mass_times(self, u: Array) -> Array:
        """Multiply displacements, shape (n,) or (n, k), by the mass matrix [kg]."""
        return np.asarray(self._mass @ u)

    # ------------------------------------------------------------------ loads and readings

    def spread(self, direction: int, row: Array, through: Callable[[Array], Array]) -> Array:
        r"""Return :math:`\int r(x, y)\,f(z)\,u_i`, of a row on the scalar space, shape (n,).

        The row is one of means over the plane or a line in it; f is a function of the distance from
        the middle plane [m], even or odd as the displacement is.
        """
        z, weights = self.through.rule
        fields = np.zeros((len(self.through.components), self.plane.width))
        for i, (d, kind, k) in enumerate(self.through.components):
            if d == direction:
                function = self.through.functions[kind].values[k]
                fields[i] = np.sum(function * through(z) * weights) * row
        return self.gathered(fields)

    def mean(self, row: Array) -> Array:
        """Return the mean through the thickness of a row of a plane continuum, shape (n,)."""
        h = self.through.thickness
        x, y = row.reshape(2, -1)
        return self.spread(0, x, lambda z: np.ones_like(z) / h) + self.spread(
            1, y, lambda z: np.ones_like(z) / h
        )

    def middle(self, row: Array) -> Array:
        """Return a row of a plane continuum for the middle plane, shape (n,)."""
        fields = np.zeros((len(self.through.components), self.plane.width))
        values = self.through.values_at(np.zeros(1))
        for i, (d, kind, k) in enumerate(self.through.components):
            if d < 2:
                fields[i] = values[kind][0][k, 0] * row.reshape(2, -1)[d]
        return self.gathered(fields)

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
        """Three unknowns that support it if it is free."""
        x, y = self.plane.places[: self.plane.mesh.nv, 1:].T
        first = [d for d, _, _ in self.through.components].index
        # a vertex, and others from turning about it
        far = int(np.argmax(np.hypot(x - x[0], y - y[0])))
        if not self.through.out_of_plane:
            along = 0 if abs(y[far] - y[0]) > abs(x[far] - x[0]) else 1
            return self._numbers[[first(0), first(1), first(along)], [0, 0, far]]
        aside = (x - x[0]) * (y[far] - y[0]) - (y - y[0]) * (x[far] - x[0])
        return self._numbers[first(2), [0, far, int(np.argmax(np.abs(aside)))]]

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
        r"""Return the load :math:`\int\alpha T (3\lambda + 2G)\nabla\cdot v` of T(x, y) z^p.

        In a plane model the factor is 2 in place of 3, and the thickness of regions in plane strain
        is free to expand.
        """
        (lame, more), dimension = self.lame, 3 if self.through.in_space else 2
        pressure = dimension * lame + 2.0 * self.shear_modulus
        if self.plane.strained is not None:
            plane = plane * (1.0 + dimension * more / pressure * self.plane.strained)
        pressure *= self.material.thermal_expansion or 0.0
        if self.plane.other is not None:
            stretch = first_lame(self.other, flat=not self.through.in_space)
            there = dimension * stretch + 2.0 * _shear(self.other)
            there *= self.other.thermal_expansion or 0.0
            plane = plane * (1.0 + (there / pressure - 1.0) * self.plane.other)
        z, weights = self.through.rule
        slopes = [
            self.plane.linear(lambda v, d=d: plane * ng.Grad(v)[d]) / METRE for d in (0, 1)
        ]  # of mm^2 over mm
        along = sum(self.spread(d, slopes[d], lambda s: s**power) for d in (0, 1))
        if not self.through.in_space:
            return np.asarray(pressure * along)
        uniform = self.plane.linear(lambda v: plane * v) / METRE**2
        across = np.zeros((len(self.through.components), self.plane.width))
        for i, (d, kind, k) in enumerate(self.through.components):
            if d == 2:
                slope = self.through.functions[kind].slopes[k]
                across[i] = np.sum(slope * z**power * weights) * uniform
        return pressure * (along + self.gathered(across))
