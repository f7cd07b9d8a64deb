r"""Reduced equations, by mirror symmetry or condensation, and their transfer functions.

With the dynamic stiffness :math:`A(s) = Ms^2 + Cs + K`, the vector w of the drive and p of the
probe,

.. math::

    N_p = p^T\operatorname{adj}(A)\,w,\qquad D = \det A

the transfer function is :math:`N_p/D`. The adjugate is never formed: N is a bordered determinant.
With Rayleigh damping :math:`A = aM + bK`, :math:`a = s^2+\alpha s`, :math:`b = 1+\beta s`, so the
determinants are those of the undamped stage with :math:`s^2` replaced.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from scipy.linalg import qr
from sympy.polys.matrices import DomainMatrix

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.lumped.finite_rotation import nonlinear
from flexstage.lumped.rigid_bodies import Mechanism
from flexstage.lumped.symbolic import Equations, SymbolicModel, SymbolicPort
from flexstage.lumped.symbols import upright

# masses and places agree to this, relative to their size
_NEAR = 1e-9
_DIRECTIONS = (0.5 * np.pi, 0.0, 0.25 * np.pi, 0.75 * np.pi)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mirror:
    """Line of mirror symmetry of a mechanism."""

    point: tuple[float, float]
    """A point of the line [m]."""
    direction: float
    """Direction, from the x axis to the left [rad]; a multiple of 45 degrees."""
    image: NDArray[np.int64]
    """Coordinates of the image, ``image @ q``: a permutation with signs, shape (n, n)."""
    asymmetry: float = 0.0
    """Largest difference between the stiffness and its image, relative to the diagonal [1]."""


def find_mirror(mechanism: Mechanism, *, tolerance: float = 1e-9) -> Mirror | None:
    """Find a line of mirror symmetry of a mechanism.

    Lines through the mean of the necks, along x, y and between them, are tried; a line counts if M
    and K stay the same when each body moves like its image.

    `tolerance` is the largest difference of K and its image, relative to the diagonal [1]; masses
    and places must agree to 1e-9.
    """
    if not mechanism.hinges or not mechanism.free:
        return None
    necks = np.array([h.at for h in mechanism.hinges])
    middle = necks.mean(axis=0)
    size = float(np.abs(necks - middle).max()) or 1.0
    model = nonlinear(mechanism)
    stiffness = model.tangent(np.zeros(model.order))
    scale = np.sqrt(np.outer(np.diag(stiffness), np.diag(stiffness)))
    for direction in _DIRECTIONS:
        image = _image(mechanism, middle, direction, _NEAR * size)
        if image is None:
            continue
        turned = image.T @ stiffness @ image
        asymmetry = float(np.max(np.abs(turned - stiffness) / scale))
        if asymmetry <= tolerance:
            return Mirror(
                point=(float(middle[0]), float(middle[1])),
                direction=direction,
                image=image,
                asymmetry=asymmetry,
            )
    return None


def _image(
    mechanism: Mechanism, middle: Array, direction: float, near: float
) -> NDArray[np.int64] | None:
    """Pair every free body with its mirror image; None if one has none."""
    c, s = round(np.cos(2.0 * direction)), round(np.sin(2.0 * direction))
    flip = np.array([[c, s], [s, -c]])
    bodies = [mechanism.bodies[i] for i in mechanism.free]
    image = np.zeros((3 * len(bodies), 3 * len(bodies)), dtype=np.int64)
    paired: set[int] = set()
    for i, body in enumerate(bodies):
        image_centre = middle + flip @ (np.array(body.centre) - middle)
        for j, other in enumerate(bodies):
            if (
                j not in paired
                and np.abs(image_centre - other.centre).max() <= near
                and abs(other.mass - body.mass) <= _NEAR * body.mass
                and abs(other.inertia - body.inertia) <= _NEAR * body.inertia
            ):
                paired.add(j)
                image[3 * j : 3 * j + 2, 3 * i : 3 * i + 2] = flip
                image[3 * j + 2, 3 * i + 2] = -1
                break
        else:
            return None
    return image


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReducedModel(Equations):
    """Equations of motion in fewer coordinates z, with q = basis z."""

    has: ClassVar[str] = " in these coordinates: they have"

    how: str
    """Method of reduction."""
    basis: Array
    """Displacements for unit z, shape (number of q, number of z)."""


def reduce_by_symmetry(
    model: SymbolicModel,
    *,
    drive: str | None = None,
    parity: int | None = None,
    mirror: Mirror | None = None,
) -> ReducedModel:
    """Keep the motions of one symmetry of a mirror-symmetric stage; exact.

    A symmetric force causes symmetric motion only, an antisymmetric one antisymmetric motion only,
    so the equations decouple. A coordinate z is that of one body of a pair; its image has the same
    motion.

    Parameters
    ----------
    model : SymbolicModel
        The equations.
    drive : str, optional
        The drive whose symmetry is kept; the first one where neither it nor `parity` is given.
    parity : int, optional
        1 for symmetric motion, -1 for antisymmetric, instead of `drive`.
    mirror : Mirror, optional
        The mirror; found where not given. One of a stage that is not quite symmetric (see the
        tolerance of `find_mirror`) gives the mean of the stage and its image.

    Returns
    -------
    ReducedModel
        Symbolic equations in about half the coordinates.

    Raises
    ------
    ModelError
        The stage has no mirror, or the drive is neither symmetric nor antisymmetric.
    """
    symmetry = mirror if mirror is not None else find_mirror(model.source)
    if symmetry is None:
        raise ModelError(
            f"stage '{model.name}' has no mirror symmetry about a line along x, along y or at 45 "
            "deg: reduce it by condensation"
        )
    if parity is None:
        if drive is None and not model.drives:
            raise ModelError(f"stage '{model.name}' has no drive: give the parity, 1 or -1")
        vector = model.numbers(model.drive(drive or model.drives[0].name).vector)[:, 0]
        parity = _parity(symmetry.image, vector)
        if parity == 0:
            raise ModelError(
                f"drive '{drive or model.drives[0].name}' is neither symmetric nor antisymmetric "
                "about the mirror: its motion cannot be reduced by symmetry"
            )
    elif parity not in (1, -1):
        raise ModelError(f"parity is 1 for symmetric or -1 for antisymmetric, got {parity!r}")
    image = symmetry.image
    columns, names = [], []
    n = model.order
    for k in range(n):
        j = int(np.flatnonzero(image[:, k])[0])
        sign = parity * int(image[j, k])
        if j == k and sign == 1:
            columns.append({k: 1})
        elif j > k:
            columns.append({k: 1, j: sign})
        else:
            continue
        names.append(model.coordinates[k])
    basis = sp.SparseMatrix(
        n, len(columns), {(i, c): v for c, column in enumerate(columns) for i, v in column.items()}
    )
    numbers = np.array(basis.tolist(), dtype=float)

    def reduced_ports(ports: tuple[SymbolicPort, ...]) -> tuple[SymbolicPort, ...]:
        return tuple(
            replace(p, vector=sp.ImmutableMatrix((basis.T * p.vector).applyfunc(sp.expand)))
            for p in ports
            if _parity(image, model.numbers(p.vector)[:, 0]) == parity
        )

    kind = "symmetric" if parity == 1 else "antisymmetric"
    rest = (
        f" (stiffness and mirror image differ by {100.0 * symmetry.asymmetry:.2g} %; their mean is "
        "used)"
        if symmetry.asymmetry > 1e-9
        else ""
    )
    return ReducedModel(
        name=model.name,
        how=f"{kind} motion about the mirror{rest}",
        coordinates=tuple(names),
        M=_congruent(model.M, basis),
        C=_congruent(model.C, basis),
        K=_congruent(model.K, basis),
        basis=numbers,
        drives=reduced_ports(model.drives),
        probes=reduced_ports(model.probes),
        values=model.values,
        damping=model.damping,
    )


def condense(model: SymbolicModel) -> ReducedModel:
    r"""Condense a stage to its drives and probes, in numbers.

    Static condensation (R. J. Guyan, AIAA J. 3 (1965) 380) in its general form: the coordinates z
    are elongations of drives and readings of probes, :math:`z = W^T q`, and the other coordinates
    follow as in statics, :math:`q = K^{-1}W(W^TK^{-1}W)^{-1}z`. Static behaviour between them is
    exact; frequencies are slightly too high.

    Parameters
    ----------
    model : SymbolicModel
        The equations.

    Returns
    -------
    ReducedModel
        Equations with numbers; Rayleigh's alpha and beta stay symbols.

    Raises
    ------
    ModelError
        The stage has neither drives nor probes, or can move freely.
    """
    M, K, C = model.numbers(model.M), model.numbers(model.K), model.numbers(model.C)
    masters = _masters(model)
    w = np.stack([v for _, v in masters], axis=1)
    try:
        flexible = np.linalg.solve(K, w)
        between = w.T @ flexible
    except np.linalg.LinAlgError as error:
        raise ModelError("the stage can move without deforming a hinge") from error
    basis = np.asarray(np.linalg.solve(between.T, flexible.T).T, dtype=float)
    kinds = {"d": "drive ", "p": "probe "}
    how = "static condensation to " + ", ".join(
        kinds[x.name[0]] + x.name.split("mathrm{")[-1].rstrip("}").replace(r"\_", "_")
        for x, _ in masters
    )
    reduced_m, reduced_k = basis.T @ M @ basis, basis.T @ K @ basis
    Mr, Kr = (_floats(0.5 * (a + a.T)) for a in (reduced_m, reduced_k))
    if model.damping == "rayleigh":
        Cr = sp.ImmutableMatrix(model.symbol("alpha") * Mr + model.symbol("beta") * Kr)
    else:
        Cr = _floats(basis.T @ C @ basis)

    def reduced_ports(ports: tuple[SymbolicPort, ...]) -> tuple[SymbolicPort, ...]:
        return tuple(replace(p, vector=_floats(basis.T @ model.numbers(p.vector))) for p in ports)

    return ReducedModel(
        name=model.name,
        how=how,
        coordinates=tuple(symbol for symbol, _ in masters),
        M=Mr,
        C=Cr,
        K=Kr,
        basis=basis,
        drives=reduced_ports(model.drives),
        probes=reduced_ports(model.probes),
        values=model.values,
        damping=model.damping,
    )


def _masters(model: SymbolicModel) -> list[tuple[sp.Symbol, Array]]:
    """Return the independent vectors of drives and probes."""
    ports = [("d", p) for p in model.drives] + [("p", p) for p in model.probes]
    out: list[tuple[sp.Symbol, Array]] = []
    # a drive and a probe may share a name: both are meant
    for name in dict.fromkeys(p.name for _, p in ports):
        for letter, port in ports:
            if port.name == name:
                symbol = sp.Symbol(f"{letter}_{{{upright(name)}}}", real=True)
                out.append((symbol, model.numbers(port.vector)[:, 0]))
    if not out:
        raise ModelError("condensation needs a drive or a probe to keep")
    # one that repeats the others, such as a probe in line with a drive, is omitted
    vectors = np.stack([v for _, v in out], axis=1)
    independent: list[int] = []
    for k in range(len(out)):
        trial = vectors[:, [*independent, k]]
        r = qr(trial / np.linalg.norm(trial, axis=0), mode="r")[0]
        if abs(r[len(independent), len(independent)]) > 1e-9:
            independent.append(k)
    return [out[k] for k in independent]


def _parity(image: NDArray[np.int64], vector: Array) -> int:
    near = 1e-9 * float(np.abs(vector).max(initial=0.0))
    for parity in (1, -1):
        if np.all(np.abs(image @ vector - parity * vector) <= near):
            return parity
    return 0


def _congruent(matrix: sp.MatrixBase, basis: sp.MatrixBase) -> sp.ImmutableMatrix:
    return sp.ImmutableMatrix((basis.T * matrix * basis).applyfunc(sp.expand))


def _floats(matrix: Array) -> sp.ImmutableMatrix:
    return sp.ImmutableMatrix(
        matrix.shape[0], matrix.shape[1], [sp.Float(float(v), 17) for v in matrix.flat]
    )


#: Largest number of coordinates with readable determinants.
LARGEST_ORDER = 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TransferFunction:
    """A ratio of polynomials in Laplace's variable s, of a reading over the force of a drive."""

    input_kind: ClassVar[str] = "force"
    """Input by the drive [N]."""

    drive: str
    """Name of the drive."""
    probe: str
    """Name of the probe."""
    s: sp.Symbol
    """Laplace's variable."""
    numerator: sp.Expr
    """Numerator, a polynomial in s."""
    denominator: sp.Expr
    """Denominator, a polynomial in s."""
    values: dict[sp.Symbol, float]
    """The value of each symbol [SI]."""

    @property
    def expression(self) -> sp.Expr:
        """The ratio."""
        return self.numerator / self.denominator

    def coefficients(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the coefficients as numbers, highest power first.

        Returns
        -------
        tuple of numpy.ndarray
            Of numerator and denominator, the latter's first one being 1.
        """
        # numbers go in, as rationals, before anything is multiplied out: terms cancel
        symbols = self.numerator.free_symbols | self.denominator.free_symbols
        swap: dict[sp.Basic, sp.Expr] = {
            x: sp.Rational(v) for x, v in self.values.items() if x in symbols
        }
        for f in self.numerator.atoms(sp.cos, sp.sin) | self.denominator.atoms(sp.cos, sp.sin):
            swap[f] = sp.Rational(float(f.subs(self.values)))
        rows = [
            sp.Poly(polynomial.xreplace(swap), self.s, domain=sp.QQ).all_coeffs()
            for polynomial in (self.numerator, self.denominator)
        ]
        lead = next(c for c in rows[1] if c != 0)
        top, bottom = ([float(c / lead) for c in row] for row in rows)
        return np.trim_zeros(np.array(top), "f"), np.trim_zeros(np.array(bottom), "f")

    def poles(self) -> NDArray[np.complex128]:
        """Return the roots of the denominator.

        Returns
        -------
        numpy.ndarray
            Poles [rad/s], smallest first.
        """
        return _roots(self.coefficients()[1])


def transfer_function(model: Equations, drive: str, probe: str) -> TransferFunction:
    """Derive the transfer function from the force of a drive to a probe, all drives removed.

    Parameters
    ----------
    model : SymbolicModel or ReducedModel
        The equations, of at most `LARGEST_ORDER` coordinates.
    drive : str
        Name of the drive.
    probe : str
        Name of the probe.

    Returns
    -------
    TransferFunction
        Symbolic where the matrices are.

    Raises
    ------
    ModelError
        Too many coordinates, or a port that the model does not have.
    """
    if model.order > LARGEST_ORDER:
        raise ModelError(
            f"a transfer function in symbols needs at most {LARGEST_ORDER} coordinates, got "
            f"{model.order}: reduce the model by symmetry or by condensation first"
        )
    s = sp.Symbol("s")
    w, p = sp.Matrix(model.drive(drive).vector), sp.Matrix(model.probe(probe).vector)
    if model.damping == "hinge":
        dynamic, a, b = sp.Matrix(model.M * s**2 + model.C * s + model.K), s, sp.S.One
        variable = s
    else:
        # A = a M + b K: determinants in the ratio a/b, made homogeneous afterwards
        variable = sp.Symbol("lambda")
        dynamic = sp.Matrix(model.M * variable + model.K)
        a, b = s**2, sp.S.One
        if model.damping == "rayleigh":
            alpha, beta = model.symbol("alpha"), model.symbol("beta")
            a, b = s**2 + alpha * s, 1 + beta * s

    def homogeneous(polynomial: sp.Expr, degree: int) -> sp.Expr:
        if model.damping == "hinge":
            return sp.collect(polynomial, s)
        terms = sp.Poly(polynomial, variable).all_coeffs()[::-1]
        return sp.Add(*(c * a**i * b ** (degree - i) for i, c in enumerate(terms)))

    edged = sp.Matrix(sp.BlockMatrix([[dynamic, w], [p.T, sp.zeros(1, 1)]]))
    return TransferFunction(
        drive=drive,
        probe=probe,
        s=s,
        numerator=homogeneous(-_determinant(edged), model.order - 1),
        denominator=homogeneous(_determinant(dynamic), model.order),
        values=model.values,
    )


def _determinant(matrix: sp.Matrix) -> sp.Expr:
    """Expanded determinant; numbers become rationals so that no digit is lost."""
    exact_matrix = matrix.applyfunc(_rational)
    # sine and cosine of one angle would keep the entries from being polynomials
    angles = {f: sp.Dummy() for f in exact_matrix.atoms(sp.sin, sp.cos)}
    domain = DomainMatrix.from_Matrix(exact_matrix.xreplace(angles))
    if domain.domain.is_EX:
        return sp.expand(exact_matrix.det(method="berkowitz"))
    # expansion by minors, row by row, each set of columns once: no division, no larger polynomials
    ring, minors = domain.domain, {0: domain.domain.one}
    for row in domain.to_list():
        wider: dict[int, Any] = {}
        for used, minor in minors.items():
            for column, entry in enumerate(row):
                if entry and not used >> column & 1:
                    # as many exchanges as columns that are used lie behind this one
                    term = -entry * minor if (used >> column).bit_count() % 2 else entry * minor
                    key = used | 1 << column
                    wider[key] = wider.get(key, ring.zero) + term
        minors = wider
    expanded = ring.to_sympy(minors.get((1 << matrix.rows) - 1, ring.zero))
    return expanded.xreplace({dummy: f for f, dummy in angles.items()})


def _rational(expression: sp.Expr) -> sp.Expr:
    return expression.xreplace({x: sp.Rational(x) for x in expression.atoms(sp.Float)})


def _roots(polynomial: NDArray[np.float64]) -> NDArray[np.complex128]:
    degree = polynomial.size - 1
    if degree < 1:
        return np.zeros(0, dtype=complex)
    # in units that make the first and the last coefficient equal
    ends = abs(polynomial[-1] / polynomial[0])
    unit = float(np.exp(np.log(ends) / degree)) if ends else 1.0
    scaled = polynomial * unit ** np.arange(degree, -1, -1.0)
    # an undamped stage has even powers only: half the degree, twice the digits
    if not polynomial[1::2].any() and degree % 2 == 0:
        half = np.sqrt(np.roots(scaled[::2]).astype(complex))
        roots = np.concatenate((half, -half))
    else:
        roots = np.roots(scaled).astype(complex)
    return (unit * roots[np.argsort(np.abs(roots), kind="stable")]).astype(np.complex128)
