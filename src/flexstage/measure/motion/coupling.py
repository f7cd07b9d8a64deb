"""Cross-coupling and squareness of two axes, from their paths."""

import math
from dataclasses import dataclass, replace

from flexstage.errors import ModelError
from flexstage.estimate import Component, Estimate
from flexstage.measure.motion.curve_extremes import curve_range
from flexstage.measure.motion.motion_curve import MotionCurve


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coupling:
    """What an axis moves across its direction."""

    slope: Estimate
    """Motion across for a unit of motion along, by least squares [1]."""
    angle: Estimate
    """The angle of the path to the direction of the sensors along [rad]."""
    largest: Estimate
    """Largest less smallest displacement across, over the stroke [m]."""
    share: Estimate
    """That over the stroke [1]."""


def cross_coupling(
    curve: MotionCurve, *, alignment: Estimate | None = None, seed: int = 0
) -> Coupling:
    """Find the cross-coupling of an axis from its displacement across over that along.

    A sensor that is turned by an angle shows that angle as coupling: what is known of it is taken
    off the slope, and its uncertainty joins that of the slope.

    Parameters
    ----------
    curve : MotionCurve
        Displacement across over displacement along, both measured [m].
    alignment : Estimate, optional
        Angle by which the frame of the sensors has to turn, from along to across, to meet that of
        the stage: it is added to the slope [rad]. Nothing is taken off or added where not given.
    seed : int
        Seed of the simulation that finds what noise adds to a range.

    Returns
    -------
    Coupling
        Slope, angle and range.

    Validity
    --------
    Angles that are small: the slope and the alignment add as they are below some 10 mrad. Without
    an alignment nobody can tell coupling from a sensor that is turned.

    Raises
    ------
    ModelError
        Position and reading of the curve do not have the same unit, or the alignment is no angle.

    Examples
    --------
    >>> import numpy as np
    >>> from flexstage.measure.motion.curve_fit import fit_motion_curve
    >>> t = np.arange(900) / 300.0
    >>> along = 4e-5 * (1.0 - np.cos(2.0 * np.pi * t))
    >>> curve = fit_motion_curve(along, 2.3e-3 * along, t)
    >>> turned = Estimate(value=-4e-4, unit="rad")
    >>> print(f"{cross_coupling(curve, alignment=turned).slope.value:.4f}")
    0.0019
    """
    if curve.unit != curve.position_unit:
        raise ModelError(
            "cross-coupling compares two displacements in one unit, got a reading in "
            f"'{curve.unit}' over a position in '{curve.position_unit}'"
        )
    found = curve.slope()
    if alignment is not None:
        found = _joined(found, alignment)
    extent = curve.basis.high - curve.basis.low
    largest = curve_range(curve, seed=seed)
    return Coupling(
        slope=found, angle=_angle(found), largest=largest, share=largest.times(1.0 / extent, "1")
    )


def squareness(
    y_over_x: MotionCurve, x_over_y: MotionCurve, *, alignment: Estimate | None = None
) -> Estimate:
    """Return the angle between the paths of two axes less a right angle.

    Its sign is that of the angle from the path of x to that of y, counterclockwise, less pi/2:
    negative where the positive directions come closer together. A turn of both sensors in their
    plane does not enter it.

    Parameters
    ----------
    y_over_x : MotionCurve
        Displacement along y over that along x while x moves [m].
    x_over_y : MotionCurve
        Displacement along x over that along y while y moves [m].
    alignment : Estimate, optional
        Angle between the directions of the two sensors less a right angle, which is added [rad].

    Returns
    -------
    Estimate
        The squareness [rad].

    Validity
    --------
    The two paths were measured in runs that are independent of each other.

    Raises
    ------
    ModelError
        A curve does not have the same unit for both of its displacements, or the alignment is no
        angle.

    Examples
    --------
    >>> import numpy as np
    >>> from flexstage.measure.motion.curve_fit import fit_motion_curve
    >>> t = np.arange(900) / 300.0
    >>> s = 4e-5 * (1.0 - np.cos(2.0 * np.pi * t))
    >>> one, two = fit_motion_curve(s, 2e-3 * s, t), fit_motion_curve(s, -1.4e-3 * s, t)
    >>> print(f"{1e3 * squareness(one, two).value:.2f} mrad")
    -0.60 mrad
    """
    angles = []
    for name, curve in (("x", y_over_x), ("y", x_over_y)):
        if curve.unit != curve.position_unit:
            raise ModelError(
                f"the path of {name} needs two displacements in one unit, got a reading in "
                f"'{curve.unit}' over a position in '{curve.position_unit}'"
            )
        angles.append(_angle(curve.slope()))
    parts = tuple(
        Component(
            name=f"{part.name} of {name}",
            uncertainty=part.uncertainty,
            degrees_of_freedom=part.degrees_of_freedom,
            kind=part.kind,
        )
        for name, angle in zip("xy", angles, strict=True)
        for part in angle.components
    )
    found = Estimate(value=-angles[0].value - angles[1].value, unit="rad", components=parts)
    return found if alignment is None else _joined(found, alignment)


def _angle(slope: Estimate) -> Estimate:
    """Return the angle of a slope, with the uncertainty that its derivative gives."""
    turned = slope.times(1.0 / (1.0 + slope.value**2), "rad")
    return replace(turned, value=math.atan(slope.value))


def _joined(found: Estimate, alignment: Estimate) -> Estimate:
    if alignment.unit != "rad":
        raise ModelError(f"an alignment is an angle in rad, got '{alignment.unit}'")
    part = Component(
        name="alignment",
        uncertainty=alignment.uncertainty,
        degrees_of_freedom=alignment.degrees_of_freedom,
        kind="B",
    )
    return replace(found.plus(part), value=found.value + alignment.value)
