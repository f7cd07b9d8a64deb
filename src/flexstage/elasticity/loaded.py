"""A meshed part in a state of finite displacement: strain, stress, modes about it."""

from collections.abc import Callable, Sequence

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.elasticity.continuum import AttachedMass, Continuum
from flexstage.elasticity.shapes import METRE
from flexstage.errors import ModelError

Field = ng.CoefficientFunction | float


def volume_unit(continuum: Continuum) -> float:
    """Return the volume of one square or cubic millimetre of the part's mesh [m^3]."""
    thickness = continuum.thickness
    return (1.0 / METRE if thickness is None else thickness) / METRE**2


def green_strain(
    gradient: ng.CoefficientFunction, continuum: Continuum, change: Field
) -> ng.CoefficientFunction:
    """Return Green's strain less the thermal strain.

    The gradient is that of the displacement [m] by millimetres of the mesh, the change that of
    temperature [K], which does nothing where the material gives no expansion. Shape (2, 2) of a
    plane part.
    """
    turn = METRE * gradient
    strain = 0.5 * (turn + turn.trans + turn.trans * turn)
    alpha = continuum.material.thermal_expansion
    if alpha is None:
        return strain
    return strain - alpha * change * ng.Id(continuum.dimension)


def material_stress(continuum: Continuum, u: Array, change: Field = 0.0) -> ng.CoefficientFunction:
    """Return the second Piola-Kirchhoff stress at a finite displacement [Pa].

    Parameters
    ----------
    continuum : Continuum
        The part.
    u : numpy.ndarray
        Displacements [m], shape (n,).
    change : ngsolve.CoefficientFunction or float
        Change of temperature that goes with them [K].

    Returns
    -------
    ngsolve.CoefficientFunction
        The tensor, 3 x 3, in axes that turn with the material; of a plane part with the stress
        through its thickness.

    Notes
    -----
    Validity: equal to the true stress in turned axes but for a share of the order of the strain, so
    `von_mises` of it is what a strength is compared with.
    """
    d = continuum.dimension
    strain = green_strain(ng.Grad(continuum.field(u)), continuum, change)
    trace = ng.Trace(strain)
    s = continuum.lame * trace * ng.Id(d) + 2.0 * continuum.shear_modulus * strain
    if d == 3:
        return s
    zero = ng.CoefficientFunction(0.0)
    through = continuum.in_strain * continuum.lame * trace
    return ng.CoefficientFunction(
        (s[0, 0], s[0, 1], zero, s[1, 0], s[1, 1], zero, zero, zero, through), dims=(3, 3)
    )


def holding(solve: Callable[[Array], Array], rows: Array) -> Callable[[Array], Array]:
    """Return the solution of a part some readings of which stay at nothing.

    `solve` gives the solution of the part under a load, shape (n,); `rows` are the readings, shape
    (k, n).
    """
    pushed = np.column_stack([solve(row) for row in rows])
    reaction = np.linalg.inv(rows @ pushed)

    def held(load: Array) -> Array:
        u = solve(load)
        for _ in range(2):  # the second time for what the first one's rounding left
            u = u - pushed @ (reaction @ (rows @ u))
        return u

    return held


class _Loaded(Continuum):
    """Small motions about a loaded state: the stiffness is the tangent there."""

    def __init__(self, base: Continuum, u0: Array, change: Field, locked: Array | None) -> None:
        self.__dict__.update(base.__dict__)  # the same mesh, space, mass and readings
        self._solver = None
        self._matrices = {"mass": base._mass}
        self._state = base.field(u0)
        self._change = change
        self._locked = None if locked is None else np.atleast_2d(locked)
        self._held_solve: Callable[[Array], Array] | None = None

    def solve(self, load: Array) -> Array:
        if self._locked is None:
            return super().solve(load)
        if self._held_solve is None:
            self._held_solve = holding(super().solve, self._locked)
        return self._held_solve(load)

    def _form(self) -> ng.BilinearForm:
        d = self.dimension
        trial, test = self.space.TnT()
        turn = METRE * ng.Grad(self._state)
        strain = green_strain(ng.Grad(self._state), self, self._change)
        stress = self.lame * ng.Trace(strain) * ng.Id(d) + 2.0 * self.shear_modulus * strain
        a, b = METRE * ng.Grad(trial), METRE * ng.Grad(test)
        now = (ng.Id(d) + turn).trans
        da, db = ng.Sym(now * a), ng.Sym(now * b)
        density = self.lame * ng.Trace(da) * ng.Trace(db)
        density += 2.0 * self.shear_modulus * ng.InnerProduct(da, db)
        density += ng.InnerProduct(stress, a.trans * b)  # what the stress adds
        density += self.shift * self.material.density * ng.InnerProduct(trial, test)
        form = ng.BilinearForm(self.space, symmetric=True, condense=True)
        form += volume_unit(self) * density * ng.dx
        return form


def loaded(
    continuum: Continuum, u0: Array, *, change: Field = 0.0, locked: Array | None = None
) -> Continuum:
    """Return the part for small motions about a loaded state.

    Its stiffness is the tangent there; `solve` and `modes` use it, and the mass, the loads and the
    readings are those of the part. Its `stress` is not meant: see `material_stress`.

    Parameters
    ----------
    continuum : Continuum
        The part.
    u0 : numpy.ndarray
        Displacements of the loaded state [m], from `follow_drive`, or from `Continuum.solve` where
        they are small, shape (n,).
    change : ngsolve.CoefficientFunction or float
        Change of temperature of that state [K].
    locked : numpy.ndarray, optional
        Readings that stay as they are, such as the elongation of a stiff drive, shape (k, n).

    Returns
    -------
    Continuum
        The part about that state.
    """
    return _Loaded(continuum, u0, change, locked)


def stress_stiffening(
    continuum: Continuum,
    u0: Array,
    count: int,
    *,
    change: Field = 0.0,
    locked: Array | None = None,
    attached: Sequence[AttachedMass] = (),
    tolerance: float = 1e-9,
) -> tuple[Array, Array]:
    """Return the lowest natural modes about a loaded state.

    Parameters
    ----------
    continuum : Continuum
        The part.
    u0 : numpy.ndarray
        Displacements of the loaded state [m], shape (n,).
    count : int
        How many.
    change : ngsolve.CoefficientFunction or float
        Change of temperature of that state [K].
    locked : numpy.ndarray, optional
        Readings that stay as they are, such as the elongation of a stiff drive, shape (k, n).
    attached : sequence of AttachedMass
        What rides on the part.
    tolerance : float
        Relative tolerance of the eigenvalues.

    Returns
    -------
    tuple of numpy.ndarray
        omega [rad/s], shape (count,), and shapes with phi^T M phi = 1, shape (n, count), as
        `Continuum.modes` gives them.

    Raises
    ------
    ModelError
        The state is not stable: the part has buckled before it.
    ConvergenceError
        The iteration did not end.

    Notes
    -----
    The error for an unstable state is the test of a branch that was followed too far: with
    ``locked`` the row of the drive, of one under an imposed motion; without, under its force.

    Validity: undamped small vibrations; the loads of the state keep their direction. A drive that
    holds the state adds no mass, and no stiffness unless it is locked.
    """
    omega, shapes = loaded(continuum, u0, change=change, locked=locked).modes(
        count, attached=attached, tolerance=tolerance
    )
    # `modes` cuts a negative square off at nothing, and a held part has no mode at nothing
    if continuum.shift == 0.0 and omega[0] == 0.0:
        raise ModelError(
            "the loaded state is not stable, so it has no natural frequencies: the load is beyond "
            "buckling; lower it"
        )
    return omega, shapes


#: Order of the six components of a stress.
COMPONENTS: tuple[tuple[int, int], ...] = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def von_mises(stress: ng.CoefficientFunction) -> ng.CoefficientFunction:
    """Return the equivalent stress of von Mises of a stress on a mesh [Pa].

    Parameters
    ----------
    stress : ngsolve.CoefficientFunction
        The tensor, 3 x 3 [Pa].

    Returns
    -------
    ngsolve.CoefficientFunction
        The equivalent stress.
    """
    s = stress
    normal = (s[0, 0] - s[1, 1]) ** 2 + (s[1, 1] - s[2, 2]) ** 2 + (s[2, 2] - s[0, 0]) ** 2
    shear = s[0, 1] ** 2 + s[1, 2] ** 2 + s[0, 2] ** 2
    return ng.sqrt(0.5 * normal + 3.0 * shear)


def von_mises_of(components: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the equivalent stress of von Mises of stress components [Pa].

    xx, yy, zz, yz, xz, xy are the last axis [Pa], shape (..., 6).
    """
    xx, yy, zz, yz, xz, xy = np.moveaxis(components, -1, 0)
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.sqrt(0.5 * normal + 3.0 * (yz**2 + xz**2 + xy**2))
