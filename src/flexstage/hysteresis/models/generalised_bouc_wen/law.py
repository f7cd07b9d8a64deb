"""The generalised Bouc-Wen model, with six parameters for the shape of its loop."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.hysteresis.model import Array, ModelProperty
from flexstage.hysteresis.models.bouc_wen_common import (
    BoucWenModel,
    bouc_wen_c_code,
    bouc_wen_matlab_code,
)
from flexstage.hysteresis.models.bouc_wen_steps import law_of
from flexstage.hysteresis.models.source_code import HysteresisCode


@dataclass(frozen=True, slots=True, kw_only=True)
class GeneralisedBoucWen(BoucWenModel):
    """Generalised Bouc-Wen hysteresis y = d u - h (Song, Der Kiureghian 2006).

    The hysteretic displacement h obeys ``h' = u' (A - |h|^n psi)`` with the shape function
    ``psi = b1 sgn(u' h) + b2 sgn(x u') + b3 sgn(x h) + b4 sgn(u') + b5 sgn(h) + b6 sgn(x)``, where
    x = u - centre (Song, Der Kiureghian 2006, J. Eng. Mech. 132:610, Eqs. 8 and 9). In each of the
    regions that the three signs make, psi is a number, and the motion is solved exactly.

    Notes
    -----
    Validity: a loop that need not be odd about its centre; minor loops that need not close; no
    dependence on rate, no creep. Exact to rounding for an input of straight lines. State: last
    input and h.

    Examples
    --------
    >>> stack = GeneralisedBoucWen(gain=0.593e-6, hysteresis_gain=0.361e-6, centre=57.0,
    ...                            shape=(0.05, 0.006, 0.002, 0.003, -0.001, 0.004))
    >>> up_and_down = [40.0, 120.0, 40.0]
    >>> [f"{1e6 * y:.3f}" for y in stack.simulate(up_and_down).values]
    ['16.517', '65.476', '30.834']
    """

    kind: ClassVar[str] = "generalised-bouc-wen"
    title: ClassVar[str] = "generalised Bouc-Wen"
    units: ClassVar[Mapping[str, str]] = {
        "gain": "{y}/{u}",
        "hysteresis_gain": "{y}/{u}",
        "shape": "1/{u}",
        "centre": "{u}",
    }
    loading: ClassVar[str] = "its shape function is at least zero in every loading region"

    gain: float
    """Gain d of the straight part [unit of y per unit of u]."""
    hysteresis_gain: float
    """Gain A, the slope dh/du at h = 0 [unit of y per unit of u]; above zero."""
    shape: tuple[float, ...]
    """Parameters b1 to b6 of the shape function [per unit of u, times unit of y to the power 1 -
    n]. The first is beta of Bouc-Wen; the others make the loop asymmetric.
    """
    centre: float = 0.0
    """Input about which the shape function tells below from above [unit of u]."""
    exponent: float = 1.0
    """Exponent n, at least 1: how sharply h turns into saturation."""

    def __post_init__(self) -> None:
        if len(self.shape) != 6:
            raise ModelError(f"the shape of {self.title} is six numbers, got {len(self.shape)}")
        object.__setattr__(self, "shape", tuple(float(number) for number in self.shape))
        self._check("hysteresis_gain")
        self._check_exponent()

    def shape_function(self) -> Array:
        """Return the shape function in its eight regions.

        Returns
        -------
        numpy.ndarray
            psi for an input that (falls, rises), by h (unloaded, loaded: of the sign of u'), by
            the input (below, above the centre), shape (2, 2, 2).
        """
        b1, b2, b3, b4, b5, b6 = self.shape
        rate = np.array([-1.0, 1.0])[:, None, None]
        loaded = np.array([-1.0, 1.0])[:, None]
        side = np.array([-1.0, 1.0])
        h = rate * loaded
        return (
            b1 * loaded + b2 * side * rate + b3 * side * h + b4 * rate + b5 * h + b6 * side
        ) + np.zeros((2, 2, 2))

    def properties(self) -> tuple[ModelProperty, ...]:
        # Bounded: psi above zero where h is loaded, and h never beyond where unloading would drive
        # it off. Dissipative: no step gives energy out of nothing, measured with the energy h^2/(2
        # A) that h stores (Erlicher, Point 2004, C. R. Mécanique 332:51, for this psi). Invertible:
        # gain above the steepest dh/du.
        A, psi = self.hysteresis_gain, self.shape_function()
        loaded, unloaded = psi[:, 1].min(), psi[:, 0]
        # The farthest that h gets, as A/|h|^n, and how fast unloading can be there.
        holds = bool(loaded > 0.0 and unloaded.max() < loaded)
        steepest = A * max(1.0, 1.0 - unloaded.min() / loaded) if holds else math.inf
        dissipates = bool(loaded >= 0.0 and unloaded.max() <= 0.0)
        return (
            ModelProperty(
                name="bounded",
                holds=holds,
                detail=(
                    f"psi above zero where h is loaded, and above psi where it is unloaded: "
                    f"{loaded:.6g} at least, and {unloaded.max():.6g} at most"
                ),
            ),
            ModelProperty(
                name="dissipative",
                holds=dissipates,
                detail=(
                    f"psi at least zero where h is loaded, at most zero where it is unloaded: "
                    f"{loaded:.6g} at least, and {unloaded.max():.6g} at most"
                ),
            ),
            self._invertible(
                self.gain,
                steepest,
                "gain above the steepest dh/du, just after a reversal from saturation",
            ),
        )

    def _law(self) -> Array:
        return law_of(self.hysteresis_gain, self.exponent, self.centre, self.shape_function())


def c_code(model: GeneralisedBoucWen) -> HysteresisCode:
    """Return the code in C, with pieces where the exponent is 1."""
    names = ("gain", "hysteresis_gain", *(f"shape[{k}]" for k in range(6)), "centre")
    return bouc_wen_c_code(model, names, 4 if model.exponent == 1.0 else 0)


matlab_code = bouc_wen_matlab_code
