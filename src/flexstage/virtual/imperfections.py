"""A stage as it comes from the machine: necks and notches a little off, guides not straight."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hinges.registry import with_neck_thickness
from flexstage.lumped import hinge_springs, lumped_system
from flexstage.lumped.assemble import hinge_matrix, layout_of
from flexstage.quantities.units import DIMENSIONS, Angle, Length
from flexstage.stage import Stage
from flexstage.system import MechanicalSystem

#: Motions beside the one along the axis: sideways in the plane, out of it, and the rotations about
#: the axis, about the sideways direction and about the normal of the plane.
MOTIONS: tuple[str, ...] = ("across", "vertical", "roll", "pitch", "yaw")
#: Those that are angles.
ANGLES: tuple[str, ...] = ("roll", "pitch", "yaw")

#: Highest order of a curve: what bending and manufacture leave is smooth.
_ORDER = 5
_GRID = 4001


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GuideErrors:
    """Motions beside the one along the axis, as curves over the stroke.

    Examples
    --------
    >>> bow = GuideErrors(stroke=60e-6, coefficients={"across": np.array([0.0, 0.0, 1e-7])})
    >>> print(f"{bow.straightness('across') * 1e9:.0f} nm")
    150 nm
    """

    stroke: float
    """Length of the stroke [m]."""
    coefficients: Mapping[str, Array]
    """Coefficients of the Legendre polynomials over the stroke, from order 0 [m, or rad], by the
    names of `MOTIONS`, and ``along`` for what the position itself is off by.
    """

    def at(self, position: ArrayLike, motion: str) -> Array:
        """Return a motion.

        In m or rad, 0 at position 0; the motion is one of `MOTIONS`, or ``along``.
        """
        c = self.coefficients.get(motion)
        t = 2.0 * np.asarray(position, dtype=np.float64) / self.stroke - 1.0
        if c is None:
            return np.zeros_like(t)
        return legendre.legval(t, c) - legendre.legval(-1.0, c)

    def straightness(self, motion: str) -> float:
        """Return largest less smallest deviation from the least-squares straight line."""
        p = np.linspace(0.0, self.stroke, _GRID)
        e = self.at(p, motion)
        return float(np.ptp(e - straight_line(p, e)(p)))

    def slope(self, motion: str) -> float:
        """Return the slope of the least-squares straight line [1, or rad/m]."""
        p = np.linspace(0.0, self.stroke, _GRID)
        fitted = straight_line(p, self.at(p, motion)).convert().coef
        return float(fitted[1]) if fitted.size > 1 else 0.0

    def range(self, motion: str) -> float:
        """Return largest less smallest motion over the stroke [m, or rad]."""
        return float(np.ptp(self.at(np.linspace(0.0, self.stroke, _GRID), motion)))


def straight_line(x: Array, y: Array) -> np.polynomial.Polynomial:
    """Return the least-squares straight line of a curve, all positions alike.

    Of the integral over even positions, so that the ends count by half.
    """
    weight = np.ones(x.size)
    weight[[0, -1]] = 0.5**0.5
    return np.polynomial.Polynomial.fit(x, y, 1, w=weight)


def random_guide(
    stroke: float,
    straightness: Mapping[str, float],
    slopes: Mapping[str, float],
    rng: np.random.Generator,
) -> GuideErrors:
    """Draw smooth curves of given straightness and slope.

    Straightness is largest less smallest deviation from the least-squares line [m, or rad], slope
    that of the line [1, or rad/m], 0 where none is given. Drawn are Legendre polynomials of orders
    2 to 5, whose size falls with the order.
    """
    if not stroke > 0.0:
        raise ModelError(f"a stroke must be positive, got {stroke!r} m")
    coefficients: dict[str, Array] = {}
    for motion, wanted in straightness.items():
        order = np.arange(_ORDER + 1)
        c = np.where(order >= 2, rng.standard_normal(order.size) / np.maximum(order, 1) ** 1.5, 0.0)
        # one sign of the lowest order, so that no draw is nearly all high orders
        c[2] = np.copysign(0.5 + abs(c[2]), c[2])
        bent = GuideErrors(stroke=stroke, coefficients={motion: c}).straightness(motion)
        c *= wanted / bent
        c[1] = 0.5 * slopes.get(motion, 0.0) * stroke
        if motion == "along":
            # the position is right at both ends, which are those of the stroke
            c[1] = -float(c[3::2].sum())
        coefficients[motion] = c
    return GuideErrors(stroke=stroke, coefficients=coefficients)


def require_size(what: str, value: float) -> None:
    """Refuse a size that is negative or not finite."""
    if not 0.0 <= value < math.inf:
        raise ModelError(f"{what} must be 0 or more and finite, got {value!r}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """How far a process misses what it was told.

    `manufactured`, `displacements` and `flexstage.virtual.scattered_motion` draw necks, positions,
    modulus, lean and drive; `flexstage.studies.explore.tolerance` draws all but the lean, which
    does nothing in the plane.

    Notes
    -----
    Validity: the usual values are those of good wire erosion, a few micrometres, of a ground plate,
    of one heat of an alloy, of a laboratory, and of stacks as their makers give them (10 % as two
    standard deviations); they are no measurement of any machine.
    """

    neck_common: Length = 4e-6
    """Standard deviation of what all necks of a stage are off by, as from the wire's width: twice
    the offset of the contours [m].
    """
    neck_own: Length = 2e-6
    """Standard deviation of what each neck is off by beside that [m]."""
    position: Length = 3e-6
    """Standard deviation of each coordinate of a notch [m]."""
    modulus: float = 0.01
    """Relative standard deviation of Young's modulus [1]."""
    lean: Angle = 1e-4
    """Standard deviation of each tilt of a notch's axis: 1 um over a plate of 10 mm [rad]."""
    drive: Length = 50e-6
    """Standard deviation of where a drive pushes, in the plane and along its normal [m]."""
    radius: Length = 2e-6
    """Standard deviation of the radius of each notch at its neck; of one that has none there, as a
    leaf, of half its length [m].
    """
    thickness: Length = 10e-6
    """Standard deviation of the thickness of the plate [m]."""
    density: float = 0.003
    """Relative standard deviation of the density [1]."""
    temperature: Annotated[float, DIMENSIONS["temperature"]] = 1.0
    """Standard deviation of the temperature, as it expands the plate [K]."""
    stroke: float = 0.05
    """Relative standard deviation of the free displacement of each piezo stack [1]."""

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            require_size(f"scatter of {name}", getattr(self, name))


def manufactured(stage: Stage, scatter: Scatter, *, seed: int = 0) -> Stage:
    """Draw one stage from a process.

    Outlines of bodies stay, as the masses that they give change by far less.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> stage = design("vgtu-piezo")
    >>> made = manufactured(stage, Scatter(), seed=3)
    >>> off = made.hinges[0].profile.neck_thickness - stage.hinges[0].profile.neck_thickness
    >>> print(f"{off * 1e6:.1f} um")
    1.3 um
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    shift = scatter.neck_common * rng.standard_normal()
    factor = 1.0 + scatter.modulus * rng.standard_normal()
    hinges = []
    for hinge in stage.hinges:
        own = shift + scatter.neck_own * rng.standard_normal()
        neck = hinge.profile.neck_thickness + own
        if not neck > 0.2 * hinge.profile.neck_thickness:
            raise ModelError(
                f"a scatter of {scatter.neck_common:g} and {scatter.neck_own:g} m leaves hinge "
                f"'{hinge.name}' a neck of {neck:.3g} m: give a finer process"
            )
        hinges.append(replace(hinge, profile=with_neck_thickness(hinge.profile, float(neck))))
    modulus = float(factor) * stage.material.youngs_modulus
    return replace(
        stage, hinges=tuple(hinges), material=replace(stage.material, youngs_modulus=modulus)
    )


def displacements(
    stage: Stage, scatter: Scatter, *, seed: int = 0
) -> dict[str, tuple[float, float]]:
    """Draw how far each notch is out of place, along x and y [m]."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(3,)))
    moved = scatter.position * rng.standard_normal((len(stage.hinges), 2))
    return {h.name: (float(d[0]), float(d[1])) for h, d in zip(stage.hinges, moved, strict=True)}


def displaced_system(stage: Stage, moved: Mapping[str, tuple[float, float]]) -> MechanicalSystem:
    """Return the lumped model of a stage whose notches are out of place.

    Each spring acts at its displaced neck; outlines, and with them masses and roots, stay where
    they were drawn. `moved` says by hinge how far its neck is off along x and y [m].

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.system import modes
    >>> stage = design("vgtu-piezo")
    >>> off = displaced_system(stage, {"xlko-u": (0.0, 50e-6)})
    >>> change = modes(off).frequency_hz[0] / modes(lumped_system(stage)).frequency_hz[0] - 1.0
    >>> print(f"{100.0 * change:.2f} %")
    0.17 %
    """
    system = lumped_system(stage)
    layout = layout_of(stage)
    K = system.K.copy()
    for spring in hinge_springs(stage):
        dx, dy = moved.get(spring.hinge.name, (0.0, 0.0))
        at = (spring.hinge.at[0] + dx, spring.hinge.at[1] + dy)
        drawn = hinge_matrix(layout, spring.hinge)
        made = hinge_matrix(layout, replace(spring.hinge, at=at))
        K += made.T @ spring.stiffness @ made - drawn.T @ spring.stiffness @ drawn
    return replace(system, K=0.5 * (K + K.T))
