"""The modal model of a frequency response, and its least squares with residues projected out."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ConvergenceError

_ITERATIONS = 60
# further iterations for hardly separable poles, while the sum falls by more than this, over the
# mean square of noise: 0.01 of a standard uncertainty of one parameter
_MORE, _WORTH = 240, 1e-4
_STEP = 1e-12
# least relative fall of the sum of squares that another iteration is worth
_FALL = 1e-11
_ROUGH = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class ModalBasis:
    """Functions whose sum with real factors is a response to displacement.

    With s = i omega over the reference frequency,

        H = g(s) [sum (a_r + b_r s) / (s^2 + 2 zeta_r w_r s + w_r^2) + u + l / s^2],

    g(s) = exp(-s tau) / (1 + s T): a pair of conjugate poles, with its residue in a and b; u and l
    stand for modes above and below the band (Ewins, 2000, Modal Testing, 2nd ed.). The parameters
    are w_1, zeta_1, ..., then tau and T where they are in it. Everywhere theta has shape (size,),
    and s shape (k,).
    """

    count: int
    """Number of modes."""
    reference: float
    """The frequency that makes all others numbers of size 1 [rad/s]."""
    delay: bool = False
    """Whether there is a delay tau."""
    lag: bool = False
    """Whether there is a lag T."""
    residuals: bool = True
    """Whether u and l are in it."""
    real_modes: bool = False
    """Whether the b_r are omitted, as in a system with proportional damping."""

    @property
    def size(self) -> int:
        """Number of parameters that are not linear."""
        return 2 * self.count + self.delay + self.lag

    @property
    def linear(self) -> int:
        """Number of linear factors of each response."""
        return self.per_mode * self.count + (2 if self.residuals else 0)

    @property
    def per_mode(self) -> int:
        """Number of linear factors of each mode."""
        return 1 if self.real_modes else 2

    def transfer(self, theta: Array, s: Complex) -> Complex:
        """Return the factor g that delay and lag make of a response, shape (k,)."""
        g = np.ones(s.size, dtype=np.complex128)
        if self.delay:
            g = np.exp(-s * theta[2 * self.count])
        if self.lag:
            g = g / (1.0 + s * theta[-1])
        return g

    def functions(self, theta: Array, s: Complex) -> Complex:
        """Return the functions at some frequencies, shape (k, linear)."""
        g = self.transfer(theta, s)
        columns = []
        for w, zeta in theta[: 2 * self.count].reshape(-1, 2):
            first = g / (s * s + 2.0 * zeta * w * s + w * w)
            columns += [first] if self.real_modes else [first, s * first]
        if self.residuals:
            columns += [g, g / (s * s)]
        # each function in one piece of memory, as derivatives take them one by one
        return np.array(columns).T

    def derivatives(self, theta: Array, s: Complex, functions: Complex, factors: Array) -> Complex:
        """Return how responses change with the parameters, their linear factors held.

        With factors of shape (linear, m), the derivatives have shape (size, k, m).
        """
        out = np.empty((self.size, s.size, factors.shape[1]), dtype=np.complex128)
        for r, (w, zeta) in enumerate(theta[: 2 * self.count].reshape(-1, 2)):
            columns = slice(self.per_mode * r, self.per_mode * (r + 1))
            over = functions[:, columns] / (s * s + 2.0 * zeta * w * s + w * w)[:, None]
            out[2 * r] = (over * (-2.0 * zeta * s - 2.0 * w)[:, None]) @ factors[columns]
            out[2 * r + 1] = (over * (-2.0 * w * s)[:, None]) @ factors[columns]
        if self.delay or self.lag:
            value = functions @ factors
            if self.delay:
                out[2 * self.count] = -s[:, None] * value
            if self.lag:
                out[-1] = -(s / (1.0 + s * theta[-1]))[:, None] * value
        return out

    def start(self, poles: Complex) -> Array:
        """Return parameters to start from poles [rad/s], delay and lag 0."""
        theta = np.zeros(self.size)
        size = np.abs(poles)
        theta[: 2 * self.count : 2] = size / self.reference
        theta[1 : 2 * self.count : 2] = -poles.real / size
        return theta

    def residue_weights(self, theta: Array, mode: int) -> Complex:
        """Return the residue of a mode's pole for each of its linear factors.

        A_r = (a + b lambda) / (lambda - lambda*), in the numbers of the reference; in rad/s, shape
        (per_mode,).
        """
        pole, other = self.poles(theta)[mode] / self.reference
        weights = np.array([1.0, pole]) * self.reference / (pole - other)
        return weights[: self.per_mode]

    def poles(self, theta: Array) -> Complex:
        """Return the pairs of poles: conjugates, or both real where damping is above critical.

        In rad/s, shape (count, 2).
        """
        w, zeta = theta[: 2 * self.count].reshape(-1, 2).T
        root: Complex = np.sqrt((zeta * zeta - 1.0).astype(np.complex128))
        root = np.where(root.imag < 0.0, -root, root)
        pair = np.stack([w * (-zeta + root), w * (-zeta - root)], axis=1)
        return np.asarray(self.reference * pair, dtype=np.complex128)


def reference_frequency(band: tuple[float, float]) -> float:
    """Return the geometric mean of the ends of a band [Hz], in rad/s."""
    return 2.0 * math.pi * math.sqrt(band[0] * band[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResponseBlock:
    """Responses that share their frequencies."""

    s: Complex
    """i omega over the reference, shape (k,)."""
    values: Complex
    """Responses to displacement, shape (k, m)."""
    weights: Array
    """What the error of each part, real and imaginary, counts, shape (k, m)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Projected:
    """One response at given poles, with its linear factors eliminated."""

    factors: Array
    """Its factors, shape (q,)."""
    residual: Array
    """Weighted measured less modelled, real parts then imaginary ones, shape (2 k,)."""
    jacobian: Array
    """Derivatives of the weighted model by the poles, shape (2 k, p)."""
    orthogonal: Array
    """Those derivatives without what the factors can follow, shape (2 k, p)."""
    inverse: Array
    """Transposed pseudo-inverse of the weighted functions: factors are its transposed times the
    weighted data, shape (2 k, q).
    """


def _stacked(values: Complex) -> Array:
    return np.concatenate([values.real, values.imag])


def project(basis: ModalBasis, theta: Array, block: ResponseBlock, column: int) -> Projected:
    """Eliminate the linear factors of one response (Golub and Pereyra 1973, Kaufman 1975)."""
    functions = basis.functions(theta, block.s)
    q, r, scale = _factored(functions, block.weights[:, column])
    factors, residual, weight = _solved(q, r, scale, block, column)
    slope = basis.derivatives(theta, block.s, functions, factors[:, None])[:, :, 0].T
    slope = _stacked(slope) * weight[:, None]
    return Projected(
        factors=factors,
        residual=residual,
        jacobian=slope,
        orthogonal=slope - q @ (q.T @ slope),
        inverse=np.linalg.solve(r, q.T).T / scale,
    )


def _factored(functions: Complex, weights: Array) -> tuple[Array, Array, Array]:
    weighted = _stacked(functions) * np.concatenate([weights, weights])[:, None]
    scale = np.linalg.norm(weighted, axis=0)
    scale[scale == 0.0] = 1.0
    q, r = np.linalg.qr(weighted / scale)
    # two equal functions would divide by zero: let the sum go to the one, as with a ridge
    diagonal = np.diagonal(r).copy()
    weak = np.abs(diagonal) < 1e-14
    if weak.any():
        r = r + np.diag(np.where(weak, 1e-14 - diagonal, 0.0))
    return q, r, scale


def _solved(
    q: Array, r: Array, scale: Array, block: ResponseBlock, column: int
) -> tuple[Array, Array, Array]:
    from scipy.linalg import solve_triangular

    weight = np.concatenate([block.weights[:, column]] * 2)
    data = _stacked(block.values[:, column]) * weight
    along = q.T @ data
    residual = data - q @ along
    return solve_triangular(r, along) / scale, residual, weight


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Eliminated:
    """All responses of a block at given poles, by their normal equations."""

    functions: Complex
    """The functions, each over its size, shape (k, q)."""
    scale: Array
    """Those sizes, shape (q,)."""
    factors: Array
    """Factors of the functions over their sizes, shape (q, m)."""
    residual: Complex
    """Measured less modelled, without weights, shape (k, m)."""
    square: Array
    """Squares of the weights, shape (k, m)."""
    inverse: Array
    """Inverse of the normal equations of each response, shape (m, q, q), or (1, q, q) where all
    have the same weights.
    """

    @property
    def total(self) -> float:
        """Weighted sum of squares."""
        return float(np.sum(self.square * (self.residual.real**2 + self.residual.imag**2)))


def eliminate(basis: ModalBasis, theta: Array, block: ResponseBlock) -> Eliminated:
    """Eliminate the linear factors of all responses of a block at once.

    Normal equations lose digits that `project` keeps; one step of refinement with the residual
    itself gives them back.
    """
    square = block.weights**2
    shared = bool(np.all(square == square[:, :1]))
    functions = basis.functions(theta, block.s)
    mean = np.mean(block.weights, axis=1) ** 2
    scale = np.sqrt(mean @ (functions.real**2 + functions.imag**2))
    scale[scale == 0.0] = 1.0
    functions /= scale
    gram = gram_of(functions, functions, square[:, :1] if shared else square)
    # equal functions leave it singular: let them share
    size = np.einsum("mqq->m", gram)[:, None, None]
    inverse = np.linalg.inv(gram + 1e-15 * size * np.eye(functions.shape[1]))
    factors = np.zeros((functions.shape[1], block.values.shape[1]))
    residual = block.values
    parts = _stacked(functions)
    for _ in range(2):
        right = parts.T @ _stacked(square * residual)
        step = inverse[0] @ right if shared else np.einsum("mqr,rm->qm", inverse, right)
        factors = factors + step
        model = parts @ factors
        residual = block.values - (model[: len(square)] + 1j * model[len(square) :])
    return Eliminated(
        functions=functions,
        scale=scale,
        factors=factors,
        residual=residual,
        square=square,
        inverse=inverse,
    )


def gram_of(left: Complex, right: Complex, square: Array) -> Array:
    """Return weighted products of functions, of the real and the imaginary part together.

    Of functions of shapes (k, a) and (k, b), with squares of the weights (k, m): shape (m, a, b).
    """
    first, second = _stacked(left), _stacked(right)
    # one response after the other, as all products at once take more memory than a cache holds
    roots, memory = np.sqrt(np.concatenate([square, square])).T[:, :, None], np.empty_like(second)
    out = np.empty((square.shape[1], first.shape[1], second.shape[1]))
    for block, root in zip(out, roots, strict=True):
        if left is right:
            # the product of a matrix with itself takes half of the time
            block[:] = np.multiply(root, first, out=memory).T @ memory
        else:
            block[:] = first.T @ np.multiply(root**2, second, out=memory)
    return out


def _normal(
    basis: ModalBasis,
    theta: Array,
    blocks: Sequence[ResponseBlock],
    eliminated: Sequence[Eliminated],
) -> tuple[Array, Array]:
    """Return the half gradient with the sign changed, and J^T J."""
    gradient = np.zeros(basis.size)
    square = np.zeros((basis.size, basis.size))
    # lines that are taken at a time, so that their derivatives stay in the memory nearby
    piece = 1024
    for block, now in zip(blocks, eliminated, strict=True):
        factors = now.factors / now.scale[:, None]
        inside = np.zeros((block.values.shape[1], basis.linear, basis.size))
        for first in range(0, block.s.size, piece):
            some = slice(first, first + piece)
            functions = now.functions[some]
            plain = basis.derivatives(theta, block.s[some], functions * now.scale, factors)
            parts, residual = _stacked(functions), _stacked(now.residual[some])
            for column in range(len(inside)):
                weight = np.tile(block.weights[some, column], 2)[:, None]
                slopes = _stacked(plain[:, :, column].T) * weight
                inside[column] += (parts * weight).T @ slopes
                square += slopes.T @ slopes
                gradient += (residual[:, column] * weight[:, 0]) @ slopes
        square -= np.einsum("mqp,mqr->pr", inside, now.inverse @ inside)
    return gradient, square


def deviations_of(basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock]) -> Array:
    """Return the standard uncertainty of each parameter over the rms of noise.

    By the linearised fit; infinite of what nothing depends on.
    """
    now = [eliminate(basis, theta, block) for block in blocks]
    square = _normal(basis, theta, blocks, now)[1]
    diagonal = np.diagonal(square)
    # what nothing depends on has no uncertainty that ends
    felt = diagonal > 1e-14 * diagonal.max()
    scale = np.sqrt(np.where(felt, diagonal, 1.0))
    scaled = np.where(np.outer(felt, felt), square / np.outer(scale, scale), 0.0)
    inverse = np.linalg.pinv(scaled, rcond=1e-13, hermitian=True)
    return np.where(felt, np.sqrt(np.maximum(np.diagonal(inverse), 0.0)) / scale, np.inf)


def remaining(basis: ModalBasis, theta: Array, block: ResponseBlock, now: Eliminated) -> Array:
    """Return the share of the noise of each line that a fit leaves in its residual.

    One less half the leverage of real and imaginary part, shape (k, m).
    """
    gradient = now.functions.conj()
    shared = now.inverse.shape[0] == 1
    which = np.zeros(block.values.shape[1], dtype=np.intp) if shared else slice(None)
    inverse = now.inverse[which]
    half = now.functions @ inverse
    reduction = np.einsum("mkr,kr->km", half, gradient).real
    if basis.size:
        factors = now.factors / now.scale[:, None]
        plain = basis.derivatives(theta, block.s, now.functions * now.scale, factors)
        inside = (gradient.T @ (plain * now.square)).real.transpose(2, 1, 0)
        free = plain - (half @ inside).transpose(2, 1, 0)
        flat = (free * block.weights).reshape(basis.size, -1)
        solved = np.linalg.pinv((flat.conj() @ flat.T).real, hermitian=True)
        along = (solved @ free.reshape(basis.size, -1)).reshape(free.shape)
        reduction += np.einsum("pkm,pkm->km", free.conj(), along).real
    return 1.0 - 0.5 * np.clip(reduction * now.square, 0.0, 1.9)


def minimise(
    basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock], *, rough: bool = False
) -> tuple[Array, float]:
    """Make the weighted sum of squares least over the poles (Levenberg 1944, Marquardt 1963).

    A rough fit stops where the sum hardly falls, far below what noise makes of it, or after so many
    steps. Returned are the parameters and the sum of squares.
    """
    now = [eliminate(basis, theta, block) for block in blocks]
    total = sum(one.total for one in now)
    if not basis.size:
        return theta, total
    gradient, square = _normal(basis, theta, blocks, now)
    damping = 1e-6
    values = sum(2 * block.values.size for block in blocks)
    # of many poles the last digits cost most: after so many iterations over their parameters a
    # rough fit ends, and another as soon as the sum hardly falls
    work = 600
    enough = min(_ITERATIONS, max(8, work // basis.size))
    for iteration in range(enough if rough else _ITERATIONS + _MORE):
        diagonal = np.diagonal(square).copy()
        diagonal[diagonal <= 0.0] = 1.0
        scale = np.sqrt(diagonal)
        scaled = square / np.outer(scale, scale)
        while True:
            lifted = scaled + damping * np.eye(basis.size)
            step = np.linalg.solve(lifted, gradient / scale) / scale
            trial = theta + step
            if np.abs(step).max() <= _STEP:
                return theta, total
            if _sane(basis, trial, theta):
                now = [eliminate(basis, trial, block) for block in blocks]
                value = sum(one.total for one in now)
                if value <= total:
                    break
                if np.abs(step).max() <= 1e-8 and value <= total * (1.0 + 1e-9):
                    return theta, total
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e12:
                return theta, total
        fall = total - value
        small = fall <= _FALL * total and np.abs(step).max() <= 1e-6
        small = small or (rough and fall <= _ROUGH * total)
        small = small or (iteration >= enough and fall * values <= _WORTH * total)
        theta, total = trial, value
        if small:
            return theta, total
        gradient, square = _normal(basis, theta, blocks, now)
        damping = max(0.1 * damping, 1e-14)
    if rough:
        return theta, total
    poles = f"{basis.count} pole{'s' * (basis.count != 1)}"
    raise ConvergenceError(
        f"the fit of {poles} did not converge in {_ITERATIONS + _MORE} iterations: give "
        "frequencies near the modes, or fit them in a narrower band"
    )


def _sane(basis: ModalBasis, trial: Array, theta: Array) -> bool:
    """Whether a step leaves frequencies positive, damping within reason, and is no leap."""
    w, zeta = trial[: 2 * basis.count].reshape(-1, 2).T
    old = theta[: 2 * basis.count : 2]
    # two real poles may stand for what a stage is not: their ratio is then some 4 zeta^2
    most_damping = 10.0
    if np.any(w < 0.7 * old) or np.any(w > 1.4 * old) or np.any(np.abs(zeta) >= most_damping):
        return False
    return not (basis.lag and trial[-1] < -0.9)
