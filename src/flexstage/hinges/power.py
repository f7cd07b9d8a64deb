"""Notch whose depth grows as a power of the distance from the neck."""

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from flexstage.errors import HingeError
from flexstage.hinges.profile import Array, CurvedProfile, Length, Piece


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerFunction(CurvedProfile):
    """Notch of depth ``notch_depth * (x / half_length)**exponent``.

    Raises
    ------
    HingeError
        The exponent is out of its range.

    Examples
    --------
    >>> notch = PowerFunction(
    ...     neck_thickness=0.5e-3, half_length=2e-3, notch_depth=1e-3, exponent=4.0
    ... )
    >>> notch.neck_radius
    inf
    """

    kind: ClassVar[str] = "power"

    half_length: Length
    """Distance from the neck to the root [m]."""
    notch_depth: Length
    """Depth of the notch at the root, on a side [m]."""
    exponent: float
    """The power n, 2 to 32 [1]; 2 is the parabola, and a large one comes near a leaf."""

    def _check(self) -> None:
        if not 2.0 <= self.exponent <= 32.0:
            raise HingeError(
                f"power notch: exponent must lie between 2 and 32, got {self.exponent!r}"
            )

    @property
    def length(self) -> float:
        return 2.0 * self.half_length

    @property
    def depth(self) -> float:
        return self.notch_depth

    @property
    def neck_radius(self) -> float:
        if self.exponent > 2.0:
            return float("inf")
        return self.half_length**2 / (2.0 * self.notch_depth)

    def pieces(self) -> tuple[Piece, ...]:
        # high powers turn up near the root only, so the root gets panels of its own; a broken
        # exponent is not smooth at the neck in x, but as good as smooth in x**(1/4)
        cuts = (0.0, 0.0625, 0.5, 0.75, 0.875, 1.0)
        return tuple(self._part(a, b, 4 if a == 0.0 else 1) for a, b in pairwise(cuts))

    def _part(self, start: float, end: float, root: int = 1) -> Piece:
        """Return a part of the curve, in shares of its half length."""
        half, d, n = self.half_length, self.notch_depth, self.exponent

        def curve(u: Array) -> tuple[Array, Array, Array, Array]:
            v = start + (end - start) * u**root
            slope = n * d / half * v ** (n - 1.0)
            speed = root * u ** (root - 1) * (end - start) * half * np.hypot(1.0, slope)
            return half * v, d * v**n, np.arctan(slope), speed

        return curve
