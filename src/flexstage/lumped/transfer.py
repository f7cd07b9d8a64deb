r"""Transfer functions from the force of a drive to a probe, symbolic for models of few coordinates.

With the dynamic stiffness :math:`A(s) = Ms^2 + Cs + K`, the vector w of the drive and p of the
probe,

.. math::

    N_p = p^T\operatorname{adj}(A)\,w,\qquad D = \det A

give :math:`N_p/D`. The adjugate is never formed: N is a bordered determinant. With Rayleigh damping
:math:`A = aM + bK`, :math:`a = s^2+\alpha s`, :math:`b = 1+\beta s`, so the determinants are those
of the undamped stage with :math:`s^2` replaced.
"""

# SymPy's own annotations are partial and contradict what its functions return.
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false, reportReturnType=false
# pyright: reportCallIssue=false, reportOptionalMemberAccess=false, reportIndexIssue=false

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from sympy.polys.matrices import DomainMatrix

from flexstage.base.errors import ModelError
from flexstage.lumped.symbolic import Equations

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
    """Polynomial above."""
    denominator: sp.Expr
    """Polynomial below."""
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
