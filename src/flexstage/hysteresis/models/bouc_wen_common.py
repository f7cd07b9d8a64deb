"""What the models of the Bouc-Wen family check and say in the same way."""

import math

import numpy as np

from flexstage.errors import ModelError
from flexstage.hysteresis.model import Array, ModelProperty
from flexstage.hysteresis.models.bouc_wen_steps import law_of


def check_numbers(model: str, numbers: dict[str, float], above_zero: tuple[str, ...]) -> None:
    """Refuse parameters that are not finite, or not above zero where they must be."""
    for name, value in numbers.items():
        if not math.isfinite(value):
            raise ModelError(f"the {name} of {model} must be a finite number, got {value}")
    for name in above_zero:
        if numbers[name] <= 0.0:
            raise ModelError(f"the {name} of {model} must be above zero, got {numbers[name]}")


def check_exponent(model: str, exponent: float) -> None:
    """Refuse an exponent below one."""
    if exponent < 1.0:
        raise ModelError(
            f"the exponent of {model} must be at least 1, got {exponent}: "
            "below it the slope of the loop has a kink of infinite curvature at h = 0"
        )


def state_after(model: str, u: float, h: float) -> Array:
    """Return the state after the last sample.

    A ModelError where h has run away.
    """
    if not math.isfinite(h):
        raise ModelError(
            f"the hysteretic displacement of {model} grew without limit for this input: "
            "see the condition 'bounded' of the model, and correct its parameters or its state"
        )
    return np.array([u, h])


def classical_law(A: float, beta: float, gamma: float, n: float) -> Array:
    """Return the law of the classical shape function, psi = gamma + beta sign(u' h)."""
    unloaded, loaded = gamma - beta, gamma + beta
    return law_of(A, n, -math.inf, np.array([[[unloaded] * 2, [loaded] * 2]] * 2))


def classical_properties(
    A: float, beta: float, gamma: float, n: float
) -> tuple[ModelProperty, ModelProperty, float]:
    """Return whether h is bounded and whether it is dissipative, and its steepest slope dh/du.

    Bounded: Ikhouane, Mañosa, Rodellar 2007, Syst. Control Lett. 56:197, classes I and II;
    dissipative: Erlicher, Point 2004, C. R. Mécanique 332:51. The slope is that just after a
    reversal from saturation, ``A 2 beta/(beta + gamma)``, or A; infinity where h is not bounded.
    """
    total = beta + gamma
    holds = total > 0.0 and beta >= 0.0
    limit = (A / total) ** (1.0 / n) if holds else math.inf
    consequence = f"from rest |h| stays below {limit:.6g}" if holds else "h can grow without limit"
    bounded = ModelProperty(
        name="bounded",
        holds=holds,
        detail=f"beta + gamma > 0 and beta >= 0: {total:.6g} and {beta:.6g}; {consequence}",
    )
    passive = abs(gamma) <= beta
    dissipative = ModelProperty(
        name="dissipative",
        holds=passive,
        detail=(
            f"|gamma| <= beta: {abs(gamma):.6g} and {beta:.6g}; "
            f"{'no' if passive else 'some'} motion gives energy out of nothing"
        ),
    )
    steepest = A * max(1.0, 2.0 * beta / total) if holds else math.inf
    return bounded, dissipative, steepest
