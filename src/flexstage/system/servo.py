r"""Settings of a position control: proportional and integral terms, and filters of the error.

With the error :math:`e_k = r_k - y_k` after all filters, as a sampled controller computes it:

.. math:: I_k = I_{k-1} + k_i T e_k, \qquad u_k = u^{ff}_k + k_p e_k + I_k

and :math:`I` is constant while :math:`u` is at a limit of its range. Filters are bilinear
transforms, prewarped at their own frequency. The same coefficients serve the design of a loop and
the loop itself.
"""

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.errors import ModelError


@dataclass(frozen=True, slots=True, kw_only=True)
class Notch:
    r"""A notch.

    .. math:: N(s) = \frac{s^2 + 2\zeta_z\omega s + \omega^2}{s^2 + 2\zeta_p\omega s + \omega^2}
    """

    frequency_hz: float
    """Frequency [Hz]."""
    zero_damping: float = 0.01
    """Damping ratio of its zeros [1]; 0 blocks the frequency completely."""
    pole_damping: float = 0.5
    """Damping ratio of its poles [1]: the larger, the wider."""

    def __post_init__(self) -> None:
        if not (0.0 < self.frequency_hz < math.inf and 0.0 < self.pole_damping < math.inf):
            raise ModelError(
                "a notch needs a positive frequency and damping of its poles, got "
                f"{self.frequency_hz!r} Hz and {self.pole_damping!r}"
            )
        if not 0.0 <= self.zero_damping < math.inf:
            raise ModelError(
                f"the damping of a notch's zeros must be 0 or more, got {self.zero_damping!r}"
            )

    def section(self, sample_rate_hz: float) -> NDArray[np.float64]:
        """Return b0, b1, b2, a1, a2 of its difference equation (a0 = 1) at the loop's rate [Hz]."""
        w = math.tan(math.pi * _below_nyquist(self.frequency_hz, sample_rate_hz) / sample_rate_hz)
        z, p = 2.0 * self.zero_damping * w, 2.0 * self.pole_damping * w
        a0 = 1.0 + p + w * w
        mid = 2.0 * (w * w - 1.0) / a0
        return np.array([(1.0 + z + w * w) / a0, mid, (1.0 - z + w * w) / a0, mid,
                         (1.0 - p + w * w) / a0])  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Lead:
    r"""A lead, or with its pole below its zero a lag, of unit gain at zero frequency.

    .. math:: N(s) = \frac{1 + s / \omega_z}{1 + s / \omega_p}

    In series with proportional and integral gain it is the filtered derivative of a PID control.
    """

    zero_hz: float
    """Frequency of its zero [Hz]."""
    pole_hz: float
    """Frequency of its pole [Hz]."""

    def __post_init__(self) -> None:
        if not (0.0 < self.zero_hz < math.inf and 0.0 < self.pole_hz < math.inf):
            raise ModelError(
                "a lead needs positive frequencies of its zero and pole, got "
                f"{self.zero_hz!r} and {self.pole_hz!r} Hz"
            )

    def section(self, sample_rate_hz: float) -> NDArray[np.float64]:
        """Return b0, b1, b2, a1, a2 of its difference equation (a0 = 1) at the loop's rate [Hz]."""
        z, p = (
            1.0 / math.tan(math.pi * _below_nyquist(f, sample_rate_hz) / sample_rate_hz)
            for f in (self.zero_hz, self.pole_hz)
        )
        return np.array([(1.0 + z) / (1.0 + p), (1.0 - z) / (1.0 + p), 0.0,
                         (1.0 - p) / (1.0 + p), 0.0])  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Filter:
    r"""A filter by the coefficients of its difference equation, at the rate of its loop alone.

    .. math:: y_k = b_0 x_k + b_1 x_{k-1} + b_2 x_{k-2} - a_1 y_{k-1} - a_2 y_{k-2}
    """

    b0: float
    """Coefficient of the input."""
    b1: float
    """Coefficient of the input one sample before."""
    b2: float
    """Coefficient of the input two samples before."""
    a1: float
    """Coefficient of the output one sample before."""
    a2: float
    """Coefficient of the output two samples before."""

    def __post_init__(self) -> None:
        # both poles within the unit circle
        if not abs(self.a1) - 1.0 < self.a2 < 1.0:
            raise ModelError(
                f"a filter must be stable, |a1| - 1 < a2 < 1, got a1 {self.a1!r} and a2 {self.a2!r}"
            )

    def section(self, _sample_rate_hz: float) -> NDArray[np.float64]:
        """Return b0, b1, b2, a1, a2 of its difference equation (a0 = 1)."""
        return np.array([self.b0, self.b1, self.b2, self.a1, self.a2])


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoSettings:
    """Settings of the position control of one axis.

    Examples
    --------
    >>> settings = ServoSettings(integral=1.9e9, notches=(Notch(frequency_hz=800.0),))
    >>> response = settings.response([10.0, 800.0], 10e3)
    >>> print(f"{abs(response[0]) / abs(response[1]):.0f}")
    3958
    """

    proportional: float = 0.0
    """Proportional gain [V/m]."""
    integral: float = 0.0
    """Integral gain [V/(m s)]."""
    notches: tuple[Notch, ...] = field(default=())
    """Notches, in the path of the error."""
    lowpass_hz: float | None = None
    """Corner of a second-order low-pass (Butterworth) in the same path [Hz]; none where not given.
    """
    leads: tuple[Lead, ...] = field(default=())
    """Leads in the same path."""
    filters: tuple[Filter, ...] = field(default=())
    """Further filters in the same path."""
    second_integral_hz: float | None = None
    r"""Frequency below which a second integral acts, :math:`1 + \omega/s` in the same path [Hz];
    none where not given.
    """

    def __post_init__(self) -> None:
        for name in ("proportional", "integral"):
            if not 0.0 <= (value := getattr(self, name)) < math.inf:
                raise ModelError(f"the {name} gain must be 0 or more and finite, got {value!r}")
        for name in ("lowpass_hz", "second_integral_hz"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                noun = "low-pass" if name == "lowpass_hz" else "second integral"
                raise ModelError(f"the {noun} must be positive and finite, got {value!r}")

    def scaled(self, factor: float) -> "ServoSettings":
        """Return the settings with both gains times a factor."""
        return replace(
            self, integral=factor * self.integral, proportional=factor * self.proportional
        )

    def sections(self, sample_rate_hz: float) -> NDArray[np.float64]:
        """Return the filters of the error, one row of b0, b1, b2, a1, a2 (a0 = 1) each."""
        rows = [
            part.section(sample_rate_hz) for part in (*self.notches, *self.leads, *self.filters)
        ]
        if self.lowpass_hz is not None:
            rows.append(_lowpass(self.lowpass_hz, math.sqrt(0.5), sample_rate_hz))
        if self.second_integral_hz is not None:
            corner = _below_nyquist(self.second_integral_hz, sample_rate_hz)
            w = math.tan(math.pi * corner / sample_rate_hz)
            rows.append(np.array([1.0 + w, w - 1.0, 0.0, -1.0, 0.0]))
        return np.array(rows).reshape(len(rows), 5)

    def response(self, frequency_hz: ArrayLike, sample_rate_hz: float) -> NDArray[np.complex128]:
        """Return the frequency response of the controller, voltage over error [V/m]."""
        z = _delay_operator(frequency_hz, sample_rate_hz)
        total = np.full(z.shape, self.proportional, dtype=np.complex128)
        if self.integral:
            total += self.integral / sample_rate_hz / (1.0 - z)
        for section in self.sections(sample_rate_hz):
            total *= _of_section(section, z)
        return total

    def transfer_function(self, sample_rate_hz: float) -> tuple[list[float], list[float]]:
        """Return numerator and denominator of voltage over error, by falling powers of z."""
        part = self.integral / sample_rate_hz
        above, below = (
            np.array([self.proportional + part, -self.proportional]),
            np.array([1.0, -1.0]),
        )
        if not part:
            above, below = above[:1], below[:1]
        for section in self.sections(sample_rate_hz):
            above = np.convolve(above, section[:3])
            below = np.convolve(below, [1.0, *section[3:]])
        return above.tolist(), below.tolist()


@dataclass(frozen=True, slots=True, kw_only=True)
class InnerLoop:
    """Base of loops that damp a mode inside a position control."""

    kind: ClassVar[str]
    integrals: ClassVar[int] = 0
    """Number of its integrals."""
    gain: float
    """Gain."""

    def around(
        self, control: NDArray[np.complex128], frequency_hz: ArrayLike, sample_rate_hz: float
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the negative feedback of reading [V/m] and force [V/N] with a position control."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionFeedback(InnerLoop):
    r"""Positive position feedback (C. J. Goh, T. K. Caughey, Int. J. Control 41 (1985) 787).

    .. math:: u = C (r - y) + \frac{g\,\omega^2}{s^2 + 2\zeta\omega s + \omega^2}\, y

    Validity: stable without delay while the static gain of the loop, g times that of the stage, is
    below 1. It softens the stage by one less that gain, and it does not damp modes above it.
    """

    kind: ClassVar[str] = "ppf"
    gain: float
    """Static gain g [V/m]."""
    frequency_hz: float
    """Frequency [Hz]."""
    damping_ratio: float
    """Damping ratio [1]."""

    def __post_init__(self) -> None:
        if not all(0.0 < x < math.inf for x in (self.gain, self.frequency_hz, self.damping_ratio)):
            raise ModelError(
                "a position feedback needs a positive gain, frequency and damping ratio, got "
                f"{self.gain!r} V/m, {self.frequency_hz!r} Hz and {self.damping_ratio!r}"
            )

    def around(
        self, control: NDArray[np.complex128], frequency_hz: ArrayLike, sample_rate_hz: float
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        section = _lowpass(self.frequency_hz, self.damping_ratio, sample_rate_hz)
        z = _delay_operator(frequency_hz, sample_rate_hz)
        return control - self.gain * _of_section(section, z), np.zeros_like(control)


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceFeedback(InnerLoop):
    r"""Integral force feedback of a sensor in line with the stack.

    .. math:: u = \frac{g}{s} \bigl(C (r - y) - f\bigr)

    with the force f of the stack, positive in compression (A. Preumont, Vibration Control of Active
    Structures): the position control commands this force (as Y. R. Teo, D. Russell, S. S. Aphale,
    A. J. Fleming, Mechatronics 24 (2014)), so that the static gain is not lost.

    Validity: sensor and stack are collocated, and the sensor reads slow forces. Without delay it is
    stable at every gain.
    """

    kind: ClassVar[str] = "iff"
    integrals: ClassVar[int] = 1
    gain: float
    """Gain g [V/(N s)]."""

    def __post_init__(self) -> None:
        if not 0.0 < self.gain < math.inf:
            raise ModelError(f"a force feedback needs a positive gain, got {self.gain!r} V/(N s)")

    def around(
        self, control: NDArray[np.complex128], frequency_hz: ArrayLike, sample_rate_hz: float
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        z = _delay_operator(frequency_hz, sample_rate_hz)
        integral = self.gain / sample_rate_hz / (1.0 - z)
        return integral * control, integral


def _delay_operator(frequency_hz: ArrayLike, sample_rate_hz: float) -> NDArray[np.complex128]:
    """Return the response of a delay by one sample."""
    omega = 2.0 * np.pi * np.asarray(frequency_hz, dtype=np.float64) / sample_rate_hz
    return np.exp(-1j * omega)


def _of_section(section: NDArray[np.float64], z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the response of a section, by that of a delay by one sample."""
    b0, b1, b2, a1, a2 = section
    return (b0 + b1 * z + b2 * z * z) / (1.0 + a1 * z + a2 * z * z)


def _lowpass(frequency_hz: float, damping: float, sample_rate_hz: float) -> NDArray[np.float64]:
    """Return b0, b1, b2, a1, a2 (a0 = 1) of a second-order low-pass of unit static gain."""
    w = math.tan(math.pi * _below_nyquist(frequency_hz, sample_rate_hz) / sample_rate_hz)
    a0 = 1.0 + 2.0 * damping * w + w * w
    b = w * w / a0
    last = (1.0 - 2.0 * damping * w + w * w) / a0
    return np.array([b, 2.0 * b, b, 2.0 * (w * w - 1.0) / a0, last])


def _below_nyquist(frequency_hz: float, sample_rate_hz: float) -> float:
    if not frequency_hz < 0.5 * sample_rate_hz:
        raise ModelError(
            f"a filter at {frequency_hz:g} Hz needs a loop faster than twice that, got "
            f"{sample_rate_hz:g} Hz"
        )
    return frequency_hz


def parallel_gains(settings: ServoSettings) -> dict[str, float] | None:
    """Return the parallel gains of a PID without notches and low-pass, or None."""
    if settings.second_integral_hz is not None or len(settings.leads) > 1 or settings.filters:
        return None
    p, i = settings.proportional, settings.integral
    zero, pole = 0.0, 0.0
    for lead in settings.leads:
        zero, pole = (0.5 / (math.pi * f) for f in (lead.zero_hz, lead.pole_hz))
    proportional = p + i * (zero - pole)
    return {
        "proportional": proportional,
        "integral": i,
        "derivative": p * zero - proportional * pole,
        "derivative_time_constant": pole,
    }


def pi_parameters(settings: ServoSettings) -> dict[str, float] | None:
    """Return the parameters of a controller by Physik Instrumente, units as of its axis in um.

    None for a control with a filter that its parameters do not have.
    """
    if settings.leads or settings.filters or settings.lowpass_hz or settings.second_integral_hz:
        return None
    numbers = {
        "0x07000300": 1e-6 * settings.proportional,
        "0x07000301": 1e-6 * settings.integral,
    }
    for slot, notch in enumerate(settings.notches):
        numbers |= {
            f"0x0800010{slot}": notch.frequency_hz,
            f"0x0800020{slot}": notch.zero_damping / notch.pole_damping,
            f"0x0800030{slot}": 2.0 * notch.pole_damping,
        }
    return numbers
