"""Modes of a stage that follows at unit static gain, and its inverse."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Complex
from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.element import (
    ChainElement,
    positive_step,
    values_at_samples,
)
from flexstage.hysteresis.chain.modal import (
    UnitStep,
    modes_along_lines,
    modes_through_segments,
    unit_step,
)
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, Response, Segments, samples

# Relative size of coefficients that are rounding errors of a sum.
_NEGLIGIBLE = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class StageModes(ChainElement):
    r"""A stage as a sum of modes, at unit static gain.

    .. math:: \frac{y}{x} = 1 - \sum_i c_i + \sum_i c_i
              \frac{\omega_i^2}{s^2 + 2\zeta_i\omega_i s + \omega_i^2}

    The remainder :math:`1 - \sum_i c_i` follows without delay: modes far above the band. State: the
    input, the deflections of the modes, and their rates [1/s], shape (1 + 2 k,).

    Validity: linear, small motion; modes that are not listed follow without delay.

    Raises
    ------
    ModelError
        A frequency is not positive, a damping ratio is negative, or their numbers differ.

    Examples
    --------
    >>> import numpy as np
    >>> stage = StageModes(frequency_hz=[339.0], damping_ratio=[0.012])
    >>> jump = stage.settled(0.0, 1e-4)
    >>> jump[0] = 1.0
    >>> y = stage.simulate(np.ones(100), 1e-4, jump).values
    >>> round(float(y.max()), 3)
    1.962
    """

    frequency_hz: Sequence[float]
    """Natural frequencies [Hz], shape (k,)."""
    damping_ratio: Sequence[float]
    """Damping ratios [1], shape (k,); above 1 the mode does not oscillate."""
    share: Sequence[float] = (1.0,)
    """Share of each mode in the static displacement [1], shape (k,); may be negative. 1 by default,
    for one mode.
    """

    def __post_init__(self) -> None:
        for name in ("frequency_hz", "damping_ratio", "share"):
            values = tuple(float(value) for value in getattr(self, name))
            object.__setattr__(self, name, values)
            if len(values) != len(self.frequency_hz) or not values:
                raise ModelError(
                    f"a stage of {len(self.frequency_hz)} modes needs as many of {name}, and at "
                    f"least one, got {len(values)}"
                )
            if not all(math.isfinite(value) for value in values):
                raise ModelError(f"{name} of the modes must be finite, got {values!r}")
        if not all(value > 0.0 for value in self.frequency_hz):
            raise ModelError(f"frequencies must be positive, got {self.frequency_hz!r} Hz")
        if not all(value >= 0.0 for value in self.damping_ratio):
            raise ModelError(f"damping ratios must not be negative, got {self.damping_ratio!r}")

    @property
    def static_share(self) -> float:
        """Share that follows without delay [1]."""
        return 1.0 - math.fsum(self.share)

    @property
    def omega(self) -> Array:
        """Angular natural frequencies [rad/s], shape (k,)."""
        return 2.0 * np.pi * np.array(self.frequency_hz)

    def settled(self, x: float, dt: float) -> Array:
        del dt
        k = len(self.frequency_hz)
        return np.concatenate((np.full(1 + k, float(x)), np.zeros(k)))

    def simulate(self, x: ArrayLike, dt: float, state: ArrayLike | None = None) -> Response:
        inputs = samples(x, "input of the stage")
        step, last, z, v = self._start(inputs[0], dt, state)
        y = self.static_share * inputs[None, :]
        modes_along_lines(np.append(last, inputs), step, z, v, self._reader(), y)
        return Response(values=y[0], state=np.concatenate((inputs[-1:], z, v / dt)))

    def through(self, force: Segments, dt: float, state: ArrayLike | None = None) -> Response:
        """Return the output for an input that is known between the samples.

        With the segments of a hysteresis model the stage and the hysteresis are exact together.

        Parameters
        ----------
        force : Segments
            The input, n samples.
        dt : float
            Step between samples [s].
        state : array_like, optional
            State at the first of them, whose last input is not used; settled there by default.

        Returns
        -------
        Response
            The outputs at the n samples, and the state at the last.

        Raises
        ------
        ModelError
            The step is not positive, or the state does not belong to this element.
        """
        inputs = values_at_samples(force)
        step, _, z, v = self._start(inputs[0], dt, state)
        y = self.static_share * inputs[None, :]
        reader = self._reader()
        y[0, 0] += reader[0] @ np.append(z, v)
        modes_through_segments(force, step, z, v, reader, y[:, 1:])
        return Response(values=y[0], state=np.concatenate((inputs[-1:], z, v / dt)))

    def inverse(self, y: ArrayLike, dt: float) -> Response:
        r"""Return the input that gives a smooth output.

        For one mode

        .. math:: x = y + \frac{2\zeta}{\omega} \dot y + \frac{1}{\omega^2} \ddot y

        and for several modes the polynomial quotient of this kind, and a stable filter for the
        remainder, stepped exactly along the spline. Stages of relative degree two have no inverse
        sample by sample: the zeros that sampling adds are unstable (K. J. Astrom, P. Hagander,
        J. Sternby, Automatica 20 (1984) 31), so the complete output is needed.

        Parameters
        ----------
        y : array_like
            Outputs, shape (n,), n at least 6; the stage rests at the first of them. Between them it
            is a spline of fifth degree.
        dt : float
            Step between samples [s].

        Returns
        -------
        Response
            The inputs, and the state of the stage at the last sample if it follows a straight
            line between them.

        Raises
        ------
        ModelError
            The stage is not minimum phase, or the output has less than 6 samples.
        """
        h = positive_step(dt)
        x = _stage_inverse(self, samples(y, "output of the stage"), h)
        return Response(values=x, state=self.simulate(x, h).state)

    def frequency_response(self, frequency_hz: ArrayLike) -> Complex:
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)[..., None]
        w, zeta = self.omega, np.array(self.damping_ratio)
        mode = w**2 / (s**2 + 2.0 * zeta * w * s + w**2)
        return self.static_share + np.sum(np.array(self.share) * mode, axis=-1)

    def _reader(self) -> Array:
        return np.concatenate((self.share, np.zeros(len(self.share))))[None, :]

    def _start(
        self, first: float, dt: float, state: ArrayLike | None
    ) -> tuple[UnitStep, float, Array, Array]:
        step = unit_step(self.omega * positive_step(dt), np.array(self.damping_ratio))
        k = len(self.frequency_hz)
        now = self._initial_state(first, dt, state, "the stage")
        return step, float(now[0]), now[1 : 1 + k].copy(), now[1 + k :] * dt


def _polynomials(stage: StageModes) -> tuple[Array, Array, float]:
    """Return numerator and denominator of the stage, highest power first, and the unit of s."""
    unit = float(np.exp(np.mean(np.log(stage.omega))))
    w = stage.omega / unit
    factors = [
        np.array([1.0, 2.0 * zeta * omega, omega**2])
        for zeta, omega in zip(stage.damping_ratio, w.tolist(), strict=True)
    ]
    below = np.array([1.0])
    for factor in factors:
        below = np.polymul(below, factor)
    above = stage.static_share * below
    for i, share in enumerate(stage.share):
        numerator = np.array([share * w[i] ** 2])
        for j, factor in enumerate(factors):
            if j != i:
                numerator = np.polymul(numerator, factor)
        above = np.polyadd(above, numerator)
    size = np.abs(above).max()
    first = int(np.flatnonzero(np.abs(above) > _NEGLIGIBLE * size)[0])
    return np.asarray(above[first:], np.float64), np.asarray(below, np.float64), unit


def _stage_inverse(stage: StageModes, y: Array, dt: float) -> Array:
    """Return the input that gives a smooth output; the stage rests at the first."""
    above, below, unit = _polynomials(stage)
    if below.size - above.size > 2:
        raise ModelError(
            "the shares of the modes cancel at high frequency: the inverse of this stage needs "
            f"{below.size - above.size} derivatives of the reference, and only two are available"
        )
    zeros = np.roots(above)
    if np.any(zeros.real >= 0.0):
        worst = unit * zeros[int(np.argmax(zeros.real))]
        raise ModelError(
            f"the stage has a zero at {worst:.4g} rad/s, which is not in the left half-plane: its "
            "inverse is unstable; omit the mode of opposite sign, or use feedback"
        )
    quotient, remainder = np.polydiv(below, above)
    derivatives = _derivatives(y)
    x = np.zeros_like(y)
    for power, c in enumerate(quotient[::-1]):
        x += c * derivatives[power] / (unit * dt) ** power
    if above.size > 1:
        x += _remainder(np.asarray(remainder, np.float64), above, unit * dt, derivatives)
    return x


def _derivatives(y: Array) -> Array:
    """Return derivatives 0 to 5 [per sample] to the right of each sample, shape (6, n)."""
    from scipy.interpolate import make_interp_spline

    if y.size < 6:
        raise ModelError(f"the inverse of a stage needs 6 samples or more, got {y.size}")
    spline = make_interp_spline(np.arange(y.size, dtype=np.float64), y, k=5)
    return np.array([spline(np.arange(y.size, dtype=np.float64), nu) for nu in range(6)])


def _remainder(remainder: Array, above: Array, h: float, derivatives: Array) -> Array:
    """Step rest/above, a proper filter, exactly along polynomials of fifth degree."""
    from scipy.linalg import expm

    n = above.size - 1
    matrix = np.zeros((n + 6, n + 6))
    matrix[: n - 1, 1:n] = np.eye(n - 1)
    matrix[n - 1, :n] = -(above / above[0])[:0:-1]
    matrix[:n] *= h
    matrix[n - 1, n] = h
    matrix[range(n, n + 5), range(n + 1, n + 6)] = 1.0
    step = np.asarray(expm(matrix), dtype=np.float64)[:n]
    read = np.zeros(n)
    trimmed = np.atleast_1d(remainder)[::-1][:n] / above[0]
    read[: trimmed.size] = trimmed
    q = np.zeros(n)
    q[0] = derivatives[0, 0] / (above[-1] / above[0])
    out = np.empty(derivatives.shape[1])
    _filter(
        np.ascontiguousarray(step), np.ascontiguousarray(derivatives), read, q, np.empty(n), out
    )
    return out


@compiled
def _filter(
    step: Array, derivatives: Array, read: Array, q: Array, following: Array, out: Array
) -> None:
    n = q.size
    for k in range(out.size):
        total = 0.0
        for i in range(n):
            total += read[i] * q[i]
        out[k] = total
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += step[i, j] * q[j]
            for j in range(6):
                total += step[i, n + j] * derivatives[j, k]
            following[i] = total
        for i in range(n):
            q[i] = following[i]
