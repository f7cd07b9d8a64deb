"""Hyperbolic notch: the one whose stress concentration is known exactly."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexstage.hinges.profile import Array, CurvedProfile, Length, Piece


@dataclass(frozen=True, slots=True, kw_only=True)
class Hyperbolic(CurvedProfile):
    r"""Notch between the branches of a hyperbola.

    .. math::

        h(x) = 2\sqrt{\frac{t^2}{4} + \Bigl(\bigl(c + \tfrac t2\bigr)^2 - \frac{t^2}{4}\Bigr)
               \frac{x^2}{l^2}}

    (N. Lobontiu, Compliant Mechanisms, 2003, section 2.2), with half length l and depth c. Cut from
    one side only, the contour of that side is the same.

    Examples
    --------
    >>> notch = Hyperbolic(neck_thickness=0.5e-3, half_length=2e-3, notch_depth=1e-3)
    >>> round(notch.neck_radius, 9)
    0.000666667
    """

    kind: ClassVar[str] = "hyperbolic"

    half_length: Length
    """Distance l from the neck to the root [m]."""
    notch_depth: Length
    """Depth c of the notch at the root, on a side [m]."""

    @property
    def length(self) -> float:
        return 2.0 * self.half_length

    @property
    def depth(self) -> float:
        return self.notch_depth

    @property
    def neck_radius(self) -> float:
        return 0.5 * self.neck_thickness / self._asymptote() ** 2

    def _asymptote(self) -> float:
        """Slope of the asymptote [1]."""
        d = self.notch_depth
        return float(np.sqrt(d * (d + self.neck_thickness))) / self.half_length

    def pieces(self) -> tuple[Piece, ...]:
        half_neck, slope = 0.5 * self.neck_thickness, self._asymptote()
        end = float(np.arcsinh(slope * self.half_length / half_neck))

        def branch(u: Array) -> tuple[Array, Array, Array, Array]:
            v = end * u
            sinh = np.sinh(v)
            x = half_neck / slope * sinh
            # cosh(v) - 1 without cancellation near the neck
            depth = 2.0 * half_neck * np.sinh(0.5 * v) ** 2
            dx, dy = half_neck / slope * np.cosh(v), half_neck * sinh
            return x, depth, np.arctan2(dy, dx), end * np.hypot(dx, dy)

        return (branch,)
