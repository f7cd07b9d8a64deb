"""Imperfections of a manufactured stage: scatter of necks and notches, guide errors."""

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

#: Error motions of an axis (ISO 230): straightness in the plane and out of it, and rotations about
#: the axis, about the lateral direction and about the normal of the plane.
MOTIONS: tuple[str, ...] = ("across", "vertical", "roll", "pitch", "yaw")
#: Error motions that are angles.
ANGLES: tuple[str, ...] = ("roll", "pitch", "yaw")

#: Highest order of a curve: error motions by bending and manufacture are smooth.
ORDER = 5
_GRID = 4001


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GuideErrors:
    """Error motions of an axis as curves over the stroke.

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
    names of `MOTIONS`; ``along`` is the position error.
    """

    def at(self, position: ArrayLike, motion: str) -> Array:
        """Return an error motion [m, or rad], 0 at position 0: one of `MOTIONS`, or ``along``."""
        c = self.coefficients.get(motion)
        t = 2.0 * np.asarray(position, dtype=np.float64) / self.stroke - 1.0
        if c is None:
            return np.zeros_like(t)
        return legendre.legval(t, c) - legendre.legval(-1.0, c)

    def straightness(self, motion: str) -> float:
        """Return the peak-to-valley deviation from the least-squares straight line."""
        p = np.linspace(0.0, self.stroke, _GRID)
        e = self.at(p, motion)
        return float(np.ptp(e - straight_line(p, e)(p)))

    def slope(self, motion: str) -> float:
        """Return the slope of the least-squares straight line [1, or rad/m]."""
        p = np.linspace(0.0, self.stroke, _GRID)
        line = straight_line(p, self.at(p, motion)).convert().coef
        return float(line[1]) if line.size > 1 else 0.0

    def range(self, motion: str) -> float:
        """Return the peak-to-valley motion over the stroke [m, or rad]."""
        return float(np.ptp(self.at(np.linspace(0.0, self.stroke, _GRID), motion)))


def straight_line(x: Array, y: Array) -> np.polynomial.Polynomial:
    """Return the least-squares straight line of a curve at equally spaced positions.

    The sum approximates the integral: the two ends have half the weight.
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

    Straightness is the peak-to-valley deviation from the least-squares line [m, or rad], slope that
    of the line [1, or rad/m], by default 0. The curves are Legendre polynomials of orders 2 to 5,
    whose size falls with the order.
    """
    if not stroke > 0.0:
        raise ModelError(f"the stroke of a guide must be positive, got {stroke!r} m")
    coefficients: dict[str, Array] = {}
    for motion, target in straightness.items():
        order = np.arange(ORDER + 1)
        c = np.where(order >= 2, rng.standard_normal(order.size) / np.maximum(order, 1) ** 1.5, 0.0)
        # the lowest order is at least 0.5, so that high orders never dominate
        c[2] = np.copysign(0.5 + abs(c[2]), c[2])
        drawn_straightness = GuideErrors(stroke=stroke, coefficients={motion: c}).straightness(
            motion
        )
        c *= target / drawn_straightness
        c[1] = 0.5 * slopes.get(motion, 0.0) * stroke
        if motion == "along":
            # no position error at both ends of the stroke
            c[1] = -float(c[3::2].sum())
        coefficients[motion] = c
    return GuideErrors(stroke=stroke, coefficients=coefficients)


def require_size(what: str, value: float) -> None:
    """Refuse a size that is negative or not finite."""
    if not 0.0 <= value < math.inf:
        raise ModelError(f"{what} must be 0 or more and finite, got {value!r}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """Standard deviations of a manufacturing process.

    `manufactured`, `displacements` and `flexstage.virtual.scattered_motion` draw necks, positions,
    modulus, lean and drive; `flexstage.studies.explore.tolerance` draws all but the lean, which has
    no effect in the plane.

    Notes
    -----
    Validity: the usual values are those of good wire erosion, a few micrometres, of a ground plate,
    of one heat of an alloy, of a laboratory, and of stacks by their data sheets (10 % as two
    standard deviations); they were not measured on a machine.
    """

    neck_common: Length = 4e-6
    """Standard deviation of the neck error common to all necks of a stage, such as by the wire
    offset: twice the offset of the contours [m].
    """
    neck_own: Length = 2e-6
    """Standard deviation of the individual neck error [m]."""
    position: Length = 3e-6
    """Standard deviation of each coordinate of a notch [m]."""
    modulus: float = 0.01
    """Relative standard deviation of Young's modulus [1]."""
    lean: Angle = 1e-4
    """Standard deviation of each tilt of a notch's axis: 1 um over a plate of 10 mm [rad]."""
    drive: Length = 50e-6
    """Standard deviation of the line of action of a drive, in the plane and normal to it [m]."""
    radius: Length = 2e-6
    """Standard deviation of the radius of each notch at its neck; for a profile without one, such
    as a leaf, of half its length [m].
    """
    thickness: Length = 10e-6
    """Standard deviation of the thickness of the plate [m]."""
    density: float = 0.003
    """Relative standard deviation of the density [1]."""
    temperature: Annotated[float, DIMENSIONS["temperature"]] = 1.0
    """Standard deviation of the temperature, which expands the plate [K]."""
    stroke: float = 0.05
    """Relative standard deviation of the free displacement of each piezo stack [1]."""

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            require_size(f"scatter of {name}", getattr(self, name))


def manufactured(stage: Stage, scatter: Scatter, *, seed: int = 0) -> Stage:
    """Return one random stage from a process.

    Outlines of bodies do not change: masses scatter by far less. The modulus is that of the plate,
    and bodies of another material keep theirs.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> stage = design("vgtu-piezo")
    >>> part = manufactured(stage, Scatter(), seed=3)
    >>> off = part.hinges[0].profile.neck_thickness - stage.hinges[0].profile.neck_thickness
    >>> print(f"{off * 1e6:.1f} um")
    1.3 um
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    shift = scatter.neck_common * rng.standard_normal()
    factor = 1.0 + scatter.modulus * rng.standard_normal()
    hinges = []
    for hinge in stage.hinges:
        deviation = shift + scatter.neck_own * rng.standard_normal()
        neck = hinge.profile.neck_thickness + deviation
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
    """Return the random position error of each notch, along x and y [m]."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(3,)))
    moved = scatter.position * rng.standard_normal((len(stage.hinges), 2))
    return {h.name: (float(d[0]), float(d[1])) for h, d in zip(stage.hinges, moved, strict=True)}


def displaced_system(stage: Stage, moved: Mapping[str, tuple[float, float]]) -> MechanicalSystem:
    """Return the lumped model of a stage with displaced notches.

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
        nominal = hinge_matrix(layout, spring.hinge)
        displaced = hinge_matrix(layout, replace(spring.hinge, at=at))
        K += displaced.T @ spring.stiffness @ displaced - nominal.T @ spring.stiffness @ nominal
    return replace(system, K=0.5 * (K + K.T))
