"""Seats of drives: the contacts at the ends of an actuator, each with its force and approach."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np

from flexstage.base.arrays import Array
from flexstage.files.ranges import NOT_NEGATIVE, POSITIVE, Size
from flexstage.quantities.units import DIMENSIONS, Stiffness


@dataclass(frozen=True, slots=True, kw_only=True)
class Seat(ABC):
    """Base class of seats; use one of its kinds."""

    kind: ClassVar[str]

    pulls: ClassVar[bool] = False
    """True if the seat holds a pulling force; else the drive lifts off."""

    @abstractmethod
    def approach(self, force: float, preload: float) -> float:
        """Return the approach of both bodies from a preload to a force, both pressing [m]."""

    def approaches(self, force: Array, preload: float) -> Array:
        """Return the approaches of both bodies from a preload to forces that press [m]."""
        # laws of powers take arrays as they are
        return np.asarray(self.approach(force, preload))  # type: ignore[arg-type]

    @abstractmethod
    def stiffness(self, force: float) -> float:
        """Return the stiffness against small vibrations under a pressing force [N/m]."""


@dataclass(frozen=True, kw_only=True)
class BallSeat(Seat):
    r"""A ball or a crowned end on a flat, or two crossed cylinders.

    .. math:: \delta = \left(\frac{9 F^2}{16 R E^{*2}}\right)^{1/3} F_2, \quad
              k = \frac{3 F}{2 \delta}

    F is the force [N], R the geometric mean of the principal radii of relative curvature [m] and
    E* the contact modulus [Pa]; F2 is 1 for equal radii, and less for others.

    Notes
    -----
    H. Hertz, J. reine angew. Math. 92 (1882) 156; K. L. Johnson, Contact Mechanics, Cambridge
    University Press 1985, sections 4.1 and 4.2. Valid for smooth elastic surfaces without adhesion,
    a contact that is small against the radii, and a pressure below 1.6 times the yield strength of
    the softer body (no permanent dent).
    """

    kind: ClassVar[str] = "ball"

    radius: Size
    """Radius of relative curvature [m]: that of a ball on a flat."""
    second_radius: Size | None = None
    """The other principal radius of relative curvature [m], of crossed cylinders of different
    radii; equal where not given.
    """
    contact_modulus: Annotated[float, DIMENSIONS["pressure"], POSITIVE]
    """1/E* = sum of (1 - nu^2)/E of both bodies [Pa]: 59.7 GPa for steel on aluminium, 115.4 GPa
    for steel on steel.
    """

    @cached_property
    def _ellipse(self) -> tuple[float, float, float]:
        """Mean radius [m] and the factors F1 and F2 of the size and the approach."""
        other = self.radius if self.second_radius is None else self.second_radius
        mean, ratio = math.sqrt(self.radius * other), max(self.radius, other)
        ratio = ratio / min(self.radius, other)
        if ratio < 1.0 + 1e-9:
            return mean, 1.0, 1.0
        from scipy.optimize import brentq
        from scipy.special import ellipe, ellipk

        def curvature(axes: float) -> float:
            m = 1.0 - axes**-2
            return (axes**2 * ellipe(m) - ellipk(m)) / (ellipk(m) - ellipe(m)) - ratio

        root: Any = brentq(curvature, 1.0 + 1e-9, 10.0 * ratio)
        axes = float(root)
        m = 1.0 - axes**-2
        k, e = float(ellipk(m)), float(ellipe(m))
        f1 = (4.0 / (math.pi * m) * axes**-1.5 * math.sqrt((axes**2 * e - k) * (k - e))) ** (1 / 3)
        return mean, f1, 2.0 / math.pi * k / (math.sqrt(axes) * f1)

    def _depth(self, force: float) -> float:
        mean, _, factor = self._ellipse
        return factor * (9.0 * force**2 / (16.0 * mean * self.contact_modulus**2)) ** (1.0 / 3.0)

    def approach(self, force: float, preload: float) -> float:
        return self._depth(force) - self._depth(preload)

    def stiffness(self, force: float) -> float:
        return 1.5 * force / self._depth(force) if force > 0.0 else 0.0

    def pressure(self, force: float) -> float:
        """Return the largest pressure under a force [Pa]."""
        mean, size, _ = self._ellipse
        cube = 6.0 * force * self.contact_modulus**2 / (math.pi**3 * mean**2)
        return float(cube ** (1.0 / 3.0) / size**2)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlatSeat(Seat):
    r"""Two flat surfaces that touch at their asperities.

    .. math:: F = F_0 \exp(\delta/\lambda), \quad k = F/\lambda

    Notes
    -----
    J. A. Greenwood and J. B. P. Williamson, Proc. R. Soc. A 295 (1966) 300, with heights of an
    exponential distribution. The length lambda is near the rms height of the rougher surface:
    0.1 um where ground, 0.7 um at a roughness Sa of 1.6 um. Valid while the surfaces touch at few
    asperities: not for a stiffness above that of the bodies themselves.
    """

    kind: ClassVar[str] = "flat"

    roughness_length: Size
    """Approach that raises the force by the factor e [m]."""

    def approach(self, force: float, preload: float) -> float:
        if force <= 0.0:
            return -math.inf
        return self.roughness_length * math.log(force / preload)

    def approaches(self, force: Array, preload: float) -> Array:
        with np.errstate(divide="ignore"):
            return self.roughness_length * np.log(np.maximum(force, 0.0) / preload)

    def stiffness(self, force: float) -> float:
        return force / self.roughness_length


@dataclass(frozen=True, slots=True, kw_only=True)
class TipSeat(Seat):
    """A flexible tip, or a joint that is glued or screwed: a spring that also pulls."""

    kind: ClassVar[str] = "tip"
    pulls: ClassVar[bool] = True

    axial_stiffness: Annotated[Stiffness, POSITIVE]
    """Stiffness along the drive [N/m]."""

    def approach(self, force: float, preload: float) -> float:
        return (force - preload) / self.axial_stiffness

    def stiffness(self, force: float) -> float:
        return self.axial_stiffness


#: Kinds of seats, as files name them.
SEATS: dict[str, type[Seat]] = {kind.kind: kind for kind in (BallSeat, FlatSeat, TipSeat)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Preload:
    """A force that presses a drive on its seats while it is at rest."""

    force: Annotated[float, DIMENSIONS["force"], POSITIVE]
    """Pressing force at rest [N]."""
    spring_stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 0.0
    """Stiffness of the spring between both bodies of the drive [N/m]; 0 for a soft spring, or for
    a preload by the hinges of the stage.
    """


def seats_stiffness(seats: Sequence[Seat], force: float) -> float:
    """Return the stiffness of seats in series under a pressing force [N/m]; infinite for none."""
    each = [seat.stiffness(force) for seat in seats]
    if 0.0 in each:
        return 0.0
    return 1.0 / sum(1.0 / k for k in each) if each else math.inf
