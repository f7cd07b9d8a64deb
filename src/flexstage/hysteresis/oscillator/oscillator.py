"""A mass on a spring, a damper and a Bouc–Wen force that depends on its motion."""

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from flexstage.errors import ModelError
from flexstage.hysteresis.model import Array, samples
from flexstage.hysteresis.oscillator.input import Interpolation, input_pieces
from flexstage.hysteresis.oscillator.steps import advance

#: Degree of the Taylor series of a step.
ORDER = 16
#: Largest last term of a series, in parts of the sum of its first five.
TOLERANCE = 1e-15


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
