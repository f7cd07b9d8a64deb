"""An oscillator with hysteresis, and the excitation that moves it."""

import math
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.errors import ModelError
from flexstage.hysteresis.model import Array, samples
from flexstage.hysteresis.oscillator.steps import advance

#: How an input moves between its samples.
Interpolation = Literal["band-limited", "periodic", "linear"]

#: Coefficients of a piece. Full bandwidth turns by pi in an interval; its Chebyshev interpolant of
#: degree 13 is off by 2 (pi/4)**14 / 14! = 8e-13 of the amplitude.
COEFFICIENTS = 14
#: Samples on either side of an interval that determine its piece.
REACH = 32
#: Shape of the Kaiser window. With 64 samples, -150 dB for all that is below 0.42 of the rate.
KAISER = 16.0
#: Degree of the Taylor series of a step.
ORDER = 16
#: Largest last term of a series, in parts of the sum of its first five.
TOLERANCE = 1e-15


def input_pieces(u: Array, interpolation: Interpolation) -> Array:
    """Return the polynomials that an input follows between its samples.

    On interval i, with s counted from its middle in samples, -1/2 to 1/2, the input is
    ``sum_j pieces[i, j] s**j``. Three ways:

    - ``band-limited``: a sum of sinc functions (Shannon, Proc. IRE 37, 1949) under a Kaiser window
      of 64 samples. Past its ends the input is mirrored in its first and its last point, which
      continues a value and a slope smoothly.
    - ``periodic``: the trigonometric polynomial through the samples, which are whole periods.
    - ``linear``: straight lines.

    Returned: shape (n - 1, 14), or (n - 1, 2) for straight lines.

    Notes
    -----
    Validity: content up to 0.42 of the sampling rate, to 3e-8 of its amplitude (``band-limited``);
    up to half of the sampling rate (``periodic``). Within 32 samples of an end ``band-limited``
    depends on how the input was mirrored.

    Examples
    --------
    >>> phase = 2.0 * np.pi * 0.2 * np.arange(101)
    >>> pieces = input_pieces(np.sin(phase), "band-limited")
    >>> print(f"{pieces[50, 0]:.6f} {np.sin(2.0 * np.pi * 0.2 * 50.5):.6f}")  # between two samples
    0.587785 0.587785
    """
    if interpolation == "linear":
        return np.stack([0.5 * (u[1:] + u[:-1]), np.diff(u)], axis=1)
    if interpolation == "periodic":
        return _periodic(u)
    if interpolation == "band-limited":
        return _band_limited(u)
    raise ModelError(
        f"there is no interpolation {interpolation!r}: take 'band-limited', 'periodic' or 'linear'"
    )


def _nodes() -> tuple[Array, Array]:
    """Return Chebyshev nodes from -1/2 to 1/2, and what turns values there into coefficients."""
    nodes = 0.5 * np.cos(np.pi * (np.arange(COEFFICIENTS) + 0.5) / COEFFICIENTS)
    # In units of half an interval the powers are as well conditioned as they can be.
    to_coefficients = np.linalg.inv(np.vander(2.0 * nodes, increasing=True))
    return nodes, 2.0 ** np.arange(COEFFICIENTS)[:, None] * to_coefficients


def _periodic(u: Array) -> Array:
    nodes, to_coefficients = _nodes()
    n = u.size
    spectrum = np.fft.rfft(u)
    turns = 2.0j * np.pi * np.arange(spectrum.size) / n
    values = np.empty((n - 1, COEFFICIENTS))
    for column, node in enumerate(nodes):
        # Of the last line of an even record, whose phase samples do not show, irfft takes the
        # real part: the cosine, which is the smallest wave through the samples.
        values[:, column] = np.fft.irfft(spectrum * np.exp(turns * (node + 0.5)), n)[:-1]
    return values @ to_coefficients.T


def _band_limited(u: Array) -> Array:
    nodes, to_coefficients = _nodes()
    offsets = np.arange(1 - REACH, REACH + 1) - 0.5  # of the samples, from the middle
    distance = nodes[:, None] - offsets[None, :]
    window = np.i0(KAISER * np.sqrt(np.maximum(1.0 - (distance / REACH) ** 2, 0.0)))
    weights = np.where(np.abs(distance) < REACH, np.sinc(distance) * window, 0.0)
    # A constant must stay what it is.
    weights /= np.sum(weights, axis=1, keepdims=True)
    kernel = (to_coefficients @ weights).T
    # past its ends the force continues, turned half round about its first and last point
    extended = np.pad(u, REACH - 1, mode="reflect", reflect_type="odd")
    windows = np.lib.stride_tricks.sliding_window_view(extended, 2 * REACH)
    pieces = np.empty((u.size - 1, COEFFICIENTS))
    for start in range(0, u.size - 1, 4096):
        pieces[start : start + 4096] = windows[start : start + 4096] @ kernel
    return pieces


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OscillatorResponse:
    """The motion of an oscillator."""

    displacement: Array
    """y [m], shape (n,)."""
    velocity: Array
    """y' [m/s], shape (n,)."""
    force: Array
    """Hysteretic force z [N], shape (n,)."""
    state: Array
    """Displacement, velocity and hysteretic force at the last sample, shape (3,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BoucWenOscillator:
    """A mass on a spring and a damper with a hysteretic force that its own motion drives.

    ``m y'' + c y' + k y + z = u`` and
    ``z' = alpha y' - beta gamma |y'| |z|**(nu - 1) z - beta delta y' |z|**nu``
    (Bouc 1967; Wen, J. Eng. Mech. 102, 1976; as a benchmark of identification: Noël and Schoukens,
    Workshop on Nonlinear System Identification Benchmarks, 2016). Of beta, gamma and delta only
    the two products act.

    Notes
    -----
    Validity: one degree of freedom; loops symmetric about zero; no creep, no dependence of the
    force on the rate but that of c. The hysteretic force is bounded by
    ``(alpha / (beta gamma + beta delta))**(1/nu)`` where that sum is above zero; where it is not,
    the force grows without bound with the displacement (the benchmark is of this kind), and a
    motion outside of the range of identification may diverge.

    A step is a Taylor series in time, whose terms follow one from another because the right side is
    a polynomial (Jorba and Zou, Exp. Math. 14, 2005). It ends where y' or z changes its sign, at
    the zero of that series, as the right side has a corner there. Where nu is not 1 or 2, steps
    shrink towards z = 0, where a power has no series. So what remains is rounding, and the question
    what the input does between its samples.

    Examples
    --------
    >>> model = BoucWenOscillator(
    ...     mass=1.7, damping=8.0, stiffness=4.1e4, alpha=5.3e4,
    ...     beta_gamma=870.0, beta_delta=-420.0,
    ... )
    >>> drive = 60.0 * np.sin(2.0 * np.pi * 23.0 * np.arange(400) / 800.0)
    >>> response = model.simulate(drive, 800.0)
    >>> print(f"{1e6 * response.displacement[-1]:.6f} um")
    458.473605 um
    """

    mass: float
    """Mass m [kg], above zero."""
    damping: float
    """Viscous damping c [N s/m]."""
    stiffness: float
    """Stiffness k of the spring [N/m]."""
    alpha: float
    """Stiffness of the hysteretic force about z = 0 [N/m], above zero."""
    beta_gamma: float
    """Product beta gamma [1/m for an exponent of one; in general N**(1 - nu)/m]."""
    beta_delta: float
    """Product beta delta, in the same unit."""
    exponent: float = 1.0
    """Exponent nu, above zero. As alpha is above zero, z passes zero at a slope, and the motion is
    unique below 1 too.
    """

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not math.isfinite(value):
                raise ModelError(f"{field.name} must be a finite number, got {value}")
        if self.mass <= 0.0:
            raise ModelError(f"mass must be above zero, got {self.mass} kg")
        if self.alpha <= 0.0:
            raise ModelError(
                f"alpha must be above zero, got {self.alpha} N/m: put a force without hysteresis "
                "into the stiffness"
            )
        if self.exponent <= 0.0:
            raise ModelError(f"exponent must be above zero, got {self.exponent}")

    def simulate(
        self,
        u: ArrayLike,
        sample_rate_hz: float,
        initial: ArrayLike | None = None,
        *,
        interpolation: Interpolation = "band-limited",
    ) -> OscillatorResponse:
        """Return the motion under a sampled force.

        Force [N], at least two samples. Initial: displacement [m], velocity [m/s] and hysteretic
        force [N] at the first sample; at rest where not given. `periodic` is for a record of whole
        periods; see `input_pieces`. A ModelError too where the motion diverges.
        """
        force = samples(u, "force")
        pieces = prepared_input(force, sample_rate_hz, interpolation)
        start = _initial(initial)
        motion = np.empty((force.size, 3))
        done = advance(
            pieces, 1.0 / sample_rate_hz, parameter_row(self), start, ORDER, TOLERANCE, motion
        )
        if done < force.size:
            raise ModelError(
                f"the motion diverges after sample {done - 1} of {force.size}: there is no "
                "equilibrium; lower the force, or correct the parameters"
            )
        y, v, z = np.ascontiguousarray(motion.T)
        return OscillatorResponse(displacement=y, velocity=v, force=z, state=motion[-1].copy())


def prepared_input(force: Array, sample_rate_hz: float, interpolation: Interpolation) -> Array:
    """Return the pieces of a force after checking it."""
    if force.size < 2:
        raise ModelError("the force must have two samples or more, got one: give the whole record")
    if not (math.isfinite(sample_rate_hz) and sample_rate_hz > 0.0):
        raise ModelError(f"the sampling rate must be above zero, got {sample_rate_hz} Hz")
    return input_pieces(force, interpolation)


def parameter_row(model: BoucWenOscillator) -> Array:
    """Return m, c, k, alpha, beta gamma, beta delta and nu as the compiled loops take them."""
    return np.array([getattr(model, field.name) for field in fields(model)], dtype=np.float64)


def _initial(initial: ArrayLike | None) -> Array:
    start = np.zeros(3) if initial is None else np.array(initial, dtype=np.float64)
    if start.shape != (3,) or not np.all(np.isfinite(start)):
        raise ModelError(
            "an initial state is a displacement, a velocity and a force, three finite numbers, got "
            f"shape {start.shape}"
        )
    return start
