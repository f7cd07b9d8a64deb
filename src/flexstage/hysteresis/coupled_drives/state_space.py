"""A linear system of several inputs and outputs from its frequency response."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from flexstage.base.arrays import Array, Complex, Integers


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModalSystem:
    r"""A discrete linear system as a sum of its modes.

    .. math:: H(z) = D + \sum_i \left(\frac{c_i b_i^T}{z - \lambda_i}
              + \frac{\bar c_i \bar b_i^T}{z - \bar\lambda_i}\right)

    over complex poles with a positive imaginary part; a real pole has one term.
    """

    poles: Complex
    """Poles with an imaginary part of at least 0, shape (n,)."""
    output_shapes: Complex
    """Output vectors c, shape (p, n)."""
    input_shapes: Complex
    """Input vectors b, shape (n, m)."""
    feedthrough: Array
    """Direct feedthrough D, shape (p, m)."""

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.poles) + int(np.sum(self.poles.imag > 0.0))

    def response(self, z: Complex) -> Complex:
        """Return the frequency response, shape (L, p, m)."""
        pairs, c, b = self.poles.imag > 0.0, self.output_shapes, self.input_shapes
        terms = 1.0 / (z[:, None] - np.concatenate((self.poles, np.conj(self.poles[pairs]))))
        c = np.concatenate((c, np.conj(c[:, pairs])), axis=1)
        b = np.concatenate((b, np.conj(b[pairs])))
        return self.feedthrough + np.einsum("ln,pn,nm->lpm", terms, c, b, optimize=True)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentifiedModes:
    """Lightly damped modes of a system, by frequency."""

    frequency_hz: Array
    """Natural frequencies [Hz], shape (k,)."""
    damping_ratio: Array
    """Damping ratios [1], shape (k,)."""
    input_shapes: Array
    """Unit input vectors, real, shape (k, m)."""
    imaginary_share: Array
    """Imaginary over real part of each input vector: 0 for a normal mode, shape (k,)."""

    def of(self, numbers: Integers) -> "IdentifiedModes":
        """Return some of the modes."""
        return IdentifiedModes(**{f.name: getattr(self, f.name)[numbers] for f in fields(self)})


#: Rows and columns of the block Hankel matrix: impulse responses over twice as many samples.
HANKEL_BLOCKS = 70
#: Poles of a higher damping ratio are no modes of a flexure stage.
_LARGEST_DAMPING = 0.05
#: Unit input vectors of a larger cosine belong to parts of one mode.
_PARALLEL = 0.7


def modes_of(system: ModalSystem, sample_rate_hz: float, highest_hz: float) -> IdentifiedModes:
    """Return the modes of a system below a frequency."""
    s = np.log(system.poles.astype(complex)) * sample_rate_hz
    frequency = np.abs(s) / (2.0 * np.pi)
    damping = -s.real / np.abs(s)
    light = (system.poles.imag > 0.0) & (damping > 0.0) & (damping < _LARGEST_DAMPING)
    order = np.argsort(frequency)
    order = order[(light & (frequency < highest_hz))[order]]
    shapes = system.input_shapes[order]
    # the phase that makes a vector as real as it can be
    shapes = shapes * np.exp(-0.5j * np.angle(np.sum(shapes**2, axis=1)))[:, None]
    real = np.linalg.norm(shapes.real, axis=1)
    modes = IdentifiedModes(
        frequency_hz=frequency[order],
        damping_ratio=damping[order],
        input_shapes=shapes.real / real[:, None],
        imaginary_share=np.linalg.norm(shapes.imag, axis=1) / real,
    )
    # more states than the system has split a mode: weaker parts lie within its half width
    distance = np.abs(modes.frequency_hz[:, None] - modes.frequency_hz)
    near = distance < modes.damping_ratio * modes.frequency_hz
    parallel = np.abs(modes.input_shapes @ modes.input_shapes.T) > _PARALLEL
    strength = real * np.linalg.norm(system.output_shapes[:, order], axis=0)
    weaker = strength[:, None] < strength
    return modes.of(np.flatnonzero(~np.any(near & parallel & weaker, axis=1)))


def subspace_systems(
    response: Complex,
    lines: Integers,
    period: int,
    orders: Sequence[int],
    blocks: int = HANKEL_BLOCKS,
) -> Iterator[ModalSystem]:
    """Yield a stable linear system of each order from its response at some lines.

    Parameters
    ----------
    response : array
        Frequency response, shape (L, p, m).
    lines : array
        Numbers of the lines, rising, at most half of the period, shape (L,).
    period : int
        Samples in a period.
    orders : sequence of int
        Numbers of states, at most ``blocks * min(p, m)``.
    blocks : int
        Rows and columns of the block Hankel matrix of impulse responses.

    Notes
    -----
    T. McKelvey, H. Akçay and L. Ljung, IEEE Trans. Automat. Contr. 41 (1996) 960: poles and output
    vectors from the Hankel matrix of the impulse response; input vectors and feedthrough from
    linear least squares on the response. Between the lines, below the first one and above the last
    one the response is bridged by straight lines. A pole outside the unit circle is mirrored.
    """
    p, m = response.shape[1:]
    half = period // 2
    ends = np.concatenate(([0], lines, [half]))
    values = np.concatenate((response[:1].real, response, response[-1:].real))
    dense = np.array(
        [
            [np.interp(np.arange(half + 1), ends, values[:, i, j]) for j in range(m)]
            for i in range(p)
        ]
    )
    impulse = np.moveaxis(np.fft.irfft(dense, period, axis=2), 2, 0)
    step = np.arange(blocks)
    hankel = impulse[step[:, None] + step + 1].swapaxes(1, 2).reshape(blocks * p, blocks * m)
    left, singular, _ = np.linalg.svd(hankel, full_matrices=False)
    z = np.exp(2j * np.pi * lines / period)
    for order in orders:
        observability = left[:, :order] * np.sqrt(singular[:order])
        shift = np.linalg.lstsq(observability[:-p], observability[p:], rcond=None)[0]
        eigenvalues, vectors = np.linalg.eig(shift)
        poles = eigenvalues.astype(np.complex128)
        upper = poles.imag >= 0.0
        poles, outputs = poles[upper], (observability[:p] @ vectors)[:, upper]
        outside = np.abs(poles) > 1.0
        poles[outside] = 1.0 / np.conj(poles[outside])
        yield with_inputs(poles, outputs, response, z)


def with_inputs(poles: Complex, outputs: Complex, response: Complex, z: Complex) -> ModalSystem:
    """Return the system of known poles and output vectors that fits a response best."""
    lines, p, m = response.shape
    pairs = poles.imag > 0.0
    first = outputs[None] / (z[:, None] - poles)[:, None, :]
    second = np.conj(outputs)[None] / (z[:, None] - np.conj(poles))[:, None, :] * pairs
    at_once = np.broadcast_to(np.eye(p, dtype=complex), (lines, p, p))
    columns = [first + second, (1j * (first - second))[:, :, pairs], at_once]
    design = np.concatenate(columns, axis=2).reshape(lines * p, -1)
    design = np.concatenate((np.real(design), np.imag(design)))
    flat = response.reshape(lines * p, m)
    target = np.concatenate((flat.real, flat.imag))
    scale = np.linalg.norm(design, axis=0)
    weights = np.linalg.lstsq(design / scale, target, rcond=None)[0] / scale[:, None]
    n = len(poles)
    inputs = weights[:n].astype(complex)
    inputs[pairs] += 1j * weights[n : n + int(pairs.sum())]
    return ModalSystem(
        poles=poles,
        output_shapes=outputs,
        input_shapes=inputs,
        feedthrough=weights[n + int(pairs.sum()) :],
    )


def with_both_vectors(system: ModalSystem, response: Complex, z: Complex) -> ModalSystem:
    """Return the system of the same poles whose output and input vectors fit a response best.

    Each is a linear problem if the others are known: they are solved in turn, three times.
    """
    for _ in range(3):
        turned = with_inputs(system.poles, system.input_shapes.T, np.swapaxes(response, 1, 2), z)
        system = with_inputs(system.poles, turned.input_shapes.T, response, z)
    return system
