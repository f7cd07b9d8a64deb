"""Elliptical notch: longer and more compliant than a circular one of the same depth."""

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from flexstage.hinges.profile import Array, CurvedProfile, Length, Piece


@dataclass(frozen=True, slots=True, kw_only=True)
class Elliptical(CurvedProfile):
    """Notch of half ellipses.

    Examples
    --------
    >>> notch = Elliptical(neck_thickness=0.5e-3, half_length=2e-3, notch_depth=1e-3)
    >>> notch.neck_radius
    0.004
    """

    kind: ClassVar[str] = "elliptical"

    half_length: Length
    """Semi-axis of the ellipse along the hinge [m]."""
    notch_depth: Length
    """Semi-axis of the ellipse across the hinge, the depth of the notch on a side [m]."""

    @property
    def length(self) -> float:
        return 2.0 * self.half_length

    @property
    def depth(self) -> float:
        return self.notch_depth

    @property
    def neck_radius(self) -> float:
        return self.half_length**2 / self.notch_depth

    def pieces(self) -> tuple[Piece, ...]:
        # a long ellipse turns within the last b/a of it, so that end gets pieces of its own
        aspect = self.half_length / self.notch_depth
        number = int(np.clip(np.ceil(np.log2(aspect)) + 1.0, 0.0, 10.0))
        cuts = (0.0, *(1.0 - 0.5 ** np.arange(1, number + 1)), 1.0)
        return tuple(self._arc(float(p), float(q)) for p, q in pairwise(cuts))

    def _arc(self, start: float, end: float) -> Piece:
        """Return a part of the quarter ellipse, in shares of its eccentric angle."""
        a, b, share = self.half_length, self.notch_depth, 0.5 * np.pi * (end - start)

        def arc(u: Array) -> tuple[Array, Array, Array, Array]:
            phi = 0.5 * np.pi * start + share * u
            # the angle from the root keeps its digits where the slope turns steep
            rest = 0.5 * np.pi * (1.0 - end) + share * (1.0 - u)
            cos = np.sin(rest)
            # 1 - cos(phi) without cancellation near the neck
            depth = 2.0 * b * np.sin(0.5 * phi) ** 2
            angle = np.arctan2(b * np.sin(phi), a * cos)
            return a * np.sin(phi), depth, angle, share * np.hypot(a * cos, b * np.sin(phi))

        return arc
