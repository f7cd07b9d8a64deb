"""Parabolic notch."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexstage.hinges.profile import Array, CurvedProfile, Length, Piece


@dataclass(frozen=True, slots=True, kw_only=True)
class Parabolic(CurvedProfile):
    """Notch whose depth grows with the square of the distance from the neck.

    Examples
    --------
    >>> notch = Parabolic(neck_thickness=0.5e-3, half_length=2e-3, notch_depth=1e-3)
    >>> notch.neck_radius
    0.002
    """

    kind: ClassVar[str] = "parabolic"

    half_length: Length
    """Distance from the neck to the root [m]."""
    notch_depth: Length
    """Depth of the notch at the root, on a side [m]."""

    @property
    def length(self) -> float:
        return 2.0 * self.half_length

    @property
    def depth(self) -> float:
        return self.notch_depth

    @property
    def neck_radius(self) -> float:
        return self.half_length**2 / (2.0 * self.notch_depth)

    def pieces(self) -> tuple[Piece, ...]:
        half, d = self.half_length, self.notch_depth

        def parabola(u: Array) -> tuple[Array, Array, Array, Array]:
            slope = 2.0 * d / half * u
            return half * u, d * u**2, np.arctan(slope), half * np.hypot(1.0, slope)

        return (parabola,)
