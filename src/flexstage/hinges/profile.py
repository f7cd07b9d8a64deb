"""What every notch profile has: its dimensions, its shape as a curve, its outline for drawing."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import HingeError
from flexstage.units import Length

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(20)


def _differentiation(nodes: Array) -> Array:
    """Matrix that takes values of a polynomial at its nodes to its derivatives there."""
    apart = nodes[:, None] - nodes[None, :] + np.eye(nodes.size)
    product = np.prod(apart, axis=1)
    matrix = product[:, None] / (product[None, :] * apart)
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -np.sum(matrix, axis=1))
    return matrix


_DERIVATIVES = _differentiation(_POINTS)
# panels graded towards the neck, where the compliance of a thin notch is concentrated
_PANELS = np.concatenate(([0.0], 2.0 ** np.arange(-9.0, 1.0)))


class Samples(NamedTuple):
    """Quadrature points along the contour of one half of a notch, from the neck to the root."""

    x: Array
    """Distance from the neck along the hinge [m], shape (n,)."""
    depth: Array
    """Distance of the contour from the neck's surface, across the hinge [m], shape (n,)."""
    angle: Array
    """Slope of the contour against the hinge axis, 0 to pi/2 [rad], shape (n,)."""
    ds: Array
    """Quadrature weight times arc length [m], shape (n,); ``cos(angle) * ds`` integrates over x."""


class Vertex(NamedTuple):
    """A point of the contour, and how the contour goes on from it."""

    x: float
    """Distance from the neck along the hinge [m]."""
    depth: float
    """Distance from the neck's surface [m]."""
    bulge: float = 0.0
    """Tangent of a quarter of the angle of the arc to the next vertex, positive if it turns left
    [1]; 0 for a straight line.
    """


def increments(values: Array) -> Array:
    """Return the increments of a function along the contour: quadrature weight times derivative.

    The function is given at the points of `Profile.samples` and smooth in each piece; the
    increments are what ``ds`` is for the arc length.
    """
    panels = values.reshape(-1, _POINTS.size)
    return ((panels @ _DERIVATIVES.T) * _WEIGHTS).ravel()


#: A smooth piece of the contour: maps u in [0, 1] to (x, depth, angle, ds/du).
Piece = Callable[[Array], tuple[Array, Array, Array, Array]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile(ABC):
    """A notch, symmetric about its neck; cut from both sides, or from one.

    Raises
    ------
    HingeError
        A dimension is not positive and finite.
    """

    kind: ClassVar[str]

    neck_thickness: Length
    """Smallest thickness t [m]."""
    one_sided: bool = False
    """Whether the notch is cut on one side only (the left one, looking along the hinge), the other
    side being straight.
    """

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            is_size = isinstance(value, (int, float)) and not isinstance(value, bool)
            if is_size and not 0.0 < value < float("inf"):
                raise HingeError(
                    f"{self.kind} notch: {name} must be positive and finite, got {value!r}"
                )
        self._check()

    def _check(self) -> None:  # noqa: B027
        """Refuse impossible combinations of dimensions; a profile overrides it where it has any."""

    @property
    @abstractmethod
    def length(self) -> float:
        """Length of the whole notch along the hinge [m]."""

    @property
    @abstractmethod
    def depth(self) -> float:
        """Depth of the notch at its root, on one side [m]."""

    @property
    @abstractmethod
    def neck_radius(self) -> float:
        """Radius of curvature of the contour where the stress is largest [m]."""

    @abstractmethod
    def pieces(self) -> tuple[Piece, ...]:
        """Return the contour from the neck to the root as smooth pieces."""

    @abstractmethod
    def contour(self) -> tuple[Vertex, ...]:
        """Return the contour from the neck to the root as lines and arcs."""

    @property
    def flat_length(self) -> float:
        """Length of the part about the neck that has constant thickness [m]."""
        return 0.0

    @property
    def step(self) -> float:
        """Height of the sharp step at the root, on one side [m]."""
        return 0.0

    @property
    def sides(self) -> int:
        """Number of sides that are cut."""
        return 1 if self.one_sided else 2

    @property
    def root_height(self) -> float:
        """Height of the notch where it meets the bodies [m]."""
        return self.neck_thickness + self.sides * self.depth

    def samples(self) -> Samples:
        """Return quadrature points along half of the contour.

        Returns
        -------
        Samples
            Gauss points on panels graded towards the neck.
        """
        left, width = _PANELS[:-1, None], np.diff(_PANELS)[:, None]
        u = (left + width * (_POINTS + 1.0) / 2.0).ravel()
        w = (width * _WEIGHTS / 2.0).ravel()
        columns = []
        for piece in self.pieces():
            x, depth, angle, speed = piece(u)
            columns.append((x, depth, angle, speed * w))
        return Samples(*(np.concatenate(c) for c in zip(*columns, strict=True)))

    def half_area_integrals(self) -> tuple[float, float, float, float]:
        """Integrate 1, x, y and x^2 + y^2 over half of the notch's material.

        Returns
        -------
        tuple of float
            Area [m^2], first moments along and across the hinge [m^3], polar moment about the neck
            [m^4].
        """
        x, depth, angle, ds = self.samples()
        dx = np.cos(angle) * ds
        h = self.neck_thickness + self.sides * depth
        e = 0.5 * depth if self.one_sided else np.zeros_like(depth)
        return (
            float(np.sum(h * dx)),
            float(np.sum(x * h * dx)),
            float(np.sum(e * h * dx)),
            float(np.sum((x**2 * h + e**2 * h + h**3 / 12.0) * dx)),
        )
