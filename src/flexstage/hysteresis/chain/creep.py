"""Creep: motion of a drive after its input has come to rest."""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Complex
from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.element import (
    LONGEST,
    SHORTEST,
    ChainElement,
    positive_step,
)
from flexstage.hysteresis.chain.lag import decay_share, ramp_share
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, Response, checked, samples

#: Motion of a drive before the first command: it rested there for long; it repeated the motion, of
#: which the first and the last sample are the same; or it moved as after the first command, for a
#: time [s] since the low end of its range, which may be infinite.
Start = Literal["rested", "periodic"] | float


class Creep(ChainElement):
    r"""Linear creep: the input, and lags of it.

    Each subclass is a distribution of time constants.

    .. math:: y = x + \sum_i a_i l_i, \qquad \tau_i \dot l_i + l_i = x

    State: the input, and the value of each lag, shape (1 + m,).
    """

    __slots__ = ()

    if TYPE_CHECKING:

        @property
        def rate_per_decade(self) -> float:
            """Mean rise after a step in each decade of time, over the step [1]."""

    @property
    @abstractmethod
    def time_constants(self) -> Array:
        """Time constants of the lags [s], rising, shape (m,)."""

    @property
    @abstractmethod
    def lag_shares(self) -> Array:
        """Static gain of each lag over the rise in a decade [1], shape (m,)."""

    @property
    def lag_gains(self) -> Array:
        """Static gain of each lag [1], shape (m,)."""
        return self.rate_per_decade * self.lag_shares

    @property
    def static_gain(self) -> float:
        """Output over input after infinite time [1]."""
        return 1.0 + float(self.lag_gains.sum())

    def settled(self, x: float, dt: float) -> Array:
        del dt
        return np.full(1 + self.time_constants.size, float(x))

    def step_response(self, time: ArrayLike) -> Array:
        """Return the response to a unit step of the input.

        Parameters
        ----------
        time : array_like
            Times after the step [s], shape (k,).

        Returns
        -------
        numpy.ndarray
            Output [1], shape (k,).
        """
        t = np.asarray(time, dtype=np.float64)
        rise = decay_share(t[..., None] / self.time_constants)
        return 1.0 + rise @ self.lag_gains

    def simulate(self, x: ArrayLike, dt: float, state: ArrayLike | None = None) -> Response:
        inputs = samples(x, "input of creep")
        now, decay, ramp = self._start(inputs[0], dt, state)
        y = np.empty_like(inputs)
        _creep(inputs, now, decay, ramp, self.lag_gains, y)
        return Response(values=y, state=now)

    def simulate_rows(self, x: Array, dt: float, states: Array) -> Array:
        """Return the outputs for several sequences of inputs.

        Parameters
        ----------
        x : numpy.ndarray
            Inputs, a sequence in each row, shape (m, n).
        dt : float
            Step between samples [s].
        states : numpy.ndarray
            State of each sequence one step before the first sample, overwritten, shape (m, 1 + k).

        Returns
        -------
        numpy.ndarray
            The outputs, shape (m, n).
        """
        ratio = dt / self.time_constants
        decay, ramp, y = decay_share(ratio), ramp_share(ratio), np.empty(x.shape)
        _creep_rows(np.ascontiguousarray(x), states, decay, ramp, self.lag_gains, y)
        return y

    def inverse(self, y: ArrayLike, dt: float, state: ArrayLike | None = None) -> Response:
        """Return the input that gives a sequence of outputs, exact to rounding.

        Parameters
        ----------
        y : array_like
            Outputs, shape (n,).
        dt : float
            Step between samples [s].
        state : array_like, optional
            State one step before the first of them; settled at the first where not given.

        Returns
        -------
        Response
            The inputs, and the state at the last sample.
        """
        outputs = samples(y, "output of creep")
        now, decay, ramp = self._start(outputs[0] / self.static_gain, dt, state)
        x = np.empty_like(outputs)
        _invert_creep(outputs, now, decay, ramp, self.lag_gains, x)
        return Response(values=x, state=now)

    def frequency_response(self, frequency_hz: ArrayLike) -> Complex:
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)[..., None]
        return 1.0 + (1.0 / (1.0 + s * self.time_constants)) @ self.lag_gains

    def _start(self, first: float, dt: float, state: ArrayLike | None) -> tuple[Array, ...]:
        ratio = positive_step(dt) / self.time_constants
        now = self._initial_state(first, dt, state, "creep")
        return now, decay_share(ratio), ramp_share(ratio)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogCreep(Creep):
    r"""Linear creep, logarithmic in time.

    .. math:: y = x + \frac{\gamma}{p} \sum_i l_i, \qquad \tau_i \dot l_i + l_i = x, \qquad
              \tau_i = \tau_s 10^{(i + 1/2)/p}

    After a step of the input the output immediately follows the step, and then rises by
    :math:`\gamma` times the step in each decade of time: lags with time constants spaced uniformly
    in the logarithm represent the operator of Kuhnen and Janocha (K. Kuhnen, H. Janocha, Proc. 6th
    Int. Conf. New Actuators ACTUATOR 98, Bremen 1998; K. Kuhnen, Control Eng. Practice 13 (2005)).
    Their continuous distribution between :math:`\tau_s` and :math:`\tau_l` has the step response
    :math:`1 + \gamma [\ln(\tau_l/\tau_s) + E_1(t/\tau_s) - E_1(t/\tau_l)]/\ln 10`, which is
    :math:`1 + \gamma \log_{10}(t/t_0)` with :math:`t_0 = 0.5615\,\tau_s` for times well between
    the two.

    Validity: small signals and one temperature; creep is the same for rise and fall, and does not
    depend on the history otherwise. Within a factor of 10 of `shortest` and `longest` the response
    leaves the logarithm, and it is constant beyond. Few lags ripple about it: by 2 % of
    `rate_per_decade` with one a decade, 0.02 % with two, 0.0002 % with three.

    Raises
    ------
    ModelError
        The rate is negative, or the times are not positive and rising.

    Examples
    --------
    >>> import numpy as np
    >>> creep = LogCreep(rate_per_decade=0.02)
    >>> jump = creep.settled(0.0, 0.05)
    >>> jump[0] = 1.0
    >>> y = creep.simulate(np.ones(200), 0.05, jump).values
    >>> round(float(y[199] - y[19]), 5)
    0.0199
    """

    rate_per_decade: float
    """Rise after a step in each decade of time, over the step [1]; not negative."""
    shortest: float = 0.01
    """Time at which creep begins [s]."""
    longest: float = 1000.0
    """Time at which creep ends [s]."""
    per_decade: int = 2
    """Number of lags in a decade p."""

    def __post_init__(self) -> None:
        checked(self.rate_per_decade, "rate of creep", "finite and not negative")
        if not SHORTEST <= self.shortest < self.longest <= LONGEST:
            raise ModelError(
                f"the times of creep must rise and be between {SHORTEST:g} and {LONGEST:g} s, got "
                f"{self.shortest!r} and {self.longest!r} s"
            )
        if not 1 <= self.per_decade <= 100:
            raise ModelError(
                f"creep needs 1 to 100 lags in a decade, got {self.per_decade!r}: 2 is usual"
            )

    @property
    def time_constants(self) -> Array:
        decades = math.log10(self.longest / self.shortest)
        count = max(1, math.ceil(self.per_decade * decades - 1e-9))
        # an integer number of lags, uniform over the decades between the given ends
        return self.shortest * 10.0 ** (decades * (np.arange(count) + 0.5) / count)

    @property
    def lag_shares(self) -> Array:
        count = self.time_constants.size
        return np.full(count, math.log10(self.longest / self.shortest) / count)

    @property
    def lag_gain(self) -> float:
        """Static gain of each lag [1]."""
        decades = math.log10(self.longest / self.shortest)
        return self.rate_per_decade * decades / self.time_constants.size

    @property
    def lag_gains(self) -> Array:
        return np.full(self.time_constants.size, self.lag_gain)


@dataclass(frozen=True, slots=True, kw_only=True)
class CreepSpectrum(Creep):
    r"""Linear creep with a separate weight for each time constant.

    .. math:: y = x + \sum_i a_i l_i, \qquad \tau_i \dot l_i + l_i = x, \qquad a_i \ge 0

    A spectrum of relaxation as of a generalised Kelvin-Voigt body (J. D. Ferry, Viscoelastic
    Properties of Polymers, 1980, chapter 3): short time constants are the loss of loops at 10 to
    500 Hz in addition to hysteresis, long ones are creep. After a step of the input the output
    immediately follows the step, and is then :math:`1 + \sum_i a_i (1 - e^{-t/\tau_i})` times it.
    As no weight is negative the inverse is stable, and exact from sample to sample.

    Validity: as `LogCreep`, from the shortest time constant to the longest; rates between those of
    the records that it was found from.

    Raises
    ------
    ModelError
        The time constants are not positive and rising, or a weight is negative.

    Examples
    --------
    >>> creep = CreepSpectrum(times=(0.01, 2.0), weights=(0.03, 0.05))
    >>> creep.step_response([0.0, 0.1, 100.0]).round(4)
    array([1.    , 1.0324, 1.08  ])
    """

    times: tuple[float, ...]
    """Time constants [s], rising."""
    weights: tuple[float, ...]
    """Static gain of each lag [1]; not negative."""

    def __post_init__(self) -> None:
        for name in ("times", "weights"):
            value = tuple(float(v) for v in getattr(self, name))
            object.__setattr__(self, name, value)
        tau, a = np.array(self.times), np.array(self.weights)
        if (
            tau.size == 0
            or not np.all((tau >= SHORTEST) & (tau <= LONGEST))
            or np.any(np.diff(tau) <= 0.0)
        ):
            raise ModelError(
                f"the time constants of creep must rise and be between {SHORTEST:g} and "
                f"{LONGEST:g} s, got {self.times}"
            )
        if a.shape != tau.shape or not np.all(np.isfinite(a)) or a.min() < 0.0 or a.max() == 0.0:
            raise ModelError(
                "creep needs one weight for each time constant, finite, none negative and not all "
                f"zero, got {self.weights} for {tau.size}"
            )

    @property
    def time_constants(self) -> Array:
        return np.array(self.times)

    @property
    def rate_per_decade(self) -> float:
        """Mean rise after a step in a decade of time, over the step [1]."""
        return sum(self.weights) / (1.0 + math.log10(self.times[-1] / self.times[0]))

    @property
    def lag_shares(self) -> Array:
        return np.array(self.weights) / self.rate_per_decade

    def scaled(self, rate_per_decade: float) -> "CreepSpectrum":
        """Return creep of the same time constants, larger or smaller.

        Parameters
        ----------
        rate_per_decade : float
            Mean rise after a step in a decade of time, over the step [1].

        Returns
        -------
        CreepSpectrum
            The creep.
        """
        weights = tuple(rate_per_decade * self.lag_shares)
        return CreepSpectrum(times=self.times, weights=weights)


def creep_start(creep: Creep, x: Array, dt: float, start: Start | Array) -> Array:
    """Return the state of creep before a sequence, by the motion of the drive before it.

    Creep has a longer memory than any record. After a rest at the first command, all lags have
    settled there; after motion for a time t since the low end of the range, each lag has moved from
    there to the mean of the motion by ``1 - exp(-t / tau)``. In steady periodic motion each lag
    returns to its state, by ``exp(-T / tau)`` of any deviation after a period T. The input x is the
    output of the hysteresis, shape (n,), or several of them, (m, n), as is the state one step
    before the first sample. A number as `start` is the time of motion [s]; an array is the state.
    """
    if isinstance(start, np.ndarray):
        return start
    state = x[..., :1] * creep.settled(1.0, dt)
    if start == "periodic":
        period = x[..., :-1]
        state[..., 0] = period[..., -1]
        after = np.atleast_2d(state).copy()
        creep.simulate_rows(np.atleast_2d(period), dt, after)
        change = after.reshape(state.shape)[..., 1:] - state[..., 1:]
        state[..., 1:] += change / decay_share(period.shape[-1] * dt / creep.time_constants)
    elif start != "rested":
        mean, low = (by(x, axis=-1, keepdims=True) for by in (np.mean, np.min))
        state[..., 1:] = mean + (low - mean) * np.exp(-start / creep.time_constants)
    return state


@compiled
def _creep(x: Array, state: Array, decay: Array, ramp: Array, gain: Array, y: Array) -> None:
    last = state[0]
    for k in range(x.size):
        rise = x[k] - last
        total = 0.0
        for i in range(decay.size):
            lag = state[i + 1]
            lag += (last - lag) * decay[i] + rise * ramp[i]
            state[i + 1] = lag
            total += gain[i] * lag
        last = x[k]
        y[k] = last + total
    state[0] = last


@compiled
def _creep_rows(x: Array, states: Array, decay: Array, ramp: Array, gain: Array, y: Array) -> None:
    for j in range(x.shape[0]):
        _creep(x[j], states[j], decay, ramp, gain, y[j])


@compiled
def _invert_creep(y: Array, state: Array, decay: Array, ramp: Array, gain: Array, x: Array) -> None:
    last = state[0]
    stiff = 1.0 + (gain * ramp).sum()
    for k in range(y.size):
        # output for a constant input; the remainder is the rise times `stiff`
        total = 0.0
        for i in range(decay.size):
            lag = state[i + 1]
            lag += (last - lag) * decay[i]
            state[i + 1] = lag
            total += gain[i] * lag
        rise = (y[k] - last - total) / stiff
        for i in range(decay.size):
            state[i + 1] += rise * ramp[i]
        last += rise
        x[k] = last
    state[0] = last
