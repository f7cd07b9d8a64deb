"""Notches whose contour is a conic section or a power of the distance from the neck."""

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from flexstage.base.errors import HingeError
from flexstage.hinges.profile import Array, CurvedProfile, Length, Piece, Profile, Vertex


@dataclass(frozen=True, slots=True, kw_only=True)
class RightCircular(Profile):
    """Notch of half circles of one radius.

    Examples
    --------
    >>> RightCircular(neck_thickness=0.5e-3, radius=1.0e-3).root_height
    0.0025
    """

    kind: ClassVar[str] = "circular"

    radius: Length
    """Radius R of the circle [m]."""

    @property
    def length(self) -> float:
        return 2.0 * self.radius

    @property
    def depth(self) -> float:
        return self.radius

    @property
    def neck_radius(self) -> float:
        return self.radius

    def pieces(self) -> tuple[Piece, ...]:
        def quarter(u: Array) -> tuple[Array, Array, Array, Array]:
            angle = 0.5 * np.pi * u
            speed = np.full_like(u, 0.5 * np.pi * self.radius)
            # 1 - cos(a) without cancellation near the neck
            depth = 2.0 * self.radius * np.sin(0.5 * angle) ** 2
            return self.radius * np.sin(angle), depth, angle, speed

        return (quarter,)

    def contour(self) -> tuple[Vertex, ...]:
        return (
            Vertex(0.0, 0.0, float(np.tan(np.pi / 8.0))),
            Vertex(self.radius, self.radius),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _ToTheRoot(CurvedProfile):
    """Notch that is given by the position of its root."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Elliptical(_ToTheRoot):
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Parabolic(_ToTheRoot):
    """Notch whose depth grows with the square of the distance from the neck.

    Examples
    --------
    >>> notch = Parabolic(neck_thickness=0.5e-3, half_length=2e-3, notch_depth=1e-3)
    >>> notch.neck_radius
    0.002
    """

    kind: ClassVar[str] = "parabolic"

    @property
    def neck_radius(self) -> float:
        return self.half_length**2 / (2.0 * self.notch_depth)

    def pieces(self) -> tuple[Piece, ...]:
        half, d = self.half_length, self.notch_depth

        def parabola(u: Array) -> tuple[Array, Array, Array, Array]:
            slope = 2.0 * d / half * u
            return half * u, d * u**2, np.arctan(slope), half * np.hypot(1.0, slope)

        return (parabola,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hyperbolic(_ToTheRoot):
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


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerFunction(_ToTheRoot):
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

    exponent: float
    """The power n, 2 to 32 [1]; 2 is the parabola, and a large one approaches a leaf."""

    def _check(self) -> None:
        if not 2.0 <= self.exponent <= 32.0:
            raise HingeError(
                f"power notch: exponent must lie between 2 and 32, got {self.exponent!r}"
            )

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
