"""Linear elasticity of a meshed part: matrices, loads, readings, statics, modes, stress."""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.elasticity.resources import parallel
from flexstage.elasticity.shapes import METRE
from flexstage.quantities.material import Material

_COMPONENTS = "xyz"


# The coordinates that each rotation turns into one another, by the dimension.
_TURNS = {2: [(0, 1)], 3: [(1, 2), (2, 0), (0, 1)]}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AttachedMass:
    """A mass attached to a part that does not stiffen it."""

    motion: Array
    """Motions for each degree of freedom of the part, one a row [m or rad], shape (k, n)."""
    inertia: Array
    """Mass or moment of inertia for each motion [kg or kg m^2], shape (k,)."""


def inverse_of(form: ng.BilinearForm, retained: Any) -> ng.BaseMatrix:
    """Factorise a condensed form in its retained unknowns, with recovery of element interiors."""
    inverse = form.mat.Inverse(retained, "sparsecholesky")
    one = ng.IdentityMatrix(form.space.ndof)
    outwards, inwards = one + form.harmonic_extension, one + form.harmonic_extension_trans
    return outwards @ inverse @ inwards + form.inner_solve


class Continuum:
    r"""A linear-elastic part on a mesh.

    .. math:: K u = f, \quad K_{ij} = \int \varepsilon(\phi_i) : C : \varepsilon(\phi_j)

    Displacements are in metres, forces in newtons; the mesh is in millimetres. Interior degrees of
    freedom of the elements are condensed before the factorisation, which is made once.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        The mesh, curved to `order`, in two or three dimensions.
    material : Material
        What the part is made of.
    order : int
        Polynomial order of the displacement.
    thickness : float, optional
        Thickness of a plane part [m]; None in three dimensions.
    strain : str
        Regular expression of the regions in plane strain; the others are in plane stress.
    fixed : str
        Regular expression of the fixed boundaries.
    fixed_components : Mapping
        Regular expression of the boundaries that are fixed in one direction, by ``x``, ``y``,
        ``z``.
    copies : int
        Number of copies of the meshed part: 2 where a half represents a part that is symmetric or
        antisymmetric about a plane. Stiffness, mass and volume forces are those of the whole.
    shift : float
        Adds this multiple of the mass matrix to the stiffness [rad^2/s^2], so that a free part can
        be solved; its modes are still found.
    regions : Mapping
        Materials of regions that are of another one, by their names.

    Raises
    ------
    ModelError
        The thickness does not suit the dimension of the mesh, the part is free without a shift, or
        the stiffness cannot be factorised.

    Notes
    -----
    Validity: small displacements and strains, isotropic material. Plane stress holds for parts thin
    against their other dimensions, plane strain for notches wide against their neck.
    """

    def __init__(
        self,
        mesh: ng.Mesh,
        material: Material,
        *,
        order: int,
        thickness: float | None = None,
        strain: str = "",
        fixed: str = "",
        fixed_components: Mapping[str, str] | None = None,
        copies: int = 1,
        shift: float = 0.0,
        regions: Mapping[str, Material] | None = None,
    ) -> None:
        if (thickness is None) != (mesh.dim == 3):
            raise ModelError(
                "a plane mesh needs a thickness, and a mesh in three dimensions must have none"
            )
        self.mesh = mesh
        self.material = material
        self.order = order
        self.dimension = int(mesh.dim)
        self.thickness = thickness
        self.shift = shift
        self._matrices: dict[str, Any] = {}  # stiffness and mass, whatever holds the part
        self._set_supports(fixed, fixed_components or {})
        self.materials = [(regions or {}).get(name, material) for name in mesh.GetMaterials()]
        self.shear_modulus = self._by_region(
            lambda m: m.youngs_modulus / (2.0 * (1.0 + m.poissons_ratio))
        )
        self.density = self._by_region(lambda m: m.density)
        if self.dimension == 2:
            wide = mesh.Materials(strain).Mask() if strain else [False] * len(self.materials)
            # plane stress is three-dimensional elasticity with another first Lamé constant
            self.lame = ng.CoefficientFunction(
                [first_lame(m, flat=not wide[i]) for i, m in enumerate(self.materials)]
            )
            self.in_strain = ng.CoefficientFunction(
                [float(wide[i]) for i in range(len(self.materials))]
            )
        else:
            self.lame = ng.CoefficientFunction(self._by_region(first_lame))
            self.in_strain = ng.CoefficientFunction(1.0)
        # A gradient is by millimetres. What is left of a volume integral of two gradients:
        self._measure = copies * (thickness if thickness is not None else 1.0 / METRE)
        self._volume = self._measure / METRE**2
        self._density: Any = self._volume * self.density

    def _by_region(self, figure: Callable[[Material], float]) -> Any:
        """Return a figure of its material, or a function on the mesh where it has several."""
        values = [figure(m) for m in self.materials]
        return values[0] if len(set(values)) == 1 else ng.CoefficientFunction(values)

    def _set_supports(self, fixed: str, fixed_components: Mapping[str, str]) -> None:
        parts = {f"dirichlet{c}": names for c, names in fixed_components.items()}
        self.space = ng.VectorH1(self.mesh, order=self.order, dirichlet=fixed, **parts)
        self.size: int = self.space.ndof
        self.free = np.array(self.space.FreeDofs(), dtype=bool)
        self._solver: ng.BaseMatrix | None = None

    def with_supports(
        self, fixed: str = "", fixed_components: Mapping[str, str] | None = None
    ) -> "Continuum":
        """Return the same part with other supports, as in the initialiser.

        Matrices that do not depend on them are assembled once for both, while either is in use.
        """
        other = copy(self)
        other._set_supports(fixed, fixed_components or {})
        return other

    # ------------------------------------------------------------------ matrices

    def _form(self) -> ng.BilinearForm:
        # a field for each component, in the order of the space: the integrals of a vector field
        # would go through the components that a function does not have, at several times the cost
        space = ng.FESpace([ng.H1(self.mesh, order=self.order) for _ in range(self.dimension)])
        fields = tuple(zip(*space.TnT(), strict=True))
        slopes = [(ng.Grad(u), ng.Grad(v)) for u, v in fields]
        density: Any = sum(self.shear_modulus * ng.InnerProduct(a, b) for a, b in slopes)
        for i, (a, _) in enumerate(slopes):
            for j, (_, b) in enumerate(slopes):
                density += self.lame * a[i] * b[j] + self.shear_modulus * a[j] * b[i]
        form = ng.BilinearForm(space, symmetric=True, condense=True)
        form += self._measure * density * ng.dx
        if self.shift:
            form += self.shift * self._density * sum(u * v for u, v in fields) * ng.dx
        return form

    def factorise(self) -> None:
        """Assemble and factorise the stiffness; `solve` does so if necessary.

        Raises
        ------
        ModelError
            The part is free, or the stiffness cannot be factorised.
        """
        if self._solver is not None:
            return
        if self.free.all() and not self.shift:
            raise ModelError(
                "the part is not constrained, so it has no static solution: fix a boundary, or "
                "give a shift"
            )
        with parallel():
            progress.update("assembly")
            if "stiffness" not in self._matrices:
                form = self._form()
                form.Assemble()
                self._matrices["stiffness"] = form
            # kept, as the operators refer to it
            form = self._matrices["stiffness"]
            retained = self.space.FreeDofs(True)
            progress.update("factorisation", 0.5)
            self._solver = inverse_of(form, retained)
            self._right = form.mat.CreateColVector()
            self._left = form.mat.CreateColVector()

    def release(self) -> None:
        """Free factorisation and matrices, the bulk of the memory; fields stay."""
        self._solver = None
        self._matrices = {}  # another part, held otherwise, may still use those of before

    @property
    def _mass(self) -> sp.csr_matrix:
        """Mass matrix of one component of the displacement [kg]; all components share it."""
        if "mass" not in self._matrices:
            self._matrices["mass"] = self._assembled_mass()
        return self._matrices["mass"]

    def _assembled_mass(self) -> sp.csr_matrix:
        scalar = ng.H1(self.mesh, order=self.order)
        if scalar.ndof * self.dimension != self.size:
            raise ModelError("the components of the displacement do not share one scalar space")
        p, q = scalar.TnT()
        with parallel():
            form = ng.BilinearForm(scalar)
            form += self._density * p * q * ng.dx
            form.Assemble()
        rows, columns, values = form.mat.COO()
        shape = (scalar.ndof, scalar.ndof)
        return sp.csr_matrix((np.asarray(values), (np.asarray(rows), np.asarray(columns))), shape)

    def mass_times(self, u: Array) -> Array:
        """Multiply by the mass matrix.

        Parameters
        ----------
        u : numpy.ndarray
            Displacements, shape (n,) or (n, k).

        Returns
        -------
        numpy.ndarray
            M u, same shape.
        """
        d, width = self.dimension, u.shape[1:]
        return np.concatenate([self._mass @ part for part in u.reshape(d, self.size // d, *width)])

    def solve(self, load: Array) -> Array:
        """Return the displacement under loads.

        Parameters
        ----------
        load : numpy.ndarray
            Loads, shape (n,) or (n, k).

        Returns
        -------
        numpy.ndarray
            Displacements, same shape.

        Raises
        ------
        ModelError
            The part is free, or the solution is not finite.
        """
        self.factorise()
        assert self._solver is not None
        if load.ndim == 2:
            return np.column_stack([self.solve(column) for column in load.T])
        with parallel():
            self._right.FV().NumPy()[:] = np.where(self.free, load, 0.0)
            self._left.data = self._solver * self._right
        solution = self._left.FV().NumPy().copy()
        if not np.isfinite(solution).all():
            raise ModelError("the stiffness is singular: a part of the mesh is unconstrained")
        return solution

    def modes(
        self,
        count: int,
        *,
        attached: Sequence[AttachedMass] = (),
        respond: Callable[[Array], Array] | None = None,
        tolerance: float = 1e-9,
    ) -> tuple[Array, Array]:
        r"""Return the lowest natural modes, :math:`K\phi = \omega^2 M\phi`.

        Parameters
        ----------
        count : int
            How many.
        attached : sequence of AttachedMass
            Masses attached to the part.
        respond : callable, optional
            Displacement under a load, where the part has more constraints than for `solve`.
        tolerance : float
            Relative tolerance of the eigenvalues.

        Returns
        -------
        tuple of numpy.ndarray
            omega [rad/s], shape (count,), and shapes with phi^T M phi = 1, shape (n, count).

        Raises
        ------
        ConvergenceError
            The iteration did not end.
        """
        n = self.size

        def mass(x: Array) -> Array:
            x = x.ravel()
            total = self.mass_times(x)
            for rider in attached:
                total = total + rider.motion.T @ (rider.inertia * (rider.motion @ x))
            return total

        steps = 0

        def solve(x: Array) -> Array:
            # a Krylov space of twice the modes, rebuilt once as a rule
            nonlocal steps
            steps += 1
            progress.update("modes", steps / (steps + max(4.0 * count - steps, 0.15 * steps)))
            return answer(x.ravel())

        answer = respond or self.solve
        start = answer(np.random.default_rng(0).standard_normal(n))
        operator: Any = spl.LinearOperator  # its types do not know its keywords
        weigh = operator((n, n), matvec=mass, dtype=float)
        try:
            values, shapes = spl.eigsh(
                weigh,
                k=count,
                M=weigh,
                sigma=0.0,
                OPinv=operator((n, n), matvec=solve, dtype=float),
                v0=start,
                tol=tolerance,
            )
        except spl.ArpackError as error:
            raise ConvergenceError(f"the modes of the mesh were not found: {error}") from error
        order = np.argsort(values)
        omega = np.sqrt(np.clip(values[order] - self.shift, 0.0, None))
        return omega, shapes[:, order]

    # ------------------------------------------------------------------ loads and readings

    def _linear(self, *integrals: object) -> Array:
        form = ng.LinearForm(self.space)
        for integral in integrals:
            form += integral
        with parallel():
            form.Assemble()
        return form.vec.FV().NumPy().copy()

    def _vector(self, direction: Sequence[float] | ng.CoefficientFunction) -> object:
        if isinstance(direction, ng.CoefficientFunction):
            return direction
        components = tuple(float(c) for c in direction)[: self.dimension]
        return ng.CoefficientFunction(components + (0.0,) * (self.dimension - len(components)))

    def measure(self, *, boundary: str = "", region: str = "") -> float:
        """Return the length or area of boundaries, or the area or volume of regions.

        Parameters
        ----------
        boundary : str
            Regular expression of boundaries.
        region : str
            Regular expression of regions, if no boundary is given.

        Returns
        -------
        float
            In metres to the power of its dimension.

        Raises
        ------
        ModelError
            There is no such name.
        """
        where = self.mesh.Boundaries(boundary) if boundary else self.mesh.Materials(region)
        total = float(ng.Integrate(ng.CoefficientFunction(1.0), self.mesh, definedon=where))
        if total <= 0.0:
            raise ModelError(f"the mesh has no part called '{boundary or region}'")
        return total / METRE ** (self.dimension - (1 if boundary else 0))

    def mean(
        self,
        boundary: str,
        direction: Sequence[float] | ng.CoefficientFunction,
        weight: ng.CoefficientFunction | float = 1.0,
    ) -> Array:
        r"""Return the mean of a displacement over a boundary, :math:`\int w\,d^T u / \int w`.

        The same vector is the load of a unit force along `direction` that is distributed as
        `weight`.

        Parameters
        ----------
        boundary : str
            Regular expression of boundaries.
        direction : sequence of float or ngsolve.CoefficientFunction
            The direction d.
        weight : ngsolve.CoefficientFunction or float
            The weight w.

        Returns
        -------
        numpy.ndarray
            Shape (n,).

        Raises
        ------
        ModelError
            There is no such name, or the integral of the weight is zero.
        """
        self.measure(boundary=boundary)
        where = self.mesh.Boundaries(boundary)
        w = ng.CoefficientFunction(weight)
        total = ng.Integrate(w, self.mesh, definedon=where, order=2 * self.order + 2)
        v = self.space.TestFunction()
        integral = ng.InnerProduct(self._vector(direction), v.Trace()) * w
        return self._linear(integral * ng.ds(boundary, bonus_intorder=2)) / total

    def force(self, region: str, density: Sequence[float] | ng.CoefficientFunction) -> Array:
        """Return the load of a force that is distributed over regions.

        Parameters
        ----------
        region : str
            Regular expression of regions.
        density : sequence of float or ngsolve.CoefficientFunction
            Force by volume [N/m^3].

        Returns
        -------
        numpy.ndarray
            Shape (n,).
        """
        v = self.space.TestFunction()
        integral = self._volume * ng.InnerProduct(self._vector(density), v)
        return self._linear(integral * ng.dx(region, bonus_intorder=2))

    def gravity(self, direction: Sequence[float], acceleration: float = 9.80665) -> Array:
        """Return the load of the part's own weight.

        Parameters
        ----------
        direction : sequence of float
            Unit vector in which it falls.
        acceleration : float
            Acceleration [m/s^2]; standard gravity where not given.

        Returns
        -------
        numpy.ndarray
            Shape (n,).
        """
        scale = self.density * acceleration
        components = tuple(scale * c for c in direction)[: self.dimension]
        if isinstance(scale, float):
            return self.force(".*", components)
        return self.force(".*", ng.CoefficientFunction(components))

    def thermal(self, change: ng.CoefficientFunction | float) -> Array:
        r"""Return the load of a change of temperature, :math:`\int\alpha T\,(C:I):\varepsilon(v)`.

        In plane strain the thickness is free to expand: only the strain beyond that is zero.

        Parameters
        ----------
        change : ngsolve.CoefficientFunction or float
            Change of temperature [K].

        Returns
        -------
        numpy.ndarray
            Shape (n,).

        Raises
        ------
        ModelError
            A material has no coefficient of expansion.
        """
        for material in self.materials:
            if material.thermal_expansion is None:
                raise ModelError(
                    f"material '{material.name}' gives no thermal_expansion: add it to the material"
                )
        expansion = self._by_region(lambda m: m.thermal_expansion or 0.0)
        pressure = (self.dimension * self.lame + 2.0 * self.shear_modulus) * expansion * change
        v = self.space.TestFunction()
        # one gradient is by millimetres
        return self._linear(self._volume * METRE * pressure * ng.div(v) * ng.dx)

    def rigid_motion(
        self, region: str, centre: Sequence[float] | None = None
    ) -> tuple[tuple[float, ...], Array]:
        """Return the mean motion of regions: the rigid motion nearest to theirs in mean square.

        Parameters
        ----------
        region : str
            Regular expression of regions.
        centre : sequence of float, optional
            The point whose displacement is given [m]; their centroid where not given.

        Returns
        -------
        tuple
            The point, and displacements [m] and rotations [rad] for each degree of freedom,
            shape (3, n) for x, y and the rotation about z, or (6, n) in three dimensions.
        """
        d = self.dimension
        where = self.mesh.Materials(region)
        x = [c / METRE for c in (ng.x, ng.y, ng.z)[:d]]
        # two coordinates and the determinant of a curved element are polynomials of this order
        exact = (d + 2) * self.order

        def over(fields: Sequence[ng.CoefficientFunction | float]) -> Array:
            # together, as going over the elements takes longer than the fields
            function = ng.CoefficientFunction(tuple(fields))
            return np.array(ng.Integrate(function, self.mesh, definedon=where, order=exact))

        volume, *firsts = over([1.0, *x])
        if volume <= 0.0:
            raise ModelError(f"the mesh has no region called '{region}'")
        middle = [float(first / volume) for first in firsts]
        fields = rigid_fields(middle)
        count = len(fields)
        gram = over([ng.InnerProduct(p, q) for p in fields for q in fields]).reshape(count, count)
        v = self.space.TestFunction()
        rows = np.array(
            [self._linear(ng.InnerProduct(p, v) * ng.dx(region, bonus_intorder=1)) for p in fields]
        )
        motion: Array = np.linalg.solve(gram, rows).astype(np.float64)
        at = tuple(middle) if centre is None else tuple(float(c) for c in centre)[:d]
        offset = np.array(at) - np.array(middle)
        turned = motion.copy()
        for k, (a, b) in enumerate(_TURNS[d]):
            turned[a] -= offset[b] * motion[d + k]
            turned[b] += offset[a] * motion[d + k]
        return at, turned

    def point(self, at: Sequence[float], direction: Sequence[float]) -> Array:
        """Return the displacement of a point of the part along a direction.

        Parameters
        ----------
        at : sequence of float
            The point [m].
        direction : sequence of float
            The direction.

        Returns
        -------
        numpy.ndarray
            Shape (n,).

        Raises
        ------
        ModelError
            The point is not in the part.
        """
        place = [c * METRE for c in at]
        if not self.mesh.Contains(*place):
            raise ModelError(f"there is no material at {tuple(at)} m, so there is no displacement")
        mapped = self.mesh(*place)
        element = self.mesh[ng.ElementId(ng.VOL, mapped.nr)]
        row = np.zeros(self.size)
        scalar = ng.H1(self.mesh, order=self.order)
        shape = np.asarray(
            scalar.GetFE(element).CalcShape(mapped.pnt[0], mapped.pnt[1], mapped.pnt[2])
        )
        dofs = np.asarray(scalar.GetDofNrs(element))
        for c, part in enumerate(tuple(direction)[: self.dimension]):
            row[dofs + c * scalar.ndof] += part * shape
        return row

    # ------------------------------------------------------------------ fields

    def field(self, u: Array) -> ng.GridFunction:
        """Return displacements as a function on the mesh [m].

        Parameters
        ----------
        u : numpy.ndarray
            Displacements, shape (n,).

        Returns
        -------
        ngsolve.GridFunction
            The field.
        """
        function = ng.GridFunction(self.space)
        function.vec.FV().NumPy()[:] = u
        return function

    def stress(
        self, u: Array, change: ng.CoefficientFunction | float = 0.0
    ) -> ng.CoefficientFunction:
        """Return the stress as a function on the mesh [Pa].

        Parameters
        ----------
        u : numpy.ndarray
            Displacements, shape (n,).
        change : ngsolve.CoefficientFunction or float
            Change of temperature with them [K].

        Returns
        -------
        ngsolve.CoefficientFunction
            The tensor, 3 x 3; of a plane part with the stress through its thickness.
        """
        function = self.field(u)
        gradient = METRE * ng.Grad(function)
        d = self.dimension
        alpha = self._by_region(lambda m: m.thermal_expansion or 0.0)
        strain = ng.Sym(gradient) - alpha * change * ng.Id(d)
        trace = sum(strain[i, i] for i in range(d))
        inner = self.lame * trace * ng.Id(d) + 2.0 * self.shear_modulus * strain
        if d == 3:
            return inner
        through = self.in_strain * self.lame * trace
        zero = ng.CoefficientFunction(0.0)
        return ng.CoefficientFunction(
            (inner[0, 0], inner[0, 1], zero, inner[1, 0], inner[1, 1], zero, zero, zero, through),
            dims=(3, 3),
        )


def first_lame(material: Material, *, flat: bool = False) -> float:
    """Return the first Lamé constant [Pa]; `flat`, that which makes it plane stress."""
    modulus, poisson = material.youngs_modulus, material.poissons_ratio
    if flat:
        return modulus * poisson / (1.0 - poisson**2)
    return modulus * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))


def rigid_fields(at: Sequence[float]) -> list[ng.CoefficientFunction]:
    """Return the rigid motions about a point, three in a plane or six [m, or m/rad]."""
    d = len(at)
    arm = [c / METRE - float(a) for c, a in zip((ng.x, ng.y, ng.z)[:d], at, strict=True)]
    fields = [ng.CoefficientFunction(tuple(row)) for row in np.eye(d).tolist()]
    for a, b in _TURNS[d]:
        parts: list[object] = [ng.CoefficientFunction(0.0)] * d
        parts[a], parts[b] = -arm[b], arm[a]
        fields.append(ng.CoefficientFunction(tuple(parts)))
    return fields
